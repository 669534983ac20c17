#include "splat/geometry.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace nacre {

float logit(float opacity) { return std::log(opacity / (1.0f - opacity)); }

void SplatGeometry::resize(size_t count)
{
    raw.resize(count), momentum.resize(count), second.resize(count), activated.resize(count);
}

void SplatGeometry::activate(size_t i)
{
    GeometryRow& r = raw[i];
    GaussianGeometry<float>& g = activated[i];
    for (int k = 3; k < 6; ++k) r[k] = std::clamp(r[k], kMinLogScale, kMaxLogScale);
    r[10] = std::clamp(r[10], -kMaxOpacityLogit, kMaxOpacityLogit);
    float unit[4];
    if (detail::normalizeQuaternion(&r[6], unit) == 0.0f) std::copy(unit, unit + 4, &r[6]); // a lost rotation starts again
    for (int k = 0; k < 3; ++k) g.position[k] = r[k], g.scale[k] = std::exp(r[3 + k]);
    for (int k = 0; k < 4; ++k) g.rotation[k] = r[6 + k];
    g.opacity = 1.0f / (1.0f + std::exp(-r[10]));
}

void SplatGeometry::clearMoments(size_t i) { momentum[i].fill(0.0f), second[i].fill(0.0f); }

void SplatGeometry::permute(std::span<const uint32_t> order)
{
    const auto apply = [&](auto& data) {
        auto out = data;
        for (size_t i = 0; i < order.size(); ++i) out[i] = data[order[i]];
        data.swap(out);
    };
    apply(raw), apply(momentum), apply(second), apply(activated);
}

void stepGeometry(SplatGeometry& geometry, const View<float>& view, std::span<const uint32_t> splatFromVisible,
                  const ScreenGradient<float>* dSplats, const uint8_t* active, const GeometryRates& rates, int step, float opacityPull)
{
    constexpr float kBeta1 = 0.9f, kBeta2 = 0.99f, kEpsilon = 1e-15f;
    const float correction1 = 1.0f / (1.0f - std::pow(kBeta1, float(step))), correction2 = 1.0f / (1.0f - std::pow(kBeta2, float(step)));
    tbb::parallel_for(tbb::blocked_range<size_t>(0, splatFromVisible.size(), 256), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t v = range.begin(); v < range.end(); ++v) {
            if (!active[v]) continue;
            const size_t i = splatFromVisible[v];
            const GaussianGeometry<float>& g = geometry.activated[i];
            GaussianGeometry<float> d{};
            projectGaussianBackward(view, g, dSplats[v].mean, dSplats[v].conic, dSplats[v].opacity, d);
            d.opacity += opacityPull;
            const float gradient[kGeometryParameters] = {
                d.position[0], d.position[1], d.position[2], d.scale[0] * g.scale[0], d.scale[1] * g.scale[1], d.scale[2] * g.scale[2],
                d.rotation[0], d.rotation[1], d.rotation[2], d.rotation[3], d.opacity * g.opacity * (1.0f - g.opacity)};
            for (int k = 0; k < kGeometryParameters; ++k) {
                if (!(std::abs(gradient[k]) < 1e18f)) continue; // NaN, or its square would overflow: this parameter sits out the step
                const float rate = k < 3 ? rates.position : k < 6 ? rates.scale : k < 10 ? rates.rotation : rates.opacity;
                float &m = geometry.momentum[i][k], &s = geometry.second[i][k];
                m += (1.0f - kBeta1) * (gradient[k] - m);
                s += (1.0f - kBeta2) * (gradient[k] * gradient[k] - s);
                geometry.raw[i][k] -= rate * correction1 * m / (std::sqrt(s * correction2) + kEpsilon);
            }
            geometry.activate(i);
        }
    });
}

} // namespace nacre
