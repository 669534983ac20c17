// PNG through stb_image and stb_image_write, both compiled into this file with internal linkage: other libraries export the
// same names. stb checks neither sizes against the file nor checksums, so checkChunks() does both before it is called.
#include "interchange/png.h"

#include "base/file.h"
#include "interchange/inflate.h"

#include <algorithm>
#include <array>
#include <climits>
#include <cstring>
#include <memory>
#include <string_view>
#include <vector>

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#pragma GCC diagnostic ignored "-Wsign-compare"
#endif
#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#define STBI_NO_STDIO
#define STBI_MAX_DIMENSIONS 65536
#include <stb/stb_image.h>
#define STB_IMAGE_WRITE_STATIC
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STBI_WRITE_NO_STDIO
#include <stb/stb_image_write.h>
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

namespace nacre {
namespace {

constexpr uint32_t kMaxSide = 65536;
constexpr size_t kMaxPixels = size_t(1) << 28;
constexpr size_t kMaxDeflateRatio = 1032; // one deflate symbol of 2 bits gives at most 258 bytes

Error bad(const std::string& name, const std::string& what) { return {ErrorCode::kBadInput, name + ": " + what}; }

uint32_t bigEndian(std::span<const std::byte> bytes, size_t at)
{
    uint32_t v = 0;
    for (size_t i = 0; i < 4; i++) v = (v << 8) | uint32_t(bytes[at + i]);
    return v;
}

uint32_t crc32(std::span<const std::byte> bytes)
{
    static const std::array<uint32_t, 256> kTable = [] {
        std::array<uint32_t, 256> t{};
        for (uint32_t n = 0; n < 256; n++) {
            uint32_t c = n;
            for (int k = 0; k < 8; k++) c = (c & 1) ? 0xedb88320u ^ (c >> 1) : c >> 1;
            t[n] = c;
        }
        return t;
    }();
    uint32_t c = 0xffffffffu;
    for (std::byte b : bytes) c = kTable[(c ^ uint32_t(b)) & 0xff] ^ (c >> 8);
    return c ^ 0xffffffffu;
}

struct PngHeader {
    uint32_t width = 0, height = 0, bitDepth = 0, colorType = 0;
};

constexpr unsigned char kSignature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};

/// Reads the first chunk: signature, length 13, "IHDR", width, height, bit depth, colour type.
Result<PngHeader> readHeader(std::span<const std::byte> bytes, size_t fileSize, const std::string& name)
{
    if (bytes.size() < 33 || std::memcmp(bytes.data(), kSignature, 8) != 0 || std::memcmp(bytes.data() + 12, "IHDR", 4) != 0)
        return bad(name, "not a PNG file (" + std::to_string(fileSize) + " bytes)");
    const PngHeader h{bigEndian(bytes, 16), bigEndian(bytes, 20), uint32_t(bytes[24]), uint32_t(bytes[25])};
    const uint32_t colorType = h.colorType;
    if (h.width < 1 || h.height < 1 || h.width > kMaxSide || h.height > kMaxSide || size_t(h.width) * h.height > kMaxPixels)
        return bad(name, "PNG of " + std::to_string(h.width) + " x " + std::to_string(h.height) +
                             " pixels, expected 1 to 65536 per side and at most 2^28 pixels");
    const size_t samples = colorType == 2 ? 3 : colorType == 4 ? 2 : colorType == 6 ? 4 : 1;
    const size_t rawBytes = (size_t(h.width) * samples * h.bitDepth + 7) / 8 * h.height;
    if (rawBytes / kMaxDeflateRatio > fileSize)
        return bad(name, "PNG header claims " + std::to_string(h.width) + " x " + std::to_string(h.height) + " pixels but the file has only " +
                             std::to_string(fileSize) + " bytes");
    return h;
}

/// Every chunk lies inside the file with the right checksum and a type that may be there, and the last one is IEND. stb would quote
/// the bytes of an unknown type in its message, from a buffer that all threads share.
Status checkChunks(std::span<const std::byte> bytes, const std::string& name)
{
    for (size_t at = 8;;) {
        if (bytes.size() - at < 12) return bad(name, "PNG is cut off at byte " + std::to_string(bytes.size()));
        const size_t length = bigEndian(bytes, at);
        if (length > bytes.size() - at - 12) return bad(name, "PNG is cut off at byte " + std::to_string(bytes.size()));
        if (crc32(bytes.subspan(at + 4, length + 4)) != bigEndian(bytes, at + 8 + length))
            return bad(name, "damaged PNG: checksum of the chunk at byte " + std::to_string(at) + " does not match");
        const std::string type(reinterpret_cast<const char*>(bytes.data()) + at + 4, 4);
        const bool critical = (type[0] & 0x20) == 0;
        if (critical && type != "IHDR" && type != "PLTE" && type != "IDAT" && type != "IEND")
            return bad(name, "broken PNG: unknown kind of chunk at byte " + std::to_string(at));
        if (type == "IEND") return ok();
        at += length + 12;
    }
}

/// The chunks of a checked file, in order: kind and data.
template <class F>
void forEachChunk(std::span<const std::byte> bytes, F&& f)
{
    for (size_t at = 8; at + 12 <= bytes.size();) {
        const size_t length = bigEndian(bytes, at);
        const std::string_view kind(reinterpret_cast<const char*>(bytes.data()) + at + 4, 4);
        f(kind, bytes.subspan(at + 8, length));
        if (kind == "IEND") return;
        at += length + 12;
    }
}

PngColor colorOf(std::span<const std::byte> bytes)
{
    PngColor out;
    bool pixels = false; // what comes after them does not count
    forEachChunk(bytes, [&](std::string_view kind, std::span<const std::byte> data) {
        pixels = pixels || kind == "IDAT";
        if (pixels) return;
        if (kind == "gAMA" && data.size() == 4) out.gamma = bigEndian(data, 0) / 1e5;
        if (kind == "sRGB" && data.size() == 1) out.isSrgb = true;
        if (kind == "iCCP") {
            const auto* name = reinterpret_cast<const char*>(data.data());
            out.profile.assign(name, std::find(name, name + std::min<size_t>(data.size(), 80), '\0'));
            if (out.profile.empty()) out.profile = "without a name";
        }
        if (kind == "cHRM" && data.size() == 32) {
            const auto xy = [&](size_t i) { return glm::dvec2(bigEndian(data, 8 * i) / 1e5, bigEndian(data, 8 * i + 4) / 1e5); };
            out.primaries = {xy(1), xy(2), xy(3), xy(0)};
        }
    });
    return out;
}

void appendChunk(std::vector<std::byte>& out, std::string_view kind, std::span<const std::byte> data)
{
    for (int shift = 24; shift >= 0; shift -= 8) out.push_back(std::byte(data.size() >> shift));
    const size_t start = out.size();
    for (char c : kind) out.push_back(std::byte(c));
    out.insert(out.end(), data.begin(), data.end());
    const uint32_t crc = crc32(std::span(out).subspan(start));
    for (int shift = 24; shift >= 0; shift -= 8) out.push_back(std::byte(crc >> shift));
}

/// stb takes the colour of an index beyond the palette from memory that nothing has set. So the same pixels are decoded with the palette
/// 0, 1, 2, ..., which gives the indices.
Status checkPalette(std::span<const std::byte> bytes, const PngHeader& header, const std::string& name)
{
    if (header.colorType != 3) return ok();
    std::array<std::byte, 768> identity{};
    for (size_t i = 0; i < identity.size(); ++i) identity[i] = std::byte(i / 3);
    std::vector<std::byte> indexed(bytes.begin(), bytes.begin() + 33); // signature and IHDR
    appendChunk(indexed, "PLTE", identity);
    size_t colors = 0;
    forEachChunk(bytes, [&](std::string_view kind, std::span<const std::byte> data) {
        if (kind == "PLTE") colors = data.size() / 3;
        if (kind == "IDAT" || kind == "IEND") appendChunk(indexed, kind, data);
    });
    if (colors == 0) return bad(name, "broken PNG: colours by index, and no palette");
    if (indexed.size() > size_t(INT_MAX)) return bad(name, "PNG larger than 2 GiB");
    int w = 0, h = 0, channels = 0;
    stbi_uc* decoded = stbi_load_from_memory(reinterpret_cast<const stbi_uc*>(indexed.data()), int(indexed.size()), &w, &h, &channels, 1);
    const std::unique_ptr<stbi_uc, void (*)(void*)> owner(decoded, stbi_image_free);
    if (!decoded) return bad(name, std::string("broken PNG: ") + stbi_failure_reason());
    const stbi_uc *first = decoded, *wrong = std::max_element(first, first + size_t(w) * size_t(h));
    if (*wrong < colors) return ok();
    const size_t pixel = size_t(wrong - first);
    return bad(name, "broken PNG: palette index " + std::to_string(*wrong) + " of " + std::to_string(colors) + " colours at pixel (" +
                         std::to_string(pixel % size_t(w)) + ", " + std::to_string(pixel / size_t(w)) + ")");
}

/// Everything stb would believe, checked before it is called.
Result<PngHeader> checkFile(std::span<const std::byte> bytes, const std::string& name)
{
    Result<PngHeader> header = readHeader(bytes, bytes.size(), name);
    if (!header) return header;
    if (Status s = checkChunks(bytes, name); !s) return s.error();
    if (bytes.size() > size_t(INT_MAX)) return bad(name, "PNG larger than 2 GiB");
    if (Status s = checkPalette(bytes, *header, name); !s) return s.error();
    return header;
}

} // namespace

std::optional<std::vector<std::byte>> inflateZlib(std::span<const std::byte> zlib, size_t maxBytes)
{
    if (zlib.size() < 6 || zlib.size() > size_t(INT_MAX) || maxBytes > size_t(INT_MAX)) return std::nullopt;
    std::vector<std::byte> out(maxBytes);
    const int size = stbi_zlib_decode_buffer(reinterpret_cast<char*>(out.data()), int(maxBytes), reinterpret_cast<const char*>(zlib.data()), int(zlib.size()));
    if (size < 0 && std::string_view(stbi_failure_reason()) == "output buffer limit") return std::vector<std::byte>();
    if (size <= 0) return std::nullopt;
    out.resize(size_t(size));
    uint32_t a = 1, b = 0; // Adler-32, which ends the stream
    for (const std::byte x : out) a = (a + uint32_t(x)) % 65521, b = (b + a) % 65521;
    if (bigEndian(zlib, zlib.size() - 4) != (b << 16 | a)) return std::nullopt;
    return out;
}

bool looksLikePng(std::span<const std::byte> bytes) { return bytes.size() >= 8 && std::memcmp(bytes.data(), kSignature, 8) == 0; }

Result<Image8> decodePng8(std::span<const std::byte> bytes, const std::string& name)
{
    if (Result<PngHeader> header = checkFile(bytes, name); !header) return header.error();
    int w = 0, h = 0, channels = 0;
    stbi_uc* decoded = stbi_load_from_memory(reinterpret_cast<const stbi_uc*>(bytes.data()), int(bytes.size()), &w, &h, &channels, 4);
    const std::unique_ptr<stbi_uc, void (*)(void*)> owner(decoded, stbi_image_free);
    if (!decoded) return bad(name, std::string("broken PNG: ") + stbi_failure_reason());
    return Image8{w, h, std::vector<uint8_t>(decoded, decoded + size_t(w) * size_t(h) * 4)};
}

Result<Image> decodePng(std::span<const std::byte> bytes, const std::string& name, PngColor* color)
{
    const Result<PngHeader> header = checkFile(bytes, name);
    if (!header) return header.error();
    if (color) *color = colorOf(bytes);
    const auto* data = reinterpret_cast<const stbi_uc*>(bytes.data());
    const int size = int(bytes.size());
    const bool wide = header->bitDepth == 16;
    int w = 0, h = 0, channels = 0;
    void* decoded = wide ? static_cast<void*>(stbi_load_16_from_memory(data, size, &w, &h, &channels, 4))
                         : static_cast<void*>(stbi_load_from_memory(data, size, &w, &h, &channels, 4));
    const std::unique_ptr<void, void (*)(void*)> owner(decoded, stbi_image_free);
    if (!decoded) return bad(name, std::string("broken PNG: ") + stbi_failure_reason());

    Image image{w, h, std::vector<float>(size_t(w) * size_t(h) * 4)};
    for (size_t i = 0; i < image.rgba.size(); i++)
        image.rgba[i] = wide ? float(static_cast<const uint16_t*>(decoded)[i]) / 65535.0f : float(static_cast<const uint8_t*>(decoded)[i]) / 255.0f;
    return image;
}

Result<Image> readPng(const std::string& path, PngColor* color)
{
    Result<std::vector<std::byte>> bytes = readFile(path);
    if (!bytes) return bytes.error();
    return decodePng(*bytes, path, color);
}

Result<Image> readPngSize(const std::string& path)
{
    const Result<FileStart> start = readFileStart(path, 64);
    if (!start) return start.error();
    const Result<PngHeader> header = readHeader(start->bytes, start->fileSize, path);
    if (!header) return header.error();
    return Image{int(header->width), int(header->height), {}};
}

Result<std::vector<std::byte>> encodePng(const std::string& name, int width, int height, int channels, std::span<const uint8_t> pixels)
{
    if (width < 1 || height < 1 || uint32_t(width) > kMaxSide || uint32_t(height) > kMaxSide || (channels != 3 && channels != 4) ||
        size_t(width) * size_t(height) > kMaxPixels || pixels.size() != size_t(width) * size_t(height) * size_t(channels))
        return bad(name, "cannot write a PNG of " + std::to_string(width) + " x " + std::to_string(height) + " x " + std::to_string(channels) +
                             " from " + std::to_string(pixels.size()) + " bytes");
    std::vector<std::byte> encoded;
    const auto append = [](void* context, void* data, int size) {
        auto& out = *static_cast<std::vector<std::byte>*>(context);
        const auto* bytes = static_cast<const std::byte*>(data);
        out.insert(out.end(), bytes, bytes + size);
    };
    if (!stbi_write_png_to_func(append, &encoded, width, height, channels, pixels.data(), width * channels) || encoded.empty())
        return Error{ErrorCode::kIo, name + ": cannot encode PNG"};
    return encoded;
}

Status writePng(const std::string& path, int width, int height, int channels, std::span<const uint8_t> pixels)
{
    const Result<std::vector<std::byte>> encoded = encodePng(path, width, height, channels, pixels);
    return encoded ? writeFileAtomically(path, *encoded) : encoded.error();
}

} // namespace nacre
