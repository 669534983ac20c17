#include "selftest/random_scenes.h"

#include <algorithm>
#include <cmath>

namespace nacre::selftest {

static bool oneIn(Random& random, uint32_t n) { return random.below(n) == 0; }

/// Ends of the range more often than chance would have them.
static float share(Random& random)
{
    if (oneIn(random, 4)) return 0;
    if (oneIn(random, 4)) return 1;
    return oneIn(random, 4) ? powerOfTen(random, -8, 0) : random.uniform();
}

static void makeExtreme(SplatCloud& cloud, Random& random)
{
    const bool needles = oneIn(random, 3), dust = oneIn(random, 3), clump = oneIn(random, 5);
    for (size_t i = 0; i < cloud.count; ++i) {
        glm::vec3& scale = cloud.scales[i];
        if (dust) scale *= powerOfTen(random, -6, 6);
        if (needles) // condition of the covariance up to 1e10
            for (int k = 0; k < 3; ++k) scale[k] *= powerOfTen(random, -2.5f, 2.5f);
        if (oneIn(random, 30)) scale *= 1e-38f;
        scale = glm::max(scale, glm::vec3(1e-40f));
        if (clump) cloud.positions[i] = cloud.positions[0];
        else if (oneIn(random, 10)) cloud.positions[i] *= powerOfTen(random, 0, 8);
        cloud.opacities[i] = share(random);
    }
}

static Light randomLight(const Scene& scene, Random& random)
{
    const float intensity = oneIn(random, 8) ? 0 : powerOfTen(random, -12, 12);
    if (oneIn(random, 4)) return directionalLight(randomDirection(random), intensity);
    glm::vec3 at = powerOfTen(random, -6, 8) * randomDirection(random);
    if (oneIn(random, 4)) at = scene.asset.cloud.positions[random.below(uint32_t(scene.asset.cloud.count))]; // on a mean
    return pointLight(at, intensity, oneIn(random, 2) ? 0 : powerOfTen(random, -6, 2));
}

static Camera randomCamera(const Scene& scene, Random& random)
{
    glm::dvec3 eye = glm::dvec3(randomDirection(random)) * double(powerOfTen(random, -3, 2));
    if (oneIn(random, 8)) eye = scene.asset.cloud.positions[random.below(uint32_t(scene.asset.cloud.count))];
    const glm::dvec3 target = oneIn(random, 4) ? eye + glm::dvec3(randomDirection(random)) : glm::dvec3(0);
    if (glm::distance(eye, target) < 1e-9) return cameraAt(eye, eye + glm::dvec3(0, 0, -1), 9, 8);
    const double wide = glm::length(eye) < 1 ? 5 : 9 * glm::length(eye); // the ball about fills the frame
    return cameraAt(eye, target, 9, wide * double(powerOfTen(random, -0.5f, 0.5f)));
}

/// Materials and peaks at their ends; coefficients of both signs stay as they are.
static void makeExtreme(Scene& scene, Random& random)
{
    for (Channel& c : scene.asset.channels) {
        if (c.name == "material" || c.name == "baseColor")
            for (float& v : c.values) v = oneIn(random, 2) ? share(random) : v;
        if (c.name == "lobe")
            for (size_t i = 3; i < c.values.size(); i += 7) c.values[i] = oneIn(random, 4) ? 0 : powerOfTen(random, -4, 4);
        if (c.name == "forward")
            for (size_t i = 0; i < c.values.size(); i += 4) c.values[i] = oneIn(random, 4) ? 0 : powerOfTen(random, -4, 4);
        if (c.name == "rho" || c.name == "tDir" || c.name == "s") {
            const float factor = oneIn(random, 4) ? powerOfTen(random, -3, 3) : 1;
            for (float& v : c.values) v *= factor;
        }
    }
}

Scene randomScene(uint64_t seed, uint64_t index)
{
    Random random(seed, index);
    const size_t count = 1 + random.below(24);
    static constexpr int kFunctions[] = {0, 1, 4, 9};
    const int functions = kFunctions[random.below(4)];
    const uint64_t own = random.next();
    Scene scene = oneIn(random, 4) ? sssScene(count, oneIn(random, 2), own) : oneIn(random, 2) ? sharpScene(count, functions, own) : bigsScene(count, functions, own);
    makeExtreme(scene.asset.cloud, random);
    makeExtreme(scene, random);
    if (oneIn(random, 8)) scene.asset.lowPassVariance = oneIn(random, 2) ? 0 : powerOfTen(random, -6, 1);
    scene.lights.clear();
    for (uint32_t l = 0, lights = 1 + random.below(4); l < lights; ++l) scene.lights.push_back(randomLight(scene, random));
    scene.camera = randomCamera(scene, random);
    return scene;
}

} // namespace nacre::selftest
