// Fibres as cubic Bezier curves with a round cross-section.
#pragma once

#include <glm/glm.hpp>

#include <cstddef>
#include <vector>

namespace nacre {

struct HairStrands {
    std::vector<glm::vec4> controlPoints; // 4 per segment: xyz in world units, w = radius; segments do not share points
    std::vector<glm::vec3> colors;        // per segment: the colour a thick coat of such fibres shows under white light, linear
    float longitudinalRoughness = 0.3f;   // beta_M, (0, 1]
    float azimuthalRoughness = 0.3f;      // beta_N, (0, 1]
    float cuticleTiltRadians = 0.035f;    // alpha: 2 degrees
    float ior = 1.55f;
    size_t segmentCount() const { return controlPoints.size() / 4; }
};

} // namespace nacre
