// Assets of profile compact: drawn as the scalar reference draws what their integers stand for.
#include "runtime_fixture.h"

#include "appearance/coded_channels.h"
#include "appearance/detail.h"
#include "appearance/splat_visibility.h"
#include "formats_fixtures.h"

using namespace nacre;
using namespace nacre::test;

namespace {

/// 200 splats of all sizes around the origin: transport over a basis, and maps that are not stored.
QuantisedAsset coded()
{
    QuantisedAsset q = makeQuantised(200, false);
    for (Block& block : q.blocks) {
        const std::string& name = block.targets[0].name;
        if (name == "POSITION") block.offset.assign(3, 0.0f), block.step.assign(3, 0.5f / 70000);
        if (name == "SCALE") block.offset.assign(3, -3.0f), block.step.assign(3, 0.5f / 500);
        if (name == "OPACITY") block.offset = {0.5f}, block.step = {0.5f / 100};
        if (name == "rho") block.step.assign(3, 0.002f);
        if (name == "tDir") {
            block.offset.assign(100, 0.02f), block.step.assign(block.columns, 1.0f / (127 * 127));
            for (size_t i = 0; i < block.codes.size(); i += 3) block.codes[i] /= 20; // splats much fainter than others
        }
    }
    return q;
}

} // namespace

TEST_CASE("an asset whose transport is coded and whose maps are drawn again matches the scalar reference, in fewer bytes of the GPU")
{
    const std::vector<Light> lights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f}), directionalLight({-0.3f, 0.4f, 0.9f}, {0.3f, 0.6f, 0.9f})};
    const auto bytes = encodeCompact(coded());
    REQUIRE_MESSAGE(bool(bytes), (bytes ? "" : bytes.error().message));
    Result<SplatAsset> asset = decodeAsset(*bytes);
    REQUIRE(asset);
    REQUIRE(asset->coded.size() == 1);
    REQUIRE(asset->drawnVisibility == 16);
    expandChannels(*asset), drawVisibility(*asset);
    if (!haveGl()) return;
    Host host(*asset); // with numbers and stored maps
    const NacreAssetInfo plain = host.info();
    const Image expected = referenceImage(*asset, offCentre(), lights), stored = host.draw(offCentre(), lights);
    CHECK(largest(expected) > 0.1f);
    CHECK(psnr(stored, expected) > 75);

    host.unload();
    host.asset = host.create(*bytes), host.instance = host.place(host.asset);
    const Image drawn = host.draw(offCentre(), lights);
    CHECK(psnr(drawn, expected) > 55); // transport is rounded to an eighth of a per cent of a splat's largest at most twice
    CHECK(host.info().gpuBytes + 200 * 90 < plain.gpuBytes);
}

TEST_CASE("a coded asset with fewer functions of transport matches the scalar reference, in fewer bytes of the GPU")
{
    if (!haveGl()) return;
    const std::vector<Light> lights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f})};
    const auto bytes = encodeCompact(coded());
    REQUIRE(bytes);
    Result<SplatAsset> asset = decodeAsset(*bytes);
    REQUIRE(asset);
    expandChannels(*asset), drawVisibility(*asset);
    Host host;
    uint64_t least = ~uint64_t(0);
    for (const uint32_t functions : {25, 16, 9, 4, 1}) {
        SplatAsset fewer = *asset;
        REQUIRE(reduceDetail(fewer, {1, 0, functions}));
        NacreDetail detail{};
        detail.structSize = sizeof detail, detail.transportFunctions = functions;
        host.unload();
        REQUIRE_MESSAGE(nacreAssetCreateDetail(host.context, bytes->data(), bytes->size(), &detail, &host.asset) == NACRE_OK, host.lastMessage());
        host.instance = host.place(host.asset);
        CHECK(psnr(host.draw(offCentre(), lights), referenceImage(fewer, offCentre(), lights)) > 55);
        CHECK(host.info().gpuBytes < least);
        least = host.info().gpuBytes;
    }
}

TEST_CASE("a coded asset uploads in slices of the budget, whole maps at hand after decoding")
{
    if (!haveGl()) return;
    const auto bytes = encodeCompact(coded());
    REQUIRE(bytes);
    Host host;
    NacreAsset asset{};
    REQUIRE(nacreAssetDecode(host.context, bytes->data(), bytes->size(), &asset) == NACRE_OK);
    uint64_t left = ~uint64_t(0), before = 0;
    int steps = 0;
    do {
        before = left;
        REQUIRE(nacreAssetUploadStep(asset, 1, &left) == NACRE_OK);
        CHECK(left < before);
        if (steps > 0) CHECK(before - left <= 1 << 16); // a piece is a slot of all splats, or so many texels of maps
    } while (++steps < 1000 && left > 0);
    CHECK(left == 0);
    CHECK(steps > 26);
    nacreAssetDestroy(asset);
}
