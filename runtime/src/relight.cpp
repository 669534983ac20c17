// From the host's lights to those of the passes, in asset space, and what has to be evaluated again.
#include "textures.h"

#include "base/light.h"

#include <algorithm>
#include <cstring>

namespace nacre {

static PackedLights packLights(const std::vector<NacreLight>& lights, const DrawFrame& frame)
{
    PackedLights packed{};
    packed.count = int(lights.size());
    packed.worldScale2 = frame.worldScale * frame.worldScale;
    for (size_t i = 0; i < lights.size(); ++i) {
        const NacreLight& light = lights[i];
        const glm::dvec3 v(light.vector[0], light.vector[1], light.vector[2]);
        const float radius = std::max(light.radius, kMinLightRadius);
        packed.shape[i] = light.type == NACRE_LIGHT_POINT
                              ? glm::vec4(glm::vec3(frame.assetFromWorld * glm::dvec4(v, 1.0)), radius * radius)
                              : glm::vec4(glm::vec3(glm::normalize(glm::dmat3(frame.assetFromWorld) * v)), -1.0f);
        packed.intensity[i] = glm::vec4(light.intensity[0], light.intensity[1], light.intensity[2],
                                        light.type == NACRE_LIGHT_DIRECTIONAL ? highlightWidening(light.radius) : 0.0f);
    }
    return packed;
}

static void uploadLights(const NacreAssetImpl& asset)
{
    const PackedLights& lights = asset.packed;
    bindTexture(asset.context->gl, 0, GL_TEXTURE_2D, asset.lights);
    static_assert(offsetof(PackedLights, intensity) == sizeof(PackedLights::shape)); // one block
    asset.context->gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, NACRE_MAX_LIGHTS, 2, GL_RGBA, GL_FLOAT, lights.shape);
}

Failure relight(NacreAssetImpl& asset, const DrawFrame& frame)
{
    asset.packed = packLights(asset.hostLights, frame);
    const bool changed = !asset.relit || std::memcmp(&asset.packed, &asset.relitWith, sizeof asset.packed) != 0;
    if (changed) {
        asset.relit = false;
        uploadLights(asset);
    }
    if (Failure f = asset.model->relight(frame, changed)) return f;
    asset.relitWith = asset.packed;
    asset.relit = true;
    return {};
}

} // namespace nacre
