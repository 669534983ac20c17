// Pictures for people: what a screen shows of a linear image, and reference | render | 4x error side by side.
#pragma once

#include "base/image.h"

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

/// 8-bit sRGB, rows top to bottom, 3 bytes a pixel.
struct Picture {
    int width = 0, height = 0;
    std::vector<uint8_t> rgb;
};

/// Γ(linear over black), rounded to 8 bits.
Picture displayPicture(const Image& linear);

/// reference | render | 4 |reference - render| of Γ images (before rounding), with thin grey separators. Sizes must agree.
Picture contactRow(const Image& reference, const Image& render);

/// The pictures in reading order, `columns` a row, with thin grey separators. Pictures may differ in size.
Picture tile(std::span<const Picture> pictures, int columns);

} // namespace nacre
