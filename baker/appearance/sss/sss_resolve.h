// From a blended G-buffer to an image under up to four lights, and back: sss.h over all pixels.
#pragma once

#include "appearance/trainable.h"
#include "base/host_device.h"

#include <cmath>

namespace nacre {

/// Unit direction from the eye through pixels: column = x + 0.5, row = y + 0.5. T: a number, or several columns.
template <class T>
NACRE_HD inline void sssPixelRay(const PixelRays& rays, T column, float row, T* ray)
{
    using std::sqrt;
    T length2 = T(0);
    for (int k = 0; k < 3; ++k) {
        ray[k] = T(rays.origin[k] + row * rays.down[k]) + column * T(rays.right[k]);
        length2 += ray[k] * ray[k];
    }
    const T inverse = T(1) / sqrt(length2);
    for (int k = 0; k < 3; ++k) ray[k] = ray[k] * inverse;
}

/// planes: [kSssSurfaceChannels + kSssLightChannels * lights + 1][height][width], the last alpha. image: [3 * lights +
/// 1][height][width].
void sssResolve(const PixelRays& rays, const LitView& lit, const float* planes, float* image);

/// dPlanes from dImage, same shapes.
void sssResolveBackward(const PixelRays& rays, const LitView& lit, const float* planes, const float* dImage, float* dPlanes);

} // namespace nacre
