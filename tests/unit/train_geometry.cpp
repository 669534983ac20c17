// The SIMD step of the geometry against its scalar reference, and what must not show in its result.
#include "base/random.h"
#include "splat/geometry.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cstring>
#include <glm/gtc/matrix_transform.hpp>

using namespace nacre;

namespace {

View<float> testView()
{
    Camera c;
    c.width = c.height = 64;
    c.fx = c.fy = 90;
    c.cx = c.cy = 32;
    c.worldFromCamera = glm::inverse(glm::lookAt(glm::dvec3(0.3, -3, 0.4), glm::dvec3(0), glm::dvec3(0, 0, 1)));
    return makeView<float>(c, 0.1);
}

// Splats around the view's axis and far beside it (clamped tangents), some behind the camera, thin, without a rotation, at every bound.
SplatGeometry randomGeometry(size_t count)
{
    SplatGeometry geometry;
    geometry.resize(count);
    Random random(11);
    const auto u = [&] { return 2 * random.uniform() - 1; };
    for (size_t i = 0; i < count; ++i) {
        GeometryRow& r = geometry.raw[i];
        const float spread = i % 5 == 0 ? 8.0f : 0.8f;
        for (int k = 0; k < 3; ++k) r[k] = spread * u(), r[3 + k] = -3.0f + 2 * u();
        if (i % 7 == 0) r[5] = -12.0f;
        if (i % 11 == 0) r[3] = 4.0f;
        for (int k = 6; k < 10; ++k) r[k] = (i % 13 == 0 ? 1e-11f : i % 17 == 0 ? 1e-8f : 1.0f) * u();
        r[10] = (i % 19 == 0 ? 20.0f : 5.0f) * u();
        for (int k = 0; k < kGeometryParameters; ++k) geometry.momentum[i][k] = 0.1f * u(), geometry.second[i][k] = 0.1f * random.uniform();
        geometry.activate(i);
    }
    return geometry;
}

std::vector<ScreenGradient<float>> randomGradients(size_t count)
{
    Random random(12);
    std::vector<ScreenGradient<float>> d(count);
    for (auto& g : d)
        for (float* x : {&g.mean[0], &g.mean[1], &g.conic[0], &g.conic[1], &g.conic[2], &g.opacity}) *x = 2 * random.uniform() - 1;
    return d;
}

constexpr GeometryRates kRates = {0.01f, 0.02f, 0.03f, 0.04f};
constexpr float kPull = 1e-3f;

bool same(float a, float b) { return a == b || (std::isnan(a) && std::isnan(b)); }

bool sameBytes(const SplatGeometry& a, const SplatGeometry& b)
{
    const auto equal = [](const auto& x, const auto& y) { return std::memcmp(x.data(), y.data(), x.size() * sizeof x[0]) == 0; };
    return equal(a.raw, b.raw) && equal(a.momentum, b.momentum) && equal(a.second, b.second) && equal(a.activated, b.activated);
}

} // namespace

TEST_CASE("the SIMD step of the geometry equals the scalar reference")
{
    const size_t count = 1003; // no multiple of any vector
    const View<float> view = testView();
    SplatGeometry fast = randomGeometry(count), slow = fast;
    auto d = randomGradients(count);
    std::vector<float> distance(count); // gradient of it
    for (size_t i = 0; i < count; ++i) distance[i] = d[(i + 1) % count].opacity;
    for (size_t i = 0; i < count; i += 23) d[i].mean[i % 2] = NAN; // position
    for (size_t i = 5; i < count; i += 29) d[i].conic[0] = INFINITY;
    for (size_t i = 7; i < count; i += 31) d[i].opacity = 1e30f;
    std::vector<uint32_t> splats(count);
    std::vector<uint8_t> active(count);
    for (size_t v = 0; v < count; ++v) splats[v] = uint32_t(v * 7 % count), active[v] = v % 3 != 0;
    for (int step = 1; step <= 5; ++step) {
        for (size_t v = 0; v < count; ++v)
            if (const size_t i = splats[v]; active[v])
                stepSplatReference(slow.raw[i], slow.momentum[i], slow.second[i], slow.activated[i], view, d[v], distance[v], GeometryAdam(kRates, step), kPull);
        stepGeometry(fast, view, splats, d.data(), distance.data(), active.data(), kRates, step, kPull);
        size_t clamped = 0, behind = 0;
        for (size_t i = 0; i < count; ++i) {
            CAPTURE(i);
            for (int k = 0; k < kGeometryParameters; ++k) {
                CAPTURE(k);
                REQUIRE(same(fast.raw[i][k], slow.raw[i][k])); // the same operations in the same order
                REQUIRE(same(fast.momentum[i][k], slow.momentum[i][k]));
                REQUIRE(same(fast.second[i][k], slow.second[i][k]));
            }
            const GaussianGeometry<float>&f = fast.activated[i], &s = slow.activated[i];
            for (int k = 0; k < 3; ++k) {
                REQUIRE(same(f.position[k], s.position[k]));
                REQUIRE(std::abs(f.scale[k] - s.scale[k]) <= 1.5e-6f * s.scale[k]); // exp of up to 12: half an ulp of the exponent, 2e-7 of exp2
            }
            for (int k = 0; k < 4; ++k) REQUIRE(same(f.rotation[k], s.rotation[k]));
            REQUIRE(std::abs(f.opacity - s.opacity) <= 1.5e-6f * s.opacity);
            detail::ProjectionSteps<float> p;
            if (!detail::projectionSteps(view, s, p)) ++behind;
            else clamped += p.clampedX || p.clampedY;
        }
        CHECK(clamped > 20);
        CHECK(behind > 20);
        slow = fast; // the exponentials' rounding must not add up from step to step
    }
}

TEST_CASE("a gradient that is not a number leaves its parameter and its moments alone")
{
    const View<float> view = testView();
    SplatGeometry geometry = randomGeometry(3);
    const SplatGeometry before = geometry;
    auto d = randomGradients(3);
    d[1].mean[0] = d[1].opacity = NAN;
    const uint32_t splats[3] = {0, 1, 2};
    const uint8_t active[3] = {1, 1, 1};
    stepGeometry(geometry, view, splats, d.data(), nullptr, active, kRates, 1, kPull);
    for (int k : {0, 1, 2, 10}) {
        CHECK(geometry.raw[1][k] == before.raw[1][k]);
        CHECK(geometry.momentum[1][k] == before.momentum[1][k]);
        CHECK(geometry.second[1][k] == before.second[1][k]);
        CHECK(geometry.raw[2][k] != before.raw[2][k]);
    }
}

TEST_CASE("the order of the visible list, the inactive between them and the thread count do not show in a step")
{
    const size_t count = 1500;
    const View<float> view = testView();
    const SplatGeometry start = randomGeometry(count);
    const auto d = randomGradients(count);
    SplatGeometry results[3];
    for (int run = 0; run < 3; ++run) {
        tbb::global_control threads(tbb::global_control::max_allowed_parallelism, run == 1 ? 4 : 1);
        std::vector<uint32_t> splats;
        std::vector<ScreenGradient<float>> gradients;
        std::vector<uint8_t> active;
        for (size_t v = 0; v < count; ++v) {
            const uint32_t i = uint32_t(run == 2 ? count - 1 - v : v);
            if (run == 2 && i % 4 == 0) continue; // not even visible
            splats.push_back(i), gradients.push_back(d[i]), active.push_back(i % 4 != 0);
        }
        results[run] = start;
        for (int step = 1; step <= 3; ++step)
            stepGeometry(results[run], view, splats, gradients.data(), nullptr, active.data(), kRates, step, kPull);
    }
    CHECK_FALSE(sameBytes(results[0], start));
    CHECK(sameBytes(results[0], results[1]));
    CHECK(sameBytes(results[0], results[2]));
}

TEST_CASE("the rows after a step activate to the bytes that the step left")
{
    const View<float> view = testView();
    SplatGeometry geometry = randomGeometry(100);
    const auto d = randomGradients(100);
    std::vector<uint32_t> splats(100);
    for (size_t i = 0; i < 100; ++i) splats[i] = uint32_t(i);
    stepGeometry(geometry, view, splats, d.data(), nullptr, std::vector<uint8_t>(100, 1).data(), kRates, 1, kPull);
    SplatGeometry again = geometry; // as a checkpoint does
    for (size_t i = 0; i < 100; ++i) again.activate(i);
    CHECK(sameBytes(geometry, again));
}
