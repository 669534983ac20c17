#include "splat/geometry.h"

#include <algorithm>
#include <cmath>

namespace nacre {

float logit(float opacity) { return std::log(opacity / (1.0f - opacity)); }

void SplatGeometry::resize(size_t count)
{
    raw.resize(count), momentum.resize(count), second.resize(count), activated.resize(count);
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

GeometryAdam::GeometryAdam(const GeometryRates& rates, int step)
    : correction2(1.0f / (1.0f - std::pow(kBeta2, float(step))))
{
    const float correction1 = 1.0f / (1.0f - std::pow(kBeta1, float(step)));
    for (int k = 0; k < kGeometryParameters; ++k)
        rate[k] = (k < 3 ? rates.position : k < 6 ? rates.scale : k < 10 ? rates.rotation : rates.opacity) * correction1;
}

void activateReference(GeometryRow& r, GaussianGeometry<float>& g)
{
    for (int k = 3; k < 6; ++k) r[k] = std::clamp(r[k], kMinLogScale, kMaxLogScale);
    r[10] = std::clamp(r[10], -kMaxOpacityLogit, kMaxOpacityLogit);
    float unit[4];
    if (detail::normalizeQuaternion(&r[6], unit) == 0.0f) std::copy(unit, unit + 4, &r[6]); // a lost rotation starts again
    for (int k = 0; k < 3; ++k) g.position[k] = r[k], g.scale[k] = std::exp(r[3 + k]);
    for (int k = 0; k < 4; ++k) g.rotation[k] = r[6 + k];
    g.opacity = 1.0f / (1.0f + std::exp(-r[10]));
}

void stepSplatReference(SplatGeometry& geometry, size_t i, const View<float>& view, const ScreenGradient<float>& dSplat,
                        float dDistance, const GeometryAdam& adam, float opacityPull)
{
    const GaussianGeometry<float>& g = geometry.activated[i];
    GaussianGeometry<float> d{};
    projectGaussianBackward(view, g, dSplat.mean, dSplat.conic, dSplat.opacity, dDistance, d);
    d.opacity += opacityPull;
    const float gradient[kGeometryParameters] = {
        d.position[0], d.position[1], d.position[2], d.scale[0] * g.scale[0], d.scale[1] * g.scale[1], d.scale[2] * g.scale[2],
        d.rotation[0], d.rotation[1], d.rotation[2], d.rotation[3], d.opacity * g.opacity * (1.0f - g.opacity)};
    for (int k = 0; k < kGeometryParameters; ++k) {
        if (!(std::abs(gradient[k]) < GeometryAdam::kMaxGradient)) continue;
        float &m = geometry.momentum[i][k], &s = geometry.second[i][k];
        m += (1.0f - GeometryAdam::kBeta1) * (gradient[k] - m);
        s += (1.0f - GeometryAdam::kBeta2) * (gradient[k] * gradient[k] - s);
        geometry.raw[i][k] -= adam.rate[k] * m / (std::sqrt(s * adam.correction2) + GeometryAdam::kEpsilon);
    }
    activateReference(geometry.raw[i], geometry.activated[i]);
}

} // namespace nacre
