// Environment maps as directional lights: no power lost, nothing turned round.
#include "eval/splat_renderer.h"

#include "interchange/exr.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <numbers>
#include <unistd.h>

using namespace nacre;
namespace fs = std::filesystem;

namespace {

/// Expands a map given by its texels.
std::vector<Light> expand(int width, int height, int count, const std::function<glm::vec3(int x, int y)>& radiance)
{
    Image map{width, height, {}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const glm::vec3 c = radiance(x, y);
            map.rgba.insert(map.rgba.end(), {c.r, c.g, c.b, 1.0f});
        }
    const fs::path path = fs::temp_directory_path() / ("nacre-environment-" + std::to_string(::getpid()) + ".exr");
    REQUIRE(writeExr(map, path.string()));
    Light light;
    light.type = LightType::kEnvironment;
    light.environmentPath = path.string();
    const auto lights = expandEnvironment(light, count);
    fs::remove(path);
    REQUIRE_MESSAGE(lights, (lights ? "" : lights.error().message));
    REQUIRE(lights->size() <= size_t(count));
    return *lights;
}

glm::dvec3 total(const std::vector<Light>& lights)
{
    glm::dvec3 sum(0.0);
    for (const Light& l : lights) sum += glm::dvec3(l.intensity);
    return sum;
}

} // namespace

TEST_CASE("constant map: irradiances sum to 4 pi L, and every cell gets its share")
{
    for (const auto& [width, height] : {std::pair(64, 32), std::pair(2, 1), std::pair(34, 17)})
        for (int count : {1, 2, 40, 256}) {
            CAPTURE(width);
            CAPTURE(count);
            const auto lights = expand(width, height, count, [](int, int) { return glm::vec3(1.0f, 0.5f, 0.0f); });
            const double sphere = 4 * std::numbers::pi;
            CHECK(total(lights).r == doctest::Approx(sphere).epsilon(1e-6)); // f32 irradiances
            CHECK(total(lights).g == doctest::Approx(sphere / 2).epsilon(1e-6));
            CHECK(total(lights).b == 0.0);
            for (const Light& l : lights) {
                CHECK(l.type == LightType::kDirectional);
                CHECK(l.intensity.r > 0.5 * sphere / count);
                CHECK(l.intensity.r < 1.5 * sphere / count);
                CHECK(glm::length(l.directionToLight) == doctest::Approx(1.0).epsilon(1e-6));
            }
        }
}

TEST_CASE("bright texel lights from where it is")
{
    struct Case {
        int x, y;
        glm::dvec3 direction;
    };
    // 64 x 32: image centre +X, a quarter from the left +Y, left and right edge -X, top row +Z.
    for (const Case& c : {Case{32, 16, {1, 0, 0}}, Case{16, 16, {0, 1, 0}}, Case{48, 16, {0, -1, 0}}, Case{0, 16, {-1, 0, 0}},
                          Case{63, 15, {-1, 0, 0}}, Case{10, 0, {0, 0, 1}}, Case{50, 31, {0, 0, -1}}}) {
        const auto lights = expand(64, 32, 100, [&](int x, int y) { return glm::vec3(x == c.x && y == c.y ? 100.0f : 0.0f); });
        glm::dvec3 mean(0.0);
        for (const Light& l : lights) mean += double(l.intensity.r) * glm::dvec3(l.directionToLight);
        CHECK(glm::dot(glm::normalize(mean), c.direction) > std::cos(0.08)); // half a texel's diagonal is 0.07 rad
        const double solidAngle =
            2 * std::numbers::pi / 64 * (std::cos(std::numbers::pi * c.y / 32) - std::cos(std::numbers::pi * (c.y + 1) / 32));
        CHECK(total(lights).r == doctest::Approx(100 * solidAngle).epsilon(1e-5)); // f32
    }
}

TEST_CASE("a cell is as wide as what shines in it: all of it under a constant sky, a point for a small sun")
{
    for (const int count : {32, 128, 512})
        for (const Light& l : expand(128, 64, count, [](int, int) { return glm::vec3(1.0f); }))
            CHECK(l.radius == doctest::Approx(2 / std::sqrt(count)).epsilon(0.25)); // a disc of 4 pi / count, not quite round
    const auto lights = expand(256, 128, 128, [](int x, int y) { return glm::vec3(x == 70 && y == 40 ? 1e7f : 1.0f); });
    const auto sun = std::max_element(lights.begin(), lights.end(), [](const Light& a, const Light& b) { return a.intensity.r < b.intensity.r; });
    CHECK(sun->radius < 0.02);
}

TEST_CASE("irradiance of a plane under a smooth map is kept")
{
    // L = 1 + z on the upper half: E of a plane facing +Z = integral of (1 + z) z over the hemisphere = 2 pi (1/2 + 1/3).
    const auto lights = expand(128, 64, 256, [](int, int y) {
        const double z = std::cos(std::numbers::pi * (y + 0.5) / 64);
        return glm::vec3(float(z > 0 ? 1 + z : 0));
    });
    double e = 0;
    for (const Light& l : lights) e += l.intensity.r * std::max(0.0f, l.directionToLight.z);
    CHECK(e == doctest::Approx(2 * std::numbers::pi * (0.5 + 1.0 / 3)).epsilon(0.005)); // cells of 0.2 rad, mean directions
}

TEST_CASE("other lights pass through, bad maps and counts are errors")
{
    Light light;
    light.intensity = {1, 2, 3};
    const auto same = expandEnvironment(light, 10);
    REQUIRE(same);
    REQUIRE(same->size() == 1);
    CHECK(same->front().intensity == light.intensity);
    light.type = LightType::kEnvironment;
    light.environmentPath = "no-such-map.exr";
    const auto missing = expandEnvironment(light, 10);
    REQUIRE_FALSE(missing);
    CHECK(missing.error().message.find("no-such-map.exr") != std::string::npos);
    CHECK_FALSE(expandEnvironment(light, 0));
}

TEST_CASE("the map's zenith is where the light says; other layouts than latitude-longitude are refused by name")
{
    const fs::path path = fs::temp_directory_path() / ("nacre-zenith-" + std::to_string(::getpid()) + ".exr");
    const auto write = [&](int width, int height) {
        Image map{width, height, std::vector<float>(size_t(width) * size_t(height) * 4, 0.0f)};
        for (int x = 0; x < width; ++x) map.pixel(x, 0)[0] = map.pixel(x, 0)[1] = map.pixel(x, 0)[2] = 10.0f;
        REQUIRE(writeExr(map, path.string()));
    };
    write(64, 32);
    Light light;
    light.type = LightType::kEnvironment;
    light.environmentPath = path.string();
    for (const glm::vec3 up : {glm::vec3(0, 0, 1), glm::vec3(0, 1, 0), glm::vec3(0, -1, 0), glm::vec3(1, 0, 0), glm::vec3(0, 0, -1)}) {
        light.directionToLight = up;
        const auto lights = expandEnvironment(light, 100);
        REQUIRE(lights);
        glm::dvec3 mean(0.0);
        for (const Light& l : *lights) mean += double(l.intensity.g) * glm::dvec3(l.directionToLight);
        CHECK(glm::dot(glm::normalize(mean), glm::dvec3(up)) > 0.999);
    }
    const struct {
        int width, height;
        const char* word;
    } layouts[] = {{16, 96, "cube"}, {96, 16, "cube"}, {48, 64, "cross"}, {64, 48, "cross"}, {32, 32, "probe"}, {50, 10, "latitude"}, {16, 32, "latitude"}};
    for (const auto& c : layouts) {
        write(c.width, c.height);
        const auto lights = expandEnvironment(light, 10);
        REQUIRE(!lights);
        CAPTURE(lights.error().message);
        CHECK(lights.error().code == ErrorCode::kBadInput);
        CHECK(lights.error().message.find(c.word) != std::string::npos);
        CHECK(lights.error().message.find("twice as wide as high") != std::string::npos);
    }
    fs::remove(path);
}
