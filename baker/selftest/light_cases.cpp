// Where lights are and how bright.
#include "selftest/cases.h"

namespace nacre::selftest {

static constexpr const char* kImageOf = "colour, alpha";
static constexpr Bound kRounding{1e-5, "float32 rounds each of some 100 steps by 6e-8"};

static Scene litBy(Scene scene, std::vector<Light> lights)
{
    scene.lights = std::move(lights);
    return scene;
}
static Scene cloudLitBy(std::vector<Light> lights) { return litBy(sharpScene(60, 9, 3), std::move(lights)); }

std::vector<Case> lightCases()
{
    std::vector<Case> cases;
    const auto add = [&](const char* name, Bound bound, auto scene) { return &cases.emplace_back(Case{.name = name, .quantity = kImageOf, .bound = bound, .scene = scene}); };
    const double solid = 0.5 * 36 / (36 + double(0.1f)); // alpha of a ball of 0.3 at opacity 0.5, which sends back a half

    add("light on the mean of a splat: 1/r^2 ends at the least radius", kRounding, [] { return litBy(matteSplat(0.3f, 0.5f), {pointLight({0, 0, 0}, 1e-6f)}); })->known = {{16, 16, 0, 0.5 * solid}};
    add("light 1e-5 from the mean of a splat", kRounding, [] { return litBy(matteSplat(0.3f, 0.5f), {pointLight({0, 1e-5f, 0}, 1e-6f)}); })->known = {{16, 16, 0, 0.5 * solid}};
    add("light in a splat, nearer than its own radius", kRounding, [] { return litBy(matteSplat(0.3f, 0.5f), {pointLight({0.1f, 0, 0}, 0.25f, 0.5f)}); })->known = {{16, 16, 0, 0.5 * solid}};
    add("light on the mean of a splat with all channels", {1e-4, "its neighbours are 1e6 times as dark: rounding is that of one splat"}, [] {
        Scene scene = cloudLitBy({});
        scene.lights = {pointLight(scene.asset.cloud.positions[5], 1e-4f)};
        return scene;
    });
    add("light in the cloud", kRounding, [] { return litBy(bigsScene(200, 9, 4), {pointLight({0.01f, 0.02f, 0}, 0.01f)}); });
    add("light of 1e12 at a distance of 1e6 is a sun of 1", {1e-5, "parallax of 1e-6"}, [] { return cloudLitBy({pointLight({0, 0, 1e6f}, 1e12f)}); })->like = [] { return cloudLitBy({directionalLight({0, 0, 1}, 1)}); };
    add("light of 1e15 at a distance of 1e8 is a sun of 0.1", {1e-5, "parallax of 1e-8"}, [] { return cloudLitBy({pointLight({0, 1e8f, 0}, 1e15f)}); })->like = [] { return cloudLitBy({directionalLight({0, 1, 0}, 0.1f)}); };
    add("intensity 0", {0, "exactly black"}, [] { return cloudLitBy({pointLight({1, 1, 2}, 0)}); })->exactColor = true;
    add("intensity 1e-12", kRounding, [] { return cloudLitBy({pointLight({1, 1, 2}, 1e-12f)}); });
    add("intensity 1e12", kRounding, [] { return cloudLitBy({pointLight({1, 1, 2}, 1e12f)}); });
    add("intensities 0, 1e-12, 1 and 1e12 together", kRounding, [] {
        return cloudLitBy({pointLight({1, 1, 2}, 0), pointLight({-1, 1, 2}, 1e-12f), directionalLight({0, 1, 0}, 1), pointLight({0, -1, 2}, 1e12f)});
    });
    add("four lights at one place are one four times as bright", kRounding, [] {
        return cloudLitBy(std::vector<Light>(4, pointLight({1, 1, 2}, 1)));
    })->like = [] { return cloudLitBy({pointLight({1, 1, 2}, 4)}); };
    add("a sun of 0.3 radians, and one of 1e-6", kRounding, [] { return cloudLitBy({directionalLight({1, 1, 2}, 1, 0.3f), directionalLight({-1, 1, 2}, 1, 1e-6f)}); });
    add("light in the eye", kRounding, [] {
        Scene scene = cloudLitBy({});
        scene.lights = {pointLight(glm::vec3(scene.camera.position()), 3)};
        return scene;
    });
    add("light opposite the eye: no half vector", {1e-4, "directions a few 1e-4 apart decide whether there is one"}, [] {
        Scene scene = cloudLitBy({});
        scene.lights = {pointLight(-glm::vec3(scene.camera.position()), 3)};
        return scene;
    });
    for (Case& c : cases) c.gl = {3e-3, "visibility of splats with a lobe passes between two passes as a half: 2^-12 of highlights"};
    return cases;
}

} // namespace nacre::selftest
