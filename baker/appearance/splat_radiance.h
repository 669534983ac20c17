// What a splat sends out in fixed directions under fixed lights: what a model has to tell for the look of an asset in viewers that cannot
// relight (pack/neutral_look.h). One implementation per model of appearance/models.h.
#pragma once

#include "appearance/models.h"
#include "base/spherical_harmonics.h"
#include "splats/splat_asset.h"

#include <array>
#include <functional>
#include <span>

namespace nacre {

constexpr int kRadianceDirections = 64;
constexpr size_t kMaxRadianceLights = 64;

/// The same for all splats.
struct ViewDirections {
    std::array<std::array<float, 3>, kRadianceDirections> toCamera;            // unit
    std::array<std::array<float, kMaxShFunctions>, kRadianceDirections> yView; // its SH
};

/// A light as a splat sees it.
struct IncidentLight {
    glm::vec3 direction;  // unit, towards the light
    glm::vec3 irradiance; // facing the light
};

using SplatRadiance = std::array<glm::dvec3, kRadianceDirections>; // under the sum of the lights

struct RadianceSampler {
    size_t lights = 0; // under how many to sample: as many as take seconds, at most kMaxRadianceLights
    std::function<void(size_t splat, std::span<const IncidentLight> lights, const ViewDirections& views, SplatRadiance& radiance)> sample;
};

#define NACRE_MODEL(name) \
    namespace name { RadianceSampler makeRadianceSampler(const SplatAsset& asset); }
NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL

/// Of the asset's model. `asset`, which is valid, must outlive it.
RadianceSampler makeRadianceSampler(const SplatAsset& asset);

} // namespace nacre
