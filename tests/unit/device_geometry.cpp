// The geometry and the light of the surroundings on a device: the numbers of the CPU's step.
#include "base/random.h"
#include "device/geometry.h"
#include "splat/geometry.h"

#include <doctest/doctest.h>

#include <glm/gtc/matrix_transform.hpp>

#include <cmath>
#include <cstring>
#include <numeric>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr size_t kSplats = 500, kVisible = 333;
constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 5}};

View<float> someView()
{
    Camera c;
    c.width = 40, c.height = 30, c.fx = c.fy = 45, c.cx = 20, c.cy = 15;
    c.worldFromCamera = glm::inverse(glm::lookAt(glm::dvec3(1, -2.5, 0.7), glm::dvec3(0), glm::dvec3(0, 0, 1)));
    return makeView<float>(c, 0.1);
}

/// Some behind the camera, some without a rotation, some out of bounds.
SplatGeometry someGeometry(Random& random)
{
    SplatGeometry g;
    g.resize(kSplats);
    const auto u = [&] { return 2 * random.uniform() - 1; };
    for (size_t i = 0; i < kSplats; ++i) {
        GeometryRow& r = g.raw[i];
        for (int k = 0; k < 3; ++k) r[k] = (i % 5 == 0 ? 8.0f : 0.8f) * u(), r[3 + k] = -3 + 2 * u();
        if (i % 7 == 0) r[5] = -12, r[3] = 4;
        for (int k = 6; k < 10; ++k) r[k] = (i % 13 == 0 ? 1e-11f : 1.0f) * u();
        r[10] = 5 * u();
        for (int k = 0; k < kGeometryParameters; ++k) g.momentum[i][k] = 0.1f * u(), g.second[i][k] = 0.1f * random.uniform();
        g.activate(i);
    }
    return g;
}

template <class T>
bool sameBytes(const std::vector<T>& a, const std::vector<T>& b) { return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0; }

} // namespace

TEST_CASE("a step of the geometry on a device is that of the CPU: to the bit but for the exponentials of the activation")
{
    constexpr GeometryRates kRates{0.01f, 0.02f, 0.03f, 0.04f};
    constexpr int kStride = 16, kDistance = 9, kStep = 3;
    Random random(3);
    const SplatGeometry before = someGeometry(random);
    std::vector<uint32_t> splats(kVisible);
    for (size_t v = 0; v < kVisible; ++v) splats[v] = uint32_t(v * 7 % kSplats);
    std::vector<uint8_t> active(kVisible);
    std::vector<ScreenGradient<float>> dSplats(kVisible);
    std::vector<float> dColors(kVisible * kStride), distance(kVisible);
    for (size_t v = 0; v < kVisible; ++v) {
        active[v] = v % 3 != 0;
        for (float* x : {&dSplats[v].mean[0], &dSplats[v].mean[1], &dSplats[v].conic[0], &dSplats[v].conic[1], &dSplats[v].conic[2], &dSplats[v].opacity})
            *x = v % 23 == 1 ? NAN : 2 * random.uniform() - 1;
        dColors[v * kStride + kDistance] = distance[v] = random.uniform();
    }
    for (const bool distant : {false, true}) {
        SplatGeometry cpu = before;
        stepGeometry(cpu, someView(), splats, dSplats.data(), distant ? distance.data() : nullptr, active.data(), kRates, kStep, 1e-3f);
        for (const Emulation& order : kOrders) {
            Device device(order);
            Buffer<GeometryRow> raw, momentum, second;
            Buffer<GaussianGeometry<float>> activated;
            Buffer<uint32_t> list;
            Buffer<uint8_t> on;
            Buffer<float> colors;
            Buffer<ScreenGradient<float>> gradients;
            raw.upload(device, before.raw), momentum.upload(device, before.momentum), second.upload(device, before.second), activated.upload(device, before.activated);
            list.upload(device, splats), on.upload(device, active), colors.upload(device, dColors), gradients.upload(device, dSplats);
            TileView tiles{};
            tiles.splatFromVisible = list.data(), tiles.visibleCount = kVisible;
            stepGeometry(device, {raw.data(), momentum.data(), second.data(), activated.data()}, someView(), tiles, gradients.data(),
                         {distant ? colors.data() + kDistance : nullptr, kStride}, on.data(), GeometryAdam(kRates, kStep), 1e-3f);
            SplatGeometry after = before;
            raw.download(device, after.raw), momentum.download(device, after.momentum), second.download(device, after.second), activated.download(device, after.activated);
            CHECK(sameBytes(after.raw, cpu.raw));
            CHECK(sameBytes(after.momentum, cpu.momentum));
            CHECK(sameBytes(after.second, cpu.second));
            for (size_t i = 0; i < kSplats; ++i) { // the SIMD exponential: half an ulp of an exponent of up to 12, and 2e-7 of its own
                for (int k = 0; k < 3; ++k) CHECK(after.activated[i].scale[k] == doctest::Approx(cpu.activated[i].scale[k]).epsilon(1.5e-6));
                CHECK(after.activated[i].opacity == doctest::Approx(cpu.activated[i].opacity).epsilon(1.5e-6));
            }
        }
    }
}

TEST_CASE("light of the surroundings on a device: the same for all lights, stepped by the sum of their gradients")
{
    constexpr int kLights = 2;
    const size_t stride = size_t(channelStride(3 * kLights));
    Random random(4);
    std::vector<AmbientRow> rows(kSplats);
    for (AmbientRow& row : rows)
        for (size_t c = 0; c < 3; ++c) row.value[c] = -3 * random.uniform(), row.momentum[c] = 0.1f * random.uniform(), row.second[c] = 0.1f * random.uniform();
    std::vector<uint32_t> splats(kVisible);
    for (size_t v = 0; v < kVisible; ++v) splats[v] = uint32_t(v * 7 % kSplats);
    std::vector<uint8_t> active(kVisible);
    std::vector<float> colors(kVisible * stride), dColors(kVisible * stride);
    for (size_t v = 0; v < kVisible; ++v) active[v] = v % 4 != 1;
    for (float& x : colors) x = random.uniform();
    for (float& x : dColors) x = 2 * random.uniform() - 1;
    std::vector<float> wantedColors = colors;
    std::vector<AmbientRow> wanted = rows;
    for (size_t v = 0; v < kVisible; ++v)
        for (size_t c = 0; c < 3; ++c) {
            for (size_t l = 0; l < kLights; ++l) wantedColors[v * stride + 3 * l + c] += std::exp(rows[splats[v]].value[c]);
            if (active[v]) stepAmbientChannel(wanted[splats[v]], c, dColors[v * stride + c] + dColors[v * stride + 3 + c], 0.02f);
        }
    for (const Emulation& order : kOrders) {
        Device device(order);
        Buffer<AmbientRow> on;
        Buffer<uint32_t> list;
        Buffer<uint8_t> learns;
        Buffer<float> shown, gradients;
        on.upload(device, rows), list.upload(device, splats), learns.upload(device, active), shown.upload(device, colors), gradients.upload(device, dColors);
        TileView tiles{};
        tiles.splatFromVisible = list.data(), tiles.visibleCount = kVisible;
        addAmbient(device, tiles, on.data(), kLights, shown.data());
        stepAmbient(device, tiles, gradients.data(), kLights, learns.data(), 0.02f, on.data());
        std::vector<AmbientRow> after(kSplats);
        std::vector<float> lit(colors.size());
        on.download(device, after), shown.download(device, lit);
        CHECK(sameBytes(after, wanted));
        CHECK(sameBytes(lit, wantedColors));
    }
}
