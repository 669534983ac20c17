// PNG in and out through stb. Only png.cpp knows the library.
#pragma once

#include "base/image.h"
#include "base/result.h"

#include <cstdint>
#include <span>
#include <string>

namespace nacre {

/// 8- or 16-bit grey/RGB/RGBA PNG as stored values in [0, 1] (no transfer function applied; alpha = 1 if absent).
Result<Image> readPng(const std::string& path);

/// 8-bit RGB (channels = 3) or RGBA (4) PNG from display-encoded bytes, rows top to bottom, written atomically.
Status writePng(const std::string& path, int width, int height, int channels, std::span<const uint8_t> pixels);

} // namespace nacre
