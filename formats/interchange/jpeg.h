// JPEG in through libjpeg. Only jpeg.cpp knows the library.
#pragma once

#include "base/result.h"
#include "interchange/image8.h"

#include <cstddef>
#include <span>
#include <string>

namespace nacre {

/// Whether the bytes begin like a JPEG.
bool looksLikeJpeg(std::span<const std::byte> bytes);

/// 8-bit baseline or progressive JPEG, grey or colour. Any bytes are safe; a file that is cut off or damaged is an error kBadInput,
/// CMYK is kUnsupported. `name` stands for the file in error messages.
Result<Image8> decodeJpeg(std::span<const std::byte> bytes, const std::string& name);

} // namespace nacre
