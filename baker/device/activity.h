// Which splats are active in a step, and the statistics of density control, on the device.
#pragma once

#include "device/device.h"
#include "device/tiles.h"
#include "train/splat_activity.h"

namespace nacre::NACRE_BACKEND {

/// Floor: 28 bytes per visible splat, and scattered 16 per active one.
struct ActivityKernel {
    static constexpr uint32_t kThreads = 256;
    TileView view;
    const ScreenGradient<float>* dSplats;
    float scale;
    uint8_t* active;
    float* gradientSum;
    uint32_t* seen;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t v = t.index();
        if (v >= view.visibleCount) return;
        const uint32_t i = view.splatFromVisible[v];
        active[v] = addActivity(dSplats[v], scale, gradientSum[i], seen[i]);
    }
};

/// active: [visible], overwritten; gradientSum, seen: [splats], added to. `scale` is that of addActivity.
inline void findActive(Device& device, const TileView& view, const ScreenGradient<float>* dSplats, float scale, uint8_t* active, float* gradientSum,
                       uint32_t* seen)
{
    launch(device, blocksFor(view.visibleCount, ActivityKernel::kThreads), ActivityKernel{view, dSplats, scale, active, gradientSum, seen});
}

} // namespace nacre::NACRE_BACKEND
