// Surfaces, the network, and the G-buffer in between.
#include "selftest/cases.h"

#include "appearance/sss/sss.h"
#include "appearance/sss/sss_network.h"

#include <cmath>

namespace nacre::selftest {

static constexpr const char* kImageOf = "colour, alpha";
static constexpr Bound kRounding{2e-5, "float32 rounds each of some 200 steps by 6e-8"};
static constexpr Bound kHalves{2e-2, "the G-buffer is blended in halves: 2^-11 a layer"};

/// A wall of one splat across the frame, lit and seen along given directions.
static Scene wall(glm::vec3 normal, float roughness, float metalness, glm::vec3 towardsLight, glm::dvec3 eye = {0, 0, 2})
{
    Scene scene = sssScene(1, false);
    scene.asset.cloud.positions = {glm::vec3(0)}, scene.asset.cloud.rotations = {glm::quat(1, 0, 0, 0)};
    scene.asset.cloud.scales = {glm::vec3(0.3f)}, scene.asset.cloud.opacities = {0.5f};
    normal = glm::normalize(normal);
    channel(scene, "baseColor") = {0.8f, 0.4f, 0.1f}, channel(scene, "material") = {roughness, metalness}, channel(scene, "normal") = {normal.x, normal.y, normal.z};
    scene.camera = cameraAt(eye, glm::dvec3(0), 9);
    scene.lights = {directionalLight(towardsLight, 1)};
    return scene;
}

static Scene cloud(std::vector<Light> lights)
{
    Scene scene = sssScene(60, true, 3);
    scene.lights = std::move(lights);
    return scene;
}

/// Half of the splats face away from where the other half faces, at the same places.
static Scene cancelling()
{
    Scene scene = sssScene(60, true, 3);
    std::vector<float>& normals = channel(scene, "normal");
    for (size_t i = 0; i + 1 < 60; i += 2) {
        scene.asset.cloud.positions[i + 1] = scene.asset.cloud.positions[i], scene.asset.cloud.scales[i + 1] = scene.asset.cloud.scales[i];
        scene.asset.cloud.opacities[i] = 0.5f, scene.asset.cloud.opacities[i + 1] = 1;
        for (size_t k = 0; k < 3; ++k) normals[3 * i + 3 + k] = -normals[3 * i + k];
    }
    return scene;
}

static Scene networkTimes(float factor)
{
    Scene scene = sssScene(60, true, 3);
    std::vector<float>& w = channel(scene, "network");
    for (size_t i = 0; i < size_t(kSssWeights); ++i) w[i] *= factor;
    return scene;
}

std::vector<Case> sssCases()
{
    std::vector<Case> cases;
    const auto add = [&](const char* name, Bound bound, auto scene) {
        return &cases.emplace_back(Case{.name = name, .quantity = kImageOf, .bound = bound, .scene = scene, .gl = kHalves});
    };
    constexpr Bound kPeak{1e-3, "the half vector is rounded by 6e-8, a highlight is 1.6e-3 wide"};
    // straight on: D = 1 / (pi r^4), masking 1 / 4, Fresnel 0.04, half of it covered
    const double r = double(kSssMinRoughness), solid = 0.5 * 36 / (36 + double(0.1f));

    add("sss: roughness 0, straight on", {1e-3, "the mirror image of a pixel's ray leaves the peak of 0.1 degrees within its frame"}, [] { return wall({0, 0, 1}, 0, 0, {0, 0, 1}); })->known =
        {{4, 4, 2, solid * (0.04 / (4 * 3.14159265358979 * r * r * r * r) + 0.96 * double(0.1f) / 3.14159265358979)}};
    add("sss: roughness 0, oblique", kPeak, [] { return wall({1, 0, 1}, 0, 0, {1, 0, 0}); })->gl = {2e-3, "this normal is exact in halves, roughness and alpha are rounded to 2^-11"};
    add("sss: roughness 0, a normal that halves round", kPeak, [] {
        const glm::vec3 n = glm::normalize(glm::vec3(0.31f, -0.2f, 0.8f));
        return wall(n, 0, 0, 2 * n.z * n - glm::vec3(0, 0, 1));
    })->gl = {0.2, "normals in halves err by 5e-4, whose square is a tenth of alpha^2"};
    add("sss: roughness 0, light and eye grazing", kPeak, [] { return wall({0, 0, 1}, 0, 0, {-1, 0, 0.01f}, {2, 0, 0.02}); })->gl = {0.5, "normals in halves err by 5e-4, a third of the highlight's width"};
    add("sss: roughness 1 at a grazing angle", kRounding, [] { return wall({0, 0, 1}, 1, 0, {1, 0, 1e-3f}, {2, 0, 0.02}); });
    add("sss: black metal and white metal", kRounding, [] {
        Scene scene = sssScene(60, false, 3);
        for (size_t i = 0; i < 60; ++i) {
            channel(scene, "material")[2 * i + 1] = 1;
            for (size_t c = 0; c < 3; ++c) channel(scene, "baseColor")[3 * i + c] = float(i % 2);
        }
        return scene;
    });
    add("sss: a light behind the surface", kRounding, [] { return wall({0, 0, 1}, 0.5f, 0, {0, 0.5f, -1}); })->known = {{4, 4, 0, 0}, {4, 4, 2, 0}};
    add("sss: normals that cancel", {2e-3, "a blended normal of length 1e-3 is rounded by 1e-4 of itself"}, cancelling)->gl = {2e-2, "a blended normal of length 0.1 in halves errs by 2^-11 of 1"};
    add("sss: 5,000 layers on one pixel", {2e-3, "5,000 products of 1 - alpha, and a pixel ends at a transmittance of 1e-4"}, [] {
        Scene scene = sssScene(5000, false, 8);
        for (size_t i = 0; i < 5000; ++i) scene.asset.cloud.positions[i] *= glm::vec3(0.01f, 0.01f, 1), scene.asset.cloud.opacities[i] = 0.01f;
        scene.camera = cameraAt({0, 0, 2}, glm::dvec3(0), 9);
        return scene;
    })->gl = {0.1, "some 500 layers are added up in halves, each rounded to 2^-11 of the sum"};
    add("sss: intensity 1e12", kRounding, [] { return cloud({pointLight({1, 1, 2}, 1e12f)}); });
    add("sss: intensities 0, 1e-12, 1 and 1e12 together", kRounding,
        [] { return cloud({pointLight({1, 1, 2}, 0), pointLight({-1, 1, 2}, 1e-12f), directionalLight({0, 1, 0}, 1), pointLight({0, -1, 2}, 1e12f)}); });
    add("sss: light of 1e15 at a distance of 1e8", kRounding, [] { return cloud({pointLight({0, 1e8f, 0}, 1e15f)}); });
    add("sss: light on the mean of a splat", {1e-4, "its neighbours are 1e6 times as dark: rounding is that of one splat"}, [] {
        Scene scene = cloud({});
        scene.lights = {pointLight(scene.asset.cloud.positions[5], 1e-4f)};
        return scene;
    });
    add("sss: roughness 0 under a sun of 0.3 radians", kRounding, [] {
        Scene scene = wall({1, 0, 1}, 0, 0, {1, 0, 0});
        scene.lights[0].radius = 0.3f;
        return scene;
    });
    add("sss: light in the cloud", {1e-3, "a pixel's surface may lie within 1e-2 of the light"}, [] { return cloud({pointLight({0.01f, 0.02f, 0}, 0.01f)}); });
    add("sss: camera in the cloud", {1.0 / 255 + 1e-3, "rounding decides whether a splat at the threshold of 1/255 is counted"}, [] {
        Scene scene = sssScene(300, true, 4);
        scene.camera = cameraAt({0, 0, 0}, {0.3, 0.2, -1});
        return scene;
    });
    add("sss: network of weights 100 times as large", {1e-3, "logistic functions of sums of some 1e4 that cancel"}, [] { return networkTimes(100); })->gl = {2e-2, "the G-buffer is blended in halves, and so are sums of the network"};
    add("sss: positions 1e6 boxes away", kRounding, [] {
        Scene scene = sssScene(60, true, 3);
        channel(scene, "network")[kSssWeights + 3] = 4e6f;
        return scene;
    })->bound = {2e-2, "a position of 1e4 in units of its code's longest wave is rounded to 1e-3 of it, and 1e-2 of the shortest"};
    add("sss: half overflow, 1e12 in a half target", {1e-3, "a half has 11 bits"}, [] {
        Scene scene = cloud({pointLight({1, 1, 2}, 1e12f)});
        scene.halfTarget = true;
        return scene;
    })->gl = kHalves;
    return cases;
}

} // namespace nacre::selftest
