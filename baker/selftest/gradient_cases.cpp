// The backward pass where the forward pass is at its ends.
#include "selftest/cases.h"

namespace nacre::selftest {

Scene layers(size_t count, float opacity); // blending_cases.cpp

std::vector<Case> gradientCases()
{
    std::vector<Case> cases;
    const auto add = [&](const char* name, Bound bound, auto scene) {
        cases.push_back({.name = std::string("gradient: ") + name, .quantity = "gradients", .kind = Kind::kGradients, .bound = bound, .scene = scene});
    };
    static constexpr Bound kRounding{1e-4, "float32 sums of some 1,000 pixels whose terms cancel"};
    const auto shaped = [](glm::vec3 scale) {
        Scene scene = bigsScene(40, 4, 3);
        for (glm::vec3& s : scene.asset.cloud.scales) s = scale;
        return scene;
    };

    add("a cloud", kRounding, [] { return bigsScene(60, 4, 3); });
    add("condition 1e4", {1e-4, "float32 sums of some 1,000 pixels whose terms cancel"}, [=] { return shaped({0.1f, 0.1f, 1e-3f}); });
    add("condition 1e8", {2e-3, "terms some 1e4 times the sum cancel, at 6e-8 of them"}, [=] { return shaped({10, 1e-3f, 1e-3f}); });
    add("splats of a hundredth of a pixel", {1e-4, "the slope of the compensation is 1 / scale, relative errors stay"}, [=] { return shaped({2e-3f, 1e-3f, 1.5e-3f}); });
    add("opacity 1: a capped splat feels no geometry where it is capped", {1e-3, "a pixel at the cap may fall on either side of it"}, [] {
        Scene scene = bigsScene(20, 0, 3);
        for (size_t i = 0; i < 20; ++i) scene.asset.cloud.opacities[i] = 1, scene.asset.cloud.scales[i] = {0.2f, 0.15f, 0.1f};
        return scene;
    });
    add("equal depths", kRounding, [] {
        Scene scene = bigsScene(20, 0, 3);
        for (size_t i = 0; i < 20; ++i) scene.asset.cloud.positions[i] = glm::vec3(0), scene.asset.cloud.opacities[i] = 0.2f;
        return scene;
    });
    add("5,000 faint layers", {1e-3, "what lies behind a splat is a difference of two sums of 5,000 terms, at 6e-8 each"}, [] { return layers(5000, 0.01f); });
    add("5,000 solid layers", {1e-3, "what lies behind a splat is a difference of two sums, and alpha is nearly 1"}, [] { return layers(5000, 1); });
    add("camera in the cloud", {1e-3, "splats near the camera are larger than the frame"}, [] {
        Scene scene = bigsScene(200, 4, 4);
        scene.camera = cameraAt({0, 0, 0}, {0.3, 0.2, -1});
        return scene;
    });
    add("intensity 1e12", kRounding, [] {
        Scene scene = bigsScene(60, 4, 3);
        scene.lights[0].intensity = glm::vec3(1e12f);
        return scene;
    });
    add("light on the mean of a splat", kRounding, [] {
        Scene scene = bigsScene(60, 4, 3);
        scene.lights = {pointLight(scene.asset.cloud.positions[5], 1)};
        return scene;
    });
    return cases;
}

} // namespace nacre::selftest
