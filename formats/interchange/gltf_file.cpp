// Opening a glTF 2.0 file: .glb or .gltf, base64 and external buffers, extensions.
#include "interchange/gltf_file.h"

#include "base/glb_container.h"
#include "base/text.h"

#include <algorithm>
#include <cctype>

namespace nacre::gltf {

void bad(const std::string& message) { throw Fault{ErrorCode::kBadInput, message}; }
void unsupported(const std::string& message) { throw Fault{ErrorCode::kUnsupported, message}; }

// ---- extensions ---------------------------------------------------------------------------------------------------------------

namespace {

struct KnownExtension {
    const char* name;
    bool mayBeRequired; // false: without it the picture would be wrong, so a file that requires it is refused
};
constexpr KnownExtension kKnownExtensions[] = {
    {"KHR_draco_mesh_compression", true},
    {"KHR_mesh_quantization", true}, // only allows more component types, which accessors read anyway
    {"KHR_texture_transform", true},
    {"KHR_materials_ior", true},
    {"KHR_materials_specular", true},
    {"KHR_materials_anisotropy", true},
    {"KHR_materials_clearcoat", true},
    {"KHR_materials_iridescence", true},
    {"KHR_materials_transmission", true},
    {"KHR_materials_diffuse_transmission", true}, // with KHR_materials_volume_scatter; alone it has its own warning
    {"KHR_materials_volume", true},
    {"KHR_materials_volume_scatter", true},
    {"KHR_materials_emissive_strength", true}, // emission has its own warning
    {"KHR_materials_unlit", true},             // has its own warning
    {"KHR_lights_punctual", true},             // has its own warning
    {"KHR_materials_pbrSpecularGlossiness", false}, // has its own warning
    {"KHR_animation_pointer", true},           // animations have their own warning
    {"KHR_node_visibility", true},
    {"EXT_mesh_gpu_instancing", true},
    {"KHR_materials_variants", true},          // the default variant is the plain material
    {"KHR_xmp_json_ld", true},                 // authors and licences
    {"KHR_xmp", true},
};

const KnownExtension* findKnown(const std::string& name)
{
    const auto it = std::find_if(std::begin(kKnownExtensions), std::end(kKnownExtensions), [&](const auto& e) { return name == e.name; });
    return it == std::end(kKnownExtensions) ? nullptr : it;
}

std::string whatToTry(const std::string& extension)
{
    if (extension.find("meshopt") != std::string::npos) return "export without meshopt compression (KHR_draco_mesh_compression works)";
    if (extension == "KHR_texture_basisu" || extension.find("EXT_texture") == 0 || extension == "MSFT_texture_dds")
        return "convert the textures to PNG or JPEG";
    if (extension == "KHR_materials_pbrSpecularGlossiness") return "convert the materials to metallic-roughness";
    return "export without it";
}

/// What the picture lacks if an extension that the file uses is ignored.
std::string effectOf(const std::string& extension)
{
    struct Effect {
        const char *name, *effect;
    };
    constexpr Effect kEffects[] = {
        {"KHR_materials_sheen", "cloth has no sheen"},
        {"KHR_materials_dispersion", "glass does not split colours"},
        {"KHR_materials_retroreflection", "nothing shines back at the light"},
        {"KHR_materials_diffuse_roughness", "diffuse surfaces are Lambertian"},
        {"EXT_lights_image_based", "the light stage lights the scene"},
        {"EXT_meshopt_compression", "its uncompressed copy is read"},
        {"KHR_meshopt_compression", "its uncompressed copy is read"},
        {"KHR_texture_basisu", "the PNG or JPEG is read"},
        {"EXT_texture_webp", "the PNG or JPEG is read"},
        {"EXT_texture_avif", "the PNG or JPEG is read"},
        {"MSFT_texture_dds", "the PNG or JPEG is read"},
        {"MSFT_lod", "the finest level is shown, and others if they are nodes of the scene"},
        {"KHR_gaussian_splatting", "splats are no surface"},
        {"CESIUM_RTC", "the object stands at the origin"},
    };
    for (const Effect& e : kEffects)
        if (extension == e.name) return std::string(" (") + e.effect + ")";
    return "";
}

// ---- URIs ---------------------------------------------------------------------------------------------------------------------

int base64Value(char c)
{
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    if (c == '+' || c == '-') return 62; // '-' and '_': the alphabet for URLs
    if (c == '/' || c == '_') return 63;
    return -1;
}

/// RFC 4648; padding may be missing.
std::vector<std::byte> decodeBase64(std::string_view text, const std::string& where)
{
    while (!text.empty() && text.back() == '=') text.remove_suffix(1);
    std::vector<std::byte> out;
    out.reserve(text.size() / 4 * 3 + 2);
    uint32_t bits = 0;
    int bitCount = 0;
    for (size_t i = 0; i < text.size(); ++i) {
        const int value = base64Value(text[i]);
        if (value < 0) bad(where + ": character " + std::to_string(i) + " of the embedded data is not base64");
        bits = (bits << 6) | uint32_t(value);
        if ((bitCount += 6) >= 8) out.push_back(std::byte(bits >> (bitCount -= 8)));
    }
    if (text.size() % 4 == 1) bad(where + ": the embedded base64 data is cut off");
    return out;
}

int hexValue(char c)
{
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

std::string percentDecode(std::string_view text)
{
    std::string out;
    for (size_t i = 0; i < text.size(); ++i) {
        const bool escape = text[i] == '%' && i + 2 < text.size() && hexValue(text[i + 1]) >= 0 && hexValue(text[i + 2]) >= 0;
        out += escape ? char(16 * hexValue(text[i + 1]) + hexValue(text[i + 2])) : text[i];
        if (escape) i += 2;
    }
    return out;
}

/// A file may name files in its folder and below, nothing else on the user's disk.
void checkStaysInFolder(const std::string& path, const std::string& where)
{
    const auto refuse = [&](const char* why) {
        bad(where + ": " + inQuotes(path) + " " + why + "; put the file into the folder of the .gltf and name it relative to that");
    };
    if (path.empty()) bad(where + ": the name is empty");
    if (path.size() > 4096 || path.find('\0') != std::string::npos) bad(where + ": not a name of a file");
    if (path[0] == '/' || path[0] == '\\') refuse("is an absolute path");
    const size_t colon = path.find(':');
    if (colon != std::string::npos && path.find_first_of("/\\") > colon && std::isalpha(static_cast<unsigned char>(path[0])))
        refuse("has a URL scheme or a drive");
    int depth = 0;
    for (size_t begin = 0; begin <= path.size();) {
        const size_t end = std::min(path.find_first_of("/\\", begin), path.size());
        const std::string_view part = std::string_view(path).substr(begin, end - begin);
        if (part == "..") depth--;
        else if (!part.empty() && part != ".") depth++;
        if (depth < 0) refuse("leads out of the folder");
        begin = end + 1;
    }
}

/// Bounds the tree before the parser builds it: separators outside strings are as many as values.
void checkValueCount(std::span<const std::byte> text)
{
    size_t separators = 0;
    bool inString = false;
    for (size_t i = 0; i < text.size(); ++i) {
        const char c = char(text[i]);
        if (inString) {
            if (c == '\\') ++i;
            else if (c == '"') inString = false;
        } else if (c == '"') {
            inString = true;
        } else if (c == ',' || c == '[' || c == '{') {
            ++separators;
        }
    }
    if (separators > kMaxJsonValues)
        bad("the JSON holds " + std::to_string(separators) + " values, at most " + std::to_string(kMaxJsonValues) + " are accepted");
}

} // namespace

// ---- File ---------------------------------------------------------------------------------------------------------------------

File::File(std::span<const std::byte> bytes, const UriReader& readUri, uint64_t maxDecodedBytes)
    : readUri_(readUri), maxDecodedBytes_(maxDecodedBytes), bytesLeft_(maxDecodedBytes)
{
    GlbChunks chunks{bytes, {}};
    const bool isGlb = looksLikeGlb(bytes);
    if (isGlb) {
        // A GLB ends where its header says (section 4.4.2); what stands behind is padding of a download or of an archive.
        constexpr size_t kHeaders = 20;
        if (const size_t length = glbLength(bytes); length >= kHeaders && length < bytes.size()) {
            warn("ignored: " + std::to_string(bytes.size() - length) + " bytes behind the end of the GLB (its header says " + std::to_string(length) + " bytes)");
            bytes = bytes.first(length);
        }
        const Result<GlbChunks> split = splitGlb(bytes);
        if (!split) throw Fault{split.error().code, split.error().message};
        chunks = *split;
    }
    checkValueCount(chunks.json);
    Result<JsonDocument> document = JsonDocument::parse(chunks.json, "JSON");
    if (!document)
        throw Fault{document.error().code, isGlb ? document.error().message : "neither .glb nor .gltf: " + document.error().message};
    document_.emplace(std::move(*document));
    if (!root().isObject()) bad("not glTF: the JSON is not an object");

    checkVersionAndExtensions();
    accessors = list("accessors");
    bufferViews = list("bufferViews");
    meshes = list("meshes");
    nodes = list("nodes");
    scenes = list("scenes");
    materials = list("materials");
    textures = list("textures");
    images = list("images");
    samplers = list("samplers");
    skins = list("skins");
    check();
    loadBuffers(chunks.bin, isGlb);
}

void File::check() const
{
    if (!document_->failed()) return;
    // The document's name in front is for its other users; here decodeGltf() puts the name of the file there.
    throw Fault{document_->error().code, document_->error().message.substr(document_->name().size() + 2)};
}

void File::warn(const std::string& line)
{
    constexpr size_t kMaxWarnings = 50;
    if (warned_.size() > kMaxWarnings || !warned_.insert(line).second) return;
    warnings.push_back(warned_.size() > kMaxWarnings ? "more warnings of this file are left out" : line);
}

void File::take(uint64_t count, uint64_t bytesEach, const std::string& what)
{
    if (bytesEach != 0 && count > bytesLeft_ / bytesEach)
        bad(what + " would make the decoded scene larger than the limit of " + std::to_string(maxDecodedBytes_ >> 20) +
            " MiB; simplify the meshes, shrink the textures or use fewer instances");
    bytesLeft_ -= count * bytesEach;
}

std::vector<JsonNode> File::list(const char* key) const
{
    const JsonNode node = root()[key];
    if (!node.exists()) return {};
    if (!node.isArray()) bad(std::string(key) + " is not an array");
    return node.items();
}

size_t File::index(const std::vector<JsonNode>& list, const JsonNode& node) const
{
    const uint64_t i = node.size(UINT32_MAX);
    check();
    if (i >= list.size()) bad(node.where() + " is " + std::to_string(i) + ", but there are " + std::to_string(list.size()));
    return i;
}

void File::checkVersionAndExtensions()
{
    const JsonNode asset = root()["asset"];
    if (!asset.exists()) bad("not glTF: the JSON has no 'asset'");
    const std::string version = asset["version"].string();
    check();
    if (version.rfind("2.", 0) != 0) unsupported("glTF version " + inQuotes(version) + ", expected 2.0; export as glTF 2.0");
    if (asset["minVersion"].exists() && asset["minVersion"].string() != "2.0")
        unsupported("glTF minVersion " + inQuotes(asset["minVersion"].string()) + ", expected 2.0");

    for (const JsonNode& node : list("extensionsRequired")) {
        const std::string extension = node.string();
        const KnownExtension* known = findKnown(extension);
        if (!known || !known->mayBeRequired)
            unsupported("the file requires the extension " + inQuotes(extension) + ", which is not supported; " + whatToTry(extension));
    }
    std::string unknown;
    for (const JsonNode& node : list("extensionsUsed"))
        if (const std::string extension = node.string(); !findKnown(extension))
            unknown += (unknown.empty() ? "" : ", ") + oneLine(extension, 80) + effectOf(extension);
    if (!unknown.empty()) warn("ignored: extensions " + oneLine(unknown, 1200) + "; the pictures lack what they add");
    check();
}

void File::loadBuffers(std::span<const std::byte> bin, bool isGlb)
{
    const std::vector<JsonNode> buffers = list("buffers");
    fetched_.resize(buffers.size());
    for (size_t i = 0; i < buffers.size(); ++i) {
        const JsonNode uri = buffers[i]["uri"];
        const uint64_t length = buffers[i]["byteLength"].size(uint64_t(1) << 40);
        check();
        std::span<const std::byte> bytes;
        for (const char* name : {"EXT_meshopt_compression", "KHR_meshopt_compression"})
            if (!uri.exists() && i > 0 && extension(buffers[i], name).exists())
                unsupported(buffers[i].where() + " is there only in compressed form (" + name + "); " + whatToTry(name));
        if (uri.exists()) {
            fetched_[i] = fetch(uri);
            take(fetched_[i].size(), 1, buffers[i].where());
            bytes = fetched_[i];
        } else if (i == 0 && isGlb) {
            bytes = bin;
        } else {
            bad(buffers[i].where() + " has no uri" + (i == 0 ? " (only a .glb may leave it out)" : ""));
        }
        if (bytes.size() < length)
            bad(buffers[i].where() + " has " + std::to_string(bytes.size()) + " bytes, the file promises " + std::to_string(length));
        buffers_.push_back(bytes.first(length));
    }
}

File::View File::view(const JsonNode& index) const
{
    const JsonNode& node = at(bufferViews, index);
    const uint64_t buffer = node["buffer"].size(UINT32_MAX), length = node["byteLength"].size(uint64_t(1) << 40);
    const uint64_t offset = node["byteOffset"].exists() ? node["byteOffset"].size(uint64_t(1) << 40) : 0;
    View view;
    view.stride = node["byteStride"].exists() ? size_t(node["byteStride"].integer(4, 252)) : 0;
    view.where = node.where();
    check();
    if (buffer >= buffers_.size())
        bad(view.where + ".buffer is " + std::to_string(buffer) + ", but there are " + std::to_string(buffers_.size()));
    const std::span<const std::byte> bytes = buffers_[buffer];
    if (offset > bytes.size() || length > bytes.size() - offset)
        bad(view.where + " ends at byte " + std::to_string(offset + length) + ", its buffer has " + std::to_string(bytes.size()));
    view.bytes = bytes.subspan(offset, length);
    return view;
}

std::vector<std::byte> File::fetch(const JsonNode& uri) const
{
    const std::string_view text = uri.text();
    check();
    if (text.rfind("data:", 0) == 0) {
        const size_t comma = text.find(',');
        constexpr std::string_view kBase64 = ";base64";
        if (comma == std::string_view::npos || comma < 5 + kBase64.size() || text.substr(comma - kBase64.size(), kBase64.size()) != kBase64)
            bad(uri.where() + " is a data: URI that is not base64");
        return decodeBase64(text.substr(comma + 1), uri.where());
    }
    if (text.size() > 4096) bad(uri.where() + " is a name of " + std::to_string(text.size()) + " bytes");
    const std::string path = percentDecode(text);
    checkStaysInFolder(path, uri.where());
    if (!readUri_) bad(uri.where() + " names the file " + inQuotes(path) + ", and there are no files to read here");
    Result<std::vector<std::byte>> bytes = readUri_(path);
    if (!bytes) throw Fault{bytes.error().code, uri.where() + ": " + bytes.error().message};
    return std::move(*bytes);
}

} // namespace nacre::gltf
