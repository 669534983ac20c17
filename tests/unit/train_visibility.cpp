// What follows from the splats' geometry: who shades whom, and the surface's normals.
#include "appearance/bigs/bigs.h"
#include "base/fibonacci_sphere.h"
#include "base/random.h"
#include "splat/light_visibility.h"
#include "splat/splat_normals.h"

#include <doctest/doctest.h>
#include <glm/gtc/quaternion.hpp>
#include <tbb/global_control.h>

#include <cmath>

using namespace nacre;

namespace {

/// A flat disc with the given normal.
GaussianGeometry<float> disc(const glm::vec3& p, const glm::vec3& normal, float size, float opacity = 0.95f)
{
    glm::vec4 q(1 + normal.z, -normal.y, normal.x, 0);
    if (normal.z < -0.999f) q = {0, 1, 0, 0};
    return {{p.x, p.y, p.z}, {size, size, 0.2f * size}, {q.x, q.y, q.z, q.w}, opacity};
}

std::vector<GaussianGeometry<float>> sphere(int count, float radius)
{
    std::vector<GaussianGeometry<float>> splats;
    for (int i = 0; i < count; ++i) {
        const glm::vec3 n(fibonacciDirection(i, count));
        splats.push_back(disc(radius * n, n, 0.6f * radius * std::sqrt(12.566f / float(count))));
    }
    return splats;
}

float visibility(const std::vector<uint8_t>& maps, size_t splat, const glm::vec3& w)
{
    const glm::vec3 d = glm::normalize(w);
    return mapVisibility(VisibilityMap{&maps[splat * kVisibilityTexels]}, &d.x);
}

} // namespace

TEST_CASE("a closed surface hides the far side from its splats and leaves the near side open")
{
    const auto splats = sphere(3000, 0.7f);
    const std::vector<uint8_t> maps = lightVisibility(splats, kVisibilitySize, 2);
    for (int i = 0; i < 3000; i += 61) {
        const glm::vec3 n(fibonacciDirection(i, 3000));
        for (int k = 0; k < 200; ++k) {
            const glm::vec3 w(fibonacciDirection(k, 200));
            CAPTURE(glm::dot(n, w));
            if (glm::dot(n, w) > 0.35f) CHECK(visibility(maps, size_t(i), w) > 0.95f);
            if (glm::dot(n, w) < -0.35f) CHECK(visibility(maps, size_t(i), w) < 0.05f);
        }
    }
}

TEST_CASE("the edge of a hard shadow lies where geometry puts it")
{
    std::vector<GaussianGeometry<float>> splats; // a wall of 1 x 1 over the ground splats at height 0, seen from below at 45 degrees at its rim
    for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 40; ++x) splats.push_back(disc({(float(x) + 0.5f) / 40 - 0.5f, (float(y) + 0.5f) / 40 - 0.5f, 0.5f}, {0, 0, 1}, 0.02f));
    const size_t probe = splats.size();
    splats.push_back(disc({0, 0, 0}, {0, 0, 1}, 0.02f));
    const std::vector<uint8_t> maps = lightVisibility(splats, kVisibilitySize, 2);
    for (const glm::vec3 side : {glm::vec3(1, 0, 0), glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, -1, 0)}) {
        float edge = -1; // degrees from the vertical where half of the light arrives
        for (float a = 0; a < 89 && edge < 0; a += 0.25f)
            if (visibility(maps, probe, std::cos(a * 0.0174533f) * glm::vec3(0, 0, 1) + std::sin(a * 0.0174533f) * side) > 0.5f) edge = a;
        CHECK(std::abs(edge - 45) < 4); // texels are 9 to 15 degrees wide
    }
    CHECK(visibility(maps, probe, {0, 0, 1}) < 0.02f);
    CHECK(visibility(maps, probe, {0, 0, -1}) > 0.98f);
}

TEST_CASE("visibility does not depend on the number of threads and survives odd splats")
{
    auto splats = sphere(400, 1.0f);
    const auto map = [&](int threads) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        return lightVisibility(splats, kVisibilitySize, 1);
    };
    CHECK(map(1) == map(3));
    splats[5].scale[0] = splats[5].scale[1] = 300, splats[9].opacity = 0, splats[11].scale[2] = 1e-12f;
    CHECK(lightVisibility(splats, kVisibilitySize, 1).size() == 400 * kVisibilityTexels);
    splats.resize(1);
    for (uint8_t v : lightVisibility(splats, kVisibilitySize, 1)) CHECK(v == 255);
    CHECK(lightVisibility({}, kVisibilitySize, 1).empty());
}

TEST_CASE("one splat far away does not blur the shadows of all others")
{
    auto splats = sphere(1000, 0.7f);
    splats.push_back(disc({300, 0, 0}, {1, 0, 0}, 0.02f));
    const std::vector<uint8_t> maps = lightVisibility(splats, kVisibilitySize, 1);
    double hidden = 0, open = 0;
    int hiddenCount = 0, openCount = 0;
    for (int i = 0; i < 1000; i += 37)
        for (int k = 0; k < 50; ++k) {
            const glm::vec3 n(fibonacciDirection(i, 1000)), w(fibonacciDirection(k, 50));
            if (glm::dot(n, w) > 0.5f) open += double(visibility(maps, size_t(i), w)), ++openCount;
            if (glm::dot(n, w) < -0.5f) hidden += double(visibility(maps, size_t(i), w)), ++hiddenCount;
        }
    CHECK(open / openCount > 0.95);
    CHECK(hidden / hiddenCount < 0.05);
    CHECK(visibility(maps, 1000, {0, 0, 1}) == 1.0f);
}

TEST_CASE("drawing visibility asks again and again whether to go on, and gives up when it may not")
{
    const auto splats = sphere(200, 1.0f);
    int asked = 0;
    const auto whole = lightVisibility(splats, kVisibilitySize, 1, {}, [&] { return ++asked, true; });
    CHECK(asked > 3);
    CHECK(whole == lightVisibility(splats, kVisibilitySize, 1));
    int left = 2;
    CHECK(lightVisibility(splats, kVisibilitySize, 1, {}, [&] { return left-- > 0; }).empty());
}

TEST_CASE("what lies behind a lamp does not shade under it; what lies before it does, and other directions stay as they were")
{
    std::vector<GaussianGeometry<float>> splats; // ground at height 0, a ceiling at 1, between them a lamp and a small screen at 0.4 over one half
    const auto sheet = [&](float height, float from, float to) {
        for (int y = 0; y < 40; ++y)
            for (int x = 0; x < 40; ++x)
                splats.push_back(disc({from + (to - from) * (float(x) + 0.5f) / 40, (float(y) + 0.5f) / 20 - 1, height}, {0, 0, 1}, 0.04f));
    };
    sheet(0, -1, 1), sheet(1, -1, 1), sheet(0.4f, -0.6f, -0.1f);
    const glm::vec3 lamps[] = {{0, 0, 0.7f}, {5, 0, 0.5f}}; // the second stands outside and changes nothing
    const auto without = lightVisibility(splats, kVisibilitySize, 1), with = lightVisibility(splats, kVisibilitySize, 1, lamps);
    int open = 0, shaded = 0;
    for (size_t i = 0; i < 1600; ++i) {
        const glm::vec3 p(splats[i].position[0], splats[i].position[1], splats[i].position[2]), w = lamps[0] - p;
        if (glm::length(w) > 1) continue; // the lamp's image is coarse there
        const float x = p.x * 0.3f / 0.7f; // where the ray passes the screen's height
        if (std::abs(x + 0.6f) < 0.12f || std::abs(x + 0.1f) < 0.12f) continue; // its edges
        CAPTURE(p.x);
        CAPTURE(p.y);
        const bool hidden = x > -0.6f && x < -0.1f;
        (hidden ? shaded : open) += 1;
        CHECK(visibility(without, i, w) < 0.1f); // the ceiling
        if (hidden) CHECK(visibility(with, i, w) < 0.1f);
        else CHECK(visibility(with, i, w) > 0.9f);
        CHECK(visibility(with, i, -w) == visibility(without, i, -w));
    }
    CHECK(open > 100);
    CHECK(shaded > 20);
    CHECK(lightVisibility(splats, kVisibilitySize, 1, std::span(lamps).subspan(1)) == without);
}

TEST_CASE("normals of wobbling discs are those of the surface, outside where they were said to be")
{
    Random random(3);
    const int count = 3000;
    std::vector<GaussianGeometry<float>> splats;
    std::vector<glm::vec3> outside;
    for (int i = 0; i < count; ++i) {
        const glm::vec3 n(fibonacciDirection(i, count));
        const glm::vec3 wobble(random.uniform() - 0.5f, random.uniform() - 0.5f, random.uniform() - 0.5f);
        const float flip = i % 2 ? 1.0f : -1.0f; // an axis has no sign
        splats.push_back(disc(n, flip * glm::normalize(n + 0.4f * wobble), 0.04f));
        outside.push_back(n + glm::vec3(0.3f, 0, 0.5f));
    }
    const std::vector<glm::vec3> normals = splatNormals(splats, outside);
    double before = 0, after = 0;
    for (int i = 0; i < count; ++i) {
        const glm::vec3 n(fibonacciDirection(i, count));
        const GaussianGeometry<float>& g = splats[size_t(i)];
        const glm::vec3 axis = glm::quat(g.rotation[0], g.rotation[1], g.rotation[2], g.rotation[3]) * glm::vec3(0, 0, 1) / glm::length(glm::vec4(g.rotation[0], g.rotation[1], g.rotation[2], g.rotation[3]));
        CHECK(glm::dot(normals[size_t(i)], n) > 0.9f);
        before += std::acos(std::min(1.0f, std::abs(glm::dot(glm::normalize(axis), n)))) / count, after += std::acos(std::min(1.0f, glm::dot(normals[size_t(i)], n))) / count;
    }
    CHECK(after < 0.5 * before);
    CHECK(after < 0.1); // radians
}
