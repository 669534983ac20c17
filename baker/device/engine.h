// The step on a device: what cpu_engine.cpp does, with the kernels of this folder. State, images and all between them stay on the device; the
// host sees the state when it asks for it.
#pragma once

#include "device/activity.h"
#include "device/blend.h"
#include "device/geometry.h"
#include "device/images.h"
#include "device/loss.h"
#include "device/model.h"
#include "device/tiles.h"
#include "device/visibility.h"
#include "train/pixel_evidence.h"
#include "train/step_engine.h"

#include <chrono>

namespace nacre::NACRE_BACKEND {

/// PixelEvidence of all pixels under all lights: the gradients that evidence blends backwards. The plane behind the last is zero.
struct EvidenceKernel {
    static constexpr uint32_t kThreads = 256;
    const float* image;
    DeviceImage references[kMaxLightsPerStep];
    float* gradients;
    uint32_t pixels, lights;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index(), planes = 3 * lights;
        if (i >= pixels) return;
        for (size_t l = 0; l < lights; ++l) {
            const PixelEvidence e = pixelEvidence(image + 3 * l * pixels, references[l].planes, pixels, i);
            float* to = gradients + 3 * l * pixels + i;
            to[0] = e.residual, to[pixels] = e.slope, to[2 * size_t(pixels)] = e.saturated;
        }
        gradients[planes * pixels + i] = 0;
    }
};

class DeviceEngine final : public StepEngine {
public:
    DeviceEngine(std::unique_ptr<Device> device, SplatState& state, const StepOptions& options)
        : device_(std::move(device)), state_(state), options_(options), model_(makeDeviceModel(*state.appearance)), images_(*device_)
    {
        state_.appearance->setVisibilityDrawer([this](std::span<const GaussianGeometry<float>> splats, int size, int oversample, std::span<const glm::vec3> lights) {
            return visibility_.draw(*device_, splats, size, oversample, lights);
        });
    }
    ~DeviceEngine() override { state_.appearance->setVisibilityDrawer({}); }

    LossStats step(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references, const StepMoment& moment,
                   double* splatErrors) override
    {
        beginStep(state_, options_, moment, [&] {
            toHost();
            changed();
            return std::span<const GaussianGeometry<float>>(state_.geometry.activated);
        });
        begin();
        model_->beginStep(*device_);
        const int count = int(lights.size()), channels = state_.appearance->channels(count);
        const DeviceView view = project(camera, lights);
        const float* image = draw(view, channels);
        DeviceImage held[kMaxLightsPerStep];
        for (int l = 0; l < count; ++l) held[l] = images_.get(*references[l]);
        const size_t pixels = pixelsOf(camera);
        dImage_.reserve(*device_, pixels * size_t(3 * count + 1));
        loss_.run(*device_, image, held, count, options_.loss, dImage_.data());
        end(kStageLoss);
        const float* dPlanes = model_->resolveBackward(*device_, view, planes_.data(), dImage_.data());
        end(kStageResolve);
        dColors_.reserve(*device_, size_t(view.tiles.visibleCount) * channelStride(channels));
        dSplats_.reserve(*device_, view.tiles.visibleCount);
        blendBack_.run(*device_, view.tiles, colors_.data(), channels, planes_.data(), dPlanes, dColors_.data(), dSplats_.data());
        end(kStageBlendBack);

        active_.reserve(*device_, view.tiles.visibleCount);
        findActive(*device_, view.tiles, dSplats_.data(), float(pixels), active_.data(), gradientSum_.data(), seen_.data());
        if (state_.hasAmbient(count)) stepAmbient(*device_, view.tiles, dColors_.data(), count, active_.data(), ambientRate(moment.rate), ambient_.data());
        // Geometry moves after the appearance has used it: both gradients belong to the same state.
        end(kStageGeometryBack);
        model_->backwardAndStep(*device_, view, active_.data(), dColors_.data());
        end(kStageShadeBack);
        const int distance = state_.appearance->distanceChannel();
        stepGeometry(*device_, {raw_.data(), momentum_.data(), second_.data(), activated_.data()}, makeView<float>(camera, options_.lowPassVariance), view.tiles,
                     dSplats_.data(), {distance < 0 ? nullptr : dColors_.data() + distance, channelStride(channels)}, active_.data(),
                     GeometryAdam(geometryRates(options_, moment.rate), moment.step), kOpacityPull);
        end(kStageGeometryBack);
        ahead_ = true;
        if (splatErrors) shareOutErrors(view, image, held, count, splatErrors);
        return loss_.stats(*device_);
    }

    void render(const Camera& camera, std::span<const Light> lights, std::vector<float>& planes) override
    {
        begin();
        const DeviceView view = project(camera, lights);
        const float* image = draw(view, state_.appearance->channels(int(lights.size())));
        planes.resize(pixelsOf(camera) * (3 * lights.size() + 1));
        device_->copyOut(planes.data(), image, planes.size() * sizeof(float));
    }

    ViewEvidence evidence(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references) override
    {
        begin();
        const int count = int(lights.size()), channels = 3 * count;
        const size_t pixels = pixelsOf(camera);
        const DeviceView view = project(camera, lights);
        state_.appearance->hideHighlights(true);
        const float* image = draw(view, state_.appearance->channels(count));
        state_.appearance->hideHighlights(false);
        dImage_.reserve(*device_, pixels * size_t(channels + 1));
        EvidenceKernel kernel{image, {}, dImage_.data(), uint32_t(pixels), uint32_t(count)};
        for (int l = 0; l < count; ++l) kernel.references[l] = images_.get(*references[l]);
        launch(*device_, blocksFor(pixels, EvidenceKernel::kThreads), kernel);
        blendBack(view, image + size_t(channels) * pixels, channels);
        const size_t visible = view.tiles.visibleCount;
        std::vector<uint32_t> splats(visible);
        std::vector<ScreenGradient<float>> dSplats(visible);
        std::vector<float> dColors(visible * channelStride(channels));
        device_->copyOut(splats.data(), view.tiles.splatFromVisible, visible * sizeof(uint32_t));
        dSplats_.download(*device_, dSplats), dColors_.download(*device_, dColors);
        return {litView(camera, lights), splatEvidence(splats, dSplats.data(), dColors.data(), count)};
    }

    void toHost() override
    {
        if (!ahead_) return;
        raw_.download(*device_, state_.geometry.raw), momentum_.download(*device_, state_.geometry.momentum);
        second_.download(*device_, state_.geometry.second), activated_.download(*device_, state_.geometry.activated);
        ambient_.download(*device_, state_.ambient), gradientSum_.download(*device_, state_.gradientSum), seen_.download(*device_, state_.seen);
        model_->download(*device_);
        ahead_ = false;
    }
    void changed() override { stale_ = true, ahead_ = false; }

    StepFigures figures() override { return figures_; }
    void resetFigures() override { figures_ = {}, timed_ = true; }

    size_t deviceBytes() const { return device_->bytes(); }
    size_t residentImages() const { return images_.count(); }

private:
    static size_t pixelsOf(const Camera& camera) { return size_t(camera.width) * size_t(camera.height); }

    /// Before anything is done with the splats.
    void begin()
    {
        images_.beginStep();
        if (stale_) {
            raw_.upload(*device_, state_.geometry.raw), momentum_.upload(*device_, state_.geometry.momentum);
            second_.upload(*device_, state_.geometry.second), activated_.upload(*device_, state_.geometry.activated);
            ambient_.upload(*device_, state_.ambient), gradientSum_.upload(*device_, state_.gradientSum), seen_.upload(*device_, state_.seen);
            model_->upload(*device_);
        }
        stale_ = false;
        if (timed_) device_->synchronize(), last_ = std::chrono::steady_clock::now();
    }

    /// Waits only for benchmarks.
    void end(Stage stage)
    {
        if (!timed_) return;
        device_->synchronize();
        const auto now = std::chrono::steady_clock::now();
        figures_.stageSeconds[stage] += std::chrono::duration<double>(now - last_).count();
        last_ = now;
    }

    DeviceView project(const Camera& camera, std::span<const Light> lights)
    {
        const uint32_t splats = uint32_t(state_.count());
        const TileView tiles = tiles_.build(*device_, makeView<float>(camera, options_.lowPassVariance), activated_.data(), splats);
        figures_.visible = tiles.visibleCount, figures_.entries = tiles.entryCount;
        end(kStageBin);
        return {tiles, activated_.data(), splats, deviceLitView(litView(camera, lights)), pixelRays(camera)};
    }

    /// The image; the planes that it is made of are in planes_.
    const float* draw(const DeviceView& view, int channels)
    {
        colors_.reserve(*device_, size_t(view.tiles.visibleCount) * channelStride(channels));
        model_->forward(*device_, view, colors_.data());
        if (state_.hasAmbient(view.lit.lightCount)) addAmbient(*device_, view.tiles, ambient_.data(), view.lit.lightCount, colors_.data());
        end(kStageShade);
        planes_.reserve(*device_, view.pixels() * size_t(channels + 1));
        blendForward(*device_, view.tiles, colors_.data(), channels, planes_.data());
        end(kStageBlend);
        const float* image = model_->resolve(*device_, view, planes_.data());
        end(kStageResolve);
        return image;
    }

    /// Sums of weight times dImage_ into dColors_: with any numbers of the pixels as gradients of the colours, those of a splat are that.
    void blendBack(const DeviceView& view, const float* alpha, int channels)
    {
        const size_t pixels = view.pixels(), visible = view.tiles.visibleCount;
        colors_.reserve(*device_, visible * channelStride(channels)), dColors_.reserve(*device_, visible * channelStride(channels));
        dSplats_.reserve(*device_, visible), sums_.reserve(*device_, pixels * size_t(channels + 1));
        colors_.zero(*device_), sums_.zero(*device_);
        device_->copyWithin(sums_.data() + size_t(channels) * pixels, alpha, pixels * sizeof(float));
        blendBack_.run(*device_, view.tiles, colors_.data(), channels, sums_.data(), dImage_.data(), dColors_.data(), dSplats_.data());
    }

    // After a step, whose working memory is free then.
    void shareOutErrors(const DeviceView& view, const float* image, const DeviceImage* references, int count, double* splatErrors)
    {
        constexpr int kChannels = 3; // the fewest that blending takes; the first is used
        const size_t pixels = view.pixels(), visible = view.tiles.visibleCount, stride = channelStride(kChannels);
        dImage_.reserve(*device_, (kChannels + 1) * pixels);
        dImage_.zero(*device_);
        objectErrors(*device_, image, references, count, dImage_.data());
        blendBack(view, image + 3 * size_t(count) * pixels, kChannels);
        std::vector<uint32_t> splats(visible);
        std::vector<float> dColors(visible * stride);
        device_->copyOut(splats.data(), view.tiles.splatFromVisible, visible * sizeof(uint32_t));
        dColors_.download(*device_, dColors);
        for (size_t v = 0; v < visible; ++v) splatErrors[splats[v]] += dColors[v * stride];
    }

    std::unique_ptr<Device> device_;
    SplatState& state_;
    const StepOptions options_;
    bool stale_ = true, ahead_ = false; // the device's state is behind the host's, before it
    Buffer<GeometryRow> raw_, momentum_, second_;
    Buffer<GaussianGeometry<float>> activated_;
    Buffer<AmbientRow> ambient_;
    Buffer<float> gradientSum_;
    Buffer<uint32_t> seen_;
    std::unique_ptr<DeviceModel> model_;
    DeviceImages images_;

    // Working memory of a step, reused.
    DeviceVisibility visibility_;
    Tiles tiles_;
    BlendBackward blendBack_;
    DeviceLoss loss_;
    Buffer<float> colors_, dColors_, planes_, dImage_, sums_;
    Buffer<ScreenGradient<float>> dSplats_;
    Buffer<uint8_t> active_;

    StepFigures figures_;
    bool timed_ = false;
    std::chrono::steady_clock::time_point last_;
};

} // namespace nacre::NACRE_BACKEND
