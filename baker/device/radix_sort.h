// Stable ascending sort of pairs of 32 bits, least significant digit first. Per digit: how often each occurs in each block, where the block's
// first of each goes, and there they go. A pass reads 12 bytes of a pair (its key twice) and writes 8.
#pragma once

#include "device/scan.h"

#include <utility>

namespace nacre::NACRE_BACKEND {

constexpr uint32_t kSortThreads = 256, kSortWarps = kSortThreads / kWarp, kSortItems = 16, kSortBlock = kSortThreads * kSortItems;
constexpr uint32_t kSortDigits = kSortThreads; // at most; a digit has a thread

/// counts[digit][block]. Reads 4 bytes a pair.
struct CountDigits {
    static constexpr uint32_t kThreads = kSortThreads;
    struct Shared { uint32_t count[kSortDigits]; };
    const uint32_t* keys;
    uint32_t* counts;
    uint32_t count, shift, digits;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        s.count[t.thread()] = 0;
        t.sync();
        const size_t first = size_t(t.block()) * kSortBlock + t.thread();
        for (uint32_t k = 0; k < kSortItems && first + k * kThreads < count; ++k)
            deviceAdd(&s.count[keys[first + k * kThreads] >> shift & (digits - 1)], 1u);
        t.sync();
        if (t.thread() < digits) counts[size_t(t.thread()) * t.blocks() + t.block()] = s.count[t.thread()];
    }
};

/// `starts`: the sums of CountDigits before each. Reads 8 bytes a pair and writes 8, in runs of equal digits.
/// A warp takes kWarp kSortItems pairs that follow each other, kWarp at a time: lanes with the same digit find each other by votes.
struct MoveDigits {
    static constexpr uint32_t kThreads = kSortThreads;
    struct Shared {
        uint32_t ofWarp[kSortWarps][kSortDigits]; // how many so far, then where the next goes in the block
        uint32_t offset[kSortDigits];             // from the block's order to that of all
        uint32_t key[kSortBlock], value[kSortBlock];
        BlockSums sums;
    };
    const uint32_t *keys, *values;
    uint32_t *toKeys, *toValues;
    const uint32_t* starts;
    uint32_t count, shift, digitBits;

    NACRE_DEVICE uint32_t digit(uint32_t key) const { return key >> shift & ((1u << digitBits) - 1); }

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        for (uint32_t w = 0; w < kSortWarps; ++w) s.ofWarp[w][t.thread()] = 0;
        t.sync();
        const size_t blockFirst = size_t(t.block()) * kSortBlock, warpFirst = blockFirst + t.warp() * kWarp * kSortItems;
        uint32_t* const ofWarp = s.ofWarp[t.warp()];
        uint32_t key[kSortItems] = {}, rank[kSortItems] = {};
        NACRE_UNROLL
        for (uint32_t k = 0; k < kSortItems; ++k) {
            if (warpFirst + k * kWarp >= count) continue; // all lanes alike
            const size_t i = warpFirst + k * kWarp + t.lane();
            key[k] = i < count ? keys[i] : 0;
            uint32_t same = t.ballot(kFullWarp, i < count);
            for (uint32_t bit = 0; bit < digitBits; ++bit) {
                const bool one = digit(key[k]) >> bit & 1;
                const uint32_t ones = t.ballot(kFullWarp, one);
                same &= one ? ones : ~ones;
            }
            const uint32_t before = bitCount(same & ((1u << t.lane()) - 1));
            if (i < count) rank[k] = ofWarp[digit(key[k])] + before;
            t.syncWarp(kFullWarp);
            if (i < count && before == 0) ofWarp[digit(key[k])] += bitCount(same);
            t.syncWarp(kFullWarp);
        }
        t.sync();
        uint32_t here = 0, all;
        for (uint32_t w = 0; w < kSortWarps; ++w) here += s.ofWarp[w][t.thread()];
        uint32_t next = sumBefore<kThreads>(t, s.sums, here, all);
        if (t.thread() < 1u << digitBits) s.offset[t.thread()] = starts[size_t(t.thread()) * t.blocks() + t.block()] - next;
        for (uint32_t w = 0; w < kSortWarps; ++w) {
            const uint32_t n = s.ofWarp[w][t.thread()];
            s.ofWarp[w][t.thread()] = next, next += n;
        }
        t.sync();
        NACRE_UNROLL
        for (uint32_t k = 0; k < kSortItems; ++k) {
            const size_t i = warpFirst + k * kWarp + t.lane();
            if (i >= count) continue;
            const uint32_t slot = ofWarp[digit(key[k])] + rank[k];
            s.key[slot] = key[k], s.value[slot] = values[i];
        }
        t.sync();
        for (uint32_t i = t.thread(); i < all; i += kThreads) {
            const uint32_t to = s.offset[digit(s.key[i])] + i;
            toKeys[to] = s.key[i], toValues[to] = s.value[i];
        }
    }
};

class RadixSort {
public:
    /// Sorts both by the lowest `bits` of the keys; equal keys keep their order. They have the same size; their data may be elsewhere afterwards.
    void run(Device& device, Buffer<uint32_t>& keys, Buffer<uint32_t>& values, uint32_t bits)
    {
        const uint32_t count = uint32_t(keys.size()), blocks = blocksFor(count, kSortBlock);
        const uint32_t passes = (bits + 7) / 8; // of 8 bits at most
        keys_.reserve(device, count), values_.reserve(device, count);
        for (uint32_t pass = 0, shift = 0; pass < passes; ++pass) {
            const uint32_t digitBits = (bits - shift) / (passes - pass), digits = 1u << digitBits;
            counts_.reserve(device, size_t(digits) * blocks + 1);
            launch(device, blocks, CountDigits{keys.data(), counts_.data(), count, shift, digits});
            scan_.run(device, counts_.data(), counts_.data(), digits * blocks);
            launch(device, blocks, MoveDigits{keys.data(), values.data(), keys_.data(), values_.data(), counts_.data(), count, shift, digitBits});
            std::swap(keys, keys_), std::swap(values, values_);
            shift += digitBits;
        }
    }

private:
    Buffer<uint32_t> keys_, values_, counts_;
    Scan scan_;
};

} // namespace nacre::NACRE_BACKEND
