// From Gaussians to tile lists, as render/tiles.h, in the same order: splats are projected and their tiles counted, the visible joined and sorted
// front to back, their pairs of splat and tile written and sorted by tile. The host waits once, for two counts. A view moves about 320 bytes for each visible
// splat (80 of them to sort), 52 for each other, and 90 for each pair (40 to sort, up to 65536 tiles).
#pragma once

#include "device/radix_sort.h"
#include "render/projection.h"
#include "render/tile_cover.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace nacre::NACRE_BACKEND {

/// What VisibleSplats and TileLists hold (render/tiles.h), in memory of the device.
struct TileView {
    const uint32_t* splatFromVisible; // front to back; equal distances by splat index
    const uint32_t* visibleFromSplat; // ~0u: not visible
    const ProjectedGaussian<float>* projected;
    uint32_t visibleCount;
    const uint32_t* tileStart;     // [tiles + 1] into entries
    const TileEntry* entries;      // per tile, front to back
    const uint32_t* pairStart;     // [visible + 1] into entryFromPair
    const uint32_t* entryFromPair; // the entries of one splat, in tile order
    uint32_t entryCount;
    int width, height, tilesX, tilesY;
};

constexpr uint32_t kNotVisible = ~0u;
constexpr int kOwnRows = 4; // splats that reach over more rows of tiles are the work of their whole warp

/// Calls emit(tile, mask) for the tiles of one row; returns how many.
template <class Emit>
NACRE_DEVICE inline uint32_t tilesOfRow(const ProjectedGaussian<float>& s, const TileCover& cover, int ty, int width, int tilesX, const Emit& emit)
{
    const TileRow row = tileRow(s, cover, ty, width, tilesX);
    uint32_t count = 0;
    for (int tx = row.tileX0; tx <= row.tileX1; ++tx) {
        const uint32_t mask = blockMask(row, tx);
        if (mask) emit(count++, uint32_t(ty * tilesX + tx), mask);
    }
    return count;
}

/// A thread a splat. Reads 44 bytes a splat; writes 4, and 36 more if it is visible.
struct ProjectSplats {
    static constexpr uint32_t kThreads = 128;
    using Shared = BlockSums;
    View<float> view;
    const GaussianGeometry<float>* splats;
    uint32_t count;
    ProjectedGaussian<float>* projected; // of the visible
    uint32_t* tileCount;                 // kNotVisible
    uint32_t* inBlocks;                  // [2][blocks]: how many are visible, how many pairs of splat and tile

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const int width = int(view.width), height = int(view.height), tilesX = (width + kTileSize - 1) / kTileSize;
        const auto nothing = [](uint32_t, uint32_t, uint32_t) {};
        const size_t i = t.index();
        ProjectedGaussian<float> s;
        const bool visible = i < count && projectGaussian(view, splats[i], s);
        TileCover cover{0, -1, 0, 0};
        if (visible) projected[i] = s, cover = tileCover(s, height);
        uint32_t tiles = 0;
        if (cover.tileY1 - cover.tileY0 < kOwnRows)
            for (int ty = cover.tileY0; ty <= cover.tileY1; ++ty) tiles += tilesOfRow(s, cover, ty, width, tilesX, nothing);

        uint32_t large = t.ballot(kFullWarp, cover.tileY1 - cover.tileY0 >= kOwnRows);
        if (large) t.syncWarp(kFullWarp); // the others read what they have written
        for (uint32_t lane = 0; large != 0; ++lane, large >>= 1) {
            if (!(large & 1)) continue;
            const ProjectedGaussian<float> its = projected[i - t.lane() + lane];
            const TileCover itsCover = tileCover(its, height);
            uint32_t sum = 0;
            for (int ty = itsCover.tileY0 + int(t.lane()); ty <= itsCover.tileY1; ty += int(kWarp)) sum += tilesOfRow(its, itsCover, ty, width, tilesX, nothing);
            for (uint32_t bit = kWarp / 2; bit > 0; bit /= 2) sum += t.shuffleXor(kFullWarp, sum, bit);
            if (lane == t.lane()) tiles = sum;
        }
        if (i < count) tileCount[i] = visible ? tiles : kNotVisible;
        uint32_t visibleSum, pairSum;
        sumBefore<kThreads>(t, t.shared<Shared>(), visible ? 1 : 0, visibleSum);
        sumBefore<kThreads>(t, t.shared<Shared>(), tiles, pairSum);
        if (t.thread() == 0) inBlocks[t.block()] = visibleSum, inBlocks[size_t(t.blocks()) + t.block()] = pairSum;
    }
};

/// Reads 4 bytes a splat; reads 4 and writes 8 for each that is visible, and writes 4 for each that is not.
struct JoinVisible {
    static constexpr uint32_t kThreads = ProjectSplats::kThreads;
    using Shared = BlockSums;
    const ProjectedGaussian<float>* projected;
    const uint32_t* tileCount; // per splat
    const uint32_t* before;    // the sums before each of ProjectSplats::inBlocks
    uint32_t count;
    uint32_t *keys, *order, *visibleFromSplat;
    uint32_t* totals; // visible splats, pairs

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index();
        const bool visible = i < count && tileCount[i] != kNotVisible;
        uint32_t total;
        const uint32_t to = before[t.block()] + sumBefore<kThreads>(t, t.shared<Shared>(), visible ? 1 : 0, total);
        if (visible) {
            uint32_t bits; // distances are not negative: their bits are in their order
            const float distance = projected[i].distance;
            memcpy(&bits, &distance, sizeof bits);
            keys[to] = bits, order[to] = uint32_t(i);
        } else if (i < count) {
            visibleFromSplat[i] = kNotVisible;
        }
        if (t.index() == 0) totals[0] = before[t.blocks()], totals[1] = before[2 * size_t(t.blocks())] - totals[0];
    }
};

/// Reads 44 bytes of a visible splat, not in the order of memory, and writes 44.
struct OrderVisible {
    static constexpr uint32_t kThreads = 256;
    const uint32_t* order;
    const ProjectedGaussian<float>* projected;
    const uint32_t* tileCount;
    uint32_t visibleCount;
    ProjectedGaussian<float>* ordered;
    uint32_t *pairCount, *visibleFromSplat;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t v = t.index();
        if (v >= visibleCount) return;
        const uint32_t splat = order[v];
        ordered[v] = projected[splat];
        pairCount[v] = tileCount[splat];
        visibleFromSplat[splat] = uint32_t(v);
    }
};

struct PairOrigin {
    uint32_t visible, blockMask;
};

/// A thread a visible splat: reads 40 bytes; writes 16 a pair.
struct WritePairs {
    static constexpr uint32_t kThreads = 128;
    const ProjectedGaussian<float>* projected;
    const uint32_t* pairStart;
    uint32_t visibleCount;
    int width, height, tilesX;
    uint32_t *tiles, *pairs;
    PairOrigin* origins;

    NACRE_DEVICE uint32_t writeRow(const ProjectedGaussian<float>& s, const TileCover& cover, int ty, uint32_t visible, uint32_t first) const
    {
        return tilesOfRow(s, cover, ty, width, tilesX, [&](uint32_t k, uint32_t tile, uint32_t mask) {
            tiles[first + k] = tile, pairs[first + k] = first + k, origins[first + k] = {visible, mask};
        });
    }

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const auto nothing = [](uint32_t, uint32_t, uint32_t) {};
        const uint32_t v = uint32_t(t.index());
        TileCover cover{0, -1, 0, 0};
        if (v < visibleCount) {
            const ProjectedGaussian<float> s = projected[v];
            cover = tileCover(s, height);
            if (cover.tileY1 - cover.tileY0 < kOwnRows) {
                uint32_t first = pairStart[v];
                for (int ty = cover.tileY0; ty <= cover.tileY1; ++ty) first += writeRow(s, cover, ty, v, first);
            }
        }
        uint32_t large = t.ballot(kFullWarp, cover.tileY1 - cover.tileY0 >= kOwnRows);
        for (uint32_t lane = 0; large != 0; ++lane, large >>= 1) {
            if (!(large & 1)) continue;
            const uint32_t its = v - t.lane() + lane;
            const ProjectedGaussian<float> s = projected[its];
            const TileCover itsCover = tileCover(s, height);
            uint32_t first = pairStart[its];
            for (int rows = itsCover.tileY0; rows <= itsCover.tileY1; rows += int(kWarp)) {
                const int ty = rows + int(t.lane());
                const uint32_t own = ty <= itsCover.tileY1 ? tilesOfRow(s, itsCover, ty, width, tilesX, nothing) : 0;
                uint32_t sum = own;
                for (uint32_t d = 1; d < kWarp; d *= 2) {
                    const uint32_t other = t.shuffleUp(kFullWarp, sum, d);
                    if (t.lane() >= d) sum += other;
                }
                if (own > 0) writeRow(s, itsCover, ty, its, first + sum - own);
                first += t.shuffle(kFullWarp, sum, kWarp - 1);
            }
        }
    }
};

/// A thread an entry: reads 8 bytes, 8 more not in the order of memory, and writes 12 and, as scattered, 4.
struct WriteEntries {
    static constexpr uint32_t kThreads = 256;
    const uint32_t *tiles, *pairs;
    const PairOrigin* origins;
    uint32_t entryCount;
    TileEntry* entries;
    uint32_t* entryFromPair;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t e = t.index();
        if (e >= entryCount) return;
        const uint32_t pair = pairs[e];
        const PairOrigin origin = origins[pair];
        entries[e] = {origin.visible, tiles[e], origin.blockMask};
        entryFromPair[pair] = uint32_t(e);
    }
};

/// A thread a tile, and one for the end: where it would come among the sorted entries.
struct FindTileStarts {
    static constexpr uint32_t kThreads = 256;
    const uint32_t* tiles;
    uint32_t entryCount, tileCount;
    uint32_t* tileStart;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        if (t.index() > tileCount) return;
        uint32_t first = 0, last = entryCount;
        while (first < last) {
            const uint32_t middle = first + (last - first) / 2;
            if (tiles[middle] < t.index()) first = middle + 1;
            else last = middle;
        }
        tileStart[t.index()] = first;
    }
};

/// Memory is reused between calls: no allocation once it has grown.
class Tiles {
public:
    /// Valid until the next call. `splats`: memory of the device.
    TileView build(Device& device, const View<float>& view, const GaussianGeometry<float>* splats, uint32_t count)
    {
        TileView out{};
        out.width = int(view.width), out.height = int(view.height);
        out.tilesX = (out.width + kTileSize - 1) / kTileSize, out.tilesY = (out.height + kTileSize - 1) / kTileSize;
        const uint32_t tileCount = uint32_t(out.tilesX) * uint32_t(out.tilesY);

        const uint32_t blocks = std::max(1u, blocksFor(count, ProjectSplats::kThreads));
        projected_.reserve(device, count), tilesOfSplat_.reserve(device, count), visibleFromSplat_.reserve(device, count);
        inBlocks_.reserve(device, 2 * size_t(blocks) + 1), totals_.reserve(device, 2);
        keys_.reserve(device, count), order_.reserve(device, count);
        launch(device, blocks, ProjectSplats{view, splats, count, projected_.data(), tilesOfSplat_.data(), inBlocks_.data()});
        scan_.run(device, inBlocks_.data(), inBlocks_.data(), 2 * blocks);
        launch(device, blocks, JoinVisible{projected_.data(), tilesOfSplat_.data(), inBlocks_.data(), count, keys_.data(), order_.data(),
                                           visibleFromSplat_.data(), totals_.data()});
        uint32_t totals[2];
        totals_.download(device, totals);
        out.visibleCount = totals[0], out.entryCount = totals[1];
        if (out.entryCount > kMostPairs)
            throw DeviceError("the splats touch more tiles of one view than there is room for (2^31): they are too large, or too many, for an image of " +
                              std::to_string(out.width) + " x " + std::to_string(out.height));

        keys_.reserve(device, out.visibleCount), order_.reserve(device, out.visibleCount); // fewer than before: nothing moves
        sort_.run(device, keys_, order_, 31);
        ordered_.reserve(device, out.visibleCount), pairStart_.reserve(device, size_t(out.visibleCount) + 1);
        launch(device, blocksFor(out.visibleCount, OrderVisible::kThreads),
               OrderVisible{order_.data(), projected_.data(), tilesOfSplat_.data(), out.visibleCount, ordered_.data(), pairStart_.data(), visibleFromSplat_.data()});
        scan_.run(device, pairStart_.data(), pairStart_.data(), out.visibleCount);

        tiles_.reserve(device, out.entryCount), pairs_.reserve(device, out.entryCount), origins_.reserve(device, out.entryCount);
        launch(device, blocksFor(out.visibleCount, WritePairs::kThreads),
               WritePairs{ordered_.data(), pairStart_.data(), out.visibleCount, out.width, out.height, out.tilesX, tiles_.data(), pairs_.data(), origins_.data()});
        pairSort_.run(device, tiles_, pairs_, uint32_t(std::bit_width(tileCount - 1)));
        entries_.reserve(device, out.entryCount), entryFromPair_.reserve(device, out.entryCount), tileStart_.reserve(device, size_t(tileCount) + 1);
        launch(device, blocksFor(out.entryCount, WriteEntries::kThreads),
               WriteEntries{tiles_.data(), pairs_.data(), origins_.data(), out.entryCount, entries_.data(), entryFromPair_.data()});
        launch(device, blocksFor(size_t(tileCount) + 1, FindTileStarts::kThreads), FindTileStarts{tiles_.data(), out.entryCount, tileCount, tileStart_.data()});

        out.splatFromVisible = order_.data(), out.visibleFromSplat = visibleFromSplat_.data(), out.projected = ordered_.data();
        out.tileStart = tileStart_.data(), out.entries = entries_.data(), out.pairStart = pairStart_.data(), out.entryFromPair = entryFromPair_.data();
        return out;
    }

private:
    static constexpr uint32_t kMostPairs = 1u << 31;

    Buffer<ProjectedGaussian<float>> projected_, ordered_; // per splat; per visible splat
    Buffer<uint32_t> tilesOfSplat_, visibleFromSplat_, inBlocks_, totals_, keys_, order_, pairStart_, tiles_, pairs_, entryFromPair_, tileStart_;
    Buffer<PairOrigin> origins_;
    Buffer<TileEntry> entries_;
    Scan scan_;
    RadixSort sort_, pairSort_;
};

} // namespace nacre::NACRE_BACKEND
