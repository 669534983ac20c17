// A splat as the pixels of a tile see it, and its gradient from sums over them: per-item mathematics of all rasterisers.
#pragma once

#include "base/host_device.h"
#include "render/reference_raster.h"

#include <cmath>

namespace nacre {

/// Position from the tile's centre; alpha = 2^(logOpacity - (a dx^2 + b dx dy + c dy^2)).
struct TileSplat {
    float x, y, a, b, c, logOpacity;
};

constexpr float kMinLogAlpha = -7.99435344f; // log2 kMinAlpha

NACRE_HD inline TileSplat tileSplat(const ProjectedGaussian<float>& g, float centerX, float centerY)
{
    constexpr float kLog2E = 1.44269504f;
    return {g.mean[0] - centerX,        g.mean[1] - centerY,       0.5f * kLog2E * g.conic[0], kLog2E * g.conic[1],
            0.5f * kLog2E * g.conic[2], std::log2(g.opacity)};
}

/// m: sums over pixels of the gradient of ln(alpha) times 1, dx, dy, dx^2, dx dy, dy^2, with dx, dy from the splat's mean.
NACRE_HD inline ScreenGradient<float> screenGradient(const ProjectedGaussian<float>& s, const float m[6], float weight)
{
    ScreenGradient<float> d;
    d.mean[0] = s.conic[0] * m[1] + s.conic[1] * m[2];
    d.mean[1] = s.conic[1] * m[1] + s.conic[2] * m[2];
    d.conic[0] = -0.5f * m[3], d.conic[1] = -m[4], d.conic[2] = -0.5f * m[5];
    d.opacity = m[0] / s.opacity;
    d.weight = weight;
    return d;
}

} // namespace nacre
