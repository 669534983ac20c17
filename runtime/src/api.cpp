// The C API: checks arguments, turns exceptions and failures into results and messages. The only extern "C" file.
#include "appearance/detail.h"
#include "appearance/sss/sss_edit.h"
#include "asset.h"
#include "base/text.h"
#include "host_struct.h"
#include "instance.h"
#include "light_check.h"
#include "splat_shadows.h"
#include "view.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <new>

using nacre::Failure;
using nacre::Handle;
using nacre::HandleKind;
using nacre::checkSize;
using nacre::invalid;
using nacre::rawEnum;
using nacre::read;

namespace {

/// The contexts of this process.
class Contexts {
public:
    std::shared_ptr<nacre::Context> find(const Handle& h)
    {
        const std::lock_guard lock(mutex_);
        const std::shared_ptr<nacre::Context>& c = slots_[h.context];
        return c && (h.kind != HandleKind::kContext || c->handle == h) ? c : nullptr;
    }
    /// 0 if there are too many.
    uint64_t add(std::shared_ptr<nacre::Context> context)
    {
        const std::lock_guard lock(mutex_);
        for (uint32_t slot = 0; slot < slots_.size(); ++slot) {
            if (slots_[slot]) continue;
            context->handle = {nacre::nextSerial(), 0, slot, HandleKind::kContext};
            slots_[slot] = std::move(context);
            return slots_[slot]->handle.id();
        }
        return 0;
    }
    std::shared_ptr<nacre::Context> remove(const Handle& h)
    {
        const std::lock_guard lock(mutex_);
        std::shared_ptr<nacre::Context>& slot = slots_[h.context];
        if (!slot || slot->handle != h) return nullptr;
        return std::exchange(slot, nullptr);
    }

private:
    std::mutex mutex_;
    std::array<std::shared_ptr<nacre::Context>, Handle::kMostContexts> slots_;
};

Contexts& contexts()
{
    static Contexts all;
    return all;
}

/// An object and the context that it lives in.
template <class T>
struct Found {
    std::shared_ptr<nacre::Context> context;
    std::shared_ptr<T> object;
    explicit operator bool() const { return object != nullptr; }
    T* operator->() const { return object.get(); }
};

template <class T, class Table>
Found<T> find(uint64_t id, Table table)
{
    const Handle h = Handle::of(id);
    Found<T> found{h.kind == HandleKind::kContext ? nullptr : contexts().find(h), nullptr};
    if (found.context) found.object = ((*found.context).*table).find(h);
    return found;
}
Found<nacre::Asset> find(NacreAsset a) { return find<nacre::Asset>(a.id, &nacre::Context::assets); }
Found<nacre::Instance> find(NacreInstance i) { return find<nacre::Instance>(i.id, &nacre::Context::instances); }
Found<nacre::View> find(NacreView v) { return find<nacre::View>(v.id, &nacre::Context::views); }
std::shared_ptr<nacre::Context> find(NacreContext c)
{
    const Handle h = Handle::of(c.id);
    return h.kind == HandleKind::kContext ? contexts().find(h) : nullptr;
}

/// Runs `work`; nothing thrown gets past the C border.
template <class Work>
NacreResult guarded(const nacre::Context& context, Work work)
{
    try {
        if (const Failure f = work()) return context.fail(f);
        return NACRE_OK;
    } catch (const std::bad_alloc&) {
        context.report(NACRE_ERROR, "out of memory");
        return NACRE_ERROR_OUT_OF_MEMORY;
    } catch (...) {
        context.report(NACRE_ERROR, "internal error");
        return NACRE_ERROR_GL;
    }
}

/// Work on a found object; what is not found has no context to tell.
template <class T, class Work>
NacreResult on(const Found<T>& found, Work work)
{
    return found ? guarded(*found.context, work) : NACRE_ERROR_INVALID_ARGUMENT;
}

/// As much as the host's struct has room for; its structSize stays.
template <class Info>
void write(const Info& from, Info* out)
{
    const size_t size = out->structSize;
    std::memcpy(out, &from, size);
    out->structSize = size;
}

Failure checkEdit(const NacreEdit& edit, size_t index)
{
    const std::string which = "edit " + std::to_string(index) + ": ";
    const int target = rawEnum(edit.target), operation = rawEnum(edit.operation), region = rawEnum(edit.region);
    if (target < NACRE_EDIT_BASE_COLOR || target > NACRE_EDIT_OPACITY) return invalid(which + "unknown target " + std::to_string(target));
    if (operation != NACRE_EDIT_SET && operation != NACRE_EDIT_MULTIPLY) return invalid(which + "unknown operation " + std::to_string(operation));
    if (region < NACRE_REGION_EVERYWHERE || region > NACRE_REGION_SPHERE) return invalid(which + "unknown region " + std::to_string(region));
    const int values = target == NACRE_EDIT_BASE_COLOR || target == NACRE_EDIT_RESIDUAL ? 3 : 1;
    for (int k = 0; k < values; ++k)
        if (!(edit.value[k] >= 0 && edit.value[k] <= 1e4f)) return invalid(which + "values must be from 0 to 10000, found " + nacre::numberText(edit.value[k]));
    for (int k = 0; k < 3 && region != NACRE_REGION_EVERYWHERE; ++k)
        if (!std::isfinite(edit.low[k]) || (region == NACRE_REGION_BOX && !std::isfinite(edit.high[k]))) return invalid(which + "the region is not finite");
    if (region == NACRE_REGION_SPHERE && !(edit.high[0] >= 0 && std::isfinite(edit.high[0]))) return invalid(which + "the radius must be finite and not negative");
    return {};
}

nacre::SplatEdit toSplatEdit(const NacreEdit& edit)
{
    nacre::SplatEdit out;
    out.target = nacre::EditTarget(edit.target);
    out.multiply = edit.operation == NACRE_EDIT_MULTIPLY;
    out.region = nacre::EditRegion(edit.region);
    std::memcpy(out.value, edit.value, sizeof out.value);
    std::memcpy(out.low, edit.low, sizeof out.low);
    std::memcpy(out.high, edit.high, sizeof out.high);
    return out;
}
static_assert(int(nacre::EditTarget::kOpacity) == NACRE_EDIT_OPACITY && int(nacre::EditRegion::kSphere) == NACRE_REGION_SPHERE);

/// Objects whose GL context is not current cannot be deleted.
std::unique_ptr<nacre::ForgottenObjects> forgetUnlessCurrent(nacre::Context& context, const char* function)
{
    const Failure elsewhere = nacre::checkGlContext(context);
    if (!elsewhere) return nullptr;
    context.report(NACRE_WARNING, std::string(function) + " frees no GL objects: " + elsewhere.text);
    return std::make_unique<nacre::ForgottenObjects>(context);
}

Failure checkBackEnd(const NacreContextDesc& desc)
{
    const int wanted = rawEnum(desc.backEnd);
    if (wanted >= NACRE_BACK_END_AUTO && wanted <= NACRE_BACK_END_GL43) return {};
    return invalid("NacreContextDesc.backEnd is " + std::to_string(wanted) + ", which is none of NacreBackEnd");
}

Failure checkFlags(const NacreContextDesc& desc)
{
    if ((desc.flags & ~uint32_t(NACRE_HOST_RESTORES_STATE)) == 0) return {};
    return invalid("NacreContextDesc.flags is " + std::to_string(desc.flags) + ", which has bits that are none of NacreContextFlags");
}

/// The instances of a draw: those it names, or all.
Failure listInstances(const nacre::Context& context, const NacreDrawDesc& desc, std::vector<std::shared_ptr<nacre::Instance>>* out)
{
    if (!desc.instances) {
        if (desc.instanceCount > 0) return invalid("NacreDrawDesc.instances is null, instanceCount " + std::to_string(desc.instanceCount));
        *out = context.instances.all();
        return {};
    }
    for (size_t i = 0; i < desc.instanceCount; ++i) {
        const Handle h = Handle::of(desc.instances[i].id);
        std::shared_ptr<nacre::Instance> instance = h.context == context.handle.context ? context.instances.find(h) : nullptr;
        if (!instance) return invalid("instance " + std::to_string(i) + " of the draw does not exist in this context");
        out->push_back(std::move(instance));
    }
    return {};
}

template <class Work>
NacreResult withDraw(NacreView view, const char* function, const NacreDrawDesc* desc, Work work)
{
    const auto v = find(view);
    return on(v, [&]() -> Failure {
        if (!desc) return invalid(std::string(function) + ": desc must not be null");
        NacreDrawDesc d;
        if (Failure f = read("NacreDrawDesc", desc, &d)) return f;
        std::vector<std::shared_ptr<nacre::Instance>> instances;
        if (Failure f = listInstances(*v.context, d, &instances)) return f;
        return work(*v.object, d, instances);
    });
}

/// Zeros are defaults, and the preset comes instead of all else.
Failure readDetail(const NacreDetail* given, nacre::DetailChoice* choice)
{
    if (!given) return {};
    NacreDetail d;
    if (Failure f = read("NacreDetail", given, &d)) return f;
    nacre::Detail& detail = choice->detail;
    detail.splats = d.splats == 0 ? 1 : d.splats;
    detail.leaveOut = d.leaveOut, detail.transportFunctions = d.transportFunctions, detail.visibilitySize = d.visibilitySize;
    if (const nacre::Status s = nacre::checkDetail(detail); !s) return invalid("NacreDetail: " + s.error().message);
    if (d.preset) choice->preset = d.preset;
    if (!choice->preset.empty() && !(detail == nacre::Detail{})) return invalid("NacreDetail: a preset and fields of one's own; leave one of them zero");
    return {};
}

NacreResult addAsset(NacreContext context, const char* function, const void* bytes, size_t byteCount, const NacreDetail* detail, NacreAsset* asset, bool upload)
{
    if (asset) asset->id = 0;
    const auto c = find(context);
    if (!c) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*c, [&]() -> Failure {
        if (!bytes || !asset) return invalid(std::string(function) + ": bytes and asset must not be null");
        if (upload)
            if (Failure f = nacre::checkGlContext(*c)) return f;
        nacre::DetailChoice choice;
        if (Failure f = readDetail(detail, &choice)) return f;
        std::shared_ptr<nacre::Asset> made;
        if (Failure f = nacre::decode(*c, {static_cast<const std::byte*>(bytes), byteCount}, choice, &made)) return f;
        if (upload)
            if (Failure f = nacre::uploadStep(*made, ~uint64_t(0))) return f;
        asset->id = c->assets.add(c->handle.context, std::move(made));
        return asset->id ? Failure{} : Failure{NACRE_ERROR_OUT_OF_MEMORY, "too many assets, the most is 2^20"};
    });
}

} // namespace

extern "C" {

uint32_t nacreVersion(void) { return NACRE_VERSION_MAJOR * 10000 + NACRE_VERSION_MINOR * 100 + NACRE_VERSION_PATCH; }

NacreResult nacreContextCreate(const NacreContextDesc* desc, NacreContext* context)
{
    if (context) context->id = 0;
    if (!desc || !context) return NACRE_ERROR_INVALID_ARGUMENT;
    NacreContextDesc d;
    if (read("NacreContextDesc", desc, &d)) return NACRE_ERROR_INVALID_ARGUMENT; // the callback's place is not trusted
    std::shared_ptr<nacre::Context> made;
    try {
        made = std::make_shared<nacre::Context>();
    } catch (const std::bad_alloc&) {
        return NACRE_ERROR_OUT_OF_MEMORY;
    }
    made->message = d.message;
    made->messageUser = d.messageUser;
    made->hostState = d.flags & NACRE_HOST_RESTORES_STATE ? nacre::HostState::kLeftToHost : nacre::HostState::kPutBack;
    return guarded(*made, [&]() -> Failure {
        if (!d.getProcAddress) return invalid("NacreContextDesc.getProcAddress is null, it is required");
        if (Failure f = checkBackEnd(d)) return f;
        if (Failure f = checkFlags(d)) return f;
        std::string missing = nacre::loadGl(d.getProcAddress, d.getProcAddressUser, nacre::BackEnd(d.backEnd), &made->gl);
        if (!missing.empty()) return {NACRE_ERROR_UNSUPPORTED, std::move(missing)};
        nacre::markGlContext(*made);
        context->id = contexts().add(made);
        return context->id ? Failure{} : Failure{NACRE_ERROR_OUT_OF_MEMORY, "too many contexts, the most is 256"};
    });
}

void nacreContextDestroy(NacreContext context)
{
    const auto c = contexts().remove(Handle::of(context.id));
    if (!c) return;
    const auto forgotten = forgetUnlessCurrent(*c, "nacreContextDestroy");
    c->destroyObjects();
}

void nacreContextSetProfiling(NacreContext context, int enabled)
{
    if (const auto c = find(context)) c->profiling = enabled != 0;
}

NacreResult nacreContextGetInfo(NacreContext context, NacreContextInfo* info)
{
    const auto c = find(context);
    if (!c) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*c, [&]() -> Failure {
        if (!info) return invalid("nacreContextGetInfo: info must not be null");
        if (Failure f = checkSize("NacreContextInfo", info->structSize, sizeof *info)) return f;
        NacreContextInfo all{};
        all.backEnd = NacreBackEnd(c->gl.backEnd);
        all.assets = uint32_t(c->assets.all().size()), all.instances = uint32_t(c->instances.all().size()), all.views = uint32_t(c->views.all().size());
        all.gpuBytes = c->gpuBytes;
        all.programs = uint32_t(c->programs.size());
        write(all, info);
        return {};
    });
}

NacreResult nacreAssetCreate(NacreContext context, const void* bytes, size_t byteCount, NacreAsset* asset)
{
    return addAsset(context, "nacreAssetCreate", bytes, byteCount, nullptr, asset, true);
}

NacreResult nacreAssetCreateDetail(NacreContext context, const void* bytes, size_t byteCount, const NacreDetail* detail, NacreAsset* asset)
{
    return addAsset(context, "nacreAssetCreateDetail", bytes, byteCount, detail, asset, true);
}

NacreResult nacreAssetDecode(NacreContext context, const void* bytes, size_t byteCount, NacreAsset* asset)
{
    return addAsset(context, "nacreAssetDecode", bytes, byteCount, nullptr, asset, false);
}

NacreResult nacreAssetDecodeDetail(NacreContext context, const void* bytes, size_t byteCount, const NacreDetail* detail, NacreAsset* asset)
{
    return addAsset(context, "nacreAssetDecodeDetail", bytes, byteCount, detail, asset, false);
}

NacreResult nacreAssetUploadStep(NacreAsset asset, uint64_t budgetBytes, uint64_t* bytesLeft)
{
    const auto a = find(asset);
    return on(a, [&]() -> Failure {
        if (Failure f = nacre::checkGlContext(*a.context)) return f;
        if (Failure f = nacre::uploadStep(*a.object, budgetBytes)) return f;
        if (bytesLeft) *bytesLeft = a->complete() ? 0 : std::max<uint64_t>(a->queue.left(), 1);
        return {};
    });
}

void nacreAssetDestroy(NacreAsset asset)
{
    auto a = find(asset);
    if (!a) return;
    const auto forgotten = forgetUnlessCurrent(*a.context, "nacreAssetDestroy");
    a.context->assets.remove(a->handle);
    a.object.reset();
}

NacreResult nacreAssetGetInfo(NacreAsset asset, NacreAssetInfo* info)
{
    const auto a = find(asset);
    return on(a, [&]() -> Failure {
        if (!info) return invalid("nacreAssetGetInfo: info must not be null");
        if (Failure f = checkSize("NacreAssetInfo", info->structSize, sizeof *info)) return f;
        NacreAssetInfo all{};
        all.splatCount = a->grid.count;
        all.gpuBytes = a->gpuBytes;
        for (int c = 0; c < 3; ++c) all.boundsMin[c] = a->boundsMin[c], all.boundsMax[c] = a->boundsMax[c];
        const glm::quat& q = a->yUpFromAsset;
        const float xyzw[4] = {q.x, q.y, q.z, q.w};
        std::memcpy(all.yUpFromAsset, xyzw, sizeof xyzw);
        all.datasetScale = a->frame.scale;
        for (int c = 0; c < 3; ++c) all.datasetTranslation[c] = a->frame.translation[c];
        all.datasetLightGain = a->frame.lightGain;
        std::snprintf(all.model, sizeof all.model, "%s", a->modelName.c_str());
        all.bakedSplatCount = a->bakedSplats;
        all.resolutionScale = a->preset.resolutionScale, all.environmentDirections = a->preset.environmentDirections;
        std::snprintf(all.preset, sizeof all.preset, "%s", a->preset.name.c_str());
        write(all, info);
        return {};
    });
}

NacreResult nacreInstanceCreate(const NacreInstanceDesc* desc, NacreInstance* instance)
{
    if (instance) instance->id = 0;
    if (!desc || !instance || desc->structSize < offsetof(NacreInstanceDesc, worldFromAsset)) return NACRE_ERROR_INVALID_ARGUMENT; // no asset to tell
    const auto a = find(desc->asset);
    return on(a, [&]() -> Failure {
        NacreInstanceDesc d;
        if (Failure f = read("NacreInstanceDesc", desc, &d)) return f;
        nacre::Placement place;
        if (Failure f = nacre::makePlacement(d.worldFromAsset, &place)) return f;
        auto made = std::make_shared<nacre::Instance>(*a.context, a.object);
        made->moveTo(place);
        made->lightMask = d.lightMask ? d.lightMask : ~0u;
        made->viewMask = d.viewMask ? d.viewMask : ~0u;
        made->hidden = d.hidden != 0;
        instance->id = a.context->instances.add(a.context->handle.context, std::move(made));
        return instance->id ? Failure{} : Failure{NACRE_ERROR_OUT_OF_MEMORY, "too many instances, the most is 2^20"};
    });
}

void nacreInstanceDestroy(NacreInstance instance)
{
    auto i = find(instance);
    if (!i) return;
    const auto forgotten = forgetUnlessCurrent(*i.context, "nacreInstanceDestroy");
    i.context->instances.remove(i->handle);
    for (const auto& view : i.context->views.all()) view->forget(i->handle.serial);
    i.object.reset();
}

NacreResult nacreInstanceSetTransform(NacreInstance instance, const float worldFromAsset[16])
{
    const auto i = find(instance);
    return on(i, [&]() -> Failure {
        if (!worldFromAsset) return invalid("nacreInstanceSetTransform: worldFromAsset must not be null");
        nacre::Placement place;
        if (Failure f = nacre::makePlacement(worldFromAsset, &place)) return f;
        i->moveTo(place);
        return {};
    });
}

NacreResult nacreInstanceSetHidden(NacreInstance instance, int hidden)
{
    const auto i = find(instance);
    return on(i, [&]() -> Failure { return i->hidden = hidden != 0, Failure{}; });
}

NacreResult nacreInstanceSetMasks(NacreInstance instance, uint32_t lightMask, uint32_t viewMask)
{
    const auto i = find(instance);
    return on(i, [&]() -> Failure {
        i->lightMask = lightMask ? lightMask : ~0u;
        i->viewMask = viewMask ? viewMask : ~0u;
        return {};
    });
}

NacreResult nacreInstanceSetTint(NacreInstance instance, const float tint[3])
{
    const auto i = find(instance);
    return on(i, [&]() -> Failure {
        if (!tint) return invalid("nacreInstanceSetTint: tint must not be null");
        for (int c = 0; c < 3; ++c)
            if (!(tint[c] >= 0 && tint[c] <= 1e4f)) return invalid("tint must be from 0 to 10000, found " + nacre::numberText(tint[c]));
        const glm::vec3 t(tint[0], tint[1], tint[2]);
        if (t != i->tint) i->tint = t, ++i->looksRevision;
        return {};
    });
}

NacreResult nacreInstanceSetEdits(NacreInstance instance, const NacreEdit* edits, size_t count)
{
    const auto i = find(instance);
    return on(i, [&]() -> Failure {
        if (count > 0 && !edits) return invalid("nacreInstanceSetEdits: edits must not be null");
        if (count > NACRE_MAX_EDITS)
            return invalid(std::to_string(count) + " edits, the most is " + std::to_string(NACRE_MAX_EDITS) + "; join those of the same target");
        std::vector<nacre::SplatEdit> checked;
        for (size_t k = 0; k < count; ++k) {
            if (Failure f = checkEdit(edits[k], k)) return f;
            checked.push_back(toSplatEdit(edits[k]));
        }
        if (!i->asset->complete()) return invalid("nacreInstanceSetEdits: the asset is not complete; nacreAssetUploadStep it to the end first");
        if (!i->model) i->model = i->asset->model->makeInstance(*i.object);
        return i->model->setEdits(checked);
    });
}

NacreResult nacreContextSetLights(NacreContext context, const NacreLight* lights, size_t count)
{
    const auto c = find(context);
    if (!c) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*c, [&]() -> Failure {
        if (count > 0 && !lights) return invalid("nacreContextSetLights: lights must not be null");
        std::vector<NacreLight> copies;
        if (Failure f = nacre::readLights(lights, count, &copies)) return f;
        c->lights.setLights(copies);
        return {};
    });
}

NacreResult nacreContextSetEnvironment(NacreContext context, const NacreEnvironment* environment)
{
    const auto c = find(context);
    if (!c) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*c, [&]() -> Failure {
        if (!environment) return c->lights.setEnvironment(nullptr), Failure{};
        NacreEnvironment copy;
        if (Failure f = nacre::readEnvironment(*environment, &copy)) return f;
        c->lights.setEnvironment(&copy);
        return {};
    });
}

NacreResult nacreContextSetShadowBudget(NacreContext context, uint32_t mostMaps, uint32_t size)
{
    const auto c = find(context);
    if (!c) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*c, [&]() -> Failure {
        const uint32_t most = uint32_t(std::min(c->gl.maxTextureSize, 4096));
        if (size < 16 || size > most) return invalid("nacreContextSetShadowBudget: size must be from 16 to " + std::to_string(most) + ", found " + std::to_string(size));
        c->splatShadows->setBudget(mostMaps, int(size));
        return {};
    });
}

NacreResult nacreViewCreate(NacreContext context, const NacreViewDesc* desc, NacreView* view)
{
    if (view) view->id = 0;
    const auto c = find(context);
    if (!c) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*c, [&]() -> Failure {
        if (!view) return invalid("nacreViewCreate: view must not be null");
        NacreViewDesc d{};
        if (desc)
            if (Failure f = read("NacreViewDesc", desc, &d)) return f;
        auto made = std::make_shared<nacre::View>(*c);
        if (d.mask) made->mask = d.mask;
        view->id = c->views.add(c->handle.context, std::move(made));
        return view->id ? Failure{} : Failure{NACRE_ERROR_OUT_OF_MEMORY, "too many views, the most is 2^20"};
    });
}

void nacreViewDestroy(NacreView view)
{
    auto v = find(view);
    if (!v) return;
    const auto forgotten = forgetUnlessCurrent(*v.context, "nacreViewDestroy");
    v.context->views.remove(v->handle);
    v.object.reset();
}

NacreResult nacreViewDraw(NacreView view, const NacreDrawDesc* desc)
{
    return withDraw(view, "nacreViewDraw", desc, [](nacre::View& v, const NacreDrawDesc& d, const auto& instances) { return v.draw(d, instances); });
}

NacreResult nacreViewDrawDepth(NacreView view, const NacreDrawDesc* desc)
{
    return withDraw(view, "nacreViewDrawDepth", desc, [](nacre::View& v, const NacreDrawDesc& d, const auto& instances) { return v.drawDepth(d, instances); });
}

NacreResult nacreViewPrepare(NacreView view, const NacreDrawDesc* desc, size_t mostLights)
{
    const auto v = find(view);
    if (!v) return NACRE_ERROR_INVALID_ARGUMENT;
    const int lights = int(std::min<size_t>(mostLights, 1 << 16));
    if (desc)
        return withDraw(view, "nacreViewPrepare", desc, [&](nacre::View& w, const NacreDrawDesc& d, const auto& instances) { return w.prepare(&d, instances, lights); });
    return guarded(*v.context, [&]() -> Failure { return v->prepare(nullptr, v.context->instances.all(), lights); });
}

NacreResult nacreViewGetStats(NacreView view, NacreDrawStats* stats)
{
    const auto v = find(view);
    return on(v, [&]() -> Failure {
        if (!stats) return invalid("nacreViewGetStats: stats must not be null");
        if (Failure f = checkSize("NacreDrawStats", stats->structSize, sizeof *stats)) return f;
        write(v->stats(), stats);
        return {};
    });
}

} // extern "C"
