// The relightable asset out of .glb bytes (SPEC.md). asset_io.h has the rest: bytes and files both ways.
#pragma once

#include "base/result.h"
#include "splats/splat_asset.h"

#include <cstddef>
#include <span>

namespace nacre {

/// Safe on untrusted input: sizes are checked before allocation, every value is validated. Errors name the part at fault.
Result<SplatAsset> decodeAsset(std::span<const std::byte> bytes);

} // namespace nacre
