#include "eval/channel_pictures.h"

#include "eval/label.h"
#include "eval/splat_renderer.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nacre {

namespace {

constexpr double kLeftOut = 0.005;     // of the values at either end: a few pixels of an outline must not set the scale
constexpr float kFarthest = 0.2f;      // grey of what is far, told apart from what is not there
constexpr int kColumns = 4;

/// Values that white and black stand for, at the two ends of those that are seen.
struct Span { float low = 0, high = 0; };

Span spanOf(const Image& part)
{
    std::vector<float> seen;
    for (size_t i = 0; i < part.rgba.size(); i += 4)
        for (size_t c = 0; c < 3; ++c)
            if (part.rgba[i + 3] > 0 && std::isfinite(part.rgba[i + c])) seen.push_back(part.rgba[i + c]);
    if (seen.empty()) return {};
    const auto at = [&](size_t rank) {
        std::nth_element(seen.begin(), seen.begin() + std::ptrdiff_t(rank), seen.end());
        return seen[rank];
    };
    const size_t leftOut = size_t(kLeftOut * double(seen.size()));
    return {at(leftOut), at(seen.size() - 1 - leftOut)};
}

std::string words(const char* pattern, double a, double b = 0)
{
    char text[80];
    std::snprintf(text, sizeof text, pattern, a, b);
    return text;
}

/// grey: of a value; black where nothing is seen.
template <class F>
Picture greys(const Image& part, F grey)
{
    Picture out{part.width, part.height, std::vector<uint8_t>(part.rgba.size() / 4 * 3)};
    for (size_t i = 0; i < part.rgba.size() / 4; ++i)
        for (size_t c = 0; c < 3 && part.rgba[4 * i + 3] > 0; ++c) {
            const float g = grey(part.rgba[4 * i + c]);
            out.rgb[3 * i + c] = g > 0 ? uint8_t(std::lround(255 * std::min(g, 1.0f))) : uint8_t(0); // NaN is black
        }
    return out;
}

void show(PartRange range, ChannelPicture& out)
{
    const Image& part = out.values;
    const Span seen = spanOf(part);
    const auto even = [&](float low, float high) { return greys(part, [=](float x) { return high > low ? (x - low) / (high - low) : 0.0f; }); };
    switch (range) {
    case PartRange::kColor:
        out.scale = "as on a screen, white 1";
        out.picture = displayPicture(part);
        return;
    case PartRange::kUnit:
        out.scale = "black 0, white 1";
        out.picture = even(0, 1);
        return;
    case PartRange::kLargest:
        out.scale = words("black 0, white %.3g", double(std::max(seen.high, 0.0f)));
        out.picture = even(0, seen.high);
        return;
    case PartRange::kSigned: {
        const float most = std::max(std::abs(seen.low), std::abs(seen.high));
        out.scale = words("black %.3g, white %.3g", -double(most), double(most));
        out.picture = even(-most, most);
        return;
    }
    case PartRange::kDirection:
        out.scale = "x, y, z: dark -1, bright 1";
        out.picture = even(-1, 1);
        return;
    case PartRange::kDistance: {
        out.scale = words("white %.3g, dark %.3g", double(seen.low), double(seen.high));
        const float perUnit = seen.high > seen.low ? (1 - kFarthest) / (seen.high - seen.low) : 0.0f;
        out.picture = greys(part, [=](float x) { return std::max(1 - (x - seen.low) * perUnit, kFarthest); });
        return;
    }
    }
}

} // namespace

Result<ChannelPicture> channelPicture(const SplatAsset& asset, const std::string& name, const Camera& camera, std::span<const Light> lights,
                                      std::span<const SplatEdit> edits)
{
    const auto part = findPart(asset, name);
    if (!part) return part.error();
    const auto renderer = makePartRenderer(asset, name);
    if (!renderer) return renderer.error();
    if (Status s = (*renderer)->setEdits(edits); !s) return s.error();
    auto image = (*renderer)->render(camera, lights);
    if (!image) return image.error();
    ChannelPicture out{name, {}, {}, std::move(*image)};
    show(part->range, out);
    return out;
}

Result<std::vector<ChannelPicture>> channelPictures(const SplatAsset& asset, const Camera& camera, std::span<const Light> lights,
                                                    std::span<const SplatEdit> edits)
{
    std::vector<ChannelPicture> out;
    for (const PartInfo& part : partsOf(asset)) {
        auto channel = channelPicture(asset, part.name, camera, lights, edits);
        if (!channel) return channel.error();
        out.push_back(std::move(*channel));
    }
    return out;
}

Picture channelSheet(std::span<const ChannelPicture> channels)
{
    std::vector<Picture> pictures;
    for (const ChannelPicture& c : channels) {
        const std::string lines[] = {c.name, c.scale};
        pictures.push_back(labelled(c.picture, lines));
    }
    return tile(pictures, kColumns);
}

} // namespace nacre
