// Sharing T_ind's dependence on the light between neighbours: what it must keep, what it must remove.
#include "appearance/bigs/indirect_sharing.h"
#include "base/random.h"
#include "splat/splat_normals.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>

using namespace nacre;

namespace {

GaussianGeometry<float> splatAt(float x, float y, float z)
{
    GaussianGeometry<float> g{};
    g.position[0] = x, g.position[1] = y, g.position[2] = z;
    g.rotation[0] = 1;
    g.scale[0] = g.scale[1] = 0.1f, g.scale[2] = 0.01f;
    g.opacity = 0.9f;
    return g;
}

// Two sheets closer to each other than splats are, facing away from each other: a thin plate of 2 x 20 x 20.
struct Plate {
    std::vector<GaussianGeometry<float>> splats;
    std::vector<glm::vec3> normals;
    Plate()
    {
        for (int i = 0; i < 800; ++i) {
            const float side = i % 2 ? 1.0f : -1.0f;
            splats.push_back(splatAt(0.1f * float(i / 2 % 20), 0.1f * float(i / 40), 0.01f * side));
            normals.push_back({0, 0, side});
        }
    }
};

// The same dependence on the light for all (`shape`), each with its own brightness per channel; `noise` on top, relative to band 0.
BigsParameters shared(size_t count, const float* shape, float noise)
{
    BigsParameters p;
    p.resize(count);
    Random random(4);
    for (size_t i = 0; i < count; ++i)
        for (size_t c = 0; c < 3; ++c) {
            const float bright = 0.1f + random.uniform();
            for (size_t k = 0; k < 25; ++k)
                p.value[p.index(i, kTInd + int(3 * k + c))] = bright * (shape[k] + (k ? noise * (2 * random.uniform() - 1) : 0));
        }
    return p;
}

double deviation(const BigsParameters& p, const float* shape) // root mean square from shape x own band 0, relative to that
{
    double sum = 0;
    for (size_t i = 0; i < p.count; ++i)
        for (int c = 0; c < 3; ++c)
            for (int k = 1; k < 25; ++k) {
                const double own = p.value[p.index(i, kTInd + c)] / shape[0];
                sum += std::pow(p.value[p.index(i, kTInd + 3 * k + c)] / own - shape[k], 2);
            }
    return std::sqrt(sum / double(72 * p.count));
}

const std::vector<float> kShape = [] {
    std::vector<float> shape(25);
    for (size_t k = 0; k < 25; ++k) shape[k] = k == 0 ? 1.0f : 0.6f * std::sin(1.7f * float(k)) / float(1 + k);
    return shape;
}();

} // namespace

TEST_CASE("neighbours are the nearest of the same side; a lone splat is its own")
{
    const Plate plate;
    const std::vector<uint32_t> neighbours = splatNeighbours(plate.splats, plate.normals);
    REQUIRE(neighbours.size() == 800 * kSplatNeighbours);
    for (size_t i = 0; i < 800; ++i)
        for (size_t k = 0; k < kSplatNeighbours; ++k) {
            const uint32_t j = neighbours[i * kSplatNeighbours + k];
            REQUIRE(j < 800);
            CHECK(j != i);
            CHECK(j % 2 == i % 2);
            const auto& a = plate.splats[i].position;
            const auto& b = plate.splats[j].position;
            CHECK(std::hypot(a[0] - b[0], a[1] - b[1]) < 0.31f); // in a corner of the lattice the eighth lies furthest
        }
    const std::vector<GaussianGeometry<float>> apart = {splatAt(0, 0, 0), splatAt(5, 0, 0)};
    const std::vector<glm::vec3> up(2, glm::vec3(0, 0, 1));
    for (size_t k = 0; k < kSplatNeighbours; ++k) CHECK(splatNeighbours(apart, up)[kSplatNeighbours + k] == 1);
    CHECK(splatNeighbours({}, {}).empty());
}

TEST_CASE("sharing indirect light keeps what neighbours agree on and every splat's own brightness, and removes noise")
{
    const Plate plate;
    const std::vector<uint32_t> neighbours = splatNeighbours(plate.splats, plate.normals);
    std::vector<float> scratch;

    BigsParameters agreed = shared(800, kShape.data(), 0);
    const AlignedVector<float> before = agreed.value;
    for (int k = 0; k < 100; ++k) shareIndirect(agreed, neighbours, 25, 0.5f, scratch);
    for (size_t k = 0; k < before.size(); ++k) CHECK(std::abs(agreed.value[k] - before[k]) < 1e-5f);

    BigsParameters noisy = shared(800, kShape.data(), 0.3f);
    const BigsParameters start = noisy;
    const double first = deviation(noisy, kShape.data());
    CHECK(first > 0.15);
    for (int k = 0; k < 100; ++k) shareIndirect(noisy, neighbours, 25, 0.1f, scratch);
    CHECK(deviation(noisy, kShape.data()) < 0.2 * first);
    for (size_t i = 0; i < noisy.count; ++i)
        for (int k = 0; k < noisy.coefficients(); ++k)
            if (k < kTInd + 3 || k >= kTInd + 75) CHECK(noisy.value[noisy.index(i, k)] == start.value[start.index(i, k)]);

    BigsParameters low = start; // bands that are not in use yet stay
    shareIndirect(low, neighbours, 4, 0.5f, scratch);
    CHECK(low.value[low.index(7, kTInd + 12)] == start.value[start.index(7, kTInd + 12)]);
    CHECK(low.value[low.index(7, kTInd + 9)] != start.value[start.index(7, kTInd + 9)]);
}

TEST_CASE("sharing indirect light: dark, negative and enormous neighbours; any number of threads")
{
    const Plate plate;
    const std::vector<uint32_t> neighbours = splatNeighbours(plate.splats, plate.normals);
    BigsParameters hard = shared(800, kShape.data(), 3.0f); // far beyond what a non-negative function can be
    for (size_t i = 0; i < 800; i += 3)
        for (int c = 0; c < 3; ++c) hard.value[hard.index(i, kTInd + c)] = i % 2 ? 0.0f : i % 5 ? 1e-20f : i % 7 ? -1.0f : 1e20f;
    const BigsParameters start = hard;
    std::vector<float> scratch;
    const auto run = [&](int threads) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        BigsParameters p = start;
        for (int k = 0; k < 50; ++k) shareIndirect(p, neighbours, 25, 0.5f, scratch);
        return p.value;
    };
    const AlignedVector<float> one = run(1);
    CHECK(one == run(3));
    for (float x : one) CHECK(std::isfinite(x));
    for (size_t i = 0; i < 800; ++i)
        for (int c = 0; c < 3; ++c) {
            const float own = start.value[start.index(i, kTInd + c)];
            const float was = start.value[start.index(i, kTInd + 12 + c)], is = one[start.index(i, kTInd + 12 + c)]; // degree 2
            if (own <= 0) CHECK(is == was);
            else if (own < 1e10f && is != was) CHECK(std::abs(is) <= std::sqrt(5.0f) * own + 1e-5f);
        }
}
