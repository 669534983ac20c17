// How an image is cut into tiles, and what touches them.
#pragma once

#include <cstdint>

namespace nacre {

constexpr int kTileSize = 16;                                   // pixels
constexpr int kBlockSize = 4;                                   // pixels; a tile is 4x4 blocks
constexpr int kTilePixels = kTileSize * kTileSize;

struct TileEntry {
    uint32_t visible;   // index into the visible list
    uint32_t tile;
    uint32_t blockMask; // bit 4*row + column: the splat reaches kMinAlpha somewhere in that block
};

} // namespace nacre
