// OpenEXR in and out. Only exr.cpp knows the library; nothing it throws gets out.
#pragma once

#include "base/image.h"
#include "base/result.h"

#include <cstddef>
#include <span>
#include <string>

namespace nacre {

/// RGB, RGBA or luminance (Y, YA) scanline/tiled EXR, half or float. Colours come in the primaries of Rec.709: if the header has others
/// (chromaticities) they are converted. Alpha as stored, 1 if absent. Of a file with layers the only one with colours is taken, or the only
/// one named Combined (what Blender calls its picture). The image covers the display window; where the data window does not reach, pixels are 0.
/// Errors kBadInput: unreadable, no R/G/B or several layers (which are listed), whole numbers, NaN or infinite pixels, absurd size;
/// kIo: out of memory.
Result<Image> readExr(const std::string& path);

/// The same from memory. `name` stands for the file in error messages.
Result<Image> decodeExr(std::span<const std::byte> bytes, const std::string& name);

/// Width and height only, from the start of the file: `rgba` stays empty.
Result<Image> readExrSize(const std::string& path);

/// RGBA, ZIP compression, written atomically. Half-float, or float if a value lies beyond the half range (65504). NaN and infinite
/// pixels are an error kBadInput.
Status writeExr(const Image& image, const std::string& path);

} // namespace nacre
