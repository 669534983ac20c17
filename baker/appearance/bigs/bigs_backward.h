// Gradient of the bigs evaluator (formats/appearance/bigs/bigs.h) with respect to its coefficients. Scalar reference, host and device.
//
// Directions and falloff are held constant within a step, as in BiGS: moving a Gaussian by its own size turns them by size / distance,
// orders of magnitude less than what the same move does on the image plane.
#pragma once

#include "appearance/bigs/bigs.h"

#include <cmath>

namespace nacre {

/// Gradient of one light's radiance. dTransport is the gradient with respect to bigsTransport of each channel, `visible` the v of the light.
/// Adds to `d`.
/// `leaky` lets a clamped-off value feel the gradient when descent would raise it, so that dead coefficients come back to life;
/// without it this is the exact derivative of the clamps.
template <class T>
NACRE_HD inline void bigsTransportBackward(const BigsTerms<T>& t, T visible, const T dTransport[3], bool leaky, BigsTerms<T>& d)
{
    const T zero = T(0);
    const auto pass = [&](T value, T gradient) { return value > zero || (leaky && gradient < zero) ? gradient : zero; };
    const T direct = t.direct > zero ? t.direct : zero;
    T dDirect = zero;
    for (int c = 0; c < 3; ++c) {
        dDirect += visible * dTransport[c] * (t.scatter[c] > zero ? t.scatter[c] : zero);
        d.scatter[c] += pass(t.scatter[c], visible * dTransport[c] * direct);
        d.indirect[c] += pass(t.indirect[c], dTransport[c]);
    }
    d.direct += pass(t.direct, dDirect);
}

/// Adds the gradient of weight * (min(T_dir,0)^2 + sum_c min(T_ind,0)^2 + sum_c min(rho+s,0)^2) to `d` (BiGS eq. 15).
template <class T>
NACRE_HD inline void bigsPositiveBackward(const BigsTerms<T>& t, T weight, BigsTerms<T>& d)
{
    const auto slope = [&](T x) { return x < T(0) ? T(2) * weight * x : T(0); };
    d.direct += slope(t.direct);
    for (int c = 0; c < 3; ++c) d.scatter[c] += slope(t.scatter[c]), d.indirect[c] += slope(t.indirect[c]);
}

/// Gradient of the sharp terms: of the shadow, of the lobe's normal (as a unit vector: tangential), log sharpness and k, and of the logarithm of
/// the sharpness and the colour of what goes on forward.
template <class T>
struct BigsSharpGradient {
    T shadow = T(0), normal[3] = {T(0), T(0), T(0)}, logSharpness = T(0), color[3] = {T(0), T(0), T(0)};
    T forwardLogSharpness = T(0), forwardColor[3] = {T(0), T(0), T(0)};
};

/// Adds the gradient of one light. dTransport as above.
template <class T>
NACRE_HD inline void bigsSharpBackward(const BigsCoefficients<T>& g, const BigsTerms<T>& t, const T* wo, const T* wi, const T dTransport[3],
                                       BigsSharpGradient<T>& d)
{
    const T zero = T(0), dark = g.visibility.texels ? T(1) - mapVisibility(g.visibility, wi) : zero, visible = T(1) - g.shadow * dark;
    const T direct = t.direct > zero ? t.direct : zero, shape = g.lobe ? bigsLobe(g.lobe, wo, wi) : zero;
    const T ahead = g.forward ? bigsForward(g.forward[0], wo, wi) : zero;
    T dShape = zero, dAhead = zero;
    for (int c = 0; c < 3; ++c) {
        const T k = g.lobe ? g.lobe[4 + c] : zero, scatter = t.scatter[c] > zero ? t.scatter[c] : zero;
        const T f = g.forward ? g.forward[1 + c] : zero;
        d.shadow -= dTransport[c] * dark * (direct * scatter + k * shape + f * ahead);
        d.forwardColor[c] += dTransport[c] * visible * ahead;
        dAhead += dTransport[c] * visible * f;
        d.color[c] += dTransport[c] * visible * shape;
        dShape += dTransport[c] * visible * k;
    }
    if (g.forward) { // ahead = u^(3/2), u = 1 / (1 + q)
        const T q = g.forward[0] * (T(1) + wo[0] * wi[0] + wo[1] * wi[1] + wo[2] * wi[2]);
        d.forwardLogSharpness -= T(1.5) * dAhead * ahead * q / (T(1) + q);
    }
    if (shape == zero) return;
    // shape = u^2 front, u = 1 / (1 + q (1 - cos^2)), cos = n.h
    const T *n = g.lobe, q = n[3];
    T h[3], length2 = zero, cosine = zero, facing = zero;
    for (int k = 0; k < 3; ++k) h[k] = wo[k] + wi[k], length2 += h[k] * h[k], facing += n[k] * wi[k];
    for (int k = 0; k < 3; ++k) h[k] /= std::sqrt(length2), cosine += n[k] * h[k];
    if (cosine < zero) cosine = zero;
    const T sine2 = T(1) - cosine * cosine, u = T(1) / (T(1) + q * sine2), front = T(kBigsLobeFacing) * facing;
    const T dFront = front < T(1) ? dShape * u * u * T(kBigsLobeFacing) : zero;
    const T dU = dShape * T(2) * u * (front < T(1) ? front : T(1)), dSine2 = -dU * u * u * q, dCosine = -T(2) * cosine * dSine2;
    d.logSharpness -= dU * u * u * q * sine2;
    T dNormal[3], along = zero;
    for (int k = 0; k < 3; ++k) dNormal[k] = dCosine * h[k] + dFront * wi[k], along += dNormal[k] * n[k];
    for (int k = 0; k < 3; ++k) d.normal[k] += dNormal[k] - along * n[k];
}

/// Integral of s(w_t, .) over all exitant directions, one channel: only the constant function survives, its integral is sqrt(4 pi).
template <class T>
NACRE_HD inline T bigsScatteredEnergy(const BigsCoefficients<T>& g, const T* yLight, int c)
{
    T sum = T(0);
    for (int i = 0; i < g.sFunctions; ++i) sum += g.s[3 * bigsPair(0, i) + c] * yLight[i];
    return T(3.5449077018110320) * sum;
}

/// Where the gradient of one Gaussian's coefficients goes; same layout as BigsCoefficients.
template <class T>
struct BigsGradient {
    T *tDir, *tInd, *rho, *s;
};

/// Adds the gradient of one light's terms. yView, yLight: 25 SH of w_o and w_t.
template <class T>
NACRE_HD inline void bigsTermsBackward(int sFunctions, const T* yView, const T* yLight, const BigsTerms<T>& d, BigsGradient<T>& out)
{
    for (int i = 0; i < kBigsTransportFunctions; ++i) {
        out.tDir[i] += d.direct * yLight[i];
        for (int c = 0; c < 3; ++c) out.tInd[3 * i + c] += d.indirect[c] * yLight[i];
    }
    for (int c = 0; c < 3; ++c) {
        out.rho[c] += d.scatter[c];
        for (int b = 0; b < sFunctions; ++b)
            for (int a = 0; a <= b; ++a)
                out.s[3 * bigsPair(a, b) + c] +=
                    d.scatter[c] * (a == b ? yLight[a] * yView[a] : yLight[a] * yView[b] + yLight[b] * yView[a]);
    }
}

/// Adds the gradient of weight * sum_c max(energy_c - 1, 0)^2 (BiGS eq. 14).
template <class T>
NACRE_HD inline void bigsEnergyBackward(const BigsCoefficients<T>& g, const T* yLight, T weight, BigsGradient<T>& out)
{
    for (int c = 0; c < 3; ++c) {
        const T excess = bigsScatteredEnergy(g, yLight, c) - T(1);
        if (!(excess > T(0))) continue;
        for (int i = 0; i < g.sFunctions; ++i)
            out.s[3 * bigsPair(0, i) + c] += T(2) * weight * excess * T(3.5449077018110320) * yLight[i];
    }
}

} // namespace nacre
