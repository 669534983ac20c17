// Assets with an order of importance.
#pragma once

#include "splats/splat_asset.h"

#include <random>

namespace nacre::test {

/// `spread`: of the importance, in factors of two.
inline SplatAsset withOrder(SplatAsset asset, float growth = 0.25f, float spread = 8, uint32_t seed = 1)
{
    std::mt19937 rng(seed);
    Channel importance{"importance", 1};
    for (size_t i = 0; i < asset.cloud.count; ++i) importance.values.push_back(-spread * float(rng() >> 8) * 0x1p-24f);
    asset.channels.push_back(std::move(importance));
    asset.channels.push_back({"growth", 1, {growth}, {}, true});
    return asset;
}

inline Preset preset(const std::string& name, const Detail& detail = {})
{
    Preset p;
    p.name = name, p.detail = detail;
    return p;
}

/// The first has every field away from what it is when absent.
inline std::vector<Preset> somePresets()
{
    Preset fast{"fast", {0.35f, kPartLobe | kPartIndirect, 9, 16}, 0.75f, 16, 1.2345678901234567, 27.125, "a card, 640 x 480, caf\xc3\xa9"};
    return {fast, preset("half", {0.5f}), preset("plain", {1, kPartVisibility}), preset("all")};
}

} // namespace nacre::test
