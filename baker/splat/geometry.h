// The trainable geometry of all splats: raw parameters with Adam state, and the activated values that projection reads.
#pragma once

#include "render/projection.h"
#include "render/reference_raster.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

// position 3, log scale 3, quaternion (w, x, y, z) 4, opacity logit 1
constexpr int kGeometryParameters = 11;
using GeometryRow = std::array<float, kGeometryParameters>;

struct GeometryRates {
    float position = 0, scale = 0, rotation = 0, opacity = 0;
};

struct SplatGeometry {
    std::vector<GeometryRow> raw, momentum, second;
    std::vector<GaussianGeometry<float>> activated;

    size_t count() const { return raw.size(); }
    void resize(size_t count);
    /// Recomputes activated[i] from raw[i] and keeps raw inside its bounds. The same arithmetic as in stepGeometry, to the bit.
    void activate(size_t i);
    void clearMoments(size_t i);
    void permute(std::span<const uint32_t> order);
};

constexpr float kMaxOpacityLogit = 8.0f;
constexpr float kMinLogScale = -12.0f, kMaxLogScale = 3.0f;

float logit(float opacity);

struct GeometryAdam {
    static constexpr float kBeta1 = 0.9f, kBeta2 = 0.99f, kEpsilon = 1e-15f;
    static constexpr float kMaxGradient = 1e18f; // NaN, or its square would overflow: the parameter sits out the step
    float rate[kGeometryParameters];             // with the correction of the momentum's start
    float correction2;
    GeometryAdam(const GeometryRates& rates, int step);
};

/// One Adam step of the visible splats with active[visible] != 0, from their screen-space gradients.
/// `dDistance`, per visible splat, is the gradient of what is blended of its centre's distance from the eye; nullptr: nothing is.
/// `opacityPull` is added to the gradient of every active opacity (a small positive value fades splats nobody needs).
void stepGeometry(SplatGeometry& geometry, const View<float>& view, std::span<const uint32_t> splatFromVisible,
                  const ScreenGradient<float>* dSplats, const float* dDistance, const uint8_t* active, const GeometryRates& rates,
                  int step, float opacityPull);

/// The scalar references of the above, for one splat.
void activateReference(GeometryRow& raw, GaussianGeometry<float>& activated);
void stepSplatReference(SplatGeometry& geometry, size_t splat, const View<float>& view, const ScreenGradient<float>& dSplat,
                        float dDistance, const GeometryAdam& adam, float opacityPull);

} // namespace nacre
