// Embree rays through Gaussians against formulas, against asking every Gaussian, and against the drawn maps.
#include "render/visibility_embree.h"

#include "base/fibonacci_sphere.h"
#include "base/random.h"
#include "base/spherical_harmonics.h"
#include "splat/light_visibility.h"
#include "splats/blend.h"

#include <doctest/doctest.h>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>

using namespace nacre;

namespace {

using Splats = std::vector<GaussianGeometry<float>>;

constexpr float kEverything = 1e9f; // a bias of minus this lets centres behind the origin count

glm::vec3 randomPoint(Random& random) { return 2.0f * glm::vec3(random.uniform(), random.uniform(), random.uniform()) - 1.0f; }
glm::vec3 randomDirection(Random& random) { return glm::vec3(fibonacciDirection(int(random.below(100003)), 100003)); }

/// In [-1, 1]^3; scales spread over a factor `spread` within each splat.
GaussianGeometry<float> randomSplat(Random& random, float size, float spread)
{
    GaussianGeometry<float> g;
    const glm::vec3 p = randomPoint(random);
    for (int k = 0; k < 3; ++k) g.position[k] = p[k], g.scale[k] = size * std::pow(spread, -random.uniform());
    for (float& q : g.rotation) q = random.uniform() - 0.5f;
    g.opacity = random.uniform();
    return g;
}

/// alphaOnRay by another way: float64, glm's matrices, the ray's nearest point in local space.
double alphaByFormula(const GaussianGeometry<float>& g, const glm::dvec3& origin, const glm::dvec3& direction)
{
    const glm::dmat3 worldFromLocal =
        glm::mat3_cast(glm::normalize(glm::dquat(g.rotation[0], g.rotation[1], g.rotation[2], g.rotation[3])));
    const glm::dvec3 scale(g.scale[0], g.scale[1], g.scale[2]);
    const glm::dvec3 o =
        glm::transpose(worldFromLocal) * (origin - glm::dvec3(g.position[0], g.position[1], g.position[2])) / scale;
    const glm::dvec3 d = glm::transpose(worldFromLocal) * direction / scale;
    const glm::dvec3 nearest = o + std::max(0.0, -glm::dot(o, d) / glm::dot(d, d)) * d;
    return g.opacity * std::exp(-0.5 * glm::dot(nearest, nearest));
}

/// A flat disc with the given normal.
GaussianGeometry<float> disc(const glm::vec3& p, const glm::vec3& normal, float size, float opacity = 0.95f)
{
    glm::vec4 q(1 + normal.z, -normal.y, normal.x, 0);
    if (normal.z < -0.999f) q = {0, 1, 0, 0};
    return {{p.x, p.y, p.z}, {size, size, 0.2f * size}, {q.x, q.y, q.z, q.w}, opacity};
}

Splats shell(int count, float radius)
{
    Splats splats;
    for (int i = 0; i < count; ++i) {
        const glm::vec3 n(fibonacciDirection(i, count));
        splats.push_back(disc(radius * n, n, 0.6f * radius * std::sqrt(12.566f / float(count))));
    }
    return splats;
}

} // namespace

TEST_CASE("one Gaussian lets through one minus its largest alpha on the ray")
{
    Random random(1);
    int hits = 0;
    for (int trial = 0; trial < 200; ++trial) {
        const GaussianGeometry<float> g = randomSplat(random, 0.5f, 20);
        const GaussianRayScene scene({&g, 1});
        for (int k = 0; k < 20; ++k) {
            const glm::vec3 w = randomDirection(random), o = 0.7f * randomPoint(random) - 2.0f * w;
            const double alpha = alphaByFormula(g, o, w);
            if (std::abs(alpha - double(kMinAlpha)) < 1e-5) continue; // rounding decides whether it counts
            const double expected = alpha < double(kMinAlpha) ? 1 : alpha > 0.9999 ? 0 : 1 - alpha;
            // float32 rotation at distances of up to 100 standard deviations
            CHECK(std::abs(double(scene.transmittance(o, w, -kEverything)) - expected) < 2e-5);
            hits += alpha > double(kMinAlpha);
        }
    }
    CHECK(hits > 500);
}

TEST_CASE("what lies behind the origin, or less than the bias ahead of it, does not count")
{
    const GaussianGeometry<float> g{{0, 0, 2}, {0.1f, 0.1f, 0.1f}, {1, 0, 0, 0}, 0.5f};
    const GaussianRayScene scene({&g, 1});
    CHECK(scene.transmittance({0, 0, 0}, {0, 0, 1}, 0) == doctest::Approx(0.5f));
    CHECK(scene.transmittance({0, 0, 0}, {0, 0, 1}, 1.9f) == doctest::Approx(0.5f));
    CHECK(scene.transmittance({0, 0, 0}, {0, 0, 1}, 2.1f) == 1);
    CHECK(scene.transmittance({0, 0, 0}, {0, 0, -1}, 0) == 1);
    CHECK(scene.transmittance({0, 0, 2}, {0, 0, 1}, 0) == 1); // from its own centre
    CHECK(scene.bias() == doctest::Approx(0.4f));
    CHECK(scene.transmittanceFrom(0, {0, 0, 1}) == 1);
}

TEST_CASE("Gaussians in a row multiply, and below the least transmittance nothing is left")
{
    Splats row;
    double expected = 1;
    for (int i = 0; i < 6; ++i) {
        row.push_back({{0, 0, float(i + 1)}, {0.1f, 0.1f, 0.1f}, {1, 0, 0, 0}, 0.1f * float(i + 1)});
        expected *= 1 - 0.1 * (i + 1);
    }
    CHECK(GaussianRayScene(row).transmittance({}, {0, 0, 1}, 0) == doctest::Approx(expected).epsilon(1e-6)); // f32 opacities
    std::reverse(row.begin(), row.end());
    CHECK(GaussianRayScene(row).transmittance({}, {0, 0, 1}, 0) == doctest::Approx(expected).epsilon(1e-6));
    Splats wall(3, GaussianGeometry<float>{{0, 0, 1}, {0.1f, 0.1f, 0.1f}, {1, 0, 0, 0}, 0.95f});
    CHECK(GaussianRayScene(wall).transmittance({}, {0, 0, 1}, 0) == doctest::Approx(1.25e-4).epsilon(1e-5));
    wall.push_back(wall[0]);
    CHECK(GaussianRayScene(wall).transmittance({}, {0, 0, 1}, 0) == 0);
}

TEST_CASE("Embree finds exactly the Gaussians that asking every one of them finds")
{
    Random random(2);
    int between = 0;
    for (const float spread : {1.0f, 30.0f, 1e4f, 1e8f}) {
        Splats splats;
        for (int i = 0; i < 1500; ++i) splats.push_back(randomSplat(random, i % 50 ? 0.05f : 0.5f, spread));
        const GaussianRayScene scene(splats);
        for (int k = 0; k < 1500; ++k) {
            const glm::vec3 w =
                k % 5 ? randomDirection(random) : glm::vec3(k % 3 == 0, k % 3 == 1, k % 3 == 2); // some along the boxes
            const glm::vec3 o = k % 2 ? randomPoint(random) : randomPoint(random) - 5.0f * w;
            const float bias = 0.1f * float(k % 3), traced = scene.transmittance(o, w, bias);
            REQUIRE(traced == scene.transmittanceReference(o, w, bias)); // sums of integers
            between += traced > 0.01f && traced < 0.99f;
        }
    }
    CHECK(between > 1000);
}

TEST_CASE("rays that graze the edge of a thin tilted Gaussian's box are not lost")
{
    Random random(3);
    int met = 0;
    for (int trial = 0; trial < 300; ++trial) {
        GaussianGeometry<float> g = randomSplat(random, 1, 1);
        g.scale[trial % 3] = 1e-8f, g.opacity = 1;
        if (trial % 4 == 0) std::fill(g.rotation, g.rotation + 4, 1e-20f); // no direction: stands for no rotation
        const GaussianRayScene scene({&g, 1});
        RayGaussian r;
        REQUIRE(prepareRayGaussian(g, r));
        for (int k = 0; k < 30; ++k) { // through a point of the ellipse just within the cut
            const float angle = random.uniform() * 6.2831853f, within = std::sqrt(r.reach) * (1 - 1e-4f * random.uniform());
            glm::vec3 local(0);
            local[(trial + 1) % 3] = within * std::cos(angle), local[(trial + 2) % 3] = within * std::sin(angle);
            const glm::quat q = trial % 4 ? glm::normalize(glm::quat(g.rotation[0], g.rotation[1], g.rotation[2], g.rotation[3]))
                                          : glm::quat(1, 0, 0, 0);
            const glm::vec3 w = randomDirection(random);
            const glm::vec3 o = glm::vec3(g.position[0], g.position[1], g.position[2]) + q * local - 3.0f * w;
            const float traced = scene.transmittance(o, w, -kEverything);
            REQUIRE(traced == scene.transmittanceReference(o, w, -kEverything));
            met += traced < 1;
        }
    }
    CHECK(met > 5000); // of 9000; rounding puts some beyond the cut
}

TEST_CASE("boxes touch their ellipsoids, round, thin or without a rotation")
{
    Random random(6);
    for (const float spread : {1.0f, 100.0f, 1e8f})
        for (int trial = 0; trial < 200; ++trial) {
            GaussianGeometry<float> g = randomSplat(random, 0.5f, 1);
            g.opacity = 0.01f + 0.99f * random.uniform();
            g.scale[trial % 3] /= spread;
            if (trial % 2) g.scale[(trial + 1) % 3] /= spread;
            if (trial % 5 == 0) std::fill(g.rotation, g.rotation + 4, 0.0f);
            const glm::dquat q = trial % 5
                                     ? glm::normalize(glm::dquat(g.rotation[0], g.rotation[1], g.rotation[2], g.rotation[3]))
                                     : glm::dquat(1, 0, 0, 0);
            const glm::dmat3 m = glm::mat3_cast(q);
            const double reach = std::sqrt(2 * std::log(double(g.opacity) / double(kMinAlpha)));
            const auto box = GaussianRayScene({&g, 1}).box();
            for (int k = 0; k < 3; ++k) {
                const double half =
                    reach * glm::length(glm::dvec3(m[0][k] * g.scale[0], m[1][k] * g.scale[1], m[2][k] * g.scale[2]));
                const double slack = 2e-5; // of float32 coordinates up to 2, on the outside
                CHECK(g.position[k] - half - box.lower[k] >= 0);
                CHECK(g.position[k] - half - box.lower[k] < slack);
                CHECK(box.upper[k] - g.position[k] - half >= 0);
                CHECK(box.upper[k] - g.position[k] - half < slack);
            }
        }
}

TEST_CASE("traced and drawn maps of a closed shell agree")
{
    const int count = 3000, size = 16;
    const Splats splats = shell(count, 0.7f);
    const std::vector<uint8_t> drawn = lightVisibility(splats, size, 1), traced = embreeVisibility(splats, size, 1);
    REQUIRE(traced.size() == drawn.size());
    double horizon = 0, elsewhere = 0;
    int atHorizon = 0, most = 0;
    for (size_t k = 0; k < drawn.size(); ++k) {
        const int i = int(k) % size, j = int(k) / size % size, off = std::abs(int(drawn[k]) - int(traced[k]));
        const glm::vec3 w = octahedralDirection((2 * float(i) + 1) / float(size) - 1, (2 * float(j) + 1) / float(size) - 1);
        const bool near = std::abs(glm::dot(w, glm::vec3(fibonacciDirection(int(k) / (size * size), count)))) < 0.3f;
        (near ? horizon : elsewhere) += off / 255.0, atHorizon += near;
        if (!near) most = std::max(most, off);
    }
    // A pixel of the drawn image is 1/64 of the radius, which is ten degrees at the horizon. Images of 1024 pixels come to a
    // tenth of these differences.
    CHECK(horizon / atHorizon < 0.08);
    CHECK(elsewhere / double(drawn.size() - size_t(atHorizon)) < 0.008);
    CHECK(most < 26);
}

TEST_CASE("traced maps are the same bytes for one thread and two")
{
    const Splats splats = shell(600, 1);
    const auto maps = [&](size_t threads) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        return embreeVisibility(splats, 8, 2);
    };
    CHECK(maps(1) == maps(2));
}

TEST_CASE("extreme splats give finite transmittances")
{
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    Random random(4);
    Splats splats;
    for (int i = 0; i < 200; ++i) {
        GaussianGeometry<float> g = randomSplat(random, 0.3f, 1e8f);
        if (i % 11 == 0) g.scale[i % 3] = 0;
        if (i % 13 == 0) g.scale[i % 3] = 1e30f;
        if (i % 17 == 0) g.scale[0] = g.scale[1] = g.scale[2] = 0;
        if (i % 7 == 0) std::fill(g.rotation, g.rotation + 4, i % 2 ? 0.0f : nan);
        if (i % 5 == 0) g.opacity = i % 2 ? 0.0f : 1.0f;
        if (i % 19 == 0) g.opacity = nan;
        if (i % 23 == 0) g.position[1] = i % 2 ? nan : inf;
        if (i % 29 == 0) g.position[2] = 1e17f;
        splats.push_back(g);
    }
    const GaussianRayScene scene(splats);
    for (int k = 0; k < 2000; ++k) {
        const glm::vec3 w = randomDirection(random), o = randomPoint(random);
        const float t = scene.transmittance(o, w, 0);
        CHECK((t >= 0 && t <= 1));
        CHECK(t == scene.transmittanceReference(o, w, 0));
    }
    for (size_t i = 0; i < splats.size(); ++i) {
        const float t = scene.transmittanceFrom(i, randomDirection(random));
        CHECK((t >= 0 && t <= 1));
    }
    CHECK(embreeVisibility(Splats{}, 32, 1).empty());
    splats.resize(1), splats[0] = {{0, 0, 0}, {1, 1, 1}, {1, 0, 0, 0}, 0};
    for (const uint8_t v : embreeVisibility(splats, 8, 1)) CHECK(v == 255);
}

TEST_CASE("the fit finds spherical harmonics again and reports what it misses")
{
    Random random(5);
    std::vector<glm::vec3> directions;
    for (int d = 0; d < 300; ++d) directions.push_back(randomDirection(random));
    std::vector<float> values;
    std::vector<std::array<float, 16>> truth(20);
    for (auto& c : truth) {
        for (float& x : c) x = 0.1f * (random.uniform() - 0.5f);
        c[0] = 0.5f / 0.28209479f;
        for (const glm::vec3& w : directions) values.push_back(evaluateVisibilitySh3(c, w));
    }
    for (size_t d = 0; d < directions.size(); ++d) values.push_back(float(directions[d].z > 0.2f)); // a step: beyond degree 3
    const VisibilityShFit fit = fitVisibilitySh3(directions, values);
    for (size_t s = 0; s < truth.size(); ++s) {
        CHECK(fit.rmsError[s] < 1e-5f);
        for (size_t k = 0; k < 16; ++k) CHECK(std::abs(fit.coefficients[s][k] - truth[s][k]) < 1e-5f); // f32 values
    }
    CHECK(fit.rmsError.back() > 0.05f);
    CHECK(fit.rmsError.back() < 0.25f);
    const std::vector<glm::vec3> alike(40, glm::vec3(0, 0, 1)); // nothing to tell functions apart by
    const std::vector<float> ones(40, 1.0f);
    const VisibilityShFit poor = fitVisibilitySh3(alike, ones);
    CHECK(poor.rmsError[0] < 1e-3f);
    for (const float c : poor.coefficients[0]) CHECK(std::isfinite(c));
}
