// What each splat of an asset shows, by which a host can leave out others first (appearance/detail.h).
#pragma once

#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "pack/pack_views.h"
#include "splats/splat_asset.h"

#include <span>

namespace nacre {

/// Writes the channels `importance` and `growth`; those that are there are replaced. `asset` is expanded. Growth is the power of 1 / share that
/// errs least, at a quarter of the splats, against renders of the whole; errors around the object count half. Same result for any number of threads. Errors: of the renders.
Status addImportance(SplatAsset& asset, std::span<const PackView> views);

/// The same for an asset that has none, seen as in `seen`, or from all around if that is null.
Status ensureImportance(SplatAsset& asset, const OlatSplit* seen);

} // namespace nacre
