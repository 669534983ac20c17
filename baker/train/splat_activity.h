// Which splats a view teaches, and what density control remembers of them.
#pragma once

#include "base/host_device.h"
#include "render/reference_raster.h"

#include <cmath>
#include <cstdint>

namespace nacre {

constexpr float kActiveWeight = 2e-3f; // a splat whose blending weights sum to less than this over the image does not learn from it

/// Whether the splat is active; if so, adds scale * |d loss / d mean| and counts it.
NACRE_HD inline bool addActivity(const ScreenGradient<float>& d, float scale, float& gradientSum, uint32_t& seen)
{
    if (!(d.weight > kActiveWeight)) return false;
    gradientSum += scale * std::sqrt(d.mean[0] * d.mean[0] + d.mean[1] * d.mean[1]);
    ++seen;
    return true;
}

} // namespace nacre
