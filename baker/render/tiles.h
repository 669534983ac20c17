// From Gaussians to tile lists: project all, keep the visible, sort front to back by distance from the eye, and list per 16x16 tile
// which splats touch which of its 4x4 blocks. Deterministic for any thread count.
#pragma once

#include "base/radix_sort.h"
#include "render/projection.h"
#include "render/tile_entry.h"

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

struct VisibleSplats {                                          // sorted front to back; equal distances by splat index
    std::vector<uint32_t> splatFromVisible;
    std::vector<ProjectedGaussian<float>> projected;
    size_t count() const { return splatFromVisible.size(); }
};

struct TileLists {
    int width = 0, height = 0, tilesX = 0, tilesY = 0;
    std::vector<uint32_t> tileStart;        // [tiles + 1] into entries
    std::vector<TileEntry> entries;         // per tile, front to back
    std::vector<uint32_t> pairStart;        // [visible + 1] into entryFromPair
    std::vector<uint32_t> entryFromPair;    // the entries of one splat, in tile order
};

/// Buffers are reused between calls: no allocation once they have grown.
class TileBuilder {
public:
    void build(const View<float>& view, std::span<const GaussianGeometry<float>> splats);
    VisibleSplats visible;
    TileLists tiles;
    double projectSeconds = 0; // of the last build: projection and sort, without the lists

private:
    struct Chunk {
        std::vector<uint32_t> pairTile, pairMask, pairCount;
    };
    void project(const View<float>& view, std::span<const GaussianGeometry<float>> splats);
    void sort();
    void bin();
    std::vector<Chunk> chunks_;
    std::vector<uint32_t> keys_, order_, visibleInChunk_;
    std::vector<size_t> chunkVisible_;
    RadixScratch<uint32_t> sortScratch_;
    std::vector<ProjectedGaussian<float>> projected_; // per splat; only those of visible splats mean something
    std::vector<uint32_t> fill_;
};

} // namespace nacre
