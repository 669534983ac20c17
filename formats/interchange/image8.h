// An 8-bit RGBA image, rows top to bottom: stored values, no transfer function applied.
#pragma once

#include <cstdint>
#include <vector>

namespace nacre {

struct Image8 {
    int width = 0, height = 0;
    std::vector<uint8_t> rgba; // width*height*4; alpha = 255 if the file has none
};

} // namespace nacre
