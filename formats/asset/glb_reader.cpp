// .glb bytes -> SplatAsset. The bytes are untrusted: every length, index and offset is checked before it is used, and nothing is
// allocated before the file is known to hold that many bytes.
//
// The JSON chunk is parsed with nlohmann-json rather than read by tinygltf: tinygltf resolves URIs, decodes images, copies the
// whole BIN chunk and, as Debian builds it, has live asserts on the way. An asset needs a dozen properties; reading exactly those
// keeps the attack surface here and in glb_json.cpp. Faults are thrown and become an Error at the one way out, read().
#include "asset/compact_reader.h"
#include "asset/glb_json.h"
#include "asset/glb_layout.h"
#include "asset/look_color.h"

#include "base/base64.h"
#include "base/glb_container.h"
#include "base/text.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <new>
#include <string_view>

namespace nacre::glb {
namespace {

/// Rows of `components` floats, `stride` bytes apart, known to lie in the file. Rows do not overlap.
struct Rows {
    const std::byte* data;
    size_t stride, count;
    int components;
    const std::byte* at(size_t row) const { return data + row * stride; }
    void copy(size_t row, float* out) const { std::memcpy(out, data + row * stride, 4 * size_t(components)); }
};

Rows attribute(const json& document, std::span<const std::byte> bin, const json& attributes, const std::string& name,
               const char* type, int components, size_t componentType = kFloat)
{
    const size_t index = needSize(attributes, name.c_str(), "the splat primitive");
    const std::string where = "accessors[" + std::to_string(index) + "] (" + name + ")";
    const json& accessor = element(document, "accessors", index);
    if (const std::string found = needString(accessor, "type", where); found != type)
        bad(where + " has type " + inQuotes(found) + ", expected " + type);
    const json* normalized = find(accessor, "normalized");
    if (needSize(accessor, "componentType", where) != componentType || (normalized && *normalized != json(false)))
        unsupported(where + (componentType == kFloat ? " is not float32" : " is not uint8") + ", which is all that is read of it (was the file quantised by a tool?)");
    if (find(accessor, "sparse")) unsupported(where + " is sparse, which is not read");

    const size_t count = needSize(accessor, "count", where);
    const View view = bufferView(document, bin, needSize(accessor, "bufferView", where));
    const size_t offset = sizeOr(accessor, "byteOffset", 0, where);
    const size_t row = (componentType == kFloat ? 4 : 1) * size_t(components);
    const size_t stride = view.stride ? view.stride : row;
    if (stride < row || stride % 4 != 0) // glTF stops at 252, gltf-transform, which interleaves all attributes, does not
        bad(where + " has a stride of " + std::to_string(stride) + " bytes, expected a multiple of 4 from " + std::to_string(row) + " on");
    const size_t length = view.bytes.size();
    if (count == 0) bad(where + " is empty");
    if (offset > length || row > length - offset || count - 1 > (length - offset - row) / stride)
        bad(where + " claims " + std::to_string(count) + " rows of " + std::to_string(stride) + " bytes from byte " +
            std::to_string(offset) + ", its buffer view has " + std::to_string(length));
    return {view.bytes.data() + offset, stride, count, components};
}

// ---- The asset
// ------------------------------------------------------------------------------------------------------------------

struct SplatPrimitive {
    size_t mesh = 0;
    const json* primitive = nullptr;
    const json* splatting = nullptr; // KHR_gaussian_splatting
    const json* relight = nullptr;   // NACRE_gaussian_splatting_relight
};

SplatPrimitive findSplats(const json& document)
{
    SplatPrimitive found;
    const json* meshes = find(document, "meshes");
    for (size_t m = 0; meshes && meshes->is_array() && m < meshes->size(); ++m) {
        const json* primitives = find((*meshes)[m], "primitives");
        if (!primitives || !primitives->is_array()) continue;
        for (const json& primitive : *primitives) {
            const json* extensions = find(primitive, "extensions");
            const json* splatting = extensions ? find(*extensions, kSplatExtension) : nullptr;
            if (!splatting) continue;
            if (found.splatting) unsupported("the file holds several splat primitives, one is expected");
            found.mesh = m;
            found.primitive = &primitive;
            found.splatting = splatting;
        }
    }
    if (!found.splatting)
        bad("a glTF file without Gaussian splats (KHR_gaussian_splatting); expected an asset written by 'nacre bake'");
    const json* nested = find(*found.splatting, "extensions");
    found.relight = nested ? find(*nested, kRelightExtension) : nullptr;
    if (!found.relight)
        bad(std::string("a splat file without Nacre relighting data (") + kRelightExtension +
            "); expected an asset written by 'nacre bake'");
    return found;
}

void checkHeader(const json& document, const SplatPrimitive& splats)
{
    if (const json* required = find(document, "extensionsRequired"))
        for (const json& name : *required)
            if (name != kSplatExtension && name != kRelightExtension)
                unsupported("the file requires the glTF extension " +
                            (name.is_string() ? inQuotes(name.get<std::string>()) : "(not a string)") + ", which is not read");

    const std::string where = kRelightExtension;
    const size_t version = needSize(*splats.relight, "version", where);
    if (version < kOldestRelightVersion || version > kRelightVersion)
        unsupported(where + " has version " + std::to_string(version) + ", this build reads " + std::to_string(kOldestRelightVersion) + " to " + std::to_string(kRelightVersion) +
                    (version > kRelightVersion ? "; update Nacre" : ""));
    const auto expect = [](const json& object, const char* key, const char* value, const std::string& at) {
        if (const std::string found = needString(object, key, at); found != value)
            unsupported(at + "." + key + " is " + inQuotes(found) + ", this build reads '" + value + "'");
    };
    if (const std::string profile = needString(*splats.relight, "profile", where); profile != kLosslessProfile && ((profile != kCompactProfile && profile != kInteropProfile) || version < kCompactVersion))
        unsupported(where + ".profile is " + inQuotes(profile) + ", this build reads '" + kLosslessProfile + "' and, since version 5, '" + kCompactProfile + "' and '" + kInteropProfile + "'");
    expect(*splats.relight, "lightUnits", "KHR_lights_punctual", where);
    expect(need(*splats.relight, "screenFilter", where), "type", "mip", where + ".screenFilter");
    expect(*splats.splatting, "kernel", "ellipse", kSplatExtension);
    if (const std::string space = needString(*splats.splatting, "colorSpace", kSplatExtension); space != kLinearSpace && space != kSrgbSpace)
        unsupported(std::string(kSplatExtension) + ".colorSpace is " + inQuotes(space) + ", this build reads '" + kLinearSpace + "' and '" + kSrgbSpace + "'");
    if (sizeOr(*splats.primitive, "mode", 4, "the splat primitive") != 0) bad("the splat primitive's mode is not 0 (POINTS)");
}

/// The rotation of the first node that shows the mesh. Other placement (translation, scale, parents) belongs to the scene the
/// file was put into, not to the asset.
glm::quat nodeRotation(const json& document, size_t mesh)
{
    const json* nodes = find(document, "nodes");
    for (size_t n = 0; nodes && nodes->is_array() && n < nodes->size(); ++n) {
        const json& node = (*nodes)[n];
        const std::string where = "nodes[" + std::to_string(n) + "]";
        const json* shows = find(node, "mesh");
        if (!shows || toSize(*shows, where + ".mesh") != mesh) continue;
        if (find(node, "matrix")) unsupported(where + " has a matrix, expected a rotation");
        const json* r = find(node, "rotation");
        if (!r) break;
        if (!r->is_array() || r->size() != 4) bad(where + ".rotation does not have 4 numbers");
        const auto component = [&](size_t i) { return toFloat((*r)[i], where + ".rotation"); };
        return glm::quat(component(3), component(0), component(1), component(2));
    }
    return glm::quat(1, 0, 0, 0);
}

/// Where the asset lies in the dataset it was baked from. Files of before version 4 lie there as they are.
AssetFrame datasetFrame(const json& relight)
{
    AssetFrame frame;
    const std::string where = std::string(kRelightExtension) + ".datasetFrame";
    const json* object = find(relight, "datasetFrame");
    if (!object || needSize(relight, "version", kRelightExtension) < size_t(kFrameVersion)) return frame;
    const auto number = [](const json& value, const std::string& at) {
        const double x = value.is_number() ? value.get<double>() : NAN;
        if (!std::isfinite(x)) bad(at + " is not a finite number");
        return x;
    };
    frame.scale = number(need(*object, "scale", where), where + ".scale");
    frame.lightGain = number(need(*object, "lightGain", where), where + ".lightGain");
    const json& translation = need(*object, "translation", where);
    if (!translation.is_array() || translation.size() != 3) bad(where + ".translation does not have 3 numbers");
    for (int k = 0; k < 3; ++k) frame.translation[k] = number(translation[size_t(k)], where + ".translation");
    return frame;
}

/// What the values must be like is checked with the rest of the asset.
std::vector<Preset> readPresets(const json& relight)
{
    std::vector<Preset> presets;
    const json* list = find(relight, "presets");
    if (!list) return presets;
    if (!list->is_array() || list->size() > 64) bad("presets is not an array of at most 64 entries");
    for (const json& entry : *list) {
        const std::string where = "presets[" + std::to_string(presets.size()) + "]";
        if (!entry.is_object()) bad(where + " is not an object");
        const auto number = [&](const char* key) { // 0 where it is absent
            const json* value = find(entry, key);
            if (value && !value->is_number()) bad(where + "." + key + " is not a number");
            return value ? value->get<double>() : 0.0;
        };
        const auto real = [&](const char* key) { // 1 where it is absent
            const json* value = find(entry, key);
            return value ? toFloat(*value, where + "." + key) : 1.0f;
        };
        const auto whole = [&](const char* key) { return uint32_t(std::min<size_t>(sizeOr(entry, key, 0, where), ~0u)); };
        Preset preset;
        preset.name = needName(entry, "name", where);
        preset.detail.splats = real("splats");
        preset.detail.transportFunctions = whole("transportFunctions"), preset.detail.visibilitySize = whole("visibilitySize");
        preset.resolutionScale = real("resolutionScale"), preset.environmentDirections = whole("environmentDirections");
        preset.milliseconds = number("milliseconds"), preset.psnrMasked = number("psnrMasked");
        if (find(entry, "measuredOn")) preset.measuredOn = needString(entry, "measuredOn", where);
        if (const json* parts = find(entry, "leaveOut")) {
            if (!parts->is_array()) bad(where + ".leaveOut is not an array");
            for (const json& part : *parts) {
                if (!part.is_string()) bad(where + ".leaveOut has an entry that is not a string");
                for (const DetailPartName& known : kDetailParts) // parts of newer versions stay
                    if (part == known.name) preset.detail.leaveOut |= known.part;
            }
        }
        presets.push_back(std::move(preset));
    }
    return presets;
}

SplatCloud readCloud(const json& document, std::span<const std::byte> bin, const json& attributes, size_t count)
{
    const auto rowsOf = [&](const char* name, const char* type, int components) {
        const Rows rows = attribute(document, bin, attributes, name, type, components);
        if (rows.count != count)
            bad(std::string(name) + " has " + std::to_string(rows.count) + " rows, expected " + std::to_string(count));
        return rows;
    };
    const Rows positions = rowsOf(kPosition, "VEC3", 3), rotations = rowsOf(kRotation, "VEC4", 4);
    const Rows scales = rowsOf(kScale, "VEC3", 3), opacities = rowsOf(kOpacity, "SCALAR", 1);

    SplatCloud cloud;
    cloud.count = count;
    cloud.positions.resize(count);
    cloud.rotations.resize(count);
    cloud.scales.resize(count);
    cloud.opacities.resize(count);
    for (size_t i = 0; i < count; ++i) {
        float xyzw[4];
        positions.copy(i, &cloud.positions[i].x);
        rotations.copy(i, xyzw);
        cloud.rotations[i] = glm::quat(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
        scales.copy(i, &cloud.scales[i].x);
        opacities.copy(i, &cloud.opacities[i]);
    }
    return cloud;
}

NeutralLook readNeutralLook(const json& document, std::span<const std::byte> bin, const json& attributes, size_t functions, size_t count)
{
    if (functions > 16) bad("neutralFunctions is " + std::to_string(functions) + ", expected 0, 1, 4, 9 or 16");
    std::vector<Rows> rows;
    for (size_t f = 0; f < functions; ++f) {
        rows.push_back(attribute(document, bin, attributes, shAttribute(int(f)), "VEC3", 3));
        if (rows[f].count != count)
            bad(shAttribute(int(f)) + " has " + std::to_string(rows[f].count) + " rows, expected " + std::to_string(count));
    }
    NeutralLook look;
    look.shFunctions = int(functions);
    look.sh.resize(count * functions);
    for (size_t i = 0; i < count; ++i)
        for (size_t f = 0; f < functions; ++f) rows[f].copy(i, &look.sh[i * functions + f].x);
    return look;
}

/// `previous`: the channels before this one. Refuses before copying what would make the asset larger than its file.
Channel readChannel(const json& document, std::span<const std::byte> bin, const json& entry, const std::vector<Channel>& previous,
                    size_t count)
{
    const std::string where = "channels[" + std::to_string(previous.size()) + "]";
    Channel channel;
    channel.name = needName(entry, "name", where);
    if (const json* perAsset = find(entry, "perAsset")) {
        if (!perAsset->is_boolean()) bad(where + ".perAsset is neither true nor false");
        channel.perAsset = perAsset->get<bool>();
    }
    if (find(entry, "leading")) {
        channel.leading = needSize(entry, "leading", where);
        if (channel.leading == 0 || channel.leading >= count || channel.perAsset)
            bad(where + ".leading is " + std::to_string(channel.leading) + ", expected 1 to " + std::to_string(count - 1) +
                " of a channel with rows per splat");
    }
    const size_t rows = channel.rows(count);
    const std::string at = where + " (" + inQuotes(channel.name) + ")";
    const size_t type = needSize(entry, "componentType", at);
    if (type != kFloat && type != kUnorm8) unsupported(at + " is neither float32 nor uint8, which the lossless profile demands");
    const size_t width = type == kFloat ? 4 : 1;
    size_t total = 0;
    for (const Channel& other : previous) {
        if (other.name == channel.name) bad(at + " occurs twice");
        total += other.sizeInBytes();
    }
    const size_t components = needSize(entry, "components", at);
    const View view = bufferView(document, bin, needSize(entry, "bufferView", at));
    const size_t available = view.bytes.size() / width; // dividing keeps the products below from overflowing
    if (components == 0 || components > available / rows || view.bytes.size() != width * rows * components)
        bad(at + " has " + std::to_string(view.bytes.size()) + " bytes, expected " + std::to_string(rows) + (channel.perAsset ? " row x " : " splats x ") +
            std::to_string(components) + (type == kFloat ? " floats" : " bytes"));
    if (view.bytes.size() > bin.size() - total)
        bad(at + " and the channels before it need " + std::to_string(total + view.bytes.size()) + " bytes, the binary chunk has " +
            std::to_string(bin.size()) + " (channels must not share bytes)");
    channel.components = uint32_t(components);
    if (type == kFloat) channel.values.resize(rows * components);
    else channel.bytes.resize(rows * components);
    std::memcpy(type == kFloat ? static_cast<void*>(channel.values.data()) : channel.bytes.data(), view.bytes.data(), view.bytes.size());
    return channel;
}

/// SH functions of all degrees that are complete.
size_t lookFunctions(const json& attributes)
{
    size_t functions = 0;
    while (functions < 16 && find(attributes, shAttribute(int(functions)).c_str())) ++functions;
    return functions >= 16 ? 16 : functions >= 9 ? 9 : functions >= 4 ? 4 : functions >= 1 ? 1 : 0;
}

/// Profile interop: relighting data are attributes, so they are those of the splats in whatever order these are now.
class InteropReader {
public:
    InteropReader(const json& document, std::span<const std::byte> bin, const json& attributes, const json& relight, SplatAsset& asset)
        : document_(document), bin_(bin), attributes_(attributes), relight_(relight), asset_(asset), count_(asset.cloud.count),
          shared_(fnv1a(asset.model.data(), asset.model.size()))
    {
    }

    void read()
    {
        asset_.channels = declaredChannels(relight_, asset_.model, count_);
        asset_.drawnVisibility = drawnVisibility(relight_);
        std::vector<bool> coded(asset_.channels.size(), false);
        const json& entries = need(relight_, "channels", kRelightExtension);
        for (size_t i = 0; i < asset_.channels.size(); ++i)
            if (Channel& channel = asset_.channels[i]; channel.perAsset) channel.values = sharedFloats(entries[i], "data", channel.components, channel.name);
        if (const json* groups = find(relight_, "coded")) readCoded(*groups, coded);
        for (size_t i = 0; i < asset_.channels.size(); ++i) {
            Channel& channel = asset_.channels[i];
            if (channel.leading > 0) bad("channel '" + channel.name + "' of profile interop has rows for some splats only");
            if (!channel.perAsset && !coded[i]) channel.values = floats(channel.name, channel.components);
        }
        checkStamps();
    }

private:
    std::vector<float> sharedFloats(const json& object, const char* key, size_t size, const std::string& where)
    {
        const json& text = need(object, key, where);
        std::vector<unsigned char> bytes;
        if (!text.is_string() || !fromBase64(text.get_ref<const std::string&>(), bytes) || bytes.size() != size * sizeof(float))
            bad(where + "." + key + " is not the base64 text of " + std::to_string(size) + " floats");
        std::vector<float> values(size);
        std::memcpy(values.data(), bytes.data(), bytes.size());
        shared_ = fnv1a(values.data(), bytes.size(), shared_);
        return values;
    }

    Rows part(const std::string& name, int components, size_t componentType)
    {
        constexpr const char* kTypes[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
        if (!find(attributes_, name.c_str())) bad("relighting data " + name + " are missing (dropped by a tool?)");
        const Rows rows = attribute(document_, bin_, attributes_, name, kTypes[components - 1], components, componentType);
        if (rows.count != count_) bad(name + " has " + std::to_string(rows.count) + " rows, " + kPosition + " has " + std::to_string(count_));
        used_ += count_ * size_t(components) * (componentType == kFloat ? 4 : 1);
        if (used_ / kMostSharing > bin_.size()) bad("relighting data share their bytes more than " + std::to_string(kMostSharing) + " times");
        return rows;
    }

    std::vector<float> floats(const std::string& name, size_t components)
    {
        std::vector<Rows> parts; // all checked before anything is allocated
        for (size_t k = 0; k < components; k += 4) parts.push_back(part(relightAttribute(name, k / 4), int(std::min<size_t>(4, components - k)), kFloat));
        std::vector<float> values(count_ * components);
        for (size_t p = 0; p < parts.size(); ++p)
            for (size_t i = 0; i < count_; ++i) parts[p].copy(i, &values[i * components + 4 * p]);
        return values;
    }

    void readCoded(const json& groups, std::vector<bool>& isCoded)
    {
        if (!groups.is_array() || groups.size() > 64) bad("coded is not an array of at most 64 entries");
        for (const json& entry : groups) {
            const std::string where = "coded[" + std::to_string(asset_.coded.size()) + "]";
            CodedChannels group;
            const json& names = need(entry, "channels", where);
            if (!names.is_array() || names.empty() || names.size() > 64) bad(where + ".channels is not an array of 1 to 64 names");
            for (const json& name : names) {
                size_t i = 0;
                while (i < asset_.channels.size() && name != asset_.channels[i].name) ++i;
                if (i == asset_.channels.size() || isCoded[i] || asset_.channels[i].perAsset) bad(where + " names a channel that cannot be coded");
                isCoded[i] = true;
                group.channels.push_back(asset_.channels[i].name);
                group.numbers += asset_.channels[i].components;
            }
            const size_t codes = needSize(entry, "codes", where);
            if (codes == 0 || codes > 4 * group.numbers) bad(where + ".codes is " + std::to_string(codes) + ", expected 1 to " + std::to_string(4 * group.numbers));
            group.codes = uint32_t(codes);
            group.offset = sharedFloats(entry, "offset", group.numbers, where);
            group.basis = sharedFloats(entry, "basis", codes * group.numbers, where);
            std::vector<Rows> parts;
            for (size_t k = 0; k < codes; k += 4) parts.push_back(part(relightAttribute(codesName(asset_.coded.size()), k / 4), 4, kUnorm8));
            group.values.resize(count_ * codes);
            for (size_t k = 0; k < codes; ++k)
                for (size_t i = 0; i < count_; ++i) group.values[i * codes + k] = int8_t(int(parts[k / 4].at(i)[k % 4]) - 128);
            asset_.coded.push_back(std::move(group));
        }
    }

    /// Positions that have changed, or splats of another asset put among these.
    void checkStamps()
    {
        const Rows stamps = part(kStamp, 4, kUnorm8);
        for (size_t i = 0; i < count_; ++i) {
            uint32_t stamp;
            std::memcpy(&stamp, stamps.at(i), 4);
            if (stamp != stampOf(shared_, asset_.cloud.positions[i])) bad("relighting data belong to other positions (edited by a tool?)");
        }
    }

    static constexpr size_t kMostSharing = 4; // tools store what is equal once

    const json& document_;
    const std::span<const std::byte> bin_;
    const json& attributes_;
    const json& relight_;
    SplatAsset& asset_;
    const size_t count_;
    uint64_t shared_;
    size_t used_ = 0;
};

SplatAsset readAssetOrThrow(std::span<const std::byte> bytes)
{
    const Result<GlbChunks> split = splitGlb(bytes);
    if (!split) throw Fault{split.error().code, split.error().message};
    const GlbChunks& chunks = *split;
    const json document = parseJson(chunks.json);
    const SplatPrimitive splats = findSplats(document);
    checkHeader(document, splats);

    const json& relight = *splats.relight;
    const json& attributes = need(*splats.primitive, "attributes", "the splat primitive");
    SplatAsset asset;
    asset.model = needName(relight, "model", kRelightExtension);
    asset.bakedWith = needString(relight, "bakedWith", kRelightExtension);
    asset.lowPassVariance =
        toFloat(need(need(relight, "screenFilter", kRelightExtension), "variance", "screenFilter"), "screenFilter.variance");
    asset.yUpFromAsset = nodeRotation(document, splats.mesh);
    asset.frame = datasetFrame(relight);
    asset.presets = readPresets(relight);

    asset.profile = needString(relight, "profile", kRelightExtension);
    const bool srgb = needString(*splats.splatting, "colorSpace", kSplatExtension) == kSrgbSpace;
    if (asset.profile == kInteropProfile) {
        const size_t count = attribute(document, chunks.bin, attributes, kPosition, "VEC3", 3).count;
        asset.cloud = readCloud(document, chunks.bin, attributes, count);
        asset.neutral = readNeutralLook(document, chunks.bin, attributes, lookFunctions(attributes), count);
        if (srgb) asset.neutral = toLinear(asset.neutral);
        InteropReader(document, chunks.bin, attributes, relight, asset).read();
        return asset;
    }
    const size_t count = needSize(relight, "count", kRelightExtension);
    if (asset.profile == kCompactProfile) {
        readCompact(document, chunks.bin, relight, count, asset);
        return asset;
    }
    asset.cloud = readCloud(document, chunks.bin, attributes, count);
    if (needString(relight, "positionHash", kRelightExtension) != positionHash(asset.cloud.positions))
        bad("relighting data belong to other positions (edited by a tool?); take the file as 'nacre bake' wrote it");
    asset.neutral = readNeutralLook(document, chunks.bin, attributes, needSize(relight, "neutralFunctions", kRelightExtension), count);
    if (srgb) asset.neutral = toLinear(asset.neutral);

    const json& channels = need(relight, "channels", kRelightExtension);
    if (!channels.is_array() || channels.size() > 64) bad("channels is not an array of at most 64 entries");
    for (const json& entry : channels) asset.channels.push_back(readChannel(document, chunks.bin, entry, asset.channels, count));
    return asset;
}

} // namespace

Result<SplatAsset> read(std::span<const std::byte> bytes)
{
    try {
        return readAssetOrThrow(bytes);
    } catch (const Fault& fault) {
        return Error{fault.code, fault.message};
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, "out of memory while reading an asset of " + std::to_string(bytes.size()) + " bytes"};
    } catch (const json::exception& e) { // nothing above should get here; a parser's surprise is still only a bad file
        return Error{ErrorCode::kBadInput, std::string("broken JSON: ") + e.what()};
    }
}

} // namespace nacre::glb
