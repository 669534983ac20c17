// The step on the CPU: SIMD over pixels and splats, threads over tiles and blocks of splats.
#include "train/step_engine.h"

#include "render/raster.h"
#include "train/pixel_evidence.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>

namespace nacre {

namespace {

class StageClock {
public:
    explicit StageClock(std::array<double, kStageCount>& seconds) : seconds_(seconds), last_(std::chrono::steady_clock::now()) {}
    void end(Stage stage)
    {
        const auto now = std::chrono::steady_clock::now();
        seconds_[stage] += std::chrono::duration<double>(now - last_).count();
        last_ = now;
    }

private:
    std::array<double, kStageCount>& seconds_;
    std::chrono::steady_clock::time_point last_;
};

class CpuEngine final : public StepEngine {
public:
    CpuEngine(SplatState& state, const StepOptions& options) : state_(state), options_(options) {}

    LossStats step(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references, const StepMoment& moment,
                   double* splatErrors) override;
    void render(const Camera& camera, std::span<const Light> lights, std::vector<float>& planes) override;
    ViewEvidence evidence(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references) override;
    StepFigures figures() override;
    void resetFigures() override { figures_ = {}; }

private:
    TrainableAppearance& appearance() { return *state_.appearance; }
    VisibleView project(const Camera& camera, int channels);
    void addAmbient(size_t lights);
    void stepAmbient(size_t lights, float rate);
    void shareOutErrors(const Camera& camera, const float* image, const PreparedImage* const* references, int imageCount, double* splatErrors);

    SplatState& state_;
    const StepOptions options_;
    StepFigures figures_;

    // Working memory of a step, reused.
    View<float> view_{};
    TileBuilder builder_;
    RasterScratch rasterScratch_;
    ImageLoss loss_;
    std::vector<uint32_t> visibleFromSplat_;
    std::vector<uint8_t> active_;
    std::vector<float> colors_, dColors_, dDistances_, planes_, dImage_;
    std::vector<ScreenGradient<float>> dSplats_;
};

void CpuEngine::addAmbient(size_t lights)
{
    if (!state_.hasAmbient(int(lights))) return;
    const size_t stride = size_t(channelStride(int(3 * lights)));
    for (size_t v = 0; v < builder_.visible.count(); ++v) {
        const std::array<float, 3>& a = state_.ambient[builder_.visible.splatFromVisible[v]].value;
        const float color[3] = {std::exp(a[0]), std::exp(a[1]), std::exp(a[2])};
        for (size_t k = 0; k < 3 * lights; ++k) colors_[v * stride + k] += color[k % 3];
    }
}

void CpuEngine::stepAmbient(size_t lights, float rate)
{
    if (!state_.hasAmbient(int(lights))) return;
    const size_t stride = size_t(channelStride(int(3 * lights)));
    for (size_t v = 0; v < builder_.visible.count(); ++v) {
        if (!active_[v]) continue;
        AmbientRow& row = state_.ambient[builder_.visible.splatFromVisible[v]];
        for (size_t c = 0; c < 3; ++c) {
            float gradient = 0;
            for (size_t l = 0; l < lights; ++l) gradient += dColors_[v * stride + 3 * l + c];
            stepAmbientChannel(row, c, gradient, rate);
        }
    }
}

VisibleView CpuEngine::project(const Camera& camera, int channels)
{
    view_ = makeView<float>(camera, options_.lowPassVariance);
    builder_.build(view_, state_.geometry.activated);
    const VisibleSplats& visible = builder_.visible;
    visibleFromSplat_.assign(state_.geometry.count(), ~0u);
    for (size_t v = 0; v < visible.count(); ++v) visibleFromSplat_[visible.splatFromVisible[v]] = uint32_t(v);
    const size_t floats = visible.count() * size_t(channelStride(channels));
    if (colors_.size() < floats) colors_.resize(floats), dColors_.resize(floats);
    if (dSplats_.size() < visible.count()) dSplats_.resize(visible.count()), active_.resize(visible.count());
    return {state_.geometry.activated, visibleFromSplat_, visible.count()};
}

void CpuEngine::render(const Camera& camera, std::span<const Light> lights, std::vector<float>& planes)
{
    const int channels = appearance().channels(int(lights.size()));
    const VisibleView view = project(camera, channels);
    const LitView lit = litView(camera, lights);
    appearance().forward(view, lit, colors_.data());
    addAmbient(lights.size());
    const size_t pixels = size_t(camera.width) * camera.height;
    planes_.resize(pixels * size_t(channels + 1));
    rasterForward(builder_.visible, builder_.tiles, colors_.data(), channels, planes_.data());
    const float* image = appearance().resolve(pixelRays(camera), lit, planes_.data());
    planes.assign(image, image + pixels * (3 * lights.size() + 1));
}

LossStats CpuEngine::step(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references,
                          const StepMoment& moment, double* splatErrors)
{
    StageClock clock(figures_.stageSeconds);
    const int channels = appearance().channels(int(lights.size()));
    beginStep(state_, options_, moment, [&] { return std::span<const GaussianGeometry<float>>(state_.geometry.activated); });
    appearance().shareAmongNeighbours();

    const VisibleView view = project(camera, channels);
    const VisibleSplats& visible = builder_.visible;
    figures_.visible = visible.count(), figures_.entries = builder_.tiles.entries.size();
    clock.end(kStageBin);
    figures_.stageSeconds[kStageBin] -= builder_.projectSeconds, figures_.stageSeconds[kStageProject] += builder_.projectSeconds;

    const LitView lit = litView(camera, lights);
    appearance().forward(view, lit, colors_.data());
    addAmbient(lights.size());
    clock.end(kStageShade);

    const size_t pixels = size_t(camera.width) * camera.height;
    planes_.resize(pixels * size_t(channels + 1)), dImage_.resize(pixels * (3 * lights.size() + 1));
    rasterForward(visible, builder_.tiles, colors_.data(), channels, planes_.data());
    clock.end(kStageBlend);

    const PixelRays rays = pixelRays(camera);
    const float* image = appearance().resolve(rays, lit, planes_.data());
    clock.end(kStageResolve);

    const LossStats stats = loss_.evaluate(image, references, int(lights.size()), options_.loss, dImage_.data());
    clock.end(kStageLoss);

    const float* dPlanes = appearance().resolveBackward(rays, lit, planes_.data(), dImage_.data());
    clock.end(kStageResolve);

    rasterBackward(visible, builder_.tiles, colors_.data(), channels, planes_.data(), dPlanes, rasterScratch_, dColors_.data(),
                   dSplats_.data());
    clock.end(kStageBlendBack);

    const float gradientScale = float(pixels); // the loss is a mean over pixels: undo it, so that statistics do not depend on the image size
    const int distance = appearance().distanceChannel();
    dDistances_.resize(distance < 0 ? 0 : visible.count());
    for (size_t v = 0; v < dDistances_.size(); ++v) dDistances_[v] = dColors_[v * size_t(channelStride(channels)) + size_t(distance)];
    figures_.active = 0;
    for (size_t v = 0; v < visible.count(); ++v) {
        const size_t i = visible.splatFromVisible[v];
        active_[v] = addActivity(dSplats_[v], gradientScale, state_.gradientSum[i], state_.seen[i]);
        figures_.active += active_[v];
    }
    // Geometry moves after the appearance has used it: both gradients belong to the same state.
    clock.end(kStageGeometryBack);
    stepAmbient(lights.size(), ambientRate(moment.rate));
    appearance().backwardAndStep(view, lit, active_.data(), dColors_.data());
    clock.end(kStageShadeBack);
    stepGeometry(state_.geometry, view_, visible.splatFromVisible, dSplats_.data(), distance < 0 ? nullptr : dDistances_.data(), active_.data(),
                 geometryRates(options_, moment.rate), moment.step, kOpacityPull);
    clock.end(kStageGeometryBack);
    if (splatErrors) shareOutErrors(camera, image, references, int(lights.size()), splatErrors);
    return stats;
}

// Blending backwards: with the error as gradient of a channel, the gradient of a splat's colour is the sum of weight times error. After a
// step, whose working memory is free then.
void CpuEngine::shareOutErrors(const Camera& camera, const float* image, const PreparedImage* const* references, int imageCount, double* splatErrors)
{
    constexpr int kChannels = 3; // the fewest that the rasteriser takes; the first is used
    const size_t pixels = size_t(camera.width) * camera.height, stride = size_t(channelStride(kChannels));
    const VisibleSplats& visible = builder_.visible;
    std::vector<float> colors(visible.count() * stride), planes((kChannels + 1) * pixels), errors((kChannels + 1) * pixels);
    objectErrors(image, references, imageCount, errors.data());
    std::copy_n(image + 3 * size_t(imageCount) * pixels, pixels, planes.data() + kChannels * pixels); // alpha
    rasterBackward(visible, builder_.tiles, colors.data(), kChannels, planes.data(), errors.data(), rasterScratch_, dColors_.data(),
                   dSplats_.data());
    for (size_t v = 0; v < visible.count(); ++v) splatErrors[visible.splatFromVisible[v]] += dColors_[v * stride];
}

// Blending backwards, as above, with three channels per light: residual, slope of the display, saturation.
ViewEvidence CpuEngine::evidence(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references)
{
    const int channels = 3 * int(lights.size());
    const size_t pixels = size_t(camera.width) * camera.height, stride = size_t(channelStride(channels));
    std::vector<float> image;
    appearance().hideHighlights(true);
    render(camera, lights, image);
    appearance().hideHighlights(false);
    std::vector<float> gradients(size_t(channels + 1) * pixels, 0.0f);
    for (size_t l = 0; l < lights.size(); ++l)
        for (size_t i = 0; i < pixels; ++i) {
            const PixelEvidence e = pixelEvidence(image.data() + 3 * l * pixels, references[l]->planes.data(), pixels, i);
            gradients[3 * l * pixels + i] = e.residual, gradients[(3 * l + 1) * pixels + i] = e.slope, gradients[(3 * l + 2) * pixels + i] = e.saturated;
        }
    const VisibleSplats& visible = builder_.visible;
    std::vector<float> colors(visible.count() * stride), planes(size_t(channels + 1) * pixels);
    std::copy_n(image.data() + size_t(channels) * pixels, pixels, planes.data() + size_t(channels) * pixels); // alpha
    rasterBackward(visible, builder_.tiles, colors.data(), channels, planes.data(), gradients.data(), rasterScratch_, dColors_.data(), dSplats_.data());
    return {litView(camera, lights), splatEvidence(visible.splatFromVisible, dSplats_.data(), dColors_.data(), int(lights.size()))};
}

StepFigures CpuEngine::figures()
{
    figures_.blocks = 0;
    for (const TileEntry& e : builder_.tiles.entries) figures_.blocks += size_t(std::popcount(e.blockMask));
    return figures_;
}

} // namespace

std::unique_ptr<StepEngine> makeCpuEngine(SplatState& state, const StepOptions& options) { return std::make_unique<CpuEngine>(state, options); }

} // namespace nacre
