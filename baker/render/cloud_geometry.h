// The splats of an asset as the rasteriser takes them.
#pragma once

#include "render/projection.h"
#include "splats/splat_asset.h"

#include <vector>

namespace nacre {

inline std::vector<GaussianGeometry<float>> geometryOf(const SplatCloud& cloud)
{
    std::vector<GaussianGeometry<float>> geometry(cloud.count);
    for (size_t i = 0; i < cloud.count; ++i) {
        const glm::vec3 &p = cloud.positions[i], &s = cloud.scales[i];
        const glm::quat& q = cloud.rotations[i];
        geometry[i] = {{p.x, p.y, p.z}, {s.x, s.y, s.z}, {q.w, q.x, q.y, q.z}, cloud.opacities[i]};
    }
    return geometry;
}

} // namespace nacre
