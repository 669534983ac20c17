// LDR-FLIP: the difference a person sees when flipping between two images.
#pragma once

#include "base/image.h"

namespace nacre {

/// 0.7 m in front of a 0.7 m wide 3840-pixel screen: the default of the paper.
constexpr double kFlipPixelsPerDegree = 67.0;

/// Mean over the pixels that both know, in [0, 1]. Linear Rec.709 input is clamped to [0, 1]. Images of one size; symmetric in its arguments.
double meanFlip(const Image& a, const Image& b, double pixelsPerDegree = kFlipPixelsPerDegree);

} // namespace nacre
