// The asset's way into bytes, and in and out of files.
#include "asset/asset_io.h"

#include "appearance/coded_channels.h"
#include "appearance/model_table.h"
#include "appearance/splat_visibility.h"
#include "appearance/visibility_map.h"
#include "asset/glb_json.h"
#include "asset/glb_layout.h"
#include "asset/look_color.h"
#include "base/glb_container.h"
#include "base/file.h"

#include <algorithm>

namespace nacre {

Result<std::vector<std::byte>> encodeAsset(const SplatAsset& asset)
{
    if (Status s = validate(asset); !s) return s.error();
    if (asset.coded.empty() && asset.drawnVisibility == 0) return glb::write(asset);
    SplatAsset full = asset;
    expandChannels(full), drawVisibility(full);
    return glb::write(full);
}

Result<std::vector<std::byte>> encodeInterop(const SplatAsset& asset)
{
    if (Status s = validate(asset); !s) return s.error();
    if (asset.neutral.shFunctions == 0) return Error{ErrorCode::kBadInput, "the asset has no neutral look, which other viewers show; fit one first"};
    SplatAsset out = asset;
    out.neutral = toSrgb(asset.neutral);
    const std::vector<std::string> maps{"visibility"};
    for (const CodedChannels& coded : out.coded) {
        const bool some = coded.values.size() != out.cloud.count * coded.codes; // rows of some splats only: codes of none would stand for the offset
        const bool mixed = coded.channels != maps && std::ranges::count(coded.channels, maps[0]) > 0;
        if (some || mixed || coded.codes > 4 * coded.numbers) { // the last: floats would be smaller
            expandChannels(out);
            break;
        }
    }
    if (const Channel* channel = out.find(maps[0].c_str())) {
        out.drawnVisibility = visibilitySize(channel->components);
        std::erase_if(out.channels, [&](const Channel& c) { return c.name == maps[0]; });
        std::erase_if(out.coded, [&](const CodedChannels& c) { return c.channels == maps; });
    }
    for (Channel& channel : out.channels) {
        if (!channel.bytes.empty()) return Error{ErrorCode::kUnsupported, "profile interop cannot store the channel '" + channel.name + "' of bytes"};
        if (channel.leading > 0) channel.leading = 0, channel.values.resize(out.cloud.count * channel.components);
    }
    return glb::writeInterop(out);
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

/// Of a file that has been read without errors.
static std::vector<AssetSummary::ChannelBytes> blocksOf(std::span<const std::byte> file)
{
    std::vector<AssetSummary::ChannelBytes> out;
    const Result<GlbChunks> chunks = splitGlb(file);
    if (!chunks) return out;
    const glb::json document = glb::parseJson(chunks->json);
    for (const glb::json& primitive : document["meshes"][0]["primitives"])
        for (const glb::json& block : primitive["extensions"][glb::kSplatExtension]["extensions"][glb::kRelightExtension]["blocks"]) {
            std::string name;
            for (const glb::json& target : block["targets"]) name += (name.empty() ? "" : "+") + target["name"].get<std::string>();
            const size_t bytes = glb::bufferView(document, chunks->bin, block["bufferView"].get<size_t>()).bytes.size();
            if (!out.empty() && out.back().name == name) out.back().bytes += bytes;
            else out.push_back({name, bytes});
        }
    return out;
}

AssetSummary summarizeAsset(const SplatAsset& asset, std::span<const std::byte> file)
{
    const size_t count = asset.cloud.count;
    const size_t neutralFunctions = size_t(std::max(1, asset.neutral.shFunctions)); // KHR demands degree 0

    AssetSummary summary;
    summary.profile = asset.profile;
    if (asset.profile == glb::kCompactProfile && !file.empty()) {
        summary.channels = blocksOf(file);
        return summary;
    }
    summary.channels.push_back({"geometry", count * sizeof(float) * (3 + 4 + 3 + 1)});
    summary.channels.push_back({"neutralLook", count * sizeof(float) * (3 * neutralFunctions + 4)}); // SH and COLOR_0
    if (asset.profile == glb::kInteropProfile && !file.empty()) {
        size_t others = 0;
        for (const auto& part : summary.channels) others += part.bytes;
        summary.channels.push_back({"relighting", file.size() - std::min(file.size(), others)});
        return summary;
    }
    for (const Channel& channel : asset.channels)
        summary.channels.push_back({channel.name, channel.sizeInBytes()});
    return summary;
}

} // namespace nacre
