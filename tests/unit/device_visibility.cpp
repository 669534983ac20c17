// Visibility maps drawn on a device: those of the CPU but for rounding. Each value is a product of up to hundreds of factors, whose
// exponential the CPU takes to 1e-5; at the border between two bytes that is a step of one.
#include "appearance/trainable.h"
#include "device/visibility.h"

#include <doctest/doctest.h>

#include <cstdlib>
#include <random>
#include <vector>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 17}};

std::vector<GaussianGeometry<float>> cloud(size_t count, uint32_t seed)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(-1, 1);
    std::vector<GaussianGeometry<float>> splats(count);
    for (GaussianGeometry<float>& g : splats) {
        for (int k = 0; k < 3; ++k) g.position[k] = 5 + 3 * uniform(random), g.scale[k] = 0.12f * std::exp(uniform(random));
        for (float& q : g.rotation) q = uniform(random);
        g.opacity = 0.5f + 0.49f * uniform(random);
    }
    return splats;
}

void checkMaps(const std::vector<GaussianGeometry<float>>& splats, int size, int oversample, std::span<const glm::vec3> lights)
{
    const std::vector<uint8_t> expected = lightVisibility(splats, size, oversample, lights);
    std::vector<uint8_t> first;
    for (const Emulation& order : kOrders) {
        Device device(order);
        DeviceVisibility visibility;
        const std::vector<uint8_t> maps = visibility.draw(device, splats, size, oversample, lights);
        REQUIRE(maps.size() == expected.size());
        size_t steps = 0;
        int most = 0;
        for (size_t i = 0; i < maps.size(); ++i) steps += maps[i] != expected[i], most = std::max(most, std::abs(int(maps[i]) - int(expected[i])));
        CHECK(most <= 1);
        CHECK(steps * 100 <= maps.size());
        if (first.empty()) first = maps;
        CHECK(maps == first);
    }
}

} // namespace

TEST_CASE("visibility maps of a device are those of the CPU within one byte, the same in each order of threads")
{
    checkMaps(cloud(150, 1), 8, 1, {});
    checkMaps(cloud(60, 2), 4, 2, {});
}

TEST_CASE("lights among the splats are seen on a device as far as they are")
{
    std::vector<GaussianGeometry<float>> splats = cloud(120, 3);
    const glm::vec3 lights[] = {{5, 5, 5}, {4, 6, 5.5f}, {500, 0, 0}};
    checkMaps(splats, 8, 1, lights);
    CHECK(lightVisibility(splats, 8, 1, lights) != lightVisibility(splats, 8, 1));
}

TEST_CASE("visibility on a device of one splat, of huge and of flat ones, of none")
{
    std::vector<GaussianGeometry<float>> splats = cloud(40, 4);
    splats[5].scale[0] = splats[5].scale[1] = 300, splats[9].opacity = 0, splats[11].scale[2] = 1e-12f;
    splats[12].position[0] = 4000; // beside the image of the rest
    checkMaps(splats, 4, 1, {});
    splats.resize(1);
    checkMaps(splats, 4, 1, {});
    Device device;
    CHECK(DeviceVisibility().draw(device, {}, 4, 1).empty());
}

TEST_CASE("models take their visibility from who draws it, of the splats that shade each other alone")
{
    const std::vector<GaussianGeometry<float>> splats = cloud(30, 5);
    for (const char* name : {"bigs", "sss"}) {
        AppearanceOptions options;
        options.region = {5, 5, 5, 2.5f}; // of 6 around
        const std::unique_ptr<TrainableAppearance> model = makeTrainableAppearance(name, options);
        model->resize(splats.size());
        size_t drawn = 0;
        model->setVisibilityDrawer([&](std::span<const GaussianGeometry<float>> some, int size, int, std::span<const glm::vec3>) {
            drawn += some.size();
            return std::vector<uint8_t>(some.size() * size_t(size * size), 9);
        });
        const HostGeometry geometry = [&] { return std::span<const GaussianGeometry<float>>(splats); };
        CHECK(model->prepareStep(0.5, geometry, {}));
        CHECK(drawn > 0);
        CHECK(drawn < splats.size());
    }
}
