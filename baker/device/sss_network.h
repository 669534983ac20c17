// The sss network on a device (formats/appearance/sss/sss_network.h), for a block of threads: 16 or 32 splats under their lights at a time. Twin of
// appearance/sss/sss_network_simd.h.
//
// A row per splat and light (light * splats + splat), features side by side, all of it in shared memory with the weights. Each layer is a product of
// matrices; a thread has tiles of four rows by four columns in registers, for which it reads 8 vectors of four numbers per 64 multiplications. Strides
// are odd multiples of four, so that the eight threads which are served at a time find their vectors in different banks. The gradient of the weights
// stays in registers from batch to batch, 63 numbers a thread. With 166 to 211 registers (sm_80 to sm_120) and 90 kB a block, two blocks of the step run on
// a multiprocessor of 228 kB, one on one of 100 kB.
#pragma once

#include "appearance/sss/sss_network.h"
#include "appearance/trainable.h"
#include "device/device.h"

namespace nacre::NACRE_BACKEND {

constexpr uint32_t kSssThreads = 128;
constexpr int kSssBatchSplats(int lights) { return lights <= 2 ? 32 : 16; }

/// Where vectors lie: read and written as one.
template <int N>
struct alignas(4 * N) SssVector {
    float v[N];
};
template <int N = 4>
NACRE_DEVICE inline SssVector<N> sssRead(const float* p) { return *reinterpret_cast<const SssVector<N>*>(p); }
NACRE_DEVICE inline void sssWrite(float* p, const SssVector<4>& x) { *reinterpret_cast<SssVector<4>*>(p) = x; }

constexpr int kSssFixedPadded = (kSssFixedInputs + 3) / 4 * 4; // the rest is zero
constexpr int kSssFixedRow = kSssFixedPadded, kSssCodeRow = kSssCodeInputs + 4, kSssLightRow = kSssLightInputs + 4, kSssRow1 = kSssHidden1 + 4,
              kSssRow2 = kSssHidden2 + 4, kSssRow3 = kSssHidden3 + 4, kSssRowShare = kSssHiddenShare + 4;
constexpr bool sssFreeOfConflicts(int stride) { return stride % 8 == 4; }
static_assert(sssFreeOfConflicts(kSssFixedRow) && sssFreeOfConflicts(kSssCodeRow) && sssFreeOfConflicts(kSssLightRow) && sssFreeOfConflicts(kSssRow1) &&
              sssFreeOfConflicts(kSssRow2) && sssFreeOfConflicts(kSssRow3) && sssFreeOfConflicts(kSssRowShare));
static_assert(kSssHidden2 == 32 && kSssHidden3 == 32 && kSssHiddenShare == 32 && kSssHidden1 == 64, "what threads do what below");

/// The weights, each row of a matrix padded.
struct alignas(16) SssSharedWeights {
    float fixed[kSssHidden1 * kSssFixedRow], light[kSssHidden1 * kSssLightRow], code[kSssHidden1 * kSssCodeRow];
    float second[kSssHidden2 * kSssRow1], third[kSssHidden3 * kSssRow2], share[kSssHiddenShare * kSssRow3];
    float residual[3 * kSssHidden3], shareOut[kSssHiddenShare];
    float firstBias[kSssHidden1], secondBias[kSssHidden2], thirdBias[kSssHidden3], shareBias[kSssHiddenShare], residualBias[3], shareOutBias;

    template <class T>
    NACRE_DEVICE void load(const T& t, const float* w)
    {
        matrix(t, w + kSssFirstFixed, kSssHidden1, kSssFixedInputs, kSssFixedRow, fixed);
        matrix(t, w + kSssFirstLight, kSssHidden1, kSssLightInputs, kSssLightRow, light);
        matrix(t, w + kSssCode, kSssHidden1, kSssCodeInputs, kSssCodeRow, code);
        matrix(t, w + kSssSecond, kSssHidden2, kSssHidden1, kSssRow1, second);
        matrix(t, w + kSssThird, kSssHidden3, kSssHidden2, kSssRow2, third);
        matrix(t, w + kSssShare, kSssHiddenShare, kSssHidden3, kSssRow3, share);
        matrix(t, w + kSssResidual, 3, kSssHidden3, kSssHidden3, residual);
        matrix(t, w + kSssShareOut, 1, kSssHiddenShare, kSssHiddenShare, shareOut);
        matrix(t, w + kSssFirstBias, 1, kSssHidden1, kSssHidden1, firstBias);
        matrix(t, w + kSssSecondBias, 1, kSssHidden2, kSssHidden2, secondBias);
        matrix(t, w + kSssThirdBias, 1, kSssHidden3, kSssHidden3, thirdBias);
        matrix(t, w + kSssShareBias, 1, kSssHiddenShare, kSssHiddenShare, shareBias);
        matrix(t, w + kSssResidualBias, 1, 3, 3, residualBias);
        matrix(t, w + kSssShareOutBias, 1, 1, 1, &shareOutBias);
    }

private:
    template <class T>
    NACRE_DEVICE static void matrix(const T& t, const float* w, int outputs, int inputs, int stride, float* to)
    {
        for (int k = int(t.thread()); k < outputs * stride; k += kSssThreads) {
            const int j = k / stride, i = k % stride;
            to[k] = i < inputs ? w[j * inputs + i] : 0.0f;
        }
    }
};

/// A batch between forward and backward. Gradients take the place of what they are gradients of.
template <int kLights>
struct alignas(16) SssSharedBatch {
    static constexpr int kSplats = kSssBatchSplats(kLights), kRows = kSplats * kLights;
    float fixed[kSplats * kSssFixedRow], code[kSplats * kSssCodeRow], light[kRows * kSssLightRow]; // inputs
    float h1[kRows * kSssRow1], h2[kRows * kSssRow2], h3[kRows * kSssRow3], hs[kRows * kSssRowShare];
    float residual[kRows * 3], share[kRows];

    /// The first layer before a light is known, and its gradient: [kSplats][kSssRow1], in h2 and h3, before and after they are in use.
    NACRE_DEVICE float* first() { return h2; }
    static_assert(kSplats * kSssRow1 <= kRows * (kSssRow2 + kSssRow3));
};

// For each tile of a thread: start(row, column) is where the sum of four columns begins; finish(row, column, sum) takes it. Rows of a tile lie
// kRows / 4 apart.
template <int kRows, int kColumns, class Work>
NACRE_DEVICE inline void sssTiles(uint32_t thread, Work work)
{
    constexpr int kGroups = kRows / 4, kTiles = kGroups * (kColumns / 4);
    for (int tile = int(thread); tile < kTiles; tile += int(kSssThreads)) work(tile % kGroups, kGroups, tile / kGroups * 4);
}

/// out[row][j] = start(row, j) + sum_i a[row][i] w[j][i], then finish(row, j, four of them).
template <int kRows, int kIn, int kOut, class Start, class Finish>
NACRE_DEVICE inline void sssForward(uint32_t thread, const float* a, int aStride, const float* w, int wStride, Start start, Finish finish)
{
    sssTiles<kRows, kOut>(thread, [&](int row, int step, int column) {
        SssVector<4> sum[4];
        for (int r = 0; r < 4; ++r) sum[r] = start(row + r * step, column);
        for (int i = 0; i < kIn; i += 4) {
            SssVector<4> x[4];
            for (int r = 0; r < 4; ++r) x[r] = sssRead(a + (row + r * step) * aStride + i);
            for (int j = 0; j < 4; ++j) {
                const SssVector<4> y = sssRead(w + (column + j) * wStride + i);
                for (int r = 0; r < 4; ++r)
                    for (int q = 0; q < 4; ++q) sum[r].v[j] += x[r].v[q] * y.v[q];
            }
        }
        for (int r = 0; r < 4; ++r) finish(row + r * step, column, sum[r]);
    });
}

/// dIn[row][i] = start(row, i) + sum_j dOut[row][j] w[j][i], then finish(row, i, four of them).
template <int kRows, int kOut, int kIn, class Start, class Finish>
NACRE_DEVICE inline void sssInputGradient(uint32_t thread, const float* dOut, int outStride, const float* w, int wStride, Start start, Finish finish)
{
    sssTiles<kRows, kIn>(thread, [&](int row, int step, int column) {
        SssVector<4> sum[4];
        for (int r = 0; r < 4; ++r) sum[r] = start(row + r * step, column);
        for (int j = 0; j < kOut; j += 4) {
            SssVector<4> x[4];
            for (int r = 0; r < 4; ++r) x[r] = sssRead(dOut + (row + r * step) * outStride + j);
            for (int q = 0; q < 4; ++q) {
                const SssVector<4> y = sssRead(w + (j + q) * wStride + column);
                for (int r = 0; r < 4; ++r)
                    for (int i = 0; i < 4; ++i) sum[r].v[i] += x[r].v[q] * y.v[i];
            }
        }
        for (int r = 0; r < 4; ++r) finish(row + r * step, column, sum[r]);
    });
}

/// Of a matrix [kOut][kIn]: a thread's kJ rows by four columns of it.
template <int kIn, int kOut, int kJ>
struct SssWeightGradient {
    static constexpr int kGroups = (kIn + 3) / 4;
    static_assert(kGroups * kOut / kJ <= int(kSssThreads) && kOut % kJ == 0);
    float sum[kJ][4];

    NACRE_DEVICE void clear()
    {
        for (auto& row : sum)
            for (float& x : row) x = 0;
    }
    template <int kRows>
    NACRE_DEVICE void add(uint32_t thread, const float* dOut, int outStride, const float* in, int inStride)
    {
        const int i = int(thread) % kGroups * 4, j = int(thread) / kGroups * kJ;
        if (j >= kOut) return;
        for (int row = 0; row < kRows; ++row) {
            const SssVector<kJ> d = sssRead<kJ>(dOut + row * outStride + j);
            const SssVector<4> x = sssRead(in + row * inStride + i);
            for (int a = 0; a < kJ; ++a)
                for (int b = 0; b < 4; ++b) sum[a][b] += d.v[a] * x.v[b];
        }
    }
    NACRE_DEVICE void store(uint32_t thread, float* dWeight) const
    {
        const int i = int(thread) % kGroups * 4, j = int(thread) / kGroups * kJ;
        if (j >= kOut) return;
        for (int a = 0; a < kJ; ++a)
            for (int b = 0; b < 4; ++b)
                if (i + b < kIn) dWeight[(j + a) * kIn + i + b] = sum[a][b];
    }
};

template <int kRows>
NACRE_DEVICE inline float sssColumnSum(const float* x, int stride)
{
    float sum = 0;
    for (int row = 0; row < kRows; ++row) sum += x[row * stride];
    return sum;
}

/// Inputs -> hidden layers, residual and share. Begins with a barrier; the share of a row is in its place for the thread of that number.
template <int kLights, class T>
NACRE_DEVICE inline void sssNetworkForward(const T& t, const SssSharedWeights& w, bool share, SssSharedBatch<kLights>& b)
{
    using Batch = SssSharedBatch<kLights>;
    constexpr int kRows = Batch::kRows, kSplats = Batch::kSplats;
    const uint32_t thread = t.thread();
    const auto rectified = [](SssVector<4> x) {
        for (float& v : x.v) v = sssLeaky(v);
        return x;
    };
    t.sync();
    sssForward<kSplats, kSssFixedPadded, kSssHidden1>(thread, b.fixed, kSssFixedRow, w.fixed, kSssFixedRow, [&](int, int j) { return sssRead(w.firstBias + j); },
        [&](int row, int j, const SssVector<4>& sum) { sssWrite(b.first() + row * kSssRow1 + j, sum); });
    // The same threads have the same tiles: no barrier.
    sssForward<kSplats, kSssCodeInputs, kSssHidden1>(thread, b.code, kSssCodeRow, w.code, kSssCodeRow,
        [&](int row, int j) { return sssRead(b.first() + row * kSssRow1 + j); },
        [&](int row, int j, const SssVector<4>& sum) { sssWrite(b.first() + row * kSssRow1 + j, sum); });
    t.sync();
    sssForward<kRows, kSssLightInputs, kSssHidden1>(thread, b.light, kSssLightRow, w.light, kSssLightRow,
        [&](int row, int j) { return sssRead(b.first() + row % kSplats * kSssRow1 + j); },
        [&](int row, int j, const SssVector<4>& sum) { sssWrite(b.h1 + row * kSssRow1 + j, rectified(sum)); });
    t.sync();
    sssForward<kRows, kSssHidden1, kSssHidden2>(thread, b.h1, kSssRow1, w.second, kSssRow1, [&](int, int j) { return sssRead(w.secondBias + j); },
        [&](int row, int j, const SssVector<4>& sum) { sssWrite(b.h2 + row * kSssRow2 + j, rectified(sum)); });
    t.sync();
    sssForward<kRows, kSssHidden2, kSssHidden3>(thread, b.h2, kSssRow2, w.third, kSssRow2, [&](int, int j) { return sssRead(w.thirdBias + j); },
        [&](int row, int j, const SssVector<4>& sum) { sssWrite(b.h3 + row * kSssRow3 + j, rectified(sum)); });
    t.sync();
    if (share)
        sssForward<kRows, kSssHidden3, kSssHiddenShare>(thread, b.h3, kSssRow3, w.share, kSssRow3, [&](int, int j) { return sssRead(w.shareBias + j); },
            [&](int row, int j, const SssVector<4>& sum) { sssWrite(b.hs + row * kSssRowShare + j, rectified(sum)); });
    for (int k = int(thread); k < 3 * kRows; k += int(kSssThreads)) {
        const int row = k % kRows, c = k / kRows; // all threads of a warp, mostly, the same weights
        float sum = w.residualBias[c];
        for (int i = 0; i < kSssHidden3; i += 4) {
            const SssVector<4> x = sssRead(b.h3 + row * kSssRow3 + i), y = sssRead(w.residual + c * kSssHidden3 + i);
            for (int q = 0; q < 4; ++q) sum += x.v[q] * y.v[q];
        }
        b.residual[3 * row + c] = sssLogistic(sum);
    }
    t.sync();
    for (int row = int(thread); row < kRows; row += int(kSssThreads)) {
        float sum = w.shareOutBias;
        for (int i = 0; share && i < kSssHiddenShare; i += 4) {
            const SssVector<4> x = sssRead(b.hs + row * kSssRowShare + i), y = sssRead(w.shareOut + i);
            for (int q = 0; q < 4; ++q) sum += x.v[q] * y.v[q];
        }
        b.share[row] = share ? 2 * sssLogistic(sum) : 1.0f;
    }
}

/// A thread's part of the gradient of the weights.
struct SssNetworkGradient {
    SssWeightGradient<kSssFixedInputs, kSssHidden1, 4> fixed;
    SssWeightGradient<kSssLightInputs, kSssHidden1, 1> light;
    SssWeightGradient<kSssCodeInputs, kSssHidden1, 2> code;
    SssWeightGradient<kSssHidden1, kSssHidden2, 4> second;
    SssWeightGradient<kSssHidden2, kSssHidden3, 2> third;
    SssWeightGradient<kSssHidden3, kSssHiddenShare, 2> share;
    float ends;      // threads 0..95: residual; 96..127: shareOut
    float biases;    // 0..31: share; 32..63: third; 64..95: second; 96..98: residual; 99: shareOut
    float firstBias; // 0..63

    NACRE_DEVICE void clear()
    {
        fixed.clear(), light.clear(), code.clear(), second.clear(), third.clear(), share.clear();
        ends = biases = firstBias = 0;
    }

    /// All of dWeights [kSssAllWeights].
    NACRE_DEVICE void store(uint32_t thread, float* dWeights) const
    {
        fixed.store(thread, dWeights + kSssFirstFixed), light.store(thread, dWeights + kSssFirstLight), code.store(thread, dWeights + kSssCode);
        second.store(thread, dWeights + kSssSecond), third.store(thread, dWeights + kSssThird), share.store(thread, dWeights + kSssShare);
        dWeights[thread < 96 ? kSssResidual + int(thread) : kSssShareOut + int(thread) - 96] = ends;
        const int at = thread < 32 ? kSssShareBias : thread < 64 ? kSssThirdBias : thread < 96 ? kSssSecondBias : thread < 99 ? kSssResidualBias : kSssShareOutBias;
        if (thread < 100) dWeights[at + int(thread < 96 ? thread % 32 : thread < 99 ? thread - 96 : 0)] = biases;
        if (thread < uint32_t(kSssHidden1)) dWeights[kSssFirstBias + int(thread)] = firstBias;
    }
};

/// After sssNetworkForward, with the gradients of the values before the logistic functions of residual and share in the place of both: adds to `d`,
/// and hands dCode(splat, i, four numbers) on. Begins with a barrier.
template <int kLights, class T, class DCode>
NACRE_DEVICE inline void sssNetworkBackward(const T& t, const SssSharedWeights& w, bool share, SssSharedBatch<kLights>& b, SssNetworkGradient& d, DCode dCode)
{
    using Batch = SssSharedBatch<kLights>;
    constexpr int kRows = Batch::kRows, kSplats = Batch::kSplats;
    const uint32_t thread = t.thread();
    const int lane = int(thread % 32);
    const auto none = [](int, int) { return SssVector<4>{}; };
    // In place of the activations, which a thread reads just where it writes.
    const auto throughRectifier = [](float* h, const SssVector<4>& sum) {
        SssVector<4> x = sssRead(h);
        for (int q = 0; q < 4; ++q) x.v[q] = x.v[q] > 0 ? sum.v[q] : kSssLeak * sum.v[q];
        sssWrite(h, x);
    };
    t.sync();
    if (thread < 96) {
        const int c = int(thread / 32);
        for (int row = 0; row < kRows; ++row) d.ends += b.residual[3 * row + c] * b.h3[row * kSssRow3 + lane];
    } else {
        for (int row = 0; share && row < kRows; ++row) d.ends += b.share[row] * b.hs[row * kSssRowShare + lane];
        if (lane < 3) d.biases += sssColumnSum<kRows>(b.residual + lane, 3);
        if (lane == 3 && share) d.biases += sssColumnSum<kRows>(b.share, 1);
    }
    if (share) {
        t.sync();
        for (int k = int(thread); k < kRows * kSssHiddenShare; k += int(kSssThreads)) {
            float& h = b.hs[k / kSssHiddenShare * kSssRowShare + lane];
            h = b.share[k / kSssHiddenShare] * w.shareOut[lane] * (h > 0 ? 1.0f : kSssLeak);
        }
        t.sync();
        d.share.template add<kRows>(thread, b.hs, kSssRowShare, b.h3, kSssRow3);
        if (thread < 32) d.biases += sssColumnSum<kRows>(b.hs + lane, kSssRowShare);
    }
    t.sync();
    const auto fromResidual = [&](int row, int i) {
        SssVector<4> sum{};
        for (int c = 0; c < 3; ++c) {
            const SssVector<4> y = sssRead(w.residual + c * kSssHidden3 + i);
            for (int q = 0; q < 4; ++q) sum.v[q] += b.residual[3 * row + c] * y.v[q];
        }
        return sum;
    };
    const auto into3 = [&](int row, int i, const SssVector<4>& sum) { throughRectifier(b.h3 + row * kSssRow3 + i, sum); };
    if (share) sssInputGradient<kRows, kSssHiddenShare, kSssHidden3>(thread, b.hs, kSssRowShare, w.share, kSssRow3, fromResidual, into3);
    else sssInputGradient<kRows, 0, kSssHidden3>(thread, b.hs, kSssRowShare, w.share, kSssRow3, fromResidual, into3);
    t.sync();
    d.third.template add<kRows>(thread, b.h3, kSssRow3, b.h2, kSssRow2);
    if (thread / 32 == 1) d.biases += sssColumnSum<kRows>(b.h3 + lane, kSssRow3);
    t.sync();
    sssInputGradient<kRows, kSssHidden3, kSssHidden2>(thread, b.h3, kSssRow3, w.third, kSssRow2, none,
        [&](int row, int i, const SssVector<4>& sum) { throughRectifier(b.h2 + row * kSssRow2 + i, sum); });
    t.sync();
    d.second.template add<kRows>(thread, b.h2, kSssRow2, b.h1, kSssRow1);
    if (thread / 32 == 2) d.biases += sssColumnSum<kRows>(b.h2 + lane, kSssRow2);
    t.sync();
    sssInputGradient<kRows, kSssHidden2, kSssHidden1>(thread, b.h2, kSssRow2, w.second, kSssRow1, none,
        [&](int row, int i, const SssVector<4>& sum) { throughRectifier(b.h1 + row * kSssRow1 + i, sum); });
    t.sync();
    d.light.template add<kRows>(thread, b.h1, kSssRow1, b.light, kSssLightRow);
    for (int k = int(thread); k < kSplats * kSssHidden1; k += int(kSssThreads)) {
        const int splat = k / kSssHidden1, j = k % kSssHidden1;
        float sum = 0;
        for (int l = 0; l < kLights; ++l) sum += b.h1[(l * kSplats + splat) * kSssRow1 + j];
        b.first()[splat * kSssRow1 + j] = sum;
    }
    t.sync();
    d.fixed.template add<kSplats>(thread, b.first(), kSssRow1, b.fixed, kSssFixedRow);
    d.code.template add<kSplats>(thread, b.first(), kSssRow1, b.code, kSssCodeRow);
    if (thread < uint32_t(kSssHidden1)) d.firstBias += sssColumnSum<kSplats>(b.first() + thread, kSssRow1);
    sssInputGradient<kSplats, kSssHidden1, kSssCodeInputs>(thread, b.first(), kSssRow1, w.code, kSssCodeRow, none, dCode);
}

} // namespace nacre::NACRE_BACKEND
