// The runtime through its public C API, in a headless context that serves all scenes.
#include "eval/headless_gl.h"
#include "eval/runtime_types.h"
#include "selftest/back_end.h"

#include "nacre/nacre.h"

#include <cstring>

namespace nacre::selftest {

namespace {

constexpr unsigned kRgba16f = 0x881A; // GL_RGBA16F

class GlBackEnd final : public BackEnd {
public:
    ~GlBackEnd() override
    {
        if (gl_) gl_->makeCurrent();
        nacreContextDestroy(context_);
    }

    Status open(NacreBackEnd backEnd, const Hooks& hooks)
    {
        auto gl = HeadlessGl::create();
        if (!gl) return gl.error();
        gl_ = std::move(*gl);
        NacreContextDesc desc{};
        desc.structSize = sizeof desc;
        desc.getProcAddress = hooks.getProcAddress ? hooks.getProcAddress : HeadlessGl::getProcAddress;
        desc.backEnd = backEnd;
        desc.message = [](NacreSeverity severity, const char* text, void* user) {
            if (severity == NACRE_ERROR) *static_cast<std::string*>(user) = text;
        };
        desc.messageUser = &message_;
        if (Status s = check(nacreContextCreate(&desc, &context_)); !s) return s;
        return check(nacreViewCreate(context_, nullptr, &view_));
    }
    const std::string& description() const { return gl_->description(); }

    Result<Values> draw(const Scene& scene) override
    {
        const auto file = assetFile(scene);
        if (!file) return file.error();
        gl_->makeCurrent();
        NacreInstanceDesc instance{};
        instance.structSize = sizeof instance;
        if (Status s = check(nacreAssetCreate(context_, file->data(), file->size(), &instance.asset)); !s) return s.error();
        NacreInstance placed{};
        Status status = check(nacreInstanceCreate(&instance, &placed));
        if (status) status = drawPlaced(scene);
        nacreInstanceDestroy(placed);
        nacreAssetDestroy(instance.asset);
        if (!status) return status.error();
        return valuesOf(gl_->readFrame());
    }

    Result<bool> acceptsFile(const Scene& scene) override { return accepts(scene); }
    Result<bool> accepts(const Scene& scene) override
    {
        const auto values = draw(scene);
        if (values) return true;
        if (values.error().code != ErrorCode::kBadInput) return values.error();
        return false;
    }

private:
    Status drawPlaced(const Scene& scene)
    {
        const auto lights = toNacreLights(scene.lights);
        if (!lights) return lights.error();
        if (Status s = check(nacreContextSetLights(context_, lights->data(), lights->size())); !s) return s;
        if (Status s = gl_->beginFrame(scene.camera.width, scene.camera.height, scene.halfTarget ? kRgba16f : 0); !s) return s;
        const NacreDrawDesc desc = drawDescOf(scene.camera);
        return check(nacreViewDraw(view_, &desc));
    }

    static Values valuesOf(const Image& image)
    {
        ValueGroup color{"colour", {}, 0}, coverage{"alpha", {}, 1};
        for (size_t i = 0; i < image.rgba.size(); ++i) (i % 4 == 3 ? coverage : color).values.push_back(double(image.rgba[i]));
        return {std::move(color), std::move(coverage)};
    }

    Status check(NacreResult result) const
    {
        if (result == NACRE_OK) return ok();
        const bool refused = result == NACRE_ERROR_INVALID_ARGUMENT || result == NACRE_ERROR_BAD_ASSET;
        return Error{refused ? ErrorCode::kBadInput : ErrorCode::kGpu, message_};
    }

    std::unique_ptr<HeadlessGl> gl_;
    NacreContext context_{};
    NacreView view_{};
    std::string message_;
};

Column makeGlColumn(const char* name, NacreBackEnd which, const Hooks& hooks)
{
    auto backEnd = std::make_unique<GlBackEnd>();
    if (Status s = backEnd->open(which, hooks); !s) return {name, "", nullptr, s.error().message, true};
    const std::string what = backEnd->description();
    return {name, what, std::move(backEnd), {}, true};
}

} // namespace

Column makeGl33Column(const Hooks& hooks) { return makeGlColumn("GL 3.3", NACRE_BACK_END_GL33, hooks); }
Column makeGl43Column(const Hooks& hooks) { return makeGlColumn("GL 4.3", NACRE_BACK_END_GL43, hooks); }

} // namespace nacre::selftest
