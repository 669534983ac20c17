// From a blended G-buffer to an image under up to four lights, and back: sss.h over all pixels.
#pragma once

#include "appearance/trainable.h"

namespace nacre {

/// planes: [kSssSurfaceChannels + kSssLightChannels * lights + 1][height][width], the last alpha. image: [3 * lights +
/// 1][height][width].
void sssResolve(const PixelRays& rays, const LitView& lit, const float* planes, float* image);

/// dPlanes from dImage, same shapes.
void sssResolveBackward(const PixelRays& rays, const LitView& lit, const float* planes, const float* dImage, float* dPlanes);

} // namespace nacre
