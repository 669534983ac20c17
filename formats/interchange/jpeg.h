// JPEG in through stb. Only jpeg.cpp knows the library.
#pragma once

#include "base/result.h"
#include "interchange/image8.h"

#include <cstddef>
#include <span>
#include <string>

namespace nacre {

/// Whether the bytes begin like a JPEG.
bool looksLikeJpeg(std::span<const std::byte> bytes);

/// 8-bit baseline or progressive JPEG, grey, YCbCr, RGB or CMYK. Any bytes are safe; a file that is cut off is an error kBadInput.
/// `name` stands for the file in error messages.
Result<Image8> decodeJpeg(std::span<const std::byte> bytes, const std::string& name);

} // namespace nacre
