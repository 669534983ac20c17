// Less of an asset through the API: what a host asks for is what reduceDetail makes, presets are found, and nonsense is refused with a message.
#include "detail_fixtures.h"
#include "runtime_fixture.h"

#include "appearance/detail.h"

#include <cstddef>

using namespace nacre;
using namespace nacre::test;

namespace {

const std::vector<Light> kLights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f}), directionalLight({-0.3f, 0.4f, 0.9f}, {0.3f, 0.6f, 0.9f})};
const Camera kCamera = offCentre();

NacreDetail wanted(float splats = 0, uint32_t leaveOut = 0, uint32_t functions = 0, uint32_t maps = 0, const char* preset = nullptr)
{
    return {sizeof(NacreDetail), splats, leaveOut, functions, maps, preset};
}

SplatAsset reduced(SplatAsset asset, const Detail& detail)
{
    const Status s = reduceDetail(asset, detail);
    REQUIRE_MESSAGE(bool(s), (s ? "" : s.error().message));
    return asset;
}

SplatAsset bigsAsset() { return withOrder(withSharp(randomAsset(400, 4, 5), kAllSharp, 6)); }

struct DetailHost : Host {
    NacreResult tryLoad(std::span<const std::byte> bytes, const NacreDetail* detail)
    {
        unload(), messages.clear();
        gl->makeCurrent();
        const NacreResult result = nacreAssetCreateDetail(context, bytes.data(), bytes.size(), detail, &asset);
        if (result == NACRE_OK) instance = place(asset);
        return result;
    }
    Image drawn(std::span<const std::byte> bytes, const NacreDetail& detail)
    {
        REQUIRE_MESSAGE(tryLoad(bytes, &detail) == NACRE_OK, lastMessage());
        return draw(kCamera, kLights);
    }
    Image drawnWhole(const SplatAsset& source)
    {
        load(source);
        return draw(kCamera, kLights);
    }
};

} // namespace

TEST_CASE("an asset loaded with less detail shows what a file of that detail shows, pixel for pixel")
{
    if (!haveGl()) return;
    DetailHost host;
    for (const bool sss : {false, true}) {
        const SplatAsset asset = sss ? withOrder(randomSss(400, kAllSss, 5)) : bigsAsset();
        const auto bytes = *encodeAsset(asset);
        const Image whole = host.drawnWhole(asset);
        REQUIRE(largest(whole) > 0.1f);
        CHECK(host.drawn(bytes, wanted()).rgba == whole.rgba);
        CHECK(host.drawn(bytes, wanted(1, 0, sss ? 9 : 25, 32)).rgba == whole.rgba);
        for (const Detail& d : {Detail{0.5f}, Detail{0.1f}, Detail{1, kPartVisibility}, Detail{1, kPartLobe | kPartForward}, Detail{1, kPartIndirect}, Detail{1, kPartScatter},
                                Detail{1, kPartNetwork}, Detail{1, 0, 4}, Detail{1, 0, 0, 16}, Detail{0.3f, kPartVisibility | kPartScatter, 9, 16}, Detail{1e-9f, kAllDetailParts, 1, 16}}) {
            CAPTURE(detailText(d));
            const Image less = host.drawn(bytes, wanted(d.splats, d.leaveOut, d.transportFunctions, d.visibilitySize));
            CHECK(less.rgba == host.drawnWhole(reduced(asset, d)).rgba);
            CHECK(allFinite(less));
        }
        CHECK(host.drawn(bytes, wanted(0, sss ? NACRE_WITHOUT_NETWORK : NACRE_WITHOUT_INDIRECT)).rgba != whole.rgba);
        CHECK(host.drawn(bytes, wanted(0.5f)).rgba != whole.rgba);
    }
}

TEST_CASE("fewer functions of transport draw what zeros in their place draw, and what the reference makes of these")
{
    if (!haveGl()) return;
    DetailHost host;
    const SplatAsset asset = randomAsset(300, 4, 5);
    for (const uint32_t functions : {1, 4, 9, 16}) {
        SplatAsset zeros = asset;
        for (Channel& c : zeros.channels)
            for (size_t k = 0; k < c.values.size() && c.name.starts_with("t"); ++k)
                if (k % c.components / (c.components / 25) >= functions) c.values[k] = 0;
        const Image less = host.drawn(*encodeAsset(asset), wanted(0, 0, functions));
        CHECK(less.rgba == host.drawnWhole(zeros).rgba);
        CHECK(psnr(less, referenceImage(zeros, kCamera, kLights)) > 80);
        zeros.channels[1].values[3 * 24] = 0x1p-20f; // the last function of one splat: all are there, and hardly anything else changes
        CHECK(psnr(host.drawnWhole(zeros), less) > 80);
    }
}

TEST_CASE("parts that are left out take no light from others: the reference without them shows the same")
{
    if (!haveGl()) return;
    DetailHost host;
    const SplatAsset asset = bigsAsset();
    for (uint32_t parts = 0; parts <= kAllDetailParts; parts += 3)
        CHECK(psnr(host.drawn(*encodeAsset(asset), wanted(0, parts)), referenceImage(reduced(asset, {1, parts}), kCamera, kLights)) > 75);
}

TEST_CASE("presets load by name, and the host is told what they advise")
{
    if (!haveGl()) return;
    DetailHost host;
    SplatAsset asset = bigsAsset();
    host.load(asset);
    NacreAssetInfo info = host.info();
    CHECK(info.splatCount == 400);
    CHECK(info.bakedSplatCount == 400);
    CHECK(std::string(info.preset).empty());
    CHECK(info.resolutionScale == 1.0f);
    CHECK(info.environmentDirections == 0);

    asset.presets = somePresets();
    asset.presets[2].name = std::string(31, 'x');
    const auto bytes = *encodeAsset(asset);
    const NacreDetail fast = wanted(0, 0, 0, 0, "fast"), longest = wanted(0, 0, 0, 0, asset.presets[2].name.c_str());
    const Image drawn = host.drawn(bytes, fast);
    info = host.info();
    CHECK(std::string(info.preset) == "fast");
    CHECK(info.splatCount == 140);
    CHECK(info.bakedSplatCount == 400);
    CHECK(info.resolutionScale == 0.75f);
    CHECK(info.environmentDirections == 16);
    CHECK(host.drawn(bytes, wanted(0.35f, NACRE_WITHOUT_LOBE | NACRE_WITHOUT_INDIRECT, 9, 16)).rgba == drawn.rgba);
    CHECK(std::string(host.info().preset).empty());
    CHECK(host.info().resolutionScale == 1.0f);
    REQUIRE(host.tryLoad(bytes, &longest) == NACRE_OK);
    CHECK(std::string(host.info().preset) == asset.presets[2].name);
    const NacreDetail none = wanted(0.5f, 0, 0, 0, ""); // as NacreAssetInfo says none
    REQUIRE(host.tryLoad(bytes, &none) == NACRE_OK);
    CHECK(host.info().splatCount == 200);

    NacreAssetInfo older{};
    older.structSize = offsetof(NacreAssetInfo, bakedSplatCount), older.bakedSplatCount = 12345;
    REQUIRE(nacreAssetGetInfo(host.asset, &older) == NACRE_OK);
    CHECK(older.splatCount == 200);
    CHECK(older.bakedSplatCount == 12345);
}

TEST_CASE("what cannot be loaded with less detail is refused with a message, and nothing is made")
{
    if (!haveGl()) return;
    DetailHost host;
    SplatAsset asset = bigsAsset();
    const auto plain = *encodeAsset(asset);
    asset.presets = somePresets();
    const auto bytes = *encodeAsset(asset), unordered = *encodeAsset(randomAsset(20, 0, 1));
    const auto refused = [&](std::span<const std::byte> file, const NacreDetail& detail) {
        CHECK(host.tryLoad(file, &detail) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(host.asset.id == 0);
        CHECK(host.messages.size() == 1);
        CHECK(host.contextInfo().assets == 0);
        NacreAsset decoded{~0ull};
        CHECK(nacreAssetDecodeDetail(host.context, file.data(), file.size(), &detail, &decoded) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(decoded.id == 0);
        return host.lastMessage();
    };
    const auto says = [](const std::string& message, const char* text) { CHECK_MESSAGE(message.find(text) != std::string::npos, message); };
    for (const float share : {-0.5f, 1.5f, NAN, INFINITY}) says(refused(bytes, wanted(share)), "share of splats");
    says(refused(bytes, wanted(0, 64)), "64");
    says(refused(bytes, wanted(0, 0, 5)), "transport functions");
    says(refused(bytes, wanted(0, 0, 0, 8)), "16 or 32");
    says(refused(bytes, wanted(0, 0, 0, 0, "slow")), "'slow'; there are: fast, half, plain, all");
    says(refused(bytes, wanted(0, 0, 0, 0, "\x1b[31m\n")), "'?[31m'");
    says(refused(plain, wanted(0, 0, 0, 0, "fast")), "nor any other");
    says(refused(bytes, wanted(0.5f, 0, 0, 0, "fast")), "preset");
    says(refused(bytes, wanted(0, 0, 9, 0, "nowhere")), "preset");
    says(refused(unordered, wanted(0.5f)), "nacre pack");
    for (const size_t size : {size_t(0), size_t(3), sizeof(NacreDetail) + 8}) {
        NacreDetail d = wanted();
        d.structSize = size;
        says(refused(bytes, d), "NacreDetail.structSize");
    }
    CHECK(host.tryLoad(bytes, nullptr) == NACRE_OK);
}

TEST_CASE("a host of an older header, which knows fewer fields, gets what it asks for")
{
    if (!haveGl()) return;
    DetailHost host;
    const auto bytes = *encodeAsset(bigsAsset());
    NacreDetail d = wanted(0.5f, ~0u, ~0u, ~0u, "nowhere");
    d.structSize = offsetof(NacreDetail, leaveOut);
    REQUIRE(host.tryLoad(bytes, &d) == NACRE_OK);
    CHECK(host.info().splatCount == 200);
    d.structSize = offsetof(NacreDetail, splats);
    REQUIRE(host.tryLoad(bytes, &d) == NACRE_OK);
    CHECK(host.info().splatCount == 400);
}

TEST_CASE("decoded on its own and uploaded in slices, less detail is the same")
{
    if (!haveGl()) return;
    DetailHost host;
    const auto bytes = *encodeAsset(bigsAsset());
    const NacreDetail d = wanted(0.4f, NACRE_WITHOUT_SCATTER, 9);
    const Image expected = host.drawn(bytes, d);
    host.unload();
    REQUIRE(nacreAssetDecodeDetail(host.context, bytes.data(), bytes.size(), &d, &host.asset) == NACRE_OK);
    for (uint64_t left = 1; left > 0;) REQUIRE(nacreAssetUploadStep(host.asset, 1000, &left) == NACRE_OK);
    host.instance = host.place(host.asset);
    CHECK(host.draw(kCamera, kLights).rgba == expected.rgba);
}

TEST_CASE("levels of detail of one file are assets side by side")
{
    if (!haveGl()) return;
    DetailHost host;
    const auto bytes = *encodeAsset(bigsAsset());
    const NacreDetail d = wanted(0.1f);
    const Image far = host.drawn(bytes, d), near = host.drawn(bytes, wanted());
    const NacreInstance whole = host.instance;
    NacreAsset coarse{};
    REQUIRE(nacreAssetCreateDetail(host.context, bytes.data(), bytes.size(), &d, &coarse) == NACRE_OK);
    const NacreInstance less = host.place(coarse);
    REQUIRE(nacreInstanceSetHidden(less, 1) == NACRE_OK);
    CHECK(host.draw(kCamera).rgba == near.rgba);
    REQUIRE(nacreInstanceSetHidden(less, 0) == NACRE_OK);
    REQUIRE(nacreInstanceSetHidden(whole, 1) == NACRE_OK);
    CHECK(host.draw(kCamera).rgba == far.rgba);
}
