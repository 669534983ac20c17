// The image loss. x is the rendered, r the reference radiance, both cut at 1; Γ is the sRGB transfer function:
//
//   (1 - lambda) * mean ((x - r) Γ'(x))^2 / (2 kLossScale) + lambda * (1 - SSIM) + alphaWeight * mean |alpha - alphaReference|
//
// The first term is the squared error as displayed, to first order; Γ'(x) is held constant in the gradient. Path-traced and captured images
// carry noise whose mean, not whose median, is right in linear radiance: |Γ(x) - Γ(r)| (BiGS section 5.1) is pulled below it where noise is
// skewed, this is not (the weighting of Noise2Noise, Lehtinen et al. 2018, section 4.3, with the slope of our display).
// Means are over known pixels; the others (kUnknownAlpha) have no part in any sum, and no gradient.
// SSIM is that of eval/metrics.h, of Γ images. A render above 1 still feels the pull down to a darker reference (slope of Γ at 1).
#pragma once

#include "base/image.h"
#include "render/aligned_vector.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <vector>

namespace nacre {

constexpr float kLossScale = 0.03f; // a displayed difference of this weighs as much as in a mean of absolute differences

/// A reference made ready for the loss: Γ(r), Γ(g), Γ(b) and alpha as 16-bit unorm planes, and r, g, b as half floats.
struct PreparedImage {
    int width = 0, height = 0;
    std::vector<uint16_t> planes; // [4][height][width]
    std::vector<uint16_t> linear; // [3][height][width], at most 1
    std::vector<uint16_t> known;  // [height][width]: 65535, or 0 where nothing is known (and all planes are 0); empty: all is known
    size_t unknown = 0;           // pixels
    uint64_t id = newId();        // of these pixels: copies share it, until they are changed
    bool isKnown(size_t pixel) const { return known.empty() || known[pixel] != 0; }
    size_t bytes() const { return (planes.size() + linear.size() + known.size()) * sizeof(uint16_t); }
    static uint64_t newId()
    {
        static std::atomic<uint64_t> last{0};
        return ++last;
    }
};
PreparedImage prepareImage(const Image& linear);

struct LossOptions {
    float dssim = 0.0f;       // lambda
    float alphaWeight = 0.1f;
};

/// Sums over pixels and channels, for PSNR on the fly.
struct LossStats {
    double loss = 0;
    double squaredError = 0, count = 0;             // of Γ values
    double squaredErrorMasked = 0, countMasked = 0; // where reference alpha > 0.5
};

/// dB, at most 100.
inline double psnrFrom(double squaredError, double count)
{
    return -10.0 * std::log10(std::max(squaredError / std::max(count, 1.0), 1e-10));
}

/// Squared error of the displayed images under all lights, per pixel; 0 where reference alpha <= 0.5. planes and references as
/// ImageLoss::evaluate takes them; errors[height][width].
void objectErrors(const float* planes, const PreparedImage* const* references, int imageCount, float* errors);

class ImageLoss {
public:
    /// planes: 3 * imageCount + 1 planes of rasterForward; references: one per light, all of the same size.
    /// Overwrites dPlanes (same shape). Deterministic for any thread count.
    LossStats evaluate(const float* planes, const PreparedImage* const* references, int imageCount, const LossOptions& options,
                       float* dPlanes);

private:
    void addDssim(const PreparedImage* const* references, int imageCount, size_t samples, float lambda, float* dPlanes, double* loss);
    AlignedVector<float> encoded_, slope_; // Γ(render) and Γ'(render), [3 * imageCount][height][width]; filled only when SSIM is on
    AlignedVector<float> blurred_, scratch_;
};

} // namespace nacre
