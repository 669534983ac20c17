// IEEE 754 half floats.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace nacre {

constexpr float kMaxHalf = 65504.0f;

/// Nearest half, ties to even. |x| <= kMaxHalf.
inline uint16_t halfFromFloat(float x)
{
    const uint32_t bits = std::bit_cast<uint32_t>(x), sign = bits >> 16 & 0x8000u;
    const float magnitude = std::abs(x);
    if (magnitude < 6.103515625e-05f) // subnormal half: adding 0.5 leaves the multiple of 2^-24 in the low mantissa bits
        return uint16_t(sign | (std::bit_cast<uint32_t>(magnitude + 0.5f) - std::bit_cast<uint32_t>(0.5f)));
    const uint32_t rebased = (bits & 0x7fffffffu) - (112u << 23);
    return uint16_t(sign | (rebased + 0xfffu + (rebased >> 13 & 1u)) >> 13);
}

} // namespace nacre
