// Where splats are and what shape they have.
#include "selftest/cases.h"

#include "base/exact_position.h"
#include "splats/blend.h"

#include <cmath>

namespace nacre::selftest {

static constexpr const char* kImageOf = "colour, alpha";
// float32 has 24 bits: 6e-8 a step. A few dozen steps lie between a splat and a pixel, and layers add theirs.
static constexpr Bound kRounding{1e-5, "float32 rounds each of some 100 steps by 6e-8"};
// exp(-q / 2) of a thin splat at a pixel far from its centre: q is a difference of large terms.
static constexpr Bound kThin{1e-3, "q is a difference of terms some 1e3 times as large, at 6e-8 of them"};
static constexpr Bound kThreshold{1.0 / 255 + 1e-4, "rounding decides whether a splat at the threshold of 1/255 is counted"};

/// Splats of random directions whose axes are so long.
static Scene shaped(glm::vec3 scale, float opacity = 0.9f, size_t count = 60)
{
    Scene scene = bigsScene(count, 4, 3);
    for (size_t i = 0; i < count; ++i) scene.asset.cloud.scales[i] = scale, scene.asset.cloud.opacities[i] = opacity;
    return scene;
}

static Scene scaledBy(Scene scene, float low, float high)
{
    Random random(5);
    for (glm::vec3& s : scene.asset.cloud.scales)
        for (int k = 0; k < 3; ++k) s[k] *= powerOfTen(random, low, high);
    return scene;
}

/// The same scene in other units and from another origin, as a host of a dataset states them.
static Scene throughFrame(double scale, glm::dvec3 translation)
{
    Scene scene = bigsScene(60, 4, 3);
    const AssetFrame frame{scale, translation, 1};
    scene.camera.worldFromCamera[3] = glm::dvec4(frame.positionInDataset(scene.camera.position()), 1.0);
    scene.camera = cameraInAsset(frame, scene.camera);
    for (Light& light : scene.lights) {
        const glm::dvec3 exact = frame.positionInDataset(light.position);
        light = lightInDataset(frame, light);
        setExactPosition(light, exact);
        light = lightInAsset(frame, light);
    }
    return scene;
}

static Scene movedBy(double scale, glm::vec3 by)
{
    Scene scene = bigsScene(60, 4, 3);
    SplatCloud& cloud = scene.asset.cloud;
    for (size_t i = 0; i < cloud.count; ++i) cloud.positions[i] = float(scale) * cloud.positions[i] + by, cloud.scales[i] *= float(scale);
    scene.camera.worldFromCamera[3] = glm::dvec4(scale * scene.camera.position() + glm::dvec3(by), 1.0);
    scene.lights[0].position = float(scale) * scene.lights[0].position + by;
    scene.lights[0].intensity *= float(scale * scale);
    return scene;
}

/// Discs that lie in planes through the eye, but for `tilt`.
static Scene edgeOn(double tilt)
{
    Scene scene = bigsScene(40, 4, 4);
    scene.camera = cameraAt({0, 0, 2});
    for (size_t i = 0; i < scene.asset.cloud.count; ++i) {
        scene.asset.cloud.positions[i] *= glm::vec3(0, 1, 1); // in the plane x = 0, whose discs have the normal x
        const float half = float(0.5 * (1.5707963 - tilt));
        scene.asset.cloud.rotations[i] = glm::quat(std::cos(half), 0, std::sin(half), 0);
        scene.asset.cloud.scales[i] = glm::vec3(0.1f, 0.1f, 1e-4f), scene.asset.cloud.opacities[i] = 0.9f;
    }
    return scene;
}

/// A ball of `scale` two units before the camera: standard deviation and low-pass in pixels give its alpha.
static std::vector<Known> onAxis(float scale, float opacity, float rho)
{
    const double variance = std::pow(40.0 * double(scale) / 2.0, 2), v = double(0.1f);
    const double alpha = std::min(double(kMaxAlpha), double(opacity) * variance / (variance + v));
    return {{16, 16, 0, double(rho) * alpha}, {16, 16, 3, alpha}};
}

static Scene nothingBefore(float z)
{
    Scene scene = bigsScene(60, 4, 3);
    for (size_t i = 0; i < 60; ++i) scene.asset.cloud.positions[i].z = z;
    return scene;
}
static const std::vector<Known> kEmpty = {{16, 16, 0, 0}, {16, 16, 3, 0}, {3, 29, 1, 0}};

std::vector<Case> projectionCases()
{
    std::vector<Case> cases;
    const auto add = [&](const char* name, Bound bound, auto scene) { return &cases.emplace_back(Case{.name = name, .quantity = kImageOf, .bound = bound, .scene = scene}); };

    add("one splat on the axis", kRounding, [] { return matteSplat(0.1f, 0.8f); })->known = onAxis(0.1f, 0.8f, 0.5f);
    add("a splat of a tenth of a pixel fades with its area", kRounding, [] { return matteSplat(5e-3f, 1); })->known = onAxis(5e-3f, 1, 0.5f);
    add("condition 1e4: discs", kThin, [] { return shaped({0.1f, 0.1f, 1e-3f}); });
    add("condition 1e8: needles 200 pixels long", kThin, [] { return shaped({10, 1e-3f, 1e-3f}); });
    add("condition 1e10: needles across the scene", kThin, [] { return shaped({50, 5e-4f, 5e-4f}); });
    add("condition 1e10: discs", kThin, [] { return shaped({0.5f, 0.5f, 5e-6f}, 0.1f); });
    add("condition 1e8 without a low-pass", {1, "a conic of condition 1e8 has more digits than float32: pixels of a needle of 1e-3 pixels are chance, but in [0, 1]"}, [] {
        Scene scene = shaped({1, 1e-4f, 1e-4f});
        scene.asset.lowPassVariance = 0;
        return scene;
    })->gl = {5e-2, "the root of the covariance has half the digits of the conic"};
    add("no low-pass", kThreshold, [] {
        Scene scene = shaped({0.05f, 0.05f, 0.02f}, 0.5f);
        scene.asset.lowPassVariance = 0;
        return scene;
    });
    add("scales of 1e-6 of the scene: nothing is left", {0, "opacity is in proportion to the area: 1e-9"}, [] { return shaped(glm::vec3(1e-6f)); })->known = kEmpty;
    add("a splat 1e6 times the scene around the camera", kRounding, [] { return matteSplat(1e6f, 0.5f); })->known = {{0, 0, 3, 0.5}, {16, 16, 0, 0.25}, {32, 5, 1, 0.25}};
    add("scales of 1e-6 to 1e6 side by side", kThreshold, [] { return scaledBy(bigsScene(120, 4, 7), -6, 6); });
    add("axes of 1e-5 to 1e5 in one splat", kThreshold, [] { return scaledBy(bigsScene(120, 4, 8), -5, 5); });
    add("quaternions of length 1e-15 and 0", kRounding, [] {
        Scene scene = bigsScene(40, 4, 3);
        for (size_t i = 0; i < 40; ++i) scene.asset.cloud.rotations[i] *= i % 2 ? 0.0f : 1e-15f;
        return scene;
    })->mayRefuse = true;
    add("quaternions rounded to 1e-3 of a unit", kRounding, [] {
        Scene scene = bigsScene(40, 4, 3);
        for (size_t i = 0; i < 40; ++i) scene.asset.cloud.rotations[i] *= i % 2 ? 0.9992f : 1.0008f;
        return scene;
    });
    add("centres at the near plane and before it", kThreshold, [] {
        Scene scene = bigsScene(60, 4, 3);
        for (size_t i = 0; i < 60; ++i) { // in steps of 1e-4 from 3e-3 before the near plane to 3e-3 beyond
            scene.asset.cloud.positions[i] = {0.002f * float(i % 7) - 0.006f, 0.002f * float(i % 5) - 0.004f, -kNearPlane - 1e-4f * (float(i) - 29.5f)};
            scene.asset.cloud.scales[i] = glm::vec3(1e-3f), scene.asset.cloud.opacities[i] = 0.3f;
        }
        scene.camera = cameraAt({0, 0, 0}, {0, 0, -1});
        return scene;
    });
    add("all splats behind the camera", {0, "nothing is drawn"}, [] { return nothingBefore(3); })->known = kEmpty;
    add("camera in the cloud", kThreshold, [] {
        Scene scene = bigsScene(300, 9, 4);
        scene.camera = cameraAt({0, 0, 0}, {0.3, 0.2, -1});
        return scene;
    });
    add("camera on the mean of a splat", kThreshold, [] {
        Scene scene = sharpScene(60, 9, 4);
        scene.camera = cameraAt({0.05, -0.02, 0.01}, {0.3, 0.2, -1});
        scene.asset.cloud.positions[0] = scene.camera.position();
        return scene;
    });
    add("grazing view: discs seen edge on", kThin, [] { return edgeOn(0); });
    add("grazing view: discs 0.01 degrees from edge on", kThin, [] { return edgeOn(1.7e-4); });
    add("wide angle: splats beside and behind the frame's edge", kThreshold, [] {
        Scene scene = bigsScene(200, 4, 6);
        scene.camera = cameraAt({0, 0, 0.4}, {0, 0.1, 0}, 33, 8);
        return scene;
    });
    add("telescope: focal length 1e5 pixels at 5,000 units", {5e-3, "the view's translation of 5,000 is rounded by 2.4e-4, 5e-3 pixels"}, [] {
        Scene scene = bigsScene(60, 4, 3);
        scene.camera = cameraAt({0, 0, 5000}, {0, 0, 0}, 33, 1e5);
        return scene;
    });
    add("in a dataset 1e6 units from the origin", kRounding, [] { return throughFrame(1, {1e6, -1e6, 1e6}); })->like = [] { return bigsScene(60, 4, 3); };
    add("in a dataset of units of 1e-6", kRounding, [] { return throughFrame(1e-6, {1, 2, 3}); })->like = [] { return bigsScene(60, 4, 3); };
    add("in a dataset of units of 1e6", kRounding, [] { return throughFrame(1e6, {1, 2, 3}); })->like = [] { return bigsScene(60, 4, 3); };
    add("an asset 1e6 units large", kRounding, [] { return movedBy(1e6, glm::vec3(0)); })->like = [] { return bigsScene(60, 4, 3); };
    add("an asset of 1e3 units at coordinates of 1e6", {2e-2, "rotating and moving 1e6 rounds by some 0.2 units, of splats of 10"}, [] { return movedBy(1e3, {1e6f, -1e6f, 1e6f}); });
    return cases;
}

} // namespace nacre::selftest
