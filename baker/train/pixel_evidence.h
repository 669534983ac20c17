// What one pixel of an image shows beyond a render.
#pragma once

#include "base/color.h"
#include "base/host_device.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace nacre {

/// As SplatEvidence has it; zero outside of the object.
struct PixelEvidence {
    float residual = 0, slope = 0, saturated = 0;
};

/// `image`: three planes of the render; `reference`: the planes of a PreparedImage.
NACRE_HD inline PixelEvidence pixelEvidence(const float* image, const uint16_t* reference, size_t pixels, size_t i)
{
    constexpr float kWeights[] = {0.2126f, 0.7152f, 0.0722f}, kSaturated = 0.98f;
    if (reference[3 * pixels + i] < 32768) return {};
    float shown = 0, seen = 0;
    for (size_t c = 0; c < 3; ++c) {
        shown += kWeights[c] * std::clamp(image[c * pixels + i], 0.0f, 1.0f);
        seen += kWeights[c] * linearFromSrgb(float(reference[c * pixels + i]) / 65535.0f);
    }
    const float slope = shown <= 0.0031308f ? 12.92f : 1.055f / 2.4f * std::pow(shown, 1 / 2.4f - 1); // of srgbFromLinear
    return {seen - shown, slope, seen > kSaturated ? 1.0f : 0.0f};
}

} // namespace nacre
