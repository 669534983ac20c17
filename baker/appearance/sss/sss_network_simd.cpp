#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "appearance/sss/sss_network_simd.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "appearance/sss/sss_network_simd.h"
#include "render/simd_math-inl.h"

#include <algorithm>
#include <cstring>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
constexpr int kN = int(hn::MaxLanes(D()));

enum Start { kZero, kBias, kAdd }; // what a sum starts from

// out[row][j] = start + sum_k a[row][k] b[k][j], N columns. Tiles of four rows by two vectors or sixteen columns stay in registers.
template <int K, int N, Start S>
HWY_INLINE void product(const float* a, int aStride, const float* b, const float* bias, int rows, float* out)
{
    const D d;
    constexpr int kColumns = kN > 8 ? 2 * kN : 16, kVectors = kColumns / kN;
    static_assert(N % kColumns == 0);
    for (int row = 0; row < rows; row += 4)
        for (int j = 0; j < N; j += kColumns) {
            V sum[4][kVectors];
            for (int r = 0; r < 4; ++r)
                for (int v = 0; v < kVectors; ++v)
                    sum[r][v] = S == kZero ? hn::Zero(d)
                                           : hn::LoadU(d, S == kBias ? bias + j + v * kN : out + (row + r) * N + j + v * kN);
            for (int k = 0; k < K; ++k)
                for (int v = 0; v < kVectors; ++v) {
                    const V column = hn::LoadU(d, b + k * N + j + v * kN);
                    for (int r = 0; r < 4; ++r) sum[r][v] = hn::MulAdd(hn::Set(d, a[(row + r) * aStride + k]), column, sum[r][v]);
                }
            for (int r = 0; r < 4; ++r)
                for (int v = 0; v < kVectors; ++v) hn::Store(sum[r][v], d, out + (row + r) * N + j + v * kN);
        }
}

// out[row][j] = bias[j] + sum_k a[row][k] w[j][k]: few outputs, vectors along the inputs.
template <int K, int N> HWY_INLINE void narrowProduct(const float* a, const float* w, const float* bias, int rows, float* out)
{
    const D d;
    for (int row = 0; row < rows; ++row)
        for (int j = 0; j < N; ++j) {
            V sum = hn::Zero(d);
            for (int k = 0; k < K; k += kN) sum = hn::MulAdd(hn::Load(d, a + row * K + k), hn::LoadU(d, w + j * K + k), sum);
            out[row * N + j] = bias[j] + hn::GetLane(hn::SumOfLanes(d, sum));
        }
}

// What follows for `Outputs` rows of weights and `Vectors` vectors of inputs, whose sums stay in registers. `in` and dWeight
// point at the first.
template <int Outputs, int Vectors>
HWY_INLINE void outerTile(const float* dOut, int outStride, const float* in, int inStride, int rows, int inputs, float* dWeight,
                          int weightStride)
{
    const D d;
    V sum[Outputs][Vectors];
    for (int t = 0; t < Outputs; ++t)
        for (int v = 0; v < Vectors; ++v) sum[t][v] = hn::Zero(d);
    for (int row = 0; row < rows; ++row)
        for (int v = 0; v < Vectors; ++v) {
            const V x = hn::LoadU(d, in + row * inStride + v * kN); // may read beyond a row: what is not an input is not kept
            for (int t = 0; t < Outputs; ++t) sum[t][v] = hn::MulAdd(hn::Set(d, dOut[row * outStride + t]), x, sum[t][v]);
        }
    for (int t = 0; t < Outputs; ++t)
        for (int v = 0; v < Vectors; ++v) {
            float* to = dWeight + t * weightStride + v * kN;
            const int rest = inputs - v * kN;
            if (rest >= kN) {
                hn::StoreU(hn::Add(hn::LoadU(d, to), sum[t][v]), d, to);
            } else {
                alignas(64) float last[kN];
                hn::Store(sum[t][v], d, last);
                for (int i = 0; i < rest; ++i) to[i] += last[i];
            }
        }
}

// dWeight[j][i] += sum over rows of dOut[row][j] in[row][i]
template <int In, int Out>
HWY_INLINE void outerProduct(const float* dOut, const float* in, int inStride, int rows, float* dWeight)
{
    constexpr int kVectors = (In + kN - 1) / kN, kWhole = kVectors / 4 * 4, kRest = kVectors - kWhole;
    constexpr int kSums = kN > 8 ? 16 : 8, kMost = kSums / (kWhole > 0 ? 4 : kVectors); // that registers hold
    constexpr int kOutputs = Out % 8 == 0 && kMost >= 8 ? 8 : Out % 4 == 0 && kMost >= 4 ? 4 : Out % 2 == 0 ? 2 : 1;
    for (int j = 0; j < Out; j += kOutputs) {
        float* to = dWeight + j * In;
        for (int v = 0; v < kWhole; v += 4)
            outerTile<kOutputs, 4>(dOut + j, Out, in + v * kN, inStride, rows, In - v * kN, to + v * kN, In);
        if constexpr (kRest > 0)
            outerTile<kOutputs, kRest>(dOut + j, Out, in + kWhole * kN, inStride, rows, In - kWhole * kN, to + kWhole * kN, In);
    }
}

// dBias[j] += sum over rows of dOut[row][j]
template <int Out> HWY_INLINE void sumRows(const float* dOut, int rows, float* dBias)
{
    for (int row = 0; row < rows; ++row)
        for (int j = 0; j < Out; ++j) dBias[j] += dOut[row * Out + j];
}

HWY_INLINE void leaky(float* x, int floats)
{
    const D d;
    for (int k = 0; k < floats; k += kN) {
        const V v = hn::Load(d, x + k);
        hn::Store(hn::Max(v, hn::Mul(v, hn::Set(d, kSssLeak))), d, x + k);
    }
}

HWY_INLINE void leakyBackward(const float* h, float* dx, int floats)
{
    const D d;
    for (int k = 0; k < floats; k += kN) {
        const V g = hn::Load(d, dx + k);
        hn::Store(hn::IfThenElse(hn::Gt(hn::Load(d, h + k), hn::Zero(d)), g, hn::Mul(g, hn::Set(d, kSssLeak))), d, dx + k);
    }
}

// scale / (1 + exp(-x)); the exponent is held where a float ends
HWY_INLINE void logistic(float* x, int floats, float scale)
{
    const D d;
    for (int k = 0; k < floats; k += kN) {
        const V limited = hn::Min(hn::Max(hn::Load(d, x + k), hn::Set(d, -80.0f)), hn::Set(d, 80.0f));
        const V e = exp2(d, hn::Mul(limited, hn::Set(d, -1.44269504f)));
        hn::Store(hn::Div(hn::Set(d, scale), hn::Add(hn::Set(d, 1.0f), e)), d, x + k);
    }
}

void batchForward(const SssWeights& w, int lights, SssBatch& b)
{
    const float *m = w.transposed.data(), *value = w.value.data();
    const int rows = lights * kSssLanes;
    product<kSssFixedInputs, kSssHidden1, kBias>(b.fixed[0], kSssFixedStride, m + kSssFirstFixed, value + kSssFirstBias,
                                                 kSssLanes, b.first[0]);
    product<kSssCodeInputs, kSssHidden1, kAdd>(b.code[0], kSssCodeInputs, m + kSssCode, nullptr, kSssLanes, b.first[0]);
    for (int l = 0; l < lights; ++l) std::memcpy(b.h1[l * kSssLanes], b.first, sizeof b.first);
    product<kSssLightInputs, kSssHidden1, kAdd>(b.light[0], kSssLightInputs, m + kSssFirstLight, nullptr, rows, b.h1[0]);
    leaky(b.h1[0], rows * kSssHidden1);
    product<kSssHidden1, kSssHidden2, kBias>(b.h1[0], kSssHidden1, m + kSssSecond, value + kSssSecondBias, rows, b.h2[0]);
    leaky(b.h2[0], rows * kSssHidden2);
    product<kSssHidden2, kSssHidden3, kBias>(b.h2[0], kSssHidden2, m + kSssThird, value + kSssThirdBias, rows, b.h3[0]);
    leaky(b.h3[0], rows * kSssHidden3);
    narrowProduct<kSssHidden3, 3>(b.h3[0], value + kSssResidual, value + kSssResidualBias, rows, b.residual[0]);
    logistic(b.residual[0], rows * 3, 1.0f);
    if (!w.share) {
        std::fill_n(b.share, rows, 1.0f);
        return;
    }
    product<kSssHidden3, kSssHiddenShare, kBias>(b.h3[0], kSssHidden3, m + kSssShare, value + kSssShareBias, rows, b.hs[0]);
    leaky(b.hs[0], rows * kSssHiddenShare);
    narrowProduct<kSssHiddenShare, 1>(b.hs[0], value + kSssShareOut, value + kSssShareOutBias, rows, b.share);
    logistic(b.share, rows, 2.0f);
}

// dShare -> d3, the gradient of the third layer's outputs.
void shareBackward(const SssWeights& w, int rows, const SssBatch& b, float* d3, float* dW)
{
    const D d;
    const float* m = w.value.data();
    alignas(64) float dOut[kSssRows], ds[kSssRows * kSssHiddenShare];
    for (int k = 0; k < rows; k += kN) {
        const V s = hn::Load(d, b.share + k);
        hn::Store(hn::Mul(hn::Mul(hn::Load(d, b.dShare + k), s), hn::NegMulAdd(hn::Set(d, 0.5f), s, hn::Set(d, 1.0f))), d,
                  dOut + k);
    }
    outerProduct<kSssHiddenShare, 1>(dOut, b.hs[0], kSssHiddenShare, rows, dW + kSssShareOut),
        sumRows<1>(dOut, rows, dW + kSssShareOutBias);
    product<1, kSssHiddenShare, kZero>(dOut, 1, m + kSssShareOut, nullptr, rows, ds);
    leakyBackward(b.hs[0], ds, rows * kSssHiddenShare);
    outerProduct<kSssHidden3, kSssHiddenShare>(ds, b.h3[0], kSssHidden3, rows, dW + kSssShare),
        sumRows<kSssHiddenShare>(ds, rows, dW + kSssShareBias);
    product<kSssHiddenShare, kSssHidden3, kZero>(ds, kSssHiddenShare, m + kSssShare, nullptr, rows, d3);
}

void batchBackward(const SssWeights& w, int lights, SssBatch& b, float* dW)
{
    const D d;
    const float* m = w.value.data(); // [out][in] is what the gradient of the inputs needs
    const int rows = lights * kSssLanes;
    alignas(64) float d1[kSssRows * kSssHidden1], d2[kSssRows * kSssHidden2], d3[kSssRows * kSssHidden3];
    alignas(64) float dr[kSssRows * 3], dFirst[kSssLanes * kSssHidden1];
    for (int k = 0; k < 3 * rows; k += kN) {
        const V r = hn::Load(d, b.residual[0] + k);
        hn::Store(hn::Mul(hn::Mul(hn::Load(d, b.dResidual[0] + k), r), hn::Sub(hn::Set(d, 1.0f), r)), d, dr + k);
    }
    if (w.share) shareBackward(w, rows, b, d3, dW);
    else std::fill_n(d3, rows * kSssHidden3, 0.0f);
    outerProduct<kSssHidden3, 3>(dr, b.h3[0], kSssHidden3, rows, dW + kSssResidual), sumRows<3>(dr, rows, dW + kSssResidualBias);
    product<3, kSssHidden3, kAdd>(dr, 3, m + kSssResidual, nullptr, rows, d3);
    leakyBackward(b.h3[0], d3, rows * kSssHidden3);
    outerProduct<kSssHidden2, kSssHidden3>(d3, b.h2[0], kSssHidden2, rows, dW + kSssThird),
        sumRows<kSssHidden3>(d3, rows, dW + kSssThirdBias);
    product<kSssHidden3, kSssHidden2, kZero>(d3, kSssHidden3, m + kSssThird, nullptr, rows, d2);
    leakyBackward(b.h2[0], d2, rows * kSssHidden2);
    outerProduct<kSssHidden1, kSssHidden2>(d2, b.h1[0], kSssHidden1, rows, dW + kSssSecond),
        sumRows<kSssHidden2>(d2, rows, dW + kSssSecondBias);
    product<kSssHidden2, kSssHidden1, kZero>(d2, kSssHidden2, m + kSssSecond, nullptr, rows, d1);
    leakyBackward(b.h1[0], d1, rows * kSssHidden1);
    outerProduct<kSssLightInputs, kSssHidden1>(d1, b.light[0], kSssLightInputs, rows, dW + kSssFirstLight);
    std::memcpy(dFirst, d1, sizeof dFirst);
    for (int l = 1; l < lights; ++l)
        for (int k = 0; k < kSssLanes * kSssHidden1; k += kN)
            hn::Store(hn::Add(hn::Load(d, dFirst + k), hn::Load(d, d1 + l * kSssLanes * kSssHidden1 + k)), d, dFirst + k);
    outerProduct<kSssFixedInputs, kSssHidden1>(dFirst, b.fixed[0], kSssFixedStride, kSssLanes, dW + kSssFirstFixed);
    sumRows<kSssHidden1>(dFirst, kSssLanes, dW + kSssFirstBias);
    outerProduct<kSssCodeInputs, kSssHidden1>(dFirst, b.code[0], kSssCodeInputs, kSssLanes, dW + kSssCode);
    const float none[kSssCodeInputs] = {};
    narrowProduct<kSssHidden1, kSssCodeInputs>(dFirst, w.transposed.data() + kSssCode, none, kSssLanes, b.dCode[0]);
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nacre {

HWY_EXPORT(batchForward);
HWY_EXPORT(batchBackward);

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
    matrix(kSssShare, kSssHiddenShare, kSssHidden3);
    matrix(kSssCode, kSssHidden1, kSssCodeInputs);
}

void sssBatchForward(const SssWeights& weights, int lights, SssBatch& batch)
{
    HWY_DYNAMIC_DISPATCH(batchForward)(weights, lights, batch);
}
void sssBatchBackward(const SssWeights& weights, int lights, SssBatch& batch, float* dWeights)
{
    HWY_DYNAMIC_DISPATCH(batchBackward)(weights, lights, batch, dWeights);
}

} // namespace nacre
#endif
