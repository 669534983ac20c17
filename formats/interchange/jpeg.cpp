// JPEG through libjpeg(-turbo). Not through stb_image, which overruns its tables on damaged ones (the version Debian 12 has) and shows
// missing data as grey.
//
// libjpeg reports an error by a function that must not return. It jumps back into decodeInto(), which therefore holds nothing
// that needs a destructor; what does lives in decodeJpeg().
#include "interchange/jpeg.h"

#include "base/file.h"
#include "base/text.h"

#include <algorithm>
#include <cassert>
#include <csetjmp>
#include <cstdio> // jpeglib.h needs it
#include <cstdlib>
#include <cstring>
#include <jerror.h>
#include <jpeglib.h>

namespace nacre {
namespace {

constexpr size_t kMaxPixels = size_t(1) << 28;
constexpr size_t kMaxPixelsPerByte = 512; // a block of 64 pixels takes at least one bit
constexpr int kMaxScans = 200;            // of a progressive file, which costs a pass over the image for each; usual are 10

struct Decoder {
    jpeg_decompress_struct info;
    jpeg_error_mgr errors;
    jpeg_progress_mgr progress;
    std::jmp_buf failed;
    ErrorCode code = ErrorCode::kBadInput;
    char message[JMSG_LENGTH_MAX + 100]; // set when `failed` is reached

    [[noreturn]] void fail(const char* format, size_t a = 0, size_t b = 0, size_t c = 0)
    {
        std::snprintf(message, sizeof message, format, a, b, c);
        std::longjmp(failed, 1);
    }
};

Decoder& decoderOf(j_common_ptr info) { return *static_cast<Decoder*>(info->client_data); }

void onError(j_common_ptr info)
{
    Decoder& d = decoderOf(info);
    info->err->format_message(info, d.message);
    std::longjmp(d.failed, 1);
}

/// libjpeg repairs damage with a warning; we call it an error. Oddities of harmless writers pass.
void onMessage(j_common_ptr info, int level)
{
    const int code = info->err->msg_code;
    const bool damage = code == JWRN_JPEG_EOF || code == JWRN_HIT_MARKER || code == JWRN_HUFF_BAD_CODE || code == JWRN_MUST_RESYNC ||
                        code == JWRN_BOGUS_PROGRESSION;
    if (level < 0 && damage) onError(info);
}

void onProgress(j_common_ptr info)
{
    Decoder& d = decoderOf(info);
    if (d.info.input_scan_number > kMaxScans) d.fail("more than %zu scans", kMaxScans);
}

/// False: d.code and d.message say why.
bool decodeInto(Decoder& d, std::span<const std::byte> bytes, Image8& image, std::vector<uint8_t>& row)
{
    d.info.err = jpeg_std_error(&d.errors);
    d.errors.error_exit = onError;
    d.errors.emit_message = onMessage;
    d.info.client_data = &d;
    if (setjmp(d.failed)) return false;

    jpeg_create_decompress(&d.info);
    d.progress.progress_monitor = onProgress;
    d.info.progress = &d.progress;
    jpeg_mem_src(&d.info, reinterpret_cast<const unsigned char*>(bytes.data()), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&d.info, TRUE);
    const size_t width = d.info.image_width, height = d.info.image_height;
    if (width * height > kMaxPixels) d.fail("%zu x %zu pixels, expected at most 2^28 pixels", width, height);
    if (width * height / kMaxPixelsPerByte > bytes.size())
        d.fail("the header claims %zu x %zu pixels but the file has only %zu bytes", width, height, bytes.size());
    if (d.info.jpeg_color_space == JCS_CMYK || d.info.jpeg_color_space == JCS_YCCK) {
        d.code = ErrorCode::kUnsupported;
        d.fail("CMYK; convert it to RGB");
    }

    d.info.out_color_space = JCS_RGB;
    jpeg_start_decompress(&d.info);
    row.resize(3 * width);
    image = {int(width), int(height), std::vector<uint8_t>(4 * width * height, 255)};
    uint8_t* out = image.rgba.data();
    JSAMPROW rows[1] = {row.data()};
    while (d.info.output_scanline < d.info.output_height) {
        jpeg_read_scanlines(&d.info, rows, 1);
        for (size_t x = 0; x < width; ++x, out += 4)
            for (size_t c = 0; c < 3; ++c) out[c] = row[3 * x + c];
    }
    jpeg_finish_decompress(&d.info); // up to the end marker
    return true;
}

/// Big- or little-endian whole numbers of a segment. What lies past the end reads as 0.
struct Segment {
    std::span<const std::byte> bytes;
    bool littleEndian = false;

    size_t value(size_t at, size_t count) const
    {
        if (at > bytes.size() || count > bytes.size() - at) return 0;
        size_t v = 0;
        for (size_t i = 0; i < count; ++i) v = v << 8 | std::to_integer<size_t>(bytes[at + (littleEndian ? count - 1 - i : i)]);
        return v;
    }
    bool startsWith(std::string_view text) const
    {
        return bytes.size() >= text.size() && std::memcmp(bytes.data(), text.data(), text.size()) == 0;
    }
    Segment from(size_t at) const { return {bytes.subspan(std::min(at, bytes.size())), littleEndian}; }
};

/// Tag 0x112 of the first directory of a TIFF header.
int exifOrientation(Segment tiff)
{
    tiff.littleEndian = tiff.startsWith("II");
    const size_t directory = tiff.value(4, 4), count = tiff.value(directory, 2);
    for (size_t i = 0; i < count && directory + 2 + 12 * i < tiff.bytes.size(); ++i) {
        const size_t entry = directory + 2 + 12 * i, orientation = tiff.value(entry + 8, 2);
        if (tiff.value(entry, 2) == 0x112 && orientation >= 1 && orientation <= 8) return int(orientation);
    }
    return 1;
}

/// The tag `desc` of an ICC profile: 8-bit text in version 2, UTF-16 in version 4, of which names of profiles use what is ASCII.
std::string profileName(const Segment& icc)
{
    constexpr size_t kHeader = 128, kLongest = 80;
    const size_t count = icc.value(kHeader, 4);
    for (size_t i = 0; i < count && kHeader + 4 + 12 * i < icc.bytes.size(); ++i) {
        const size_t tag = kHeader + 4 + 12 * i;
        if (!icc.from(tag).startsWith("desc")) continue;
        const Segment text = icc.from(icc.value(tag + 4, 4));
        const bool wide = text.startsWith("mluc");
        const size_t start = wide ? text.value(24, 4) : 12, size = wide ? text.value(20, 4) : text.value(8, 4);
        std::string name;
        for (size_t at = wide ? 1 : 0; at < std::min(size, kLongest); at += wide ? 2 : 1)
            if (const size_t c = text.value(start + at, 1)) name += char(c);
        if (!name.empty()) return name;
    }
    return "without a name";
}

} // namespace

bool looksLikeJpeg(std::span<const std::byte> bytes)
{
    return bytes.size() >= 3 && unsigned(bytes[0]) == 0xff && unsigned(bytes[1]) == 0xd8 && unsigned(bytes[2]) == 0xff;
}

Result<Image8> decodeJpeg(std::span<const std::byte> bytes, const std::string& name)
{
    if (!looksLikeJpeg(bytes)) return Error{ErrorCode::kBadInput, name + ": not a JPEG file (" + std::to_string(bytes.size()) + " bytes)"};
    struct Owner { // releases libjpeg's memory on every way out, an exception of a vector among them
        Decoder d{};
        ~Owner() { jpeg_destroy_decompress(&d.info); }
    } owner;
    Image8 image;
    std::vector<uint8_t> row;
    if (!decodeInto(owner.d, bytes, image, row)) return Error{owner.d.code, name + ": JPEG: " + oneLine(owner.d.message)};
    return image;
}

Result<JpegHeader> readJpegHeader(std::span<const std::byte> bytes, const std::string& name)
{
    const auto broken = [&](const std::string& what) { return Error{ErrorCode::kBadInput, name + ": JPEG: " + what}; };
    if (!looksLikeJpeg(bytes)) return broken("not a JPEG file (" + std::to_string(bytes.size()) + " bytes)");
    const Segment all{bytes};
    JpegHeader header;
    for (size_t at = 2;;) {
        while (at + 1 < bytes.size() && (all.value(at, 1) != 0xff || all.value(at + 1, 1) == 0 || all.value(at + 1, 1) == 0xff)) ++at; // fill, junk
        const size_t marker = all.value(at, 2);
        if (marker == 0xff01 || (marker >= 0xffd0 && marker <= 0xffd7)) { // restarts and the like: bare markers
            at += 2;
            continue;
        }
        const size_t size = std::max<size_t>(all.value(at + 2, 2), 2);
        if (at + 4 > bytes.size() || size > bytes.size() - at - 2) return broken("ends before its size, at byte " + std::to_string(bytes.size()));
        const Segment segment{bytes.subspan(at + 4, size - 2)};
        const bool isFrame = marker >= 0xffc0 && marker <= 0xffcf && marker != 0xffc4 && marker != 0xffc8 && marker != 0xffcc;
        if (isFrame) {
            header.height = int(segment.value(1, 2)), header.width = int(segment.value(3, 2));
            if (header.width < 1 || header.height < 1) return broken(std::to_string(header.width) + " x " + std::to_string(header.height) + " pixels");
            return header;
        }
        if (marker == 0xffe1 && segment.startsWith({"Exif\0", 6})) header.orientation = exifOrientation(segment.from(6));
        if (marker == 0xffe2 && segment.startsWith({"ICC_PROFILE\0\1", 13})) header.profile = profileName(segment.from(14)); // the first part has the tags
        if (marker == 0xffd9 || marker == 0xffda) return broken("no frame header before its pixels");
        at += 2 + size;
    }
}

Result<Image> readJpeg(const std::string& path, JpegHeader* header)
{
    const Result<std::vector<std::byte>> bytes = readFile(path);
    if (!bytes) return bytes.error();
    const Result<Image8> decoded = decodeJpeg(*bytes, path);
    if (!decoded) return decoded.error();
    if (header)
        if (const Result<JpegHeader> found = readJpegHeader(*bytes, path)) *header = *found;
    Image image{decoded->width, decoded->height, std::vector<float>(decoded->rgba.size())};
    for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] = float(decoded->rgba[i]) / 255.0f;
    return image;
}

Result<Image> readJpegSize(const std::string& path)
{
    // Cameras put a preview and a profile before the frame header; 64 KiB mostly reach it.
    for (const size_t count : {size_t(1) << 16, size_t(1) << 24}) {
        const Result<FileStart> start = readFileStart(path, count);
        if (!start) return start.error();
        const Result<JpegHeader> header = readJpegHeader(start->bytes, path);
        if (header) return Image{header->width, header->height, {}};
        if (count >= start->fileSize || count > (size_t(1) << 16)) return header.error();
    }
    return Error{ErrorCode::kBadInput, path + ": JPEG: no size"};
}

Status writeJpeg(const std::string& path, int width, int height, std::span<const uint8_t> rgb, int quality)
{
    assert(width > 0 && height > 0 && width <= JPEG_MAX_DIMENSION && height <= JPEG_MAX_DIMENSION && rgb.size() == size_t(3) * size_t(width) * size_t(height));
    jpeg_compress_struct info;
    jpeg_error_mgr errors;
    info.err = jpeg_std_error(&errors); // ends the process, which can only be for want of memory
    jpeg_create_compress(&info);
    unsigned char* bytes = nullptr;
    unsigned long size = 0;
    jpeg_mem_dest(&info, &bytes, &size);
    info.image_width = JDIMENSION(width), info.image_height = JDIMENSION(height);
    info.input_components = 3;
    info.in_color_space = JCS_RGB;
    jpeg_set_defaults(&info);
    jpeg_set_quality(&info, quality, TRUE);
    jpeg_start_compress(&info, TRUE);
    for (int y = 0; y < height; ++y) {
        JSAMPROW row = const_cast<JSAMPROW>(rgb.data() + size_t(3) * size_t(width) * size_t(y));
        jpeg_write_scanlines(&info, &row, 1);
    }
    jpeg_finish_compress(&info);
    const Status written = writeFileAtomically(path, std::as_bytes(std::span(bytes, size)));
    jpeg_destroy_compress(&info);
    std::free(bytes);
    return written;
}

} // namespace nacre
