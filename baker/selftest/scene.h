// What a case of the stability suite draws, and small parts to make scenes of.
#pragma once

#include "base/camera.h"
#include "base/light.h"
#include "base/random.h"
#include "splats/splat_asset.h"

#include <string>
#include <vector>

namespace nacre::selftest {

struct Scene {
    SplatAsset asset;
    Camera camera;                 // in the units of the asset, as are the lights
    std::vector<Light> lights;     // at most four point and directional ones
    bool halfTarget = false;       // into half floats, where colours of splats stop at the largest half
    std::string spoilt, spoiltWith; // of the asset's file, before it is read: these bytes become those; empty: none
};

/// A camera at `eye` that looks at `target`, up +Y; square, `focal` in pixels.
Camera cameraAt(glm::dvec3 eye, glm::dvec3 target = glm::dvec3(0), int size = 33, double focal = 40);
Light pointLight(glm::vec3 position, float intensity, float radius = 0);
Light directionalLight(glm::vec3 towards, float irradiance, float angularRadius = 0);

/// Splats in a ball of radius 0.5 under a lamp, seen from two units away. Coefficients are multiples of 2^-10, which half floats hold, so that
/// what is measured is arithmetic, not storage. `functions`: of s.
Scene bigsScene(size_t count, int functions, uint64_t seed = 1);
/// The same with lobe, forward light, visibility and shadow.
Scene sharpScene(size_t count, int functions, uint64_t seed = 1);
/// The same splats as surfaces; `network`: that also scatter, with codes and shares.
Scene sssScene(size_t count, bool network, uint64_t seed = 1);
/// One splat at the origin, a ball of standard deviation `scale` that sends back `rho` of the light from everywhere.
Scene matteSplat(float scale, float opacity, float rho = 0.5f);

std::vector<float>& channel(Scene& scene, const char* name);
void fill(Scene& scene, const char* name, float value);

inline float between(Random& random, float low, float high) { return low + (high - low) * random.uniform(); }
/// 10^x, x evenly from `low` to `high`.
float powerOfTen(Random& random, float low, float high);
glm::vec3 randomDirection(Random& random);
glm::quat randomRotation(Random& random);

} // namespace nacre::selftest
