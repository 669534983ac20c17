// Reflectance of a surface under a thin film (KHR_materials_iridescence; Belcour and Barla 2017, "A Practical Extension to Microfacet
// Theory for the Modeling of Varying Iridescence"): light goes back and forth between the film's two faces and interferes with itself.
//
// Airy's sum for amplitudes r12 = -r21 (outer face) and r23 (inner face), t = 1 - r12^2, r = |r21 r23|, in powers of the phase:
//   R(lambda) = r12^2 + t^2 r23^2 / (1 - r^2) + 2 sum_m (t^2 r23^2 / (1 - r^2) - t) r^m cos(m (2 pi D / lambda + phase of r21 r23)),
// with D = 2 ior thickness cos(angle inside), the path that one round trip adds. As in the extension, the faces reflect by Schlick's law and the
// ior of what lies beneath follows from its F0, by channel. A cosine over the eye's response to wavelengths has a closed form where the
// response is a sum of Gaussians in 1 / lambda; no spectrum is sampled. Against the sum over wavelengths: test "thin films have the colours of
// Airy's sum".
#pragma once

#include "light_stage/microfacet.h"

namespace nacre::stage {

/// Mean of cos(2 pi path / lambda) as the eye's three responses weigh wavelengths, in linear Rec.709; path in nanometres. 1 at path 0, 0 at infinity.
inline glm::vec3 meanCosine(float path)
{
    const float k = 2.0f * kPi * 1e-9f * path; // the Gaussians are in 1 / metre (Belcour and Barla, their fit to CIE 1931)
    const auto term = [k](float mean, float variance) { return std::cos(mean * k) * std::exp(-variance * k * k); };
    const glm::vec3 xyz(0.846f * term(1.6810e6f, 4.3278e9f) + 0.154f * term(2.2399e6f, 4.5282e9f), term(1.7953e6f, 9.3046e9f), term(2.2084e6f, 6.6121e9f));
    // XYZ to Rec.709, each row divided by its sum: a reflectance that is the same at all wavelengths is grey.
    return {glm::dot(xyz, {2.68966f, -1.27586f, -0.41380f}), glm::dot(xyz, {-1.02211f, 1.97829f, 0.04382f}), glm::dot(xyz, {0.06122f, -0.22449f, 1.16327f})};
}

/// Linear Rec.709, each in [0, 1] (saturated colours are clipped). filmIor >= 1, thickness in nanometres; f0: of the surface without film.
inline glm::vec3 thinFilmReflectance(float cosine, float filmIor, float thickness, const glm::vec3& f0)
{
    const float c = glm::clamp(cosine, 0.0f, 1.0f), inside = std::sqrt(1.0f - (1.0f - c * c) / (filmIor * filmIor));
    const float outer0 = sqr((filmIor - 1.0f) / (filmIor + 1.0f)), outer = outer0 + (1.0f - outer0) * schlickWeight(c), t = 1.0f - outer;
    const glm::vec3 root = glm::sqrt(glm::min(f0, 0.9999f)), baseIor = (1.0f + root) / (1.0f - root);
    const glm::vec3 inner0 = (baseIor - filmIor) / (baseIor + filmIor), square = inner0 * inner0;
    const glm::vec3 inner = square + (1.0f - square) * schlickWeight(inside);
    const glm::vec3 r2 = glm::min(outer * inner, 0.9999f), once = t * t * inner / (1.0f - r2);
    const glm::vec3 sign = glm::mix(glm::vec3(-1.0f), glm::vec3(1.0f), glm::lessThan(inner0, glm::vec3(0.0f))); // of r21 r23

    glm::vec3 sum = outer + once, term = once - t;
    for (int m = 1; m <= 3; ++m) { // r is below 0.3 but at grazing angles, where t vanishes
        term *= sign * glm::sqrt(r2);
        sum += 2.0f * term * meanCosine(float(m) * 2.0f * filmIor * thickness * inside);
    }
    return glm::clamp(sum, 0.0f, 1.0f);
}

} // namespace nacre::stage
