// An environment map as directional lights.
//
// The sphere is divided into the cells nearest to `count` spherical Fibonacci directions (equal solid angles to within a few
// per cent). Each cell becomes one directional light: irradiance = sum over the cell of radiance x solid angle, so the total
// is that of the map; direction = mean direction of the cell weighted by luminance, so a small bright sun keeps its place; angular
// radius = that of a disc whose directions agree as well as the cell's, so the sun stays sharp and the sky leaves no gaps.
//
// Axes of the map: formats/dataset/environment_map.h; its zenith is the light's directionToLight.
#include "eval/splat_renderer.h"

#include "base/fibonacci_sphere.h"
#include "dataset/environment_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nacre {
namespace {

constexpr double kPi = std::numbers::pi;

/// Nearest of the Fibonacci directions. No point of the sphere is further than 3/sqrt(n) from its nearest direction, and they
/// are ordered by z: only a band of them needs a look.
int nearest(const std::vector<glm::dvec3>& directions, const glm::dvec3& d)
{
    const int n = int(directions.size());
    const double centre = (1.0 - d.z) * 0.5 * n - 0.5, reach = 2.0 + 1.5 * std::sqrt(double(n));
    const int first = std::max(0, int(std::floor(centre - reach))), last = std::min(n - 1, int(std::ceil(centre + reach)));
    int best = first;
    double bestDot = -2.0;
    for (int i = first; i <= last; ++i)
        if (const double dot = glm::dot(directions[size_t(i)], d); dot > bestDot) {
            bestDot = dot;
            best = i;
        }
    return best;
}

double luminance(const glm::dvec3& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; }

} // namespace

Result<std::vector<Light>> expandEnvironment(const Light& light, int count)
{
    if (light.type != LightType::kEnvironment) return std::vector<Light>{light};
    if (count < 1)
        return Error{ErrorCode::kBadInput, "an environment needs at least 1 directional light, got " + std::to_string(count)};
    const Result<Image> map = readEnvironmentMap(light.environmentPath);
    if (!map) return map.error();

    const auto cells = static_cast<size_t>(count);
    std::vector<glm::dvec3> directions, irradiance(cells), weighted(cells);
    for (int i = 0; i < count; ++i) directions.push_back(fibonacciDirection(i, count));

    // A texel that is large next to a cell is shared out among cells through sub-texels of the same radiance.
    const double texels = double(map->width) * map->height;
    const int sub = int(std::clamp(std::ceil(std::sqrt(64.0 * count / texels)), 1.0, 256.0));
    const int rows = map->height * sub, columns = map->width * sub;
    for (int y = 0; y < rows; ++y) {
        const double theta = kPi * (y + 0.5) / rows, sinTheta = std::sin(theta);
        const double solidAngle = 2.0 * kPi / columns * (std::cos(kPi * y / rows) - std::cos(kPi * (y + 1) / rows));
        for (int x = 0; x < columns; ++x) {
            const double phi = kPi - 2.0 * kPi * (x + 0.5) / columns;
            const glm::dvec3 d(sinTheta * std::cos(phi), sinTheta * std::sin(phi), std::cos(theta));
            const float* p = map->pixel(x / sub, y / sub);
            const glm::dvec3 power = glm::max(glm::dvec3(p[0], p[1], p[2]), 0.0) * solidAngle; // filtered maps ring below 0
            const size_t cell = size_t(nearest(directions, d));
            irradiance[cell] += power;
            weighted[cell] += luminance(power) * d;
        }
    }

    const glm::dmat3 worldFromMap = worldFromEnvironment(glm::normalize(glm::dvec3(light.directionToLight)));
    std::vector<Light> lights(cells);
    for (size_t i = 0; i < lights.size(); ++i) {
        const double length = glm::length(weighted[i]);
        lights[i].type = LightType::kDirectional;
        lights[i].directionToLight = glm::vec3(worldFromMap * (length > 0 ? weighted[i] / length : directions[i]));
        const double agreement = length > 0 ? length / luminance(irradiance[i]) : 1; // of a disc: (1 + cos radius) / 2
        lights[i].radius = float(std::acos(std::clamp(2 * agreement - 1, 0.0, 1.0)));
        lights[i].intensity = glm::vec3(irradiance[i] * glm::dvec3(light.intensity));
    }
    return lights;
}

} // namespace nacre
