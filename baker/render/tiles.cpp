// Work is cut into fixed chunks of splats, results are joined in chunk order, so the thread count cannot show in the result.
#include "render/tiles.h"

#include "render/project_gaussians.h"
#include "render/tile_cover.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>

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

void TileBuilder::bin()
{
    const size_t n = visible.count(), chunkCount = (n + kChunk - 1) / kChunk;
    if (chunks_.size() < chunkCount) chunks_.resize(chunkCount);

    // Which tiles, and which blocks in them, each splat touches.
    tbb::parallel_for(size_t(0), chunkCount, [&](size_t k) {
        Chunk& chunk = chunks_[k];
        chunk.pairTile.clear(), chunk.pairMask.clear(), chunk.pairCount.clear();
        for (size_t v = k * kChunk; v < std::min(n, (k + 1) * kChunk); ++v) {
            const ProjectedGaussian<float>& s = visible.projected[v];
            const TileCover cover = tileCover(s, tiles.height);
            const size_t before = chunk.pairTile.size();
            for (int ty = cover.tileY0; ty <= cover.tileY1; ++ty) {
                const TileRow row = tileRow(s, cover, ty, tiles.width, tiles.tilesX);
                for (int tx = row.tileX0; tx <= row.tileX1; ++tx) {
                    const uint32_t mask = blockMask(row, tx);
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
