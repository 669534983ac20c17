// sss: deferred PBR with a learned subsurface term (SSS-GS, eq. 4 to 8). The scalar reference of what a pixel shades. Host and device.
//
//   L = sum_t ( S_t + alpha * E_t * V_t * f(w_t, w_o) * max(n.w_t, 0) )
//
// Splats are blended into a G-buffer first: base colour, roughness, metalness, normal, subsurfaceness s and depth once per view, and per
// light the incident share V_t and the scattered light S_t, the sum of what the network gives each Gaussian (s_i E_i R_i). All but S_t are
// divided by the accumulated alpha before they mean anything; E_t is the irradiance of light t at the pixel's surface point (intensity /
// distance^2).
// f is GGX with alpha = roughness^2, Schlick's Fresnel term, Smith-Schlick masking with k = (roughness + 1)^2 / 8 and a diffuse part
// (1 - F)(1 - metalness)(1 - s) base / pi. The paper takes 1 - s of highlights too; but they never enter the surface. Linear in light: V_t and R_t are ratios that do not know the light's intensity.
//
// Without branches, so that T can be a number or a vector of them (render/lanes.h of the baker). What has no value is 0 and adds nothing.
#pragma once

#include "base/host_device.h"
#include "base/select.h"

#include <cmath>

namespace nacre {

constexpr float kSssMinRoughness = 0.04f;  // GGX peaks at 1 / (pi r^4): 1.2e5 here, finite in half floats after E * NL of order one
constexpr double kSssInversePi = 0.318309886183791;
constexpr float kSssDielectricF0 = 0.04f;
constexpr float kSssMinAlpha = 1e-3f;      // a pixel fainter than this shows nothing
constexpr float kSssMinLength = 1e-4f;     // blended normals shorter than this have cancelled: there is no direction to shade

/// What a pixel's surface is, after division by alpha.
template <class T>
struct SssSurface {
    T base[3];     // [0, 1]
    T roughness;   // [0, 1]
    T metalness;   // [0, 1]
    T normal[3];   // unit
    T diffuse = T(1); // 1 - subsurfaceness: of what enters the surface, that part leaves where it entered
};

/// Intermediate values of sssReflect, for its gradient.
template <class T>
struct SssReflection {
    T nl, nv, nh, vh, inverseHalf, half[3]; // cosines, clamped at 0; 1 / length and direction of w_i + w_o (0 if there is none)
    T sine2;                               // 1 - nh^2
    T r, k, a2, inverseQ, d, inverseGl, inverseGv, vis, p;
    T f0[3], fresnel[3];
    T value[3];                            // f * nl
};

/// Reflected radiance per unit irradiance across the light's direction: f(w_i, w_o) * max(n.w_i, 0), per channel. Unit directions, away
/// from the surface. `widening`: highlightWidening of the light.
template <class T>
NACRE_HD inline SssReflection<T> sssReflect(const SssSurface<T>& s, const T* wo, const T* wi, T widening = T(0))
{
    const T zero = T(0), one = T(1);
    using std::sqrt;
    const auto atLeast0 = [&](T x) { return select(x > zero, x, zero); };
    SssReflection<T> o{};
    T length2 = zero, nh = zero, vh = zero, nl = zero, nv = zero;
    for (int c = 0; c < 3; ++c) {
        o.half[c] = wi[c] + wo[c], length2 += o.half[c] * o.half[c];
        nl += s.normal[c] * wi[c], nv += s.normal[c] * wo[c];
    }
    o.inverseHalf = select(length2 > T(1e-12), one / sqrt(length2), zero);
    for (int c = 0; c < 3; ++c) {
        o.half[c] = o.half[c] * o.inverseHalf;
        nh += s.normal[c] * o.half[c], vh += wo[c] * o.half[c];
    }
    o.nl = atLeast0(nl), o.nv = atLeast0(nv), o.nh = select(nh > one, one, atLeast0(nh)), o.vh = select(vh > one, one, atLeast0(vh));
    o.r = select(s.roughness > T(kSssMinRoughness), select(s.roughness < one, s.roughness, one), T(kSssMinRoughness));
    o.a2 = o.r * o.r * o.r * o.r + widening;
    o.a2 = select(o.a2 < one, o.a2, one);
    o.k = (o.r + one) * (o.r + one) * T(0.125);
    // |n x h|^2: one minus a square of nearly one would be off by 1e-7, a tenth of the peak at the least roughness.
    T across2 = zero;
    for (int c = 0; c < 3; ++c) {
        const int p = (c + 1) % 3, q = (c + 2) % 3;
        const T across = s.normal[p] * o.half[q] - s.normal[q] * o.half[p];
        across2 += across * across;
    }
    o.sine2 = select(o.nh > zero, across2, one);
    o.inverseQ = one / (o.sine2 + o.nh * o.nh * o.a2);
    o.d = select(o.inverseHalf > zero, o.a2 * T(kSssInversePi) * o.inverseQ * o.inverseQ, zero);
    o.inverseGl = one / (o.nl * (one - o.k) + o.k), o.inverseGv = one / (o.nv * (one - o.k) + o.k);
    o.vis = T(0.25) * o.inverseGl * o.inverseGv;
    const T m = one - o.vh;
    o.p = m * m * m * m * m;
    for (int c = 0; c < 3; ++c) {
        o.f0[c] = T(kSssDielectricF0) * (one - s.metalness) + s.base[c] * s.metalness;
        o.fresnel[c] = o.f0[c] + (one - o.f0[c]) * o.p;
        const T diffuse = (one - o.fresnel[c]) * (one - s.metalness) * s.diffuse * s.base[c] * T(kSssInversePi);
        o.value[c] = (diffuse + o.d * o.vis * o.fresnel[c]) * o.nl;
    }
    return o;
}

// Channels of the G-buffer, blended like colours (not yet divided by alpha).
constexpr int kSssNormal = 0, kSssBase = 3, kSssRoughness = 6, kSssMetalness = 7, kSssSubsurface = 8, kSssDepth = 9, kSssSurfaceChannels = 10;
// And per light: visibility * share of the network, and subsurfaceness * residual * irradiance of each Gaussian (rgb). Residual light is
// added up Gaussian by Gaussian, not as a product of two means.
constexpr int kSssIncident = 0, kSssScattered = 1, kSssLightChannels = 4;

/// A pixel's surface, once per view.
template <class T>
struct SssPixel {
    SssSurface<T> surface;
    T inverseAlpha;
    T inverseLength; // of the blended normal; 0: too faint, or its normals cancel: the normal is 0, and only scattered light is seen
    T wo[3], point[3];
};

/// `g`: the surface channels; the point at depth t is eye + t * ray.
template <class T>
NACRE_HD inline SssPixel<T> sssPixel(const T* g, T alpha, const T* eye, const T* ray)
{
    using std::sqrt;
    const T zero = T(0), one = T(1);
    SssPixel<T> o{};
    o.inverseAlpha = select(alpha > T(kSssMinAlpha), one / alpha, zero);
    const T normalLength = sqrt(g[kSssNormal] * g[kSssNormal] + g[kSssNormal + 1] * g[kSssNormal + 1] + g[kSssNormal + 2] * g[kSssNormal + 2]);
    o.inverseLength = select(normalLength * o.inverseAlpha > T(kSssMinLength), one / normalLength, zero);
    const T depth = g[kSssDepth] * o.inverseAlpha, inverseRay = one / sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
    for (int c = 0; c < 3; ++c) {
        o.surface.normal[c] = g[kSssNormal + c] * o.inverseLength, o.surface.base[c] = g[kSssBase + c] * o.inverseAlpha;
        o.wo[c] = -ray[c] * inverseRay, o.point[c] = eye[c] + depth * ray[c];
    }
    o.surface.roughness = g[kSssRoughness] * o.inverseAlpha, o.surface.metalness = g[kSssMetalness] * o.inverseAlpha;
    o.surface.diffuse = one - g[kSssSubsurface] * o.inverseAlpha;
    return o;
}

/// Radiance of one light times alpha, one channel: what the image shows. `irradiance`: intensity * falloff; reflected: sssReflect.
template <class T>
NACRE_HD inline T sssRadiance(const T* light, T irradiance, T reflected, int c)
{
    return light[kSssScattered + c] + light[kSssIncident] * irradiance * reflected;
}

} // namespace nacre
