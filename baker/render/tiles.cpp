// Work is cut into fixed chunks of splats, results are joined in chunk order, so the thread count cannot show in the result.
#include "render/tiles.h"

#include "render/project_gaussians.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace nacre {

constexpr size_t kChunk = 1024;

void TileBuilder::build(const View<float>& view, std::span<const GaussianGeometry<float>> splats)
{
    tiles.width = int(view.width), tiles.height = int(view.height);
    tiles.tilesX = (tiles.width + kTileSize - 1) / kTileSize;
    tiles.tilesY = (tiles.height + kTileSize - 1) / kTileSize;
    const auto start = std::chrono::steady_clock::now();
    project(view, splats);
    sort();
    projectSeconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    bin();
}

// Every splat has a slot for its projection; only the short lists of the visible are joined.
void TileBuilder::project(const View<float>& view, std::span<const GaussianGeometry<float>> splats)
{
    const size_t chunkCount = (splats.size() + kChunk - 1) / kChunk;
    projected_.resize(splats.size()), visibleInChunk_.resize(splats.size()), chunkVisible_.resize(chunkCount);
    tbb::parallel_for(size_t(0), chunkCount, [&](size_t k) {
        const size_t first = k * kChunk, count = std::min(kChunk, splats.size() - first);
        chunkVisible_[k] = projectGaussians(view, splats.subspan(first, count), uint32_t(first), &projected_[first], &visibleInChunk_[first]);
    });
    order_.clear();
    for (size_t k = 0; k < chunkCount; ++k)
        order_.insert(order_.end(), &visibleInChunk_[k * kChunk], &visibleInChunk_[k * kChunk] + chunkVisible_[k]);
}

// Stable, so the splat index breaks ties.
void TileBuilder::sort()
{
    const size_t n = order_.size();
    keys_.resize(n);
    for (size_t v = 0; v < n; ++v) keys_[v] = radixKey(projected_[order_[v]].distance);
    radixSort<uint32_t>(keys_, order_, sortScratch_);
    visible.splatFromVisible.assign(order_.begin(), order_.end());
    visible.projected.resize(n);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, n, kChunk), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t v = range.begin(); v < range.end(); ++v) visible.projected[v] = projected_[order_[v]];
    });
}

namespace {

struct Span { float lo, hi; };

/// The x range (relative to the mean) that the ellipse q <= qMax covers between the rows y0 <= dy <= y1. Empty if lo > hi.
/// `yRight` is where it reaches furthest right; furthest left is the mirror image.
Span ellipseSpan(const ProjectedGaussian<float>& s, float qMax, float yRight, float y0, float y1)
{
    if (y0 > s.extent[1] || y1 < -s.extent[1]) return {1, 0};
    const float a = s.conic[0], b = s.conic[1], c = s.conic[2];
    const float yr = std::clamp(yRight, y0, y1), yl = std::clamp(-yRight, y0, y1);
    const auto branch = [&](float y, float sign) {
        const float discriminant = (b * y) * (b * y) - a * (c * y * y - qMax);
        return (-b * y + sign * std::sqrt(std::max(discriminant, 0.0f))) / a;
    };
    return {branch(yl, -1.0f), branch(yr, 1.0f)};
}

} // namespace

void TileBuilder::bin()
{
    const size_t n = visible.count(), chunkCount = (n + kChunk - 1) / kChunk;
    if (chunks_.size() < chunkCount) chunks_.resize(chunkCount);
    const int blocksX = tiles.tilesX * (kTileSize / kBlockSize);

    // Which tiles, and which blocks in them, each splat touches.
    tbb::parallel_for(size_t(0), chunkCount, [&](size_t k) {
        Chunk& chunk = chunks_[k];
        chunk.pairTile.clear(), chunk.pairMask.clear(), chunk.pairCount.clear();
        for (size_t v = k * kChunk; v < std::min(n, (k + 1) * kChunk); ++v) {
            const ProjectedGaussian<float>& s = visible.projected[v];
            const float slack = 0.01f; // pixels: rounding in the span must not lose a pixel on the rim
            const float qMax = 2.0f * std::log(s.opacity / kMinAlpha), yRight = -s.conic[1] / s.conic[2] * s.extent[0];
            const int tileY0 = int(std::max(0.0f, s.mean[1] - s.extent[1])) / kTileSize;
            const int tileY1 = int(std::min(float(tiles.height - 1), s.mean[1] + s.extent[1])) / kTileSize;
            const size_t before = chunk.pairTile.size();
            for (int ty = tileY0; ty <= tileY1; ++ty) {
                int first[4], last[4], tileX0 = tiles.tilesX, tileX1 = -1;
                for (int r = 0; r < 4; ++r) {
                    const float y0 = float(ty * kTileSize + r * kBlockSize) + 0.5f - s.mean[1];
                    const Span span = ellipseSpan(s, qMax, yRight, y0 - slack, y0 + float(kBlockSize - 1) + slack);
                    // pixel centres x + 0.5 inside [lo, hi]
                    const float lo = std::max(0.0f, s.mean[0] + span.lo - 0.5f - slack);
                    const float hi = std::min(float(tiles.width - 1), s.mean[0] + span.hi - 0.5f + slack);
                    first[r] = 1, last[r] = 0;
                    if (!(lo <= hi)) continue;
                    const int x0 = int(lo) + (float(int(lo)) < lo), x1 = int(hi); // ceil and floor: neither is negative, and neither is a call
                    if (x0 > x1) continue;
                    first[r] = x0 / kBlockSize, last[r] = std::min(blocksX - 1, x1 / kBlockSize);
                    tileX0 = std::min(tileX0, first[r] / 4), tileX1 = std::max(tileX1, last[r] / 4);
                }
                for (int tx = tileX0; tx <= tileX1; ++tx) {
                    uint32_t mask = 0;
                    for (int r = 0; r < 4; ++r) {
                        const int b0 = std::max(first[r] - 4 * tx, 0), b1 = std::min(last[r] - 4 * tx, 3);
                        if (b0 <= b1) mask |= ((2u << b1) - (1u << b0)) << (4 * r);
                    }
                    if (!mask) continue;
                    chunk.pairTile.push_back(uint32_t(ty * tiles.tilesX + tx));
                    chunk.pairMask.push_back(mask);
                }
            }
            chunk.pairCount.push_back(uint32_t(chunk.pairTile.size() - before));
        }
    });

    // Tile lists in depth order, by counting sort.
    const size_t tileCount = size_t(tiles.tilesX) * tiles.tilesY;
    tiles.tileStart.assign(tileCount + 1, 0);
    for (size_t k = 0; k < chunkCount; ++k)
        for (uint32_t t : chunks_[k].pairTile) ++tiles.tileStart[t + 1];
    for (size_t t = 0; t < tileCount; ++t) tiles.tileStart[t + 1] += tiles.tileStart[t];
    fill_.assign(tiles.tileStart.begin(), tiles.tileStart.end() - 1);
    tiles.entries.resize(tiles.tileStart[tileCount]);
    tiles.entryFromPair.resize(tiles.tileStart[tileCount]);
    tiles.pairStart.resize(n + 1);
    uint32_t pair = 0;
    size_t v = 0;
    for (size_t k = 0; k < chunkCount; ++k) {
        size_t inChunk = 0;
        for (uint32_t count : chunks_[k].pairCount) {
            tiles.pairStart[v] = pair;
            for (uint32_t i = 0; i < count; ++i, ++inChunk) {
                const uint32_t tile = chunks_[k].pairTile[inChunk], entry = fill_[tile]++;
                tiles.entries[entry] = {uint32_t(v), tile, chunks_[k].pairMask[inChunk]};
                tiles.entryFromPair[pair++] = entry;
            }
            ++v;
        }
    }
    tiles.pairStart[n] = pair;
}

} // namespace nacre
