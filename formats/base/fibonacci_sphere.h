// Directions spread evenly over the sphere: equal steps in z, golden angle in azimuth.
#pragma once

#include <glm/glm.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nacre {

/// Direction i of n, unit. Ordered by falling z.
inline glm::dvec3 fibonacciDirection(int i, int n)
{
    const double z = 1.0 - (2.0 * i + 1.0) / n, r = std::sqrt(std::max(0.0, 1.0 - z * z));
    const double phi = 2.0 * std::numbers::pi * std::fmod(i * (std::numbers::phi - 1.0), 1.0);
    return {r * std::cos(phi), r * std::sin(phi), z};
}

} // namespace nacre
