// The GL renderer against the float64 reference made of the scalar headers.
#include "runtime_fixture.h"

using namespace nacre;
using namespace nacre::test;

static const std::vector<Light> kMixedLights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f}),
                                                directionalLight({-0.3f, 0.4f, 0.9f}, {0.3f, 0.6f, 0.9f}, 0.3f),
                                                pointLight({-1.2f, 0.2f, 0.7f}, {0.5f, 1.5f, 1.0f}, 1.6f)}; // splats inside its radius

TEST_CASE("one splat has the colour and shape of the scalar reference for every size of s")
{
    if (!haveGl()) return;
    Host host;
    for (const int functions : {0, 1, 4, 9, 16, 25}) {
        CAPTURE(functions);
        const SplatAsset asset = oneSplat(functions, {0.3f, 0.1f, 0.05f});
        host.load(asset);
        const Image expected = referenceImage(asset, offCentre(), kMixedLights);
        CHECK(largest(expected) > 0.05f);
        // f32 sums of 25 terms and of the view matrix, on values of order one
        CHECK(largestDifference(host.draw(offCentre(), kMixedLights), expected) < 2e-5f);
    }
}

/// 64 small splats in a plane before the camera, side by side: an image of their colours.
static SplatAsset palette(int functions, int which, uint32_t seed)
{
    SplatAsset asset = withSharp(randomAsset(64, functions, seed), which, seed);
    for (size_t g = 0; g < 64; ++g) {
        asset.cloud.positions[g] = {0.2f * (float(g % 8) - 3.5f), 0.2f * (float(g / 8) - 3.5f), 0};
        asset.cloud.scales[g] = glm::vec3(0.02f);
        asset.cloud.opacities[g] = 0.9f;
    }
    return asset;
}
static Camera overPalette() { return lookAt({0.2, -0.1, 2}, {0.05, 0, 0}, 72, 72, 80); }

TEST_CASE("lobe, forward light, visibility and shadow, each alone and together, with and without s, give the colours of the scalar reference")
{
    if (!haveGl()) return;
    Host host;
    std::vector<Light> lights = kMixedLights; // and from all around, so that every part of the maps is read
    for (int i = 0; i < 10; ++i) {
        const double z = 0.9 - 0.2 * i, r = std::sqrt(1 - z * z);
        lights.push_back(pointLight(glm::vec3(1.5 * r * std::cos(2.4 * i), 1.5 * r * std::sin(2.4 * i), 1.5 * z), glm::vec3(0.3f)));
    }
    for (const int functions : {0, 9})
        for (int which = 1; which <= kAllSharp; ++which) {
            CAPTURE(functions);
            CAPTURE(which);
            const SplatAsset asset = palette(functions, which, uint32_t(30 + which));
            host.load(asset);
            const Image expected = referenceImage(asset, overPalette(), lights), drawn = host.draw(overPalette(), lights);
            CHECK(largest(expected) > 0.3f);
            // f32; with lobe and visibility v passes between two passes as a half: 2^-12 of highlights of a few units
            CHECK(largestDifference(drawn, expected) < ((which & (kLobe | kForward)) && (which & kVisibility) ? 1.5e-3f : 5e-5f));
            CHECK(psnr(drawn, expected) > 85.0);
        }
}

TEST_CASE("visibility maps are read right on their folds, edges and corners")
{
    if (!haveGl()) return;
    const SplatAsset asset = palette(0, kVisibility, 41);
    Host host(asset);
    for (const float x : {-1.0f, 0.0f, 1.0f})
        for (const float y : {-1.0f, 0.0f, 1.0f})
            for (const float z : {-1.0f, -1e-4f, 0.0f, 1.0f}) {
                if (x == 0 && y == 0 && std::abs(z) != 1) continue;
                CAPTURE(x);
                CAPTURE(y);
                CAPTURE(z);
                const std::vector<Light> light = {directionalLight({x, y, z}, glm::vec3(1))};
                CHECK(largestDifference(host.draw(overPalette(), light), referenceImage(asset, overPalette(), light)) < 2e-5f);
            }
}

TEST_CASE("every light type alone matches the scalar reference")
{
    if (!haveGl()) return;
    const SplatAsset asset = oneSplat(25);
    Host host(asset);
    for (const Light& light : kMixedLights)
        CHECK(largestDifference(host.draw(offCentre(), {{light}}), referenceImage(asset, offCentre(), {{light}})) < 2e-5f);
}

TEST_CASE("a random cloud of 2000 splats matches the reference image")
{
    if (!haveGl()) return;
    const SplatAsset asset = randomAsset(2000, 9, 3);
    Host host(asset);
    const Image expected = referenceImage(asset, offCentre(), kMixedLights), drawn = host.draw(offCentre(), kMixedLights);
    CHECK(largest(expected) > 0.3f);
    CHECK(psnr(drawn, expected) > 80.0); // f32; a flipped alpha cut costs 1/255 in a few pixels
}

TEST_CASE("a random cloud of 2000 splats with highlights and hard shadows matches the reference image")
{
    if (!haveGl()) return;
    const SplatAsset asset = withSharp(randomAsset(2000, 9, 3), kAllSharp, 3);
    Host host(asset);
    const Image expected = referenceImage(asset, offCentre(), kMixedLights), drawn = host.draw(offCentre(), kMixedLights);
    CHECK(largest(expected) > 0.3f);
    CHECK(psnr(drawn, expected) > 80.0); // as without; half-float v costs no more than an alpha cut that flips
}

TEST_CASE("the sum of single-light images is the image with all lights")
{
    if (!haveGl()) return;
    std::vector<Light> lights = kMixedLights;
    for (int i = 0; i < 6; ++i) // nine lights: three groups, the last with one
        lights.push_back(pointLight({std::cos(float(i)), 1.0f, std::sin(float(i))}, {0.2f * float(i), 0.5f, 1.0f}));
    for (const int which : {0, int(kAllSharp)}) {
        Host host(withSharp(randomAsset(200, 25, 5), which, 5));
        Image sum = host.draw(offCentre(), {{lights[0]}});
        for (size_t i = 1; i < lights.size(); ++i) {
            const Image one = host.draw(offCentre(), {{lights[i]}});
            for (size_t k = 0; k < sum.rgba.size(); ++k)
                if (k % 4 != 3) sum.rgba[k] += one.rgba[k];
        }
        const Image together = host.draw(offCentre(), lights);
        CHECK(largestDifference(sum, together) < 2e-6f * largest(together) * 9); // f32 rounding of nine blended images
    }
}

TEST_CASE("many lights at once match the reference")
{
    if (!haveGl()) return;
    const SplatAsset asset = oneSplat(4);
    Host host(asset);
    for (const int count : {256, 257, 1500}) {
        CAPTURE(count);
        std::vector<Light> lights;
        for (int i = 0; i < count; ++i) {
            const float t = float(i), dim = 256 / float(count);
            lights.push_back(i % 2 ? pointLight({std::cos(t), std::sin(1.7f * t), std::sin(t)}, glm::vec3(0.02f * dim))
                                   : directionalLight({std::sin(t), 0.5f, std::cos(t)}, glm::vec3(0.01f * dim)));
        }
        const Image expected = referenceImage(asset, offCentre(), lights);
        CHECK(largestDifference(host.draw(offCentre(), lights), expected) < 2e-5f * std::max(1.0f, largest(expected)));
    }
}

TEST_CASE("a moved, turned and scaled asset is lit and seen as in its own frame")
{
    if (!haveGl()) return;
    const double k = 2.5;
    const glm::dmat4 worldFromAsset = glm::scale(
        glm::rotate(glm::translate(glm::dmat4(1.0), glm::dvec3(3, -2, 5)), 0.8, glm::normalize(glm::dvec3(1, 2, -1))), glm::dvec3(k));
    const SplatAsset asset = randomAsset(300, 9, 11);
    Host host(asset);
    const Image expected = referenceImage(asset, offCentre(), kMixedLights);

    std::vector<Light> world = kMixedLights;
    for (Light& light : world) {
        light.position = glm::vec3(worldFromAsset * glm::dvec4(light.position, 1.0));
        light.directionToLight = glm::vec3(glm::dmat3(worldFromAsset) * glm::dvec3(light.directionToLight) / k);
        light.radius *= float(k);
        if (light.type == LightType::kPoint) light.intensity *= float(k * k); // world distances are k times longer
    }
    host.setLights(world);
    NacreDrawDesc desc = describe(offCentre());
    host.moveTo(worldFromAsset);
    const glm::dmat3 rotation = glm::dmat3(worldFromAsset) / k;
    glm::dmat4 worldFromView = glm::dmat4(rotation) * glm::dmat4(glm::dmat3(offCentre().worldFromCamera));
    worldFromView[3] = worldFromAsset * offCentre().worldFromCamera[3];
    copy(desc.viewFromWorld, glm::inverse(worldFromView));
    CHECK(psnr(host.draw(desc), expected) > 80.0); // f32 matrices in another frame
}

TEST_CASE("the GL renderer of the tools draws the reference image, top row first, and times it")
{
    if (!haveGl()) return;
    const SplatAsset asset = randomAsset(100, 4, 13);
    const auto bytes = encodeAsset(asset);
    REQUIRE(bytes);
    const auto renderer = makeGlRenderer(*bytes);
    REQUIRE(renderer);
    const auto image = (*renderer)->render(offCentre(), kMixedLights);
    REQUIRE(image);
    CHECK(psnr(*image, referenceImage(asset, offCentre(), kMixedLights)) > 60.0);
    const auto times = (*renderer)->time(offCentre(), kMixedLights, 1, 3);
    REQUIRE(times);
    CHECK(times->relightMs > 0);
    CHECK(times->frameMs >= times->rasterMs);
    for (const double distance : {0.0, 1e3, 1e6}) // a frame that float32 makes the same as the last would fail
        CHECK((*renderer)->time(lookAt({0, 0, distance}, {0, 0, -1}, 16, 16, 20), kMixedLights, 0, 3));
    Light environment;
    environment.type = LightType::kEnvironment;
    CHECK_FALSE((*renderer)->render(offCentre(), {{environment}}));
}

TEST_CASE("the GL renderer of the tools draws under hundreds of lights")
{
    if (!haveGl()) return;
    const SplatAsset asset = randomAsset(100, 4, 13);
    const auto bytes = encodeAsset(asset);
    REQUIRE(bytes);
    const auto renderer = makeGlRenderer(*bytes);
    REQUIRE(renderer);
    std::vector<Light> lights;
    for (size_t i = 0; i < 515; ++i) {
        lights.push_back(kMixedLights[i % kMixedLights.size()]);
        lights.back().position += 0.001f * float(i), lights.back().intensity /= 200.0f;
    }
    const auto image = (*renderer)->render(offCentre(), lights);
    REQUIRE(image);
    CHECK(psnr(*image, referenceImage(asset, offCentre(), lights)) > 60.0);
    CHECK((*renderer)->time(offCentre(), lights, 1, 2));
    CHECK((*renderer)->render(offCentre(), {})); // none at all
}

TEST_CASE("the GL renderer and the reference renderer of the tools agree on 2000 splats with the full s and all channels")
{
    if (!haveGl()) return;
    SplatAsset asset = withSharp(randomAsset(2000, 25, 17, 0.08f), kAllSharp, 17);
    for (Channel& channel : asset.channels)
        for (float& v : channel.values) v *= 0.9997f; // values that half floats cannot hold, as a bake makes them
    const auto bytes = encodeAsset(asset);
    REQUIRE(bytes);
    const auto gl = makeGlRenderer(*bytes);
    const auto reference = makeReferenceRenderer(asset);
    REQUIRE(gl);
    REQUIRE(reference);
    const auto drawn = (*gl)->render(offCentre(), kMixedLights), expected = (*reference)->render(offCentre(), kMixedLights);
    REQUIRE(drawn);
    REQUIRE(expected);
    CHECK(psnr(*drawn, *expected) > 60.0); // half floats: relative 2^-11 per coefficient
}
