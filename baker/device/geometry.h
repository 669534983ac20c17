// Splats' geometry and the light of the surroundings on the device: what a step does with them. Twin of splat/geometry_step.cpp.
#pragma once

#include "device/device.h"
#include "device/tiles.h"
#include "render/channel_stride.h"
#include "splat/geometry_row.h"
#include "train/ambient.h"

namespace nacre::NACRE_BACKEND {

/// [splats] each.
struct DeviceGeometry {
    GeometryRow *raw, *momentum, *second;
    GaussianGeometry<float>* activated;
};

/// Gradients of what is blended of the centres' distances from the eye: in each row of `stride` floats; null: nothing is.
struct DistanceGradients {
    const float* first;
    int stride;
};

/// Floor: 332 bytes per active splat, and 0.4 kflop.
struct StepGeometryKernel {
    static constexpr uint32_t kThreads = 128;
    DeviceGeometry geometry;
    View<float> view;
    const uint32_t* splatFromVisible;
    const ScreenGradient<float>* dSplats;
    DistanceGradients distances;
    const uint8_t* active;
    uint32_t visibleCount;
    GeometryAdam adam;
    float opacityPull;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t v = t.index();
        if (v >= visibleCount || !active[v]) return;
        const size_t i = splatFromVisible[v];
        const float dDistance = distances.first ? distances.first[v * size_t(distances.stride)] : 0.0f;
        stepSplatReference(geometry.raw[i], geometry.momentum[i], geometry.second[i], geometry.activated[i], view, dSplats[v], dDistance, adam, opacityPull);
    }
};

/// One Adam step of the visible splats with active[visible] != 0: stepGeometry of splat/geometry.h.
inline void stepGeometry(Device& device, const DeviceGeometry& geometry, const View<float>& view, const TileView& tiles, const ScreenGradient<float>* dSplats,
                         const DistanceGradients& distances, const uint8_t* active, const GeometryAdam& adam, float opacityPull)
{
    launch(device, blocksFor(tiles.visibleCount, StepGeometryKernel::kThreads),
           StepGeometryKernel{geometry, view, tiles.splatFromVisible, dSplats, distances, active, tiles.visibleCount, adam, opacityPull});
}

struct AddAmbientKernel {
    static constexpr uint32_t kThreads = 128;
    const AmbientRow* rows;
    const uint32_t* splatFromVisible;
    uint32_t visibleCount;
    int lights;
    float* colors;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t v = t.index();
        if (v >= visibleCount) return;
        const AmbientRow& row = rows[splatFromVisible[v]];
        float* to = colors + v * size_t(channelStride(3 * lights));
        for (int c = 0; c < 3; ++c) {
            const float color = std::exp(row.value[size_t(c)]);
            for (int l = 0; l < lights; ++l) to[3 * l + c] += color;
        }
    }
};

struct StepAmbientKernel {
    static constexpr uint32_t kThreads = 128;
    AmbientRow* rows;
    const uint32_t* splatFromVisible;
    uint32_t visibleCount;
    int lights;
    const float* dColors;
    const uint8_t* active;
    float rate;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t v = t.index();
        if (v >= visibleCount || !active[v]) return;
        const float* d = dColors + v * size_t(channelStride(3 * lights));
        for (int c = 0; c < 3; ++c) {
            float gradient = 0;
            for (int l = 0; l < lights; ++l) gradient += d[3 * l + c];
            stepAmbientChannel(rows[splatFromVisible[v]], size_t(c), gradient, rate);
        }
    }
};

/// Adds the light of the surroundings to the colours of the visible splats, three channels for each light.
inline void addAmbient(Device& device, const TileView& tiles, const AmbientRow* rows, int lights, float* colors)
{
    launch(device, blocksFor(tiles.visibleCount, AddAmbientKernel::kThreads), AddAmbientKernel{rows, tiles.splatFromVisible, tiles.visibleCount, lights, colors});
}

/// Steps it, from the gradients of these colours.
inline void stepAmbient(Device& device, const TileView& tiles, const float* dColors, int lights, const uint8_t* active, float rate, AmbientRow* rows)
{
    launch(device, blocksFor(tiles.visibleCount, StepAmbientKernel::kThreads),
           StepAmbientKernel{rows, tiles.splatFromVisible, tiles.visibleCount, lights, dColors, active, rate});
}

} // namespace nacre::NACRE_BACKEND
