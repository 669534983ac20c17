// Splats in another order, or fewer of them.
#pragma once

#include "splats/splat_asset.h"

#include <cstdint>
#include <span>

namespace nacre {

/// Row i of everything becomes what row order[i] was; rows that `order` does not name are gone. Channels with leading rows: see `leading`, the
/// rows that stay of them come first in `order`; a channel of which none stays goes. Codes of channels must have been expanded.
void reorderSplats(SplatAsset& asset, std::span<const uint32_t> order);

} // namespace nacre
