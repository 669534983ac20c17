#include "pack/leading_rows.h"

#include "appearance/model_table.h"

#include <algorithm>
#include <numeric>

namespace nacre {

namespace {

template <class T> void reorder(std::vector<T>& rows, const std::vector<uint32_t>& order)
{
    if (rows.empty()) return;
    const size_t width = rows.size() / order.size();
    std::vector<T> out;
    out.reserve(rows.size());
    for (const uint32_t i : order)
        out.insert(out.end(), rows.begin() + ptrdiff_t(i * width), rows.begin() + ptrdiff_t((i + 1) * width));
    rows = std::move(out);
}

void reorder(SplatAsset& asset, const std::vector<uint32_t>& order)
{
    SplatCloud& cloud = asset.cloud;
    reorder(cloud.positions, order), reorder(cloud.rotations, order), reorder(cloud.scales, order),
        reorder(cloud.opacities, order);
    reorder(asset.neutral.sh, order);
    for (Channel& c : asset.channels)
        if (!c.perAsset) reorder(c.values, order), reorder(c.bytes, order);
}

} // namespace

void leaveOutZeroRows(SplatAsset& asset)
{
    for (const ChannelSpec& spec : findAppearanceModel(asset.model)->channels) {
        const auto channel =
            std::find_if(asset.channels.begin(), asset.channels.end(), [&](const Channel& c) { return c.name == spec.name; });
        if (!spec.mayLead || channel == asset.channels.end() || channel->leading > 0) continue;
        std::vector<uint32_t> order(asset.cloud.count);
        std::iota(order.begin(), order.end(), 0u);
        const auto used = [&](uint32_t i) {
            const float* row = &channel->values[size_t(i) * channel->components];
            return std::any_of(row, row + channel->components, [](float x) { return x != 0; });
        };
        const auto end = std::stable_partition(order.begin(), order.end(), used);
        const size_t leading = size_t(end - order.begin());
        if (leading == order.size()) continue;
        if (leading == 0) {
            asset.channels.erase(channel);
            continue;
        }
        reorder(asset, order);
        channel->leading = leading;
        channel->values.resize(leading * channel->components);
    }
}

} // namespace nacre
