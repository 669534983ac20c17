// The C API: checks arguments, turns exceptions and failures into results and messages. The only extern "C" file.
#include "asset.h"

#include "appearance/sss/sss_edit.h"
#include "asset/asset_decode.h"
#include "base/limits.h"
#include "base/text.h"
#include "host_depth.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <new>

using nacre::Failure;

namespace {

/// Runs `work`; nothing thrown gets past the C border.
template <class Work>
NacreResult guarded(const NacreContextImpl& context, Work work)
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

Failure invalid(const std::string& text) { return {NACRE_ERROR_INVALID_ARGUMENT, text}; }

Failure checkSize(const char* type, size_t found, size_t expected)
{
    if (found == expected) return {};
    return invalid(std::string(type) + ".structSize is " + std::to_string(found) + ", expected " + std::to_string(expected) +
                   "; set it to sizeof(" + type + ")");
}

/// A C host can store any int in an enum, and C++ must not read such a value as one.
template <class Enum>
int rawEnum(const Enum& value)
{
    int raw = 0;
    static_assert(sizeof raw == sizeof value);
    std::memcpy(&raw, &value, sizeof raw);
    return raw;
}

Failure checkLight(const NacreLight& light, size_t index)
{
    const std::string which = "light " + std::to_string(index) + ": ";
    const int type = rawEnum(light.type);
    if (type != NACRE_LIGHT_POINT && type != NACRE_LIGHT_DIRECTIONAL)
        return invalid(which + "unknown type " + std::to_string(type));
    constexpr float kWidestLight = 1.6f; // radians
    constexpr float kBrightest = 1e15f; // times falloff 1e6, the largest coefficients and 256 lights still finite: no inf * 0
    double length2 = 0;
    for (int c = 0; c < 3; ++c) {
        if (!(std::abs(light.vector[c]) <= nacre::kLargestNumber)) return invalid(which + "vector is not finite or beyond 1e15");
        if (!(light.intensity[c] >= 0 && light.intensity[c] <= kBrightest))
            return invalid(which + "intensity must be from 0 to 1e15, found " + nacre::numberText(light.intensity[c]));
        length2 += double(light.vector[c]) * light.vector[c];
    }
    if (light.type == NACRE_LIGHT_DIRECTIONAL && !(std::abs(length2 - 1.0) < 1e-2))
        return invalid(which + "vector of a directional light must have length 1, found " + nacre::numberText(std::sqrt(length2)));
    if (light.type == NACRE_LIGHT_POINT && !(light.radius >= 0 && light.radius <= nacre::kLargestNumber))
        return invalid(which + "radius must be finite and not negative");
    if (light.type == NACRE_LIGHT_DIRECTIONAL && !(light.radius >= 0 && light.radius <= kWidestLight))
        return invalid(which + "radius of a directional light is an angle from 0 to 1.6 radians, found " + nacre::numberText(light.radius));
    return {};
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
std::unique_ptr<nacre::ForgottenObjects> forgetUnlessCurrent(NacreContextImpl& context, const char* function)
{
    const Failure elsewhere = nacre::checkGlContext(context);
    if (!elsewhere) return nullptr;
    context.report(NACRE_WARNING, std::string(function) + " frees no GL objects: " + elsewhere.text);
    return std::make_unique<nacre::ForgottenObjects>(context);
}

NacreResult decodeResult(nacre::ErrorCode code)
{
    switch (code) {
    case nacre::ErrorCode::kUnsupported: return NACRE_ERROR_UNSUPPORTED;
    case nacre::ErrorCode::kIo: return NACRE_ERROR_OUT_OF_MEMORY; // decoding reads no files: memory is all of the world it needs
    default: return NACRE_ERROR_BAD_ASSET;
    }
}

} // namespace

extern "C" {

uint32_t nacreVersion(void) { return NACRE_VERSION_MAJOR * 10000 + NACRE_VERSION_MINOR * 100 + NACRE_VERSION_PATCH; }

NacreResult nacreContextCreate(const NacreContextDesc* desc, NacreContext* context)
{
    if (context) *context = nullptr;
    if (!desc || !context) return NACRE_ERROR_INVALID_ARGUMENT;
    if (desc->structSize != sizeof(NacreContextDesc)) return NACRE_ERROR_INVALID_ARGUMENT; // the callback's place is not trusted
    std::unique_ptr<NacreContextImpl> made(new (std::nothrow) NacreContextImpl);
    if (!made) return NACRE_ERROR_OUT_OF_MEMORY;
    made->message = desc->message;
    made->messageUser = desc->messageUser;
    const NacreResult result = guarded(*made, [&]() -> Failure {
        if (!desc->getProcAddress) return invalid("NacreContextDesc.getProcAddress is null, it is required");
        std::string missing = nacre::loadGl(desc->getProcAddress, desc->getProcAddressUser, nacre::BackEnd::kAuto, &made->gl);
        if (!missing.empty()) return {NACRE_ERROR_UNSUPPORTED, std::move(missing)};
        nacre::markGlContext(*made);
        return {};
    });
    if (result == NACRE_OK) *context = made.release();
    return result;
}

void nacreContextDestroy(NacreContext context)
{
    if (!context) return;
    if (const auto forgotten = forgetUnlessCurrent(*context, "nacreContextDestroy"); !forgotten) {
        nacre::freeDepthCopy(*context);
        context->gl.DeleteVertexArrays(1, &context->vertexArray);
        context->gl.DeleteBuffers(1, &context->indexBuffer);
    }
    delete context;
}

void nacreContextSetProfiling(NacreContext context, int enabled)
{
    if (context) context->profiling = enabled != 0;
}

NacreResult nacreAssetCreate(NacreContext context, const void* bytes, size_t byteCount, NacreAsset* asset)
{
    if (asset) *asset = nullptr;
    if (!context) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*context, [&]() -> Failure {
        if (!bytes || !asset) return invalid("nacreAssetCreate: bytes and asset must not be null");
        if (Failure f = nacre::checkGlContext(*context)) return f;
        const nacre::Result<nacre::SplatAsset> decoded = nacre::decodeAsset({static_cast<const std::byte*>(bytes), byteCount});
        if (!decoded)
            return {decodeResult(decoded.error().code), decoded.error().message};
        const auto destroy = [](NacreAssetImpl* a) { nacreAssetDestroy(a); };
        std::unique_ptr<NacreAssetImpl, decltype(destroy)> made(new NacreAssetImpl, destroy);
        if (Failure f = nacre::uploadAsset(*context, *decoded, *made)) return f;
        *asset = made.release();
        return {};
    });
}

void nacreAssetDestroy(NacreAsset asset)
{
    if (!asset) return;
    {
        std::unique_ptr<nacre::ForgottenObjects> forgotten;
        if (asset->context) forgotten = forgetUnlessCurrent(*asset->context, "nacreAssetDestroy");
        nacre::destroyAsset(*asset);
    }
    delete asset;
}

NacreResult nacreAssetGetInfo(NacreAsset asset, NacreAssetInfo* info)
{
    if (!asset) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*asset->context, [&]() -> Failure {
        if (!info) return invalid("nacreAssetGetInfo: info must not be null");
        if (Failure f = checkSize("NacreAssetInfo", info->structSize, sizeof *info)) return f;
        info->splatCount = asset->count;
        info->gpuBytes = asset->gpuBytes;
        for (int c = 0; c < 3; ++c) {
            info->boundsMin[c] = asset->boundsMin[c];
            info->boundsMax[c] = asset->boundsMax[c];
        }
        const glm::quat& q = asset->yUpFromAsset;
        const float xyzw[4] = {q.x, q.y, q.z, q.w};
        std::memcpy(info->yUpFromAsset, xyzw, sizeof xyzw);
        info->datasetScale = asset->frame.scale;
        for (int c = 0; c < 3; ++c) info->datasetTranslation[c] = asset->frame.translation[c];
        info->datasetLightGain = asset->frame.lightGain;
        std::snprintf(info->model, sizeof info->model, "%s", asset->modelName.c_str());
        return {};
    });
}

NacreResult nacreAssetSetLights(NacreAsset asset, const NacreLight* lights, size_t count)
{
    if (!asset) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*asset->context, [&]() -> Failure {
        if (count > 0 && !lights) return invalid("nacreAssetSetLights: lights must not be null");
        if (count > NACRE_MAX_LIGHTS)
            return invalid(std::to_string(count) + " lights, the most is " + std::to_string(NACRE_MAX_LIGHTS) +
                           "; keep those that matter at the asset");
        if (count > size_t(asset->mostLights))
            return {NACRE_ERROR_UNSUPPORTED, std::to_string(count) + " lights, for " + std::to_string(asset->count) + " splats this GPU's textures have room for " +
                                                 std::to_string(asset->mostLights) + "; keep those that matter at the asset"};
        for (size_t i = 0; i < count; ++i)
            if (Failure f = checkLight(lights[i], i)) return f;
        asset->hostLights.assign(lights, lights + count);
        return {};
    });
}

NacreResult nacreAssetSetEdits(NacreAsset asset, const NacreEdit* edits, size_t count)
{
    if (!asset) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*asset->context, [&]() -> Failure {
        if (count > 0 && !edits) return invalid("nacreAssetSetEdits: edits must not be null");
        if (count > NACRE_MAX_EDITS)
            return invalid(std::to_string(count) + " edits, the most is " + std::to_string(NACRE_MAX_EDITS) + "; join those of the same target");
        std::vector<nacre::SplatEdit> checked;
        for (size_t i = 0; i < count; ++i) {
            if (Failure f = checkEdit(edits[i], i)) return f;
            checked.push_back(toSplatEdit(edits[i]));
        }
        return asset->model->setEdits(checked);
    });
}

NacreResult nacreAssetDraw(NacreAsset asset, const NacreDrawDesc* desc)
{
    if (!asset) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*asset->context, [&]() -> Failure {
        if (!desc) return invalid("nacreAssetDraw: desc must not be null");
        if (Failure f = checkSize("NacreDrawDesc", desc->structSize, sizeof *desc)) return f;
        return nacre::draw(*asset, *desc);
    });
}

NacreResult nacreAssetPrepare(NacreAsset asset, const NacreDrawDesc* desc, size_t mostLights)
{
    if (!asset) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*asset->context, [&]() -> Failure {
        if (mostLights > NACRE_MAX_LIGHTS)
            return invalid("nacreAssetPrepare: mostLights is " + std::to_string(mostLights) + ", the most is " + std::to_string(NACRE_MAX_LIGHTS));
        if (desc)
            if (Failure f = checkSize("NacreDrawDesc", desc->structSize, sizeof *desc)) return f;
        return nacre::prepare(*asset, desc, int(mostLights));
    });
}

NacreResult nacreAssetGetDrawStats(NacreAsset asset, NacreDrawStats* stats)
{
    if (!asset) return NACRE_ERROR_INVALID_ARGUMENT;
    return guarded(*asset->context, [&]() -> Failure {
        if (!stats) return invalid("nacreAssetGetDrawStats: stats must not be null");
        if (Failure f = checkSize("NacreDrawStats", stats->structSize, sizeof *stats)) return f;
        *stats = asset->stats;
        stats->structSize = sizeof *stats;
        return {};
    });
}

} // extern "C"
