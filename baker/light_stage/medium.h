// Homogeneous scattering media.
//
// Albedo: artists give the colour that a half space shows (multiple-scattering albedo A under diffuse light, index-matched); the walk
// needs alpha = sigma_s / sigma_t. Van de Hulst's approximation, inverted as in KHR_materials_volume_scatter:
//   s^2 = (1 - alpha) / (1 - g alpha),   A = (1 - s)(1 - 0.139 s) / (1 + 1.17 s)
// It stays within 0.001 of Chandrasekhar's exact solution at g = 0; the fit printed by Chiang, Kutz and Burley 2016 (their eq. for
// alpha(A)) loses 3 % at A = 0.9 and 7 % at A = 1.
#pragma once

#include "light_stage/sampling.h"

namespace nacre::stage {

struct Medium {
    glm::vec3 sigmaT{0.0f}; // 1 / world unit
    glm::vec3 albedo{0.0f}; // single-scattering: sigma_s / sigma_t
    float g = 0.0f;         // Henyey-Greenstein
    bool scatters() const { return maxOf(albedo) > 0.0f; }
};

inline float singleScatterFromDiffuseAlbedo(float diffuseAlbedo, float g)
{
    const float a = glm::clamp(diffuseAlbedo, 0.0f, 1.0f);
    // 0.139 s^2 - (1.139 + 1.17 A) s + (1 - A) = 0, the root in [0, 1], in the form that does not cancel
    const float b = 1.139f + 1.17f * a, s = 2.0f * (1.0f - a) / (b + std::sqrt(b * b - 4.0f * 0.139f * (1.0f - a)));
    return (1.0f - s * s) / (1.0f - g * s * s);
}

inline float diffuseAlbedoFromSingleScatter(float alpha, float g)
{
    const float s = std::sqrt((1.0f - alpha) / (1.0f - g * alpha));
    return (1.0f - s) * (1.0f - 0.139f * s) / (1.0f + 1.17f * s);
}

/// Henyey-Greenstein phase function and, being normalised, its own density. cosine: between the directions of travel before and after.
inline float henyeyGreenstein(float cosine, float g)
{
    const float d = 1.0f + g * g - 2.0f * g * cosine;
    return (1.0f - g * g) / (4.0f * kPi * std::max(1e-12f, d * std::sqrt(std::max(0.0f, d))));
}

/// A direction of travel after scattering.
inline glm::vec3 sampleHenyeyGreenstein(const glm::vec3& travel, float g, const glm::vec2& u)
{
    float cosine = 1.0f - 2.0f * u.x;
    if (std::fabs(g) > 1e-3f) cosine = (1.0f + g * g - sqr((1.0f - g * g) / (1.0f + g - 2.0f * g * u.x))) / (2.0f * g);
    cosine = glm::clamp(cosine, -1.0f, 1.0f);
    const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)), phi = 2.0f * kPi * u.y;
    return Frame::around(travel).toWorld({sine * std::cos(phi), sine * std::sin(phi), cosine});
}

/// One step of a walk whose channels have different sigma_t: the distance is drawn for one channel, picked by throughput, and the
/// weight is taken against the mean density over the channels (one-sample balance heuristic, spectral MIS).
struct DistanceSampler {
    glm::vec3 probability{1.0f / 3.0f};

    DistanceSampler(const Medium& medium, const glm::vec3& throughput)
    {
        const glm::vec3 w = throughput * (medium.albedo + 1e-3f); // absorbing channels still get a share
        const float sum = w.x + w.y + w.z;
        if (sum > 0.0f) probability = w / sum;
    }
    float sample(const Medium& medium, Rng& rng) const
    {
        const float u = rng.next();
        const int c = u < probability.x ? 0 : u < probability.x + probability.y ? 1 : 2;
        const float sigma = medium.sigmaT[c];
        return sigma > 0.0f ? -std::log(1.0f - rng.next()) / sigma : INFINITY;
    }
    /// Transmittance over `t` divided by the probability that no channel-averaged event came before.
    glm::vec3 weightToSurface(const Medium& medium, float t) const
    {
        const glm::vec3 transmittance = glm::exp(-medium.sigmaT * t);
        return transmittance / std::max(1e-30f, glm::dot(probability, transmittance));
    }
    /// sigma_s * transmittance over the density of an event at `t`.
    glm::vec3 weightToScatter(const Medium& medium, float t) const
    {
        const glm::vec3 density = medium.sigmaT * glm::exp(-medium.sigmaT * t);
        return medium.albedo * density / std::max(1e-30f, glm::dot(probability, density));
    }
};

} // namespace nacre::stage
