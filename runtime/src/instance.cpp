#include "instance.h"

#include <algorithm>

namespace nacre {

Instance::Instance(Context& c, std::shared_ptr<Asset> a) : context(c), asset(std::move(a)) {}

uint64_t Instance::groupRevision(int group) const
{
    uint64_t newest = 0;
    for (int k = 0; k < kLightsPerGroup; ++k)
        if (const size_t slot = size_t(kLightsPerGroup * group + k); slot < slotRevisions.size()) newest = std::max(newest, slotRevisions[slot]);
    return newest;
}

void Instance::moveTo(const Placement& place)
{
    if (place == placement) return;
    placement = place;
    ++looksRevision;
}

Failure Instance::updateLights()
{
    if (packedLights_ == context.lights.revision() && packedLooks_ == looksRevision && packedMask_ == lightMask) return {};
    const InstancePlace place{placement.assetFromWorld, float(placement.scale), asset->boundsMin, asset->boundsMax, lightMask};
    InstanceLights next = lights;
    packLights(context.lights, place, &next);
    const size_t count = next.packed.size();
    if (count > size_t(context.gl.maxTextureSize)) // and the lights that were stay those that were
        return {NACRE_ERROR_UNSUPPORTED, std::to_string(count) + " lights reach an instance, on this GPU at most " + std::to_string(context.gl.maxTextureSize) +
                                             " can; use masks or ranges"};
    std::swap(lights, next);
    arriving = 0;
    for (const PackedLight& light : lights.packed) arriving += boundLight(light, place).most;
    const std::vector<PackedLight>& before = next.packed;
    ++revision_;
    size_t first = count, end = 0;
    slotRevisions.resize(std::max(count, before.size()), revision_);
    for (size_t t = 0; t < slotRevisions.size(); ++t)
        if (t >= count || t >= before.size() || !(lights.packed[t] == before[t])) {
            if (t < count || t < before.size()) slotRevisions[t] = revision_;
            if (t < count) first = std::min(first, t), end = t + 1;
        }
    if (count > size_t(lightTexture.width())) {
        clearHostErrors(context);
        lightTexture = {};
        lightTexture = Texture(context, GL_RGBA32F, int(std::min<size_t>((count + 15) / 16 * 16, size_t(context.gl.maxTextureSize))), kLightRows);
        if (takeGlError(context.gl) != GL_NO_ERROR) {
            lightTexture = {}, packedLights_ = 0;
            return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(count) + " lights on an instance; use fewer"};
        }
        first = 0, end = count;
    }
    uploadLights(context.gl, lightTexture, lights.packed, first, end);
    packedLights_ = context.lights.revision(), packedLooks_ = looksRevision, packedMask_ = lightMask;
    return {};
}

} // namespace nacre
