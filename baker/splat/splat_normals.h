// Normals of the surface that splats lie on, and who lies next to whom on it.
#pragma once

#include "render/projection.h"

#include <cstdint>
#include <glm/glm.hpp>

#include <span>
#include <vector>

namespace nacre {

/// The shortest axis of each splat, turned to the side of `outside` [count] (any length), then averaged over the splats within about two
/// splat sizes that face the same way (within 45 degrees): trained splats wobble, surfaces do not. Unit.
std::vector<glm::vec3> splatNormals(std::span<const GaussianGeometry<float>> splats, std::span<const glm::vec3> outside);

constexpr int kSplatNeighbours = 8;

/// [count][kSplatNeighbours]: the nearest splats within about two to four splat sizes that face the same way (within 45 degrees), the
/// nearest first, the splat itself where there are fewer.
std::vector<uint32_t> splatNeighbours(std::span<const GaussianGeometry<float>> splats, std::span<const glm::vec3> normals);

} // namespace nacre
