// sss on a device: splats to channels, the channels of pixels to an image, both ways back, and the step. Twin of appearance/sss/sss_model.cpp and
// sss_resolve.cpp.
#pragma once

#include "appearance/sss/sss_backward.h"
#include "appearance/sss/sss_network_backward.h"
#include "appearance/sss/sss_resolve.h"
#include "appearance/sss/sss_row.h"
#include "appearance/sss/sss_state.h"
#include "device/lit_view.h"
#include "device/sss_network.h"
#include "render/channel_stride.h"
#include "render/projection.h"

#include <algorithm>

namespace nacre::NACRE_BACKEND {

/// What kernels read of the splats of a view and its lights.
struct SssView {
    float* rows;               // [splats][kSssRowFloats]
    const uint8_t* visibility; // [splats][kVisibilityTexels], or null
    const float* weights;      // [kSssAllWeights]
    const GaussianGeometry<float>* geometry;
    const uint32_t* splatFromVisible;
    uint32_t visibleCount;
    int stride;    // of channels
    float frame[4];
    bool nearness;
    DeviceLitView lit;
    SssStep step;

    NACRE_DEVICE VisibilityMap map(uint32_t splat) const { return {visibility ? visibility + size_t(splat) * kVisibilityTexels : nullptr}; }
    NACRE_DEVICE const float* row(uint32_t splat) const { return rows + size_t(splat) * kSssRowFloats; }

    /// Lanes beyond the last splat repeat it.
    NACRE_DEVICE uint32_t visibleOf(uint32_t first, int lane) const { return first + uint32_t(lane) < visibleCount ? first + uint32_t(lane) : visibleCount - 1; }

    /// The inputs of the network, by the first three warps: a thread a row, then one a splat.
    template <int kLights, class T>
    NACRE_DEVICE void fill(const T& t, uint32_t first, SssSharedBatch<kLights>& batch, float* falloff) const
    {
        using Batch = SssSharedBatch<kLights>;
        static_assert(Batch::kRows <= 64 && Batch::kSplats <= 32 && kSssThreads >= 96);
        const int thread = int(t.thread());
        if (thread < Batch::kRows) {
            const uint32_t splat = splatFromVisible[visibleOf(first, thread % Batch::kSplats)];
            const float* position = geometry[splat].position;
            const LightSample<float> toEye = samplePointLight(lit.eye, 0.0f, position);
            falloff[thread] = sssRowLight(lit.lights[thread / Batch::kSplats], position, toEye.dir, map(splat), frame, nearness, batch.light + thread * kSssLightRow);
        } else if (thread >= 64 && thread < 64 + Batch::kSplats) {
            const int lane = thread - 64;
            const uint32_t splat = splatFromVisible[visibleOf(first, lane)];
            float normal[3], *fixed = batch.fixed + lane * kSssFixedRow;
            sssRowUnitNormal(row(splat), normal);
            sssFixedInputs(geometry[splat].position, normal, frame, fixed);
            for (int k = kSssFixedInputs; k < kSssFixedPadded; ++k) fixed[k] = 0;
            for (int k = 0; k < kSssCodeInputs; ++k) batch.code[lane * kSssCodeRow + k] = row(splat)[kSssRowCode + k];
        }
    }
};

/// Splats to channels. Per visible splat under four lights 500 bytes (148 of row and geometry, 256 of maps, in sectors of 32, 104 written) and 43 kflop:
/// twice 2752 for what lights do not change and twice 4736 a light. 60,000 splats are 2.6 Gflop, 0.04 ms of 67 Tflop/s, and 30 MB, 0.006 ms of 4.8 TB/s.
template <int kLights>
struct ForwardSss {
    static constexpr uint32_t kThreads = kSssThreads;
    using Batch = SssSharedBatch<kLights>;
    struct Shared {
        SssSharedWeights weights;
        Batch batch;
        float falloff[Batch::kRows];
    };
    SssView view;
    float* channels; // [visible][stride]

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const int thread = int(t.thread());
        if (view.step.network()) s.weights.load(t, view.weights);
        for (uint32_t first = t.block() * Batch::kSplats; first < view.visibleCount; first += t.blocks() * Batch::kSplats) {
            view.template fill<kLights>(t, first, s.batch, s.falloff);
            if (thread >= 96 && thread < 96 + Batch::kSplats && first + uint32_t(thread - 96) < view.visibleCount) {
                const uint32_t visible = first + uint32_t(thread - 96), splat = view.splatFromVisible[visible];
                sssRowChannels(view.row(splat), view.geometry[splat].position, view.lit.eye, view.step.residual, channels + size_t(visible) * view.stride);
            }
            if (view.step.network()) sssNetworkForward<kLights>(t, s.weights, view.step.share, s.batch);
            if (thread < Batch::kRows && first + uint32_t(thread % Batch::kSplats) < view.visibleCount) {
                const uint32_t visible = first + uint32_t(thread % Batch::kSplats);
                const int l = thread / Batch::kSplats;
                sssRowLightChannels(view.step, s.batch.light[thread * kSssLightRow + kSssVisibilityInput], s.falloff[thread], view.lit.lights[l].intensity,
                                    sssRowSubsurface(view.row(view.splatFromVisible[visible]), view.step.residual), s.batch.share[thread],
                                    s.batch.residual + 3 * thread, channels + size_t(visible) * view.stride + kSssSurfaceChannels + kSssLightChannels * l);
            } // no barrier: what a thread has read here it writes itself in the next batch, or others do after barriers
        }
    }
};

/// The gradient of channels to a step of the rows and the gradient of the network, a sum for each block. The activations are computed again, 43 of its
/// 123 kflop per splat under four lights: to write and read them would be 5 kB a splat, no sooner done, and gigabytes of memory for a million. Bytes per
/// splat: 1000, of rows and their moments most. 60,000 splats: 7.4 Gflop, 0.11 ms of 67 Tflop/s; 60 MB, 0.013 ms of 4.8 TB/s.
template <int kLights>
struct StepSss {
    static constexpr uint32_t kThreads = kSssThreads, kBlocksAtOnce = 2; // shared memory holds no more
    using Batch = SssSharedBatch<kLights>;
    struct Shared {
        SssSharedWeights weights;
        Batch batch;
        float falloff[Batch::kRows], dSubsurface[Batch::kRows];
        uint32_t active; // a bit for each splat of the batch
    };
    static_assert(Batch::kSplats * kSssRowFloats <= Batch::kRows * kSssRowShare);
    SssView view;
    float *momentum, *second;  // of rows
    const uint8_t* active;     // [visible]
    const float* dChannels;    // [visible][stride]
    float* dWeights;           // [blocks][kSssAllWeights]

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const int thread = int(t.thread());
        float* gradient = s.batch.hs; // of rows [splat][kSssRowFloats], once it has served
        SssNetworkGradient sum;
        sum.clear();
        if (view.step.network()) s.weights.load(t, view.weights);
        for (uint32_t first = t.block() * Batch::kSplats; first < view.visibleCount; first += t.blocks() * Batch::kSplats) {
            t.sync();
            if (t.warp() == 0) {
                const uint32_t visible = first + uint32_t(thread);
                const uint32_t bits = t.ballot(kFullWarp, thread < Batch::kSplats && visible < view.visibleCount && active[visible]);
                if (thread == 0) s.active = bits;
            }
            t.sync();
            if (s.active == 0) continue;
            if (view.step.network()) network(t, first, s, sum);
            if (thread < Batch::kSplats && (s.active >> thread & 1)) {
                float dSubsurface = 0;
                for (int l = 0; view.step.network() && l < kLights; ++l) dSubsurface += s.dSubsurface[l * Batch::kSplats + thread];
                const uint32_t visible = first + uint32_t(thread);
                sssRowBackward(view.step, view.row(view.splatFromVisible[visible]), dChannels + size_t(visible) * view.stride, dSubsurface, gradient + thread * kSssRowFloats);
            }
            t.sync();
            for (int k = thread; k < Batch::kSplats * kSssRowFloats; k += int(kThreads)) {
                const int lane = k / kSssRowFloats, number = k % kSssRowFloats;
                if (!(s.active >> lane & 1)) continue;
                const size_t at = size_t(view.splatFromVisible[first + uint32_t(lane)]) * kSssRowFloats + size_t(number);
                sssStepNumber(view.step, number, number < kSssRowCode || view.step.code ? gradient[k] : 0.0f, view.rows[at], momentum[at], second[at]);
            }
        }
        if (view.step.network()) sum.store(t.thread(), dWeights + size_t(t.block()) * kSssAllWeights);
    }

private:
    NACRE_DEVICE void network(const Thread& t, uint32_t first, Shared& s, SssNetworkGradient& sum) const
    {
        const int thread = int(t.thread());
        view.template fill<kLights>(t, first, s.batch, s.falloff);
        sssNetworkForward<kLights>(t, s.weights, view.step.share, s.batch);
        if (thread < Batch::kRows) {
            const int lane = thread % Batch::kSplats, l = thread / Batch::kSplats;
            float *residual = s.batch.residual + 3 * thread, dResidual[3] = {}, share = s.batch.share[thread], dShare = 0, dSubsurface = 0;
            if (s.active >> lane & 1) {
                const uint32_t visible = first + uint32_t(lane);
                sssRowLightBackward(view.step, dChannels + size_t(visible) * view.stride + kSssSurfaceChannels + kSssLightChannels * l,
                                    s.batch.light[thread * kSssLightRow + kSssVisibilityInput], s.falloff[thread], view.lit.lights[l].intensity,
                                    sssRowSubsurface(view.row(view.splatFromVisible[visible]), view.step.residual), share, residual, dResidual, &dShare, &dSubsurface);
            }
            s.dSubsurface[thread] = dSubsurface;
            sssEndsBackward(residual, share, dResidual, dShare, residual, &s.batch.share[thread]);
        }
        float* gradient = s.batch.hs;
        sssNetworkBackward<kLights>(t, s.weights, view.step.share, s.batch, sum, [gradient](int splat, int i, const SssVector<4>& d) {
            for (int q = 0; q < 4; ++q) gradient[splat * kSssRowFloats + kSssRowCode + i + q] = d.v[q];
        });
    }
};

/// Sums the gradient over the blocks, always in the same order, and steps the weights. 31 kB a block of the step: 8 MB, 0.002 ms of 4.8 TB/s.
struct StepSssWeights {
    static constexpr uint32_t kThreads = 256;
    struct Shared {
        float sum[kThreads];
    };
    const float* dWeights;
    uint32_t parts;
    float *value, *momentum, *second;
    SssStep step;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const uint32_t k = t.block() * kWarp + t.lane(), warps = kThreads / kWarp;
        float sum = 0;
        if (k < uint32_t(kSssAllWeights))
            for (uint32_t part = t.warp(); part < parts; part += warps) sum += dWeights[size_t(part) * kSssAllWeights + k];
        s.sum[t.thread()] = sum;
        t.sync();
        if (t.warp() != 0 || k >= uint32_t(kSssAllWeights)) return;
        for (uint32_t w = 1; w < warps; ++w) sum += s.sum[w * kWarp + t.lane()];
        sssAdam(step, kSssNetworkRate, sum, value[k], momentum[k], second[k]);
    }
};

/// What pixels see. Bytes per pixel: 48, and 28 a light; flops: 45, and 150 a light. Four lights at 800 x 800: 102 MB, 0.02 ms of 4.8 TB/s; 0.4 Gflop.
struct ResolveSss {
    static constexpr uint32_t kThreads = 128;
    PixelRays rays;
    DeviceLitView lit;
    const float* planes; // [channels, alpha][pixels]
    float* image;        // [3 a light, alpha][pixels]

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t at = t.index(), pixels = size_t(rays.width) * size_t(rays.height);
        if (at >= pixels) return;
        const float alpha = planes[size_t(kSssSurfaceChannels + kSssLightChannels * lit.lightCount) * pixels + at];
        image[size_t(3 * lit.lightCount) * pixels + at] = alpha;
        if (!(alpha > 0)) {
            for (int k = 0; k < 3 * lit.lightCount; ++k) image[size_t(k) * pixels + at] = 0;
            return;
        }
        float g[kSssSurfaceChannels], ray[3];
        for (int k = 0; k < kSssSurfaceChannels; ++k) g[k] = planes[size_t(k) * pixels + at];
        sssPixelRay(rays, float(at % size_t(rays.width)) + 0.5f, float(at / size_t(rays.width)) + 0.5f, ray);
        const SssPixel<float> pixel = sssPixel(g, alpha, rays.eye, ray);
        for (int l = 0; l < lit.lightCount; ++l) {
            const PlainLight& light = lit.lights[l];
            const LightSample<float> to = sampleLight(light, pixel.point);
            const SssReflection<float> o = sssReflect(pixel.surface, pixel.wo, to.dir);
            float own[kSssLightChannels];
            for (int k = 0; k < kSssLightChannels; ++k) own[k] = planes[size_t(kSssSurfaceChannels + kSssLightChannels * l + k) * pixels + at];
            for (int c = 0; c < 3; ++c) image[size_t(3 * l + c) * pixels + at] = sssRadiance(own, light.intensity[c] * to.falloff, o.value[c], c);
        }
    }
};

/// And back. Bytes per pixel: 92, and 32 a light; flops: 90, and 370 a light. Four lights at 800 x 800: 141 MB, 0.03 ms of 4.8 TB/s; 1 Gflop, 0.015 ms.
struct ResolveSssBackward {
    static constexpr uint32_t kThreads = 128;
    PixelRays rays;
    DeviceLitView lit;
    const float *planes, *dImage;
    float* dPlanes;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t at = t.index(), pixels = size_t(rays.width) * size_t(rays.height);
        if (at >= pixels) return;
        const int channels = kSssSurfaceChannels + kSssLightChannels * lit.lightCount;
        const float alpha = planes[size_t(channels) * pixels + at], dAlpha = dImage[size_t(3 * lit.lightCount) * pixels + at];
        if (!(alpha > 0)) {
            for (int k = 0; k < channels; ++k) dPlanes[size_t(k) * pixels + at] = 0;
            dPlanes[size_t(channels) * pixels + at] = dAlpha;
            return;
        }
        float g[kSssSurfaceChannels], ray[3];
        for (int k = 0; k < kSssSurfaceChannels; ++k) g[k] = planes[size_t(k) * pixels + at];
        sssPixelRay(rays, float(at % size_t(rays.width)) + 0.5f, float(at / size_t(rays.width)) + 0.5f, ray);
        const SssPixel<float> pixel = sssPixel(g, alpha, rays.eye, ray);
        SssPixelGradient<float> gradient;
        for (int l = 0; l < lit.lightCount; ++l) {
            const PlainLight& light = lit.lights[l];
            const LightSample<float> to = sampleLight(light, pixel.point);
            const size_t own = size_t(kSssSurfaceChannels + kSssLightChannels * l);
            float channelsOf[kSssLightChannels] = {}, dPixel[3], dOwn[kSssLightChannels];
            channelsOf[kSssIncident] = planes[(own + kSssIncident) * pixels + at]; // the gradient needs no other
            for (int c = 0; c < 3; ++c) dPixel[c] = dImage[size_t(3 * l + c) * pixels + at];
            sssPixelLightBackward(pixel, channelsOf, to, light.radius > kMinLightRadius ? light.radius : kMinLightRadius, light.intensity,
                                  sssReflect(pixel.surface, pixel.wo, to.dir), dPixel, dOwn, gradient);
            for (int k = 0; k < kSssLightChannels; ++k) dPlanes[(own + size_t(k)) * pixels + at] = dOwn[k];
        }
        float dG[kSssSurfaceChannels], dAlphaHere = 0;
        sssPixelBackward(pixel, g, ray, gradient, dG, &dAlphaHere);
        for (int k = 0; k < kSssSurfaceChannels; ++k) dPlanes[size_t(k) * pixels + at] = dG[k];
        dPlanes[size_t(channels) * pixels + at] = dAlphaHere + dAlpha;
    }
};

/// What a bake keeps of sss, on the device, and its part in a step.
class DeviceSss {
public:
    /// At most so many blocks of a step at a time, each with a sum of its own: two a multiprocessor of a large card (132 of them), whatever the card, as the
    /// order of the sums depends on it. And of forward.
    explicit DeviceSss(uint32_t stepBlocks = 264, uint32_t forwardBlocks = 1024) : stepBlocks_(stepBlocks), forwardBlocks_(forwardBlocks) {}

    static int channels(int lights) { return kSssSurfaceChannels + kSssLightChannels * lights; }

    /// After the host has changed it.
    void upload(Device& device, const SssState& state)
    {
        rows_.upload(device, std::span<const SssRow>(state.row));
        momentum_.upload(device, std::span<const SssRow>(state.momentum)), second_.upload(device, std::span<const SssRow>(state.second));
        visibility_.upload(device, std::span<const uint8_t>(state.visibility));
        weights_.upload(device, std::span<const float>(state.weights.value));
        weightsMomentum_.upload(device, std::span<const float>(state.networkMomentum));
        weightsSecond_.upload(device, std::span<const float>(state.networkSecond));
        beginStep(state);
    }
    /// What steps have changed.
    void download(Device& device, SssState& state) const
    {
        rows_.download(device, std::span(state.row)), momentum_.download(device, std::span(state.momentum)), second_.download(device, std::span(state.second));
        weights_.download(device, std::span<float>(state.weights.value));
        weightsMomentum_.download(device, std::span(state.networkMomentum)), weightsSecond_.download(device, std::span(state.networkSecond));
        state.weights.transpose();
    }
    /// After beginStep of the model, if that has changed neither splats nor weights: the step's rates and the parts in use.
    void beginStep(const SssState& state)
    {
        std::copy_n(state.frame, 4, frame_);
        nearness_ = state.nearness;
        for (int l = 1; l <= kMaxLightsPerStep; ++l) step_[l] = sssStep(state, l);
    }

    /// The visible splats, front to back, to channels [visible][channelStride].
    void forward(Device& device, const GaussianGeometry<float>* geometry, const uint32_t* splatFromVisible, uint32_t visibleCount, const DeviceLitView& lit, float* out)
    {
        const SssView v = view(geometry, splatFromVisible, visibleCount, lit);
        withLights(lit.lightCount, [&](auto lights) {
            launch(device, std::min(batches(lights(), visibleCount), forwardBlocks_), ForwardSss<lights()>{v, out});
        });
    }

    /// Planes of channels and alpha to planes of three per light and alpha. Valid until the next call.
    const float* resolve(Device& device, const PixelRays& rays, const DeviceLitView& lit, const float* planes)
    {
        const size_t pixels = size_t(rays.width) * size_t(rays.height);
        image_.reserve(device, pixels * size_t(3 * lit.lightCount + 1));
        launch(device, blocksFor(pixels, ResolveSss::kThreads), ResolveSss{rays, lit, planes, image_.data()});
        return image_.data();
    }
    const float* resolveBackward(Device& device, const PixelRays& rays, const DeviceLitView& lit, const float* planes, const float* dImage)
    {
        const size_t pixels = size_t(rays.width) * size_t(rays.height);
        dPlanes_.reserve(device, pixels * size_t(channels(lit.lightCount) + 1));
        launch(device, blocksFor(pixels, ResolveSssBackward::kThreads), ResolveSssBackward{rays, lit, planes, dImage, dPlanes_.data()});
        return dPlanes_.data();
    }

    /// Steps the visible splats with active[visible] != 0, and the network.
    void backwardAndStep(Device& device, const GaussianGeometry<float>* geometry, const uint32_t* splatFromVisible, uint32_t visibleCount, const DeviceLitView& lit,
                         const uint8_t* active, const float* dChannels)
    {
        const SssView v = view(geometry, splatFromVisible, visibleCount, lit);
        uint32_t blocks = 0;
        withLights(lit.lightCount, [&](auto lights) {
            blocks = std::min(batches(lights(), visibleCount), stepBlocks_);
            if (v.step.network()) dWeights_.reserve(device, size_t(blocks) * kSssAllWeights);
            launch(device, blocks, StepSss<lights()>{v, momentum_.data()->data(), second_.data()->data(), active, dChannels, dWeights_.data()});
        });
        if (v.step.network())
            launch(device, blocksFor(kSssAllWeights, kWarp),
                   StepSssWeights{dWeights_.data(), blocks, weights_.data(), weightsMomentum_.data(), weightsSecond_.data(), v.step});
    }

private:
    static uint32_t batches(int lights, uint32_t visibleCount) { return blocksFor(visibleCount, uint32_t(kSssBatchSplats(lights))); }

    template <class Work>
    static void withLights(int lights, Work work)
    {
        static_assert(kMaxLightsPerStep == 4);
        if (lights == 1) work(std::integral_constant<int, 1>());
        if (lights == 2) work(std::integral_constant<int, 2>());
        if (lights == 3) work(std::integral_constant<int, 3>());
        if (lights == 4) work(std::integral_constant<int, 4>());
    }

    SssView view(const GaussianGeometry<float>* geometry, const uint32_t* splatFromVisible, uint32_t visibleCount, const DeviceLitView& lit) const
    {
        SssView v{};
        v.rows = rows_.data()->data(), v.visibility = visibility_.size() ? visibility_.data() : nullptr, v.weights = weights_.data();
        v.geometry = geometry, v.splatFromVisible = splatFromVisible, v.visibleCount = visibleCount;
        v.stride = channelStride(channels(lit.lightCount)), v.lit = lit, v.step = step_[lit.lightCount];
        std::copy_n(frame_, 4, v.frame);
        v.nearness = nearness_;
        return v;
    }

    uint32_t stepBlocks_, forwardBlocks_;
    Buffer<SssRow> rows_, momentum_, second_;
    Buffer<uint8_t> visibility_;
    Buffer<float> weights_, weightsMomentum_, weightsSecond_, dWeights_, image_, dPlanes_;
    float frame_[4] = {0, 0, 0, 0};
    bool nearness_ = false;
    SssStep step_[kMaxLightsPerStep + 1] = {};
};

} // namespace nacre::NACRE_BACKEND
