// Shadow rays on their way to the ray library, eight at a time.
#pragma once

#include "light_stage/ray_scene.h"

#include <glm/glm.hpp>

namespace nacre::stage {

inline void addTo(float* pixel, const glm::vec3& color)
{
    for (int c = 0; c < 3; ++c) pixel[c] += color[c];
}

/// Half of the vertices face away from a light, and late in a pass most paths have ended, so packets fill up across lights. The rays of
/// one light stay in order: its sum does not depend on the others.
class ShadowQueue {
public:
    void push(const glm::vec3& origin, const glm::vec3& direction, float nearDistance, float farDistance, const glm::vec3& color, float* pixel,
              const RayScene& scene, bool coherent)
    {
        const int k = count_++;
        packet_.originX[k] = origin.x, packet_.originY[k] = origin.y, packet_.originZ[k] = origin.z;
        packet_.directionX[k] = direction.x, packet_.directionY[k] = direction.y, packet_.directionZ[k] = direction.z;
        packet_.nearDistance[k] = nearDistance, packet_.farDistance[k] = farDistance;
        packet_.time[k] = 0.0f, packet_.mask[k] = ~0u, packet_.id[k] = 0, packet_.flags[k] = 0;
        colors_[k] = color;
        pixels_[k] = pixel;
        if (count_ == 8) flush(scene, coherent);
    }
    void flush(const RayScene& scene, bool coherent)
    {
        if (count_ == 0) return;
        alignas(32) int32_t valid[8];
        for (int k = 0; k < 8; ++k) valid[k] = k < count_ ? -1 : 0;
        scene.occluded(valid, packet_, coherent);
        for (int k = 0; k < count_; ++k)
            if (!(packet_.farDistance[k] < 0.0f)) addTo(pixels_[k], colors_[k]);
        count_ = 0;
    }

private:
    ShadowPacket packet_;
    glm::vec3 colors_[8];
    float* pixels_[8];
    int count_ = 0;
};

} // namespace nacre::stage
