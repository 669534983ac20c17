// makeGlRenderer: the runtime's public C API on a headless context, as a host application would use it.
#include "eval/headless_gl.h"
#include "eval/runtime_types.h"
#include "eval/splat_renderer.h"

#include <algorithm>
#include <cstring>

namespace nacre {

static double median(std::vector<double> values)
{
    std::nth_element(values.begin(), values.begin() + ptrdiff_t(values.size() / 2), values.end());
    return values[values.size() / 2];
}

namespace {

class GlRenderer final : public SplatRenderer {
public:
    ~GlRenderer() override
    {
        if (gl_) gl_->makeCurrent();
        nacreContextDestroy(context_); // and what is in it
    }

    Status open(std::span<const std::byte> assetBytes, const Detail& detail, const GlHost& host)
    {
        format_ = host.halfTarget ? kHalfFormat : 0;
        Result<std::unique_ptr<HeadlessGl>> gl = HeadlessGl::create();
        if (!gl) return gl.error();
        gl_ = std::move(*gl);
        NacreContextDesc desc{};
        desc.structSize = sizeof desc;
        desc.getProcAddress = HeadlessGl::getProcAddress;
        desc.message = keepMessage;
        desc.messageUser = &lastMessage_;
        desc.backEnd = host.backEnd == GlHost::BackEnd::kGl33 ? NACRE_BACK_END_GL33 : host.backEnd == GlHost::BackEnd::kGl43 ? NACRE_BACK_END_GL43 : NACRE_BACK_END_AUTO;
        if (Status s = check(nacreContextCreate(&desc, &context_)); !s) return s;
        if (Status s = check(nacreViewCreate(context_, nullptr, &view_)); !s) return s;
        NacreInstanceDesc instance{}; // where the asset is its own world
        instance.structSize = sizeof instance;
        NacreDetail reduced{};
        reduced.structSize = sizeof reduced;
        reduced.splats = detail.splats, reduced.leaveOut = detail.leaveOut;
        reduced.transportFunctions = detail.transportFunctions, reduced.visibilitySize = detail.visibilitySize;
        if (Status s = check(nacreAssetCreateDetail(context_, assetBytes.data(), assetBytes.size(), &reduced, &instance.asset)); !s) return s;
        asset_ = instance.asset;
        return check(nacreInstanceCreate(&instance, &instance_));
    }

    Result<NacreAssetInfo> info() const
    {
        NacreAssetInfo info{};
        info.structSize = sizeof info;
        if (Status s = check(nacreAssetGetInfo(asset_, &info)); !s) return s.error();
        return info;
    }

    Result<Image> render(const Camera& camera, std::span<const Light> lights) override
    {
        gl_->makeCurrent();
        if (Status s = setLights(lights); !s) return s.error();
        if (Status s = draw(camera); !s) return s.error();
        return gl_->readFrame();
    }

    Result<RenderTimes> time(const Camera& camera, std::span<const Light> lights, int warmup, int frames) override
    {
        gl_->makeCurrent();
        nacreContextSetProfiling(context_, 1);
        std::vector<double> relight, sort, raster, frame;
        Status status = ok();
        // A millionth to and fro changes camera and lights, so that nothing can be reused: relative, or float32 would drop it. The frame
        // before the warm-up may find what the last call left.
        const double step = 1e-6 * std::max(glm::length(camera.position()), 1e-3);
        for (int i = -1; i < warmup + frames && status; ++i) {
            const float nudge = i % 2 ? 1.0f : 1.0f + 1e-6f;
            std::vector<Light> moved(lights.begin(), lights.end());
            for (Light& light : moved) light.intensity *= nudge;
            Camera seen = camera;
            if (nudge != 1.0f) seen.worldFromCamera[3] += step * camera.worldFromCamera[2];
            NacreDrawStats stats{};
            stats.structSize = sizeof stats;
            status = setLights(moved);
            if (status) status = draw(seen);
            if (status) status = check(nacreViewGetStats(view_, &stats));
            if (i >= 0 && status && !stats.sorted) status = Error{ErrorCode::kGpu, "a timed frame was not drawn afresh; move the camera closer"};
            if (i < warmup) continue;
            relight.push_back(1e3 * stats.relightSeconds), sort.push_back(1e3 * stats.sortSeconds), raster.push_back(1e3 * stats.rasterSeconds);
            frame.push_back(1e3 * (stats.relightSeconds + stats.sortSeconds + stats.rasterSeconds));
        }
        nacreContextSetProfiling(context_, 0);
        if (!status) return status.error();
        if (frames < 1) return Error{ErrorCode::kBadInput, "timing needs at least one frame"};
        return RenderTimes{median(relight), median(sort), median(raster), median(frame)};
    }

    Status setEdits(std::span<const SplatEdit> edits) override
    {
        std::vector<NacreEdit> converted;
        for (const SplatEdit& edit : edits) {
            NacreEdit n{};
            n.target = NacreEditTarget(edit.target);
            n.operation = edit.multiply ? NACRE_EDIT_MULTIPLY : NACRE_EDIT_SET;
            n.region = NacreEditRegion(edit.region);
            std::memcpy(n.value, edit.value, sizeof n.value);
            std::memcpy(n.low, edit.low, sizeof n.low);
            std::memcpy(n.high, edit.high, sizeof n.high);
            converted.push_back(n);
        }
        gl_->makeCurrent();
        return check(nacreInstanceSetEdits(instance_, converted.data(), converted.size()));
    }

    std::string description() const override { return gl_->description() + (gl_->isSoftware() ? ", software on the CPU" : ""); }

private:
    static void keepMessage(NacreSeverity severity, const char* text, void* user)
    {
        if (severity == NACRE_ERROR) *static_cast<std::string*>(user) = text;
    }

    Status check(NacreResult result) const
    {
        switch (result) {
        case NACRE_OK: return ok();
        case NACRE_ERROR_INVALID_ARGUMENT:
        case NACRE_ERROR_BAD_ASSET: return Error{ErrorCode::kBadInput, lastMessage_};
        case NACRE_ERROR_UNSUPPORTED: return Error{ErrorCode::kUnsupported, lastMessage_};
        default: return Error{ErrorCode::kGpu, lastMessage_};
        }
    }

    Status setLights(std::span<const Light> lights)
    {
        const Result<std::vector<NacreLight>> converted = toNacreLights(lights);
        if (!converted) return converted.error();
        return check(nacreContextSetLights(context_, converted->data(), converted->size()));
    }

    Status draw(const Camera& camera)
    {
        if (Status s = gl_->beginFrame(camera.width, camera.height, format_); !s) return s;
        const NacreDrawDesc desc = drawDescOf(camera);
        return check(nacreViewDraw(view_, &desc));
    }

    static constexpr unsigned kHalfFormat = 0x881A; // GL_RGBA16F

    std::unique_ptr<HeadlessGl> gl_;
    unsigned format_ = 0;
    NacreContext context_{};
    NacreAsset asset_{};
    NacreInstance instance_{};
    NacreView view_{};
    std::string lastMessage_;
};

} // namespace

Result<std::unique_ptr<SplatRenderer>> makeGlRenderer(std::span<const std::byte> assetBytes, const Detail& detail, const GlHost& host)
{
    auto renderer = std::make_unique<GlRenderer>();
    if (Status s = renderer->open(assetBytes, detail, host); !s) return s.error();
    const Result<NacreAssetInfo> info = renderer->info();
    if (!info) return info.error();
    const double* t = info->datasetTranslation;
    return inDatasetFrame({info->datasetScale, {t[0], t[1], t[2]}, info->datasetLightGain}, std::move(renderer));
}

Result<uint64_t> gpuBytesOf(std::span<const std::byte> assetBytes)
{
    GlRenderer renderer;
    if (Status s = renderer.open(assetBytes, {}, {}); !s) return s.error();
    const Result<NacreAssetInfo> info = renderer.info();
    if (!info) return info.error();
    return info->gpuBytes;
}

} // namespace nacre
