// Held-out evaluation: draws every image of a split with a renderer and compares it with the reference.
#pragma once

#include "dataset/olat_dataset.h"
#include "eval/metrics.h"
#include "eval/splat_renderer.h"
#include "train/image_screen.h"

#include <functional>
#include <vector>

namespace nacre {

/// Directional lights that stand for one environment map.
constexpr int kEnvironmentDirections = 128;

struct EvalOptions {
    int timedFrames = 50;  // of the first image, after kEvalWarmupFrames; 0: no timing
};
constexpr int kEvalWarmupFrames = 10;

/// Sum over the pixels of the luminance of linear radiance.
double totalLuminance(const Image& image);

/// One image of the split; the pictures live only during the callback.
struct EvalImage {
    size_t index = 0, count = 0;
    const OlatImage& source;
    const Image& reference;
    const Image& render;
    ImageMetrics metrics;
};

struct EvalResult {
    std::vector<size_t> indices;       // of the split: the images that the figures are of, in its order
    std::vector<ImageMetrics> images;
    std::vector<double> luminance;     // of each render, summed over its pixels
    std::vector<UnusableImage> skipped; // the rest
    ImageMetrics mean;                 // of the per-image values
    double psnrHighlight = 0;          // of the highlights of all images together; NaN: there are none
    double psnrMin = 0;
    RenderTimes times;                 // zeros without timing
};

/// The lights that the renderer understands for one image: itself, those of its group, or its environment map as directional lights.
Result<std::vector<Light>> rendererLights(const Light& light);

/// `done` sees each image as soon as it is measured; an error it returns (a full disk, a stop signal) ends the evaluation. Images that cannot
/// be read, and black frames, are skipped; kBadInput if they are more than a third.
Result<EvalResult> evaluate(const OlatSplit& split, ImageCache& references, SplatRenderer& renderer, const EvalOptions& options,
                            const std::function<Status(const EvalImage&)>& done);

} // namespace nacre
