#include "pack/leading_rows.h"

#include "appearance/model_table.h"

#include <algorithm>
#include <numeric>

namespace nacre {

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
        reorderSplats(asset, order);
        channel->leading = leading;
        channel->values.resize(leading * channel->components);
    }
}

} // namespace nacre
