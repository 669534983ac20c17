// OpenEXR in and out. Only exr.cpp knows the library; nothing it throws gets out.
#pragma once

#include "base/image.h"
#include "base/result.h"

#include <string>

namespace nacre {

/// RGB or RGBA scanline/tiled EXR, half or float, as stored (no colour or alpha conversion; alpha = 1 if absent).
/// Errors kBadInput: unreadable, missing R/G/B, NaN or infinite pixels, absurd size.
Result<Image> readExr(const std::string& path);

/// Half-float RGBA, ZIP compression, written atomically. Values beyond the half range are an error kBadInput.
Status writeExr(const Image& image, const std::string& path);

} // namespace nacre
