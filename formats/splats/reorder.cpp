#include "splats/reorder.h"

#include <algorithm>

namespace nacre {

namespace {

template <class T> void reorder(std::vector<T>& rows, size_t count, std::span<const uint32_t> order)
{
    if (rows.empty()) return;
    const size_t width = rows.size() / count;
    std::vector<T> out;
    out.reserve(width * order.size());
    for (const uint32_t i : order)
        if ((i + 1) * width <= rows.size()) out.insert(out.end(), rows.begin() + ptrdiff_t(i * width), rows.begin() + ptrdiff_t((i + 1) * width));
    rows = std::move(out);
}

} // namespace

void reorderSplats(SplatAsset& asset, std::span<const uint32_t> order)
{
    SplatCloud& cloud = asset.cloud;
    const size_t n = cloud.count;
    reorder(cloud.positions, n, order), reorder(cloud.rotations, n, order), reorder(cloud.scales, n, order), reorder(cloud.opacities, n, order);
    reorder(asset.neutral.sh, n, order);
    for (Channel& c : asset.channels) {
        if (c.perAsset) continue;
        const size_t rows = c.rows(n);
        reorder(c.values, rows, order), reorder(c.bytes, rows, order);
        if (c.leading > 0) c.leading = size_t(std::count_if(order.begin(), order.end(), [&](uint32_t i) { return i < rows; }));
        if (c.leading == order.size()) c.leading = 0;
    }
    std::erase_if(asset.channels, [](const Channel& c) { return c.values.empty() && c.bytes.empty(); }); // no splat is left that has rows
    cloud.count = order.size();
}

} // namespace nacre
