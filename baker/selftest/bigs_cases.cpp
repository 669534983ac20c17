// Where the transport of bigs clamps, peaks and ends.
#include "selftest/cases.h"

#include "base/half.h"

namespace nacre::selftest {

static constexpr const char* kImageOf = "colour, alpha";
static constexpr Bound kRounding{1e-5, "float32 rounds each of some 100 steps by 6e-8"};

/// A splat that only shines: no transport but a lobe about `normal`.
static Scene mirror(glm::vec3 normal, float sharpness, glm::vec3 towardsLight)
{
    Scene scene = matteSplat(0.3f, 0.5f, 0);
    fill(scene, "tDir", 0);
    normal = glm::normalize(normal);
    scene.asset.channels.push_back({"lobe", 7, {normal.x, normal.y, normal.z, sharpness, 1, 0.5f, 0.25f}, {}});
    scene.lights = {directionalLight(towardsLight, 1)};
    return scene;
}

static Scene through(float sharpness)
{
    Scene scene = matteSplat(0.3f, 0.5f, 0);
    fill(scene, "tDir", 0);
    scene.asset.channels.push_back({"forward", 4, {sharpness, 1, 0.5f, 0.25f}, {}});
    scene.lights = {directionalLight({0.002f, 0.001f, -1}, 1)};
    return scene;
}

static Scene withEach(const char* name, float factor)
{
    Scene scene = bigsScene(60, 9, 3);
    for (float& v : channel(scene, name)) v *= factor;
    return scene;
}

/// All coefficients at the largest that can be drawn, under the brightest light on a mean.
static Scene largest(float signOfS)
{
    Scene scene = sharpScene(1, 25, 1);
    scene.asset.cloud.positions[0] = glm::vec3(0), scene.asset.cloud.scales[0] = glm::vec3(0.3f), scene.asset.cloud.opacities[0] = 0.5f;
    for (const char* name : {"tDir", "tInd", "s"}) fill(scene, name, kMaxHalf);
    for (float& v : channel(scene, "s")) v *= signOfS;
    scene.lights = {pointLight({0, 0, 0}, 1e15f)};
    return scene;
}

std::vector<Case> bigsCases()
{
    std::vector<Case> cases;
    const auto add = [&](const char* name, Bound bound, auto scene) { return &cases.emplace_back(Case{.name = name, .quantity = kImageOf, .bound = bound, .scene = scene}); };
    const double solid = 0.5 * 36 / (36 + double(0.1f));

    add("T_dir negative everywhere: clamped", {0, "exactly black"}, [] {
        Scene scene = matteSplat(0.3f, 0.5f);
        channel(scene, "tDir")[0] = -3;
        return scene;
    })->exactColor = true;
    add("rho + s negative everywhere: clamped", {0, "exactly black"}, [] { return matteSplat(0.3f, 0.5f, -1); })->exactColor = true;
    add("T_dir and rho of both signs", kRounding, [] {
        Scene scene = bigsScene(60, 25, 3);
        for (float& v : channel(scene, "rho")) v -= 0.5f;
        for (size_t i = 0; i < 60; i += 2) channel(scene, "tDir")[25 * i] = 0;
        return scene;
    });
    add("T_dir of 6e4 against rho + s of 1e-4", kRounding, [] {
        Scene scene = withEach("tDir", 3e4f);
        for (const char* name : {"rho", "s"})
            for (float& v : channel(scene, name)) v *= 1e-4f;
        return scene;
    })->gl = {2e-3, "coefficients of 1e-5 are subnormal halves"};
    add("s of 25 functions, each as large as a half float", {1e-4, "325 terms of both signs cancel"}, [] { return withEach("s", 6e5f); })->gl = {1e-3, "coefficients are stored as halves: 2^-12 of each"};
    add("the sharpest lobe at its peak", {2e-2, "sharpness 65504 times the rounding of 1 - (n.h)^2"}, [] { return mirror({1, 0, 1}, 65504, {1, 0, 0}); });
    add("the sharpest lobe 0.1 degrees off its peak", {2e-2, "sharpness 65504 times the rounding of 1 - (n.h)^2"}, [] { return mirror({1, 0, 1}, 65504, {1, 0.0035f, 0}); });
    add("a lobe of sharpness 0", kRounding, [] { return mirror({0, 0, 1}, 0, {1, 0, 1}); })->known = {{16, 16, 0, solid}};
    add("a lobe lit along its surface", kRounding, [] { return mirror({0, 0, 1}, 10, {1, 0, 1e-4f}); });
    add("a lobe before the light, which comes from behind the camera's side", {0, "exactly black"}, [] { return mirror({0, 0, -1}, 0, {0, 0, -1}); })->exactColor = true;
    add("forward light of sharpness 1e4, nearly straight", {1e-3, "sharpness 1e4 times the rounding of 1 + cos, 6e-8"}, [] { return through(1e4f); });
    add("forward light of sharpness 0", kRounding, [] { return through(0); })->known = {{16, 16, 0, solid}};
    add("the largest coefficients under 1e15 on the mean", kRounding, [] { return largest(1); });
    add("the largest coefficients, s negative", kRounding, [] { return largest(-1); });
    const struct { const char* name; glm::vec3 towards; } kFolds[] = {{"visibility maps on their fold", {1, 1, 0}}, {"visibility maps at a corner", {0, 0, -1}}, {"visibility maps on an axis", {-1, 0, 0}}};
    for (const auto& [name, towards] : kFolds) add(name, kRounding, [towards = towards] {
        Scene scene = sharpScene(60, 0, 3);
        scene.lights = {directionalLight(towards, 1)};
        return scene;
    })->gl = {3e-3, "visibility of splats with a lobe passes between two passes as a half: 2^-12 of highlights"};
    return cases;
}

} // namespace nacre::selftest
