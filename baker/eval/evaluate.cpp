// Means are over images of per-image values, as papers report them; PSNR is never taken of a mean error, but for highlights.
#include "eval/evaluate.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre {

// Every figure of ImageMetrics, so that a mean cannot forget one.
static constexpr double ImageMetrics::*kFigures[] = {&ImageMetrics::psnr, &ImageMetrics::psnrMasked, &ImageMetrics::ssim,
                                                     &ImageMetrics::flip, &ImageMetrics::relMseLinear,
                                                     &ImageMetrics::highlightMissing, &ImageMetrics::highlightFalse,
                                                     &ImageMetrics::highlightSquared, &ImageMetrics::highlightSamples};
static_assert(sizeof(ImageMetrics) == sizeof(kFigures) / sizeof(kFigures[0]) * sizeof(double));

Result<std::vector<Light>> rendererLights(const Light& light)
{
    if (light.type == LightType::kGroup) return *light.group;
    if (light.isPunctual()) return std::vector<Light>{light};
    return expandEnvironment(light, kEnvironmentDirections);
}

double totalLuminance(const Image& image)
{
    double sum = 0;
    for (size_t i = 0; i < image.rgba.size(); i += 4)
        sum += 0.2126 * double(image.rgba[i]) + 0.7152 * double(image.rgba[i + 1]) + 0.0722 * double(image.rgba[i + 2]);
    return sum;
}

Result<EvalResult> evaluate(const OlatSplit& split, ImageCache& references, SplatRenderer& renderer, const EvalOptions& options,
                            const std::function<Status(const EvalImage&)>& done)
{
    const size_t count = split.images.size();
    if (count == 0) return Error{ErrorCode::kBadInput, "split '" + split.name + "' has no images; nothing to evaluate"};
    EvalResult result;
    result.psnrMin = std::numeric_limits<double>::infinity();
    const ImageFaults faults(split);
    for (size_t i = 0; i < count; ++i) {
        const OlatImage& source = split.images[i];
        const Camera& camera = split.cameras[source.camera];
        const auto lights = rendererLights(source.light); // an environment map is a file, too
        const auto reference = references.load(split, i);
        const std::string fault = !reference ? reference.error().message
                                  : !lights  ? source.path + ": " + lights.error().message
                                             : faults.of(source, **reference);
        if (!fault.empty()) {
            result.skipped.push_back({source.path, fault});
            if (Status s = fewUnusable(result.skipped, count, split.name); !s) return s.error();
            continue;
        }
        const auto render = renderer.render(camera, *lights);
        if (!render) return render.error();

        const ImageMetrics metrics = compareImages(*render, **reference);
        if (!std::isfinite(metrics.psnr) || !std::isfinite(metrics.relMseLinear)) // a loaded reference is finite
            return Error{ErrorCode::kGpu, "the renderer (" + renderer.description() + ") gave NaN or infinite pixels for '" + source.path + "'"};
        result.indices.push_back(i), result.images.push_back(metrics), result.luminance.push_back(totalLuminance(*render));
        result.psnrMin = std::min(result.psnrMin, metrics.psnr);
        for (auto figure : kFigures) result.mean.*figure += metrics.*figure;
        if (const Status status = done({i, count, source, **reference, *render, metrics}); !status) return status.error();

        if (result.images.size() == 1 && options.timedFrames > 0) {
            const auto times = renderer.time(camera, *lights, kEvalWarmupFrames, options.timedFrames);
            if (!times) return times.error();
            result.times = *times;
        }
    }
    result.psnrHighlight = highlightPsnr(result.mean);
    for (auto figure : kFigures) result.mean.*figure /= double(std::max<size_t>(result.images.size(), 1));
    return result;
}

} // namespace nacre
