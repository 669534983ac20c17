// From codes to values (CodedChannels in splats/splat_asset.h), for who reads channels on the CPU.
#pragma once

#include "splats/splat_asset.h"

namespace nacre {

/// Gives every coded channel its values, or bytes (rounded, 0 to 255); afterwards `asset.coded` is empty. The asset is valid.
void expandChannels(SplatAsset& asset);

/// Of one splat: x[coded.numbers].
void expandRow(const CodedChannels& coded, size_t splat, float* x);

} // namespace nacre
