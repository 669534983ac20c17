// A light as every part of Nacre passes it around. Meaning as in glTF KHR_lights_punctual, linear Rec.709.
#pragma once

#include "base/light_sample.h"

#include <glm/glm.hpp>

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace nacre {

enum class LightType : uint8_t { kPoint, kDirectional, kEnvironment, kGroup };

struct Light {
    LightType type = LightType::kPoint;
    glm::vec3 position{0.0f};         // point: in the frame of the splats
    glm::vec3 positionRest{0.0f};     // what float32 leaves of the position that a dataset states, far from its origin
    glm::vec3 directionToLight{0, 0, 1}; // directional: unit, from the surface to the light; environment: where the map's zenith is
    glm::vec3 intensity{1.0f};        // point: radiant intensity I, irradiance I/r^2; directional: irradiance
    float radius = 0.0f;              // point: 1/r^2 stops growing inside this radius (floor kMinLightRadius); directional: angular radius
                                      // of what shines (radians), which widens highlights
    std::string environmentPath;      // environment: equirectangular EXR, absolute or relative to the process
    std::shared_ptr<const std::vector<Light>> group; // group: point and directional lights that shine at once

    /// One light with one direction per point: what models train with and renderers take.
    bool isPunctual() const { return type == LightType::kPoint || type == LightType::kDirectional; }
};

/// What a directional light of some angular radius adds to alpha^2 of GGX: the half vector turns half as far as the light. Highlights become
/// wider and fainter by as much, so that lights which together are an environment leave no gaps between their highlights. (knob_marble, sss,
/// environment, masked, for factors of 0, 0.125, 0.25 and 0.5: 27.73, 27.80, 27.80, 27.74 dB.)
NACRE_HD inline float highlightWidening(float angularRadius) { return 0.25f * angularRadius * angularRadius; }
inline float highlightWidening(const Light& light) { return light.type == LightType::kDirectional ? highlightWidening(light.radius) : 0.0f; }

/// A point or directional light seen from `p`.
inline LightSample<float> sampleLight(const Light& light, const float p[3])
{
    if (light.type == LightType::kPoint) return samplePointLight(&light.position.x, light.radius, p);
    return {{light.directionToLight.x, light.directionToLight.y, light.directionToLight.z}, 1.0f};
}

} // namespace nacre
