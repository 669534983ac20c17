// Transmittance along rays through Gaussians, traced with Embree: what splat/light_visibility.h draws, without its images. Slow;
// it is what faster ways to visibility are measured against.
#pragma once

#include "render/projection.h"

#include <glm/glm.hpp>

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace nacre {

/// A Gaussian made ready for rays. It ends where its alpha falls below kMinAlpha: on the
/// ellipsoid |toLocal (x - center)|^2 = reach.
struct RayGaussian {
    float center[3];
    float toLocal[9]; // rows: the local axes divided by the standard deviations
    float opacity, reach;
};

/// Splats that are too faint to count at all, or not finite, are left out: false.
bool prepareRayGaussian(const GaussianGeometry<float>& g, RayGaussian& out);

/// Largest alpha on the ray origin + t direction, t >= 0; 0 if below kMinAlpha.
double alphaOnRay(const RayGaussian& g, const glm::vec3& origin, const glm::vec3& direction);

/// All member functions may be called from any number of threads, allocate nothing and give the same bits whatever the order in
/// which Gaussians are met.
class GaussianRayScene {
public:
    /// Copies the splats. Their scales must not be NaN.
    explicit GaussianRayScene(std::span<const GaussianGeometry<float>> splats);
    ~GaussianRayScene();
    GaussianRayScene(const GaussianRayScene&) = delete;
    GaussianRayScene& operator=(const GaussianRayScene&) = delete;

    /// Product of 1 - alphaOnRay over the Gaussians whose centres lie more than `bias` ahead of the origin along the unit
    /// direction; 0 where it is below kMinTransmittance. Origins much farther away than the scene is large may miss the rims of
    /// Gaussians.
    float transmittance(const glm::vec3& origin, const glm::vec3& direction, float bias) const;

    /// From a splat's centre to infinity with the bias of lightVisibility, which leaves out the splat itself and the surface
    /// around it.
    float transmittanceFrom(size_t splat, const glm::vec3& direction) const;

    /// The scalar reference of transmittance: asks every Gaussian.
    float transmittanceReference(const glm::vec3& origin, const glm::vec3& direction, float bias) const;

    struct Box {
        glm::vec3 lower, upper;
    };
    Box box() const; // around all ellipsoids

    size_t count() const;
    float bias() const; // visibilityBias

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// transmittanceFrom as [which][direction]. Directions are unit.
std::vector<float> traceVisibility(const GaussianRayScene& scene, std::span<const uint32_t> which,
                                   std::span<const glm::vec3> directions);

/// Maps like those of lightVisibility, of some splats or of all. Deterministic for any number of threads.
std::vector<uint8_t> embreeVisibility(const GaussianRayScene& scene, std::span<const uint32_t> which, int size, int oversample);
std::vector<uint8_t> embreeVisibility(std::span<const GaussianGeometry<float>> splats, int size, int oversample);

constexpr int kVisibilityShFunctions = 16; // degree 3

struct VisibilityShFit {
    std::vector<std::array<float, kVisibilityShFunctions>> coefficients; // order and sign of spherical_harmonics.h
    std::vector<float> rmsError; // per splat over the directions, of the fit clamped to [0, 1]
};

/// Least squares over the directions (unit, 16 or more, spread over the sphere) for each row of values [splat][direction].
VisibilityShFit fitVisibilitySh3(std::span<const glm::vec3> directions, std::span<const float> values);

/// The fit towards a unit direction, clamped to [0, 1].
float evaluateVisibilitySh3(const std::array<float, kVisibilityShFunctions>& coefficients, const glm::vec3& direction);

} // namespace nacre
