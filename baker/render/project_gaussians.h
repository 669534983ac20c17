// Projection of many Gaussians: the SIMD twin of projectGaussian (projection.h), equal to it bit for bit.
#pragma once

#include "render/projection.h"

#include <cstdint>
#include <span>

namespace nacre {

/// Writes projected[i] and appends firstIndex + i to `visible` for every Gaussian that can be seen; returns how many.
/// `projected` and `visible` have room for all; projected[i] of what cannot be seen is left alone.
size_t projectGaussians(const View<float>& view, std::span<const GaussianGeometry<float>> splats, uint32_t firstIndex,
                        ProjectedGaussian<float>* projected, uint32_t* visible);

} // namespace nacre
