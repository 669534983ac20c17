#include "appearance/bigs/bigs_asset.h"
#include "appearance/splat_radiance.h"

namespace nacre {

static void sampleBigs(const BigsCoefficients<float>& g, std::span<const IncidentLight> incidents, const ViewDirections& views,
                SplatRadiance& radiance)
{
    std::array<std::array<float, kMaxShFunctions>, kMaxRadianceLights> yLight;
    for (size_t t = 0; t < incidents.size(); ++t) {
        const glm::vec3& w = incidents[t].direction;
        shBasis(kMaxShFunctions, w.x, w.y, w.z, yLight[t].data());
    }
    std::array<float, 3 * kMaxShFunctions> a;
    // Transport that does not depend on the view is evaluated once per light, with an empty s.
    const BigsCoefficients<float> withoutView{g.tDir, g.tInd, g.rho, nullptr, 0};
    std::array<BigsTerms<float>, kMaxRadianceLights> terms;
    for (size_t t = 0; t < incidents.size(); ++t) terms[t] = bigsTerms(withoutView, a.data(), yLight[t].data());

    for (size_t k = 0; k < kRadianceDirections; ++k) {
        bigsContractView(g, views.yView[k].data(), a.data());
        glm::dvec3 sum(0.0);
        for (size_t t = 0; t < incidents.size(); ++t) {
            BigsTerms<float> viewed = terms[t];
            if (viewed.direct > 0)
                for (int i = 0; i < g.sFunctions; ++i)
                    for (int c = 0; c < 3; ++c) viewed.scatter[c] += a[size_t(3 * i + c)] * yLight[t][size_t(i)];
            const BigsSharpTerms<float> sharp = bigsSharpTerms(g, views.toCamera[k].data(), &incidents[t].direction.x);
            for (int c = 0; c < 3; ++c) sum[c] += double(incidents[t].irradiance[c]) * bigsTransport(viewed, sharp, c);
        }
        radiance[k] = sum;
    }
}

RadianceSampler bigs::makeRadianceSampler(const SplatAsset& asset)
{
    return {kMaxRadianceLights, [channels = BigsChannels(asset)](size_t i, std::span<const IncidentLight> incidents, const ViewDirections& views,
                                                                 SplatRadiance& radiance) { sampleBigs(channels.at(i), incidents, views, radiance); }};
}

} // namespace nacre
