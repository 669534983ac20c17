// Splats that need a channel come first, so that the others need no rows of it.
#pragma once

#include "splats/reorder.h"

namespace nacre {

/// A channel that may lead (model_table.h) and is zero for some splats ends with its last splat that is not: splats change places
/// for it, else keep their order. A channel that is zero everywhere is left out. What the asset shows stays the same. At most one
/// channel per model may lead.
void leaveOutZeroRows(SplatAsset& asset);

} // namespace nacre
