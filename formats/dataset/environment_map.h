// Environment maps: equirectangular (latitude-longitude) EXR images of radiance.
//
// Axes: u right, v down in [0, 1]; theta = pi v from the zenith, azimuth phi = pi - 2 pi u. In a world whose up is +Z, phi runs from +X
// towards +Y.
#pragma once

#include "base/image.h"
#include "base/result.h"

#include <glm/glm.hpp>

#include <string>

namespace nacre {

/// Error kBadInput that names the usual other layouts if the image is not twice as wide as high.
Status checkEnvironmentSize(int width, int height, const std::string& name);

/// readExr and that check.
Result<Image> readEnvironmentMap(const std::string& path);

/// The rotation by which the map's zenith, +Z, becomes `zenith` (unit), on the shortest way: +Y as up takes the map's (x, y, z) to (x, z, -y).
glm::dmat3 worldFromEnvironment(const glm::dvec3& zenith);

} // namespace nacre
