// Splats in other axes, other units, elsewhere.
#pragma once

#include "base/asset_frame.h"
#include "splats/plain_splats.h"

namespace nacre {

/// Turns positions, Gaussians and what they show. `rotation` is unit. The node's rotation stays as it is.
void rotateSplats(const glm::dquat& rotation, PlainSplats& splats);

/// From asset units to the dataset's.
void placeInDataset(const AssetFrame& frame, SplatCloud& cloud);

} // namespace nacre
