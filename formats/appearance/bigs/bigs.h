// bigs: bidirectional Gaussian primitives (BiGS, eq. 6, 7, 9, 11), the scalar reference of the evaluator. Host and device.
//
//   L(w_o) = sum_t E_t * [ max(T_dir(w_t), 0) * max(rho + s(w_t, w_o), 0) + max(T_ind(w_t), 0) ]
//
// w_t points from the Gaussian to light t, w_o from the Gaussian to the camera; E_t is the irradiance (rgb).
// T_dir and T_ind are SH of degree 4 in w_t. s is a symmetric form s(w_t, w_o) = sum_ab c_ab y_a(w_t) y_b(w_o), c_ab = c_ba,
// on the first `sFunctions` SH, stored as the pairs a <= b at b(b+1)/2 + a: fewer functions are a prefix.
// Linear in light: every clamp is per light and before the product with E_t.
#pragma once

#include "base/host_device.h"
#include "base/spherical_harmonics.h"

#include <cstdint>

namespace nacre {

constexpr int kBigsTransportFunctions = 25;

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

/// Radiance towards the camera per unit irradiance, one channel.
template <class T>
NACRE_HD inline T bigsTransport(const BigsTerms<T>& t, int c)
{
    const T zero = T(0);
    const T direct = t.direct > zero ? t.direct : zero;
    const T scatter = t.scatter[c] > zero ? t.scatter[c] : zero;
    const T indirect = t.indirect[c] > zero ? t.indirect[c] : zero;
    return direct * scatter + indirect;
}

} // namespace nacre
