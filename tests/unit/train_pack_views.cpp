// What a packed asset is compared under, and how much each splat shows there.
#include "formats_fixtures.h"

#include "pack/pack_views.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <cmath>

using namespace nacre;
using namespace nacre::test;

namespace {

/// Grey splats that scatter alike in all directions.
SplatAsset makeDots(const std::vector<glm::vec3>& positions, float size, float opacity, float grey = 0.5f)
{
    SplatAsset asset;
    asset.model = "bigs";
    asset.cloud.count = positions.size();
    asset.cloud.positions = positions;
    asset.cloud.rotations.assign(positions.size(), glm::quat(1, 0, 0, 0));
    asset.cloud.scales.assign(positions.size(), glm::vec3(size));
    asset.cloud.opacities.assign(positions.size(), opacity);
    asset.channels = {{"tDir", 25, std::vector<float>(25 * positions.size())}, {"tInd", 75, std::vector<float>(75 * positions.size())},
                      {"rho", 3, std::vector<float>(3 * positions.size(), grey)}};
    for (size_t i = 0; i < positions.size(); ++i) asset.channels[0].values[25 * i] = 1;
    return asset;
}

PackView lookDown(double size)
{
    PackView view;
    view.camera.width = view.camera.height = 40;
    view.camera.fx = view.camera.fy = size;
    view.camera.cx = view.camera.cy = 20;
    view.camera.worldFromCamera[3] = glm::dvec4(0, 0, 4, 1);
    view.light.type = LightType::kDirectional;
    view.light.intensity = glm::vec3(1);
    return view;
}

SplatAsset makeBall(size_t count)
{
    std::vector<glm::vec3> positions;
    for (size_t i = 0; i < count; ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(count), r = std::sqrt(1 - z * z), phi = 2.39996f * float(i);
        positions.emplace_back(r * std::cos(phi), r * std::sin(phi), z);
    }
    return makeDots(positions, 0.12f, 0.9f);
}

} // namespace

TEST_CASE("the importance of a splat is that of the squares of what it covers; none if it is hidden")
{
    const PackView view = lookDown(100);
    const float faint = splatImportance(makeDots({{0, 0, 0}}, 0.05f, 0.2f), std::span(&view, 1))[0];
    const float dense = splatImportance(makeDots({{0, 0, 0}}, 0.05f, 0.8f), std::span(&view, 1))[0];
    CHECK(faint > 0);
    CHECK(dense == doctest::Approx(16 * faint).epsilon(0.01)); // all but the rim, where too little is not drawn

    SplatAsset wall = makeDots({{0, 0, 1.4f}, {0, 0, 1.2f}, {0, 0, 1.0f}, {0, 0, 0}, {0, 0, 5}}, 0.02f, 1.0f);
    for (size_t i = 0; i < 3; ++i) wall.cloud.scales[i] = {3, 3, 0.01f};
    const std::vector<float> importance = splatImportance(wall, std::span(&view, 1));
    CHECK(importance[0] > 100);
    CHECK(importance[3] == 0); // behind the wall
    CHECK(importance[4] == 0); // behind the camera
}

TEST_CASE("views around see every side, and neither they nor importance depend on the number of threads")
{
    const SplatAsset ball = makeBall(400);
    std::vector<float> first;
    double firstError = 0;
    for (const size_t threads : {1, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        auto views = viewsAround(ball, 12);
        REQUIRE(views);
        const std::vector<float> importance = splatImportance(ball, *views);
        for (const float w : importance) CHECK(w > 0);
        const auto reference = PackReference::render(ball, *views);
        REQUIRE(reference);
        CHECK(*reference->error(ball) == 0);
        const auto error = reference->error(makeDots(ball.cloud.positions, 0.12f, 0.9f, 0.45f));
        REQUIRE(error);
        CHECK(*error > 0);
        if (first.empty()) first = importance, firstError = *error;
        CHECK(importance == first);
        CHECK(*error == firstError);
    }
}

TEST_CASE("views around do not depend on where an asset lies and in which unit")
{
    SplatAsset ball = makeBall(300);
    const auto here = viewsAround(ball, 6);
    const std::vector<float> before = splatImportance(ball, *here);
    for (glm::vec3& p : ball.cloud.positions) p = 64.0f * p + glm::vec3(300, -200, 100);
    for (glm::vec3& s : ball.cloud.scales) s *= 64.0f;
    const auto there = viewsAround(ball, 6);
    REQUIRE(there);
    const std::vector<float> after = splatImportance(ball, *there);
    for (size_t i = 0; i < before.size(); ++i) CHECK(after[i] == doctest::Approx(before[i]).epsilon(0.02));
}

TEST_CASE("an asset of which nothing shows is refused")
{
    const auto views = viewsAround(makeDots({{0, 0, 0}, {1, 0, 0}}, 0.1f, 0.0f), 4);
    REQUIRE(!views);
    CHECK(views.error().code == ErrorCode::kBadInput);
}
