// PNG in and out through stb. Only png.cpp knows the library.
#pragma once

#include "base/image.h"
#include "base/result.h"
#include "interchange/image8.h"
#include "interchange/primaries.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nacre {

/// What a PNG says of its colours; none of it is applied.
struct PngColor {
    double gamma = 0;               // gAMA: stored = light^gamma; 0.45455 for a display, 1 for linear, 0 if it does not say
    bool isSrgb = false;            // sRGB: this is what holds, whatever the others say
    std::string profile;            // iCCP: the name of its profile
    Primaries primaries;            // cHRM
};

/// 8- or 16-bit grey/RGB/RGBA/palette PNG as stored values in [0, 1] (no transfer function applied; alpha = 1 if absent).
/// Checksums are verified: a damaged file, or a palette index without a colour, is an error kBadInput, never wrong pixels.
Result<Image> readPng(const std::string& path, PngColor* color = nullptr);

/// The same from memory. `name` stands for the file in error messages.
Result<Image> decodePng(std::span<const std::byte> bytes, const std::string& name, PngColor* color = nullptr);

/// Whether the bytes begin like a PNG.
bool looksLikePng(std::span<const std::byte> bytes);

/// The same image in 8 bits (16-bit samples lose their lower half): textures.
Result<Image8> decodePng8(std::span<const std::byte> bytes, const std::string& name);

/// Width and height only, from the start of the file: `rgba` stays empty.
Result<Image> readPngSize(const std::string& path);

/// 8-bit RGB (channels = 3) or RGBA (4) PNG from display-encoded bytes, rows top to bottom. `name` stands for it in error messages.
Result<std::vector<std::byte>> encodePng(const std::string& name, int width, int height, int channels, std::span<const uint8_t> pixels);

/// The same, written atomically.
Status writePng(const std::string& path, int width, int height, int channels, std::span<const uint8_t> pixels);

} // namespace nacre
