// Between the two colour spaces that a KHR_gaussian_splatting look may have.
#pragma once

#include "splats/splat_asset.h"

namespace nacre {

/// Fits the same number of functions to the look's colours in sRGB, for viewers that blend display colours. What is fitted is the
/// colour after its clamp at 0.
NeutralLook toSrgb(const NeutralLook& linear);
NeutralLook toLinear(const NeutralLook& srgb);

} // namespace nacre
