// JPEG through libjpeg(-turbo). Not through stb_image, which overruns its tables on damaged ones (the version Debian 12 has) and shows
// missing data as grey.
//
// libjpeg reports an error by a function that must not return. It jumps back into decodeInto(), which therefore holds nothing
// that needs a destructor; what does lives in decodeJpeg().
#include "interchange/jpeg.h"

#include "base/text.h"

#include <csetjmp>
#include <cstdio> // jpeglib.h needs it
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

} // namespace nacre
