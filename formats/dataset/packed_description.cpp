// packed.json: everything of a dataset but its pixels. A new field of OlatDataset is one line in encode... and one in decode... below.
//
// Cameras are [width, height, fx, fy, cx, cy, 16 numbers of worldFromCamera by rows], blocks [offset, width, height, x, y, columns, rows, halves,
// hash in hexadecimal]: there may be tens of thousands of them.
#include "dataset/loader.h"
#include "dataset/packed_images.h"

#include "base/file.h"
#include "base/hash.h"

#include <nlohmann/json.hpp>

#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>

namespace nacre {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr int kVersion = 1;
constexpr size_t kMostBytes = size_t(1) << 30; // about 500 an image
constexpr int kMostPixelsPerSide = 65536;
constexpr size_t kMostPixels = size_t(1) << 28;
constexpr const char* kLightTypes[] = {"point", "directional", "environment", "group"};
constexpr const char* kRigs[] = {"fixed", "camera", "stage"};

Json toJson(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

Json toJson(const Camera& c)
{
    Json out = {c.width, c.height, c.fx, c.fy, c.cx, c.cy};
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column) out.push_back(c.worldFromCamera[column][row]);
    return out;
}

Json toJson(const Light& l)
{
    Json out = {{"type", kLightTypes[size_t(l.type)]}};
    if (l.type == LightType::kPoint) out["position"] = toJson(l.position);
    if (l.positionRest != glm::vec3(0.0f)) out["position_rest"] = toJson(l.positionRest);
    if (l.type != LightType::kPoint) out["direction"] = toJson(l.directionToLight);
    out["intensity"] = toJson(l.intensity);
    if (l.radius != 0) out["radius"] = double(l.radius);
    if (!l.environmentPath.empty()) out["map"] = l.environmentPath;
    if (l.group)
        for (const Light& one : *l.group) out["lights"].push_back(toJson(one));
    return out;
}

std::string hexText(uint64_t x)
{
    char text[20];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(x));
    return text;
}

uint64_t readHex(const JsonNode& node)
{
    const std::string text = node.string();
    uint64_t x = 0;
    const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), x, 16);
    if (status != std::errc() || end != text.data() + text.size() || text.size() != 16) node.fail("16 hexadecimal digits", inQuotes(text));
    return x;
}

constexpr std::string_view kChecksum = ",\"checksum\":\"", kEnd = "\"}\n";
constexpr size_t kChecksumBytes = kChecksum.size() + 16 + kEnd.size();

/// A changed digit of a pose or a light would be wrong without a word. Files without a checksum, of an earlier version, pass.
bool isDamaged(std::string_view text)
{
    if (text.size() < kChecksumBytes) return false;
    const std::string_view body = text.substr(0, text.size() - kChecksumBytes), tail = text.substr(body.size());
    return text.find(kChecksum) != std::string_view::npos && tail != std::string(kChecksum).append(hexText(fnv1a(body.data(), body.size()))).append(kEnd);
}

Json toJson(const PackedBlock& b) { return {b.offset, b.width, b.height, b.x, b.y, b.columns, b.rows, int(b.halves), hexText(b.hash)}; }

Camera readCamera(const JsonNode& node)
{
    const std::vector<double> v = node.numbers(22);
    Camera c;
    if (!(v[0] >= 1 && v[0] <= kMostPixelsPerSide && v[1] >= 1 && v[1] <= kMostPixelsPerSide && v[0] * v[1] <= double(kMostPixels)))
        node.fail("a camera of 1 to 65536 pixels a side, 2^28 at most", "another size");
    else c.width = int(v[0]), c.height = int(v[1]);
    if (!(v[2] > 0 && v[3] > 0)) node.fail("positive focal lengths", "others");
    c.fx = v[2], c.fy = v[3], c.cx = v[4], c.cy = v[5];
    glm::dmat4 pose(1.0);
    for (int k = 0; k < 16; ++k) pose[k % 4][k / 4] = v[size_t(6 + k)];
    c.worldFromCamera = rigidPose(pose, node);
    double change = 0;
    for (int k = 0; k < 16; ++k) change = std::max(change, std::fabs(c.worldFromCamera[k / 4][k % 4] - pose[k / 4][k % 4]));
    if (change < 1e-12) c.worldFromCamera = pose; // to the last bit what was prepared: checkpoints remember it
    return c;
}

Light readLight(const JsonNode& node, const std::string& folder, bool inGroup = false)
{
    Light l;
    const std::string type = node["type"].string();
    const auto found = std::find(std::begin(kLightTypes), std::end(kLightTypes), type);
    if (found == std::end(kLightTypes) || (inGroup && type != "point" && type != "directional")) {
        node["type"].fail(inGroup ? "point or directional" : "point, directional, environment or group", inQuotes(type));
        return l;
    }
    l.type = LightType(found - std::begin(kLightTypes));
    if (l.type == LightType::kPoint) l.position = readVec3(node["position"]);
    if (const JsonNode rest = node["position_rest"]; rest.exists()) l.positionRest = readVec3(rest);
    if (l.type != LightType::kPoint) {
        l.directionToLight = readVec3(node["direction"]);
        if (!(std::fabs(glm::length(l.directionToLight) - 1) < 1e-3f)) node["direction"].fail("a unit vector", "another length");
    }
    l.intensity = readIntensity(node["intensity"]);
    if (const JsonNode radius = node["radius"]; radius.exists()) l.radius = float(std::max(radius.number(1e9), 0.0));
    if (const JsonNode map = node["map"]; map.exists()) l.environmentPath = (fs::path(folder) / map.string()).lexically_normal().string();
    if (l.type == LightType::kGroup) {
        auto group = std::make_shared<std::vector<Light>>();
        for (const JsonNode& one : node["lights"].items()) group->push_back(readLight(one, folder, true));
        l.group = std::move(group);
    }
    return l;
}

PackedBlock readBlock(const JsonNode& node, const Camera& camera, uint64_t pixelBytes)
{
    PackedBlock b;
    const std::vector<JsonNode> v = node.items();
    if (v.size() != 9) {
        node.fail("9 values", std::to_string(v.size()));
        return b;
    }
    b.offset = v[0].size(uint64_t(1) << 53);
    b.width = v[1].integer(1, kMostPixelsPerSide), b.height = v[2].integer(1, kMostPixelsPerSide);
    b.x = v[3].integer(0, b.width), b.y = v[4].integer(0, b.height);
    b.columns = v[5].integer(0, b.width - b.x), b.rows = v[6].integer(0, b.height - b.y);
    b.halves = v[7].integer(0, 1) != 0;
    b.hash = readHex(v[8]);
    if (b.width != camera.width || b.height != camera.height) node.fail("the size of its camera", std::to_string(b.width) + " x " + std::to_string(b.height));
    if (b.offset > pixelBytes || b.bytes() > pixelBytes - b.offset)
        node.fail("a block inside the " + std::to_string(pixelBytes) + " bytes of pixels.bin", "one that ends at byte " + std::to_string(b.offset + b.bytes()) +
                  " (cut off? prepare the dataset again)");
    return b;
}

} // namespace

std::string encodePackedDescription(const OlatDataset& dataset, const PackedImages& packed)
{
    Json out = {{"nacre_packed", kVersion},       {"convention", dataset.convention}, {"source", dataset.path},  {"source_state", hexText(packed.sourceState)},
                {"up", toJson(dataset.up)},       {"warnings", dataset.warnings},
                {"background_in_view", dataset.backgroundInView}, {"light_rig", kRigs[size_t(dataset.rig)]}};
    Json &splits = out["splits"] = Json::array(), &skipped = out["skipped"] = Json::array();
    for (const OlatSplit& split : dataset.splits) {
        Json cameras = Json::array(), images = Json::array();
        for (const Camera& c : split.cameras) cameras.push_back(toJson(c));
        for (const OlatImage& image : split.images) {
            images.push_back({{"camera", image.camera}, {"path", image.path}, {"light", toJson(image.light)}, {"block", toJson(packed.blocks[image.packedBlock])}});
            if (const uint64_t development = developmentOf(dataset, split, image)) images.back()["development"] = hexText(development);
        }
        splits.push_back({{"name", split.name}, {"cameras", std::move(cameras)}, {"images", std::move(images)}});
    }
    for (const SkippedImage& s : packed.skipped) skipped.push_back({{"split", s.split}, {"path", s.path}, {"why", s.why}});
    std::string text = out.dump(-1, ' ', false, Json::error_handler_t::replace);
    text.pop_back(); // the last brace
    const std::string checksum = hexText(fnv1a(text.data(), text.size()));
    return text.append(kChecksum).append(checksum).append(kEnd);
}

Result<OlatDataset> decodePackedDescription(std::span<const std::byte> text, const std::string& folder, uint64_t pixelBytes)
{
    const Result<JsonDocument> document = JsonDocument::parse(text, (fs::path(folder) / kPackedDescription).string());
    if (!document) return document.error();
    const JsonNode root = document->root();
    if (const int version = root["nacre_packed"].integer(0, 1 << 30); !document->failed() && version != kVersion)
        root["nacre_packed"].fail("version 1", "version " + std::to_string(version) + "; prepare the dataset again", ErrorCode::kUnsupported);
    OlatDataset dataset;
    dataset.path = folder;
    dataset.convention = root["convention"].string();
    dataset.up = readVec3(root["up"]);
    dataset.backgroundInView = root["background_in_view"].boolean();
    const std::string rig = root["light_rig"].string();
    const auto known = std::find(std::begin(kRigs), std::end(kRigs), rig);
    if (known == std::end(kRigs)) root["light_rig"].fail("fixed, camera or stage", inQuotes(rig));
    else dataset.rig = LightRig(known - std::begin(kRigs));
    for (const JsonNode& line : root["warnings"].items()) dataset.warnings.push_back(oneLine(line.text(), 1000));
    auto packed = std::make_shared<PackedImages>();
    packed->sourceState = readHex(root["source_state"]);
    for (const JsonNode& s : root["splits"].items()) {
        OlatSplit split;
        split.name = s["name"].string();
        for (const JsonNode& c : s["cameras"].items()) split.cameras.push_back(readCamera(c));
        if (split.cameras.empty()) s["cameras"].fail("at least one camera", "none");
        if (document->failed()) return document->error();
        for (const JsonNode& i : s["images"].items()) {
            OlatImage image;
            image.camera = uint32_t(i["camera"].integer(0, int(split.cameras.size()) - 1));
            image.path = i["path"].string();
            image.light = readLight(i["light"], folder);
            image.packedBlock = uint32_t(packed->blocks.size());
            const JsonNode development = i["development"];
            packed->development.push_back(development.exists() ? readHex(development) : 0);
            packed->blocks.push_back(readBlock(i["block"], split.cameras[image.camera], pixelBytes));
            split.images.push_back(std::move(image));
            if (document->failed()) return document->error();
        }
        if (split.images.empty()) s["images"].fail("at least one image", "none");
        dataset.splits.push_back(std::move(split));
    }
    if (dataset.splits.empty()) root["splits"].fail("at least one split", "none");
    for (const JsonNode& s : root["skipped"].items()) packed->skipped.push_back({s["split"].string(), s["path"].string(), oneLine(s["why"].text(), 1000)});
    if (document->failed()) return document->error();
    dataset.packed = std::move(packed);
    return dataset;
}

Result<OlatDataset> loadPacked(const std::string& folder)
{
    const std::string pixels = (fs::path(folder) / kPackedPixels).string();
    std::error_code error;
    const uint64_t pixelBytes = fs::file_size(pixels, error);
    if (error) return Error{ErrorCode::kBadInput, "cannot read '" + pixels + "': " + error.message() + "; prepare the dataset again"};
    const auto text = readFile((fs::path(folder) / kPackedDescription).string(), kMostBytes);
    if (!text) return text.error();
    auto dataset = decodePackedDescription(*text, folder, pixelBytes);
    if (!dataset) return dataset;
    if (isDamaged({reinterpret_cast<const char*>(text->data()), text->size()}))
        return Error{ErrorCode::kBadInput, (fs::path(folder) / kPackedDescription).string() + ": damaged or edited: its checksum differs; prepare the dataset again"};
    // nobody else knows it yet
    if (Status s = std::const_pointer_cast<PackedImages>(dataset->packed)->open(pixels); !s) return s.error();
    return dataset;
}

} // namespace nacre
