// bigs on a device: a thread a splat. Memory is that of BigsParameters, blocks of 16 splats, so that a warp reads a coefficient in two whole
// segments of 64 bytes.
#pragma once

#include "appearance/bigs/indirect_sharing.h"
#include "device/bigs_splat.h"
#include "device/shared_adam.h"
#include "device/tiles.h"
#include "splat/splat_normals.h"

namespace nacre::NACRE_BACKEND {

constexpr uint32_t kBigsThreads = 64; // as many as leave the SH of five lights and a view in 38 KB of shared memory

/// The splats' memory, and which of them take part.
struct BigsView {
    BigsStep step;
    const GaussianGeometry<float>* geometry;
    const uint32_t* visibleFromSplat;
    float *value, *momentum, *second, *kept;
    const uint8_t *visibility, *scatters; // or null
    uint32_t count;
    int coefficients;

    NACRE_DEVICE BigsSplat splat(size_t i) const
    {
        const size_t block = i / kLanes16, lane = i % kLanes16;
        const auto column = [&](float* data, int rows) { return BlockColumn<float>{data + block * size_t(rows) * kLanes16 + lane}; };
        return {column(value, coefficients), column(momentum, coefficients), column(second, kBigsGroups), column(kept, kBigsTermStride),
                visibility ? visibility + i * kVisibilityTexels : nullptr, !scatters || scatters[i] ? step.bands.scatter : 0};
    }
};

template <int kLights>
struct BigsShared {
    float basis[kLights + 1][kMaxShFunctions][kBigsThreads];
};

template <int kLights>
NACRE_DEVICE BigsDirections<kLights, Strided<float, int(kBigsThreads)>> directionsOf(const Thread& t, const BigsView& view, size_t splat)
{
    using Basis = Strided<float, int(kBigsThreads)>;
    BigsShared<kLights>& s = t.shared<BigsShared<kLights>>();
    return bigsDirections<kLights, Basis>(view.step, view.geometry[splat].position, [&](int l) { return Basis{&s.basis[l][0][t.thread()]}; });
}

/// Floor: of a visible splat with s of 16 functions 2,100 bytes of coefficients, 16 of the map, 190 written; 8 kflop under four lights.
template <int kLights>
struct ForwardBigs {
    static constexpr uint32_t kThreads = kBigsThreads;
    using Shared = BigsShared<kLights>;
    BigsView view;
    float* colors;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index();
        if (i >= view.count) return;
        const uint32_t v = view.visibleFromSplat[i];
        if (v == ~0u) return;
        bigsSplatForward(view.step, view.splat(i), directionsOf<kLights>(t, view, i), colors + size_t(v) * kColorStride);
    }
};

/// Floor: of an active splat with s of 16 functions 8,400 bytes of coefficients and momenta, in and out, and 350 of all else; 16 kflop.
template <int kLights>
struct StepBigs {
    static constexpr uint32_t kThreads = kBigsThreads, kBlocksAtOnce = 5; // what shared memory leaves room for: else nvcc saves registers and spills
    using Shared = BigsShared<kLights>;
    BigsView view;
    const uint8_t* active; // [visible]
    const float* dColors;
    float *dLobe, *dForward; // [splats][4]
    uint8_t* took;           // [splats]
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index();
        if (i >= view.count) return;
        const uint32_t v = view.visibleFromSplat[i];
        const bool on = v != ~0u && active[v];
        took[i] = on;
        if (on)
            bigsSplatBackward(view.step, view.splat(i), directionsOf<kLights>(t, view, i), dColors + size_t(v) * kColorStride, dLobe + 4 * i, dForward + 4 * i);
    }
};

/// SharedAdam's step of sharpness (its logarithm) and colour.
struct StepSharp {
    static constexpr uint32_t kThreads = 128;
    BigsView view;
    DeviceSharedAdam::Levels levels;
    const uint8_t* took;
    int first;
    float least, most;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index();
        if (i >= view.count || !took[i]) return;
        float delta[kAdamNumbers];
        levels.step(i, delta);
        const BlockColumn<float> value = view.splat(i).value;
        const float x = value[first] - delta[0];
        value[first] = x < least ? least : x > most ? most : x;
        for (int c = 0; c < 3; ++c) {
            const float color = value[first + 1 + c] - delta[1 + c];
            value[first + 1 + c] = color > 0 ? color : 0.0f;
        }
    }
};

constexpr uint32_t kIndirectRow = 80; // 75, and what makes rows start on a cache line

/// T_ind of each splat side by side, so that a neighbour is one run of numbers, and nobody reads what is being written.
struct CopyIndirect {
    static constexpr uint32_t kThreads = 128;
    BigsView view;
    float* rows;
    int numbers;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index();
        if (i >= view.count) return;
        const BlockColumn<float> value = view.splat(i).value;
        for (int k = 0; k < numbers; ++k) rows[i * kIndirectRow + size_t(k)] = value[kTInd + k];
    }
};

/// Twin of shareIndirect, a thread a number. Floor: nine rows of 320 bytes a splat in, one out.
struct ShareIndirect {
    static constexpr uint32_t kThreads = 160;
    BigsView view;
    const float* rows;
    const uint32_t* neighbours;
    int functions;
    float rate;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index() / kIndirectRow, number = t.index() % kIndirectRow;
        if (i >= view.count || number < 3 || number >= size_t(3 * functions)) return;
        const size_t c = number % 3;
        float sum = 0, sum0 = 0;
        for (size_t j = 0; j < kSplatNeighbours; ++j) {
            const float* row = rows + size_t(neighbours[i * kSplatNeighbours + j]) * kIndirectRow;
            sum += row[number], sum0 += row[c];
        }
        const float* own = rows + i * kIndirectRow;
        if (!(own[c] > 0) || !(sum0 > 1e-12f)) return;
        view.splat(i).value[kTInd + int(number)] += rate * (own[c] * sharedRatio(int(number) / 3, sum / sum0) - own[number]);
    }
};

/// Keeps the splats' coefficients between steps.
class DeviceBigs {
public:
    /// After the host has changed it.
    void upload(Device& device, BigsState& state)
    {
        const BigsParameters& p = state.parameters;
        const auto put = [&](auto& buffer, const auto& values) { buffer.upload(device, std::span(values.data(), values.size())); };
        put(value_, p.value), put(momentum_, p.momentum), put(second_, p.secondMoment);
        put(visibility_, p.visibility), put(scatters_, p.scatters), put(neighbours_, state.neighbours);
        kept_.reserve(device, p.blocks() * kBigsTermStride * kLanes16);
        dLobe_.reserve(device, 4 * p.count), dForward_.reserve(device, 4 * p.count), took_.reserve(device, p.count);
        shared_.upload(device, state.shared, p.count), sharedForward_.upload(device, state.sharedForward, p.count);
    }
    /// What steps have changed.
    void download(Device& device, BigsState& state) const
    {
        BigsParameters& p = state.parameters;
        value_.download(device, std::span(p.value.data(), p.value.size())), momentum_.download(device, std::span(p.momentum.data(), p.momentum.size()));
        second_.download(device, std::span(p.secondMoment.data(), p.secondMoment.size()));
        shared_.download(device, state.shared), sharedForward_.download(device, state.sharedForward);
    }

    void shareAmongNeighbours(Device& device, const BigsState& state)
    {
        if (!(state.shareRate > 0)) return;
        const BigsView v = view(state, {}, {}, nullptr);
        rows_.reserve(device, size_t(v.count) * kIndirectRow);
        launch(device, blocksFor(v.count, CopyIndirect::kThreads), CopyIndirect{v, rows_.data(), 3 * state.bands.indirect});
        launch(device, blocksFor(size_t(v.count) * kIndirectRow, ShareIndirect::kThreads),
               ShareIndirect{v, rows_.data(), neighbours_.data(), state.bands.indirect, state.shareRate});
    }

    /// colors: [visible][kColorStride].
    void forward(Device& device, const BigsState& state, const TileView& tiles, const GaussianGeometry<float>* geometry, const DeviceLitView& lit, float* colors)
    {
        const BigsView v = view(state, tiles, lit, geometry);
        withLights(v.step, [&](auto lights) { launch(device, blocksFor(v.count, kBigsThreads), ForwardBigs<lights()>{v, colors}); });
    }

    /// After forward of the same view. Steps the visible splats with active[visible] != 0.
    void backwardAndStep(Device& device, const BigsState& state, const TileView& tiles, const GaussianGeometry<float>* geometry, const DeviceLitView& lit,
                         const uint8_t* active, const float* dColors)
    {
        const BigsView v = view(state, tiles, lit, geometry);
        withLights(v.step, [&](auto lights) {
            launch(device, blocksFor(v.count, kBigsThreads), StepBigs<lights()>{v, active, dColors, dLobe_.data(), dForward_.data(), took_.data()});
        });
        if (state.bands.lobe) stepSharp(device, v, state, shared_, dLobe_.data(), kLobeSharpness, kMinLogSharpness, kMaxLogSharpness);
        if (state.bands.forward) stepSharp(device, v, state, sharedForward_, dForward_.data(), kForward, kMinLogForward, kMaxLogForward);
    }

private:
    BigsView view(const BigsState& state, const TileView& tiles, const DeviceLitView& lit, const GaussianGeometry<float>* geometry) const
    {
        const BigsUpdate& u = state.update;
        const BigsStep step{lit, state.bands, state.random, u, 1 - std::pow(u.beta1, float(u.step)), 1 - std::pow(u.beta2, float(u.step))};
        return {step, geometry, tiles.visibleFromSplat, value_.data(), momentum_.data(), second_.data(), kept_.data(),
                visibility_.size() ? visibility_.data() : nullptr, scatters_.size() ? scatters_.data() : nullptr, uint32_t(state.parameters.count),
                state.parameters.coefficients()};
    }

    void stepSharp(Device& device, const BigsView& v, const BigsState& state, DeviceSharedAdam& adam, const float* gradient, int first, float least, float most)
    {
        const DeviceSharedAdam::Levels levels = adam.step(device, gradient, took_.data(), state.sharedRates);
        launch(device, blocksFor(v.count, StepSharp::kThreads), StepSharp{v, levels, took_.data(), first, least, most});
    }

    template <class Run>
    static void withLights(const BigsStep& step, Run&& run)
    {
        switch (step.lit.lightCount + (step.random.on ? 1 : 0)) {
        case 1: return run(std::integral_constant<int, 1>());
        case 2: return run(std::integral_constant<int, 2>());
        case 3: return run(std::integral_constant<int, 3>());
        case 4: return run(std::integral_constant<int, 4>());
        default: return run(std::integral_constant<int, kMaxLightsPerStep + 1>());
        }
    }

    Buffer<float> value_, momentum_, second_, kept_, dLobe_, dForward_, rows_;
    Buffer<uint8_t> visibility_, scatters_, took_;
    Buffer<uint32_t> neighbours_;
    DeviceSharedAdam shared_, sharedForward_;
};

} // namespace nacre::NACRE_BACKEND
