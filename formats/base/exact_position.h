// Positions of lights to more digits than float32 has.
#pragma once

#include "base/light.h"

namespace nacre {

/// Light::position, and in positionRest what that rounds away. One number at a time and through memory: GCC 12 makes vectors of a loop
/// over x, y, z, takes (double)(float)x for x in them, and leaves a rest of 0.
inline void setExactPosition(Light& light, const glm::dvec3& exact)
{
    for (int k = 0; k < 3; ++k) {
        const volatile float nearest = float(exact[k]);
        light.position[k] = nearest, light.positionRest[k] = float(exact[k] - double(nearest));
    }
}

inline glm::dvec3 exactPosition(const Light& light) { return glm::dvec3(light.position) + glm::dvec3(light.positionRest); }

} // namespace nacre
