// An equirectangular radiance map as a light: radiance along a direction, and directions drawn in proportion to it.
// Axes as in formats/dataset: u right, v down in [0, 1]; theta = pi v from +Z, azimuth phi = pi - 2 pi u from +X towards +Y.
// Radiance is constant within a texel, so that drawing is exact and weights are bounded.
#pragma once

#include "base/image.h"
#include "base/result.h"
#include "light_stage/sampling.h"

#include <string>
#include <vector>

namespace nacre::stage {

class EnvironmentLight {
public:
    /// Negative radiance (ringing of filtered maps) counts as 0. `scale` multiplies the map.
    EnvironmentLight(const Image& map, const glm::vec3& scale);

    glm::vec3 radiance(const glm::vec3& direction) const { return texels_[texelOf(direction)]; }
    /// Per solid angle.
    float pdf(const glm::vec3& direction) const { return density_[texelOf(direction)]; }
    /// A direction drawn in proportion to luminance. False if the map is black.
    bool sample(const glm::vec2& u, glm::vec3* direction, glm::vec3* radiance, float* pdf) const;

private:
    size_t texelOf(const glm::vec3& direction) const;

    int width_ = 0, height_ = 0;
    std::vector<glm::vec3> texels_;
    std::vector<float> density_;
    std::vector<double> rowCdf_;    // height + 1
    std::vector<double> columnCdf_; // height x (width + 1)
};

} // namespace nacre::stage
