// GGX microfacets in the shading frame (z = normal), as glTF 2.0 appendix B uses them: D of Trowbridge and Reitz, Smith masking,
// shadowing and masking independent (G = G1(wo) G1(wi)). Anisotropic form: Burley 2012. Visible-normal sampling: Heitz 2018.
#pragma once

#include "light_stage/sampling.h"

namespace nacre::stage {

/// Below this alpha a highlight of a light without size would be smaller than any pixel: roughness 0.03.
constexpr float kMinAlpha = 0.0009f;

inline float ggxD(const glm::vec3& h, float ax, float ay)
{
    const float e = sqr(h.x / ax) + sqr(h.y / ay) + h.z * h.z;
    return 1.0f / (kPi * ax * ay * e * e);
}

/// Smith masking of a direction of either hemisphere.
inline float ggxG1(const glm::vec3& w, float ax, float ay)
{
    const float cos2 = w.z * w.z;
    if (!(cos2 > 0.0f)) return 0.0f;
    const float tan2 = (sqr(w.x * ax) + sqr(w.y * ay)) / cos2;
    return 2.0f / (1.0f + std::sqrt(1.0f + tan2));
}

/// A normal distributed as seen from wo (wo.z > 0): density G1(wo) D(h) max(0, wo.h) / wo.z.
inline glm::vec3 sampleVisibleNormal(const glm::vec3& wo, float ax, float ay, const glm::vec2& u)
{
    const glm::vec3 v = glm::normalize(glm::vec3(ax * wo.x, ay * wo.y, wo.z)); // stretched so that alpha = 1
    const float length2 = v.x * v.x + v.y * v.y;
    const glm::vec3 t1 = length2 > 0.0f ? glm::vec3(-v.y, v.x, 0.0f) / std::sqrt(length2) : glm::vec3(1, 0, 0);
    const glm::vec3 t2 = glm::cross(v, t1);
    const float r = std::sqrt(u.x), phi = 2.0f * kPi * u.y, s = 0.5f * (1.0f + v.z);
    const float p1 = r * std::cos(phi), p2 = (1.0f - s) * std::sqrt(std::max(0.0f, 1.0f - p1 * p1)) + s * r * std::sin(phi);
    const glm::vec3 n = p1 * t1 + p2 * t2 + std::sqrt(std::max(0.0f, 1.0f - p1 * p1 - p2 * p2)) * v;
    return glm::normalize(glm::vec3(ax * n.x, ay * n.y, std::max(1e-6f, n.z)));
}

/// D G1(wo) G1(wi) / (4 |wo.z| |wi.z|) for a half vector h.
inline float ggxReflection(const glm::vec3& wo, const glm::vec3& wi, const glm::vec3& h, float ax, float ay)
{
    return ggxD(h, ax, ay) * ggxG1(wo, ax, ay) * ggxG1(wi, ax, ay) / (4.0f * std::fabs(wo.z * wi.z));
}

/// Density over wi of mirroring wo at a visible normal.
inline float ggxReflectionPdf(const glm::vec3& wo, const glm::vec3& h, float ax, float ay)
{
    return ggxD(h, ax, ay) * ggxG1(wo, ax, ay) / (4.0f * std::fabs(wo.z));
}

inline float schlickWeight(float cosine)
{
    const float m = std::max(0.0f, 1.0f - cosine), m2 = m * m;
    return m2 * m2 * m;
}

/// Unpolarised Fresnel reflectance of a dielectric; eta = ior on the far side over ior on the side of the ray; cosine >= 0.
inline float fresnelDielectric(float cosine, float eta)
{
    const float g2 = eta * eta - 1.0f + cosine * cosine;
    if (g2 <= 0.0f) return 1.0f; // total internal reflection
    const float g = std::sqrt(g2), a = (g - cosine) / (g + cosine), b = (cosine * (g + cosine) - 1.0f) / (cosine * (g - cosine) + 1.0f);
    return 0.5f * a * a * (1.0f + b * b);
}

} // namespace nacre::stage
