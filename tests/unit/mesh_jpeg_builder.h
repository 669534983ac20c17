// JPEG files for tests, through stb_image_write.
#pragma once

#include "dataset_file_builders.h"

#include <string>
#include <vector>

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#endif
#define STB_IMAGE_WRITE_STATIC
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STBI_WRITE_NO_STDIO
#include <stb/stb_image_write.h>
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

namespace nacre {

/// A baseline JPEG of `channels` 1 or 3, at a quality that keeps flat colours within a few steps.
inline Bytes jpegOf(int width, int height, int channels, const std::vector<uint8_t>& pixels)
{
    Bytes out;
    const auto write = [](void* context, void* data, int size) { append(*static_cast<Bytes*>(context), data, size_t(size)); };
    stbi_write_jpg_to_func(write, &out, width, height, channels, pixels.data(), 95);
    return out;
}

/// 16 x 8 pixels of one colour.
inline Bytes flatJpeg(uint8_t r, uint8_t g, uint8_t b)
{
    std::vector<uint8_t> pixels;
    for (int i = 0; i < 16 * 8; i++) pixels.insert(pixels.end(), {r, g, b});
    return jpegOf(16, 8, 3, pixels);
}

/// The same file with what cameras put in front: EXIF with an orientation, and an ICC profile (version 4) with a name.
inline Bytes withSegments(const Bytes& jpeg, uint8_t orientation, const std::string& profile)
{
    std::string exif("Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0", 25);
    exif += char(orientation);
    exif += std::string(6, '\0');
    std::string icc("ICC_PROFILE\0\1\1", 14);
    const auto u32 = [&](size_t v) {
        for (int shift = 24; shift >= 0; shift -= 8) icc += char(v >> shift & 255);
    };
    icc += std::string(128, '\0');
    u32(1), icc += "desc", u32(144), u32(28 + 2 * profile.size()); // one tag, right behind the table
    icc += "mluc", u32(0), u32(1), u32(12), icc += "enUS", u32(2 * profile.size()), u32(28);
    for (char c : profile) icc += '\0', icc += c;
    Bytes out(jpeg.begin(), jpeg.begin() + 2);
    const auto segment = [&](uint8_t marker, const std::string& body) {
        const size_t size = body.size() + 2;
        for (size_t b : {size_t(0xff), size_t(marker), size >> 8, size & 255}) out.push_back(std::byte(b));
        append(out, body.data(), body.size());
    };
    segment(0xe1, exif), segment(0xe2, icc);
    append(out, jpeg.data() + 2, jpeg.size() - 2);
    return out;
}

} // namespace nacre
