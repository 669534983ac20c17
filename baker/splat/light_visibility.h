// How much light reaches each splat from each direction, through all other splats: the `visibility` channel of bigs.
#pragma once

#include "appearance/splat_visibility.h"
#include "appearance/visibility_map.h"
#include "base/octahedral.h"
#include "render/projection.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace nacre {

/// Octahedral maps [splat][size][size] (bigs.h: mapVisibility) of the transmittance from the splat to infinity, 255 = all light arrives,
/// each texel the mean over oversample^2 directions. Of `lights` those among the splats (within the sphere around their box) are seen as far
/// as they are: towards them the texels hold the transmittance up to the light, for what lies behind a lamp shades nothing under it. What lies nearer than a few splat sizes does not count: a surface does not shade
/// itself, T_dir holds that. Deterministic for any number of threads. Time: size^2 oversample^2 passes over all splats; `goOn` is asked
/// now and then from the calling thread, and empty maps come back once it says no. Resolved are the 98 % of the splats in the middle, and
/// as much again around them; the few that lie farther away get all light and cast no shadow.
std::vector<uint8_t> lightVisibility(std::span<const GaussianGeometry<float>> splats, int size, int oversample,
                                     std::span<const glm::vec3> lights = {}, const std::function<bool()>& goOn = {});

/// Draws maps as lightVisibility does, elsewhere.
using VisibilityDrawer = std::function<std::vector<uint8_t>(std::span<const GaussianGeometry<float>> splats, int size, int oversample, std::span<const glm::vec3> lights)>;

/// The same of the splats inside a ball (centre and radius) alone: the others get all light and cast no shadow. Radius 0: of all. With a drawer,
/// `goOn` is not asked.
std::vector<uint8_t> lightVisibilityWithin(const glm::vec4& ball, std::span<const GaussianGeometry<float>> splats, int size, int oversample,
                                           std::span<const glm::vec3> lights = {}, const std::function<bool()>& goOn = {}, const VisibilityDrawer& drawer = {});

ShadowScene shadowScene(std::span<const GaussianGeometry<float>> splats);
/// The lights within the sphere around the splats' box; of very many some, evenly.
std::vector<glm::vec3> lightsAmong(const ShadowScene& scene, std::span<const glm::vec3> lights);

/// The four texels that a splat looks up towards a light. False if it is so near that nothing is between them.
NACRE_HD inline bool texelsTowards(const glm::vec3& toLight, float bias, int size, int out[4])
{
    if (!(glm::length(toLight) > bias)) return false;
    const glm::vec2 place = 0.5f * float(size) * (octahedralCoordinates(glm::normalize(toLight)) + 1.0f) - 0.5f; // from the first texel's centre
    const int x = int(std::floor(place.x)), y = int(std::floor(place.y));
    for (int j = 0; j < 4; ++j) out[j] = visibilityTexel(x + j % 2, y + j / 2, size);
    return true;
}

/// Along the light, centres of other splats nearer to a splat's own than this shade nothing.
float visibilityBias(std::span<const GaussianGeometry<float>> splats);

/// drawVisibility on all cores.
void drawVisibilityInParallel(SplatAsset& asset);

} // namespace nacre
