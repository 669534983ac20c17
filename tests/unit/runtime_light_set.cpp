// From lights to points to slots: bounds that hold, slots that stay, few points in the place of many.
#include "light_check.h"
#include "light_set.h"

#include "appearance/bigs/bigs.h"
#include "appearance/sss/sss.h"
#include "base/fibonacci_sphere.h"
#include "base/light.h"

#include <doctest/doctest.h>
#include <glm/gtc/matrix_transform.hpp>

#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <utility>

using namespace nacre;

namespace {

class Random {
public:
    explicit Random(uint32_t seed) : rng_(seed) {}
    double in(double low, double high) { return low + (high - low) * double(rng_() >> 8) * 0x1p-24; }
    glm::dvec3 box(const glm::dvec3& low, const glm::dvec3& high) { return {in(low.x, high.x), in(low.y, high.y), in(low.z, high.z)}; }
    glm::dvec3 direction()
    {
        const double z = in(-1, 1), phi = in(0, 2 * std::numbers::pi), r = std::sqrt(1 - z * z);
        return {r * std::cos(phi), r * std::sin(phi), z};
    }
    glm::dmat4 place() // turned, scaled, moved, every other time mirrored
    {
        glm::dmat4 m = glm::translate(glm::dmat4(1), box(glm::dvec3(-3), glm::dvec3(3)));
        m = glm::rotate(m, in(0, 6), direction());
        const double scale = std::exp(in(-2, 2));
        return glm::scale(m, glm::dvec3(in(-1, 1) < 0 ? -scale : scale, scale, scale));
    }

private:
    std::mt19937 rng_;
};

void store(float out[3], const glm::dvec3& v)
{
    for (int c = 0; c < 3; ++c) out[c] = float(v[c]);
}

NacreLight light(NacreLightType type, const glm::dvec3& position, const glm::dvec3& direction, double intensity)
{
    NacreLight l{};
    l.structSize = sizeof l;
    l.type = type;
    store(l.position, position);
    store(l.direction, direction);
    store(l.intensity, glm::dvec3(intensity, 0.5 * intensity, 0.25 * intensity));
    return l;
}

NacreLight randomLight(Random& random, double reach)
{
    const auto type = NacreLightType(int(random.in(0, 4.999)));
    NacreLight l = light(type, random.box(glm::dvec3(-reach), glm::dvec3(reach)), random.direction(), std::exp(random.in(-12, 3)));
    l.radius = type == NACRE_LIGHT_DIRECTIONAL ? 0.1f : float(random.in(0.01, 0.5));
    if (random.in(0, 1) < 0.5) l.range = float(random.in(0.1, 2 * reach));
    l.innerCone = float(random.in(0, 0.7)), l.outerCone = l.innerCone + float(random.in(0.01, 0.8));
    const glm::dvec3 axis(l.direction[0], l.direction[1], l.direction[2]);
    store(l.halfWidth, random.in(0.1, 1) * glm::normalize(glm::cross(axis, random.direction())));
    l.halfHeight = float(random.in(0.1, 1));
    return l;
}

InstancePlace placeAt(const glm::dmat4& worldFromAsset, uint32_t mask = ~0u)
{
    InstancePlace place;
    place.assetFromWorld = glm::inverse(worldFromAsset);
    place.worldScale = float(glm::length(glm::dvec3(worldFromAsset[1])));
    place.boundsMin = {-0.5f, -0.4f, -0.3f}, place.boundsMax = {0.5f, 0.6f, 0.7f};
    place.mask = mask;
    return place;
}

struct Rows {
    double r[kLightRows][4];
};

Rows rowsOf(const PackedLight& light)
{
    Rows rows;
    for (int i = 0; i < kLightRows; ++i)
        for (int j = 0; j < 4; ++j) rows.r[i][j] = double(light.row[i][j]);
    return rows;
}

/// What a light gives a place, of its largest channel.
double irradiance(const PackedLight& light, const glm::dvec3& p, const InstancePlace& place)
{
    const Rows rows = rowsOf(light);
    return std::max({rows.r[1][0], rows.r[1][1], rows.r[1][2]}) * samplePackedLight<double>(rows.r, &p.x, double(place.worldScale) * place.worldScale).falloff;
}

size_t slotsThatDiffer(const InstanceLights& a, const InstanceLights& b)
{
    size_t differ = 0;
    for (size_t s = 0; s < b.packed.size(); ++s) differ += s >= a.packed.size() || !(a.packed[s] == b.packed[s]);
    return differ;
}

std::vector<NacreLight> manyLights(Random& random, int count)
{
    std::vector<NacreLight> lights;
    for (int i = 0; i < count; ++i) lights.push_back(light(NACRE_LIGHT_POINT, random.box(glm::dvec3(-2), glm::dvec3(2)), {0, 0, 1}, random.in(1, 2)));
    return lights;
}

} // namespace

TEST_CASE("packed point, spot and range-limited lights are those of KHR_lights_punctual")
{
    Random random(1);
    for (int i = 0; i < 500; ++i) {
        NacreLight l = randomLight(random, 3);
        l.type = i % 2 ? NACRE_LIGHT_SPOT : NACRE_LIGHT_POINT;
        const glm::dmat4 worldFromAsset = random.place();
        const InstancePlace place = placeAt(worldFromAsset);
        LightSet set;
        set.setLights({&l, 1});
        REQUIRE(set.points().size() == 1);
        InstancePlace wide = place; // so that it is never left out
        wide.boundsMin = glm::vec3(-1e4f), wide.boundsMax = glm::vec3(1e4f);
        InstanceLights lights;
        packLights(set, wide, &lights);
        REQUIRE(lights.packed.size() == 1);
        const Rows rows = rowsOf(lights.packed[0]);
        const glm::dvec3 p = random.box(place.boundsMin, place.boundsMax), world = worldFromAsset * glm::dvec4(p, 1);
        const auto s = samplePackedLight<double>(rows.r, &p.x, double(place.worldScale) * place.worldScale);

        const glm::dvec3 to = glm::dvec3(l.position[0], l.position[1], l.position[2]) - world;
        const double distance = glm::length(to);
        double expected = 1 / std::max(distance * distance, double(l.radius) * l.radius);
        if (l.range > 0) expected *= std::max(std::min(1 - std::pow(distance / double(l.range), 4), 1.0), 0.0);
        if (l.type == NACRE_LIGHT_SPOT) {
            const double scale = 1 / std::max(0.001, std::cos(double(l.innerCone)) - std::cos(double(l.outerCone))), offset = -std::cos(double(l.outerCone)) * scale;
            const double cosine = -glm::dot(glm::dvec3(l.direction[0], l.direction[1], l.direction[2]), to) / distance;
            expected *= std::pow(std::clamp(cosine * scale + offset, 0.0, 1.0), 2);
        }
        CHECK(s.falloff == doctest::Approx(expected).epsilon(1e-3).scale(1 / (distance * distance))); // rows are float; steep cones
        const glm::dvec3 asset = glm::normalize(glm::dmat3(place.assetFromWorld) * to);
        for (int c = 0; c < 3; ++c) CHECK(std::abs(s.direction[c] - asset[c]) < 1e-4); // positions in float near the light
    }
}

TEST_CASE("bounds of a light hold at every place of the box, and what is left out is less than its share")
{
    Random random(2);
    size_t skipped = 0;
    for (int round = 0; round < 60; ++round) {
        const InstancePlace place = placeAt(random.place());
        std::vector<NacreLight> hosts;
        for (int i = 0; i < 40; ++i) hosts.push_back(randomLight(random, round % 2 ? 4 : 40));
        LightSet set;
        set.setLights(hosts);
        InstanceLights kept;
        packLights(set, place, &kept);
        skipped += kept.skipped;
        // all of them, as they would be without the others
        InstanceLights all;
        for (const NacreLight& host : hosts) {
            LightSet one;
            one.setLights({&host, 1});
            InstanceLights alone;
            packLights(one, place, &alone);
            all.packed.insert(all.packed.end(), alone.packed.begin(), alone.packed.end());
        }
        for (int k = 0; k < 200; ++k) {
            glm::dvec3 p = random.box(place.boundsMin, place.boundsMax);
            if (k < 8)
                for (int c = 0; c < 3; ++c) p[c] = k >> c & 1 ? place.boundsMin[c] : place.boundsMax[c];
            double whole = 0, left = 0;
            for (const PackedLight& l : all.packed) {
                const double e = irradiance(l, p, place);
                const LightBounds bounds = boundLight(l, place);
                REQUIRE(e >= bounds.least);
                REQUIRE(e <= bounds.most);
                whole += e;
            }
            for (const PackedLight& l : kept.packed) left += irradiance(l, p, place);
            REQUIRE(whole - left <= kLeastShare * whole);
        }
    }
    CHECK(skipped > 200); // else nothing was tried
}

TEST_CASE("lights that may be shadowed let none of the others be left out")
{
    NacreLight hosts[2] = {light(NACRE_LIGHT_DIRECTIONAL, {}, {0, 0, 1}, 1e6), light(NACRE_LIGHT_POINT, {1, 0, 0}, {}, 1e-3)};
    LightSet set;
    InstanceLights lights;
    set.setLights(hosts);
    packLights(set, placeAt(glm::dmat4(1)), &lights);
    CHECK(lights.packed.size() == 1);
    hosts[0].flags = NACRE_LIGHT_SPLAT_SHADOWS;
    set.setLights(hosts);
    packLights(set, placeAt(glm::dmat4(1)), &lights);
    CHECK(lights.packed.size() == 2);
}

TEST_CASE("masks: a light and an instance need a bit in common")
{
    NacreLight l = light(NACRE_LIGHT_POINT, {1, 1, 1}, {}, 1);
    for (const uint32_t lightMask : {0u, 1u, 6u, 0x80000000u})
        for (const uint32_t instanceMask : {~0u, 1u, 2u, 0x80000000u}) {
            l.mask = lightMask;
            LightSet set;
            set.setLights({&l, 1});
            InstanceLights lights;
            packLights(set, placeAt(glm::dmat4(1), instanceMask), &lights);
            const bool lit = lightMask == 0 || (lightMask & instanceMask);
            CHECK(lights.packed.size() == size_t(lit));
            CHECK(lights.skipped == size_t(!lit));
        }
}

TEST_CASE("of 300 lights one that comes, goes, moves or changes touches one slot")
{
    Random random(3);
    std::vector<NacreLight> hosts = manyLights(random, 300);
    LightSet set;
    set.setLights(hosts);
    InstanceLights lights;
    const InstancePlace place = placeAt(random.place());
    packLights(set, place, &lights);
    REQUIRE(lights.packed.size() == 300);
    for (int i = 0; i < 200; ++i) {
        const InstanceLights before = lights;
        const auto at = hosts.begin() + ptrdiff_t(random.in(0, double(hosts.size()) - 0.01));
        switch (i % 5) {
        case 0: hosts.erase(at); break;
        case 1: hosts.insert(at, manyLights(random, 1)[0]); break;
        case 2: at->position[0] += 0.1f; break;
        case 3: at->intensity[1] *= 0.5f; break;
        case 4: std::swap(*at, hosts.front()); break; // the order of the host's lights does not matter
        }
        set.setLights(hosts);
        packLights(set, place, &lights);
        CHECK(lights.packed.size() == hosts.size());
        CHECK(slotsThatDiffer(before, lights) <= size_t(i % 5 != 4));
        for (size_t s = 0; s < lights.packed.size(); ++s) { // each slot is what its point says
            const glm::vec3 world = glm::inverse(place.assetFromWorld) * glm::dvec4(glm::vec3(lights.packed[s].row[0]), 1);
            REQUIRE(glm::distance(world, glm::vec3(set.points()[lights.point[s]].position)) < 1e-4f); // float at distances of 3 / scale
        }
    }
}

TEST_CASE("whatever comes, goes and moves, the slots hold what they would had all of it been there at once")
{
    Random random(10);
    for (int run = 0; run < 10; ++run) {
        std::vector<NacreLight> hosts;
        LightSet set;
        InstanceLights lights;
        InstancePlace place = placeAt(random.place());
        for (int step = 0; step < 60; ++step) {
            for (int k = int(random.in(0, 6)); k > 0; --k) {
                if (random.in(0, 1) < 0.4) hosts.insert(hosts.begin() + ptrdiff_t(random.in(0, double(hosts.size()) + 0.99)), randomLight(random, 6));
                else if (!hosts.empty() && random.in(0, 1) < 0.5) hosts.erase(hosts.begin() + ptrdiff_t(random.in(0, double(hosts.size()) - 0.01)));
                else if (!hosts.empty()) hosts[size_t(random.in(0, double(hosts.size()) - 0.01))] = randomLight(random, 6);
            }
            if (step % 9 == 8) place = placeAt(random.place(), 1u << step % 3);
            for (NacreLight& l : hosts) l.mask = 3;
            set.setLights(hosts);
            packLights(set, place, &lights);
            InstanceLights fresh;
            packLights(set, place, &fresh);
            REQUIRE(lights.packed.size() == fresh.packed.size());
            REQUIRE(lights.skipped == fresh.skipped);
            REQUIRE(lights.packed.size() == lights.point.size());
            std::vector<int> of(set.points().size(), -1);
            for (size_t s = 0; s < fresh.point.size(); ++s) of[fresh.point[s]] = int(s);
            for (size_t s = 0; s < lights.point.size(); ++s) {
                const int there = std::exchange(of[lights.point[s]], -1);
                REQUIRE(there >= 0);
                REQUIRE(lights.packed[s] == fresh.packed[size_t(there)]);
            }
        }
    }
}

TEST_CASE("lights keep their slots when the instance moves")
{
    Random random(4);
    LightSet set;
    set.setLights(manyLights(random, 50));
    InstanceLights lights;
    packLights(set, placeAt(random.place()), &lights);
    const std::vector<uint32_t> before = lights.point;
    CHECK(packLights(set, placeAt(random.place()), &lights));
    CHECK(lights.point == before);
}

TEST_CASE("at rest nothing is done: the same lights again are no change")
{
    Random random(5);
    std::vector<NacreLight> hosts;
    for (int i = 0; i < 100; ++i) hosts.push_back(randomLight(random, 3));
    LightSet set;
    set.setLights(hosts);
    const uint64_t revision = set.revision();
    InstanceLights lights;
    const InstancePlace place = placeAt(random.place());
    CHECK(packLights(set, place, &lights));
    set.setLights(hosts);
    CHECK(set.revision() == revision);
    CHECK_FALSE(packLights(set, place, &lights));
    hosts[7].radius *= 2;
    set.setLights(hosts);
    CHECK(set.revision() != revision);
}

// ---- area lights -------------------------------------------------------------------------------------------------------------------

namespace {

/// A splat of each model: smooth transport, a highlight, a map with one soft horizon.
struct Receiver {
    glm::dvec3 position;
    double tDir[25], tInd[75], rho[3], lobe[7], shadow;
    std::vector<uint8_t> map;
    SssSurface<double> surface;
};

glm::dvec3 octahedral(int i, int j, int n)
{
    const double u = (i + 0.5) / n * 2 - 1, v = (j + 0.5) / n * 2 - 1, z = 1 - std::abs(u) - std::abs(v);
    if (z >= 0) return glm::normalize(glm::dvec3(u, v, z));
    return glm::normalize(glm::dvec3((1 - std::abs(v)) * (u < 0 ? -1 : 1), (1 - std::abs(u)) * (v < 0 ? -1 : 1), z));
}

Receiver receiver(Random& random)
{
    Receiver r;
    r.position = 0.4 * random.direction();
    for (int i = 0; i < 25; ++i) r.tDir[i] = i == 0 ? 0.75 + random.in(-0.2, 0.2) : random.in(-0.3, 0.3);
    for (double& t : r.tInd) t = random.in(-0.1, 0.1);
    const glm::dvec3 normal = glm::normalize(r.position + 0.1 * random.direction());
    for (int c = 0; c < 3; ++c) {
        r.rho[c] = r.surface.base[c] = random.in(0, 1);
        r.lobe[c] = r.surface.normal[c] = normal[c];
        r.lobe[4 + c] = random.in(0, 2);
    }
    r.lobe[3] = 0.1 * std::pow(3000, random.in(0, 1)); // sharpness to 300
    r.shadow = random.in(0, 1);
    const double horizon = random.in(-0.3, 0.3), width = random.in(0.05, 0.3);
    for (int j = 0; j < 32; ++j)
        for (int i = 0; i < 32; ++i)
            r.map.push_back(uint8_t(255 * std::clamp((glm::dot(octahedral(i, j, 32), normal) + horizon) / width + 0.5, 0.0, 1.0)));
    r.surface.roughness = random.in(0.3, 1), r.surface.metalness = random.in(0, 1), r.surface.diffuse = random.in(0, 1);
    return r;
}

/// Radiance of both models.
std::array<double, 6> shade(const Receiver& r, std::span<const Rows> lights)
{
    const glm::dvec3 wo = glm::normalize(glm::dvec3(1.5, 1, 2) - r.position);
    const BigsCoefficients<double> k{r.tDir, r.tInd, r.rho, nullptr, 0, r.lobe, {r.map.data(), 32}, r.shadow};
    std::array<double, 6> sum{};
    for (const Rows& l : lights) {
        const auto s = samplePackedLight<double>(l.r, &r.position.x, 1.0);
        double y[25];
        shBasis(25, s.direction[0], s.direction[1], s.direction[2], y);
        const BigsTerms<double> terms = bigsTerms<double>(k, nullptr, y);
        const BigsSharpTerms<double> sharp = bigsSharpTerms(k, &wo.x, s.direction, s.widening);
        const SssReflection<double> reflected = sssReflect(r.surface, &wo.x, s.direction, s.widening);
        const double visible = mapVisibility(k.visibility, s.direction);
        for (int c = 0; c < 3; ++c) {
            const double arriving = l.r[1][c] * s.falloff;
            sum[size_t(c)] += arriving * bigsTransport(terms, sharp, c);
            sum[size_t(3 + c)] += arriving * visible * reflected.value[c];
        }
    }
    return sum;
}

/// A point of a surface that shines with the cosine about `axis`.
Rows emitter(const glm::dvec3& position, const glm::dvec3& axis, const float intensity[3], double share)
{
    Rows rows{};
    for (int c = 0; c < 3; ++c) rows.r[0][c] = position[c], rows.r[1][c] = intensity[c] * share, rows.r[2][c] = axis[c];
    rows.r[0][3] = 1e-6, rows.r[2][3] = 1, rows.r[3][3] = kEmitsCosine;
    return rows;
}

std::vector<Rows> surfaceOf(const NacreLight& l)
{
    std::vector<Rows> points;
    const glm::dvec3 centre(l.position[0], l.position[1], l.position[2]);
    if (l.type == NACRE_LIGHT_SPHERE) {
        constexpr int n = 2000; // half of them shine to a place: those give I / r^2 in all, so each has four times its share
        for (int i = 0; i < n; ++i) points.push_back(emitter(centre + double(l.radius) * fibonacciDirection(i, n), fibonacciDirection(i, n), l.intensity, 4.0 / n));
        return points;
    }
    const glm::dvec3 axis(l.direction[0], l.direction[1], l.direction[2]), width(l.halfWidth[0], l.halfWidth[1], l.halfWidth[2]);
    const glm::dvec3 height = double(l.halfHeight) * glm::normalize(glm::cross(axis, width));
    constexpr int n = 32;
    for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x)
            points.push_back(emitter(centre + ((2 * x + 1.0) / n - 1) * width + ((2 * y + 1.0) / n - 1) * height, axis, l.intensity, 1.0 / (n * n)));
    return points;
}

std::vector<Rows> pointsOf(const NacreLight& l)
{
    LightSet set;
    set.setLights({&l, 1});
    InstanceLights lights;
    packLights(set, placeAt(glm::dmat4(1)), &lights);
    std::vector<Rows> rows;
    for (const PackedLight& p : lights.packed) rows.push_back(rowsOf(p));
    return rows;
}

NacreLight areaLight(NacreLightType type, double distance)
{
    const glm::dvec3 towards = glm::normalize(glm::dvec3(0.4, 0.7, 0.6)), axis = glm::normalize(-towards + glm::dvec3(0.2, -0.1, 0.3));
    NacreLight l = light(type, distance * towards, axis, distance * distance);
    l.radius = 0.5f;
    store(l.halfWidth, 0.5 * glm::normalize(glm::cross(axis, glm::dvec3(0, 1, 0.2))));
    l.halfHeight = 0.3f;
    return l;
}

} // namespace

TEST_CASE("few points in the place of an area light: 45 dB and more against thousands, both models, from 1.5 times its size on")
{
    Random random(6);
    std::vector<Receiver> receivers;
    for (int i = 0; i < 300; ++i) receivers.push_back(receiver(random));
    for (const NacreLightType type : {NACRE_LIGHT_SPHERE, NACRE_LIGHT_RECTANGLE}) {
        size_t fewest = 1000;
        for (const double distance : {1.9, 2.5, 3.4, 5.0, 6.0, 12.0, 25.0}) { // from the middle of a ball of radius 0.4; the light is 1 wide
            const NacreLight l = areaLight(type, distance);
            const std::vector<Rows> few = pointsOf(l), surface = surfaceOf(l);
            double squares[2] = {};
            for (const Receiver& r : receivers) {
                const auto found = shade(r, few), expected = shade(r, surface);
                for (size_t c = 0; c < 6; ++c) squares[c / 3] += std::pow(std::clamp(found[c], 0.0, 1.0) - std::clamp(expected[c], 0.0, 1.0), 2);
            }
            CAPTURE(type);
            CAPTURE(distance);
            CAPTURE(few.size());
            for (const double s : squares) CHECK(-10 * std::log10(s / (3 * double(receivers.size()))) >= 45);
            CHECK(few.size() <= fewest); // fewer and fewer from afar
            fewest = few.size();
        }
        CHECK(fewest == 1);
    }
}

TEST_CASE("an area light becomes as many points as asked for; more of them come closer")
{
    Random random(7);
    std::vector<Receiver> receivers;
    for (int i = 0; i < 50; ++i) receivers.push_back(receiver(random));
    for (const NacreLightType type : {NACRE_LIGHT_SPHERE, NACRE_LIGHT_RECTANGLE}) {
        NacreLight l = areaLight(type, 2);
        const std::vector<Rows> surface = surfaceOf(l);
        double last = 0;
        for (const uint32_t samples : {1u, 7u, 60u, 500u}) {
            l.samples = samples;
            const std::vector<Rows> points = pointsOf(l);
            if (type == NACRE_LIGHT_SPHERE) CHECK(points.size() == samples);
            CHECK(points.size() <= samples);
            CHECK(points.size() >= 0.8 * samples);
            double total = 0, squares = 0;
            for (const Rows& r : points) total += r.r[1][0];
            CHECK(total == doctest::Approx(l.intensity[0]).epsilon(1e-4)); // f32 sum
            for (const Receiver& r : receivers) {
                const auto found = shade(r, points), expected = shade(r, surface);
                for (size_t c = 0; c < 6; ++c) squares += std::pow(found[c] - expected[c], 2);
            }
            const double quality = -10 * std::log10(squares);
            CHECK(quality > last + 3);
            last = quality;
        }
    }
}

TEST_CASE("a rectangle shines to one side only, brightest along its direction")
{
    NacreLight l = light(NACRE_LIGHT_RECTANGLE, {0, 0, 100}, {0, 0, -1}, 10000);
    l.halfWidth[0] = 1, l.halfHeight = 1;
    const double front[3] = {0, 0, 0}, aside[3] = {100, 0, 0}, behind[3] = {0, 0, 200};
    double sums[3] = {};
    for (const Rows& r : pointsOf(l)) {
        sums[0] += r.r[1][0] * samplePackedLight<double>(r.r, front, 1.0).falloff;
        sums[1] += r.r[1][0] * samplePackedLight<double>(r.r, aside, 1.0).falloff;
        sums[2] += r.r[1][0] * samplePackedLight<double>(r.r, behind, 1.0).falloff;
    }
    CHECK(sums[0] == doctest::Approx(1).epsilon(1e-3)); // I / r^2
    CHECK(sums[1] == doctest::Approx(0.5 / std::sqrt(2)).epsilon(0.02)); // twice as far squared, at 45 degrees
    CHECK(sums[2] == 0);
}

// ---- environment -------------------------------------------------------------------------------------------------------------------

namespace {

std::vector<LightPoint> environmentPoints(NacreEnvironment e)
{
    e.structSize = sizeof e;
    NacreEnvironment copy;
    const Failure f = readEnvironment(e, &copy);
    REQUIRE_MESSAGE(!f, f.text);
    LightSet set;
    set.setEnvironment(&copy);
    return set.points();
}

glm::dvec3 towards(const std::vector<LightPoint>& points)
{
    glm::dvec3 sum(0);
    for (const LightPoint& p : points) sum += double(p.intensity.g) * glm::dvec3(p.direction);
    return glm::normalize(sum);
}

} // namespace

TEST_CASE("environment pixels: -Z in the middle, +X to its right, +Y up")
{
    constexpr int w = 64, h = 32;
    const struct {
        int x, y;
        glm::dvec3 direction;
    } cases[] = {{32, 16, {0, 0, -1}}, {48, 16, {1, 0, 0}}, {16, 15, {-1, 0, 0}}, {0, 16, {0, 0, 1}}, {63, 15, {0, 0, 1}}, {9, 0, {0, 1, 0}}, {40, 31, {0, -1, 0}}};
    for (const auto& c : cases) {
        std::vector<float> pixels(3 * w * h);
        for (int k = 0; k < 3; ++k) pixels[size_t(3 * (c.y * w + c.x) + k)] = 100;
        NacreEnvironment e{};
        e.width = w, e.height = h, e.pixels = pixels.data();
        CHECK(glm::dot(towards(environmentPoints(e)), c.direction) > std::cos(0.08)); // half a texel's diagonal is 0.07 rad
    }
}

TEST_CASE("an environment that turns turns its directions; only those change")
{
    Random random(8);
    std::vector<float> pixels;
    for (int i = 0; i < 3 * 32 * 16; ++i) pixels.push_back(float(std::exp(random.in(-3, 3))));
    NacreEnvironment e{};
    e.width = 32, e.height = 16, e.pixels = pixels.data(), e.directions = 40;
    const std::vector<LightPoint> still = environmentPoints(e);
    REQUIRE(still.size() == 40);
    const glm::dmat3 turn(glm::rotate(glm::dmat4(1), 0.3, glm::dvec3(0.6, 0.8, 0)));
    for (int c = 0; c < 3; ++c) store(e.worldFromMap + 3 * c, turn[c]);
    const std::vector<LightPoint> turned = environmentPoints(e);
    REQUIRE(turned.size() == 40);
    for (size_t i = 0; i < still.size(); ++i) {
        CHECK(glm::length(turn * glm::dvec3(still[i].direction) - glm::dvec3(turned[i].direction)) < 1e-6); // f32
        CHECK(turned[i].intensity == still[i].intensity);
        CHECK(turned[i].sourceRadius == still[i].sourceRadius);
    }
}

TEST_CASE("coefficients and the pixels that they stand for light alike; one of them is the same light from everywhere")
{
    Random random(9);
    for (const uint32_t count : {1u, 4u, 9u, 16u, 25u}) {
        std::vector<float> sh(3 * count);
        for (uint32_t i = 0; i < 3 * count; ++i) sh[i] = i < 3 ? 10.0f : float(random.in(-1, 1) / std::sqrt(count)); // nowhere negative
        constexpr int w = 256, h = 128;
        std::vector<float> pixels;
        double total = 0;
        for (int y = 0; y < h; ++y)
            for (int x = 0; x < w; ++x) {
                const double up = std::numbers::pi * (0.5 - (y + 0.5) / h), around = 2 * std::numbers::pi * ((x + 0.5) / w - 0.5); // from -Z towards +X
                double basis[kMaxShFunctions];
                shBasis(int(count), std::cos(up) * std::sin(around), std::sin(up), -std::cos(up) * std::cos(around), basis);
                for (uint32_t c = 0; c < 3; ++c) {
                    double radiance = 0;
                    for (uint32_t i = 0; i < count; ++i) radiance += double(sh[3 * i + c]) * basis[i];
                    pixels.push_back(float(radiance));
                }
            }
        NacreEnvironment e{};
        e.sh = sh.data(), e.shCount = count, e.directions = 256;
        const std::vector<LightPoint> fromSh = environmentPoints(e);
        e.sh = nullptr, e.shCount = 0, e.pixels = pixels.data(), e.width = w, e.height = h;
        const std::vector<LightPoint> fromPixels = environmentPoints(e);
        for (const LightPoint& p : fromSh) total += double(p.intensity.g);
        CHECK(total == doctest::Approx(10 * 0.28209479177387814 * 4 * std::numbers::pi).epsilon(1e-3)); // of function 0; the map has 128 columns
        for (int k = 0; k < 20; ++k) { // irradiance of planes that face anywhere
            const glm::dvec3 normal = random.direction();
            double a = 0, b = 0;
            for (const LightPoint& p : fromSh) a += double(p.intensity.g) * std::max(glm::dot(normal, glm::dvec3(p.direction)), 0.0);
            for (const LightPoint& p : fromPixels) b += double(p.intensity.g) * std::max(glm::dot(normal, glm::dvec3(p.direction)), 0.0);
            CHECK(a == doctest::Approx(b).epsilon(0.01)); // of 256 directions
        }
    }
}

TEST_CASE("environment: masks, intensity and number of directions; null takes it away; the same again is no change")
{
    const float white[3] = {1, 1, 1};
    NacreEnvironment e{};
    e.structSize = sizeof e, e.width = e.height = 1, e.pixels = white, e.intensity = 2, e.mask = 4, e.directions = 20;
    LightSet set;
    set.setEnvironment(&e);
    REQUIRE(set.points().size() == 20);
    double total = 0;
    for (const LightPoint& p : set.points()) {
        CHECK(p.mask == 4);
        CHECK(p.directional);
        CHECK(p.source == kEnvironmentSource);
        total += double(p.intensity.r);
    }
    CHECK(total == doctest::Approx(8 * std::numbers::pi).epsilon(1e-5));
    const uint64_t revision = set.revision();
    set.setEnvironment(&e);
    CHECK(set.revision() == revision);
    const NacreLight l = light(NACRE_LIGHT_POINT, {}, {}, 1);
    set.setLights({&l, 1});
    CHECK(set.points().size() == 21);
    set.setEnvironment(nullptr);
    CHECK(set.points().size() == 1);
    e.directions = 0;
    set.setEnvironment(&e);
    CHECK(set.points().size() == 1 + 64);
}

// ---- what hosts may say --------------------------------------------------------------------------------------------------------------

TEST_CASE("lights that are not as they should be are refused by name")
{
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    NacreLight spot = light(NACRE_LIGHT_SPOT, {1, 2, 3}, {0, 0, -1}, 1), rectangle = spot, sphere = spot, sun = spot, point = spot;
    spot.innerCone = 0.2f, spot.outerCone = 0.5f;
    rectangle.type = NACRE_LIGHT_RECTANGLE, rectangle.halfWidth[0] = 1, rectangle.halfHeight = 1;
    sphere.type = NACRE_LIGHT_SPHERE, sphere.radius = 1;
    sun.type = NACRE_LIGHT_DIRECTIONAL, sun.radius = 0.005f;
    point.type = NACRE_LIGHT_POINT;
    for (const NacreLight& l : {spot, rectangle, sphere, sun, point}) CHECK_MESSAGE(!checkLight(l, 0), checkLight(l, 0).text);

    const auto fails = [](NacreLight l, const char* word, const std::function<void(NacreLight&)>& spoil) {
        spoil(l);
        const Failure f = checkLight(l, 7);
        CAPTURE(f.text);
        CHECK(f.code == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(f.text.find("light 7") != std::string::npos);
        CHECK(f.text.find(word) != std::string::npos);
    };
    for (const float bad : {nan, inf, -inf, -1.0f}) {
        fails(point, "intensity", [&](NacreLight& l) { l.intensity[1] = bad; });
        fails(point, "radius", [&](NacreLight& l) { l.radius = bad; });
        fails(sun, "radius", [&](NacreLight& l) { l.radius = bad; });
        fails(spot, "range", [&](NacreLight& l) { l.range = bad; });
        fails(spot, "cones", [&](NacreLight& l) { l.innerCone = bad; });
        fails(spot, "cones", [&](NacreLight& l) { l.outerCone = bad; });
        fails(rectangle, "halfHeight", [&](NacreLight& l) { l.halfHeight = bad; });
    }
    for (const float bad : {nan, inf, 2e15f}) {
        fails(sphere, "position", [&](NacreLight& l) { l.position[2] = bad; });
        fails(sun, "direction", [&](NacreLight& l) { l.direction[2] = bad; });
        fails(rectangle, "halfWidth", [&](NacreLight& l) { l.halfWidth[0] = bad; });
    }
    fails(spot, "direction", [](NacreLight& l) { l.direction[2] = -2; });
    fails(spot, "cones", [](NacreLight& l) { l.innerCone = l.outerCone; });
    fails(spot, "cones", [](NacreLight& l) { l.outerCone = 1.6f; });
    fails(sphere, "radius", [](NacreLight& l) { l.radius = 0; });
    fails(sphere, "samples", [](NacreLight& l) { l.samples = 1025; });
    fails(rectangle, "halfWidth", [](NacreLight& l) { l.halfWidth[0] = 0; });
    fails(rectangle, "right angle", [](NacreLight& l) { l.halfWidth[2] = 1; });
    fails(point, "flags", [](NacreLight& l) { l.flags = 64; });
    fails(point, "type", [](NacreLight& l) {
        const int foreign = 1234;
        std::memcpy(&l.type, &foreign, sizeof foreign);
    });
    point.direction[0] = point.halfHeight = point.innerCone = nan, point.samples = 99999; // what its kind does not use
    CHECK_FALSE(checkLight(point, 0));
}

TEST_CASE("older hosts' lights have zeros for what they do not know; newer hosts' are refused")
{
    const size_t old = offsetof(NacreLight, range);
    std::vector<unsigned char> bytes(3 * old);
    for (size_t i = 0; i < 3; ++i) {
        NacreLight l = light(NACRE_LIGHT_POINT, {double(i), 0, 0}, {}, 1);
        l.structSize = old, l.radius = 0.5f, l.range = 3;
        std::memcpy(&bytes[i * old], &l, old);
    }
    std::vector<NacreLight> copies;
    REQUIRE_FALSE(readLights(reinterpret_cast<const NacreLight*>(bytes.data()), 3, &copies));
    REQUIRE(copies.size() == 3);
    CHECK(copies[2].position[0] == 2);
    CHECK(copies[2].radius == 0.5f);
    CHECK(copies[2].range == 0);
    NacreLight l = light(NACRE_LIGHT_POINT, {}, {}, 1);
    for (const size_t size : {size_t(0), size_t(1), sizeof l + 8}) {
        l.structSize = size;
        CHECK(readLights(&l, 1, &copies).text.find("NacreLight.structSize") != std::string::npos);
    }
    CHECK(readLights(nullptr, 1, &copies));
    CHECK_FALSE(readLights(nullptr, 0, &copies));
    CHECK(copies.empty());
}

TEST_CASE("environments that are not as they should be are refused by name")
{
    const float pixels[12] = {1, 2, 3, -1, 0, 0, 1, 1, 1, 1, 1, 1};
    NacreEnvironment good{};
    good.structSize = sizeof good, good.width = 2, good.height = 2, good.pixels = pixels;
    NacreEnvironment copy;
    CHECK_MESSAGE(!readEnvironment(good, &copy), readEnvironment(good, &copy).text);
    const auto fails = [&](const char* word, const std::function<void(NacreEnvironment&)>& spoil) {
        NacreEnvironment e = good;
        spoil(e);
        const Failure f = readEnvironment(e, &copy);
        CAPTURE(f.text);
        CHECK(f.code == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(f.text.find(word) != std::string::npos);
    };
    float spoilt[12];
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), 1e16f}) {
        std::copy_n(pixels, 12, spoilt);
        spoilt[7] = bad;
        fails("pixel (0, 1)", [&](NacreEnvironment& e) { e.pixels = spoilt; });
        fails("sh[7]", [&](NacreEnvironment& e) { e.pixels = nullptr, e.sh = spoilt, e.shCount = 4; });
        fails("intensity", [&](NacreEnvironment& e) { e.intensity = bad; });
        fails("worldFromMap", [&](NacreEnvironment& e) { e.worldFromMap[4] = bad; });
    }
    fails("pixels", [](NacreEnvironment& e) { e.width = 0; });
    fails("pixels", [](NacreEnvironment& e) { e.height = 8193; });
    fails("pixels", [](NacreEnvironment& e) { e.pixels = nullptr; });
    fails("only one", [&](NacreEnvironment& e) { e.sh = pixels; });
    fails("shCount", [&](NacreEnvironment& e) { e.pixels = nullptr, e.sh = pixels, e.shCount = 3; });
    fails("directions", [](NacreEnvironment& e) { e.directions = 1025; });
    fails("worldFromMap", [](NacreEnvironment& e) { e.worldFromMap[0] = 1; });
    fails("structSize", [](NacreEnvironment& e) { e.structSize = 3; });
}
