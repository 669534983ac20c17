// PNG in and out through stb. Only png.cpp knows the library.
#pragma once

#include "base/image.h"
#include "base/result.h"
#include "interchange/image8.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace nacre {

/// 8- or 16-bit grey/RGB/RGBA PNG as stored values in [0, 1] (no transfer function applied; alpha = 1 if absent).
/// Checksums are verified: a damaged file is an error kBadInput, never wrong pixels.
Result<Image> readPng(const std::string& path);

/// The same from memory. `name` stands for the file in error messages.
Result<Image> decodePng(std::span<const std::byte> bytes, const std::string& name);

/// Whether the bytes begin like a PNG.
bool looksLikePng(std::span<const std::byte> bytes);

/// The same image in 8 bits (16-bit samples lose their lower half): textures.
Result<Image8> decodePng8(std::span<const std::byte> bytes, const std::string& name);

/// Width and height only: `rgba` stays empty.
Result<Image> readPngSize(const std::string& path);

/// 8-bit RGB (channels = 3) or RGBA (4) PNG from display-encoded bytes, rows top to bottom, written atomically.
Status writePng(const std::string& path, int width, int height, int channels, std::span<const uint8_t> pixels);

} // namespace nacre
