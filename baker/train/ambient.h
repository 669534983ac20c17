// Light of the surroundings: a colour of each splat that does not depend on the light.
#pragma once

#include "base/host_device.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace nacre {

/// The logarithm of the colour, with Adam's state.
struct AmbientRow {
    std::array<float, 3> value, momentum, second;
};

/// One Adam step of channel `c`, from the gradient of the colour.
NACRE_HD inline void stepAmbientChannel(AmbientRow& row, size_t c, float gradient, float rate)
{
    constexpr float kBeta1 = 0.9f, kBeta2 = 0.99f, kLeast = -16, kMost = 4;
    gradient *= std::exp(row.value[c]);
    if (!(std::abs(gradient) < 1e18f)) return;
    row.momentum[c] += (1 - kBeta1) * (gradient - row.momentum[c]);
    row.second[c] += (1 - kBeta2) * (gradient * gradient - row.second[c]);
    row.value[c] = std::clamp(row.value[c] - rate * row.momentum[c] / (std::sqrt(row.second[c]) + 1e-15f), kLeast, kMost);
}

} // namespace nacre
