// JPEG through stb_image, compiled into this file with internal linkage: other libraries export the same names. stb shows what is
// missing of a file as grey and believes any size, so checkSegments() walks the file before it is called (ITU T.81, annex B).
#include "interchange/jpeg.h"

#include <climits>
#include <memory>

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#pragma GCC diagnostic ignored "-Wsign-compare"
#endif
#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_JPEG
#define STBI_NO_STDIO
#define STBI_MAX_DIMENSIONS 65535
#include <stb/stb_image.h>
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

namespace nacre {
namespace {

constexpr size_t kMaxPixels = size_t(1) << 28;
constexpr size_t kMaxPixelsPerByte = 512; // a block of 64 pixels takes at least one bit

Error bad(const std::string& name, const std::string& what) { return {ErrorCode::kBadInput, name + ": " + what}; }

size_t bigEndian16(std::span<const std::byte> bytes, size_t at) { return (size_t(bytes[at]) << 8) | size_t(bytes[at + 1]); }

bool isFrameHeader(unsigned marker) { return marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc; }

/// Every segment lies inside the file, up to the end marker, and the size in the frame header can be true.
Status checkSegments(std::span<const std::byte> bytes, const std::string& name)
{
    const auto cutOff = [&] { return bad(name, "JPEG is cut off at byte " + std::to_string(bytes.size())); };
    bool hasFrame = false;
    for (size_t at = 2;;) {
        // The next marker: 0xff and neither a stuffed zero nor a restart (both belong to compressed data) nor a fill byte.
        while (at + 1 < bytes.size()) {
            const unsigned next = unsigned(bytes[at + 1]);
            if (unsigned(bytes[at]) == 0xff && next != 0 && next != 0xff && !(next >= 0xd0 && next <= 0xd7)) break;
            ++at;
        }
        if (at + 1 >= bytes.size()) return cutOff();
        const unsigned marker = unsigned(bytes[at + 1]);
        if (marker == 0xd9) return hasFrame ? ok() : Status(bad(name, "broken JPEG: no image in it"));
        at += 2;
        if (marker == 0x01) continue; // has no length
        if (bytes.size() - at < 2 || bigEndian16(bytes, at) > bytes.size() - at) return cutOff();
        const size_t length = bigEndian16(bytes, at);
        if (length < 2) return bad(name, "broken JPEG: segment of length " + std::to_string(length) + " at byte " + std::to_string(at));
        if (isFrameHeader(marker)) {
            if (length < 8) return bad(name, "broken JPEG: frame header of length " + std::to_string(length));
            const size_t height = bigEndian16(bytes, at + 3), width = bigEndian16(bytes, at + 5);
            if (width < 1 || height < 1 || width * height > kMaxPixels)
                return bad(name, "JPEG of " + std::to_string(width) + " x " + std::to_string(height) + " pixels, expected at most 2^28 pixels");
            if (width * height / kMaxPixelsPerByte > bytes.size())
                return bad(name, "JPEG header claims " + std::to_string(width) + " x " + std::to_string(height) +
                                     " pixels but the file has only " + std::to_string(bytes.size()) + " bytes");
            hasFrame = true;
        }
        at += length;
    }
}

} // namespace

bool looksLikeJpeg(std::span<const std::byte> bytes)
{
    return bytes.size() >= 3 && unsigned(bytes[0]) == 0xff && unsigned(bytes[1]) == 0xd8 && unsigned(bytes[2]) == 0xff;
}

Result<Image8> decodeJpeg(std::span<const std::byte> bytes, const std::string& name)
{
    if (!looksLikeJpeg(bytes)) return bad(name, "not a JPEG file (" + std::to_string(bytes.size()) + " bytes)");
    if (bytes.size() > size_t(INT_MAX)) return bad(name, "JPEG larger than 2 GiB");
    if (Status s = checkSegments(bytes, name); !s) return s.error();

    int w = 0, h = 0, channels = 0;
    stbi_uc* decoded = stbi_load_from_memory(reinterpret_cast<const stbi_uc*>(bytes.data()), int(bytes.size()), &w, &h, &channels, 4);
    const std::unique_ptr<stbi_uc, void (*)(void*)> owner(decoded, stbi_image_free);
    if (!decoded) return bad(name, std::string("broken JPEG: ") + stbi_failure_reason());
    return Image8{w, h, std::vector<uint8_t>(decoded, decoded + size_t(w) * size_t(h) * 4)};
}

} // namespace nacre
