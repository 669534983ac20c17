// What training images show of single splats beyond what the model shows without highlights.
#pragma once

#include "appearance/trainable.h"

#include <cstdint>
#include <vector>

namespace nacre {

/// One splat in one view: means over its pixels, by its blending weights.
struct SplatEvidence {
    uint32_t splat;
    float weight;                          // sum of the blending weights: so many pixels
    float residual[kMaxLightsPerStep];     // luminance of the image less that of the render, both cut at 1
    float slope[kMaxLightsPerStep];        // of the display's transfer function at the render
    float saturated[kMaxLightsPerStep];    // share of the pixels that are cut at 1: there may be more light than the residual says
};

struct ViewEvidence {
    LitView lit;
    std::vector<SplatEvidence> splats;
};

} // namespace nacre
