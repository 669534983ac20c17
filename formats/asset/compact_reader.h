// The profile `compact` out of a parsed .glb (compact.h), and what profile interop shares with it. Of glb_reader.cpp only; faults are thrown as there.
#pragma once

#include "asset/glb_json.h"
#include "splats/splat_asset.h"

namespace nacre::glb {

/// Channels without values, as the model knows them: their sizes are safe to allocate for.
std::vector<Channel> declaredChannels(const json& relight, const std::string& model, size_t count);
/// 0, 16 or 32 texels.
int drawnVisibility(const json& relight);

/// Fills cloud, channels, coded and drawnVisibility; asset.model is set.
void readCompact(const json& document, std::span<const std::byte> bin, const json& relight, size_t count, SplatAsset& asset);

} // namespace nacre::glb
