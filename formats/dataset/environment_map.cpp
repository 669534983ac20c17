#include "dataset/environment_map.h"

#include "interchange/exr.h"

#include <cmath>
#include <cstdlib>

namespace nacre {

Status checkEnvironmentSize(int width, int height, const std::string& name)
{
    // 1 %: maps cropped or padded by a few pixels are still maps; the layouts below are far from it.
    if (std::abs(width - 2 * height) <= 0.01 * width + 1) return ok();
    const auto is = [&](int w, int h) { return std::abs(double(width) * h - double(height) * w) <= 0.01 * double(width) * h; };
    const char* layout = is(1, 6) || is(6, 1) ? ": the six faces of a cube map"
                         : is(3, 4) || is(4, 3) ? ": a cross of cube faces"
                         : is(2, 3) || is(3, 2) ? ": the faces of a cube map in two rows"
                         : is(1, 1) ? ": a light probe (mirror ball, angular or octahedral map), or one face of a cube map" : "";
    return Error{ErrorCode::kBadInput, name + ": " + std::to_string(width) + " x " + std::to_string(height) + " pixels" + layout +
                                           "; expected an environment map in latitude-longitude layout, twice as wide as high; convert it"};
}

Result<Image> readEnvironmentMap(const std::string& path)
{
    const Result<Image> size = readExrSize(path);
    if (!size) return size.error();
    if (Status s = checkEnvironmentSize(size->width, size->height, path); !s) return s.error();
    return readExr(path);
}

glm::dmat3 worldFromEnvironment(const glm::dvec3& zenith)
{
    if (zenith.z < -1 + 1e-9) return {1, 0, 0, 0, -1, 0, 0, 0, -1}; // straight down: no shortest way, so about +X
    // Rodrigues with axis +Z x zenith: R = 1 + [v] + [v]^2 / (1 + cos)
    const glm::dvec3 v(-zenith.y, zenith.x, 0);
    const glm::dmat3 cross(0, v.z, -v.y, -v.z, 0, v.x, v.y, -v.x, 0); // columns
    return glm::dmat3(1.0) + cross + cross * cross * (1 / (1 + zenith.z));
}

} // namespace nacre
