// The order of order.h made by compute shaders: the same keys, the same ties, index for index. It sorts all splats and culls none, since
// what cannot be seen costs a GPU little; so only a move of the eye or of an instance sorts again.
#pragma once

#include "order.h"
#include "textures.h"

namespace nacre {

/// Where the positions of an OrderInstance lie on the GPU.
struct OrderGeometry {
    const Texture* texture; // slot 0: the mean in xyz
    const SplatGrid* grid;
};

class GpuOrder {
public:
    explicit GpuOrder(Context& context) : context_(context) {}

    /// Writes list indices, far to near, into `order`, a list texture, if it is outdated or `lost`. Leaves the program and the textures of
    /// units 0 and 1 changed. `geometry` is parallel to `instances`, which are as in Order::update.
    Failure update(std::span<const OrderInstance> instances, std::span<const OrderGeometry> geometry, const OrderCamera& camera, const Texture& order, bool lost);

    uint32_t count() const { return count_; }
    bool hasSorted() const { return hasSorted_; }

    /// Programs ahead of the first sort.
    Failure compile();

private:
    Failure allocate(int width);
    void writeKeys(std::span<const OrderInstance> instances, std::span<const OrderGeometry> geometry);
    void sortDigit(int shift, const Texture& from, const Texture& to);

    Context& context_;
    OrderSource source_;
    Texture pairs_[2];           // RG32UI, as wide as the list: key, list index
    Texture counts_, offsets_;   // R32UI: of a digit in a tile, digit by digit
    const Program *keysProgram_ = nullptr, *countProgram_ = nullptr, *scanProgram_ = nullptr, *moveProgram_ = nullptr, *lastProgram_ = nullptr;
    uint32_t count_ = 0;
    uint64_t sortedIn_ = 0;      // draw
    bool hasSorted_ = false;
};

} // namespace nacre
