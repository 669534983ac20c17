#include "appearance/splat_radiance.h"
#include "appearance/sss/sss.h"
#include "appearance/sss/sss_asset.h"

namespace nacre {

// The splat as a surface of its own. The network is asked once per light, as seen along the normal: its answer hardly depends on the
// view, and 64 directions would take a minute.
static void sampleSss(const SssChannels& channels, size_t splat, std::span<const IncidentLight> incidents, const ViewDirections& views, SplatRadiance& radiance)
{
    const SssMaterial m = channels.material(splat);
    SssSurface<float> surface{{m.base[0], m.base[1], m.base[2]}, m.roughness, m.metalness, {m.normal[0], m.normal[1], m.normal[2]}, 1 - m.subsurface};
    radiance.fill(glm::dvec3(0.0));
    float first[kSssHidden1];
    if (channels.network()) channels.firstLayer(splat, first);
    for (const IncidentLight& light : incidents) {
        const float* w = &light.direction.x;
        float share = channels.visibility(splat).texels ? mapVisibility(channels.visibility(splat), w) : 1.0f;
        glm::dvec3 scattered(0.0);
        if (channels.network()) {
            float in[kSssLightInputs];
            sssLightInputs(m.normal, w, share, -1.0f, in);
            const SssActivations<float> a = sssNetworkLight(channels.network(), first, in);
            share *= a.share;
            scattered = double(m.subsurface) * glm::dvec3(a.residual[0], a.residual[1], a.residual[2]);
        }
        for (size_t k = 0; k < kRadianceDirections; ++k) {
            const SssReflection<float> o = sssReflect(surface, views.toCamera[k].data(), w);
            const glm::dvec3 reflected(o.value[0], o.value[1], o.value[2]);
            radiance[k] += glm::dvec3(light.irradiance) * (double(share) * reflected + scattered);
        }
    }
}

RadianceSampler sss::makeRadianceSampler(const SplatAsset& asset)
{
    constexpr size_t kLights = 16;
    return {kLights, [channels = SssChannels(asset)](size_t i, std::span<const IncidentLight> incidents, const ViewDirections& views,
                                                     SplatRadiance& radiance) { sampleSss(channels, i, incidents, views, radiance); }};
}

} // namespace nacre
