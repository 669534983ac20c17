// What improves the splats on one view, on the CPU or on a device. Everything else that a bake does with its splats is the host's (Trainer),
// which asks for the state before it looks at it and says so once it has changed it.
#pragma once

#include "appearance/evidence.h"
#include "render/reference_raster.h"
#include "train/loss.h"
#include "train/splat_activity.h"
#include "train/splat_state.h"

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

namespace nacre {

constexpr float kOpacityPull = 1e-8f;  // far below the gradient of a splat that matters

struct StepOptions {
    float lowPassVariance = 0.1f;  // px^2
    float sceneSize = 1.0f;        // half-size of the object, scales the rate of positions
    LossOptions loss;
    uint64_t seed = 1;
};

/// Where a step stands in the bake.
struct StepMoment {
    int step = 1;        // from 1
    double progress = 0; // [0, 1]: of the bake; what is in use depends on it
    double rate = 1;     // scales all learning rates
};

enum Stage { kStageProject, kStageBin, kStageShade, kStageBlend, kStageResolve, kStageLoss, kStageBlendBack, kStageGeometryBack, kStageShadeBack, kStageCount };
const char* stageName(Stage stage);

/// For benchmarks.
struct StepFigures {
    std::array<double, kStageCount> stageSeconds{}; // summed over the steps
    size_t visible = 0, active = 0;                 // of the last step: splats,
    size_t entries = 0, blocks = 0;                 // (splat, tile) pairs, and (splat, 4x4 block) pairs where they are counted
};

class StepEngine {
public:
    virtual ~StepEngine() = default;

    /// One camera under up to kMaxLightsPerStep lights. splatErrors, if given, [splats]: adds the squared error of the object's pixels
    /// before the step, each pixel's shared out among the splats by their blending weights.
    virtual LossStats step(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references, const StepMoment& moment,
                           double* splatErrors) = 0;
    /// Renders without learning; planes as rasterForward, three per light plus alpha.
    virtual void render(const Camera& camera, std::span<const Light> lights, std::vector<float>& planes) = 0;
    /// What the images of one view show beyond the render without highlights.
    virtual ViewEvidence evidence(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references) = 0;

    virtual void toHost() {}  // SplatState is what the steps have made of it
    virtual void changed() {} // after toHost: the host has changed it since
    virtual StepFigures figures() { return {}; }
    virtual void resetFigures() {}
};

/// The state outlives the engine.
using MakeStepEngine = std::function<std::unique_ptr<StepEngine>(SplatState& state, const StepOptions& options)>;
std::unique_ptr<StepEngine> makeCpuEngine(SplatState& state, const StepOptions& options);

// What all engines do alike.
PixelRays pixelRays(const Camera& camera);
LitView litView(const Camera& camera, std::span<const Light> lights);
GeometryRates geometryRates(const StepOptions& options, double rate);
float ambientRate(double rate);
void beginStep(SplatState& state, const StepOptions& options, const StepMoment& moment, const HostGeometry& geometry);
/// From blending backwards with three channels per light, whose gradients were PixelEvidence. dColors: [visible][channelStride].
std::vector<SplatEvidence> splatEvidence(std::span<const uint32_t> splatFromVisible, const ScreenGradient<float>* dSplats, const float* dColors, int lights);

} // namespace nacre
