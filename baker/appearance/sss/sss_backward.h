// Gradient of what a pixel shades (formats/appearance/sss/sss.h). Scalar reference, host and device.
#pragma once

#include "appearance/sss/sss.h"
#include "base/light_sample.h"

namespace nacre {

/// Gradient with respect to the surface and to the two directions (as free vectors: project before use on the sphere).
template <class T> struct SssReflectGradient {
    T base[3] = {}, roughness = T(0), metalness = T(0), normal[3] = {}, diffuse = T(0), wo[3] = {}, wi[3] = {};
};

/// Adds the gradient of sum_c dValue[c] * value[c] to `d`. `o` from sssReflect of the same arguments. Clamps pass no gradient.
template <class T>
NACRE_HD inline void sssReflectBackward(const SssSurface<T>& s, const T* wo, const T* wi, const SssReflection<T>& o,
                                        const T* dValue, SssReflectGradient<T>& d)
{
    const T zero = T(0), one = T(1), inversePi = T(kSssInversePi);
    const T lit = select(o.nl > zero, one, zero); // from behind: zero, and flat
    T dSpecular = zero, dP = zero, dNl = zero; // of D * vis; of Schlick's power
    for (int c = 0; c < 3; ++c) {
        const T g = dValue[c] * o.nl, entering = (one - s.metalness) * s.base[c] * inversePi, lambert = entering * s.diffuse;
        dNl += dValue[c] * lit * ((one - o.fresnel[c]) * lambert + o.d * o.vis * o.fresnel[c]);
        dSpecular += g * o.fresnel[c];
        const T dFresnel = g * (o.d * o.vis - lambert), dF0 = dFresnel * (one - o.p);
        dP += dFresnel * (one - o.f0[c]);
        const T dEntering = g * (one - o.fresnel[c]) * s.diffuse * inversePi;
        d.base[c] += dF0 * s.metalness + dEntering * (one - s.metalness);
        d.metalness += dF0 * (s.base[c] - T(kSssDielectricF0)) - dEntering * s.base[c];
        d.diffuse += g * (one - o.fresnel[c]) * entering;
    }
    const T dD = dSpecular * o.vis, dVis = dSpecular * o.d;
    const T dA2 = dD * (o.d / o.a2 - T(2) * o.d * o.nh * o.nh * o.inverseQ);
    const T dQ = dD * T(-2) * o.d * o.inverseQ;
    const T dSine2 = select(o.nh > zero, dQ, zero); // sine2 = |n|^2 |h|^2 - (n.h)^2 with n and h of length one
    const T dNh = select((o.nh > zero) & (o.nh < one), dQ * T(2) * o.nh * o.a2, zero) - T(2) * dSine2 * o.nh;
    dNl -= dVis * o.vis * (one - o.k) * o.inverseGl;
    const T dNv = select(o.nv > zero, -dVis * o.vis * (one - o.k) * o.inverseGv, zero);
    const T dK = -dVis * o.vis * ((one - o.nl) * o.inverseGl + (one - o.nv) * o.inverseGv);
    d.roughness += select((s.roughness > T(kSssMinRoughness)) & (s.roughness < one),
                          dA2 * T(4) * o.r * o.r * o.r + dK * (o.r + one) * T(0.25), zero);
    const T m = one - o.vh;
    const T dVh = select((o.vh > zero) & (o.vh < one), dP * T(-5) * m * m * m * m, zero);

    T dHalf[3], along = zero;
    for (int c = 0; c < 3; ++c) {
        dHalf[c] = dNh * s.normal[c] + dVh * wo[c], along += dHalf[c] * o.half[c];
        d.normal[c] += dNl * wi[c] + dNv * wo[c] + dNh * o.half[c] + T(2) * dSine2 * s.normal[c];
        d.wi[c] += dNl * s.normal[c];
        d.wo[c] += dNv * s.normal[c] + dVh * o.half[c];
    }
    for (int c = 0; c < 3; ++c) {
        const T free = (dHalf[c] - along * o.half[c]) * o.inverseHalf;
        d.wi[c] += free, d.wo[c] += free;
    }
}

/// Adds to dPoint. dWi as a free vector.
template <class T>
NACRE_HD inline void sssPointLightBackward(const LightSample<T>& o, T radius, const T* dWi, T dFalloff, T* dPoint)
{
    using std::sqrt;
    const T distance = sqrt(o.distance2), inv = select(o.distance2 > T(1e-20), T(1) / distance, T(0));
    T along = T(0);
    for (int c = 0; c < 3; ++c) along += dWi[c] * o.dir[c];
    // d falloff / d point = 2 falloff^2 (light - point), while the radius does not cap it
    const T slope = select(o.distance2 > radius * radius, T(2) * dFalloff * o.falloff * o.falloff * distance, T(0));
    for (int c = 0; c < 3; ++c) dPoint[c] += slope * o.dir[c] - (dWi[c] - along * o.dir[c]) * inv;
}

/// Gradient with respect to a pixel's channels, gathered over its lights.
template <class T> struct SssPixelGradient {
    SssReflectGradient<T> surface;
    T point[3] = {};
};

/// One point light (`intensity` rgb). dImage: gradient of the radiance times alpha. Writes dLight [4], adds to `d`.
template <class T>
NACRE_HD inline void sssPixelLightBackward(const SssPixel<T>& pixel, const T* channels, const LightSample<T>& at, T radius,
                                           const T* intensity, const SssReflection<T>& o, const T* dImage, T* dLight,
                                           SssPixelGradient<T>& d)
{
    for (int c = 0; c < 3; ++c) dLight[kSssScattered + c] = dImage[c];
    T dValue[3], sum = T(0); // sum: gradient with respect to incident * falloff
    const T factor = channels[kSssIncident] * at.falloff;
    for (int c = 0; c < 3; ++c) {
        dValue[c] = dImage[c] * intensity[c] * factor;
        sum += dImage[c] * intensity[c] * o.value[c];
    }
    dLight[kSssIncident] = sum * at.falloff;
    SssReflectGradient<T> here;
    sssReflectBackward(pixel.surface, pixel.wo, at.dir, o, dValue, here);
    sssPointLightBackward(at, radius, here.wi, sum * channels[kSssIncident], d.point);
    for (int c = 0; c < 3; ++c) d.surface.base[c] += here.base[c], d.surface.normal[c] += here.normal[c];
    d.surface.roughness += here.roughness, d.surface.metalness += here.metalness, d.surface.diffuse += here.diffuse;
}

/// After all lights: overwrites dG [10] and dAlpha, the gradient with respect to the blended channels. `ray` as for sssPixel.
template <class T>
NACRE_HD inline void sssPixelBackward(const SssPixel<T>& pixel, const T* g, const T* ray, const SssPixelGradient<T>& d, T* dG,
                                      T* dAlpha)
{
    T dInverse = T(0), along = T(0), dDepth = T(0);
    const auto divided = [&](int k, T gradient) { dG[k] = gradient * pixel.inverseAlpha, dInverse += gradient * g[k]; };
    for (int c = 0; c < 3; ++c) along += pixel.surface.normal[c] * d.surface.normal[c], dDepth += d.point[c] * ray[c];
    for (int c = 0; c < 3; ++c) {
        dG[kSssNormal + c] = (d.surface.normal[c] - along * pixel.surface.normal[c]) * pixel.inverseLength;
        divided(kSssBase + c, d.surface.base[c]);
    }
    divided(kSssRoughness, d.surface.roughness), divided(kSssMetalness, d.surface.metalness);
    divided(kSssSubsurface, -d.surface.diffuse), divided(kSssDepth, dDepth);
    *dAlpha = -dInverse * pixel.inverseAlpha * pixel.inverseAlpha;
}

} // namespace nacre
