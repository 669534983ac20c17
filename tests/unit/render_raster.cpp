// The SIMD rasteriser against the scalar reference, and the cases that bite.
#include "reference_splats.h"
#include "render/raster.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <random>

using namespace nacre;

namespace {

Camera testCamera(int width, int height)
{
    Camera c;
    c.width = width, c.height = height;
    c.fx = c.fy = 1.3 * width;
    c.cx = 0.5 * width, c.cy = 0.5 * height;
    c.worldFromCamera[3] = glm::dvec4(0, 0, 3, 1);
    return c;
}

std::vector<GaussianGeometry<float>> randomCloud(size_t count, float size, uint64_t seed)
{
    std::mt19937_64 rng(seed);
    std::uniform_real_distribution<float> u(-1, 1);
    std::vector<GaussianGeometry<float>> cloud(count);
    for (auto& g : cloud) {
        for (float& p : g.position) p = 0.8f * u(rng);
        for (float& s : g.scale) s = size * std::exp(u(rng));
        for (float& q : g.rotation) q = u(rng);
        g.opacity = 0.5f + 0.49f * u(rng);
    }
    return cloud;
}

struct Frame {
    TileBuilder builder;
    std::vector<float> colors, planes;
    int channels;
    Frame(const Camera& camera, const std::vector<GaussianGeometry<float>>& cloud, int channels, uint64_t seed) : channels(channels)
    {
        builder.build(makeView<float>(camera, 0.1), cloud);
        std::mt19937_64 rng(seed);
        std::uniform_real_distribution<float> u(0, 1);
        colors.resize(builder.visible.count() * channelStride(12));
        for (float& c : colors) c = u(rng);
        planes.resize(size_t(camera.width) * camera.height * (channels + 1));
        rasterForward(builder.visible, builder.tiles, colors.data(), channels, planes.data());
    }
};

// All visible splats in order, float64, no tiles.
std::vector<double> reference(const Frame& f, int width, int height)
{
    const ReferenceSplats reference(f.builder.visible, f.colors.data(), channelStride(12), size_t(f.channels));
    const auto& [splats, colors, order] = reference;
    std::vector<double> planes(f.planes.size());
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            double color[kMaxChannels];
            const double a = blendPixel<double>(order, splats.data(), colors.data(), f.channels, x + 0.5, y + 0.5, color);
            for (int c = 0; c <= f.channels; ++c) planes[(size_t(c) * height + y) * width + x] = c < f.channels ? color[c] : a;
        }
    return planes;
}

double maxDifference(const std::vector<float>& a, const std::vector<double>& b)
{
    double worst = 0;
    for (size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::abs(double(a[i]) - b[i]));
    return worst;
}

} // namespace

TEST_CASE("SIMD forward equals the scalar reference for every channel count and odd image sizes")
{
    for (int channels : {3, 6, 9, 12})
        for (auto [w, h] : {std::pair{64, 48}, {37, 53}, {5, 3}}) {
            CAPTURE(channels);
            CAPTURE(w);
            const Frame f(testCamera(w, h), randomCloud(600, 0.05f, 3), channels, 5);
            REQUIRE(f.builder.visible.count() > 100);
            // A splat at the kMinAlpha rim may fall on either side of the step in float32: up to 1/255 of one colour.
            const auto ref = reference(f, w, h);
            CHECK(maxDifference(f.planes, ref) < 1.1 * kMinAlpha);
            double sum = 0;
            for (size_t i = 0; i < ref.size(); ++i) sum += std::abs(f.planes[i] - ref[i]);
            CHECK(sum / double(ref.size()) < 1e-5); // almost no pixel is at that step; f32 elsewhere
        }
}

TEST_CASE("SIMD backward equals the scalar reference")
{
    const int w = 45, h = 38;
    for (int channels : {3, 9, 12}) {
        const Frame f(testCamera(w, h), randomCloud(300, 0.06f, 9), channels, 6);
        std::mt19937_64 rng(4);
        std::uniform_real_distribution<float> u(-1, 1);
        std::vector<float> dPlanes(f.planes.size());
        for (float& d : dPlanes) d = u(rng);
        const size_t n = f.builder.visible.count();
        std::vector<float> dColors(n * channelStride(12));
        std::vector<ScreenGradient<float>> dSplats(n);
        RasterScratch scratch;
        rasterBackward(f.builder.visible, f.builder.tiles, f.colors.data(), channels, f.planes.data(), dPlanes.data(), scratch,
                       dColors.data(), dSplats.data());

        const ReferenceSplats reference(f.builder.visible, f.colors.data(), channelStride(12), size_t(channels));
        const auto& [splats, colors, order] = reference;
        std::vector<double> refColors(n * channels);
        std::vector<ScreenGradient<double>> refSplats(n);
        for (int y = 0; y < h; ++y)
            for (int x = 0; x < w; ++x) {
                double color[kMaxChannels], d[kMaxChannels + 1] = {};
                const double a = blendPixel<double>(order, splats.data(), colors.data(), channels, x + 0.5, y + 0.5, color);
                for (int c = 0; c <= channels; ++c) d[c] = dPlanes[(size_t(c) * h + y) * w + x];
                blendPixelBackward<double>(order, splats.data(), colors.data(), channels, x + 0.5, y + 0.5, color, a, d, d[channels],
                                           refSplats.data(), refColors.data());
            }
        // Sums over up to a few hundred pixels of terms of either sign; float32 and the kMinAlpha step, relative to the largest.
        double scaleColor = 0, scaleMean = 0, scaleConic = 0, scaleOpacity = 0;
        for (size_t i = 0; i < n; ++i) {
            scaleMean = std::max({scaleMean, std::abs(refSplats[i].mean[0]), std::abs(refSplats[i].mean[1])});
            scaleOpacity = std::max(scaleOpacity, std::abs(refSplats[i].opacity));
            for (double c : refSplats[i].conic) scaleConic = std::max(scaleConic, std::abs(c));
        }
        for (double c : refColors) scaleColor = std::max(scaleColor, std::abs(c));
        for (size_t i = 0; i < n; ++i) {
            CAPTURE(i);
            for (int c = 0; c < channels; ++c) CHECK(std::abs(dColors[i * channelStride(12) + c] - refColors[i * channels + c]) < 2e-3 * scaleColor);
            for (int k = 0; k < 2; ++k) CHECK(std::abs(dSplats[i].mean[k] - refSplats[i].mean[k]) < 2e-3 * scaleMean);
            for (int k = 0; k < 3; ++k) CHECK(std::abs(dSplats[i].conic[k] - refSplats[i].conic[k]) < 2e-3 * scaleConic);
            CHECK(std::abs(dSplats[i].opacity - refSplats[i].opacity) < 5e-3 * scaleOpacity);
            CHECK(std::abs(dSplats[i].weight - refSplats[i].weight) < 0.02 + 1e-3 * refSplats[i].weight);
        }
    }
}

TEST_CASE("one and four threads give identical bytes, forward and backward")
{
    const auto cloud = randomCloud(3000, 0.04f, 21);
    std::vector<float> planes[2], dColors[2], geometry[2];
    for (int run = 0; run < 2; ++run) {
        tbb::global_control threads(tbb::global_control::max_allowed_parallelism, run ? 4 : 1);
        const Frame f(testCamera(96, 80), cloud, 12, 8);
        planes[run] = f.planes;
        std::vector<float> dPlanes(f.planes.size());
        for (size_t i = 0; i < dPlanes.size(); ++i) dPlanes[i] = std::sin(float(i));
        dColors[run].resize(f.colors.size());
        std::vector<ScreenGradient<float>> d(f.builder.visible.count());
        RasterScratch scratch;
        rasterBackward(f.builder.visible, f.builder.tiles, f.colors.data(), 12, f.planes.data(), dPlanes.data(), scratch,
                       dColors[run].data(), d.data());
        for (const auto& g : d) geometry[run].insert(geometry[run].end(), {g.mean[0], g.mean[1], g.conic[0], g.conic[1], g.conic[2], g.opacity});
    }
    CHECK(planes[0] == planes[1]);
    CHECK(dColors[0] == dColors[1]);
    CHECK(geometry[0] == geometry[1]);
}

TEST_CASE("numerics that bite: projection and blending stay finite and bounded")
{
    const Camera camera = testCamera(40, 40);
    GaussianGeometry<float> g{{0, 0, 0}, {0.1f, 0.1f, 0.1f}, {1, 0, 0, 0}, 0.9f};
    const auto render = [&](std::vector<GaussianGeometry<float>> cloud) {
        Frame f(camera, cloud, 3, 1);
        std::fill(f.colors.begin(), f.colors.end(), 1.0f);
        rasterForward(f.builder.visible, f.builder.tiles, f.colors.data(), 3, f.planes.data());
        for (float p : f.planes) {
            REQUIRE(std::isfinite(p));
            REQUIRE(p >= 0.0f);
            REQUIRE(p <= 1.0f);
        }
        return f;
    };
    SUBCASE("condition number of Sigma up to 1e8")
    {
        g.scale[0] = 1.0f, g.scale[1] = 1e-4f, g.scale[2] = 1e-4f;
        render({g});
    }
    SUBCASE("scales below a pixel fade out by their area instead of growing to a pixel")
    {
        double last = 1e9;
        for (float s : {0.05f, 0.01f, 0.003f}) {
            g.scale[0] = g.scale[1] = g.scale[2] = s;
            const Frame f = render({g});
            double sum = 0;
            for (size_t i = 3 * 1600; i < 4 * 1600; ++i) sum += f.planes[i];
            CHECK(sum < last);
            last = sum;
        }
        g.scale[0] = g.scale[1] = g.scale[2] = 1e-7f;
        CHECK(render({g}).builder.visible.count() == 0);
    }
    SUBCASE("quaternion of length zero counts as no rotation")
    {
        const Frame upright = render({g});
        g.rotation[0] = 0;
        CHECK(render({g}).planes == upright.planes);
    }
    SUBCASE("at and behind the near plane, and NaN, is culled")
    {
        for (float z : {3.0f, 3.0f - kNearPlane, 4.0f, NAN, INFINITY}) {
            g.position[2] = z;
            CHECK(render({g}).builder.visible.count() == 0);
        }
        g.position[2] = 3.0f - 2 * kNearPlane;
        CHECK(render({g}).builder.visible.count() == 1);
    }
    SUBCASE("camera inside the cloud")
    {
        auto cloud = randomCloud(2000, 0.1f, 2);
        for (auto& x : cloud) x.position[2] += 3.0f;
        render(cloud);
    }
    SUBCASE("opacity 0 draws nothing, opacity 1 stays below kMaxAlpha")
    {
        g.opacity = 0;
        CHECK(render({g}).builder.visible.count() == 0);
        g.opacity = 1, g.scale[0] = g.scale[1] = 10.0f;
        const Frame f = render({g});
        CHECK(f.planes[3 * 1600 + 820] == doctest::Approx(kMaxAlpha).epsilon(1e-4)); // f32 exponent at the centre of a wide splat
    }
    SUBCASE("thousands of layers on one pixel")
    {
        std::vector<GaussianGeometry<float>> layers(5000, g);
        for (size_t i = 0; i < layers.size(); ++i) layers[i].position[2] = 1e-4f * float(i), layers[i].opacity = 0.01f;
        const Frame f = render(layers);
        const auto ref = reference(f, 40, 40);
        CHECK(maxDifference(f.planes, ref) < 0.02); // float32 product of 5000 factors near 1, and steps at kMinAlpha
    }
    SUBCASE("equal distances keep the splat order")
    {
        const Frame f = render(std::vector<GaussianGeometry<float>>(100, g));
        CHECK(std::is_sorted(f.builder.visible.splatFromVisible.begin(), f.builder.visible.splatFromVisible.end()));
    }
}
