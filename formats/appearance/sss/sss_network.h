// The network of the sss model (SSS-GS, section 3.3): what leaves a Gaussian after travelling beneath the surface, and how much
// of a light arrives. Scalar reference, host and device.
//
//   fixed inputs and code (per Gaussian) + light inputs (per Gaussian and light) -> 64 -> 32 -> 32 -> residual rgb in (0, 1)
//                                                                                    \-> 32 -> share in (0, 2)
//
// Leaky rectifiers (0.01) between, logistic functions at the ends, so that no input whatever leads out of bounds. The incident
// term is visibility * share: a network of zeros is plain visibility, so that surface light is there from the first step and the
// residual has nothing to take over (the collapse that the published code knows). The part of the first layer that a light does
// not change is computed once per Gaussian: sssNetworkFixed, sssNetworkCode. The code is what the four octaves of the position cannot say: what
// is peculiar to a place finer than a sixteenth of the object, such as relief.
#pragma once

#include "base/host_device.h"

#include <cmath>

namespace nacre {

constexpr int kSssOctaves = 4;
constexpr int kSssFixedInputs = 6 * kSssOctaves + 3; // Fourier code of the position, normal
constexpr int kSssVisibilityInput = 6, kSssNearnessInput = 7, kSssLightInputs = 8; // w_o, w_t, visibility, nearness of the light
constexpr int kSssCodeInputs = 16; // learnt numbers of each Gaussian, which may be absent
constexpr int kSssHidden1 = 64, kSssHidden2 = 32, kSssHidden3 = 32, kSssHiddenShare = 32;
constexpr float kSssLeak = 0.01f;

// Where each matrix [outputs][inputs] and bias lies in the array of weights.
constexpr int kSssFirstFixed = 0;
constexpr int kSssFirstLight = kSssFirstFixed + kSssHidden1 * kSssFixedInputs;
constexpr int kSssFirstBias = kSssFirstLight + kSssHidden1 * kSssLightInputs;
constexpr int kSssSecond = kSssFirstBias + kSssHidden1;
constexpr int kSssSecondBias = kSssSecond + kSssHidden2 * kSssHidden1;
constexpr int kSssThird = kSssSecondBias + kSssHidden2;
constexpr int kSssThirdBias = kSssThird + kSssHidden3 * kSssHidden2;
constexpr int kSssResidual = kSssThirdBias + kSssHidden3;
constexpr int kSssResidualBias = kSssResidual + 3 * kSssHidden3;
constexpr int kSssShare = kSssResidualBias + 3;
constexpr int kSssShareBias = kSssShare + kSssHiddenShare * kSssHidden3;
constexpr int kSssShareOut = kSssShareBias + kSssHiddenShare;
constexpr int kSssShareOutBias = kSssShareOut + kSssHiddenShare;
constexpr int kSssWeights = kSssShareOutBias + 1;
constexpr int kSssCode = kSssWeights; // [kSssHidden1][kSssCodeInputs]: first layer of the code, stored apart
constexpr int kSssAllWeights = kSssCode + kSssHidden1 * kSssCodeInputs;

/// frame: centre and 1 / half-size of the object, in which the position is measured. All inputs end up in [-1, 1]. The paper adds rotation and
/// scale of the Gaussian; what leaves a surface does not depend on how it was cut into Gaussians, and the bakes do without them as well.
template <class T>
NACRE_HD inline void sssFixedInputs(const T* position, const T* normal, const T* frame, T* in)
{
    const T bound = T(1e4); // beyond it the code of a position is noise anyway, and a sine of 1e30 is not worth computing
    for (int k = 0; k < 3; ++k) {
        const T raw = (position[k] - frame[k]) * frame[3], p = raw < -bound ? -bound : raw > bound ? bound : raw;
        T sine = std::sin(T(3.14159265358979) * p), cosine = std::cos(T(3.14159265358979) * p);
        for (int o = 0; o < kSssOctaves; ++o) {
            *in++ = sine, *in++ = cosine;
            const T twice = T(2) * sine * cosine; // an octave up
            cosine = T(1) - T(2) * sine * sine, sine = twice;
        }
    }
    for (int k = 0; k < 3; ++k) *in++ = normal[k];
}

/// distance: to a point light in half-sizes of the object; negative for a directional light. Nearness is 1 / (1 + distance), 0
/// for that.
template <class T> NACRE_HD inline void sssLightInputs(const T* wo, const T* wt, T visibility, T distance, T* in)
{
    for (int k = 0; k < 3; ++k) in[k] = wo[k], in[3 + k] = wt[k];
    in[kSssVisibilityInput] = visibility;
    in[kSssNearnessInput] = distance < T(0) ? T(0) : T(1) / (T(1) + distance);
}

/// out[j] = bias[j] + sum_i weight[j][i] in[i]
template <class T> NACRE_HD inline void sssLayer(const T* weight, const T* bias, const T* in, int inputs, int outputs, T* out)
{
    for (int j = 0; j < outputs; ++j) {
        T sum = bias[j];
        for (int i = 0; i < inputs; ++i) sum += weight[j * inputs + i] * in[i];
        out[j] = sum;
    }
}

template <class T> NACRE_HD inline T sssLeaky(T x) { return x > T(0) ? x : T(kSssLeak) * x; }
template <class T> NACRE_HD inline T sssLogistic(T x)
{
    const T e = std::exp(x > T(0) ? -x : x); // never overflows
    return x > T(0) ? T(1) / (T(1) + e) : e / (T(1) + e);
}

/// The first layer before a light is known: bias included.
template <class T> NACRE_HD inline void sssNetworkFixed(const T* w, const T* fixed, T* first)
{
    sssLayer(w + kSssFirstFixed, w + kSssFirstBias, fixed, kSssFixedInputs, kSssHidden1, first);
}

/// Adds a Gaussian's code to the first layer. `w`: [kSssHidden1][kSssCodeInputs].
template <class T>
NACRE_HD inline void sssNetworkCode(const T* w, const T* code, T* first)
{
    for (int j = 0; j < kSssHidden1; ++j)
        for (int i = 0; i < kSssCodeInputs; ++i) first[j] += w[j * kSssCodeInputs + i] * code[i];
}

template <class T> struct SssActivations { // after the rectifiers; what the gradient needs
    T h1[kSssHidden1], h2[kSssHidden2], h3[kSssHidden3], hs[kSssHiddenShare];
    T residual[3], share;
};

template <class T> NACRE_HD inline SssActivations<T> sssNetworkLight(const T* w, const T* first, const T* light)
{
    SssActivations<T> a;
    sssLayer(w + kSssFirstLight, first, light, kSssLightInputs, kSssHidden1, a.h1);
    for (T& x : a.h1) x = sssLeaky(x);
    sssLayer(w + kSssSecond, w + kSssSecondBias, a.h1, kSssHidden1, kSssHidden2, a.h2);
    for (T& x : a.h2) x = sssLeaky(x);
    sssLayer(w + kSssThird, w + kSssThirdBias, a.h2, kSssHidden2, kSssHidden3, a.h3);
    for (T& x : a.h3) x = sssLeaky(x);
    sssLayer(w + kSssResidual, w + kSssResidualBias, a.h3, kSssHidden3, 3, a.residual);
    for (T& x : a.residual) x = sssLogistic(x);
    sssLayer(w + kSssShare, w + kSssShareBias, a.h3, kSssHidden3, kSssHiddenShare, a.hs);
    for (T& x : a.hs) x = sssLeaky(x);
    sssLayer(w + kSssShareOut, w + kSssShareOutBias, a.hs, kSssHiddenShare, 1, &a.share);
    a.share = T(2) * sssLogistic(a.share);
    return a;
}

} // namespace nacre
