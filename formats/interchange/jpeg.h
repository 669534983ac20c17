// JPEG in and out through libjpeg. Only jpeg.cpp knows the library.
#pragma once

#include "base/image.h"
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

/// What the segments before the pixels say; none of it is applied.
struct JpegHeader {
    int width = 0, height = 0;
    int orientation = 1;    // EXIF: 1 upright as stored, 2 to 8 the turns and mirrors that viewers apply
    std::string profile;    // the name of the ICC profile, empty if there is none
};

/// Reads the segments up to the frame header. Any bytes are safe; error kBadInput if they end or break before it.
Result<JpegHeader> readJpegHeader(std::span<const std::byte> bytes, const std::string& name);

/// Stored values in [0, 1] (no transfer function applied), alpha 1, rows as stored.
Result<Image> readJpeg(const std::string& path, JpegHeader* header = nullptr);

/// Width and height only, from the start of the file: `rgba` stays empty.
Result<Image> readJpegSize(const std::string& path);

/// Colour JPEG from display-encoded RGB bytes, rows top to bottom, with colours at half the resolution as cameras write them; `quality` 1 to 100. Written atomically.
Status writeJpeg(const std::string& path, int width, int height, std::span<const uint8_t> rgb, int quality);

} // namespace nacre
