// A small valid asset whose every number is an exact function of its indices, and helpers to edit .glb bytes.
#pragma once

#include "appearance/model_table.h"
#include "appearance/sss/sss_asset.h"
#include "asset/asset_io.h"
#include "asset/compact.h"
#include "splats/splat_asset.h"

#include <nlohmann/json.hpp>

#include <cstring>
#include <string>
#include <vector>

namespace nacre::test {

/// `sharp`: with lobe and visibility. `sFunctions`: 0, 1, 4, 9, 16, 25; `neutralFunctions`: 0, 1, 4, 9, 16. All values are multiples of 1/64 (exact in f32 and
/// text).
inline SplatAsset makeAsset(size_t count, int sFunctions, int neutralFunctions, bool sharp = false)
{
    const auto value = [](size_t i) { return float(int(i * 37 % 129) - 64) / 64.0f; };
    SplatAsset asset;
    asset.model = "bigs";
    asset.bakedWith = "test \"quoted\" \\ \n caf\xc3\xa9";
    asset.yUpFromAsset = glm::quat(0.70710678f, -0.70710678f, 0.0f, 0.0f);
    asset.cloud.count = count;
    for (size_t i = 0; i < count; ++i) {
        asset.cloud.positions.emplace_back(value(3 * i), value(3 * i + 1), value(3 * i + 2));
        asset.cloud.rotations.push_back(i % 2 ? glm::quat(0.6f, 0.0f, -0.8f, 0.0f) : glm::quat(0.5f, 0.5f, -0.5f, 0.5f));
        asset.cloud.scales.emplace_back(float(i + 1) / 64.0f, 0.25f, 1.0f / 1024.0f);
        asset.cloud.opacities.push_back(float(i % 65) / 64.0f);
    }
    const auto addChannel = [&](const char* name, uint32_t components) {
        Channel channel{name, components, {}, {}};
        for (size_t i = 0; i < count * components; ++i) channel.values.push_back(value(i + components));
        asset.channels.push_back(std::move(channel));
    };
    addChannel("tDir", 25);
    addChannel("tInd", 75);
    addChannel("rho", 3);
    if (sFunctions > 0) addChannel("s", uint32_t(3 * sFunctions * (sFunctions + 1) / 2));
    if (sharp) {
        Channel lobe{"lobe", 7, {}, {}}, visibility{"visibility", 256, {}, {}}, shadow{"shadow", 1, {}, {}};
        for (size_t i = 0; i < count; ++i) lobe.values.insert(lobe.values.end(), {0.6f, 0.0f, 0.8f, float(4 << i % 8), 0.25f, 0.5f, float(i)});
        for (size_t i = 0; i < 256 * count; ++i) visibility.bytes.push_back(uint8_t(i * 37 % 251));
        asset.channels.push_back(std::move(lobe));
        for (size_t i = 0; i < count; ++i) shadow.values.push_back(float(64 - i % 65) / 64.0f);
        asset.channels.push_back(std::move(visibility));
        asset.channels.push_back(std::move(shadow));
    }
    asset.neutral.shFunctions = neutralFunctions;
    for (size_t i = 0; i < count * size_t(neutralFunctions); ++i)
        asset.neutral.sh.emplace_back(value(i), value(i + 5), value(i + 11));
    return asset;
}

/// makeAsset with rows of s for the first `leading` splats only.
inline SplatAsset makeLeading(size_t count, size_t leading, int sFunctions, bool sharp = false)
{
    SplatAsset asset = makeAsset(count, sFunctions, 4, sharp);
    for (Channel& c : asset.channels)
        if (c.name == "s") c.leading = leading, c.values.resize(leading * c.components);
    return asset;
}

/// The same splats as an asset of the model sss, with all channels or only those that it must have.
inline SplatAsset makeSss(size_t count, bool all)
{
    SplatAsset asset = makeAsset(count, 0, 4, true);
    asset.model = "sss";
    const Channel visibility = *asset.find("visibility");
    const auto channel = [&](const char* name, uint32_t components, auto value) {
        Channel c{name, components, {}, {}};
        for (size_t i = 0; i < count * components; ++i) c.values.push_back(value(i));
        return c;
    };
    const auto share = [](size_t i) { return float(i * 37 % 65) / 64.0f; };
    asset.channels = {channel("baseColor", 3, share), channel("material", all ? 3 : 2, share),
                      channel("normal", 3, [](size_t i) { return i % 3 == 0 ? 0.6f : i % 3 == 1 ? 0.0f : -0.8f; })};
    if (!all) return asset;
    Channel network{"network", uint32_t(kSssNetworkFloats), {}, {}, true};
    for (size_t i = 0; i < kSssWeights; ++i) network.values.push_back(float(int(i * 37 % 129) - 64) / 256.0f); // so small that no output saturates
    network.values.insert(network.values.end(), {0, 0, 0, 2});                                                // frame
    Channel codeWeights{"codeWeights", kSssHidden1 * kSssCodeInputs, {}, {}, true};
    for (uint32_t i = 0; i < codeWeights.components; ++i) codeWeights.values.push_back(share(i));
    for (const Channel& c : {visibility, channel("code", kSssCodeInputs, share), codeWeights, network}) asset.channels.push_back(c);
    return asset;
}

/// Bit-exact, so that -0 and 0 differ.
template <class T> bool sameBits(const std::vector<T>& a, const std::vector<T>& b)
{
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

inline bool identical(const SplatAsset& a, const SplatAsset& b)
{
    bool same = a.model == b.model && a.bakedWith == b.bakedWith && a.lowPassVariance == b.lowPassVariance &&
                a.yUpFromAsset == b.yUpFromAsset && a.frame == b.frame && a.cloud.count == b.cloud.count &&
                sameBits(a.cloud.positions, b.cloud.positions) && sameBits(a.cloud.rotations, b.cloud.rotations) &&
                sameBits(a.cloud.scales, b.cloud.scales) && sameBits(a.cloud.opacities, b.cloud.opacities) &&
                a.neutral.shFunctions == b.neutral.shFunctions && sameBits(a.neutral.sh, b.neutral.sh) &&
                a.channels.size() == b.channels.size();
    for (size_t i = 0; same && i < a.channels.size(); ++i)
        same = a.channels[i].name == b.channels[i].name && a.channels[i].components == b.channels[i].components && a.channels[i].perAsset == b.channels[i].perAsset && a.channels[i].leading == b.channels[i].leading &&
               sameBits(a.channels[i].values, b.channels[i].values) && sameBits(a.channels[i].bytes, b.channels[i].bytes);
    return same;
}

/// The two chunks of a .glb, to be edited and put together again with right lengths.
struct GlbParts {
    nlohmann::json json;
    std::vector<std::byte> bin;

    explicit GlbParts(const std::vector<std::byte>& bytes)
    {
        uint32_t jsonLength;
        std::memcpy(&jsonLength, bytes.data() + 12, 4);
        const char* text = reinterpret_cast<const char*>(bytes.data() + 20);
        json = nlohmann::json::parse(text, text + jsonLength);
        bin.assign(bytes.begin() + 20 + jsonLength + 8, bytes.end());
    }

    static std::vector<std::byte> assemble(std::string text, const std::vector<std::byte>& bin)
    {
        while (text.size() % 4) text += ' ';
        std::vector<std::byte> bytes;
        const auto put = [&](const void* p, size_t n) {
            bytes.insert(bytes.end(), static_cast<const std::byte*>(p), static_cast<const std::byte*>(p) + n);
        };
        const auto putU32 = [&](size_t v) {
            const uint32_t u = uint32_t(v);
            put(&u, 4);
        };
        putU32(0x46546C67), putU32(2), putU32(12 + 8 + text.size() + 8 + bin.size());
        putU32(text.size()), putU32(0x4E4F534A), put(text.data(), text.size());
        putU32(bin.size()), putU32(0x004E4942), put(bin.data(), bin.size());
        return bytes;
    }
    std::vector<std::byte> bytes() const { return assemble(json.dump(), bin); }

    nlohmann::json& primitive() { return json["meshes"][0]["primitives"][0]; }
    nlohmann::json& splatting() { return primitive()["extensions"]["KHR_gaussian_splatting"]; }
    nlohmann::json& relight() { return splatting()["extensions"]["NACRE_gaussian_splatting_relight"]; }
};

/// An asset of profile compact, with every kind of block; codes are a function of their places.
inline QuantisedAsset makeQuantised(size_t count, bool sss)
{
    QuantisedAsset q;
    SplatAsset& frame = q.frame;
    frame.model = sss ? "sss" : "bigs";
    frame.cloud.count = count;
    frame.bakedWith = "test";
    frame.frame = {2.0, {1, 2, 3}, 0.5};
    frame.drawnVisibility = sss ? 0 : 16;
    uint32_t seed = 1;
    const auto add = [&](std::vector<BlockTarget> targets, BlockTransform transform, uint32_t numbers, uint32_t columns, size_t rows, int32_t most) {
        Block block;
        block.targets = std::move(targets), block.transform = transform, block.numbers = numbers, block.columns = columns;
        block.offset.assign(numbers, 0.25f), block.step.assign(columns, 1.0f / 256);
        const auto random = [&] { return int32_t((seed = seed * 1664525u + 1013904223u) >> 8); };
        if (columns != numbers || numbers > 8) {
            block.scale.assign(numbers, 0.5f);
            for (size_t i = 0; i < size_t(columns) * numbers; ++i) block.basis.push_back(int8_t(random() % 255 - 127));
        }
        for (size_t i = 0; i < rows * columns; ++i) block.codes.push_back(random() % (2 * most + 1) - most);
        q.blocks.push_back(std::move(block));
    };
    const auto channel = [&](const char* name, uint32_t components, bool perAsset = false) {
        Channel c;
        c.name = name, c.components = components, c.perAsset = perAsset;
        frame.channels.push_back(std::move(c));
    };
    add({{"POSITION", 0, 3}}, BlockTransform::kLinear, 3, 3, count, 70000);
    add({{"ROTATION", 0, 4}}, BlockTransform::kRotation, 3, 3, count, 20);
    add({{"SCALE", 0, 3}}, BlockTransform::kExp, 3, 3, count, 500);
    add({{"OPACITY", 0, 1}}, BlockTransform::kLinear, 1, 1, count, 100);
    if (sss) {
        channel("baseColor", 3), channel("material", 2), channel("normal", 3), channel("visibility", 256), channel("codeWeights", 1024, true), channel("code", 16);
        add({{"baseColor", 0, 3}}, BlockTransform::kLinear, 3, 2, count, 30);
        add({{"material", 0, 1}}, BlockTransform::kLinear, 1, 1, count, 100);
        add({{"material", 1, 1}}, BlockTransform::kLinear, 1, 1, count, 0);
        add({{"normal", 0, 3}}, BlockTransform::kDirection, 2, 2, count, 300);
        add({{"visibility", 0, 256}}, BlockTransform::kLinear, 256, 4, count, 127);
        add({{"codeWeights", 0, 1024}}, BlockTransform::kLinear, 1, 1, 1024, 90);
        add({{"code", 0, 16}}, BlockTransform::kLinear, 16, 5, count, 127);
        return q;
    }
    channel("tDir", 25), channel("tInd", 75), channel("rho", 3), channel("lobe", 7);
    add({{"tDir", 0, 25}, {"tInd", 0, 75}}, BlockTransform::kLinear, 100, 6, count, 127);
    add({{"rho", 0, 3}}, BlockTransform::kLinear, 3, 3, count, 60);
    add({{"lobe", 0, 3}}, BlockTransform::kDirection, 2, 2, count, 300);
    add({{"lobe", 3, 1}}, BlockTransform::kExp, 1, 1, count, 900);
    add({{"lobe", 4, 3}}, BlockTransform::kLinear, 3, 3, count, 50);
    return q;
}

} // namespace nacre::test
