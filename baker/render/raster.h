// Fast CPU backend of reference_raster.h: Highway SIMD over pixels, oneTBB over tiles, several lights of one view as channels of one pass.
// Planes are row-major [channel][height][width]; the plane after the last channel is alpha. Deterministic for any thread count:
// every (splat, tile) pair owns its gradient row and the rows of one splat are added in tile order.
#pragma once

#include "render/channel_stride.h"
#include "render/reference_raster.h"
#include "render/tiles.h"

#include <vector>

namespace nacre {

constexpr int kMaxChannels = 26;  // a G-buffer of ten and four lights of four

/// `channels` is 3 or 4 per light of up to four, the latter with a G-buffer of ten: 3, 6, 9, 12, 14, 18, 22 or 26. colors is
/// [visible][channelStride]; writes channels + 1 planes.
void rasterForward(const VisibleSplats& visible, const TileLists& tiles, const float* colors, int channels, float* planes);

struct RasterScratch {
    std::vector<float> pairGradients; // [entry][channelStride + 8]
};

/// `planes` as written by rasterForward, dPlanes the loss gradient of the same shape. Overwrites dColors [visible][channelStride] and
/// dSplats [visible].
void rasterBackward(const VisibleSplats& visible, const TileLists& tiles, const float* colors, int channels, const float* planes,
                    const float* dPlanes, RasterScratch& scratch, float* dColors, ScreenGradient<float>* dSplats);

} // namespace nacre
