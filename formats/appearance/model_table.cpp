// The table of appearance models, and the border check every asset passes when it is read, written or handed to a renderer.
#include "appearance/model_table.h"

#include "appearance/detail.h"
#include "base/finite.h"
#include "base/limits.h"
#include "base/text.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre {
namespace {

std::vector<AppearanceModel> makeTable()
{
    std::vector<AppearanceModel> table;
#define NACRE_MODEL(name) table.push_back({#name, name::summary(), name::channels()});
    NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    return table;
}

Error bad(std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; }

Error unknownModel(const std::string& name)
{
#define NACRE_MODEL(known) \
    if (name == #known) return bad("appearance model '" + name + "' was left out of this build of Nacre (CMake options NACRE_WITH_*)");
    NACRE_ALL_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    std::string known;
    for (const AppearanceModel& m : appearanceModels()) known += (known.empty() ? "" : ", ") + std::string(m.name);
    return bad("unknown appearance model '" + name + "', this version knows: " + known);
}

std::string sizesText(const ChannelSpec& spec)
{
    std::string text;
    for (uint32_t n : spec.components) text += (text.empty() ? "" : ", ") + std::to_string(n);
    return text;
}

std::string atSplat(size_t i) { return " (splat " + std::to_string(i) + ")"; }

bool allWithin(const std::vector<float>& values, float most)
{
    bool good = true; // NaN compares false
    for (const float v : values) good &= std::abs(v) <= most;
    return good;
}

/// False for NaN.
bool within(const glm::vec3& v, float low, float high)
{
    return v.x >= low && v.x <= high && v.y >= low && v.y <= high && v.z >= low && v.z <= high;
}

bool unit(const glm::quat& q)
{
    const double norm = std::sqrt(double(q.w) * q.w + double(q.x) * q.x + double(q.y) * q.y + double(q.z) * q.z);
    return std::abs(norm - 1.0) <= 1e-3; // f32 normalisation is good to 1e-7; other tools round to 8 or 16 bits and renormalise
}

Status validateCloud(const SplatCloud& cloud)
{
    const size_t n = cloud.count;
    if (n == 0) return bad("the asset has no splats, at least one is needed");
    if (cloud.positions.size() != n || cloud.rotations.size() != n || cloud.scales.size() != n || cloud.opacities.size() != n)
        return bad("geometry arrays disagree: " + std::to_string(n) + " splats, but " + std::to_string(cloud.positions.size()) +
                   " positions, " + std::to_string(cloud.rotations.size()) + " rotations, " +
                   std::to_string(cloud.scales.size()) + " scales, " + std::to_string(cloud.opacities.size()) + " opacities");
    for (size_t i = 0; i < n; ++i) {
        const glm::vec3& s = cloud.scales[i];
        if (!within(cloud.positions[i], -kLargestNumber, kLargestNumber)) return bad("position is not finite or beyond 1e15" + atSplat(i));
        if (!unit(cloud.rotations[i])) return bad("rotation is not a unit quaternion" + atSplat(i));
        if (!within(s, std::numeric_limits<float>::denorm_min(), kLargestNumber)) return bad("scale is not positive or beyond 1e15" + atSplat(i));
        if (!(cloud.opacities[i] >= 0 && cloud.opacities[i] <= 1)) return bad("opacity is outside [0, 1]" + atSplat(i));
    }
    return ok();
}

bool isCoded(const SplatAsset& asset, const Channel& channel)
{
    for (const CodedChannels& coded : asset.coded)
        if (std::find(coded.channels.begin(), coded.channels.end(), channel.name) != coded.channels.end()) return true;
    return false;
}

/// Names and shapes; and what the codes stand for is finite and within bounds.
Status validateCoded(const SplatAsset& asset)
{
    for (const CodedChannels& coded : asset.coded) {
        size_t numbers = 0, rows = 0;
        for (const std::string& name : coded.channels) {
            const Channel* channel = asset.find(name.c_str());
            if (!channel || channel->perAsset || !channel->values.empty() || !channel->bytes.empty()) return bad("channel '" + name + "' cannot be coded");
            for (const CodedChannels& other : asset.coded)
                if (&other != &coded && std::find(other.channels.begin(), other.channels.end(), name) != other.channels.end()) return bad("channel '" + name + "' is coded twice");
            if (numbers > 0 && rows != channel->rows(asset.cloud.count)) return bad("coded channels have different rows");
            numbers += channel->components, rows = channel->rows(asset.cloud.count);
        }
        if (numbers == 0 || coded.codes == 0 || numbers != coded.numbers || coded.offset.size() != numbers || coded.basis.size() != numbers * coded.codes ||
            coded.values.size() != rows * coded.codes)
            return bad("coded channels have " + std::to_string(coded.values.size()) + " codes and " + std::to_string(coded.basis.size()) + " numbers of a basis, which do not fit");
        for (size_t d = 0; d < numbers; ++d) {
            double largest = std::abs(double(coded.offset[d])); // the sum is NaN if any number is
            for (size_t k = 0; k < coded.codes; ++k) largest += 128 * std::abs(double(coded.basis[k * numbers + d]));
            if (!(largest <= double(kLargestNumber))) return bad("coded channels reach values that are not finite or beyond 1e15");
        }
    }
    return ok();
}

Status validateChannels(const SplatAsset& asset, const AppearanceModel& model)
{
    for (size_t i = 0; i < asset.channels.size(); ++i) {
        const Channel& channel = asset.channels[i];
        const auto sameName = [&](const auto& other) { return channel.name == other.name; };
        const auto spec = std::find_if(model.channels.begin(), model.channels.end(), sameName);
        if (spec == model.channels.end())
            return bad("channel '" + channel.name + "' does not belong to model '" + asset.model + "'");
        if (std::any_of(asset.channels.begin(), asset.channels.begin() + ptrdiff_t(i), sameName))
            return bad("channel '" + channel.name + "' appears twice");
        const std::vector<uint32_t>& sizes = spec->components;
        if (channel.components == 0 || std::find(sizes.begin(), sizes.end(), channel.components) == sizes.end())
            return bad("channel '" + channel.name + "' has " + std::to_string(channel.components) +
                       " components per splat, accepted: " + sizesText(*spec) +
                       (sizes[0] == 0 ? " (0: leave the channel out)" : ""));
        if (channel.perAsset != spec->perAsset)
            return bad("channel '" + channel.name + "' is stored " + (spec->perAsset ? "per splat, expected once per asset" : "once per asset, expected per splat"));
        if (channel.leading > 0 && (!spec->mayLead || channel.leading >= asset.cloud.count))
            return bad("channel '" + channel.name + "' has rows for the first " + std::to_string(channel.leading) + " of " + std::to_string(asset.cloud.count) +
                       " splats, expected " + (spec->mayLead ? "fewer than all" : "for all"));
        const bool floats = spec->type == ChannelType::kFloat;
        const size_t stored = floats ? channel.values.size() : channel.bytes.size(), other = floats ? channel.bytes.size() : channel.values.size();
        const size_t rows = channel.rows(asset.cloud.count);
        if (isCoded(asset, channel) && stored == 0 && other == 0) continue;
        if (stored != rows * channel.components || other != 0)
            return bad("channel '" + channel.name + "' has " + std::to_string(channel.values.size()) + " floats and " +
                       std::to_string(channel.bytes.size()) + " bytes, expected " + std::to_string(rows) + (channel.perAsset ? " row x " : " splats x ") +
                       std::to_string(channel.components) + (floats ? " floats" : " bytes"));
        if (!allWithin(channel.values, kLargestNumber))
            return bad("channel '" + channel.name + "' has a value that is not finite or beyond 1e15");
    }
    for (const ChannelSpec& spec : model.channels)
        if (spec.components[0] != 0 && !asset.find(spec.name))
            return bad("channel '" + std::string(spec.name) + "' of model '" + asset.model + "' is missing");
    return ok();
}

/// What reduceDetail can work with. Presets likewise.
Status validateDetail(const SplatAsset& asset)
{
    const Channel *importance = asset.find("importance"), *growth = asset.find("growth");
    if (!importance != !growth) return bad(std::string("channel '") + (importance ? "growth" : "importance") + "' is missing: 'importance' and 'growth' come together");
    if (growth && !(growth->values[0] >= 0 && growth->values[0] <= 1)) return bad("channel 'growth' is not from 0 to 1");
    if (asset.presets.size() > 64) return bad("the asset has " + std::to_string(asset.presets.size()) + " presets, at most 64 are read");
    for (size_t i = 0; i < asset.presets.size(); ++i) {
        const Preset& p = asset.presets[i];
        const std::string where = "preset " + inQuotes(p.name) + ": ";
        if (p.name.empty() || p.name.size() > 31 || !std::all_of(p.name.begin(), p.name.end(), [](char c) { return c > 0x20 && c < 0x7f; }))
            return bad("the name of a preset must be 1 to 31 printable ASCII characters");
        for (size_t k = 0; k < i; ++k)
            if (asset.presets[k].name == p.name) return bad(where + "the name appears twice");
        if (Status s = checkDetail(p.detail); !s) return bad(where + s.error().message);
        if (!(p.resolutionScale > 0 && p.resolutionScale <= 1)) return bad(where + "the scale of the resolution must be above 0 and at most 1");
        if (p.environmentDirections > 1024) return bad(where + "at most 1024 directions stand for an environment");
        if (!std::isfinite(p.milliseconds) || !std::isfinite(p.psnrMasked)) return bad(where + "a number is not finite");
    }
    return ok();
}

Status validateNeutral(const SplatAsset& asset)
{
    const NeutralLook& look = asset.neutral;
    const int f = look.shFunctions;
    if (f != 0 && f != 1 && f != 4 && f != 9 && f != 16)
        return bad("neutral look has " + std::to_string(f) + " SH functions, expected 0, 1, 4, 9 or 16");
    if (look.sh.size() != asset.cloud.count * size_t(f))
        return bad("neutral look has " + std::to_string(look.sh.size()) + " coefficients, expected " +
                   std::to_string(asset.cloud.count) + " splats x " + std::to_string(f));
    if (!look.sh.empty() && !allFinite(&look.sh[0].x, 3 * look.sh.size()))
        return bad("neutral look has a value that is not finite");
    return ok();
}

// Wide enough for a grain of sand in kilometres and a moon in millimetres; within it no product of two leaves float64.
Status validateFrame(const AssetFrame& frame)
{
    const auto sane = [](double x) { return x >= 1e-30 && x <= 1e30; };
    if (!sane(frame.scale) || !sane(frame.lightGain)) return bad("scale and light gain of the dataset's frame must be from 1e-30 to 1e30");
    for (int k = 0; k < 3; ++k)
        if (!(std::abs(frame.translation[k]) <= 1e30)) return bad("translation of the dataset's frame is not finite and below 1e30");
    return ok();
}

} // namespace

ChannelSpec importanceChannel() { return {"importance", {0, 1}}; }
ChannelSpec growthChannel() { return {"growth", {0, 1}, ChannelType::kFloat, true}; }

std::span<const AppearanceModel> appearanceModels()
{
    static const std::vector<AppearanceModel> table = makeTable();
    return table;
}

const AppearanceModel* findAppearanceModel(const std::string& name)
{
    for (const AppearanceModel& model : appearanceModels())
        if (name == model.name) return &model;
    return nullptr;
}

Status validate(const SplatAsset& asset)
{
    const AppearanceModel* model = findAppearanceModel(asset.model);
    if (!model) return unknownModel(asset.model);
    if (Status s = validateCloud(asset.cloud); !s) return s;
    if (Status s = validateChannels(asset, *model); !s) return s;
    if (Status s = validateCoded(asset); !s) return s;
#define NACRE_MODEL(name) \
    if (asset.model == #name) \
        if (Status s = name::check(asset); !s) return s;
    NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    if (asset.drawnVisibility != 0 && ((asset.drawnVisibility != 16 && asset.drawnVisibility != 32) || asset.find("visibility")))
        return bad("visibility is both stored and to be drawn, or of a size that is neither 16 nor 32");
    if (Status s = validateDetail(asset); !s) return s;
    if (Status s = validateNeutral(asset); !s) return s;
    if (!(std::isfinite(asset.lowPassVariance) && asset.lowPassVariance >= 0))
        return bad("screen-space filter variance is not finite and >= 0");
    if (!unit(asset.yUpFromAsset)) return bad("rotation to +Y up is not a unit quaternion");
    return validateFrame(asset.frame);
}

} // namespace nacre
