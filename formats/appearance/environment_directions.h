// An environment as a few directional lights, chosen so that they err least: the sphere is divided into compact regions, small where much
// light comes from, and each becomes one direction.
#pragma once

#include <glm/glm.hpp>

#include <span>
#include <vector>

namespace nacre {

/// A small piece of the sphere and what comes from it.
struct EnvironmentCell {
    glm::dvec3 power{0};        // radiance x solid angle, rgb
    glm::dvec3 moment{0};       // luminance of the power x direction
    bool operator==(const EnvironmentCell&) const = default;
};

/// Of an equirectangular map (axes: dataset/environment_map.h) of `stride` floats to a pixel, rgb first. Negative radiance counts as none:
/// filtered maps ring below 0. So fine that `count` directions can be told apart, however coarse the map, and no finer than that needs.
std::vector<EnvironmentCell> environmentCells(const float* pixels, int width, int height, int stride, int count);

struct EnvironmentDirection {
    glm::dvec3 direction{0};    // unit, towards where the light comes from: the mean over the region, weighted with luminance
    glm::dvec3 irradiance{0};   // of all of the region
    double angularRadius = 0;   // of a disc whose directions agree as well as the region's
};

/// At most `count`, fewer where fewer cells shine. The irradiances sum to that of the map.
std::vector<EnvironmentDirection> environmentDirections(std::span<const EnvironmentCell> cells, int count);

} // namespace nacre
