#include "appearance/model_table.h"
#include "appearance/sss/sss_asset.h"

#include "base/text.h"

#include <algorithm>
#include <cmath>

namespace nacre {

/// The largest number that a layer of the network can reach from inputs of at most `input`, and on the way there.
static double largestSum(const float* weight, const float* bias, double input, int inputs, int outputs)
{
    double largest = 0;
    for (int j = 0; j < outputs; ++j) {
        double sum = bias ? std::abs(double(bias[j])) : 0;
        for (int i = 0; i < inputs; ++i) sum += std::abs(double(weight[j * inputs + i])) * input;
        largest = std::max(largest, sum);
    }
    return largest;
}

/// Of a channel, stored or coded.
static double largestValue(const SplatAsset& asset, const Channel& channel)
{
    double largest = 0;
    for (const float v : channel.values) largest = std::max(largest, std::abs(double(v)));
    for (const CodedChannels& coded : asset.coded) {
        if (std::find(coded.channels.begin(), coded.channels.end(), channel.name) == coded.channels.end()) continue;
        for (size_t d = 0; d < coded.numbers; ++d) {
            double most = std::abs(double(coded.offset[d]));
            for (size_t k = 0; k < coded.codes; ++k) most += 128 * std::abs(double(coded.basis[k * coded.numbers + d]));
            largest = std::max(largest, most);
        }
    }
    return largest;
}

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
            {"codeWeights", {0, kSssHidden1 * kSssCodeInputs}, ChannelType::kFloat, true},
            importanceChannel(),
            growthChannel()};
}

// Three layers of weights of 1e15 end in infinities of both signs, and their sum is not a number, which every pixel would show.
Status sss::check(const SplatAsset& asset)
{
    constexpr double kMost = 1e30;
    const Channel *network = asset.find("network"), *code = asset.find("code"), *codeWeights = asset.find("codeWeights");
    if (!network) return ok();
    const float* w = network->values.data();
    const double normal = std::max(1.0, largestValue(asset, *asset.find("normal")));
    double first = largestSum(w + kSssFirstFixed, w + kSssFirstBias, normal, kSssFixedInputs, kSssHidden1) + largestSum(w + kSssFirstLight, nullptr, 1, kSssLightInputs, kSssHidden1);
    if (code && codeWeights) first += largestSum(codeWeights->values.data(), nullptr, largestValue(asset, *code), kSssCodeInputs, kSssHidden1);
    const double second = largestSum(w + kSssSecond, w + kSssSecondBias, first, kSssHidden1, kSssHidden2);
    const double third = largestSum(w + kSssThird, w + kSssThirdBias, second, kSssHidden2, kSssHidden3);
    const double share = largestSum(w + kSssShare, w + kSssShareBias, third, kSssHidden3, kSssHiddenShare);
    const double most = std::max({first, second, third, share, largestSum(w + kSssResidual, w + kSssResidualBias, third, kSssHidden3, 3),
                                  largestSum(w + kSssShareOut, w + kSssShareOutBias, share, kSssHiddenShare, 1)});
    if (most <= kMost) return ok();
    return Error{ErrorCode::kBadInput, "the weights of channel 'network' reach sums of " + numberText(float(std::min(most, 1e38))) + ", at most 1e30 can be evaluated"};
}

} // namespace nacre
