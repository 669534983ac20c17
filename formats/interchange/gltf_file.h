// Inside the glTF reader: an opened file. Container, JSON, extensions, buffers and what may still be decoded.
//
// Within the reader (gltf*.cpp) a fault is thrown and becomes an Error at the one way out, decodeGltf(): the code then reads like
// the specification. Mismatches of the JSON collect in the document; check() turns the first into a fault.
#pragma once

#include "interchange/gltf.h"
#include "interchange/json.h"

#include <cstdint>
#include <optional>
#include <set>

namespace nacre::gltf {

/// What one file may decode to, geometry, textures and external buffers together; taken before it is allocated (geometry) or kept
/// (textures and buffers, each of which has limits of its own).
constexpr uint64_t kMaxDecodedBytes = uint64_t(8) << 30;
/// JSON values in a file: a parsed value takes up to 100 bytes.
constexpr size_t kMaxJsonValues = size_t(1) << 23;

struct Fault {
    ErrorCode code;
    std::string message; // without the name of the file
};

[[noreturn]] void bad(const std::string& message);
[[noreturn]] void unsupported(const std::string& message);

class File {
public:
    /// Reads the container and the JSON, checks version and extensions, fetches the buffers.
    File(std::span<const std::byte> bytes, const UriReader& readUri, uint64_t maxDecodedBytes);
    File(const File&) = delete;

    /// Throws the first mismatch found in the JSON, if there is one.
    void check() const;
    /// One line for the user; the same line once, and not more than a screenful of lines.
    void warn(const std::string& line);
    /// Takes `count` * `bytesEach` from what may still be decoded.
    void take(uint64_t count, uint64_t bytesEach, const std::string& what);

    /// The bytes of a bufferView and its stride (0: tightly packed).
    struct View {
        std::span<const std::byte> bytes;
        size_t stride = 0;
        std::string where;
    };
    View view(const JsonNode& index) const;
    /// What the JSON gives as index into one of the lists below, and the element there.
    size_t index(const std::vector<JsonNode>& list, const JsonNode& node) const;
    const JsonNode& at(const std::vector<JsonNode>& list, const JsonNode& node) const { return list[index(list, node)]; }
    /// What a URI stands for: embedded data, or a file beside this one.
    std::vector<std::byte> fetch(const JsonNode& uri) const;

    JsonNode root() const { return document_->root(); }
    static JsonNode extension(const JsonNode& object, const char* name) { return object["extensions"][name]; }

    std::vector<JsonNode> accessors, bufferViews, meshes, nodes, scenes, materials, textures, images, samplers, skins;
    std::vector<std::string> warnings;

private:
    std::vector<JsonNode> list(const char* key) const;
    void checkVersionAndExtensions();
    void loadBuffers(std::span<const std::byte> bin, bool isGlb);

    std::optional<JsonDocument> document_;
    const UriReader& readUri_;
    std::vector<std::span<const std::byte>> buffers_;
    std::vector<std::vector<std::byte>> fetched_; // what buffers_ points into, if not the file itself
    std::set<std::string> warned_;
    uint64_t maxDecodedBytes_, bytesLeft_;
};

/// decodeGltf() with a limit of the caller's choice, which the tests make small.
Result<MeshScene> decodeWithin(uint64_t maxDecodedBytes, std::span<const std::byte> bytes, const std::string& name, const UriReader& readUri);

} // namespace nacre::gltf
