// One splat's trainable geometry: how raw parameters are activated, and its Adam step. Scalar reference, host and device.
#pragma once

#include "base/host_device.h"
#include "render/reference_raster.h"

#include <array>
#include <cmath>

namespace nacre {

// position 3, log scale 3, quaternion (w, x, y, z) 4, opacity logit 1
constexpr int kGeometryParameters = 11;
using GeometryRow = std::array<float, kGeometryParameters>;

struct GeometryRates {
    float position = 0, scale = 0, rotation = 0, opacity = 0;
};

constexpr float kMaxOpacityLogit = 8.0f;
constexpr float kMinLogScale = -12.0f, kMaxLogScale = 3.0f;

struct GeometryAdam {
    static constexpr float kBeta1 = 0.9f, kBeta2 = 0.99f, kEpsilon = 1e-15f;
    static constexpr float kMaxGradient = 1e18f; // NaN, or its square would overflow: the parameter sits out the step
    float rate[kGeometryParameters];             // with the correction of the momentum's start
    float correction2;
    GeometryAdam(const GeometryRates& rates, int step);
};

/// Keeps raw inside its bounds.
NACRE_HD inline void activateReference(GeometryRow& r, GaussianGeometry<float>& g)
{
    const auto clamp = [](float x, float least, float most) { return x < least ? least : most < x ? most : x; }; // by value: constants have no address on a device
    for (int k = 3; k < 6; ++k) r[k] = clamp(r[k], kMinLogScale, kMaxLogScale);
    r[10] = clamp(r[10], -kMaxOpacityLogit, kMaxOpacityLogit);
    float unit[4];
    if (detail::normalizeQuaternion(&r[6], unit) == 0.0f) // a lost rotation starts again
        for (int k = 0; k < 4; ++k) r[6 + k] = unit[k];
    for (int k = 0; k < 3; ++k) g.position[k] = r[k], g.scale[k] = std::exp(r[3 + k]);
    for (int k = 0; k < 4; ++k) g.rotation[k] = r[6 + k];
    g.opacity = 1.0f / (1.0f + std::exp(-r[10]));
}

/// From the gradient on the screen. `dDistance` and `opacityPull` as stepGeometry (splat/geometry.h).
NACRE_HD inline void stepSplatReference(GeometryRow& raw, GeometryRow& momentum, GeometryRow& second, GaussianGeometry<float>& activated,
                                        const View<float>& view, const ScreenGradient<float>& dSplat, float dDistance, const GeometryAdam& adam,
                                        float opacityPull)
{
    const GaussianGeometry<float>& g = activated;
    GaussianGeometry<float> d{};
    projectGaussianBackward(view, g, dSplat.mean, dSplat.conic, dSplat.opacity, dDistance, d);
    d.opacity += opacityPull;
    const float gradient[kGeometryParameters] = {
        d.position[0], d.position[1], d.position[2], d.scale[0] * g.scale[0], d.scale[1] * g.scale[1], d.scale[2] * g.scale[2],
        d.rotation[0], d.rotation[1], d.rotation[2], d.rotation[3], d.opacity * g.opacity * (1.0f - g.opacity)};
    for (int k = 0; k < kGeometryParameters; ++k) {
        if (!(std::abs(gradient[k]) < GeometryAdam::kMaxGradient)) continue;
        float &m = momentum[k], &s = second[k];
        m += (1.0f - GeometryAdam::kBeta1) * (gradient[k] - m);
        s += (1.0f - GeometryAdam::kBeta2) * (gradient[k] * gradient[k] - s);
        raw[k] -= adam.rate[k] * m / (std::sqrt(s * adam.correction2) + GeometryAdam::kEpsilon);
    }
    activateReference(raw, activated);
}

} // namespace nacre
