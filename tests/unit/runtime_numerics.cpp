// The "numerics that bite" of the renderer, each with its name.
#include "runtime_fixture.h"

#include <map>

using namespace nacre;
using namespace nacre::test;

static Camera front(double distance = 2) { return lookAt({0, 0, distance}, {0, 0, 0}, 33, 33, 40); }
static const std::vector<Light> kLamp = {pointLight({1, 1, 2}, glm::vec3(3))};

TEST_CASE("a light of intensity 0 adds exactly nothing, one of 1e4 scales")
{
    if (!haveGl()) return;
    Host host(randomAsset(50, 9, 1));
    const Image lit = host.draw(front(), kLamp);
    CHECK(largestDifference(host.draw(front(), {{kLamp[0], pointLight({0, 0, 1}, glm::vec3(0))}}), lit) == 0.0f);
    const Image dark = host.draw(front(), {{pointLight({0, 0, 1}, glm::vec3(0))}});
    for (size_t i = 0; i < dark.rgba.size(); ++i)
        if (i % 4 != 3) REQUIRE(dark.rgba[i] == 0.0f);
    Image bright = host.draw(front(), {{pointLight({1, 1, 2}, glm::vec3(3e4f))}});
    for (size_t i = 0; i < bright.rgba.size(); ++i)
        if (i % 4 != 3) bright.rgba[i] *= 1e-4f;
    CHECK(largestDifference(bright, lit) < 1e-5f * largest(lit)); // f32 products
}

TEST_CASE("no lights: black colour, full coverage")
{
    if (!haveGl()) return;
    const SplatAsset asset = randomAsset(50, 9, 1);
    Host host(asset);
    CHECK(largestDifference(host.draw(front()), referenceImage(asset, front(), {})) < 1e-5f);
}

TEST_CASE("a point light of 1e12 at distance 1e6 is a directional light of 1")
{
    if (!haveGl()) return;
    Host host(randomAsset(50, 25, 2));
    const Image far = host.draw(front(), {{pointLight({0, 0, 1e6f}, glm::vec3(1e12f))}});
    const Image directional = host.draw(front(), {{directionalLight({0, 0, 1}, glm::vec3(1))}});
    CHECK(largestDifference(far, directional) < 1e-5f * std::max(1.0f, largest(directional))); // parallax of 1e-6
}

TEST_CASE("a light exactly on a splat's mean stays finite and capped")
{
    if (!haveGl()) return;
    const SplatAsset asset = oneSplat(9);
    Host host(asset);
    const std::vector<Light> inside = {pointLight({0, 0, 0}, glm::vec3(1e-6f))};
    const Image image = host.draw(front(), inside);
    CHECK(allFinite(image));
    CHECK(largestDifference(image, referenceImage(asset, front(), inside)) < 1e-4f); // falloff 1e6, f32 rounding
}

TEST_CASE("the brightest lights allowed, on the mean of a splat with the largest coefficients, give finite colours")
{
    if (!haveGl()) return;
    for (const float sign : {-1.0f, 1.0f}) { // s negative: the scattered part is clamped to 0, and infinity times 0 would be NaN
        SplatAsset asset = withSharp(oneSplat(25), kAllSharp, 1);
        const std::map<std::string, float> special = {{"s", sign * 65504.0f}, {"rho", 0.0f}, {"shadow", 1.0f}};
        for (Channel& channel : asset.channels) // of the lobe too: not a unit normal, but the shaders must bear it
            for (float& v : channel.values) v = special.count(channel.name) ? special.at(channel.name) : 65504.0f;
        Host host(asset);
        CHECK(allFinite(host.draw(front(), std::vector<Light>(256, pointLight({0, 0, 0}, glm::vec3(1e15f))))));
    }
}

// ---- highlights and hard shadows ----------------------------------------------------------------------------------------------

/// A splat that only shines: no transport but the lobe.
static SplatAsset mirror(glm::vec3 normal, float sharpness)
{
    SplatAsset asset = withSharp(oneSplat(0), kLobe, 1);
    for (Channel& channel : asset.channels)
        for (float& v : channel.values) v = 0;
    normal = glm::normalize(normal);
    asset.channels.back().values = {normal.x, normal.y, normal.z, sharpness, 1, 0.5f, 0.25f};
    return asset;
}
static float shine(Host& host, glm::vec3 towards)
{
    return host.draw(front(), {{directionalLight(towards, glm::vec3(1))}}).pixel(16, 16)[0];
}

TEST_CASE("sharpness 0 is the same from every side; the sharpest lobe is bright only where it mirrors")
{
    if (!haveGl()) return;
    Host host(mirror({0, 0, 1}, 0));
    const float peak = shine(host, {0, 0, 1});
    CHECK(peak > 0.5f);
    CHECK(shine(host, {1, 0, 1}) == doctest::Approx(peak)); // 4 n.w is over 1 there
    CHECK(shine(host, {1, 0, 0.1f}) == doctest::Approx(0.4f / std::sqrt(1.01f) * peak));
    host.load(mirror({0, 0, 1}, -5)); // as 0
    CHECK(shine(host, {1, 0, 1}) == doctest::Approx(peak));
    host.load(mirror({1, 0, 1}, 65504));
    CHECK(shine(host, {1, 0, 0}) == doctest::Approx(peak).epsilon(0.05)); // 65504 times the f32 rounding of 1 - (n.h)^2
    CHECK(shine(host, {1, 0.02f, 0}) < 0.01f * peak);
}

TEST_CASE("a light behind the surface makes no highlight, one opposite the camera neither")
{
    if (!haveGl()) return;
    Host host(mirror({0.3f, 0.1f, 1}, 2));
    CHECK(shine(host, {0.2f, 0, -1}) == 0.0f);
    CHECK(shine(host, {-0.3f, -0.1f, -1}) == 0.0f);
    host.load(mirror({0, 0, -1}, 0)); // before the surface, but w_t + w_o = 0
    CHECK(shine(host, {0, 0, -1}) == 0.0f);
    CHECK(shine(host, {0.5f, 0, -1}) > 0.1f);
}

TEST_CASE("a light or a camera exactly on the mean of a splat with all channels stays finite and like the reference")
{
    if (!haveGl()) return;
    const SplatAsset asset = withSharp(oneSplat(9), kAllSharp, 3, 30);
    Host host(asset);
    const std::vector<Light> inside = {pointLight({0, 0, 0}, glm::vec3(1e-6f))};
    const Image image = host.draw(front(), inside);
    CHECK(allFinite(image));
    CHECK(largestDifference(image, referenceImage(asset, front(), inside)) < 1e-3f); // half v, falloff 1e6
    CHECK(allFinite(host.draw(lookAt({0, 0, 0}, {0.3, 0.2, -1}, 33, 33, 40), kLamp)));
}

TEST_CASE("open maps and shadow 0 change nothing at all; closed maps leave the indirect light")
{
    if (!haveGl()) return;
    const SplatAsset plain = withSharp(randomAsset(60, 4, 5), kLobe, 5);
    const auto sealed = [&](uint8_t texel, float depth) {
        SplatAsset a = plain;
        a.channels.push_back({"visibility", kVisibilityTexels, {}, std::vector<uint8_t>(60 * kVisibilityTexels, texel)});
        a.channels.push_back({"shadow", 1, std::vector<float>(60, depth), {}});
        return a;
    };
    SplatAsset dark = plain; // neither direct transport nor lobe
    for (Channel& channel : dark.channels)
        if (channel.name == "tDir" || channel.name == "lobe") std::fill(channel.values.begin(), channel.values.end(), 0.0f);
    Host host(plain);
    const Image lit = host.draw(front(), kLamp);
    host.load(dark);
    const Image indirect = host.draw(front(), kLamp);
    CHECK(largestDifference(lit, indirect) > 0.1f);
    for (const auto& [texel, depth] : {std::pair{255, 1.0f}, std::pair{0, 0.0f}}) {
        host.load(sealed(uint8_t(texel), depth));
        CHECK(largestDifference(host.draw(front(), kLamp), lit) < 1e-6f); // weights that sum to 1 in f32
    }
    host.load(sealed(0, 1.0f));
    CHECK(largestDifference(host.draw(front(), kLamp), indirect) == 0.0f);
    const SplatAsset half = sealed(140, 0.5f);
    host.load(half);
    CHECK(psnr(host.draw(front(), kLamp), referenceImage(half, front(), kLamp)) > 70.0);
}

TEST_CASE("a camera inside the cloud and exactly on a mean sees finite pixels like the reference")
{
    if (!haveGl()) return;
    SplatAsset asset = randomAsset(400, 9, 4);
    asset.cloud.positions[0] = glm::vec3(0);
    Host host(asset);
    const Camera inside = lookAt({0, 0, 0}, {0.3, 0.2, -1}, 48, 48, 30);
    const Image image = host.draw(inside, kLamp);
    CHECK(allFinite(image));
    CHECK(psnr(image, referenceImage(asset, inside, kLamp)) > 50.0); // huge footprints near the camera amplify f32 rounding
}

TEST_CASE("splats at and behind the near plane are not drawn")
{
    if (!haveGl()) return;
    SplatAsset asset = randomAsset(3, 0, 6);
    asset.cloud.positions = {{0, 0, 2.0f - 0.009f}, {0, 0, 2.5f}, {0, 0, 2}};
    Host host(asset);
    CHECK(largest(host.draw(front(), kLamp)) == 0.0f);
    asset.cloud.positions[0] = {0, 0, 2.0f - 0.011f};
    host.load(asset);
    CHECK(largest(host.draw(front(), kLamp)) > 0.0f);
}

TEST_CASE("opacity 0 draws nothing, opacity 1 never blocks everything")
{
    if (!haveGl()) return;
    Host host(oneSplat(0, glm::vec3(0.5f), 0.0f));
    CHECK(largest(host.draw(front(), kLamp)) == 0.0f);
    host.load(oneSplat(0, glm::vec3(0.5f), 1.0f));
    const Image solid = host.draw(front(), kLamp);
    CHECK(solid.pixel(16, 16)[3] == doctest::Approx(kMaxAlpha).epsilon(1e-4));
}

TEST_CASE("five thousand layers on one pixel blend like the reference")
{
    if (!haveGl()) return;
    SplatAsset asset = randomAsset(5000, 0, 8);
    for (size_t g = 0; g < asset.cloud.count; ++g) {
        asset.cloud.positions[g] *= glm::vec3(0.01f, 0.01f, 1.0f);
        asset.cloud.opacities[g] = 0.01f;
    }
    Host host(asset);
    const Camera camera = lookAt({0, 0, 2}, {0, 0, 0}, 9, 9, 40);
    const Image image = host.draw(camera, kLamp), expected = referenceImage(asset, camera, kLamp);
    CHECK(expected.pixel(4, 4)[3] > 0.9f);
    CHECK(largestDifference(image, expected) < 1e-3f * std::max(1.0f, largest(expected))); // 5000 f32 blends; the reference ends at 1e-4
}

TEST_CASE("equal distances keep the order of the file: the first splat is in front")
{
    if (!haveGl()) return;
    SplatAsset asset = randomAsset(2, 0, 9);
    for (int g = 0; g < 2; ++g) {
        asset.cloud.positions[g] = glm::vec3(0);
        asset.cloud.scales[g] = glm::vec3(0.4f);
        asset.cloud.opacities[g] = 0.9f;
    }
    asset.channels[2].values = {1, 0, 0, 0, 1, 0}; // rho: red, then green
    for (float& v : asset.channels[1].values) v = 0; // tInd
    Host host(asset);
    const Image image = host.draw(front(), kLamp);
    CHECK(image.pixel(16, 16)[0] > 4 * image.pixel(16, 16)[1]);
    CHECK(largestDifference(image, referenceImage(asset, front(), kLamp)) < 1e-5f);
}

TEST_CASE("splats far below a pixel fade with their area and do not vanish or blow up")
{
    if (!haveGl()) return;
    for (const float scale : {2e-3f, 1e-3f, 1e-5f}) {
        CAPTURE(scale);
        const SplatAsset asset = oneSplat(0, glm::vec3(scale), 1.0f);
        Host host(asset);
        const Image image = host.draw(front(), kLamp);
        CHECK(allFinite(image));
        CHECK(largestDifference(image, referenceImage(asset, front(), kLamp)) < 1e-5f);
    }
}

TEST_CASE("a covariance of condition number 1e8 keeps its shape")
{
    if (!haveGl()) return;
    SplatAsset asset = oneSplat(0, {0.5f, 5e-5f, 5e-5f}, 1.0f);
    asset.cloud.rotations[0] = glm::normalize(glm::quat(0.9f, 0.1f, -0.3f, 0.25f));
    asset.lowPassVariance = 0.1f;
    Host host(asset);
    CHECK(largestDifference(host.draw(front(), kLamp), referenceImage(asset, front(), kLamp)) < 1e-4f);
}

TEST_CASE("no low-pass at all still draws finite pixels")
{
    if (!haveGl()) return;
    SplatAsset asset = randomAsset(100, 0, 10, 0.2f);
    asset.lowPassVariance = 0.0f;
    Host host(asset);
    const Image image = host.draw(front(), kLamp);
    CHECK(allFinite(image));
    CHECK(psnr(image, referenceImage(asset, front(), kLamp)) > 60.0);
}
