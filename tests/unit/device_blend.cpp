// Blending on the device, emulated: against the scalar reference in float64 and the rasteriser of the CPU, in every order of threads.
#include "device/activity.h"
#include "device/blend.h"
#include "device_frame.h"
#include "reference_splats.h"
#include "render/raster.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>
#include <random>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 3}};

std::vector<GaussianGeometry<float>> randomCloud(size_t count, float size, float opacity, uint64_t seed)
{
    std::mt19937_64 rng(seed);
    std::uniform_real_distribution<float> u(-1, 1);
    std::vector<GaussianGeometry<float>> cloud(count);
    for (auto& g : cloud) {
        for (float& p : g.position) p = 0.8f * u(rng);
        for (float& s : g.scale) s = size * std::exp(u(rng));
        for (float& q : g.rotation) q = u(rng);
        g.opacity = opacity + 0.49f * u(rng);
    }
    return cloud;
}

struct Blended {
    std::vector<float> planes, dColors;
    std::vector<ScreenGradient<float>> dSplats;
};

struct Scene {
    TileBuilder builder;
    int width, height, channels;
    std::vector<float> colors, dPlanes;

    Scene(int width, int height, int channels, const std::vector<GaussianGeometry<float>>& cloud) : width(width), height(height), channels(channels)
    {
        Camera c;
        c.width = width, c.height = height;
        c.fx = c.fy = 1.3 * width, c.cx = 0.5 * width, c.cy = 0.5 * height;
        c.worldFromCamera[3] = glm::dvec4(0, 0, 3, 1);
        builder.build(makeView<float>(c, 0.1), cloud);
        std::mt19937_64 rng(5);
        std::uniform_real_distribution<float> u(0, 1);
        colors.resize(count() * stride());
        for (float& x : colors) x = u(rng);
        dPlanes.resize(size_t(width) * size_t(height) * size_t(channels + 1));
        for (float& x : dPlanes) x = 2 * u(rng) - 1;
    }
    size_t count() const { return builder.visible.count(); }
    size_t stride() const { return size_t(channelStride(channels)); }

    Blended cpu() const
    {
        Blended b{std::vector<float>(dPlanes.size()), std::vector<float>(colors.size()), std::vector<ScreenGradient<float>>(count())};
        RasterScratch scratch;
        rasterForward(builder.visible, builder.tiles, colors.data(), channels, b.planes.data());
        rasterBackward(builder.visible, builder.tiles, colors.data(), channels, b.planes.data(), dPlanes.data(), scratch, b.dColors.data(), b.dSplats.data());
        return b;
    }
    Blended device(const Emulation& emulation) const
    {
        Device device(emulation);
        DeviceFrame frame(device, builder);
        Buffer<float> deviceColors, planes, gradient, dColors;
        Buffer<ScreenGradient<float>> dSplats;
        deviceColors.upload(device, colors), gradient.upload(device, dPlanes);
        planes.reserve(device, dPlanes.size()), dColors.reserve(device, colors.size()), dSplats.reserve(device, count());
        blendForward(device, frame.view, deviceColors.data(), channels, planes.data());
        BlendBackward backward;
        backward.run(device, frame.view, deviceColors.data(), channels, planes.data(), gradient.data(), dColors.data(), dSplats.data());
        Blended b{std::vector<float>(dPlanes.size()), std::vector<float>(colors.size()), std::vector<ScreenGradient<float>>(count())};
        planes.download(device, b.planes), dColors.download(device, b.dColors), dSplats.download(device, b.dSplats);
        return b;
    }
};

template <class T>
bool sameBytes(const std::vector<T>& a, const std::vector<T>& b)
{
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

/// The largest difference, and the largest value, of the numbers that `value` takes from each of two rows.
struct Difference {
    double worst = 0, scale = 0;
    void add(double a, double b) { worst = std::max(worst, a == b ? 0.0 : std::isfinite(a) ? std::abs(a - b) : 1e30), scale = std::max(scale, std::abs(b)); }
    bool within(double bound) const { return worst <= bound * scale; }
};

template <class T>
std::vector<Difference> compareSplats(const std::vector<ScreenGradient<float>>& a, const std::vector<ScreenGradient<T>>& b)
{
    std::vector<Difference> out(4); // mean, conic, opacity, weight
    for (size_t i = 0; i < a.size(); ++i) {
        for (int k = 0; k < 2; ++k) out[0].add(a[i].mean[k], double(b[i].mean[k]));
        for (int k = 0; k < 3; ++k) out[1].add(a[i].conic[k], double(b[i].conic[k]));
        out[2].add(a[i].opacity, double(b[i].opacity)), out[3].add(a[i].weight, double(b[i].weight));
    }
    return out;
}

} // namespace

TEST_CASE("device blending: every count of channels equals the CPU's rasteriser, with the same bytes in every order of threads")
{
    for (int channels : {3, 6, 9, 12, 14, 18, 22, 26}) {
        CAPTURE(channels);
        const Scene scene(37, 29, channels, randomCloud(250, 0.06f, 0.5f, uint64_t(channels)));
        REQUIRE(scene.count() > 100);
        const Blended cpu = scene.cpu(), device = scene.device(kOrders[0]);
        for (const Emulation& order : {kOrders[1], kOrders[2]}) {
            const Blended other = scene.device(order);
            CHECK(sameBytes(other.planes, device.planes));
            CHECK(sameBytes(other.dColors, device.dColors));
            CHECK(sameBytes(other.dSplats, device.dSplats));
        }
        // A splat at the kMinAlpha rim may fall on either side of the step in float32: up to 1/255 of one colour, at almost no pixel.
        Difference planes, dColors;
        double sum = 0;
        for (size_t i = 0; i < cpu.planes.size(); ++i) planes.add(device.planes[i], cpu.planes[i]), sum += std::abs(double(device.planes[i]) - double(cpu.planes[i]));
        CHECK(planes.worst < 1.1 * kMinAlpha);
        CHECK(sum / double(cpu.planes.size()) < 1e-5);
        for (size_t i = 0; i < cpu.dColors.size(); ++i) {
            if (i % scene.stride() < size_t(channels)) dColors.add(device.dColors[i], cpu.dColors[i]);
            else CHECK(device.dColors[i] == 0);
        }
        CHECK(dColors.within(2e-3)); // float32 sums of terms of either sign, and the rim
        for (const Difference& d : compareSplats(device.dSplats, cpu.dSplats)) CHECK(d.within(2e-3));
    }
}

TEST_CASE("device blending: forward and backward equal the scalar reference in float64")
{
    constexpr int kChannels = 12;
    // 2: opaque layers that end pixels and whole tiles early; 3: fewer splats than a chunk; sizes that do not fill a tile
    for (auto [w, h, count, size, opacity] : {std::tuple{40, 30, 300, 0.06f, 0.5f}, {33, 18, 400, 0.3f, 0.8f}, {16, 16, 7, 0.1f, 0.5f}, {5, 3, 40, 0.1f, 0.5f}}) {
        CAPTURE(w);
        const Scene scene(w, h, kChannels, randomCloud(size_t(count), size, opacity, 9));
        const Blended device = scene.device(kOrders[2]);
        const size_t n = scene.count(), pixels = size_t(w) * size_t(h);
        const ReferenceSplats reference(scene.builder.visible, scene.colors.data(), scene.stride(), kChannels);
        const auto& [splats, colors, order] = reference;
        std::vector<double> dColors(n * kChannels);
        std::vector<ScreenGradient<double>> dSplats(n);
        double sum = 0;
        Difference planes;
        for (size_t p = 0; p < pixels; ++p) {
            const double x = double(p % size_t(w)) + 0.5, y = double(p / size_t(w)) + 0.5;
            double color[kChannels], d[kChannels + 1];
            const double a = blendPixel<double>(order, splats.data(), colors.data(), kChannels, x, y, color);
            for (size_t c = 0; c <= kChannels; ++c) {
                const double expected = c < kChannels ? color[c] : a;
                d[c] = scene.dPlanes[c * pixels + p];
                planes.add(device.planes[c * pixels + p], expected), sum += std::abs(device.planes[c * pixels + p] - expected);
            }
            blendPixelBackward<double>(order, splats.data(), colors.data(), kChannels, x, y, color, a, d, d[kChannels], dSplats.data(), dColors.data());
        }
        CHECK(planes.worst < 1.1 * kMinAlpha); // as above
        CHECK(sum / double(pixels * (kChannels + 1)) < 1e-5);
        Difference colorDifference;
        for (size_t i = 0; i < n * kChannels; ++i) colorDifference.add(device.dColors[i / kChannels * scene.stride() + i % kChannels], dColors[i]);
        CHECK(colorDifference.within(2e-3));
        const std::vector<Difference> differences = compareSplats(device.dSplats, dSplats);
        for (size_t k = 0; k < 4; ++k) {
            CAPTURE(k);
            CHECK(differences[k].within(k == 2 ? 5e-3 : 2e-3)); // as the test of the CPU's rasteriser has them
        }
    }
}

TEST_CASE("device blending: no splats, an image without any, and one splat across many tiles")
{
    for (int count : {0, 1}) {
        std::vector<GaussianGeometry<float>> cloud(size_t(count), {{0, 0, 0}, {0.3f, 0.3f, 0.1f}, {1, 0, 0, 0}, 0.9f});
        const Scene scene(70, 50, 3, cloud);
        const Blended device = scene.device(kOrders[2]), cpu = scene.cpu();
        Difference planes, dColors;
        for (size_t i = 0; i < cpu.planes.size(); ++i) planes.add(device.planes[i], cpu.planes[i]);
        for (size_t i = 0; i < cpu.dColors.size(); ++i) dColors.add(device.dColors[i], cpu.dColors[i]);
        CHECK(planes.worst < 1.1 * kMinAlpha);
        CHECK(planes.scale == doctest::Approx(count ? 0.9 : 0.0).epsilon(0.02));
        CHECK(dColors.within(2e-3));
    }
}

TEST_CASE("device blending: which splats are active, and the statistics of density control, equal the CPU's")
{
    const Scene scene(40, 30, 3, randomCloud(300, 0.06f, 0.5f, 4));
    Device device(kOrders[2]);
    const DeviceFrame frame(device, scene.builder);
    std::vector<ScreenGradient<float>> dSplats = scene.cpu().dSplats;
    for (size_t v = 0; v < dSplats.size(); v += 3) dSplats[v].weight = 1e-4f;
    std::vector<float> sums(300, 1.5f), expectedSums = sums;
    std::vector<uint32_t> seen(300, 7), expectedSeen = seen;
    for (size_t v = 0; v < dSplats.size(); ++v) {
        const uint32_t i = scene.builder.visible.splatFromVisible[v];
        addActivity(dSplats[v], 1200.0f, expectedSums[i], expectedSeen[i]);
        CHECK((expectedSeen[i] == 8) == (dSplats[v].weight > kActiveWeight));
        CHECK((expectedSums[i] > 1.5f) == (dSplats[v].weight > kActiveWeight));
    }
    Buffer<ScreenGradient<float>> gradients;
    Buffer<float> gradientSum;
    Buffer<uint32_t> deviceSeen;
    Buffer<uint8_t> active;
    gradients.upload(device, dSplats), gradientSum.upload(device, sums), deviceSeen.upload(device, seen);
    active.reserve(device, dSplats.size());
    findActive(device, frame.view, gradients.data(), 1200.0f, active.data(), gradientSum.data(), deviceSeen.data());
    std::vector<uint8_t> flags(dSplats.size());
    gradientSum.download(device, sums), deviceSeen.download(device, seen), active.download(device, flags);
    CHECK(sums == expectedSums);
    CHECK(seen == expectedSeen);
    for (size_t v = 0; v < flags.size(); ++v) CHECK(flags[v] == (dSplats[v].weight > kActiveWeight));
}
