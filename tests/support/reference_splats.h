// What the scalar reference of blending takes, in float64.
#pragma once

#include "render/reference_raster.h"
#include "render/tiles.h"

#include <numeric>
#include <vector>

namespace nacre {

struct ReferenceSplats {
    std::vector<ProjectedGaussian<double>> splats;
    std::vector<double> colors;  // [splats][channels]
    std::vector<uint32_t> order; // front to back

    /// colors: [splats][stride].
    ReferenceSplats(const VisibleSplats& visible, const float* colors, size_t stride, size_t channels) : order(visible.count())
    {
        std::iota(order.begin(), order.end(), 0u);
        for (size_t i = 0; i < order.size(); ++i) {
            const auto& s = visible.projected[i];
            splats.push_back({{s.mean[0], s.mean[1]}, {s.conic[0], s.conic[1], s.conic[2]}, s.opacity, s.distance, {s.extent[0], s.extent[1]}});
            for (size_t c = 0; c < channels; ++c) this->colors.push_back(colors[i * stride + c]);
        }
    }
};

} // namespace nacre
