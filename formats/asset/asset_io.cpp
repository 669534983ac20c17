// The asset's way into bytes, and in and out of files.
#include "asset/asset_io.h"

#include "appearance/coded_channels.h"
#include "appearance/model_table.h"
#include "asset/glb_layout.h"
#include "base/file.h"

#include <algorithm>

namespace nacre {

Result<std::vector<std::byte>> encodeAsset(const SplatAsset& asset)
{
    if (Status s = validate(asset); !s) return s.error();
    return glb::write(asset);
}

Result<SplatAsset> readAsset(const std::string& path)
{
    const Result<std::vector<std::byte>> bytes = readFile(path);
    if (!bytes) return bytes.error();
    Result<SplatAsset> asset = decodeAsset(*bytes);
    if (!asset) return Error{asset.error().code, "'" + path + "': " + asset.error().message};
    expandChannels(*asset);
    return asset;
}

Status writeAsset(const SplatAsset& asset, const std::string& path)
{
    const Result<std::vector<std::byte>> bytes = encodeAsset(asset);
    if (!bytes) return Error{bytes.error().code, "cannot write '" + path + "': " + bytes.error().message};
    return writeFileAtomically(path, *bytes);
}

AssetSummary summarizeAsset(const SplatAsset& asset)
{
    const size_t count = asset.cloud.count;
    const size_t neutralFunctions = size_t(std::max(1, asset.neutral.shFunctions)); // KHR demands degree 0

    AssetSummary summary;
    summary.profile = asset.profile;
    summary.channels.push_back({"geometry", count * sizeof(float) * (3 + 4 + 3 + 1)});
    summary.channels.push_back({"neutralLook", count * sizeof(float) * (3 * neutralFunctions + 4)}); // SH and COLOR_0
    for (const Channel& channel : asset.channels)
        summary.channels.push_back({channel.name, channel.sizeInBytes()});
    return summary;
}

} // namespace nacre
