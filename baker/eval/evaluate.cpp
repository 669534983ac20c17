// Means are over images of per-image values, as papers report them; PSNR is never taken of a mean error.
#include "eval/evaluate.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre {

// Every figure of ImageMetrics, so that a mean cannot forget one.
static constexpr double ImageMetrics::*kFigures[] = {&ImageMetrics::psnr, &ImageMetrics::psnrMasked, &ImageMetrics::ssim,
                                                     &ImageMetrics::flip, &ImageMetrics::relMseLinear};
static_assert(sizeof(ImageMetrics) == sizeof(kFigures) / sizeof(kFigures[0]) * sizeof(double));

Result<std::vector<Light>> rendererLights(const Light& light)
{
    if (light.type == LightType::kGroup) return *light.group;
    if (light.isPunctual()) return std::vector<Light>{light};
    return expandEnvironment(light, kEnvironmentDirections);
}

Result<EvalResult> evaluate(const OlatSplit& split, ImageCache& references, SplatRenderer& renderer, const EvalOptions& options,
                            const std::function<Status(const EvalImage&)>& done)
{
    const size_t count = split.images.size();
    if (count == 0) return Error{ErrorCode::kBadInput, "split '" + split.name + "' has no images; nothing to evaluate"};
    EvalResult result;
    result.psnrMin = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < count; ++i) {
        const OlatImage& source = split.images[i];
        const Camera& camera = split.cameras[source.camera];
        const auto lights = rendererLights(source.light);
        if (!lights) return lights.error();
        const auto reference = references.load(split, i);
        if (!reference) return reference.error();
        const auto render = renderer.render(camera, *lights);
        if (!render) return render.error();

        const ImageMetrics metrics = compareImages(*render, **reference);
        if (!std::isfinite(metrics.psnr) || !std::isfinite(metrics.relMseLinear)) // a loaded reference is finite
            return Error{ErrorCode::kGpu, "the renderer (" + renderer.description() + ") gave NaN or infinite pixels for '" + source.path + "'"};
        result.images.push_back(metrics);
        result.psnrMin = std::min(result.psnrMin, metrics.psnr);
        for (auto figure : kFigures) result.mean.*figure += metrics.*figure / double(count);
        if (const Status status = done({i, count, source, **reference, *render, metrics}); !status) return status.error();

        if (i == 0 && options.timedFrames > 0) {
            const auto times = renderer.time(camera, *lights, kEvalWarmupFrames, options.timedFrames);
            if (!times) return times.error();
            result.times = *times;
        }
    }
    return result;
}

} // namespace nacre
