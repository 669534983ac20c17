#include "appearance/bigs/bigs.h"
#include "appearance/model_table.h"

namespace nacre {

const char* bigs::summary() { return "bidirectional Gaussian primitives: per-splat spherical-harmonic light transport, linear in light"; }

std::vector<ChannelSpec> bigs::channels()
{
    const auto pairs = [](int functions) { return uint32_t(3 * bigsPairCount(functions)); };
    return {{"tDir", {25}},
            {"tInd", {75}},
            {"rho", {3}},
            {"s", {0, pairs(1), pairs(4), pairs(9), pairs(16), pairs(25)}, ChannelType::kFloat, false, true}, // 0: the channel may be absent
            {"lobe", {0, kBigsLobeFloats}},
            {"forward", {0, kBigsForwardFloats}},
            {"visibility", {0, 256, 1024}, ChannelType::kUnorm8},
            {"shadow", {0, 1}},
            importanceChannel(),
            growthChannel()};
}

Status bigs::check(const SplatAsset&) { return ok(); }

} // namespace nacre
