// JPEG files for tests, through stb_image_write.
#pragma once

#include "dataset_file_builders.h"

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

} // namespace nacre
