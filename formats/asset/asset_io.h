// The relightable asset as a .glb (SPEC.md): KHR_gaussian_splatting attributes for a neutral look, and the relighting
// channels in the vendor extension NACRE_gaussian_splatting_relight nested in it.
#pragma once

#include "asset/asset_decode.h"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace nacre {

/// Serialises as the `lossless` profile: float32 throughout, deterministic bytes.
Result<std::vector<std::byte>> encodeAsset(const SplatAsset& asset);

/// Profile `interop`: any viewer of KHR_gaussian_splatting shows the neutral look, which the asset must have; relighting data are attributes
/// of the splats, which survive tools that reorder or crop these. Visibility maps are left out and drawn again from the splats.
Result<std::vector<std::byte>> encodeInterop(const SplatAsset& asset);

/// The same file with these presets instead of those it has; of any profile, nothing else of it is touched. Errors as decodeAsset, and presets
/// that are not valid.
Result<std::vector<std::byte>> withPresets(std::span<const std::byte> file, std::span<const Preset> presets);

/// Coded channels are expanded.
Result<SplatAsset> readAsset(const std::string& path);

/// Appears atomically: written under a temporary name, flushed, then renamed. Nothing is left behind on failure.
Status writeAsset(const SplatAsset& asset, const std::string& path);

/// What `nacre info ASSET` prints.
struct AssetSummary {
    struct ChannelBytes { std::string name; size_t bytes; };
    std::string profile;
    std::vector<ChannelBytes> channels; // geometry, neutral look and every model channel; of profile compact: blocks, as stored
};
/// `file`: the bytes that `asset` was read from; may be empty for one that would be written losslessly.
AssetSummary summarizeAsset(const SplatAsset& asset, std::span<const std::byte> file = {});

} // namespace nacre
