// Directions on a square: the octahedron, its lower half folded outwards (Cigolle et al., "A Survey of Efficient Representations for
// Independent Unit Vectors", 2014).
#pragma once

#include "base/host_device.h"

#include <glm/glm.hpp>

#include <cmath>

namespace nacre {

/// Unit vector of a place, u and v in [-1, 1].
NACRE_HD inline glm::vec3 octahedralDirection(float u, float v)
{
    const float z = 1 - std::abs(u) - std::abs(v);
    if (z >= 0) return glm::normalize(glm::vec3(u, v, z));
    return glm::normalize(glm::vec3((1 - std::abs(v)) * (u < 0 ? -1.0f : 1.0f), (1 - std::abs(u)) * (v < 0 ? -1.0f : 1.0f), z));
}

/// The other way; `w` unit.
NACRE_HD inline glm::vec2 octahedralCoordinates(const glm::vec3& w)
{
    const glm::vec3 p = w / (std::abs(w.x) + std::abs(w.y) + std::abs(w.z));
    if (p.z >= 0) return {p.x, p.y};
    return {(1 - std::abs(p.y)) * (p.x < 0 ? -1.0f : 1.0f), (1 - std::abs(p.x)) * (p.y < 0 ? -1.0f : 1.0f)};
}

} // namespace nacre
