// What an asset may hold: the channels that each appearance model stores per splat.
#pragma once

#include "appearance/models.h"
#include "base/result.h"
#include "splats/splat_asset.h"

#include <span>
#include <string>
#include <vector>

namespace nacre {

/// One channel of a model. `components` lists the accepted sizes (ascending), so a scene can leave out what it does not need.
enum class ChannelType { kFloat, kUnorm8 };
struct ChannelSpec {
    const char* name;
    std::vector<uint32_t> components;
    ChannelType type = ChannelType::kFloat;
    bool perAsset = false;    // one row for all splats
    bool mayLead = false;     // rows of the first splats only (Channel::leading)
};

/// Of every model: the order of importance of splats, and how those grow that stay (appearance/detail.h).
ChannelSpec importanceChannel();
ChannelSpec growthChannel();

struct AppearanceModel {
    const char* name;         // as in --model and in the asset
    const char* summary;      // one line for --help and `nacre info --models`
    std::vector<ChannelSpec> channels;
};

#define NACRE_MODEL(name)             \
    namespace name {                  \
    const char* summary();            \
    std::vector<ChannelSpec> channels(); \
    Status check(const SplatAsset& asset); /* what names, sizes and finite values do not say */ \
    }
NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL

/// All of them, in the order of models.h.
std::span<const AppearanceModel> appearanceModels();

/// nullptr when there is no such model.
const AppearanceModel* findAppearanceModel(const std::string& name);

/// Checks counts, channel names and sizes, finite values, unit quaternions, positive scales, opacities in [0, 1].
Status validate(const SplatAsset& asset);

} // namespace nacre
