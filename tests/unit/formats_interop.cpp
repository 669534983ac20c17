// Profile interop: what other tools do to attributes leaves relighting data with their splats, or is noticed.
#include "formats_fixtures.h"

#include "appearance/coded_channels.h"
#include "asset/asset_decode.h"
#include "asset/look_color.h"
#include "base/base64.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

using namespace nacre;
using test::GlbParts;

namespace {

/// A file with every attribute's rows picked as `order` says, each tight in a buffer of its own making: a tool that knows glTF and nothing of us.
std::vector<std::byte> rearranged(const std::vector<std::byte>& file, const std::vector<size_t>& order)
{
    GlbParts parts(file);
    nlohmann::json& json = parts.json;
    std::vector<std::byte> bin;
    nlohmann::json views = nlohmann::json::array(), accessors = nlohmann::json::array();
    auto& attributes = json["meshes"][0]["primitives"][0]["attributes"];
    std::vector<std::string> names;
    for (const auto& [name, index] : attributes.items()) names.push_back(name);
    std::reverse(names.begin(), names.end()); // indices change as well
    for (const std::string& name : names) {
        nlohmann::json accessor = json["accessors"][attributes[name].get<size_t>()];
        const nlohmann::json& view = json["bufferViews"][accessor["bufferView"].get<size_t>()];
        const std::string type = accessor["type"];
        const size_t row = (type == "SCALAR" ? 1 : size_t(type[3] - '0')) * (accessor["componentType"] == 5126 ? 4 : 1);
        const size_t stride = view.value("byteStride", row), start = view.value("byteOffset", size_t(0)) + accessor.value("byteOffset", size_t(0));
        const size_t offset = bin.size();
        for (const size_t i : order) bin.insert(bin.end(), parts.bin.begin() + ptrdiff_t(start + i * stride), parts.bin.begin() + ptrdiff_t(start + i * stride + row));
        accessor["bufferView"] = views.size(), accessor["count"] = order.size();
        accessor.erase("byteOffset");
        attributes[name] = accessors.size();
        accessors.push_back(accessor);
        views.push_back({{"buffer", 0}, {"byteOffset", offset}, {"byteLength", bin.size() - offset}});
    }
    json["accessors"] = accessors, json["bufferViews"] = views, json["buffers"][0]["byteLength"] = bin.size();
    return GlbParts::assemble(json.dump(), bin);
}

SplatAsset coded(size_t count)
{
    SplatAsset asset = test::makeAsset(count, 4, 16, true);
    CodedChannels group{{"tDir", "tInd"}, 100, 6, std::vector<float>(100, 0.25f), {}, {}};
    for (int i = 0; i < 600; ++i) group.basis.push_back(float(i % 31 - 15) / 64);
    for (size_t i = 0; i < 6 * count; ++i) group.values.push_back(int8_t(int(i * 37 % 256) - 128));
    for (Channel& c : asset.channels)
        if (c.name == "tDir" || c.name == "tInd") c.values.clear();
    asset.coded.push_back(std::move(group));
    return asset;
}

std::vector<SplatAsset> assets() { return {test::makeAsset(40, 4, 16, true), test::makeLeading(40, 7, 4, true), test::makeSss(40, true), coded(40)}; }

/// Rows of `asset` in another order, as a reader of profile interop has them.
SplatAsset picked(const SplatAsset& asset, const std::vector<size_t>& order)
{
    SplatAsset out = asset;
    expandChannels(out);
    const SplatAsset full = out;
    out.cloud = {};
    out.cloud.count = order.size();
    out.drawnVisibility = full.find("visibility") ? 16 : 0;
    std::erase_if(out.channels, [](const Channel& c) { return c.name == "visibility"; });
    for (const size_t i : order) {
        out.cloud.positions.push_back(full.cloud.positions[i]), out.cloud.rotations.push_back(full.cloud.rotations[i]);
        out.cloud.scales.push_back(full.cloud.scales[i]), out.cloud.opacities.push_back(full.cloud.opacities[i]);
    }
    for (Channel& channel : out.channels) {
        if (channel.perAsset) continue;
        const Channel all = channel;
        channel.leading = 0, channel.values.clear();
        for (const size_t i : order)
            for (size_t k = 0; k < all.components; ++k) channel.values.push_back(i * all.components + k < all.values.size() ? all.values[i * all.components + k] : 0.0f);
    }
    return out;
}

std::vector<size_t> everyThird(size_t count)
{
    std::vector<size_t> order;
    for (size_t i = count; i-- > 0;)
        if (i % 3 != 1) order.push_back(i);
    return order;
}

} // namespace

TEST_CASE("interop: reordered, cropped, deinterleaved and renumbered files keep every splat's relighting data")
{
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        const auto file = encodeInterop(asset);
        REQUIRE(bool(file));
        const nlohmann::json json = GlbParts(*file).json;
        CHECK_FALSE(json.contains("extensionsRequired"));
        std::vector<size_t> same;
        for (size_t i = 0; i < asset.cloud.count; ++i) same.push_back(i);
        for (const std::vector<size_t>& order : {same, everyThird(asset.cloud.count)}) {
            auto read = decodeAsset(rearranged(*file, order));
            REQUIRE(bool(read));
            CHECK(read->profile == "interop");
            CHECK(read->coded.size() == asset.coded.size());
            expandChannels(*read);
            SplatAsset expected = picked(asset, order);
            CHECK(read->drawnVisibility == expected.drawnVisibility);
            read->neutral = expected.neutral = {};
            CHECK(test::identical(*read, expected));
        }
    }
}

TEST_CASE("interop: a tool may interleave all attributes, however far apart rows come to be")
{
    const SplatAsset asset = test::makeAsset(40, 4, 16, true);
    GlbParts parts(*encodeInterop(asset));
    size_t stride = 0;
    for (nlohmann::json& accessor : parts.json["accessors"]) {
        const std::string type = accessor["type"];
        stride += (type == "SCALAR" ? 1 : size_t(type[3] - '0')) * (accessor["componentType"] == 5126 ? 4 : 1);
    }
    REQUIRE(stride > 252);
    std::vector<std::byte> bin(40 * stride);
    size_t offset = 0;
    for (nlohmann::json& accessor : parts.json["accessors"]) {
        const nlohmann::json& view = parts.json["bufferViews"][accessor["bufferView"].get<size_t>()];
        const std::string type = accessor["type"];
        const size_t row = (type == "SCALAR" ? 1 : size_t(type[3] - '0')) * (accessor["componentType"] == 5126 ? 4 : 1);
        const size_t start = view.value("byteOffset", size_t(0)) + accessor.value("byteOffset", size_t(0)), apart = view.value("byteStride", row);
        for (size_t i = 0; i < 40; ++i) std::copy_n(parts.bin.begin() + ptrdiff_t(start + i * apart), row, bin.begin() + ptrdiff_t(i * stride + offset));
        accessor["bufferView"] = 0, accessor["byteOffset"] = offset;
        offset += row;
    }
    parts.json["bufferViews"] = {{{"buffer", 0}, {"byteLength", bin.size()}, {"byteStride", stride}}};
    parts.json["buffers"][0]["byteLength"] = bin.size();
    const auto read = decodeAsset(GlbParts::assemble(parts.json.dump(), bin));
    REQUIRE(bool(read));
    CHECK(read->find("tInd")->values == asset.find("tInd")->values);
}

TEST_CASE("interop: more codes than numbers, and maps that are codes, which are left out")
{
    SplatAsset asset = coded(40);
    asset.coded[0].codes = 194;
    asset.coded[0].basis.assign(194 * 100, 0.125f);
    asset.coded[0].values.assign(194 * 40, int8_t(-7));
    auto maps = std::ranges::find(asset.channels, "visibility", &Channel::name);
    REQUIRE(maps != asset.channels.end());
    maps->values.clear(), maps->bytes.clear();
    const uint32_t texels = maps->components;
    asset.coded.push_back({{"visibility"}, texels, 1, std::vector<float>(texels, 0.5f), std::vector<float>(texels, 0.001f), std::vector<int8_t>(40, 1)});
    const auto file = encodeInterop(asset);
    REQUIRE(bool(file));
    auto read = decodeAsset(*file);
    REQUIRE(bool(read));
    CHECK(read->drawnVisibility * read->drawnVisibility == int(texels));
    CHECK(read->coded.size() == 1);
    expandChannels(*read), expandChannels(asset);
    CHECK(read->find("tInd")->values == asset.find("tInd")->values);
}

TEST_CASE("interop: moved splats, splats of another asset and lost data are noticed")
{
    const std::vector<std::byte> file = *encodeInterop(test::makeAsset(40, 4, 16, true));
    for (const char* name : {"_NACRE_STAMP", "_NACRE_RHO_0", "_NACRE_TIND_18"}) {
        GlbParts parts(file);
        parts.json["meshes"][0]["primitives"][0]["attributes"].erase(name);
        CHECK_FALSE(bool(decodeAsset(GlbParts::assemble(parts.json.dump(), parts.bin))));
    }
    GlbParts moved(file);
    const auto view = moved.json["accessors"][moved.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].get<size_t>()]["bufferView"].get<size_t>();
    moved.bin[moved.json["bufferViews"][view].value("byteOffset", size_t(0))] ^= std::byte(1);
    CHECK_FALSE(bool(decodeAsset(GlbParts::assemble(moved.json.dump(), moved.bin))));

    GlbParts mixed(*encodeInterop(coded(40)));
    auto& offset = mixed.json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["extensions"]["NACRE_gaussian_splatting_relight"]["coded"][0]["offset"];
    const std::vector<float> other(100, 0.5f);
    offset = toBase64(other.data(), 400);
    CHECK_FALSE(bool(decodeAsset(GlbParts::assemble(mixed.json.dump(), mixed.bin))));
}

TEST_CASE("interop: no prefix and no flipped byte of a file is more than an error")
{
    const std::vector<std::byte> file = *encodeInterop(coded(3));
    for (size_t n = 0; n < file.size(); n += 7) (void)decodeAsset(std::span(file).first(n));
    for (size_t n = 0; n < file.size(); ++n) {
        std::vector<std::byte> damaged = file;
        damaged[n] ^= std::byte(1 << n % 8);
        (void)decodeAsset(damaged);
    }
}

TEST_CASE("interop: the look in sRGB has the colours of the linear one")
{
    NeutralLook flat{1, {{0.3f, -1.2f, 1.0f}}};
    const NeutralLook back = toLinear(toSrgb(flat));
    for (int c = 0; c < 3; ++c) CHECK(std::abs(back.sh[0][c] - flat.sh[0][c]) < 1e-5f);
    NeutralLook soft{16, std::vector<glm::vec3>(16, glm::vec3(0.01f, -0.02f, 0.015f))}; // far from black: the curve is smooth there
    const NeutralLook again = toLinear(toSrgb(soft));
    for (size_t i = 0; i < 16; ++i)
        for (int c = 0; c < 3; ++c) CHECK(std::abs(again.sh[i][c] - soft.sh[i][c]) < 2e-3f);
}

TEST_CASE("base64 both ways, and nothing else")
{
    std::vector<unsigned char> back;
    for (const std::string text : {"", "f", "fo", "foo", "foob"}) {
        CHECK(fromBase64(toBase64(text.data(), text.size()), back));
        CHECK(std::string(back.begin(), back.end()) == text);
    }
    CHECK(toBase64("foob", 4) == "Zm9vYg==");
    for (const char* wrong : {"Zg", "Zg=", "====Zg==", "Z===", "Zm9v\n", "Zm9-"}) CHECK_FALSE(fromBase64(wrong, back));
}
