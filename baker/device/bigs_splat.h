// bigs for one splat and all lights of a step, forward and backward with Adam, as a device's thread does it: twin of bigs_training.cpp, one splat
// instead of 16. What one light does is the shared mathematics of bigs.h and bigs_backward.h; here are the sums over coefficients, which lie 16
// numbers apart (BigsParameters), and over lights. Host and device. Parity test: tests/unit/device_bigs.cpp.
#pragma once

#include "appearance/bigs/bigs_backward.h"
#include "appearance/bigs/bigs_state.h"
#include "device/device.h"
#include "device/lit_view.h"

namespace nacre {

constexpr int kBigsKept = 7; // terms of a light that the backward pass reads again: direct, scatter rgb, indirect rgb

/// Numbers of one splat that lie `kStride` apart.
template <class T, int kStride>
struct Strided {
    T* first;
    NACRE_HD T& operator[](int k) const { return first[k * kStride]; }
};
template <class T>
using BlockColumn = Strided<T, kLanes16>;

/// What a step needs to know, the same for all splats.
struct BigsStep {
    DeviceLitView lit;
    BigsBands bands;
    BigsRandomLight random;
    BigsUpdate update;
    float correction1, correction2; // of Adam's start
};

/// Where a splat's numbers are.
struct BigsSplat {
    BlockColumn<float> value, momentum, second, kept;
    const uint8_t* visibility; // its map, or null
    int functions;             // of s, in use
};

/// Directions from a splat, and SH of them, which lie in memory that its thread shares with nobody.
template <int kLights, class Basis>
struct BigsDirections {
    float toEye[3], toLight[kLights][3], falloff[kLights];
    Basis yView, yLight[kLights];
};

/// kLights: those of the view, and the random one behind them if it is on. basis(l): where the SH towards light l go, those towards the eye last.
template <int kLights, class Basis, class BasisAt>
NACRE_HD inline BigsDirections<kLights, Basis> bigsDirections(const BigsStep& step, const float* position, BasisAt&& basis)
{
    BigsDirections<kLights, Basis> d;
    const auto fill = [](const float w[3], const Basis& to) {
        float y[kMaxShFunctions];
        shBasis(kMaxShFunctions, w[0], w[1], w[2], y);
        for (int k = 0; k < kMaxShFunctions; ++k) to[k] = y[k];
    };
    const LightSample<float> eye = samplePointLight(step.lit.eye, 0.0f, position);
    for (int k = 0; k < 3; ++k) d.toEye[k] = eye.dir[k];
    fill(d.toEye, d.yView = basis(kLights));
    NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
        const bool lit = l < step.lit.lightCount;
        const LightSample<float> s = lit ? sampleLight(step.lit.lights[l], position) : LightSample<float>{};
        for (int k = 0; k < 3; ++k) d.toLight[l][k] = lit ? s.dir[k] : step.random.direction[k];
        d.falloff[l] = lit ? s.falloff : 0.0f;
        fill(d.toLight[l], d.yLight[l] = basis(l));
    }
    return d;
}

/// The numbers that are not SH, as bigs.h takes them. `lobe` and `forward` are where they go.
NACRE_HD inline BigsCoefficients<float> bigsSharpCoefficients(const BigsSplat& splat, const BigsBands& bands, float lobe[kBigsLobeFloats], float forward[kBigsForwardFloats],
                                                               float* inverseLength)
{
    BigsCoefficients<float> g{};
    float length2 = 0;
    for (int k = 0; k < kBigsLobeFloats; ++k) lobe[k] = splat.value[kLobe + k];
    for (int k = 0; k < 3; ++k) length2 += lobe[k] * lobe[k];
    *inverseLength = 1 / std::sqrt(length2 > 1e-20f ? length2 : 1e-20f);
    for (int k = 0; k < 3; ++k) lobe[k] *= *inverseLength;
    lobe[3] = std::exp(lobe[3]);
    for (int k = 0; k < kBigsForwardFloats; ++k) forward[k] = splat.value[kForward + k];
    forward[0] = std::exp(forward[0]);
    g.lobe = bands.lobe ? lobe : nullptr;
    g.forward = bands.forward ? forward : nullptr;
    g.visibility.texels = splat.visibility;
    g.shadow = splat.value[kShadow];
    return g;
}

/// y_a(w_t) y_b(w_o) + y_b(w_t) y_a(w_o): what coefficient (a, b) of s is multiplied by.
template <class Basis>
NACRE_HD inline float bigsPairWeight(int a, int b, const Basis& yLight, const Basis& yView)
{
    return a == b ? yLight[a] * yView[a] : yLight[a] * yView[b] + yLight[b] * yView[a];
}

/// Twin of bigsTerms for all lights at once: each coefficient is read once.
template <int kLights, class Basis>
NACRE_HD inline void bigsTermsOf(const BigsSplat& splat, const BigsBands& bands, const BigsDirections<kLights, Basis>& dir, BigsTerms<float> t[kLights])
{
    NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
        t[l] = {};
        for (int c = 0; c < 3; ++c) t[l].scatter[c] = splat.value[kRho + c];
    }
    for (int k = 0; k < bands.direct; ++k) {
        const float x = splat.value[kTDir + k];
        NACRE_UNROLL for (int l = 0; l < kLights; ++l) t[l].direct += x * dir.yLight[l][k];
    }
    for (int k = 0; k < bands.indirect; ++k) {
        const float x[3] = {splat.value[kTInd + 3 * k], splat.value[kTInd + 3 * k + 1], splat.value[kTInd + 3 * k + 2]};
        NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
            const float y = dir.yLight[l][k];
            for (int c = 0; c < 3; ++c) t[l].indirect[c] += x[c] * y;
        }
    }
    for (int b = 0, at = kScatter; b < splat.functions; ++b)
        for (int a = 0; a <= b; ++a, at += 3) {
            const float x[3] = {splat.value[at], splat.value[at + 1], splat.value[at + 2]};
            NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
                const float w = bigsPairWeight(a, b, dir.yLight[l], dir.yView);
                for (int c = 0; c < 3; ++c) t[l].scatter[c] += x[c] * w;
            }
        }
}

/// The colours of a splat, three per light of the view, and the terms that the backward pass needs.
template <int kLights, class Basis>
NACRE_HD inline void bigsSplatForward(const BigsStep& step, const BigsSplat& splat, const BigsDirections<kLights, Basis>& dir, float* color)
{
    BigsTerms<float> t[kLights];
    bigsTermsOf(splat, step.bands, dir, t);
    float lobe[kBigsLobeFloats], forward[kBigsForwardFloats], inverseLength;
    const BigsCoefficients<float> g = bigsSharpCoefficients(splat, step.bands, lobe, forward, &inverseLength);
    NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
        splat.kept[kBigsKept * l] = t[l].direct;
        for (int c = 0; c < 3; ++c) splat.kept[kBigsKept * l + 1 + c] = t[l].scatter[c], splat.kept[kBigsKept * l + 4 + c] = t[l].indirect[c];
        if (l >= step.lit.lightCount) continue;
        const BigsSharpTerms<float> sharp = bigsSharpTerms(g, dir.toEye, dir.toLight[l]);
        for (int c = 0; c < 3; ++c) color[3 * l + c] = bigsTransport(t[l], sharp, c) * dir.falloff[l] * step.lit.lights[l].intensity[c];
    }
}

/// Adam of a group of coefficients that share a second moment (BigsGroup).
struct BigsGroupStep {
    float beta1, rate;

    NACRE_HD BigsGroupStep(const BigsStep& step, const BigsSplat& splat, int group, float meanSquare) : beta1(step.update.beta1)
    {
        const float v = step.update.beta2 * splat.second[group] + (1 - step.update.beta2) * meanSquare;
        splat.second[group] = v;
        rate = step.update.rate[group] / step.correction1 / (std::sqrt(v / step.correction2) + 1e-15f);
    }
    NACRE_HD void operator()(const BigsSplat& splat, int k, float gradient) const
    {
        const float m = beta1 * splat.momentum[k] + (1 - beta1) * gradient;
        splat.momentum[k] = m;
        splat.value[k] -= rate * m;
    }
};

/// gradient(k): of coefficient first + k.
template <class Gradient>
NACRE_HD inline void bigsStepGroup(const BigsStep& step, const BigsSplat& splat, int group, int first, int count, Gradient&& gradient)
{
    float square = 0;
    for (int k = 0; k < count; ++k) {
        const float d = gradient(k);
        square += d * d;
    }
    const BigsGroupStep adam(step, splat, group, square / float(count));
    for (int k = 0; k < count; ++k) adam(splat, first + k, gradient(k));
}

NACRE_HD inline void keepInUnit(float& x) { x = x > 0 ? (x < 1 ? x : 1.0f) : 0.0f; }

/// One Adam step from dColor, three per light of the view, after bigsSplatForward of the same. dLobe, dForward: gradients of sharpness (its logarithm) and
/// colour, for SharedAdam.
template <int kLights, class Basis>
NACRE_HD inline void bigsSplatBackward(const BigsStep& step, const BigsSplat& splat, const BigsDirections<kLights, Basis>& dir, const float* dColor, float dLobe[4],
                                       float dForward[4])
{
    const BigsUpdate& update = step.update;
    float lobe[kBigsLobeFloats], forward[kBigsForwardFloats], inverseLength;
    const BigsCoefficients<float> g = bigsSharpCoefficients(splat, step.bands, lobe, forward, &inverseLength);
    BigsTerms<float> d[kLights];
    BigsSharpGradient<float> sharp;
    NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
        BigsTerms<float> t;
        t.direct = splat.kept[kBigsKept * l];
        for (int c = 0; c < 3; ++c) t.scatter[c] = splat.kept[kBigsKept * l + 1 + c], t.indirect[c] = splat.kept[kBigsKept * l + 4 + c];
        d[l] = {};
        if (l < step.lit.lightCount) {
            float dTransport[3];
            for (int c = 0; c < 3; ++c) dTransport[c] = dColor[3 * l + c] * dir.falloff[l] * step.lit.lights[l].intensity[c];
            const float visible = g.visibility.texels ? 1 - g.shadow * (1 - mapVisibility(g.visibility, dir.toLight[l])) : 1.0f;
            bigsTransportBackward(t, visible, dTransport, true, d[l]);
            bigsSharpBackward(g, t, dir.toEye, dir.toLight[l], dTransport, sharp);
        }
        bigsPositiveBackward(t, update.positiveWeight, d[l]);
    }

    // Of the energy that s scatters (bigsEnergyBackward): slope[l][c] times y_i(w_t) to the pairs (0, i). Before s is stepped.
    constexpr float kSqrt4Pi = 3.5449077018110320f;
    const int functions = splat.functions;
    float slope[kLights][3];
    NACRE_UNROLL for (int l = 0; l < kLights; ++l)
        for (int c = 0; c < 3; ++c) slope[l][c] = 0;
    if (update.energyWeight > 0) {
        for (int i = 0; i < functions; ++i)
            for (int c = 0; c < 3; ++c) {
                const float x = splat.value[kScatter + 3 * bigsPair(0, i) + c];
                NACRE_UNROLL for (int l = 0; l < kLights; ++l) slope[l][c] += x * dir.yLight[l][i];
            }
        NACRE_UNROLL for (int l = 0; l < kLights; ++l)
            for (int c = 0; c < 3; ++c) {
                const float excess = kSqrt4Pi * slope[l][c] - 1;
                slope[l][c] = functions > 0 && excess > 0 ? 2 * kSqrt4Pi * update.energyWeight * excess : 0.0f;
            }
    }

    if (update.rate[kGroupDirect] > 0)
        bigsStepGroup(step, splat, kGroupDirect, kTDir, step.bands.direct, [&](int k) {
            float sum = 0;
            NACRE_UNROLL for (int l = 0; l < kLights; ++l) sum += d[l].direct * dir.yLight[l][k];
            return sum;
        });
    if (update.rate[kGroupIndirect] > 0 && step.bands.indirect > 0) {
        float square = 0;
        const auto gradient = [&](int k, float sum[3]) {
            sum[0] = sum[1] = sum[2] = 0;
            NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
                const float y = dir.yLight[l][k];
                for (int c = 0; c < 3; ++c) sum[c] += d[l].indirect[c] * y;
            }
        };
        float sum[3];
        for (int k = 0; k < step.bands.indirect; ++k) {
            gradient(k, sum);
            for (int c = 0; c < 3; ++c) square += sum[c] * sum[c];
        }
        const BigsGroupStep adam(step, splat, kGroupIndirect, square / float(3 * step.bands.indirect));
        for (int k = 0; k < step.bands.indirect; ++k) {
            gradient(k, sum);
            for (int c = 0; c < 3; ++c) adam(splat, kTInd + 3 * k + c, sum[c]);
        }
    }
    if (update.rate[kGroupRho] > 0) {
        float sum[3] = {0, 0, 0};
        NACRE_UNROLL for (int l = 0; l < kLights; ++l)
            for (int c = 0; c < 3; ++c) sum[c] += d[l].scatter[c];
        const BigsGroupStep adam(step, splat, kGroupRho, (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]) / 3);
        for (int c = 0; c < 3; ++c) {
            adam(splat, kRho + c, sum[c]);
            keepInUnit(splat.value[kRho + c]); // the albedo stays physical
        }
    }
    if (step.bands.lobe) {
        if (update.rate[kGroupNormal] > 0) {
            float square = 0;
            for (int k = 0; k < 3; ++k) sharp.normal[k] *= inverseLength, square += sharp.normal[k] * sharp.normal[k];
            const BigsGroupStep adam(step, splat, kGroupNormal, square / 3);
            for (int k = 0; k < 3; ++k) adam(splat, kLobe + k, sharp.normal[k]);
        }
        dLobe[0] = sharp.logSharpness;
        for (int c = 0; c < 3; ++c) dLobe[1 + c] = sharp.color[c];
    }
    if (step.bands.forward) {
        dForward[0] = sharp.forwardLogSharpness;
        for (int c = 0; c < 3; ++c) dForward[1 + c] = sharp.forwardColor[c];
    }
    if (splat.visibility && update.rate[kGroupShadow] > 0) {
        const BigsGroupStep adam(step, splat, kGroupShadow, sharp.shadow * sharp.shadow);
        adam(splat, kShadow, sharp.shadow);
        keepInUnit(splat.value[kShadow]);
    }

    // s, degree by degree. The mean square of a degree's gradient has a closed form from four running sums per channel, with h_a the gradient of the view
    // contraction: sum_{a<b} (h_a y_b + h_b y_a)^2 + sum_a (h_a y_a)^2 = |h|^2 |y|^2 + (h.y)^2 - sum_a (h_a y_a)^2
    float yy = 0, hh[3] = {0, 0, 0}, hy[3] = {0, 0, 0}, diagonal[3] = {0, 0, 0}, before = 0;
    for (int degree = 0; degree * degree < functions; ++degree) {
        const int b0 = degree * degree, b1 = (degree + 1) * (degree + 1);
        for (int b = b0; b < b1; ++b) {
            const float y = dir.yView[b];
            yy += y * y;
            for (int c = 0; c < 3; ++c) {
                float h = 0;
                NACRE_UNROLL for (int l = 0; l < kLights; ++l) h += d[l].scatter[c] * dir.yLight[l][b];
                hh[c] += h * h, hy[c] += h * y, diagonal[c] += h * y * h * y;
            }
        }
        float square = 0;
        for (int c = 0; c < 3; ++c) square += hh[c] * yy + hy[c] * hy[c] - diagonal[c];
        const int pairs = b1 * (b1 + 1) / 2 - b0 * (b0 + 1) / 2;
        const float meanSquare = (square > before ? square - before : 0.0f) / float(3 * pairs);
        before = square;
        if (!(update.rate[kGroupScatter0 + degree] > 0)) continue;
        const BigsGroupStep adam(step, splat, kGroupScatter0 + degree, meanSquare);
        for (int b = b0; b < b1; ++b)
            for (int a = 0; a <= b; ++a) {
                float sum[3] = {0, 0, 0};
                NACRE_UNROLL for (int l = 0; l < kLights; ++l) {
                    const float w = bigsPairWeight(a, b, dir.yLight[l], dir.yView), y = a == 0 ? dir.yLight[l][b] : 0.0f;
                    for (int c = 0; c < 3; ++c) sum[c] += d[l].scatter[c] * w + slope[l][c] * y;
                }
                for (int c = 0; c < 3; ++c) adam(splat, kScatter + 3 * bigsPair(a, b) + c, sum[c]);
            }
    }
}

} // namespace nacre
