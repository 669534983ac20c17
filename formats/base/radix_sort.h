// Stable ascending sort of (32-bit key, payload) pairs: least significant digit first, three digits of 11, 11 and 10 bits.
// Linear time, no comparisons, same result on every machine; equal keys keep their input order.
#pragma once

#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

namespace nacre {

/// Bits that order like the float (no NaN): -inf < ... < -0 < +0 < ... < inf.
inline uint32_t radixKey(float x)
{
    uint32_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}

/// Scratch memory that keeps its capacity from sort to sort.
template <class Payload>
struct RadixScratch {
    std::vector<uint32_t> keys;
    std::vector<Payload> payloads;
};

/// Sorts both arrays by `keys`. They have the same length.
template <class Payload>
void radixSort(std::span<uint32_t> keys, std::span<Payload> payloads, RadixScratch<Payload>& scratch)
{
    constexpr int kShifts[3] = {0, 11, 22};
    constexpr uint32_t kMask = 2047;
    assert(keys.size() == payloads.size());
    const size_t count = keys.size();
    scratch.keys.resize(count);
    scratch.payloads.resize(count);

    std::array<std::array<size_t, kMask + 1>, 3> histogram{};
    for (const uint32_t key : keys)
        for (int d = 0; d < 3; ++d) ++histogram[d][key >> kShifts[d] & kMask];

    uint32_t *fromKeys = keys.data(), *toKeys = scratch.keys.data();
    Payload *from = payloads.data(), *to = scratch.payloads.data();
    for (int d = 0; d < 3; ++d) {
        std::array<size_t, kMask + 1>& next = histogram[d];
        if (count == 0 || next[fromKeys[0] >> kShifts[d] & kMask] == count) continue; // one digit value: nothing would move
        size_t offset = 0;
        for (size_t& n : next) offset += std::exchange(n, offset);
        for (size_t i = 0; i < count; ++i) {
            const size_t slot = next[fromKeys[i] >> kShifts[d] & kMask]++;
            toKeys[slot] = fromKeys[i];
            to[slot] = from[i];
        }
        std::swap(fromKeys, toKeys);
        std::swap(from, to);
    }
    if (from != payloads.data()) { // an odd number of digits moved
        std::memcpy(keys.data(), fromKeys, count * sizeof(uint32_t));
        for (size_t i = 0; i < count; ++i) payloads[i] = from[i];
    }
}

} // namespace nacre
