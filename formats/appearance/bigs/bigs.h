// bigs: bidirectional Gaussian primitives (BiGS, eq. 6, 7, 9, 11) with two additions for what SH of degree 4 cannot hold, hard shadows
// and highlights. The scalar reference of the evaluator. Host and device.
//
//   L(w_o) = sum_t E_t * [ v(w_t) * ( max(T_dir(w_t), 0) * max(rho + s(w_t, w_o), 0) + k * lobe(w_t, w_o) + f * forward(w_t, w_o) ) + max(T_ind(w_t), 0) ]
//
// w_t points from the Gaussian to light t, w_o from the Gaussian to the camera; E_t is the irradiance (rgb).
// T_dir and T_ind are SH of degree 4 in w_t. s is a symmetric form s(w_t, w_o) = sum_ab c_ab y_a(w_t) y_b(w_o), c_ab = c_ba,
// on the first `sFunctions` SH, stored as the pairs a <= b at b(b+1)/2 + a: fewer functions are a prefix.
// lobe: the GGX distribution of the half vector about the splat's normal, 1 at its peak; k is its colour there (bigsLobe).
// forward: what goes on nearly straight, as through hairs and leaves, 1 straight ahead; f is its colour there (bigsForward).
// v: transmittance of the other splats towards the light, an octahedral map of 16 x 16 or 32 x 32 texels (mapVisibility), made weaker by
// `shadow`, 0 to 1, where light seeps in (v = 1 - shadow (1 - map)).
// s, lobe (k = 0), forward (f = 0), visibility (v = 1) and shadow (1) are left out of assets that do not need them.
// Linear in light: every clamp is per light and before the product with E_t.
#pragma once

#include "appearance/visibility_map.h"
#include "base/host_device.h"
#include "base/spherical_harmonics.h"

#include <cmath>
#include <cstdint>

namespace nacre {

constexpr int kBigsTransportFunctions = 25;
constexpr int kBigsLobeFloats = 7;         // unit normal, sharpness 1/alpha^2 - 1 of GGX, k rgb
constexpr float kBigsLobeFacing = 4.0f;
constexpr int kBigsForwardFloats = 4;      // sharpness 2g / (1 - g)^2 of Henyey and Greenstein, f rgb

NACRE_HD constexpr int bigsPairCount(int sFunctions) { return sFunctions * (sFunctions + 1) / 2; }
/// How many functions of s a channel of `components` floats per splat holds; 0 if it is none of the accepted sizes.
NACRE_HD constexpr int bigsScatterFunctions(uint32_t components)
{
    for (int degree = 0; degree <= 4; ++degree)
        if (components == uint32_t(3 * bigsPairCount((degree + 1) * (degree + 1)))) return (degree + 1) * (degree + 1);
    return 0;
}
NACRE_HD constexpr int bigsPair(int a, int b) { return a <= b ? b * (b + 1) / 2 + a : a * (a + 1) / 2 + b; }

/// One Gaussian's coefficients.
template <class T>
struct BigsCoefficients {
    const T* tDir;  // [25]
    const T* tInd;  // [25][3]
    const T* rho;   // [3], in [0, 1]
    const T* s;     // [pairs][3]
    int sFunctions; // 0, 1, 4, 9, 16 or 25
    const T* lobe = nullptr;             // [7], or null
    VisibilityMap visibility{};
    T shadow = T(1);
    const T* forward = nullptr;          // [4], or null
};

/// View contraction: a[i][c] = sum_j c_ij,c y_j(w_o). Once per view; then a light costs one dot product.
template <class T>
NACRE_HD inline void bigsContractView(const BigsCoefficients<T>& g, const T* yView, T* a)
{
    for (int i = 0; i < g.sFunctions; ++i)
        for (int c = 0; c < 3; ++c) {
            T sum = T(0);
            for (int j = 0; j < g.sFunctions; ++j) sum += g.s[3 * bigsPair(i, j) + c] * yView[j];
            a[3 * i + c] = sum;
        }
}

/// The values before clamping, for one light: direct transport, rho + s per channel, indirect transport per channel.
template <class T>
struct BigsTerms {
    T direct;
    T scatter[3];
    T indirect[3];
};

/// `a` from bigsContractView; `yLight` the 25 SH of w_t.
template <class T>
NACRE_HD inline BigsTerms<T> bigsTerms(const BigsCoefficients<T>& g, const T* a, const T* yLight)
{
    BigsTerms<T> t{};
    for (int i = 0; i < kBigsTransportFunctions; ++i) t.direct += g.tDir[i] * yLight[i];
    for (int c = 0; c < 3; ++c) {
        for (int i = 0; i < kBigsTransportFunctions; ++i) t.indirect[c] += g.tInd[3 * i + c] * yLight[i];
        t.scatter[c] = g.rho[c];
        for (int i = 0; i < g.sFunctions; ++i) t.scatter[c] += a[3 * i + c] * yLight[i];
    }
    return t;
}

/// GGX about the normal, of the half vector between the unit directions wo and wi, scaled to 1 at its peak:
/// 1 / (1 + sharpness (1 - (n.h)^2))^2, times min(4 n.wi, 1): no highlight from behind. 0 where there is no half vector.
/// `widening`: highlightWidening of the light; a wider lobe is fainter by as much.
template <class T>
NACRE_HD inline T bigsLobe(const T* normalAndSharpness, const T* wo, const T* wi, T widening = T(0))
{
    const T* n = normalAndSharpness;
    T h[3], length2 = T(0), nh = T(0), facing = T(0);
    for (int k = 0; k < 3; ++k) h[k] = wo[k] + wi[k], length2 += h[k] * h[k], nh += n[k] * h[k], facing += n[k] * wi[k];
    if (!(length2 > T(1e-12)) || !(facing > T(0))) return T(0);
    const T cosine2 = nh > T(0) ? nh * nh / length2 : T(0);
    const T a2 = T(1) / (T(1) + (n[3] > T(0) ? n[3] : T(0))), wide = a2 + widening < T(1) ? a2 + widening : T(1);
    const T u = T(1) / (T(1) + (T(1) / wide - T(1)) * (cosine2 < T(1) ? T(1) - cosine2 : T(0)));
    const T front = T(kBigsLobeFacing) * facing;
    return a2 / wide * u * u * (front < T(1) ? front : T(1));
}

/// Henyey and Greenstein's phase function of light that is scattered once, scaled to 1 straight ahead: (1 + q (1 + wo.wi))^(-3/2).
template <class T>
NACRE_HD inline T bigsForward(T sharpness, const T* wo, const T* wi)
{
    using std::sqrt;
    const T behind = T(1) + wo[0] * wi[0] + wo[1] * wi[1] + wo[2] * wi[2];
    const T u = T(1) / (T(1) + (sharpness > T(0) ? sharpness : T(0)) * (behind > T(0) ? behind : T(0)));
    return u * sqrt(u);
}

/// What depends on the directions beyond their SH: v, and k * lobe + f * forward.
template <class T>
struct BigsSharpTerms {
    T visible = T(1);
    T lobe[3] = {T(0), T(0), T(0)};
};

template <class T>
NACRE_HD inline BigsSharpTerms<T> bigsSharpTerms(const BigsCoefficients<T>& g, const T* wo, const T* wi, T widening = T(0))
{
    BigsSharpTerms<T> t;
    if (g.visibility.texels) t.visible = T(1) - g.shadow * (T(1) - mapVisibility(g.visibility, wi));
    if (g.lobe) {
        const T shape = bigsLobe(g.lobe, wo, wi, widening);
        for (int c = 0; c < 3; ++c) t.lobe[c] = g.lobe[4 + c] * shape;
    }
    if (g.forward) {
        const T shape = bigsForward(g.forward[0], wo, wi);
        for (int c = 0; c < 3; ++c) t.lobe[c] += g.forward[1 + c] * shape;
    }
    return t;
}

/// Radiance towards the camera per unit irradiance, one channel.
template <class T>
NACRE_HD inline T bigsTransport(const BigsTerms<T>& t, const BigsSharpTerms<T>& sharp, int c)
{
    const T zero = T(0);
    const T direct = t.direct > zero ? t.direct : zero;
    const T scatter = t.scatter[c] > zero ? t.scatter[c] : zero;
    const T indirect = t.indirect[c] > zero ? t.indirect[c] : zero;
    return sharp.visible * (direct * scatter + sharp.lobe[c]) + indirect;
}

} // namespace nacre
