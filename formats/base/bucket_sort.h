// Payloads in descending order of 32-bit keys, in two levels: one pass spreads (key, payload) pairs over buckets by the top bits of
// their distance from the largest key, then each bucket, which fits into the innermost caches, is sorted by the rest, least significant
// digit first. Keys that lie close together, as floats of one magnitude do, have few bits left. Equal keys: the later payload comes
// first, as in a stable ascending sort that is turned over. Linear time for any keys, same result on every machine.
#pragma once

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace nacre {

/// Memory that keeps its capacity from sort to sort.
class BucketSort {
public:
    /// All three have the same length, below 2^32.
    void descending(std::span<const uint32_t> keys, std::span<const uint32_t> payloads, std::span<uint32_t> sorted)
    {
        assert(keys.size() == payloads.size() && keys.size() == sorted.size());
        const size_t count = keys.size();
        if (count == 0) return;
        const auto [least, most] = range(keys);
        const int bits = std::bit_width(most - least), topBits = std::min({int(std::bit_width(count / kBucketSize)), kMostTopBits, bits});
        const int lowBits = bits - topBits;

        ends_.assign(size_t(1) << topBits, 0);
        for (const uint32_t key : keys) ++ends_[bucketOf(most - key, lowBits)];
        startsFromCounts(ends_);
        pairs_.resize(count);
        for (size_t i = count; i-- > 0;) { // backwards: of equal keys the later payload comes first
            const uint32_t below = most - keys[i];
            pairs_[ends_[bucketOf(below, lowBits)]++] = uint64_t(below) << 32 | payloads[i];
        }
        uint32_t begin = 0;
        for (const uint32_t end : ends_) {
            sortBucket(std::span(pairs_).subspan(begin, end - begin), lowBits, sorted.data() + begin);
            begin = end;
        }
    }

private:
    static constexpr size_t kBucketSize = 1024; // on average; twice eight bytes each stay in 32 kB
    static constexpr int kMostTopBits = 11;     // buckets that are written to at once: more thrash the caches
    static constexpr int kMostDigitBits = 11, kMostDigits = 3;
    static constexpr size_t kFew = 32;          // sorted by insertion

    static std::pair<uint32_t, uint32_t> range(std::span<const uint32_t> keys)
    {
        uint32_t least = keys[0], most = keys[0];
        for (const uint32_t key : keys) least = std::min(least, key), most = std::max(most, key);
        return {least, most};
    }
    static size_t bucketOf(uint32_t below, int lowBits) { return lowBits < 32 ? below >> lowBits : 0; }
    static void startsFromCounts(std::span<uint32_t> counts)
    {
        uint32_t start = 0;
        for (uint32_t& n : counts) start += std::exchange(n, start);
    }
    static uint32_t keyOf(uint64_t pair) { return uint32_t(pair >> 32); }

    static void insertionSort(std::span<uint64_t> pairs)
    {
        for (size_t i = 1; i < pairs.size(); ++i) {
            const uint64_t pair = pairs[i];
            size_t at = i;
            for (; at > 0 && keyOf(pairs[at - 1]) > keyOf(pair); --at) pairs[at] = pairs[at - 1];
            pairs[at] = pair;
        }
    }

    /// Ascending by the low bits of the key, stable. Writes the payloads; `pairs` is spoilt.
    void sortBucket(std::span<uint64_t> pairs, int lowBits, uint32_t* sorted)
    {
        if (pairs.size() <= kFew || lowBits == 0) {
            if (lowBits > 0) insertionSort(pairs);
            for (const uint64_t pair : pairs) *sorted++ = uint32_t(pair);
            return;
        }
        const int digits = (lowBits + kMostDigitBits - 1) / kMostDigitBits, digitBits = (lowBits + digits - 1) / digits;
        const size_t values = size_t(1) << digitBits;
        const uint32_t mask = uint32_t(values - 1);
        counts_.assign(size_t(digits) * values, 0);
        for (const uint64_t pair : pairs)
            for (int d = 0; d < digits; ++d) ++counts_[size_t(d) * values + (keyOf(pair) >> d * digitBits & mask)];
        for (int d = 0; d < digits; ++d) startsFromCounts(std::span(counts_).subspan(size_t(d) * values, values));

        if (spare_.size() < pairs.size()) spare_.resize(pairs.size());
        uint64_t *from = pairs.data(), *to = spare_.data();
        for (int d = 0; d < digits; ++d) {
            uint32_t* next = &counts_[size_t(d) * values];
            const int shift = 32 + d * digitBits;
            if (d == digits - 1)
                for (size_t i = 0; i < pairs.size(); ++i) sorted[next[from[i] >> shift & mask]++] = uint32_t(from[i]);
            else
                for (size_t i = 0; i < pairs.size(); ++i) to[next[from[i] >> shift & mask]++] = from[i];
            std::swap(from, to);
        }
    }

    std::vector<uint32_t> ends_, counts_;
    std::vector<uint64_t> pairs_, spare_;
};

} // namespace nacre
