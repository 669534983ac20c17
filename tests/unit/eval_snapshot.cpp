// Lit snapshots: what a viewer that cannot relight shows of an asset under lights is what the asset shows under them.
#include "formats_fixtures.h"

#include "base/color.h"
#include "eval/splat_renderer.h"
#include "interchange/rotate_splats.h"
#include "pack/lit_snapshot.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

using namespace nacre;

namespace {

/// An asset of bigs whose radiance SH of degree 3 can hold: diffuse, in [0, 1] under lights of irradiance 1.
SplatAsset matteAsset()
{
    SplatAsset asset = test::makeAsset(20, 0, 0);
    for (Channel& channel : asset.channels) std::fill(channel.values.begin(), channel.values.end(), 0.0f);
    for (size_t i = 0; i < asset.cloud.count; ++i) {
        asset.channels[0].values[25 * i] = 0.5f + 0.02f * float(i);                                  // tDir: the same from everywhere
        for (size_t c = 0; c < 3; ++c) asset.channels[2].values[3 * i + c] = 0.2f + 0.3f * float(c); // rho
        asset.cloud.scales[i] = glm::vec3(0.1f, 0.05f, 0.2f), asset.cloud.opacities[i] = 0.8f;
    }
    return asset;
}

std::vector<Light> someLights()
{
    Light point, sun;
    point.position = {2, 1, 3}, point.intensity = {4, 3, 2};
    sun.type = LightType::kDirectional, sun.directionToLight = glm::normalize(glm::vec3(-1, 2, 0.5f)), sun.intensity = {0.3f, 0.5f, 0.7f};
    return {point, sun};
}

Camera someCamera(const glm::dvec3& center, double distance)
{
    Camera camera;
    camera.width = camera.height = 48, camera.fx = camera.fy = 60, camera.cx = camera.cy = 24;
    camera.worldFromCamera[3] = glm::dvec4(center + glm::dvec3(0, 0, distance), 1);
    return camera;
}

double largestDifference(const Image& a, const Image& b)
{
    double most = 0;
    for (size_t k = 0; k < a.rgba.size(); ++k) most = std::max(most, double(std::abs(a.rgba[k] - b.rgba[k])));
    return most;
}

} // namespace

TEST_CASE("a linear snapshot of a matte asset shows what the asset shows, also far from the dataset's origin and in other units")
{
    for (const double scale : {1.0, 40.0}) {
        SplatAsset asset = matteAsset();
        if (scale > 1) asset.frame.scale = scale, asset.frame.translation = {500, -200, 90}, asset.frame.lightGain = 0.5;
        std::vector<Light> lights;
        for (const Light& light : someLights()) lights.push_back(lightInDataset(asset.frame, light));
        const auto snapshot = litSnapshot(asset, lights, {false, 1});
        REQUIRE_MESSAGE(snapshot, (snapshot ? "" : snapshot.error().message));
        CHECK(snapshot->look.shFunctions == 16);
        const auto reference = makeReferenceRenderer(asset);
        REQUIRE(reference);
        const Camera camera = someCamera(asset.frame.positionInDataset(glm::dvec3(0)), 5 * scale);
        const auto wanted = (*reference)->render(camera, lights);
        PlainSplats placed = *snapshot;
        placeInDataset(asset.frame, placed.cloud);
        const auto found = makePlainRenderer(placed, asset.lowPassVariance)->render(camera, {});
        REQUIRE(wanted);
        REQUIRE(found);
        const float brightest = *std::max_element(wanted->rgba.begin(), wanted->rgba.end());
        CHECK(brightest > 0.1f);
        CHECK(largestDifference(*wanted, *found) < (scale > 1 ? 1e-2 : 1e-4)); // float32 positions 500 units away are 3e-5 off, in pixels of 4
    }
}

TEST_CASE("an sRGB snapshot has encoded colours, cut at white; exposure scales the light")
{
    const SplatAsset asset = matteAsset();
    const auto lights = someLights();
    const auto linear = litSnapshot(asset, lights, {false, 1}), srgb = litSnapshot(asset, lights, {true, 1}), bright = litSnapshot(asset, lights, {true, 1e6});
    REQUIRE(linear);
    REQUIRE(srgb);
    REQUIRE(bright);
    CHECK(srgb->srgb);
    constexpr float kDegree0 = 0.28209479f;
    for (size_t i = 0; i < asset.cloud.count; ++i)
        for (int c = 0; c < 3; ++c) {
            const float radiance = 0.5f + kDegree0 * linear->look.sh[16 * i][c];
            CHECK(0.5f + kDegree0 * srgb->look.sh[16 * i][c] == doctest::Approx(srgbFromLinear(std::clamp(radiance, 0.0f, 1.0f))).epsilon(1e-3));
            if (radiance > 1e-3f) CHECK(0.5f + kDegree0 * bright->look.sh[16 * i][c] == doctest::Approx(1.0f).epsilon(1e-4));
        }
}

TEST_CASE("what others hide counts little: splats seen from one side only show it more exactly")
{
    SplatAsset asset = test::makeAsset(4, 25, 0, true); // s of degree 4: more than the look can hold
    Channel& visibility = asset.channels[asset.channels.size() - 2];
    REQUIRE(visibility.name == "visibility");
    const auto errorFromAbove = [&](const PlainSplats& snapshot) {
        const auto reference = makeReferenceRenderer(asset);
        double sum = 0;
        for (const double x : {-1.5, -0.5, 0.5, 1.5}) {
            Camera camera = someCamera({x, 0.3, 0}, 5);
            sum += largestDifference(*(*reference)->render(camera, someLights()), *makePlainRenderer(snapshot, asset.lowPassVariance)->render(camera, {}));
        }
        return sum;
    };
    // Light and camera share the map, so the light comes from where it is open in both cases.
    const auto open = [&](bool below) {
        for (size_t i = 0; i < visibility.bytes.size(); ++i) {
            const double u = (double(i % 16) + 0.5) / 8 - 1, v = (double(i / 16 % 16) + 0.5) / 8 - 1;
            visibility.bytes[i] = below || std::abs(u) + std::abs(v) < 1 ? 255 : 0; // octahedral: z > 0
        }
    };
    open(true);
    const auto everywhere = litSnapshot(asset, someLights(), {false, 1});
    const double before = errorFromAbove(*everywhere);
    open(false);
    const auto above = litSnapshot(asset, someLights(), {false, 1});
    CHECK(errorFromAbove(*above) < before);
}

TEST_CASE("a snapshot of sss shows matte splats as the asset's pixels do, and does not depend on the number of threads")
{
    const SplatAsset asset = test::makeSss(6, true);
    const auto lights = someLights();
    const auto many = litSnapshot(asset, lights, {true, 1});
    REQUIRE_MESSAGE(many, (many ? "" : many.error().message));
    tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const auto single = litSnapshot(asset, lights, {true, 1});
    REQUIRE(single);
    CHECK(many->look.sh == single->look.sh);
}

TEST_CASE("changing the colour space of splats and back changes little")
{
    PlainSplats splats = *litSnapshot(matteAsset(), someLights(), {true, 0.2});
    const PlainSplats before = splats;
    changeColorSpace(false, splats);
    CHECK(!splats.srgb);
    changeColorSpace(true, splats);
    for (size_t k = 0; k < before.look.sh.size(); ++k) CHECK(glm::length(before.look.sh[k] - splats.look.sh[k]) < 1e-4);
}
