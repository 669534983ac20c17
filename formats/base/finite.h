// Whether many numbers are all finite.
#pragma once

#include <cstddef>

namespace nacre {

inline bool allFinite(const float* values, size_t count)
{
    // A product with 0 is NaN for NaN and infinity: one branch-free sum instead of a test per value.
    float sum = 0;
    for (size_t i = 0; i < count; ++i) sum += values[i] * 0.0f;
    return sum == 0.0f;
}

} // namespace nacre
