#include "pack/importance.h"

#include "appearance/detail.h"

#include <algorithm>
#include <cmath>

namespace nacre {

static void replaceChannel(SplatAsset& asset, Channel channel)
{
    std::erase_if(asset.channels, [&](const Channel& c) { return c.name == channel.name; });
    asset.channels.push_back(std::move(channel));
}

Status addImportance(SplatAsset& asset, std::span<const PackView> views)
{
    constexpr float kLeast = 1e-7f; // of what is never seen: 2^-23
    Channel importance{"importance", 1};
    for (const float x : splatImportance(asset, views)) importance.values.push_back(std::log2(std::max(x, kLeast)));
    constexpr size_t kViews = 6;
    const Result<PackReference> reference = PackReference::render(asset, someOf(views, kViews));
    if (!reference) return reference.error();
    replaceChannel(asset, std::move(importance));
    replaceChannel(asset, {"growth", 1, {0.21f}, {}, true});
    float best = 0;
    double least = INFINITY;
    for (const float power : {0.13f, 0.17f, 0.21f, 0.25f, 0.29f}) { // 0.5 would keep the area
        SplatAsset quarter = asset;
        replaceChannel(quarter, {"growth", 1, {power}, {}, true});
        if (Status s = reduceDetail(quarter, {0.25f}); !s) return s;
        const Result<double> object = reference->error(quarter), all = reference->errorEverywhere(quarter);
        if (!object) return object.error();
        if (!all) return all.error();
        if (const double error = *object + *all; error < least) least = error, best = power; // half of what shows around it
    }
    replaceChannel(asset, {"growth", 1, {best}, {}, true});
    return ok();
}

Status ensureImportance(SplatAsset& asset, const OlatSplit* seen)
{
    if (asset.find("importance")) return ok();
    constexpr size_t kViews = 48;
    const Result<std::vector<PackView>> views = viewsFor(asset, seen, kViews);
    if (!views) return views.error();
    return addImportance(asset, *views);
}

} // namespace nacre
