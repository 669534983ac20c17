#include "cli/scene_spec.h"

#include <doctest/doctest.h>

#include <glm/gtc/matrix_transform.hpp>

using namespace nacre;
using namespace nacre::cli;

/// Pixel of a point, in the image's own coordinates (y down); z < 0 is in front.
static glm::dvec3 project(const Camera& camera, glm::dvec3 p)
{
    const glm::dvec3 v(glm::inverse(camera.worldFromCamera) * glm::dvec4(p, 1));
    return {camera.cx + camera.fx * v.x / -v.z, camera.cy - camera.fy * v.y / -v.z, v.z};
}

static SplatAsset cube(glm::vec3 center, glm::quat yUpFromAsset)
{
    SplatAsset asset;
    asset.yUpFromAsset = yUpFromAsset;
    for (int i = 0; i < 27; ++i) asset.cloud.positions.push_back(center + 0.5f * glm::vec3(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
    asset.cloud.count = 27;
    return asset;
}

TEST_CASE("light texts")
{
    const auto point = parseLight("point:1,-2,3e0:40,30,20");
    REQUIRE(point);
    CHECK(point->type == LightType::kPoint);
    CHECK(point->position == glm::vec3(1, -2, 3));
    CHECK(point->intensity == glm::vec3(40, 30, 20));
    const auto sun = parseLight("directional:0,3,4:2");
    REQUIRE(sun);
    CHECK(sun->directionToLight.z == doctest::Approx(0.8));
    CHECK(sun->intensity == glm::vec3(2));
    CHECK(parseLight("environment:a:b.exr")->environmentPath == "a:b.exr");
    for (const char* bad : {"", "point", "point:", "point:1,2,3", "point:1,2,3:", "point:1,2:3", "point:1,2,3:1,2", "point:1,2,3:-1", "point:1,,3:1",
                            "point:1,2,nan:1", "point:1,2,3:inf", "point:1,2,3:1e39", "point:1,2,3:4x", "directional:0,0,0:1", "environment:", "lamp:1,2,3:4"})
        CHECK_MESSAGE(!parseLight(bad), bad);
    CHECK(parseLight("spot:1,2,3:4").error().code == ErrorCode::kUnsupported);
}

TEST_CASE("size, image and orbit texts")
{
    CHECK(parseSize("640x480")->height == 480);
    for (const char* bad : {"", "640", "640x", "0x5", "5x-1", "640x480x3", "9999x10", "99999999999x1"}) CHECK_MESSAGE(!parseSize(bad), bad);
    const auto image = parseImageReference("c:/data:test:12");
    REQUIRE(image);
    CHECK(image->dataset == "c:/data");
    CHECK(image->split == "test");
    CHECK(image->index == 12);
    for (const char* bad : {"", "data", "data:test", "data:test:", "data:test:-1", "data::3", ":test:3", "data:test:99999999999"})
        CHECK_MESSAGE(!parseImageReference(bad), bad);
    CHECK(parseOrbit("-30,20")->distance == 0);
    CHECK(parseOrbit("10,-90,2.5")->distance == 2.5);
    for (const char* bad : {"", "10", "1,2,3,4", "0,91", "0,0,0", "0,0,-1", "nan,0"}) CHECK_MESSAGE(!parseOrbit(bad), bad);
}

TEST_CASE("an orbit camera looks at the middle of the object, upright, from where it was told")
{
    const glm::quat zUp = glm::angleAxis(glm::radians(-90.0f), glm::vec3(1, 0, 0)); // +Z up in the asset
    const SplatAsset asset = cube({3, -1, 2}, zUp);
    const Subject subject = findSubject(asset);
    CHECK(glm::length(subject.center - glm::dvec3(3, -1, 2)) < 1e-6);
    CHECK(glm::length(subject.up - glm::dvec3(0, 0, 1)) < 1e-6); // f32 quaternion

    for (double elevation : {-90.0, -20.0, 0.0, 45.0, 90.0}) {
        const Camera camera = orbitCamera({30, elevation, 4}, subject, zUp, 40, {640, 480});
        CHECK(glm::length(camera.position() - subject.center) == doctest::Approx(4));
        const glm::dvec3 middle = project(camera, subject.center);
        CHECK(middle.x == doctest::Approx(320));
        CHECK(middle.y == doctest::Approx(240));
        CHECK(middle.z == doctest::Approx(-4));
        CHECK(camera.position().z - 2 == doctest::Approx(4 * std::sin(glm::radians(elevation))).epsilon(1e-5));
        if (std::abs(elevation) < 90) CHECK(project(camera, subject.center + 0.1 * subject.up).y < 240); // up is up
        CHECK(glm::determinant(glm::dmat3(camera.worldFromCamera)) == doctest::Approx(1));
    }
    // azimuth 0 is the front, +Z of the glTF scene, which is -Y here; 90 degrees is +X
    CHECK(orbitCamera({0, 0, 4}, subject, zUp, 40, {64, 64}).position().y == doctest::Approx(-5));
    CHECK(orbitCamera({90, 0, 4}, subject, zUp, 40, {64, 64}).position().x == doctest::Approx(7));
}

TEST_CASE("without a distance the whole object is in view, for wide and for tall images")
{
    const SplatAsset asset = cube({0, 0, 0}, glm::quat(1, 0, 0, 0));
    for (PixelSize size : {PixelSize{640, 320}, PixelSize{200, 500}}) {
        const Camera camera = orbitCamera({25, 15, 0}, findSubject(asset), asset.yUpFromAsset, 60, size);
        for (const glm::vec3& p : asset.cloud.positions) {
            const glm::dvec3 pixel = project(camera, p);
            CHECK(pixel.z < 0);
            CHECK((pixel.x > 0 && pixel.x < size.width && pixel.y > 0 && pixel.y < size.height));
        }
    }
}

TEST_CASE("a resized camera keeps the whole view, centred")
{
    Camera camera;
    camera.width = 100, camera.height = 50, camera.fx = camera.fy = 80, camera.cx = 52, camera.cy = 24;
    const Camera big = resized(camera, {300, 400});
    const glm::dvec3 p(0.2, 0.1, -1), before = project(camera, p), after = project(big, p);
    CHECK(after.x - 150 == doctest::Approx(3 * (before.x - 50)));
    CHECK(after.y - 200 == doctest::Approx(3 * (before.y - 25)));
}

TEST_CASE("a spin turns camera and light about the up axis through the object")
{
    const SplatAsset asset = cube({1, 2, 3}, glm::quat(1, 0, 0, 0)); // +Y up
    const Subject subject = findSubject(asset);
    const glm::dmat4 quarter = spinMatrix(subject, glm::radians(90.0));
    Light light;
    light.position = {2, 5, 3};
    light.directionToLight = {1, 0, 0};
    const Light turned = spun(light, quarter);
    CHECK(glm::length(turned.position - glm::vec3(1, 5, 2)) < 1e-5f);
    CHECK(glm::length(turned.directionToLight - glm::vec3(0, 0, -1)) < 1e-5f);
    const Camera camera = orbitCamera({0, 10, 3}, subject, asset.yUpFromAsset, 40, {64, 64});
    const Camera expected = orbitCamera({90, 10, 3}, subject, asset.yUpFromAsset, 40, {64, 64});
    CHECK(glm::length(spun(camera, quarter).position() - expected.position()) < 1e-9);
}
