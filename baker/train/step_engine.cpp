#include "train/step_engine.h"

#include "base/random.h"
#include "render/channel_stride.h"

#include <algorithm>

namespace nacre {

// Learning rates at the start.
// (Measured at 3000 steps: a quarter of those of the geometry costs 0.2 dB, half 0.05 dB.)
constexpr float kRatePosition = 1.6e-3f /* of the scene size */, kRateScale = 2e-2f, kRateRotation = 4e-3f, kRateOpacity = 2e-2f;
constexpr float kRateAmbient = 2e-2f; // of its logarithm

const char* stageName(Stage stage)
{
    constexpr const char* names[kStageCount] = {"project+sort", "bin", "shade", "blend", "resolve", "loss", "blend back", "geometry back", "shade back+Adam"};
    return names[stage];
}

PixelRays pixelRays(const Camera& camera)
{
    PixelRays rays;
    const auto axis = [&](int column, int k) { return camera.worldFromCamera[column][k]; }; // looks along -z, y is up
    for (int k = 0; k < 3; ++k) {
        rays.eye[k] = float(axis(3, k));
        rays.right[k] = float(axis(0, k) / camera.fx), rays.down[k] = float(-axis(1, k) / camera.fy);
        rays.origin[k] = float(-axis(2, k) - axis(0, k) * camera.cx / camera.fx + axis(1, k) * camera.cy / camera.fy);
    }
    rays.width = camera.width, rays.height = camera.height;
    return rays;
}

LitView litView(const Camera& camera, std::span<const Light> lights)
{
    LitView lit;
    for (int k = 0; k < 3; ++k) lit.eye[k] = float(camera.worldFromCamera[3][k]);
    lit.lightCount = int(lights.size());
    std::copy(lights.begin(), lights.end(), lit.lights);
    return lit;
}

GeometryRates geometryRates(const StepOptions& options, double scale)
{
    const float rate = float(scale);
    return {kRatePosition * options.sceneSize * rate, kRateScale * rate, kRateRotation * rate, kRateOpacity * rate};
}

float ambientRate(double rate) { return kRateAmbient * float(rate); }

void beginStep(SplatState& state, const StepOptions& options, const StepMoment& moment, const HostGeometry& geometry)
{
    Random random(options.seed, uint64_t(moment.step) << 8 | 1);
    const float uniform[3] = {random.uniform(), random.uniform(), random.uniform()};
    state.appearance->beginStep(moment.progress, moment.rate, moment.step, uniform, geometry);
}

std::vector<SplatEvidence> splatEvidence(std::span<const uint32_t> splatFromVisible, const ScreenGradient<float>* dSplats, const float* dColors, int lights)
{
    const size_t stride = size_t(channelStride(3 * lights));
    std::vector<SplatEvidence> out;
    for (size_t v = 0; v < splatFromVisible.size(); ++v) {
        const float weight = dSplats[v].weight;
        if (!(weight > kActiveWeight)) continue;
        SplatEvidence e{splatFromVisible[v], weight, {}, {}, {}};
        for (int l = 0; l < lights; ++l) {
            const float* d = &dColors[v * stride + size_t(3 * l)];
            e.residual[l] = d[0] / weight, e.slope[l] = d[1] / weight, e.saturated[l] = std::clamp(d[2] / weight, 0.0f, 1.0f);
        }
        out.push_back(e);
    }
    return out;
}

} // namespace nacre
