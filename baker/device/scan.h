// Sums of all that comes before, of any number of counts.
#pragma once

#include "device/device.h"

namespace nacre::NACRE_BACKEND {

NACRE_DEVICE inline uint32_t bitCount(uint32_t bits)
{
#ifdef __CUDACC__
    return uint32_t(__popc(bits));
#else
    return uint32_t(__builtin_popcount(bits));
#endif
}

/// Sums that have no room stay the largest number, which the caller can see. In any order of adding.
NACRE_DEVICE inline uint32_t saturatedSum(uint32_t a, uint32_t b) { return a + b < a ? ~0u : a + b; }

/// One value of a warp of the block each.
struct BlockSums {
    uint32_t ofWarp[kWarp];
};

/// The sum over the threads of the block before this one; `total` becomes that over all. All threads come here. Ends with a barrier before the
/// memory may be used again.
template <uint32_t kThreads>
NACRE_DEVICE inline uint32_t sumBefore(const Thread& t, BlockSums& shared, uint32_t value, uint32_t& total)
{
    uint32_t sum = value;
    for (uint32_t d = 1; d < kWarp; d *= 2) {
        const uint32_t other = t.shuffleUp(kFullWarp, sum, d);
        if (t.lane() >= d) sum = saturatedSum(sum, other);
    }
    if (t.lane() == kWarp - 1) shared.ofWarp[t.warp()] = sum;
    const uint32_t up = t.shuffleUp(kFullWarp, sum, 1);
    uint32_t before = t.lane() == 0 ? 0 : up;
    t.sync();
    total = 0;
    for (uint32_t w = 0; w < kThreads / kWarp; ++w) {
        if (w == t.warp()) before = saturatedSum(before, total);
        total = saturatedSum(total, shared.ofWarp[w]);
    }
    t.sync();
    return before;
}

constexpr uint32_t kScanThreads = 256, kScanItems = 8, kScanBlock = kScanThreads * kScanItems;

/// The sum of each kScanBlock values. Reads 4 bytes a value.
struct ScanSums {
    static constexpr uint32_t kThreads = kScanThreads;
    using Shared = BlockSums;
    const uint32_t* in;
    uint32_t* sums;
    uint32_t count;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t first = size_t(t.block()) * kScanBlock;
        uint32_t sum = 0, total;
        for (uint32_t k = 0; k < kScanItems; ++k) {
            const size_t i = first + k * kThreads + t.thread();
            if (i < count) sum = saturatedSum(sum, in[i]);
        }
        sumBefore<kThreads>(t, t.shared<Shared>(), sum, total);
        if (t.thread() == 0) sums[t.block()] = total;
    }
};

/// With the sum before each block's first value: kScanBlock values a block. Without (starts is null): one block runs over all.
/// Reads 4 bytes a value, writes 4.
struct ScanRange {
    static constexpr uint32_t kThreads = kScanThreads;
    using Shared = BlockSums;
    const uint32_t* in;
    uint32_t* out; // may be `in`
    const uint32_t* starts;
    uint32_t count;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        size_t first = size_t(t.block()) * kScanBlock;
        const size_t end = starts && first + kScanBlock < count ? first + kScanBlock : count;
        uint32_t start = starts ? starts[t.block()] : 0;
        for (; first < end; first += kScanBlock) {
            const size_t from = first + size_t(t.thread()) * kScanItems;
            uint32_t values[kScanItems], sum = 0, total;
            for (uint32_t k = 0; k < kScanItems; ++k) values[k] = from + k < end ? in[from + k] : 0, sum = saturatedSum(sum, values[k]);
            uint32_t before = saturatedSum(start, sumBefore<kThreads>(t, t.shared<Shared>(), sum, total));
            for (uint32_t k = 0; k < kScanItems; ++k) {
                if (from + k < end) out[from + k] = before;
                before = saturatedSum(before, values[k]);
            }
            start = saturatedSum(start, total);
        }
        if (t.thread() == 0 && end == count) out[count] = start;
    }
};

class Scan {
public:
    /// out[i] becomes the sum of in[0] .. in[i - 1], out[count] that of all: one more than `in` has, which it may be. What has no room in 32
    /// bits becomes 2^32 - 1.
    void run(Device& device, const uint32_t* in, uint32_t* out, uint32_t count)
    {
        if (count <= 2 * kScanBlock) {
            launch(device, 1, ScanRange{in, out, nullptr, count});
            return;
        }
        const uint32_t blocks = blocksFor(count, kScanBlock);
        sums_.reserve(device, size_t(blocks) + 1);
        launch(device, blocks, ScanSums{in, sums_.data(), count});
        launch(device, 1, ScanRange{sums_.data(), sums_.data(), nullptr, blocks});
        launch(device, blocks, ScanRange{in, out, sums_.data(), count});
    }

private:
    Buffer<uint32_t> sums_;
};

} // namespace nacre::NACRE_BACKEND
