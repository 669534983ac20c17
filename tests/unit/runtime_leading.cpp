// Rows of zeros left out of an asset: a smaller file and fewer fetches, the same picture.
#include "runtime_fixture.h"

#include "appearance/model_table.h"
#include "pack/leading_rows.h"

using namespace nacre;
using namespace nacre::test;

namespace {

/// 300 splats, of which those that `scatters` says have an s; one row of zeros less than the grid is wide, one more, and so on.
template <class F> SplatAsset sparse(F scatters)
{
    SplatAsset asset = withSharp(randomAsset(300, 9, 5), kAllSharp, 6);
    for (Channel& c : asset.channels)
        for (size_t i = 0; i < 300 && c.name == "s"; ++i)
            if (!scatters(i)) std::fill_n(&c.values[i * c.components], c.components, 0.0f);
    return asset;
}

const std::vector<Light> kLights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f}), directionalLight({-0.3f, 0.4f, 0.9f}, {0.3f, 0.6f, 0.9f})};
const Camera kCamera = offCentre();

} // namespace

TEST_CASE("an asset without the zero rows of s shows what it showed, by the reference and by GL")
{
    const bool gl = haveGl();
    Host host;
    for (const size_t every : {2, 3, 150, 299}) {
        CAPTURE(every);
        const SplatAsset asset = sparse([&](size_t i) { return i % every == 1; });
        SplatAsset less = asset;
        leaveOutZeroRows(less);
        REQUIRE(validate(less));
        const size_t rows = less.find("s")->leading;
        CHECK(rows == (300 - 2) / every + 1);
        CHECK(less.find("s")->values.size() == rows * less.find("s")->components);
        const Image expected = referenceImage(asset, kCamera, kLights);
        CHECK(largest(expected) > 0.1f);
        CHECK(largestDifference(referenceImage(less, kCamera, kLights), expected) < 1e-6f);
        if (!gl) continue;
        host.load(asset);
        const Image drawn = host.draw(kCamera, kLights);
        host.load(less);
        CHECK(largestDifference(host.draw(kCamera, kLights), drawn) < 1e-6f);
        CHECK(psnr(drawn, expected) > 80);
    }
}

TEST_CASE("s of all splats stays as it is, s of none is left out, and what is done is not done again")
{
    const SplatAsset all = sparse([](size_t) { return true; });
    SplatAsset asset = all;
    leaveOutZeroRows(asset);
    CHECK(asset.find("s")->leading == 0);
    CHECK(asset.cloud.positions == all.cloud.positions);
    CHECK(asset.find("s")->values == all.find("s")->values);
    asset = sparse([](size_t) { return false; });
    leaveOutZeroRows(asset);
    CHECK(asset.find("s") == nullptr);
    asset = sparse([](size_t i) { return i > 200; });
    leaveOutZeroRows(asset);
    const SplatAsset once = asset;
    leaveOutZeroRows(asset);
    CHECK(asset.find("s")->leading == 99);
    CHECK(asset.find("s")->values == once.find("s")->values);
    CHECK(asset.cloud.positions == once.cloud.positions);
}
