// Which tiles a splat touches, and which blocks in them: per-item mathematics of all tile lists. Host and device: the same splats give the
// same tiles bit for bit, and on a device the kernel that counts them agrees with the one that writes them.
#pragma once

#include "render/projection.h"
#include "render/tile_entry.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace nacre {

namespace detail {

/// Rounded on its own, where a device's compiler would round it together with a sum, here so and there otherwise.
NACRE_HD inline float product(float a, float b)
{
#ifdef __CUDA_ARCH__
    return __fmul_rn(a, b);
#else
    return a * b;
#endif
}

struct Span { float lo, hi; };

/// The x range (relative to the mean) that the ellipse q <= qMax covers between the rows y0 <= dy <= y1. Empty if lo > hi.
/// `yRight` is where it reaches furthest right; furthest left is the mirror image.
NACRE_HD inline Span ellipseSpan(const ProjectedGaussian<float>& s, float qMax, float yRight, float y0, float y1)
{
    if (y0 > s.extent[1] || y1 < -s.extent[1]) return {1, 0};
    const float a = s.conic[0], b = s.conic[1], c = s.conic[2];
    const float yr = std::clamp(yRight, y0, y1), yl = std::clamp(-yRight, y0, y1);
    const auto branch = [&](float y, float sign) {
        const float by = product(b, y);
        const float discriminant = product(by, by) - product(a, product(product(c, y), y) - qMax);
        return (-by + product(sign, std::sqrt(std::max(discriminant, 0.0f)))) / a;
    };
    return {branch(yl, -1.0f), branch(yr, 1.0f)};
}

} // namespace detail

/// The tiles of one splat, row by row.
struct TileCover {
    int tileY0, tileY1; // none: tileY1 < tileY0
    float qMax, yRight;
};

/// What a splat touches in one row of tiles.
struct TileRow {
    int first[4], last[4]; // blocks of each row of blocks, from the image's left; none: last < first
    int tileX0, tileX1;    // none: tileX1 < tileX0
};

NACRE_HD inline TileCover tileCover(const ProjectedGaussian<float>& s, int height)
{
    return {int(std::max(0.0f, s.mean[1] - s.extent[1])) / kTileSize, int(std::min(float(height - 1), s.mean[1] + s.extent[1])) / kTileSize,
            2.0f * std::log(s.opacity / kMinAlpha), detail::product(-s.conic[1] / s.conic[2], s.extent[0])};
}

NACRE_HD inline TileRow tileRow(const ProjectedGaussian<float>& s, const TileCover& cover, int ty, int width, int tilesX)
{
    const float slack = 0.01f; // pixels: rounding in the span must not lose a pixel on the rim
    TileRow row;
    row.tileX0 = tilesX, row.tileX1 = -1;
    for (int r = 0; r < 4; ++r) {
        const float y0 = float(ty * kTileSize + r * kBlockSize) + 0.5f - s.mean[1];
        const detail::Span span = detail::ellipseSpan(s, cover.qMax, cover.yRight, y0 - slack, y0 + float(kBlockSize - 1) + slack);
        // pixel centres x + 0.5 inside [lo, hi]
        const float lo = std::max(0.0f, s.mean[0] + span.lo - 0.5f - slack);
        const float hi = std::min(float(width - 1), s.mean[0] + span.hi - 0.5f + slack);
        row.first[r] = 1, row.last[r] = 0;
        if (!(lo <= hi)) continue;
        const int x0 = int(lo) + (float(int(lo)) < lo), x1 = int(hi); // ceil and floor: neither is negative, and neither is a call
        if (x0 > x1) continue;
        row.first[r] = x0 / kBlockSize, row.last[r] = std::min(tilesX * (kTileSize / kBlockSize) - 1, x1 / kBlockSize);
        row.tileX0 = std::min(row.tileX0, row.first[r] / 4), row.tileX1 = std::max(row.tileX1, row.last[r] / 4);
    }
    return row;
}

/// TileEntry::blockMask of a tile of the row. May be 0 between tileX0 and tileX1: the splat passes between the pixels' centres.
NACRE_HD inline uint32_t blockMask(const TileRow& row, int tx)
{
    uint32_t mask = 0;
    for (int r = 0; r < 4; ++r) {
        const int b0 = std::max(row.first[r] - 4 * tx, 0), b1 = std::min(row.last[r] - 4 * tx, 3);
        if (b0 <= b1) mask |= ((2u << b1) - (1u << b0)) << (4 * r);
    }
    return mask;
}

} // namespace nacre
