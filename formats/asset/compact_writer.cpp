// A quantised asset as a .glb (SPEC.md, section 8). The JSON is written here rather than by tinygltf, which cannot leave out what is absent.
#include "appearance/model_table.h"
#include "asset/asset_io.h"
#include "asset/codec/columns.h"
#include "asset/compact.h"
#include "asset/glb_layout.h"
#include "base/glb_container.h"

#include <nlohmann/json.hpp>

#include <cstring>
#include <limits>

namespace nacre {

namespace {

using Json = nlohmann::ordered_json;

template <class T> void append(const std::vector<T>& values, std::vector<std::byte>& out)
{
    const auto* bytes = reinterpret_cast<const std::byte*>(values.data());
    out.insert(out.end(), bytes, bytes + values.size() * sizeof(T));
}

void padTo4(std::vector<std::byte>& bytes, std::byte with) { bytes.resize((bytes.size() + 3) / 4 * 4, with); }

Json blockJson(const Block& block, size_t view)
{
    Json targets = Json::array();
    for (const BlockTarget& t : block.targets) {
        Json target = {{"name", t.name}};
        if (t.first > 0) target["first"] = t.first;
        target["count"] = t.count;
        targets.push_back(std::move(target));
    }
    Json json = {{"targets", std::move(targets)}, {"numbers", block.numbers}};
    if (block.columns != block.numbers) json["columns"] = block.columns;
    if (block.transform != BlockTransform::kLinear) json["transform"] = blockTransformName(block.transform);
    if (!block.basis.empty()) json["basis"] = true;
    json["bufferView"] = view;
    return json;
}

void appendBlock(const Block& block, std::vector<std::byte>& out)
{
    append(block.offset, out), append(block.step, out), append(block.scale, out), append(block.basis, out);
    const size_t rows = block.codes.size() / block.columns;
    std::span<const int32_t> left;
    for (uint32_t k = 0; k < block.columns; ++k) {
        const auto column = std::span(block.codes).subspan(k * rows, rows);
        codec::encodeColumn(column, left, out);
        left = column;
    }
}

Json numbers(std::initializer_list<double> values) { return Json(std::vector<double>(values)); }

Json presetJson(const Preset& p)
{
    Json json = {{"name", p.name}};
    if (p.detail.splats != 1) json["splats"] = p.detail.splats;
    for (const DetailPartName& part : kDetailParts)
        if (p.detail.leaveOut & part.part) json["leaveOut"].push_back(part.name);
    const auto whole = [&](const char* key, uint32_t value) {
        if (value > 0) json[key] = value;
    };
    whole("transportFunctions", p.detail.transportFunctions), whole("visibilitySize", p.detail.visibilitySize), whole("environmentDirections", p.environmentDirections);
    if (p.resolutionScale != 1) json["resolutionScale"] = p.resolutionScale;
    if (p.milliseconds != 0) json["milliseconds"] = p.milliseconds;
    if (p.psnrMasked != 0) json["psnrMasked"] = p.psnrMasked;
    if (!p.measuredOn.empty()) json["measuredOn"] = p.measuredOn;
    return json;
}

Json relightJson(const SplatAsset& asset, Json blocks)
{
    Json channels = Json::array();
    for (const Channel& channel : asset.channels) {
        Json entry = {{"name", channel.name}, {"components", channel.components}};
        if (channel.leading > 0) entry["leading"] = channel.leading;
        channels.push_back(std::move(entry));
    }
    Json relight = {{"version", glb::kCompactVersion}, {"model", asset.model}, {"profile", glb::kCompactProfile}, {"count", asset.cloud.count},
                    {"screenFilter", {{"type", "mip"}, {"variance", asset.lowPassVariance}}}, {"lightUnits", "KHR_lights_punctual"},
                    {"channels", std::move(channels)}, {"blocks", std::move(blocks)}};
    if (asset.drawnVisibility > 0) relight["drawnVisibility"] = asset.drawnVisibility;
    if (const AssetFrame& f = asset.frame; f != AssetFrame{})
        relight["datasetFrame"] = {{"scale", f.scale}, {"translation", numbers({f.translation.x, f.translation.y, f.translation.z})}, {"lightGain", f.lightGain}};
    for (const Preset& p : asset.presets) relight["presets"].push_back(presetJson(p));
    relight["bakedWith"] = asset.bakedWith;
    return relight;
}

Json documentJson(const SplatAsset& asset, Json relight, Json views, size_t bytes)
{
    // As with Draco's extension: what is in the blocks has accessors without a buffer view.
    const auto accessor = [&](const char* type) { return Json{{"componentType", glb::kFloat}, {"count", asset.cloud.count}, {"type", type}}; };
    glm::vec3 low = asset.cloud.positions[0], high = low;
    for (const glm::vec3& p : asset.cloud.positions) low = glm::min(low, p), high = glm::max(high, p);
    Json position = accessor("VEC3");
    position["min"] = numbers({low.x, low.y, low.z}), position["max"] = numbers({high.x, high.y, high.z});
    const glm::quat& q = asset.yUpFromAsset;
    return {{"asset", {{"version", "2.0"}, {"generator", "Nacre"}}},
            {"extensionsUsed", {glb::kSplatExtension, glb::kRelightExtension}},
            {"extensionsRequired", {glb::kSplatExtension, glb::kRelightExtension}},
            {"scene", 0},
            {"scenes", {{{"nodes", {0}}}}},
            {"nodes", {{{"mesh", 0}, {"rotation", numbers({q.x, q.y, q.z, q.w})}}}},
            {"meshes", {{{"primitives",
                          {{{"mode", 0},
                            {"attributes", {{glb::kPosition, 0}, {glb::kRotation, 1}, {glb::kScale, 2}, {glb::kOpacity, 3}}},
                            {"extensions", {{glb::kSplatExtension, {{"kernel", "ellipse"}, {"colorSpace", "lin_rec709_display"},
                                                                    {"extensions", {{glb::kRelightExtension, std::move(relight)}}}}}}}}}}}}},
            {"accessors", {std::move(position), accessor("VEC4"), accessor("VEC3"), accessor("SCALAR")}},
            {"bufferViews", std::move(views)},
            {"buffers", {{{"byteLength", bytes}}}}};
}

} // namespace

size_t encodedBytes(const Block& block)
{
    std::vector<std::byte> bytes;
    appendBlock(block, bytes);
    return bytes.size();
}

static std::vector<std::byte> assemble(std::string json, std::span<const std::byte> bin)
{
    json.resize((json.size() + 3) / 4 * 4, ' ');
    std::vector<std::byte> out;
    const auto put = [&](uint32_t x) {
        for (int b = 0; b < 4; ++b) out.push_back(std::byte(x >> (8 * b) & 255));
    };
    constexpr uint32_t kMagic = 0x46546C67, kJson = 0x4E4F534A, kBin = 0x004E4942;
    put(kMagic), put(2), put(uint32_t(12 + 8 + json.size() + 8 + bin.size()));
    put(uint32_t(json.size())), put(kJson);
    const auto* text = reinterpret_cast<const std::byte*>(json.data());
    out.insert(out.end(), text, text + json.size());
    put(uint32_t(bin.size())), put(kBin);
    out.insert(out.end(), bin.begin(), bin.end());
    return out;
}

Result<std::vector<std::byte>> encodeCompact(const QuantisedAsset& quantised)
{
    const Result<SplatAsset> asset = dequantise(quantised); // the one check of everything; and the bounds
    if (!asset) return asset.error();
    std::vector<std::byte> bin;
    Json views = Json::array(), blocks = Json::array();
    for (const Block& block : quantised.blocks) {
        const size_t start = bin.size();
        appendBlock(block, bin);
        views.push_back({{"buffer", 0}, {"byteOffset", start}, {"byteLength", bin.size() - start}});
        blocks.push_back(blockJson(block, views.size() - 1));
    }
    bin.resize(std::max(bin.size(), asset->cloud.count / kSplatsPerByte + 1)); // compact.h: kSplatsPerByte
    padTo4(bin, std::byte(0));
    if (bin.size() > (size_t(1) << 31)) return Error{ErrorCode::kUnsupported, "the asset needs " + std::to_string(bin.size() >> 20) + " MiB, expected less than 2 GiB"};

    std::string json;
    try {
        json = documentJson(*asset, relightJson(quantised.frame, std::move(blocks)), std::move(views), bin.size()).dump();
    } catch (const nlohmann::json::exception& e) { // a name that is not UTF-8
        return Error{ErrorCode::kBadInput, std::string("cannot serialise the asset: ") + e.what()};
    }
    return assemble(std::move(json), bin);
}

Result<std::vector<std::byte>> withPresets(std::span<const std::byte> file, std::span<const Preset> presets)
{
    Result<SplatAsset> asset = decodeAsset(file);
    if (!asset) return asset.error();
    asset->presets.assign(presets.begin(), presets.end());
    if (Status s = validate(*asset); !s) return s.error();
    const Result<GlbChunks> chunks = splitGlb(file);
    if (!chunks) return chunks.error();
    try {
        Json document = Json::parse(reinterpret_cast<const char*>(chunks->json.data()), reinterpret_cast<const char*>(chunks->json.data()) + chunks->json.size());
        for (Json& mesh : document["meshes"]) { // one of them holds the splats: the file has been read
            if (!mesh.contains("primitives") || !mesh["primitives"].is_array()) continue;
            for (Json& primitive : mesh["primitives"]) {
                if (!primitive.contains("extensions") || !primitive["extensions"].contains(glb::kSplatExtension)) continue;
                Json& relight = primitive["extensions"][glb::kSplatExtension]["extensions"][glb::kRelightExtension];
                relight.erase("presets");
                for (const Preset& p : presets) relight["presets"].push_back(presetJson(p));
            }
        }
        return assemble(document.dump(), chunks->bin);
    } catch (const Json::exception& e) { // a name that is not UTF-8
        return Error{ErrorCode::kBadInput, std::string("cannot serialise the presets: ") + e.what()};
    }
}

} // namespace nacre
