// Where the object is when images show its surroundings too and no mask says which is which: a ball. Splats outside of it learn the surroundings,
// which would otherwise have to be explained by splats before them, and are cut off in the end, as is the table that the object stands on.
#pragma once

#include "dataset/olat_dataset.h"
#include "splat/visual_hull.h"
#include "splats/splat_asset.h"
#include "train/initial_splats.h"

#include <optional>
#include <string>
#include <vector>

namespace nacre {

struct ObjectRegion {
    glm::vec3 center{0};
    float radius = 0;
    std::optional<glm::vec4> plane{}; // what the object stands on: points with dot(normal, p) > offset are above it
    bool holds(const float p[3]) const
    {
        const glm::vec3 d = glm::vec3(p[0], p[1], p[2]) - center;
        return glm::dot(d, d) <= radius * radius;
    }
};

/// What the middle camera frames of the point that all look at.
ObjectRegion regionOf(const std::vector<OlatSplit>& splits);

/// The plane under the region's centre that most of the points around the object lie on, if there is one. Cameras are above it.
std::optional<glm::vec4> supportingPlane(const std::vector<glm::vec3>& points, const ObjectRegion& region, const std::vector<Camera>& cameras);

/// At most half of them on points of surfaces, the others where surfaces may be that no point tells of: small balls at random in the region, larger ones
/// around it, discs on its plane.
InitialSplats splatsForRegion(const ObjectRegion& region, const std::vector<glm::vec3>& points, size_t count, uint64_t seed);

/// What is cut off an asset, so that only the object is left.
struct ObjectCut {
    std::vector<uint8_t> kept;   // of each splat
    size_t outside = 0;          // of the region
    std::optional<glm::vec4> plane; // that of the region, or found now
    size_t below = 0, loose = 0; // on the plane or below it; neither, but far from the object in small groups
};

ObjectCut findObject(const SplatCloud& cloud, const ObjectRegion& region, const std::vector<Camera>& cameras);

} // namespace nacre
