// Lights of the host and its environment as points: punctual samples in world space, the only lights that models and shaders know. A point
// or spot light is one of them, an area light or an environment several.
#pragma once

#include "nacre/nacre.h"

#include "base/light_sample.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

namespace nacre {

constexpr uint32_t kEnvironmentSource = std::numeric_limits<uint32_t>::max(); // as a source of points

/// A shadow map of the host, copied.
struct ShadowMap {
    int kind = NACRE_SHADOW_MAP_2D;
    uint32_t texture = 0;
    std::vector<glm::dmat4> clipFromWorld; // by layer; cube: none
    glm::dvec3 centre{0};                  // cube: where its faces meet
    float nearPlane = 0, farPlane = 0;     // cube
    bool distances = false, reversed = false, zeroToOne = false;
    float bias = 0, softness = 0;
    uint64_t revision = 0;
    bool operator==(const ShadowMap&) const = default;
};

struct LightPoint {
    bool directional = false;
    glm::dvec3 position{0};          // point: world
    glm::vec3 direction{0, 0, 1};    // directional: unit, towards the light, world
    glm::vec3 intensity{0};          // point: radiant intensity; directional: irradiance
    float capRadius = 0;             // point: 1 / r^2 stops growing inside it
    float sourceRadius = 0;          // of what shines, which widens highlights: a length; directional: an angle
    float range = 0;                 // point: 0: unlimited
    glm::vec3 axis{0};               // point: unit, along which it shines, world; none without emission
    LightEmission emission = kEmitsAround;
    float coneScale = 0, coneOffset = 0;
    uint32_t mask = ~0u;
    uint32_t flags = 0;              // NacreLightFlags
    uint32_t source = 0;             // index among the host's lights, or kEnvironmentSource
    glm::dvec3 centre{0};            // of the area light that it is a part of, and between which distances from there
    float nearest = 0, farthest = std::numeric_limits<float>::infinity(); // it lights an instance: from afar fewer points do
    bool shadowed = false;           // something outside of an instance may hold it up: it has a shadow map or casts shadows of splats
    std::shared_ptr<const ShadowMap> shadowMap; // the same as long as nothing of the map changes
    bool operator==(const LightPoint&) const = default;
};

class LightSet {
public:
    LightSet();
    ~LightSet();
    LightSet(const LightSet&) = delete;

    /// Checked (light_check.h). Points of what stays the same stay the same.
    void setLights(std::span<const NacreLight> lights);
    /// Checked; null: none. Copies what it needs.
    void setEnvironment(const NacreEnvironment* environment);

    /// Those of the lights in their order, then those of the environment.
    const std::vector<LightPoint>& points() const { return points_; }
    /// Another number, a larger one, whenever any point is another one; never 0.
    uint64_t revision() const { return revision_; }
    /// Of each point, the revision with which it became what it is.
    const std::vector<uint64_t>& changedAt() const { return changedAt_; }

private:
    struct Environment;
    void join();

    std::vector<std::shared_ptr<const ShadowMap>> shadowMaps_; // by light
    std::vector<LightPoint> ofLights_, ofEnvironment_, points_;
    std::vector<uint64_t> changedAt_;
    std::unique_ptr<Environment> environment_; // what its directions were made from
    uint64_t revision_ = 1;
};

/// Where an instance stands and what it takes part in.
struct InstancePlace {
    glm::dmat4 assetFromWorld{1};
    float worldScale = 1;                        // world length of one asset unit
    glm::vec3 boundsMin{0}, boundsMax{0};        // of the splat centres, asset space
    uint32_t mask = ~0u;
    bool operator==(const InstancePlace&) const = default;
};

/// One column of an instance's light texture (samplePackedLight).
struct PackedLight {
    glm::vec4 row[kLightRows];
    bool operator==(const PackedLight&) const = default;
};

/// Bounds of what a light gives the places of a box, falloff, cone and window, for any rgb the largest of the intensity.
struct LightBounds {
    double least = 0, most = 0; // most < 0: stands for its area light at other distances than that of the instance
};

struct InstanceLights {
    std::vector<PackedLight> packed;  // of the slots
    std::vector<uint32_t> point;      // per slot: index into LightSet::points()
    size_t skipped = 0;               // points that are left out: they reach nothing of the instance
    uint64_t revision = 0;            // of the set they were made from
    InstancePlace place;
    std::vector<LightBounds> bounds;  // of all points, so that only those that change are looked at
};

/// A point in the space of a place.
PackedLight packPoint(const LightPoint& point, const InstancePlace& place);

/// The lights that matter to an instance. Left out are those of other masks, and those out of range or cone or too faint: all of them
/// together give no place of the box more than kLeastShare of what is left. A light that stays the same keeps its slot; what comes or
/// moves takes the free ones, and the last slots fill the rest. Nothing to do, and false, while set and place stay the same; else whether
/// any slot is another one.
bool packLights(const LightSet& set, const InstancePlace& place, InstanceLights* lights);

constexpr double kLeastShare = 1e-4;      // of all that are left out
constexpr double kLeastShareOfOne = 1e-6; // of each of them

LightBounds boundLight(const PackedLight& light, const InstancePlace& place);

} // namespace nacre
