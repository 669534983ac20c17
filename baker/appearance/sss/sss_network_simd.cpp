#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "appearance/sss/sss_network_simd.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "appearance/sss/sss_network_simd.h"
#include "render/simd_math-inl.h"

#include <cstring>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, kSssLanes>;
using V = hn::Vec<D>;
constexpr int kN = int(hn::MaxLanes(D()));
constexpr int kVectors = kSssLanes / kN;

// out[j] (+)= bias[j] + sum_i matrix[i][j] in[i], for all lanes. Four outputs at a time stay in registers.
template <int In, int Out, bool Add>
HWY_INLINE void product(const float* matrix, const float* bias, const float* in, float* out)
{
    const D d;
    constexpr int kTile = Out % 4 == 0 ? 4 : Out;
    static_assert(kTile <= 4);
    for (int j = 0; j < Out; j += kTile) {
        V sum[kTile][kVectors];
        for (int t = 0; t < kTile; ++t)
            for (int v = 0; v < kVectors; ++v)
                sum[t][v] = Add ? hn::Load(d, out + (j + t) * kSssLanes + v * kN) : hn::Set(d, bias ? bias[j + t] : 0.0f);
        for (int i = 0; i < In; ++i)
            for (int v = 0; v < kVectors; ++v) {
                const V x = hn::Load(d, in + i * kSssLanes + v * kN);
                for (int t = 0; t < kTile; ++t) sum[t][v] = hn::MulAdd(hn::Set(d, matrix[i * Out + j + t]), x, sum[t][v]);
            }
        for (int t = 0; t < kTile; ++t)
            for (int v = 0; v < kVectors; ++v) hn::Store(sum[t][v], d, out + (j + t) * kSssLanes + v * kN);
    }
}

// dWeight[j][i] += sum over lanes of dOut[j] in[i]; dBias likewise, unless null.
template <int In, int Out>
HWY_INLINE void outerProduct(const float* dOut, const float* in, float* dWeight, float* dBias)
{
    const D d;
    constexpr int kRow = (In + kN - 1) / kN; // vectors per row of features
    alignas(64) float turned[kSssLanes][kRow * kN]; // by lane
    if (In % kN) std::memset(turned, 0, sizeof turned);
    for (int i = 0; i < In; ++i)
        for (int lane = 0; lane < kSssLanes; ++lane) turned[lane][i] = in[i * kSssLanes + lane];
    for (int j = 0; j < Out; ++j) {
        const float* g = dOut + j * kSssLanes;
        V sum[kRow];
        for (int k = 0; k < kRow; ++k) sum[k] = hn::Zero(d);
        float total = 0;
        for (int lane = 0; lane < kSssLanes; ++lane) {
            const V x = hn::Set(d, g[lane]);
            total += g[lane];
            for (int k = 0; k < kRow; ++k) sum[k] = hn::MulAdd(x, hn::Load(d, turned[lane] + k * kN), sum[k]);
        }
        float* row = dWeight + j * In;
        for (int k = 0; k < kRow; ++k) {
            if ((k + 1) * kN <= In) {
                hn::StoreU(hn::Add(hn::LoadU(d, row + k * kN), sum[k]), d, row + k * kN);
            } else {
                alignas(64) float rest[kN];
                hn::Store(sum[k], d, rest);
                for (int i = 0; i < In % kN; ++i) row[k * kN + i] += rest[i];
            }
        }
        if (dBias) dBias[j] += total;
    }
}

HWY_INLINE void leaky(float* x, int rows)
{
    const D d;
    for (int k = 0; k < rows * kSssLanes; k += kN) {
        const V v = hn::Load(d, x + k);
        hn::Store(hn::Max(v, hn::Mul(v, hn::Set(d, kSssLeak))), d, x + k);
    }
}

HWY_INLINE void leakyBackward(const float* h, float* dx, int rows)
{
    const D d;
    for (int k = 0; k < rows * kSssLanes; k += kN) {
        const V g = hn::Load(d, dx + k);
        hn::Store(hn::IfThenElse(hn::Gt(hn::Load(d, h + k), hn::Zero(d)), g, hn::Mul(g, hn::Set(d, kSssLeak))), d, dx + k);
    }
}

// scale / (1 + exp(-x)); the exponent is held where a float ends
HWY_INLINE void logistic(float* x, int rows, float scale)
{
    const D d;
    for (int k = 0; k < rows * kSssLanes; k += kN) {
        const V limited = hn::Min(hn::Max(hn::Load(d, x + k), hn::Set(d, -80.0f)), hn::Set(d, 80.0f));
        const V e = exp2(d, hn::Mul(limited, hn::Set(d, -1.44269504f)));
        hn::Store(hn::Div(hn::Set(d, scale), hn::Add(hn::Set(d, 1.0f), e)), d, x + k);
    }
}

void batchFixed(const SssWeights& w, SssBatch& b)
{
    product<kSssFixedInputs, kSssHidden1, false>(&w.transposed[kSssFirstFixed], &w.value[kSssFirstBias], b.fixed[0], b.first[0]);
}

void batchLight(const SssWeights& w, SssBatch& b)
{
    const float *m = w.transposed.data(), *bias = w.value.data();
    std::memcpy(b.h1, b.first, sizeof b.h1);
    product<kSssLightInputs, kSssHidden1, true>(m + kSssFirstLight, nullptr, b.light[0], b.h1[0]);
    leaky(b.h1[0], kSssHidden1);
    product<kSssHidden1, kSssHidden2, false>(m + kSssSecond, bias + kSssSecondBias, b.h1[0], b.h2[0]);
    leaky(b.h2[0], kSssHidden2);
    product<kSssHidden2, kSssHidden3, false>(m + kSssThird, bias + kSssThirdBias, b.h2[0], b.h3[0]);
    leaky(b.h3[0], kSssHidden3);
    product<kSssHidden3, 3, false>(m + kSssResidual, bias + kSssResidualBias, b.h3[0], b.residual[0]);
    logistic(b.residual[0], 3, 1.0f);
    product<kSssHidden3, kSssHiddenShare, false>(m + kSssShare, bias + kSssShareBias, b.h3[0], b.hs[0]);
    leaky(b.hs[0], kSssHiddenShare);
    product<kSssHiddenShare, 1, false>(m + kSssShareOut, bias + kSssShareOutBias, b.hs[0], b.share);
    logistic(b.share, 1, 2.0f);
}

void batchLightBackward(const SssWeights& w, SssBatch& b, float* dW)
{
    const D d;
    const float* m = w.value.data(); // [out][in] is the transpose of what the gradient of the inputs needs
    alignas(64) float d1[kSssHidden1 * kSssLanes], d2[kSssHidden2 * kSssLanes], d3[kSssHidden3 * kSssLanes], ds[kSssHiddenShare * kSssLanes];
    alignas(64) float dr[3 * kSssLanes], dOut[kSssLanes];
    for (int k = 0; k < kSssLanes; k += kN) {
        const V s = hn::Load(d, b.share + k);
        hn::Store(hn::Mul(hn::Mul(hn::Load(d, b.dShare + k), s), hn::NegMulAdd(hn::Set(d, 0.5f), s, hn::Set(d, 1.0f))), d, dOut + k);
    }
    for (int k = 0; k < 3 * kSssLanes; k += kN) {
        const V r = hn::Load(d, b.residual[0] + k);
        hn::Store(hn::Mul(hn::Mul(hn::Load(d, b.dResidual[0] + k), r), hn::Sub(hn::Set(d, 1.0f), r)), d, dr + k);
    }
    outerProduct<kSssHiddenShare, 1>(dOut, b.hs[0], dW + kSssShareOut, dW + kSssShareOutBias);
    product<1, kSssHiddenShare, false>(m + kSssShareOut, nullptr, dOut, ds);
    leakyBackward(b.hs[0], ds, kSssHiddenShare);
    outerProduct<kSssHidden3, kSssHiddenShare>(ds, b.h3[0], dW + kSssShare, dW + kSssShareBias);
    product<kSssHiddenShare, kSssHidden3, false>(m + kSssShare, nullptr, ds, d3);
    outerProduct<kSssHidden3, 3>(dr, b.h3[0], dW + kSssResidual, dW + kSssResidualBias);
    product<3, kSssHidden3, true>(m + kSssResidual, nullptr, dr, d3);
    leakyBackward(b.h3[0], d3, kSssHidden3);
    outerProduct<kSssHidden2, kSssHidden3>(d3, b.h2[0], dW + kSssThird, dW + kSssThirdBias);
    product<kSssHidden3, kSssHidden2, false>(m + kSssThird, nullptr, d3, d2);
    leakyBackward(b.h2[0], d2, kSssHidden2);
    outerProduct<kSssHidden1, kSssHidden2>(d2, b.h1[0], dW + kSssSecond, dW + kSssSecondBias);
    product<kSssHidden2, kSssHidden1, false>(m + kSssSecond, nullptr, d2, d1);
    leakyBackward(b.h1[0], d1, kSssHidden1);
    outerProduct<kSssLightInputs, kSssHidden1>(d1, b.light[0], dW + kSssFirstLight, nullptr);
    for (int k = 0; k < kSssHidden1 * kSssLanes; k += kN) hn::Store(hn::Add(hn::Load(d, b.dFirst[0] + k), hn::Load(d, d1 + k)), d, b.dFirst[0] + k);
}

void batchFixedBackward(const SssBatch& b, float* dW)
{
    outerProduct<kSssFixedInputs, kSssHidden1>(b.dFirst[0], b.fixed[0], dW + kSssFirstFixed, dW + kSssFirstBias);
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nacre {

HWY_EXPORT(batchFixed);
HWY_EXPORT(batchLight);
HWY_EXPORT(batchLightBackward);
HWY_EXPORT(batchFixedBackward);

void SssWeights::transpose()
{
    const auto matrix = [&](int at, int outputs, int inputs) {
        for (int j = 0; j < outputs; ++j)
            for (int i = 0; i < inputs; ++i) transposed[size_t(at + i * outputs + j)] = value[size_t(at + j * inputs + i)];
    };
    matrix(kSssFirstFixed, kSssHidden1, kSssFixedInputs);
    matrix(kSssFirstLight, kSssHidden1, kSssLightInputs);
    matrix(kSssSecond, kSssHidden2, kSssHidden1);
    matrix(kSssThird, kSssHidden3, kSssHidden2);
    matrix(kSssResidual, 3, kSssHidden3);
    matrix(kSssShare, kSssHiddenShare, kSssHidden3);
    matrix(kSssShareOut, 1, kSssHiddenShare);
}

void sssBatchFixed(const SssWeights& weights, SssBatch& batch) { HWY_DYNAMIC_DISPATCH(batchFixed)(weights, batch); }
void sssBatchLight(const SssWeights& weights, SssBatch& batch) { HWY_DYNAMIC_DISPATCH(batchLight)(weights, batch); }
void sssBatchLightBackward(const SssWeights& weights, SssBatch& batch, float* dWeights) { HWY_DYNAMIC_DISPATCH(batchLightBackward)(weights, batch, dWeights); }
void sssBatchFixedBackward(const SssBatch& batch, float* dWeights) { HWY_DYNAMIC_DISPATCH(batchFixedBackward)(batch, dWeights); }

} // namespace nacre
#endif
