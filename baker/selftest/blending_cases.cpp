// Many layers, and the ends of opacity.
#include "selftest/cases.h"

#include "base/half.h"
#include "splats/blend.h"

#include <limits>

namespace nacre::selftest {

static constexpr const char* kImageOf = "colour, alpha";
static constexpr Bound kRounding{1e-5, "float32 rounds each of some 100 steps by 6e-8"};

Scene layers(size_t count, float opacity)
{
    Scene scene = bigsScene(count, 0, 8);
    for (size_t i = 0; i < count; ++i) {
        scene.asset.cloud.positions[i] *= glm::vec3(0.01f, 0.01f, 1);
        scene.asset.cloud.opacities[i] = opacity;
    }
    scene.camera = cameraAt({0, 0, 2}, glm::dvec3(0), 9);
    return scene;
}

static Scene atOnePlace(size_t count)
{
    Scene scene = bigsScene(count, 0, 9);
    for (size_t i = 0; i < count; ++i) {
        scene.asset.cloud.positions[i] = {0.01f, 0.02f, 0.03f}, scene.asset.cloud.scales[i] = glm::vec3(0.3f);
        scene.asset.cloud.opacities[i] = 0.1f + 0.8f * float(i % 3 == 0);
    }
    return scene;
}

static Scene redOverGreen()
{
    Scene scene = matteSplat(0.3f, 0.5f, 0);
    SplatCloud& cloud = scene.asset.cloud;
    cloud.count = 2;
    for (Channel& c : scene.asset.channels) {
        const std::vector<float> row = c.values;
        c.values.insert(c.values.end(), row.begin(), row.end());
    }
    channel(scene, "rho") = {1, 0, 0, 0, 1, 0};
    cloud.positions.resize(2, cloud.positions[0]), cloud.rotations.resize(2, cloud.rotations[0]), cloud.scales.resize(2, cloud.scales[0]), cloud.opacities.resize(2, 0.5f);
    return scene;
}

static Scene overflowing(Scene scene)
{
    scene.halfTarget = true;
    return scene;
}

std::vector<Case> blendingCases()
{
    std::vector<Case> cases;
    const auto add = [&](const char* name, Bound bound, auto scene) { return &cases.emplace_back(Case{.name = name, .quantity = kImageOf, .bound = bound, .scene = scene}); };
    constexpr Bound kQuads{2e-4, "quads blend all layers, the reference ends a pixel at a transmittance of 1e-4"};
    const double solid = 0.5 * 36 / (36 + double(0.1f)); // alpha of a ball of 0.3 at opacity 0.5

    add("opacity 0", {0, "nothing is drawn"}, [] { return matteSplat(0.3f, 0); })->known = {{16, 16, 0, 0}, {16, 16, 3, 0}};
    add("opacity 1 never blocks everything", kRounding, [] { return matteSplat(0.3f, 1); })->known = {{16, 16, 3, double(kMaxAlpha)}, {16, 16, 0, 0.5 * double(kMaxAlpha)}};
    add("opacity just above and below 1/255", {1e-4, "2 % from the threshold, rounding decides nothing"}, [] {
        Scene scene = bigsScene(40, 0, 3);
        for (size_t i = 0; i < 40; ++i) scene.asset.cloud.opacities[i] = kMinAlpha * (i % 2 ? 1.02f : 0.98f), scene.asset.cloud.scales[i] = glm::vec3(50);
        return scene;
    });
    add("opacities and scales of 1e-40", kRounding, [] {
        Scene scene = bigsScene(40, 4, 3);
        for (size_t i = 0; i < 40; ++i) {
            if (i % 4 == 0) scene.asset.cloud.opacities[i] = 1e-40f;
            if (i % 4 == 1) scene.asset.cloud.scales[i] = glm::vec3(1e-40f);
            if (i % 4 == 2) scene.asset.cloud.scales[i] = {1e-40f, 0.1f, 0.1f}, scene.asset.cloud.positions[i] *= 1e-40f;
            if (i % 4 == 3) scene.asset.cloud.opacities[i] = 0;
        }
        return scene;
    })->gl = {1.0 / 255, "rounding decides whether a splat at the threshold of 1/255 is counted"};
    add("coefficients of 1e-40", {1e-38, "numbers below 1.2e-38 may be flushed to zero"}, [] {
        Scene scene = bigsScene(40, 4, 3);
        for (const char* name : {"tDir", "tInd", "rho", "s"})
            for (float& v : channel(scene, name)) v *= 1e-40f;
        return scene;
    })->exactColor = true;
    add("equal depths: the first of the file is in front", kRounding, redOverGreen)->known = {{16, 16, 0, solid}, {16, 16, 1, solid * (1 - solid)}, {16, 16, 2, 0}};
    add("equal depths: 64 splats at one place", kRounding, [] { return atOnePlace(64); })->gl = kQuads;
    add("5,000 faint layers on one pixel", {1e-3, "5,000 products of 1 - alpha, and a pixel ends at a transmittance of 1e-4"}, [] { return layers(5000, 0.01f); });
    add("5,000 solid layers on one pixel", {1e-3, "a pixel ends at a transmittance of 1e-4, which rounding may put off by a layer"}, [] { return layers(5000, 1); });
    add("no lights", {1e-5, "black, and covered"}, [] {
        Scene scene = bigsScene(60, 4, 3);
        scene.lights.clear();
        return scene;
    });
    add("half overflow: radiance of 1e9 in a half target stops at 65504", {1.0 / 1024, "a half has 11 bits"}, [] {
        Scene scene = overflowing(matteSplat(0.3f, 1));
        scene.lights[0].intensity = glm::vec3(2e9f);
        return scene;
    })->known = {{16, 16, 0, double(kMaxHalf) * double(kMaxAlpha)}, {16, 16, 3, double(kMaxAlpha)}};
    add("half overflow: layers of a cloud under 1e12", {8.0 / 1024, "each of some 10 layers is rounded to 11 bits"}, [] {
        Scene scene = overflowing(bigsScene(60, 4, 3));
        scene.lights[0].intensity = glm::vec3(1e12f);
        return scene;
    });
    return cases;
}

} // namespace nacre::selftest
