// Scattering by a dielectric fibre with tilted cuticle scales: Chiang, Bitterli, Tappan and Burley 2016, "A Practical and Controllable
// Hair and Fur Model for Production Path Tracing", on the lobes of Marschner et al. 2003 and d'Eon et al. 2011.
//
//   S(wo, wi) = sum_p A_p(theta_o, h) M_p(theta_o, theta_i) N_p(phi_i - phi_o, h),   p = R, TT, TRT, all further bounces
//
// S is the BSDF times |cos|: radiance out = integral of S(wo, wi) L(wi) d(wi) over the whole sphere, and a light of irradiance E (on a
// plane across its direction) adds S E. No other cosine appears. Without absorption S integrates to 1 exactly, for every wo and h:
//   A_p: Fresnel and Beer's law along the refracted path, at the offset h; the lobe of further bounces is the rest of the series.
//   M_p: d'Eon's normalised Gaussian-like lobe about the cone theta_i = -theta_o + (-2, 1, 4) alpha for R, TT, TRT: scales whose normals
//        lean to the root by alpha send R to the root and TRT to the tip (Marschner et al.). Its variance v comes from beta_M.
//   N_p: logistic distribution of scale s(beta_N) about the azimuth of the perfect path, trimmed to (-pi, pi); 1 / 2 pi for the rest.
// The whole fibre is one scatterer: light leaves where it came in, so a ray that continues from here must not see this fibre again.
//
// Frame: x along the fibre from root to tip, y and z across, right-handed and else free. wo (to the viewer) and wi (to the light) are
// unit and point away. theta: angle to the yz plane, sin theta = x. phi = atan2(z, y).
// h in [-1, 1], the offset of the hit across the fibre in radii: h = sin(phi_o - phi_n) with the azimuth phi_n of the outward normal.
// Seen as a flat ribbon towards wo, h = -t for a hit at t radii in the direction cross(x, wo).
// Not reciprocal in the last percents (A_p and the tilt are evaluated at wo only), as published.
#pragma once

#include <glm/glm.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace nacre::stage {

constexpr int kHairLobes = 4; // R, TT, TRT, rest

/// What all hits of one fibre material share.
struct HairFiber {
    float ior = 1.55f;
    float variance[3], inverseVariance[3]; // v of M_p; the rest has that of TRT
    float longitudinalNorm[3]; // 1 / (v (1 - exp(-2 / v)))
    float logisticScale = 0, inverseScale = 0; // s of N_p
    float logisticTail = 0;   // cdf(-pi) of the untrimmed logistic
    float logisticNorm = 0;   // 1 / (s (1 - 2 cdf(-pi)))
    glm::vec2 tilt[3];        // (sin, cos) of what R, TT, TRT turn theta_o by: 2 alpha, -alpha, -4 alpha
};

/// Roughnesses in (0, 1] (clamped to [0.02, 1]), ior > 1, tilt alpha in radians: Chiang et al., equations 7 and 8 and section 3.
inline HairFiber makeHairFiber(float betaM, float betaN, float tiltRadians, float ior)
{
    constexpr float kPi = std::numbers::pi_v<float>;
    HairFiber f;
    f.ior = std::max(ior, 1.001f);
    const float bm = std::clamp(betaM, 0.02f, 1.0f), bn = std::clamp(betaN, 0.02f, 1.0f);
    const float root = 0.726f * bm + 0.812f * bm * bm + 3.7f * std::pow(bm, 20.0f);
    const float scale[3] = {1.0f, 0.25f, 4.0f}, turn[3] = {2.0f, -1.0f, -4.0f};
    for (int p = 0; p < 3; ++p) {
        f.variance[p] = scale[p] * root * root;
        f.inverseVariance[p] = 1.0f / f.variance[p];
        f.longitudinalNorm[p] = 1.0f / (f.variance[p] * -std::expm1(-2.0f / f.variance[p]));
        f.tilt[p] = {std::sin(turn[p] * tiltRadians), std::cos(turn[p] * tiltRadians)};
    }
    f.logisticScale = std::sqrt(kPi / 8.0f) * (0.265f * bn + 1.194f * bn * bn + 5.372f * std::pow(bn, 22.0f));
    f.inverseScale = 1.0f / f.logisticScale;
    f.logisticTail = 1.0f / (1.0f + std::exp(kPi / f.logisticScale));
    f.logisticNorm = 1.0f / (f.logisticScale * (1.0f - 2.0f * f.logisticTail));
    return f;
}

/// Absorption per fibre radius, such that a thick coat of fibres shows `color` under white light (their fit, equation 9). Colours are
/// clamped to [0.001, 1].
inline glm::vec3 hairAbsorption(glm::vec3 color, float betaN)
{
    const float b = std::clamp(betaN, 0.02f, 1.0f);
    const float fit = 5.969f + b * (-0.215f + b * (2.532f + b * (-10.73f + b * (5.574f + b * 0.245f))));
    const glm::vec3 root = glm::log(glm::clamp(color, 0.001f, 1.0f)) / fit;
    return root * root;
}

/// One hit seen from wo: everything that does not depend on wi, so that many lights at one hit are cheap.
struct HairHit {
    const HairFiber* fiber;
    glm::vec3 attenuation[kHairLobes]; // A_p
    float chance[kHairLobes];          // of sampling lobe p: mean of A_p over RGB, normalised
    glm::vec2 theta[kHairLobes];       // (sin, cos) of theta_o turned by the tilt, cos >= 0
    float phi[3];                      // azimuth of the perfect path, absolute, in [-pi, pi]: phi_o + 2 p gamma_t - 2 gamma_o + p pi
};

/// Of an unpolarised wave on a dielectric of relative index `ior` > 1, from outside; cosine in [0, 1].
inline float hairFresnel(float cosine, float ior)
{
    const float inside = std::sqrt(std::max(0.0f, 1.0f - (1.0f - cosine * cosine) / (ior * ior)));
    const float across = (cosine - ior * inside) / (cosine + ior * inside);
    const float along = (ior * cosine - inside) / (ior * cosine + inside);
    return 0.5f * (across * across + along * along);
}

/// h is clamped to [-1, 1]; sigmaA as from hairAbsorption. `fiber` must outlive the result.
inline HairHit makeHairHit(const HairFiber& fiber, float h, glm::vec3 sigmaA, glm::vec3 wo)
{
    HairHit hit;
    hit.fiber = &fiber;
    h = std::clamp(h, -1.0f, 1.0f);
    const float sinO = std::clamp(wo.x, -1.0f, 1.0f), cosO = std::sqrt(1.0f - sinO * sinO);
    const float phiO = std::atan2(wo.z, wo.y);

    // The refracted path in the cross-section: Bravais' effective index turns the tilted fibre into a flat problem.
    const float sinGammaT = h * cosO / std::sqrt(fiber.ior * fiber.ior - sinO * sinO), cosGammaT = std::sqrt(1.0f - sinGammaT * sinGammaT);
    const float cosThetaT = std::sqrt(1.0f - sinO * sinO / (fiber.ior * fiber.ior));
    const float gammaO = std::asin(h), gammaT = std::asin(sinGammaT);
    for (int p = 0; p < 3; ++p)
        hit.phi[p] = std::remainder(phiO + 2.0f * (float(p) * gammaT - gammaO) + float(p) * std::numbers::pi_v<float>,
                                    2.0f * std::numbers::pi_v<float>);

    const float fresnel = hairFresnel(cosO * std::sqrt(1.0f - h * h), fiber.ior);
    const glm::vec3 transmitted = glm::exp(-sigmaA * (2.0f * cosGammaT / cosThetaT));
    hit.attenuation[0] = glm::vec3(fresnel);
    hit.attenuation[1] = (1.0f - fresnel) * (1.0f - fresnel) * transmitted;
    hit.attenuation[2] = hit.attenuation[1] * transmitted * fresnel;
    // (1 - F)^2 F^2 T^3 / (1 - F T); at F = 1 all light is in R, and the limit of this is 0.
    hit.attenuation[3] = hit.attenuation[2] * transmitted * fresnel / glm::max(1.0f - fresnel * transmitted, glm::vec3(1e-6f));

    float sum = 0;
    for (int p = 0; p < kHairLobes; ++p) {
        hit.chance[p] = hit.attenuation[p].x + hit.attenuation[p].y + hit.attenuation[p].z;
        sum += hit.chance[p];
    }
    for (int p = 0; p < kHairLobes; ++p) hit.chance[p] /= sum; // > 0: R is never 0 for ior > 1
    for (int p = 0; p < 3; ++p) {
        const glm::vec2 t = fiber.tilt[p];
        hit.theta[p] = {sinO * t.y + cosO * t.x, std::abs(cosO * t.y - sinO * t.x)};
    }
    hit.theta[3] = {sinO, cosO};
    return hit;
}

namespace hair_detail {

/// exp(x) for x <= 0; 0 below -87. Relative error < 3e-7 (Taylor to degree 6 on +-ln 2 / 2), several times faster than the library's.
inline float expNegative(float x)
{
    if (!(x > -87.0f)) return 0.0f;
    const float shifted = x * std::numbers::log2e_v<float> + 0x1.8p23f; // rounds to an integer in the low bits
    const float n = shifted - 0x1.8p23f;
    const float r = (x - n * 0x1.62e4p-1f) - n * 0x1.7f7d1cp-20f; // ln 2 in two parts
    const float e = 1.0f + r * (1.0f + r * (0.5f + r * (1.0f / 6 + r * (1.0f / 24 + r * (1.0f / 120 + r * (1.0f / 720))))));
    return e * std::bit_cast<float>((std::bit_cast<uint32_t>(shifted) - std::bit_cast<uint32_t>(0x1.8p23f) + 127) << 23);
}

/// exp(x - a) I0(a) for a >= 0, x <= 0. Polynomials of Abramowitz and Stegun 9.8.1 and 9.8.2, relative error < 1e-6 in f32.
inline float expBesselI0(float a, float x)
{
    if (a < 3.75f) {
        const float t = a * a * (1.0f / 14.0625f);
        return expNegative(x - a) *
               (1.0f + t * (3.5156229f + t * (3.0899424f + t * (1.2067492f + t * (0.2659732f + t * (0.0360768f + t * 0.0045813f))))));
    }
    const float t = 3.75f / a;
    return expNegative(x) / std::sqrt(a) *
           (0.39894228f +
            t * (0.01328592f +
                 t * (0.00225319f +
                      t * (-0.00157565f + t * (0.00916281f + t * (-0.02057706f + t * (0.02635537f + t * (-0.01647633f + t * 0.00392377f))))))));
}

/// M_p = exp(-sin sin' / v) I0(cos cos' / v) / (2 v sinh(1 / v)). The exponent that remains beside the scaled Bessel function,
/// (cos(theta + theta') - 1) / v, is formed from squares, so that no digits cancel in narrow lobes.
inline float longitudinal(glm::vec2 thetaO, glm::vec2 thetaI, float inverse, float norm)
{
    const float s = thetaI.x + thetaO.x, c = thetaI.y - thetaO.y;
    const float a = thetaI.y * thetaO.y * inverse;
    return norm * expBesselI0(a, -0.5f * (s * s + c * c) * inverse);
}

inline float azimuthal(float dPhi, const HairFiber& fiber)
{
    const float far = std::abs(dPhi), away = std::min(far, 2.0f * std::numbers::pi_v<float> - far); // the difference of two in [-pi, pi]
    const float e = expNegative(-std::max(away, 0.0f) * fiber.inverseScale);
    return e / ((1.0f + e) * (1.0f + e)) * fiber.logisticNorm;
}

} // namespace hair_detail

/// S(wo, wi), and the density with which hairSample draws wi, per solid angle.
inline glm::vec3 hairEval(const HairHit& hit, glm::vec3 wi, float* pdf = nullptr)
{
    using namespace hair_detail;
    const HairFiber& fiber = *hit.fiber;
    const float sinI = std::clamp(wi.x, -1.0f, 1.0f), phiI = std::atan2(wi.z, wi.y);
    const glm::vec2 thetaI(sinI, std::sqrt(1.0f - sinI * sinI));
    glm::vec3 value(0.0f);
    float density = 0;
    for (int p = 0; p < kHairLobes; ++p) {
        const int n = std::min(p, 2);
        const float m = longitudinal(hit.theta[p], thetaI, fiber.inverseVariance[n], fiber.longitudinalNorm[n]);
        if (!(m > 1e-12f)) continue; // far down the tail of a narrow lobe
        const float mn = m * (p < 3 ? azimuthal(phiI - hit.phi[p], fiber) : 0.5f * std::numbers::inv_pi_v<float>);
        value += hit.attenuation[p] * mn;
        density += hit.chance[p] * mn;
    }
    if (pdf) *pdf = density;
    return value;
}

inline float hairPdf(const HairHit& hit, glm::vec3 wi)
{
    float pdf = 0;
    hairEval(hit, wi, &pdf);
    return pdf;
}

/// Draws wi with density hairPdf from four numbers in [0, 1). weight = S / pdf, at most the largest A_p / chance_p of its channel.
/// False, with nothing to add: the density underflowed.
inline bool hairSample(const HairHit& hit, glm::vec2 u0, glm::vec2 u1, glm::vec3* wi, glm::vec3* weight, float* pdf)
{
    constexpr float kPi = std::numbers::pi_v<float>;
    const HairFiber& fiber = *hit.fiber;
    int p = 0;
    float pick = u0.x;
    while (p < kHairLobes - 1 && pick >= hit.chance[p]) pick -= hit.chance[p++];

    // M_p: a von Mises-Fisher lobe about -theta_o, at a random azimuth of its own (d'Eon, Marschner and Hanika 2013).
    const float v = fiber.variance[std::min(p, 2)];
    const float u = std::max(u0.y, 0x1p-26f); // half of the smallest step of u0.y
    const float fall = std::clamp(-v * std::log(u + (1.0f - u) * std::exp(-2.0f / v)), 0.0f, 2.0f); // 1 - cosine
    const float spread = std::sqrt(fall * (2.0f - fall)) * std::cos(2.0f * kPi * u1.x);
    const float sinI = std::clamp((fall - 1.0f) * hit.theta[p].x + spread * hit.theta[p].y, -1.0f, 1.0f);
    const float cosI = std::sqrt(1.0f - sinI * sinI);

    float phiI;
    if (p < 3) { // the lower half of the logistic, on a random side of its middle: no digits cancel in the tail
        const float side = u1.y < 0.5f ? -1.0f : 1.0f, half = u1.y < 0.5f ? 2.0f * u1.y : 2.0f * u1.y - 1.0f;
        const float cdf = fiber.logisticTail + half * (0.5f - fiber.logisticTail);
        const float away = cdf > 0.0f ? fiber.logisticScale * std::log((1.0f - cdf) / cdf) : kPi;
        phiI = hit.phi[p] + side * std::clamp(away, 0.0f, kPi);
    } else {
        phiI = 2.0f * kPi * u1.y;
    }
    *wi = {sinI, cosI * std::cos(phiI), cosI * std::sin(phiI)};
    const glm::vec3 value = hairEval(hit, *wi, pdf);
    if (!(*pdf > 1e-12f)) return false;
    *weight = value / *pdf;
    return true;
}

} // namespace nacre::stage
