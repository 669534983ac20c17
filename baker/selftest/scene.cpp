#include "selftest/scene.h"

#include "appearance/bigs/bigs.h"
#include "appearance/sss/sss_asset.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cassert>
#include <cmath>

namespace nacre::selftest {

Camera cameraAt(glm::dvec3 eye, glm::dvec3 target, int size, double focal)
{
    Camera c;
    c.width = c.height = size;
    c.fx = c.fy = focal, c.cx = c.cy = 0.5 * size;
    const bool upright = std::abs(glm::normalize(target - eye).y) > 0.99;
    c.worldFromCamera = glm::inverse(glm::lookAt(eye, target, upright ? glm::dvec3(0, 0, 1) : glm::dvec3(0, 1, 0)));
    return c;
}

Light pointLight(glm::vec3 position, float intensity, float radius)
{
    Light light;
    light.position = position, light.intensity = glm::vec3(intensity), light.radius = radius;
    return light;
}

Light directionalLight(glm::vec3 towards, float irradiance, float angularRadius)
{
    Light light;
    light.type = LightType::kDirectional;
    light.directionToLight = glm::normalize(towards), light.intensity = glm::vec3(irradiance), light.radius = angularRadius;
    return light;
}

float powerOfTen(Random& random, float low, float high) { return std::pow(10.0f, between(random, low, high)); }

glm::vec3 randomDirection(Random& random)
{
    const float z = between(random, -1, 1), phi = between(random, 0, 6.2831853f), r = std::sqrt(std::max(0.0f, 1 - z * z));
    return {r * std::cos(phi), r * std::sin(phi), z};
}

glm::quat randomRotation(Random& random)
{
    const glm::vec3 axis = randomDirection(random);
    const float half = between(random, 0, 3.1415926f);
    return glm::normalize(glm::quat(std::cos(half), std::sin(half) * axis));
}

static float onGrid(float x) { return std::round(1024.0f * x) / 1024.0f; }

static SplatCloud ball(Random& random, size_t count)
{
    SplatCloud cloud;
    cloud.count = count;
    for (size_t i = 0; i < count; ++i) {
        cloud.positions.push_back(0.5f * std::cbrt(random.uniform()) * randomDirection(random));
        cloud.rotations.push_back(randomRotation(random));
        cloud.scales.push_back(0.05f * glm::vec3(between(random, 0.2f, 1), between(random, 0.2f, 1), between(random, 0.2f, 1)));
        cloud.opacities.push_back(between(random, 0.05f, 1));
    }
    return cloud;
}

static Channel rows(const char* name, size_t count, uint32_t components, auto value, bool perAsset = false)
{
    Channel c{name, components, {}, {}, perAsset};
    for (size_t i = 0; i < (perAsset ? 1 : count); ++i)
        for (uint32_t k = 0; k < components; ++k) c.values.push_back(value(k));
    return c;
}

static Channel maps(Random& random, size_t count)
{
    Channel c{"visibility", kVisibilityTexels, {}, {}};
    for (size_t i = 0; i < count * kVisibilityTexels; ++i) c.bytes.push_back(uint8_t(random.below(256)));
    return c;
}

static Scene lamplit(SplatCloud cloud, const char* model)
{
    Scene scene;
    scene.asset.model = model, scene.asset.cloud = std::move(cloud);
    scene.camera = cameraAt({0.3, 0.2, 2});
    scene.lights = {pointLight({1, 1, 2}, 3)};
    return scene;
}

Scene bigsScene(size_t count, int functions, uint64_t seed)
{
    Random random(seed);
    Scene scene = lamplit(ball(random, count), "bigs");
    const auto around = [&](float middle, float size) { return onGrid(middle + between(random, -size, size)); };
    scene.asset.channels = {rows("tDir", count, 25, [&](uint32_t k) { return k == 0 ? around(1.5f, 0.3f) : around(0, 0.2f); }),
                            rows("tInd", count, 75, [&](uint32_t k) { return k < 3 ? around(0.3f, 0.1f) : around(0, 0.1f); }),
                            rows("rho", count, 3, [&](uint32_t) { return around(0.5f, 0.4f); })};
    if (functions > 0) scene.asset.channels.push_back(rows("s", count, uint32_t(3 * bigsPairCount(functions)), [&](uint32_t) { return around(0, 0.1f); }));
    return scene;
}

Scene sharpScene(size_t count, int functions, uint64_t seed)
{
    Scene scene = bigsScene(count, functions, seed);
    Random random(seed, 1);
    Channel lobe{"lobe", kBigsLobeFloats, {}, {}}, forward{"forward", kBigsForwardFloats, {}, {}}, shadow{"shadow", 1, {}, {}};
    for (size_t i = 0; i < count; ++i) {
        const glm::vec3 n = randomDirection(random);
        lobe.values.insert(lobe.values.end(), {n.x, n.y, n.z, powerOfTen(random, -1, 3)});
        forward.values.push_back(powerOfTen(random, -1, 2));
        for (int c = 0; c < 3; ++c) lobe.values.push_back(onGrid(between(random, 0, 2))), forward.values.push_back(onGrid(random.uniform()));
        shadow.values.push_back(onGrid(random.uniform()));
    }
    for (Channel c : {lobe, forward, maps(random, count), shadow}) scene.asset.channels.push_back(std::move(c));
    return scene;
}

Scene sssScene(size_t count, bool network, uint64_t seed)
{
    Random random(seed);
    Scene scene = lamplit(ball(random, count), "sss");
    const auto share = [&](uint32_t) { return onGrid(random.uniform()); };
    Channel normal{"normal", 3, {}, {}};
    for (size_t i = 0; i < count; ++i) {
        const glm::vec3 n = glm::normalize(scene.asset.cloud.positions[i] + 0.1f * randomDirection(random) + glm::vec3(0, 0, 1e-3f));
        normal.values.insert(normal.values.end(), {n.x, n.y, n.z});
    }
    scene.asset.channels = {rows("baseColor", count, 3, share),
                            rows("material", count, network ? 3 : 2, [&](uint32_t k) { return k == 0 ? onGrid(between(random, 0.3f, 1)) : share(k); }), normal};
    if (!network) return scene;
    const auto weight = [&](uint32_t) { return onGrid(between(random, -0.4f, 0.4f)); };
    Channel weights = rows("network", 0, kSssWeights, weight, true);
    weights.values.insert(weights.values.end(), {0, 0, 0, 2});
    weights.components = kSssNetworkFloats;
    scene.asset.channels.push_back(maps(random, count));
    scene.asset.channels.push_back(std::move(weights));
    scene.asset.channels.push_back(rows("code", count, kSssCodeInputs, [&](uint32_t) { return onGrid(between(random, -1, 1)); }));
    scene.asset.channels.push_back(rows("codeWeights", 0, kSssHidden1 * kSssCodeInputs, weight, true));
    return scene;
}

Scene matteSplat(float scale, float opacity, float rho)
{
    Scene scene = bigsScene(1, 0);
    scene.asset.cloud.positions = {glm::vec3(0)}, scene.asset.cloud.rotations = {glm::quat(1, 0, 0, 0)};
    scene.asset.cloud.scales = {glm::vec3(scale)}, scene.asset.cloud.opacities = {opacity};
    fill(scene, "tDir", 0), fill(scene, "tInd", 0), fill(scene, "rho", rho);
    channel(scene, "tDir")[0] = 3.5449077f; // 1 / y_0
    scene.camera = cameraAt({0, 0, 2});
    scene.lights = {directionalLight({0, 0, 1}, 1)};
    return scene;
}

std::vector<float>& channel(Scene& scene, const char* name)
{
    const auto found = std::find_if(scene.asset.channels.begin(), scene.asset.channels.end(), [&](const Channel& c) { return c.name == name; });
    assert(found != scene.asset.channels.end());
    return found->values;
}

void fill(Scene& scene, const char* name, float value)
{
    std::vector<float>& values = channel(scene, name);
    std::fill(values.begin(), values.end(), value);
}

} // namespace nacre::selftest
