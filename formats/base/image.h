// A float RGBA image, rows top to bottom, pixels interleaved.
#pragma once

#include <cstddef>
#include <vector>

namespace nacre {

/// Alpha of a pixel of which nothing is known (saturated, outside of what the lens saw): its colour is 0, and it must count nowhere.
constexpr float kUnknownAlpha = -1.0f;

struct Image {
    int width = 0, height = 0;
    std::vector<float> rgba; // width*height*4; linear Rec.709 radiance premultiplied by alpha (composited over black), alpha = coverage
    float* pixel(int x, int y) { return rgba.data() + 4 * (size_t(y) * width + x); }
    const float* pixel(int x, int y) const { return rgba.data() + 4 * (size_t(y) * width + x); }
};

} // namespace nacre
