// The profile `compact`: numbers of splats as blocks of small integers (SPEC.md, section 8).
//
// A block holds some numbers of every splat, or of the asset. Of a row with the integers c:
//     y[d] = offset[d] + step[d] c[d]                              without a basis
//     y[d] = offset[d] + scale[d] sum_k step[k] c[k] basis[k][d]   with one; |c| <= 127, basis of bytes
// and then the numbers themselves by the block's transform. Rows are splats, or, of a block per asset, components: then there is one column.
#pragma once

#include "base/result.h"
#include "splats/splat_asset.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace nacre {

enum class BlockTransform {
    kLinear,    // x = y
    kExp,       // x = e^y
    kRotation,  // ROTATION: x, y, z of a unit quaternion whose w is not negative
    kDirection, // octahedral coordinates, 2 numbers of 3 components (SPEC.md, visibility)
};
const char* blockTransformName(BlockTransform transform);

/// Geometry by the names POSITION, ROTATION, SCALE and OPACITY; else a channel.
struct BlockTarget {
    std::string name;
    uint32_t first = 0, count = 0; // components
    bool operator==(const BlockTarget&) const = default;
};

struct BlockLayout {
    std::vector<BlockTarget> targets; // side by side; several only with a linear transform
    BlockTransform transform = BlockTransform::kLinear;
    uint32_t numbers = 0, columns = 0; // equal without a basis, at most two columns a number with one; 1 and 1 per asset
    std::vector<float> offset, step;   // [numbers], [columns]
    std::vector<float> scale;          // [numbers], with a basis
    std::vector<int8_t> basis;         // [columns][numbers], or empty
    bool operator==(const BlockLayout&) const = default;
};

struct Block : BlockLayout {
    std::vector<int32_t> codes; // [columns][rows]
};

/// An asset as it is stored.
struct QuantisedAsset {
    SplatAsset frame;           // cloud.count, channels without values, and whatever is not a number of a splat; no neutral look
    std::vector<Block> blocks;
};

/// Where the numbers of a block go; the reader's and the packer's one way from integers to an asset.
class BlockWriter {
public:
    /// `asset`: the arrays of the cloud have their sizes. Error: targets that there are not, that are filled already, or shapes that do not fit.
    static Result<BlockWriter> create(SplatAsset& asset, BlockLayout layout);
    size_t rows() const { return rows_; }
    const BlockLayout& layout() const { return layout_; }
    /// Columns in order. False if a code is out of range.
    bool column(uint32_t k, std::span<const int32_t> codes);
    void finish();

private:
    BlockWriter(SplatAsset& asset, BlockLayout layout, size_t rows) : asset_(&asset), layout_(std::move(layout)), rows_(rows) {}
    float* destination(uint32_t number, size_t* stride);

    SplatAsset* asset_;
    BlockLayout layout_;
    size_t rows_;
    std::vector<int8_t> codes_; // [row][columns], with a basis
};

/// Whether blocks have filled all of the geometry and every channel.
Status checkComplete(const SplatAsset& asset, std::span<const BlockLayout> layouts);

/// What a reader makes of it; channels with a basis stay coded.
Result<SplatAsset> dequantise(const QuantisedAsset& asset);

/// .glb bytes, the same whatever the machine. Rows of the same kind lie together; their order is the caller's, best along a space-filling curve.
Result<std::vector<std::byte>> encodeCompact(const QuantisedAsset& asset);

/// Of the file, what a block takes.
size_t encodedBytes(const Block& block);

/// A file has at least so many bytes for each two splats, so that what a reader allocates is bounded by what it was given.
constexpr size_t kSplatsPerByte = 2;

} // namespace nacre
