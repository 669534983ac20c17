// Bakes that start from splats: from an asset, from a .ply, from too many, from the wrong place.
#include "asset/asset_io.h"
#include "base/file.h"
#include "dataset/loader.h"
#include "interchange/ply.h"
#include "interchange/rotate_splats.h"
#include "pack/lit_snapshot.h"
#include "train/bake.h"
#include "train/checkpoint.h"

#include <doctest/doctest.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <unistd.h>

using namespace nacre;

namespace {

BakeOptions briefly(int iterations)
{
    BakeOptions options;
    options.iterations = iterations, options.maxSplats = 400, options.sFunctions = 0;
    options.track = BakeOptions::Track::kAtEnd;
    return options;
}

double heldOut(const BakeResult& result) { return result.history.back().psnrMaskedTest; }

/// What an earlier bake left, made once.
struct Earlier {
    Result<OlatDataset> dataset = loadDataset(NACRE_SOURCE_DIR "/samples/data/bunny_wax_tiny");
    std::string folder = (std::filesystem::temp_directory_path() / ("nacre_init_" + std::to_string(::getpid()))).string();
    std::string glb = folder + "/a.glb", ply = folder + "/a.ply";
    Earlier()
    {
        std::filesystem::create_directory(folder);
        REQUIRE(dataset);
        const auto earlier = bake(*dataset, briefly(150), nullptr, nullptr);
        REQUIRE(earlier);
        REQUIRE(writeAsset(earlier->asset, glb));
        std::vector<Light> lights;
        for (const OlatImage& image : dataset->find("train")->images) lights.push_back(image.light);
        auto snapshot = litSnapshot(earlier->asset, lights, {true, 1.0 / double(lights.size())});
        REQUIRE(snapshot);
        placeInDataset(earlier->asset.frame, snapshot->cloud);
        REQUIRE(writeFileAtomically(ply, encodePly(*snapshot)));
    }
    ~Earlier() { std::filesystem::remove_all(folder); }
};
const Earlier& earlier()
{
    static const Earlier made;
    return made;
}

std::shared_ptr<const InitialSplats> readInit(const std::string& path)
{
    auto init = readInitialSplats(path);
    REQUIRE_MESSAGE(init, (init ? "" : init.error().message));
    return std::make_shared<const InitialSplats>(std::move(*init));
}

} // namespace

TEST_CASE("a bake that starts from the splats of an earlier one, as asset or .ply, is ahead of one from the hull")
{
    BakeOptions options = briefly(60);
    const auto fromHull = bake(*earlier().dataset, options, nullptr, nullptr);
    REQUIRE(fromHull);
    for (const std::string& path : {earlier().glb, earlier().ply}) {
        options.init = readInit(path);
        const auto fromSplats = bake(*earlier().dataset, options, nullptr, nullptr);
        REQUIRE_MESSAGE(fromSplats, (fromSplats ? "" : fromSplats.error().message));
        CHECK(heldOut(*fromSplats) > heldOut(*fromHull) + 0.3);
    }
}

TEST_CASE("of too many splats to start from those that cover most are taken, and the user is told")
{
    BakeOptions options = briefly(1);
    options.init = readInit(earlier().glb), options.maxSplats = 50;
    const auto result = bake(*earlier().dataset, options, nullptr, nullptr);
    REQUIRE(result);
    CHECK(result->asset.cloud.count <= 50);
    REQUIRE(!result->warnings.empty());
    CHECK(result->warnings.back().find("--init: starting from 50 of") != std::string::npos);
}

TEST_CASE("splats to start from that lie elsewhere are refused")
{
    InitialSplats far = *readInit(earlier().ply);
    for (glm::vec3& p : far.cloud.positions) p += glm::vec3(100, 0, 0);
    BakeOptions options = briefly(5);
    options.init = std::make_shared<const InitialSplats>(far);
    const auto result = bake(*earlier().dataset, options, nullptr, nullptr);
    REQUIRE(!result);
    CHECK(result.error().code == ErrorCode::kBadInput);
    CHECK(result.error().message.find("same axes and units") != std::string::npos);
}

TEST_CASE("an interrupted bake that started from splats ends as if it had not been, and does not go on from other ones")
{
    BakeOptions options = briefly(30);
    options.track = BakeOptions::Track::kNever;
    options.init = readInit(earlier().glb);
    const auto whole = bake(*earlier().dataset, options, nullptr, nullptr);
    REQUIRE(whole);
    options.checkpointPath = earlier().folder + "/a.ckpt";
    std::atomic<bool> stop = false;
    const auto first = bake(*earlier().dataset, options, [&](const BakeProgress& p) { stop = p.stage == "training"; }, &stop);
    REQUIRE(!first);
    REQUIRE(first.error().code == ErrorCode::kCancelled);
    options.resume = true;
    BakeOptions other = options;
    other.init = readInit(earlier().ply);
    CHECK(!bake(*earlier().dataset, other, nullptr, nullptr));
    const auto rest = bake(*earlier().dataset, options, nullptr, nullptr);
    REQUIRE_MESSAGE(rest, (rest ? "" : rest.error().message));
    CHECK(rest->asset.cloud.positions == whole->asset.cloud.positions);
    CHECK(rest->asset.cloud.opacities == whole->asset.cloud.opacities);
}

TEST_CASE("an asset that was baked in another frame lies where it lay in the dataset")
{
    InitialSplats splats;
    splats.cloud.count = 1;
    splats.cloud.positions = {{0.5f, -0.25f, 1}}, splats.cloud.scales = {{0.1f, 0.2f, 0.3f}}, splats.cloud.rotations = {{1, 0, 0, 0}}, splats.cloud.opacities = {0.5f};
    splats.colors = {{0.2f, 0.2f, 0.2f}};
    splats.frame = {20, {1000, 2000, 3000}, 1};
    const AssetFrame frame{10, {1005, 1990, 3010}, 1};
    const glm::dvec3 expected = frame.positionInAsset({1010, 1995, 3020});
    const auto placed = placedFor(frame, glm::vec3(expected), 1, 10, splats);
    REQUIRE(placed);
    CHECK(glm::length(glm::dvec3(placed->cloud.positions[0]) - expected) < 1e-5);
    CHECK(placed->cloud.scales[0].y == doctest::Approx(0.4f));
    CHECK(placed->colors[0].g == doctest::Approx(1.0f));
}
