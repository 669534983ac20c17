// Splats that need a channel come first, so that the others need no rows of it.
#pragma once

#include "splats/splat_asset.h"

#include <cstdint>
#include <span>

namespace nacre {

/// A channel that may lead (model_table.h) and is zero for some splats ends with its last splat that is not: splats change places
/// for it, else keep their order. A channel that is zero everywhere is left out. What the asset shows stays the same. At most one
/// channel per model may lead.
void leaveOutZeroRows(SplatAsset& asset);

/// Row i of everything becomes what row order[i] was; rows that `order` does not name are gone. Channels with leading rows: see `leading`, the
/// rows that stay of them come first in `order`.
void reorderSplats(SplatAsset& asset, std::span<const uint32_t> order);

} // namespace nacre
