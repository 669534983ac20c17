#include "appearance/model_table.h"
#include "appearance/sss/sss_asset.h"

namespace nacre {

const char* sss::summary()
{
    return "subsurface splats: deferred PBR with editable materials, and a small network for light beneath the surface, linear in light";
}

std::vector<ChannelSpec> sss::channels()
{
    return {{"baseColor", {3}},
            {"material", {2, 3}}, // without subsurfaceness, with it
            {"normal", {3}},
            {"visibility", {0, 256, 1024}, ChannelType::kUnorm8}, // 0: the channel may be absent
            {"network", {0, kSssNetworkFloats}, ChannelType::kFloat, true},
            {"code", {0, kSssCodeInputs}},
            {"codeWeights", {0, kSssHidden1 * kSssCodeInputs}, ChannelType::kFloat, true}};
}

} // namespace nacre
