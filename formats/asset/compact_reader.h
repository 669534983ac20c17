// The profile `compact` out of a parsed .glb (compact.h). Of glb_reader.cpp only; faults are thrown as there.
#pragma once

#include "asset/glb_json.h"
#include "splats/splat_asset.h"

namespace nacre::glb {

/// Fills cloud, channels, coded and drawnVisibility; asset.model is set.
void readCompact(const json& document, std::span<const std::byte> bin, const json& relight, size_t count, SplatAsset& asset);

} // namespace nacre::glb
