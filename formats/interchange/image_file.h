// Image files of any kind that datasets hold: EXR, PNG (8 and 16 bit), JPEG, told apart by their extension, whatever its capitals.
#pragma once

#include "interchange/jpeg.h"
#include "interchange/png.h"

namespace nacre {

enum class ImageKind { kNone, kExr, kPng, kJpeg };
ImageKind imageKind(const std::string& path);

/// What a file says beside its pixels; none of it is applied.
struct ImageWords {
    PngColor color;      // of a JPEG the profile only
    int orientation = 1; // JpegHeader::orientation
};

/// Stored values: EXR as they are, PNG and JPEG in [0, 1] without a transfer function; alpha 1 if the file has none.
/// Errors: those of the decoders; kUnsupported if the extension is none of the above.
Result<Image> readImageFile(const std::string& path, ImageWords* words = nullptr);

/// Width and height only, from the start of the file: `rgba` stays empty.
Result<Image> readImageFileSize(const std::string& path);

} // namespace nacre
