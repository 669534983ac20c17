// From what the host says to points.
//
// A sphere that shines alike in all directions looks the same from everywhere outside as a ball of mist with the emission
// 1 / sqrt(R^2 - r^2): any ray through it collects as much. So its points lie inside of it and shine all around, on shells that Gauss'
// rule for this density gives: r = R cos((2k - 1) pi / (4m + 2)), k = 1..m, each with a share in proportion to r^2. A rectangle's lie on a
// grid and shine to one side with the cosine. Of both, each point is as wide as its part of what shines, so that highlights leave no gaps.
#include "light_set.h"

#include "light_check.h"

#include "appearance/environment_directions.h"
#include "base/fibonacci_sphere.h"
#include "base/spherical_harmonics.h"

#include <glm/gtc/type_ptr.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nacre {

namespace {

constexpr int kEnvironmentDirections = 64;

/// How many points an area light has in instances up to so many of its radii away, which leave about 50 dB between it and very many.
struct Level {
    int points;
    float farthest;
};
constexpr float kAnywhere = std::numeric_limits<float>::infinity();
constexpr Level kLevels[] = {{24, 4}, {12, 10}, {6, 40}, {1, kAnywhere}};

constexpr int kShColumns = 128; // of the map that coefficients become; degree 4 has waves of 90 degrees

glm::vec3 vec(const float v[3]) { return {v[0], v[1], v[2]}; }

std::shared_ptr<const ShadowMap> copyShadowMap(const NacreLight& light)
{
    if (!light.shadowMap) return nullptr;
    const NacreShadowMap m = wholeShadowMap(*light.shadowMap);
    ShadowMap copy;
    copy.kind = m.kind;
    copy.texture = m.texture;
    const bool cube = copy.kind == NACRE_SHADOW_MAP_CUBE;
    const uint32_t layers = cube ? 0 : copy.kind == NACRE_SHADOW_MAP_ARRAY ? m.layers : 1;
    for (uint32_t k = 0; k < layers; ++k) copy.clipFromWorld.emplace_back(glm::make_mat4(m.clipFromWorld + 16 * k));
    if (cube) copy.centre = vec(light.position), copy.nearPlane = m.nearPlane, copy.farPlane = m.farPlane, copy.distances = m.distances != 0;
    copy.reversed = m.reversed != 0, copy.zeroToOne = m.zeroToOne != 0;
    copy.bias = m.bias, copy.softness = m.softness;
    copy.revision = m.revision;
    return std::make_shared<const ShadowMap>(std::move(copy));
}

LightPoint commonPoint(const NacreLight& light, uint32_t index, const std::shared_ptr<const ShadowMap>& map)
{
    LightPoint p;
    p.position = vec(light.position);
    if (light.type != NACRE_LIGHT_DIRECTIONAL) p.centre = p.position;
    p.intensity = vec(light.intensity);
    p.range = light.range;
    p.mask = light.mask ? light.mask : ~0u;
    p.flags = light.flags;
    p.source = index;
    p.shadowMap = map;
    p.shadowed = map || (light.flags & NACRE_LIGHT_SPLAT_SHADOWS);
    return p;
}

LightPoint directionalPoint(const NacreLight& light, LightPoint p)
{
    p.directional = true;
    p.position = glm::dvec3(0);
    p.range = 0;
    p.direction = glm::normalize(vec(light.direction));
    p.sourceRadius = light.radius;
    return p;
}

LightPoint spotPoint(const NacreLight& light, LightPoint p)
{
    p.axis = glm::normalize(vec(light.direction));
    p.emission = kEmitsCone;
    const float outer = std::cos(light.outerCone);
    p.coneScale = 1.0f / std::max(0.001f, std::cos(light.innerCone) - outer); // the bound is KHR_lights_punctual's
    p.coneOffset = -outer * p.coneScale;
    return p;
}

void addSphere(const NacreLight& light, const LightPoint& common, int count, std::vector<LightPoint>& points)
{
    const double radius = light.radius;
    const int shells = count <= 32 ? 1 : count <= 256 ? 2 : 3;
    const auto share = [&](int k) { return std::pow(std::cos((2 * k - 1) * std::numbers::pi / (4 * shells + 2)), 2) * 4 / (2 * shells + 1); };
    for (int k = 1, left = count; k <= shells; ++k) {
        const int n = k == shells ? left : int(std::round(share(k) * count));
        left -= n;
        for (int i = 0; i < n; ++i) {
            LightPoint p = common;
            if (count > 1) p.position += radius * std::cos((2 * k - 1) * std::numbers::pi / (4 * shells + 2)) * fibonacciDirection(i, n);
            p.intensity *= float(share(k) / n);
            p.sourceRadius = float(radius / std::sqrt(count));
            p.capRadius = float(count > 1 ? 2 * radius / std::sqrt(count) : radius);
            points.push_back(p);
        }
    }
}

void addRectangle(const NacreLight& light, const LightPoint& common, int count, std::vector<LightPoint>& points)
{
    const glm::dvec3 axis = glm::normalize(glm::dvec3(vec(light.direction)));
    const glm::dvec3 given = vec(light.halfWidth), width = given - glm::dot(given, axis) * axis;
    const glm::dvec3 height = glm::normalize(glm::cross(axis, width)) * double(light.halfHeight);
    const double aspect = glm::length(width) / light.halfHeight;
    const int rows = int(std::clamp(std::round(std::sqrt(count / aspect)), 1.0, double(count))), columns = count / rows;
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x) {
            LightPoint p = common;
            p.position += width * ((2 * x + 1.0) / columns - 1) + height * ((2 * y + 1.0) / rows - 1);
            p.intensity /= float(columns * rows);
            p.axis = axis;
            p.emission = kEmitsCosine;
            p.coneScale = 1;
            p.capRadius = p.sourceRadius = float(std::sqrt(4 * glm::length(width) * light.halfHeight / (std::numbers::pi * columns * rows)));
            points.push_back(p);
        }
}

void addArea(const NacreLight& light, LightPoint p, std::vector<LightPoint>& points)
{
    const bool sphere = light.type == NACRE_LIGHT_SPHERE;
    const auto add = sphere ? addSphere : addRectangle;
    if (light.samples) return add(light, p, int(light.samples), points);
    const float radius = sphere ? light.radius : std::hypot(glm::length(vec(light.halfWidth)), light.halfHeight);
    for (const Level& level : kLevels) {
        p.farthest = level.farthest * radius;
        add(light, p, level.points, points);
        p.nearest = p.farthest;
    }
}

void addLight(const NacreLight& light, uint32_t index, const std::shared_ptr<const ShadowMap>& map, std::vector<LightPoint>& points)
{
    LightPoint p = commonPoint(light, index, map);
    switch (light.type) {
    case NACRE_LIGHT_POINT: p.capRadius = light.radius, points.push_back(p); break;
    case NACRE_LIGHT_SPOT: p.capRadius = light.radius, points.push_back(spotPoint(light, p)); break;
    case NACRE_LIGHT_DIRECTIONAL: points.push_back(directionalPoint(light, p)); break;
    case NACRE_LIGHT_SPHERE:
    case NACRE_LIGHT_RECTANGLE: addArea(light, p, points); break;
    }
}

/// From the axes of environmentCells (zenith +Z, middle +X) to the host's (zenith +Y, middle -Z).
glm::dvec3 hostDirection(const glm::dvec3& d) { return {-d.y, d.z, -d.x}; }

/// Radiance of the coefficients as a map. Series ring below 0, where environmentCells counts them as none.
std::vector<float> mapOfSh(const float* sh, uint32_t count)
{
    std::vector<float> pixels;
    for (int y = 0; y < kShColumns / 2; ++y)
        for (int x = 0; x < kShColumns; ++x) {
            const double theta = std::numbers::pi * (y + 0.5) / (kShColumns / 2), phi = std::numbers::pi - 2 * std::numbers::pi * (x + 0.5) / kShColumns;
            const glm::dvec3 d = hostDirection({std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)});
            double basis[kMaxShFunctions];
            shBasis(int(count), d.x, d.y, d.z, basis);
            for (uint32_t c = 0; c < 3; ++c) {
                double radiance = 0;
                for (uint32_t i = 0; i < count; ++i) radiance += double(sh[3 * i + c]) * basis[i];
                pixels.push_back(float(radiance));
            }
        }
    return pixels;
}

} // namespace

struct LightSet::Environment {
    int count = 0;
    std::vector<EnvironmentCell> cells;
    std::vector<EnvironmentDirection> directions;
};

LightSet::LightSet() = default;
LightSet::~LightSet() = default;

void LightSet::setLights(std::span<const NacreLight> lights)
{
    ofLights_.clear();
    shadowMaps_.resize(lights.size());
    for (size_t i = 0; i < lights.size(); ++i) {
        std::shared_ptr<const ShadowMap> map = copyShadowMap(lights[i]), &known = shadowMaps_[i];
        if (!map || !known || !(*map == *known)) known = std::move(map);
        addLight(lights[i], uint32_t(i), known, ofLights_);
    }
    join();
}

void LightSet::setEnvironment(const NacreEnvironment* e)
{
    ofEnvironment_.clear();
    if (e) {
        const int count = e->directions ? int(e->directions) : kEnvironmentDirections;
        std::vector<float> map;
        if (e->sh) map = mapOfSh(e->sh, e->shCount);
        std::vector<EnvironmentCell> cells = e->sh ? environmentCells(map.data(), kShColumns, kShColumns / 2, 3, count)
                                                   : environmentCells(e->pixels, e->width, e->height, 3, count);
        if (!environment_ || environment_->count != count || environment_->cells != cells) {
            environment_ = std::make_unique<Environment>();
            environment_->directions = environmentDirections(cells, count);
            environment_->cells = std::move(cells);
            environment_->count = count;
        }
        glm::dmat3 worldFromMap(1.0);
        if (std::any_of(e->worldFromMap, e->worldFromMap + 9, [](float x) { return x != 0; }))
            for (int c = 0; c < 3; ++c) worldFromMap[c] = vec(e->worldFromMap + 3 * c);
        const double intensity = e->intensity > 0 ? e->intensity : 1;
        for (const EnvironmentDirection& d : environment_->directions) {
            LightPoint p;
            p.directional = true;
            p.direction = glm::normalize(worldFromMap * hostDirection(d.direction));
            p.intensity = d.irradiance * intensity;
            p.sourceRadius = float(d.angularRadius);
            p.mask = e->mask ? e->mask : ~0u;
            p.source = kEnvironmentSource;
            ofEnvironment_.push_back(p);
        }
    } else {
        environment_.reset();
    }
    join();
}

void LightSet::join()
{
    std::vector<LightPoint> now = ofLights_;
    now.insert(now.end(), ofEnvironment_.begin(), ofEnvironment_.end());
    if (now == points_) return;
    ++revision_;
    changedAt_.resize(now.size(), revision_);
    for (size_t i = 0; i < std::min(now.size(), points_.size()); ++i)
        if (!(now[i] == points_[i])) changedAt_[i] = revision_;
    points_ = std::move(now);
}

} // namespace nacre
