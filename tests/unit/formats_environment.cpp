// A few directions in the place of an environment: no light lost, none of it moved far, more of them where more comes from.
#include "appearance/environment_directions.h"
#include "base/fibonacci_sphere.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

using namespace nacre;

namespace {

double luminance(const glm::dvec3& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; }

/// A dim sky with bright spots of several sizes.
std::vector<float> spots(int width, int height, uint32_t seed)
{
    std::mt19937 rng(seed);
    const auto uniform = [&](double low, double high) { return low + (high - low) * double(rng() >> 8) * 0x1p-24; };
    std::vector<float> pixels(size_t(3 * width * height));
    for (float& p : pixels) p = float(uniform(0.2, 0.3));
    for (int k = 0; k < 8; ++k) {
        const double u = uniform(0.2, 0.8), v = uniform(0.2, 0.8), size = uniform(0.01, 0.08), bright = std::exp(uniform(0, 4));
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                if (std::hypot((x + 0.5) / width - u, 0.5 * ((y + 0.5) / height - v)) < size)
                    for (int c = 0; c < 3; ++c) pixels[size_t(3 * (y * width + x) + c)] += float(bright * (1 + 0.3 * c));
    }
    return pixels;
}

glm::dvec3 total(const std::vector<EnvironmentCell>& cells)
{
    glm::dvec3 sum(0);
    for (const EnvironmentCell& c : cells) sum += c.power;
    return sum;
}

/// Irradiance of a plane.
double received(const glm::dvec3& normal, const glm::dvec3& direction, double irradiance) { return irradiance * std::max(glm::dot(normal, direction), 0.0); }

} // namespace

TEST_CASE("environment directions keep all light, whatever the size of the map; the same map gives the same bits")
{
    for (const auto& [width, height] : {std::pair(1, 1), std::pair(3, 2), std::pair(64, 32), std::pair(700, 350)}) {
        const std::vector<float> pixels = spots(width, height, 1);
        glm::dvec3 expected(0);
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                for (int c = 0; c < 3; ++c)
                    expected[c] += double(pixels[size_t(3 * (y * width + x) + c)]) * 2 * std::numbers::pi / width *
                                   (std::cos(std::numbers::pi * y / height) - std::cos(std::numbers::pi * (y + 1) / height));
        for (const int count : {1, 2, 13, 64, 1024}) {
            CAPTURE(width);
            CAPTURE(count);
            const auto cells = environmentCells(pixels.data(), width, height, 3, count);
            const auto directions = environmentDirections(cells, count), again = environmentDirections(cells, count);
            CHECK(directions.size() <= size_t(count));
            CHECK(directions.size() >= size_t(0.9 * count));
            glm::dvec3 sum(0);
            for (size_t i = 0; i < directions.size(); ++i) {
                sum += directions[i].irradiance;
                CHECK(glm::length(directions[i].direction) == doctest::Approx(1));
                CHECK(directions[i].direction == again[i].direction);
                CHECK(directions[i].irradiance == again[i].irradiance);
            }
            for (int c = 0; c < 3; ++c) CHECK(sum[c] == doctest::Approx(expected[c]).epsilon(1e-9)); // f64
        }
    }
}

TEST_CASE("environment directions err less than as many spread evenly, and the less the more there are")
{
    double before = 1e300;
    for (const int count : {16, 64, 256}) {
        double chosen = 0, even = 0;
        for (uint32_t seed = 0; seed < 4; ++seed) {
            const std::vector<float> pixels = spots(128, 64, seed);
            const auto cells = environmentCells(pixels.data(), 128, 64, 3, count);
            const auto directions = environmentDirections(cells, count);
            std::vector<EnvironmentCell> spread(static_cast<size_t>(count)); // of what is nearest to each Fibonacci direction
            for (const EnvironmentCell& c : cells) {
                int best = 0;
                for (int i = 1; i < count; ++i)
                    if (glm::dot(fibonacciDirection(i, count), c.moment) > glm::dot(fibonacciDirection(best, count), c.moment)) best = i;
                spread[size_t(best)].power += c.power, spread[size_t(best)].moment += c.moment;
            }
            const double light = luminance(total(cells));
            for (int k = 0; k < 200; ++k) {
                const glm::dvec3 normal = fibonacciDirection(k, 200);
                double truth = 0, a = 0, b = 0;
                for (const EnvironmentCell& c : cells)
                    if (const double l = luminance(c.power); l > 0) truth += received(normal, c.moment / l, l);
                for (const EnvironmentDirection& d : directions) a += received(normal, d.direction, luminance(d.irradiance));
                for (const EnvironmentCell& c : spread)
                    if (const double l = glm::length(c.moment); l > 0) b += received(normal, c.moment / l, luminance(c.power));
                chosen += (a - truth) * (a - truth) / (light * light), even += (b - truth) * (b - truth) / (light * light);
            }
        }
        CAPTURE(count);
        CHECK(chosen < 0.5 * even);
        CHECK(chosen < 0.25 * before);
        before = chosen;
    }
}

TEST_CASE("a small sun stays one sharp direction with all of its light; negative pixels are none")
{
    std::vector<float> pixels(3 * 256 * 128, 0.5f);
    for (int c = 0; c < 3; ++c) pixels[size_t(3 * (40 * 256 + 70) + c)] = 1e6f;
    pixels[0] = pixels[1] = pixels[2] = -1e9f;
    const auto directions = environmentDirections(environmentCells(pixels.data(), 256, 128, 3, 32), 32);
    const auto sun = std::max_element(directions.begin(), directions.end(), [](const auto& a, const auto& b) { return a.irradiance.g < b.irradiance.g; });
    const double theta = std::numbers::pi * 40.5 / 128, phi = std::numbers::pi - 2 * std::numbers::pi * 70.5 / 256;
    CHECK(glm::dot(sun->direction, glm::dvec3(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta))) > std::cos(0.001));
    CHECK(sun->angularRadius < 0.01);
    CHECK(sun->irradiance.g == doctest::Approx(1e6 * 2 * std::numbers::pi / 256 * std::numbers::pi / 128 * std::sin(theta)).epsilon(0.01));
    for (const EnvironmentDirection& d : directions) CHECK(d.irradiance.g >= 0);
}

TEST_CASE("a dark environment has no directions")
{
    const std::vector<float> black(3 * 32 * 16, 0.0f);
    CHECK(environmentDirections(environmentCells(black.data(), 32, 16, 3, 64), 64).empty());
}
