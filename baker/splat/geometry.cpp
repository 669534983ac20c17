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

} // namespace nacre
