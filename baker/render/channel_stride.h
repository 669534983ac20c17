// The layout in which appearance models hand channels to the rasteriser.
#pragma once

namespace nacre {

/// Floats per visible splat in the arrays of channels: room for one more than the channels, in whole vectors.
constexpr int channelStride(int channels) { return channels < 16 ? 16 : 32; }

} // namespace nacre
