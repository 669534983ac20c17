// Normals of the surface that splats lie on.
#pragma once

#include "render/projection.h"

#include <glm/glm.hpp>

#include <span>
#include <vector>

namespace nacre {

/// The shortest axis of each splat, turned to the side of `outside` [count] (any length), then averaged over the splats within about two
/// splat sizes that face the same way (within 45 degrees): trained splats wobble, surfaces do not. Unit.
std::vector<glm::vec3> splatNormals(std::span<const GaussianGeometry<float>> splats, std::span<const glm::vec3> outside);

} // namespace nacre
