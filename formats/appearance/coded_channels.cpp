#include "appearance/coded_channels.h"

#include "appearance/model_table.h"

#include <algorithm>
#include <cmath>

namespace nacre {

void expandRow(const CodedChannels& coded, size_t splat, float* x)
{
    std::copy(coded.offset.begin(), coded.offset.end(), x);
    for (uint32_t k = 0; k < coded.codes; ++k) {
        const auto c = float(coded.values[splat * coded.codes + k]);
        if (c == 0) continue;
        const float* b = &coded.basis[size_t(k) * coded.numbers];
        for (uint32_t d = 0; d < coded.numbers; ++d) x[d] += c * b[d];
    }
}

void expandChannels(SplatAsset& asset)
{
    const AppearanceModel& model = *findAppearanceModel(asset.model);
    for (const CodedChannels& coded : asset.coded) {
        const size_t rows = coded.values.size() / coded.codes;
        std::vector<float> x(coded.numbers);
        std::vector<Channel*> channels;
        for (const std::string& name : coded.channels) {
            channels.push_back(&*std::find_if(asset.channels.begin(), asset.channels.end(), [&](const Channel& c) { return c.name == name; }));
            Channel& channel = *channels.back();
            const auto spec = std::find_if(model.channels.begin(), model.channels.end(), [&](const ChannelSpec& s) { return channel.name == s.name; });
            if (spec->type == ChannelType::kFloat) channel.values.resize(rows * channel.components);
            else channel.bytes.resize(rows * channel.components);
        }
        for (size_t i = 0; i < rows; ++i) {
            expandRow(coded, i, x.data());
            const float* from = x.data();
            for (Channel* channel : channels) {
                const size_t at = i * channel->components;
                if (channel->bytes.empty()) std::copy_n(from, channel->components, &channel->values[at]);
                else
                    for (uint32_t k = 0; k < channel->components; ++k) channel->bytes[at + k] = uint8_t(std::clamp(from[k], 0.0f, 255.0f) + 0.5f);
                from += channel->components;
            }
        }
    }
    asset.coded.clear();
}

} // namespace nacre
