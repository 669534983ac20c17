// The scalar reference in float64 against central finite differences: projection, blending, and the two chained.
#include "render/reference_raster.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <random>
#include <vector>

using namespace nacre;

namespace {

Camera testCamera(int width, int height, double cxOffset = 0)
{
    Camera c;
    c.width = width, c.height = height;
    c.fx = 1.3 * width, c.fy = 1.25 * width;
    c.cx = 0.5 * width + cxOffset, c.cy = 0.5 * height;
    c.worldFromCamera[3] = glm::dvec4(0.1, -0.2, 3.0, 1.0); // looks down -Z at the origin
    return c;
}

GaussianGeometry<double> randomGaussian(std::mt19937_64& rng, double size)
{
    std::uniform_real_distribution<double> u(-1, 1);
    GaussianGeometry<double> g;
    for (double& p : g.position) p = 0.4 * u(rng);
    for (double& s : g.scale) s = size * std::exp(u(rng));
    for (double& q : g.rotation) q = u(rng);
    g.opacity = 0.5 + 0.4 * u(rng);
    return g;
}

double* parameter(GaussianGeometry<double>& g, int i)
{
    return i < 3 ? &g.position[i] : i < 6 ? &g.scale[i - 3] : i < 10 ? &g.rotation[i - 6] : &g.opacity;
}

void checkClose(double analytic, double numeric, double scale)
{
    CHECK(std::abs(analytic - numeric) <= 2e-6 * (std::abs(numeric) + scale)); // central differences with h = 1e-6 in float64
}

} // namespace

TEST_CASE("projection gradient matches finite differences for every parameter")
{
    std::mt19937_64 rng(7);
    std::uniform_real_distribution<double> u(-1, 1);
    for (int trial = 0; trial < 40; ++trial) {
        const View<double> view = makeView<double>(testCamera(64, 48, 5), 0.1);
        GaussianGeometry<double> g = randomGaussian(rng, trial % 2 ? 0.1 : 0.01);
        if (trial % 5 == 4) g.position[0] += 1.6; // far outside the frame: the clamped branch of the Jacobian
        double weights[7]; // of mean, conic, opacity, distance from the eye
        for (double& w : weights) w = u(rng);
        const auto loss = [&](const GaussianGeometry<double>& x) {
            detail::ProjectionSteps<double> s;
            REQUIRE(detail::projectionSteps(view, x, s));
            const double mean[2] = {view.fx * s.t[0] / s.t[2], view.fy * s.t[1] / s.t[2]};
            return weights[0] * mean[0] + weights[1] * mean[1] + weights[2] * s.cyy / s.det - weights[3] * s.cxy / s.det +
                   weights[4] * s.cxx / s.det + weights[5] * x.opacity * s.compensation + weights[6] * std::sqrt(detail::dot3(s.t, s.t));
        };
        GaussianGeometry<double> d{};
        projectGaussianBackward(view, g, weights, weights + 2, weights[5], weights[6], d);
        double scale = 0;
        for (int i = 0; i < 11; ++i) scale = std::max(scale, std::abs(*parameter(d, i)));
        for (int i = 0; i < 11; ++i) {
            CAPTURE(trial);
            CAPTURE(i);
            GaussianGeometry<double> lo = g, hi = g;
            const double h = 1e-6 * (i >= 3 && i < 6 ? *parameter(g, i) : 1.0);
            *parameter(lo, i) -= h, *parameter(hi, i) += h;
            checkClose(*parameter(d, i), (loss(hi) - loss(lo)) / (2 * h), 1e-2 * scale);
        }
    }
}

TEST_CASE("blending gradient through projection matches finite differences for geometry and colour")
{
    std::mt19937_64 rng(11);
    std::uniform_real_distribution<double> u(-1, 1);
    const View<double> view = makeView<double>(testCamera(24, 20), 0.1);
    constexpr int kSplats = 12, kChannels = 5;
    std::vector<GaussianGeometry<double>> g(kSplats);
    for (auto& x : g) x = randomGaussian(rng, 0.12);
    std::vector<double> colors(kSplats * kChannels);
    for (double& c : colors) c = u(rng);
    std::vector<double> weights(24 * 20 * (kChannels + 1));
    for (double& w : weights) w = u(rng);

    const auto project = [&](const std::vector<GaussianGeometry<double>>& x) {
        std::vector<ProjectedGaussian<double>> p(kSplats);
        for (int i = 0; i < kSplats; ++i) REQUIRE(projectGaussian(view, x[i], p[i]));
        return p;
    };
    const std::vector<ProjectedGaussian<double>> base = project(g);
    std::vector<uint32_t> order(kSplats);
    for (int i = 0; i < kSplats; ++i) order[i] = uint32_t(i);
    std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return base[a].distance < base[b].distance; });

    // kMinAlpha is a step: pixels where any splat is near it would see it in a difference, so they are left out of the loss.
    const auto nearStep = [&](double px, double py) {
        for (const auto& s : base) {
            double dx, dy;
            const double a = splatAlpha(s, px, py, &dx, &dy);
            if (std::abs(a - kMinAlpha) < 1e-4 || std::abs(a - kMaxAlpha) < 1e-4) return true;
        }
        return false;
    };
    int used = 0;
    const auto loss = [&](const std::vector<GaussianGeometry<double>>& x, const std::vector<double>& c) {
        const auto p = project(x);
        double sum = 0;
        used = 0;
        for (int y = 0; y < 20; ++y)
            for (int px = 0; px < 24; ++px) {
                if (nearStep(px + 0.5, y + 0.5)) continue;
                ++used;
                double color[kChannels];
                const double alpha = blendPixel<double>(order, p.data(), c.data(), kChannels, px + 0.5, y + 0.5, color);
                const double* w = &weights[(y * 24 + px) * (kChannels + 1)];
                for (int k = 0; k < kChannels; ++k) sum += w[k] * color[k];
                sum += w[kChannels] * alpha;
            }
        return sum;
    };
    loss(g, colors);
    REQUIRE(used > 300);

    std::vector<ScreenGradient<double>> dScreen(kSplats);
    std::vector<double> dColors(colors.size());
    for (int y = 0; y < 20; ++y)
        for (int px = 0; px < 24; ++px) {
            if (nearStep(px + 0.5, y + 0.5)) continue;
            double color[kChannels];
            const double alpha = blendPixel<double>(order, base.data(), colors.data(), kChannels, px + 0.5, y + 0.5, color);
            const double* w = &weights[(y * 24 + px) * (kChannels + 1)];
            blendPixelBackward<double>(order, base.data(), colors.data(), kChannels, px + 0.5, y + 0.5, color, alpha, w, w[kChannels],
                                       dScreen.data(), dColors.data());
        }
    for (int i = 0; i < kSplats; ++i) {
        GaussianGeometry<double> d{};
        projectGaussianBackward(view, g[i], dScreen[i].mean, dScreen[i].conic, dScreen[i].opacity, 0.0, d);
        for (int k = 0; k < 11; ++k) {
            CAPTURE(i);
            CAPTURE(k);
            auto lo = g, hi = g;
            const double h = 1e-6 * (k >= 3 && k < 6 ? *parameter(g[i], k) : 1.0);
            *parameter(lo[i], k) -= h, *parameter(hi[i], k) += h;
            checkClose(*parameter(d, k), (loss(hi, colors) - loss(lo, colors)) / (2 * h), 1.0);
        }
    }
    for (size_t k = 0; k < colors.size(); ++k) {
        auto lo = colors, hi = colors;
        lo[k] -= 1e-6, hi[k] += 1e-6;
        checkClose(dColors[k], (loss(g, hi) - loss(g, lo)) / 2e-6, 1.0);
    }
}

TEST_CASE("float32 projection and its gradient agree with float64, thin and tiny Gaussians included")
{
    std::mt19937_64 rng(17);
    std::uniform_real_distribution<double> u(-1, 1);
    const Camera camera = testCamera(256, 256);
    const View<double> view64 = makeView<double>(camera, 0.1);
    const View<float> view32 = makeView<float>(camera, 0.1);
    int seen = 0;
    for (int trial = 0; trial < 400; ++trial) {
        GaussianGeometry<double> g = randomGaussian(rng, 0.03);
        if (trial % 4 == 1) g.scale[0] = 1.0, g.scale[1] = g.scale[2] = 1e-4; // condition 1e8
        if (trial % 4 == 2) g.scale[2] = 1e-6;
        GaussianGeometry<float> f;
        for (int i = 0; i < 3; ++i) f.position[i] = float(g.position[i]), f.scale[i] = float(g.scale[i]);
        for (int i = 0; i < 4; ++i) f.rotation[i] = float(g.rotation[i]);
        f.opacity = float(g.opacity);
        ProjectedGaussian<double> p{};
        ProjectedGaussian<float> q{};
        const bool visible = projectGaussian(view64, g, p);
        if (std::abs(p.opacity - kMinAlpha) < 1e-5) continue; // may fall on either side of the cull
        REQUIRE(projectGaussian(view32, f, q) == visible);
        if (!visible) continue;
        ++seen;
        CHECK(q.mean[0] == doctest::Approx(p.mean[0]).epsilon(1e-4)); // f32: 2^-24 times a few hundred pixels, a few roundings
        CHECK(q.opacity == doctest::Approx(p.opacity).epsilon(2e-3));
        const double trace = p.conic[0] + p.conic[2];
        for (int k = 0; k < 3; ++k) CHECK(std::abs(q.conic[k] - p.conic[k]) < 2e-3 * trace); // f32 rotation of a thin ellipse
        const double dMean[2] = {1, -0.5}, dConic[3] = {0.3, 0.2, -0.4};
        const float fMean[2] = {1, -0.5f}, fConic[3] = {0.3f, 0.2f, -0.4f};
        GaussianGeometry<double> d{};
        GaussianGeometry<float> e{};
        projectGaussianBackward(view64, g, dMean, dConic, 0.7, 0.4, d);
        projectGaussianBackward(view32, f, fMean, fConic, 0.7f, 0.4f, e);
        for (int i = 0; i < 11; ++i) CHECK(std::isfinite(i < 3 ? e.position[i] : i < 6 ? e.scale[i - 3] : i < 10 ? e.rotation[i - 6] : e.opacity));
        double scale = 0;
        for (int i = 0; i < 3; ++i) scale = std::max(scale, std::abs(d.position[i]));
        for (int i = 0; i < 3; ++i) CHECK(std::abs(e.position[i] - d.position[i]) < 5e-3 * scale);
    }
    CHECK(seen > 150);
}
