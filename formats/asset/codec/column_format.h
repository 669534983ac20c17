// What encoder and decoder of columns share (columns.h).
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace nacre::codec {

constexpr int kProbabilityBits = 12;
constexpr uint32_t kProbabilityOne = 1u << kProbabilityBits;
constexpr uint32_t kLowestState = 1u << 16; // states lie in [2^16, 2^32); 16 bits are moved at a time
constexpr size_t kRuns = 4, kLeastRowsForRuns = 256;
constexpr int kTokens = 16 + 2 * 28;        // of 32-bit numbers
constexpr int kMostContexts = 9;

constexpr size_t runsOf(size_t rows) { return rows < kLeastRowsForRuns ? 1 : kRuns; }

/// 0, -1, 1, -2 ... as 0, 1, 2, 3 ...
constexpr uint32_t zigzag(int32_t v) { return (uint32_t(v) << 1) ^ uint32_t(v >> 31); }
constexpr int32_t unzigzag(uint32_t u) { return int32_t(u >> 1) ^ -int32_t(u & 1); }

/// Numbers below 16 are tokens themselves. Of larger ones the token has the place of the highest bit and the bit after it; the rest is raw.
struct Token {
    uint32_t token, extra;
    int extraBits;
};
constexpr Token tokenOf(uint32_t u)
{
    if (u < 16) return {u, 0, 0};
    const int top = std::bit_width(u) - 1; // 4..31
    const int bits = top - 1;
    return {16 + 2 * uint32_t(top - 4) + ((u >> bits) & 1), u & ((1u << bits) - 1), bits};
}
constexpr int extraBitsOf(uint32_t token) { return token < 16 ? 0 : int((token - 16) / 2) + 3; }
constexpr uint32_t firstOfToken(uint32_t token) { return token < 16 ? token : (2 + ((token - 16) & 1)) << extraBitsOf(token); }

/// How large a number is, in three classes. Sums, because branches on it are mispredicted.
constexpr int sizeClass(uint32_t zigzagged) { return int(zigzagged > 0) + int(zigzagged > 2); }

/// How a column is coded: its first byte.
enum ColumnFlags : uint8_t { kDifference = 1, kSeesAbove = 2, kSeesLeft = 4, kAllFlags = 7 };
constexpr int contextsOf(int flags) { return (flags & kSeesAbove ? 3 : 1) * (flags & kSeesLeft ? 3 : 1); }

/// The context of a row from the coded number of the row above and the value to the left.
constexpr int contextOf(int flags, uint32_t above, uint32_t left)
{
    const int a = flags & kSeesAbove ? sizeClass(above) : 0, l = flags & kSeesLeft ? sizeClass(left) : 0;
    return flags & kSeesAbove ? 3 * l + a : l;
}

} // namespace nacre::codec
