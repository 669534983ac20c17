// The trainable geometry of all splats: raw parameters with Adam state, and the activated values that projection reads.
#pragma once

#include "splat/geometry_row.h"

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

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

float logit(float opacity);

/// One Adam step of the visible splats with active[visible] != 0, from their screen-space gradients.
/// `dDistance`, per visible splat, is the gradient of what is blended of its centre's distance from the eye; nullptr: nothing is.
/// `opacityPull` is added to the gradient of every active opacity (a small positive value fades splats nobody needs).
void stepGeometry(SplatGeometry& geometry, const View<float>& view, std::span<const uint32_t> splatFromVisible,
                  const ScreenGradient<float>* dSplats, const float* dDistance, const uint8_t* active, const GeometryRates& rates,
                  int step, float opacityPull);

} // namespace nacre
