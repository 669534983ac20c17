// GLB: magic 'glTF', version 2, total length; then chunks of length, type and that many bytes, padded to 4 (glTF 2.0, section 4.4).
#include "base/glb_container.h"

#include <cstdint>
#include <cstring>
#include <string>

namespace nacre {

static uint32_t u32At(std::span<const std::byte> bytes, size_t offset)
{
    uint32_t value;
    std::memcpy(&value, bytes.data() + offset, 4);
    return value;
}

bool looksLikeGlb(std::span<const std::byte> bytes) { return bytes.size() >= 4 && std::memcmp(bytes.data(), "glTF", 4) == 0; }

size_t glbLength(std::span<const std::byte> bytes) { return bytes.size() < 12 ? 0 : u32At(bytes, 8); }

Result<GlbChunks> splitGlb(std::span<const std::byte> bytes)
{
    constexpr uint32_t kJson = 0x4E4F534A, kBin = 0x004E4942;
    const auto bad = [](const std::string& message) { return Error{ErrorCode::kBadInput, message}; };
    const std::string size = std::to_string(bytes.size());
    if (bytes.size() < 20) return bad("not a .glb: " + size + " bytes, the headers alone take 20");
    if (!looksLikeGlb(bytes)) return bad("not a .glb: it does not begin with 'glTF'");
    if (u32At(bytes, 4) != 2)
        return Error{ErrorCode::kUnsupported, "GLB version " + std::to_string(u32At(bytes, 4)) + ", expected 2"};
    if (u32At(bytes, 8) != bytes.size())
        return bad("the GLB header says " + std::to_string(u32At(bytes, 8)) + " bytes, the file has " + size + " (truncated?)");

    GlbChunks chunks;
    size_t offset = 12;
    for (int i = 0; offset < bytes.size(); ++i) {
        if (bytes.size() - offset < 8) return bad("GLB chunk header cut off at byte " + std::to_string(offset));
        const size_t length = u32At(bytes, offset);
        const uint32_t type = u32At(bytes, offset + 4);
        offset += 8;
        if (length > bytes.size() - offset)
            return bad("GLB chunk " + std::to_string(i) + " needs " + std::to_string(length) + " bytes, " +
                       std::to_string(bytes.size() - offset) + " left");
        if ((type == kJson) != (i == 0)) return bad("the first GLB chunk, and only that one, must be JSON");
        if (type == kBin && i != 1) return bad("the binary GLB chunk must be the second");
        if (type == kJson) chunks.json = bytes.subspan(offset, length);
        if (type == kBin) chunks.bin = bytes.subspan(offset, length);
        offset += length; // chunks of other types are skipped, as glTF demands
        if (offset % 4 != 0) return bad("GLB chunk " + std::to_string(i) + " is not padded to 4 bytes");
    }
    return chunks;
}

} // namespace nacre
