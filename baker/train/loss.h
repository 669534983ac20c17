// The image loss of BiGS section 5.1 on display-encoded images, Γ(x) = sRGB of clamp(x, 0, 1):
//
//   (1 - lambda) * mean |Γ(render) - Γ(reference)| + lambda * (1 - SSIM) + alphaWeight * mean |alpha - alphaReference|
//
// SSIM as in eval/metrics.h. A render above 1 still feels the pull down to a darker reference (slope of Γ at 1).
#pragma once

#include "base/image.h"
#include "render/aligned_vector.h"

#include <cstdint>
#include <vector>

namespace nacre {

/// A reference made ready for the loss: Γ(r), Γ(g), Γ(b) and alpha as 16-bit unorm planes.
struct PreparedImage {
    int width = 0, height = 0;
    std::vector<uint16_t> planes; // [4][height][width]
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

class ImageLoss {
public:
    /// planes: 3 * imageCount + 1 planes of rasterForward; references: one per light, all of the same size.
    /// Overwrites dPlanes (same shape). Deterministic for any thread count.
    LossStats evaluate(const float* planes, const PreparedImage* const* references, int imageCount, const LossOptions& options,
                       float* dPlanes);

private:
    void addDssim(const PreparedImage* const* references, int imageCount, float lambda, float* dPlanes, double* loss);
    AlignedVector<float> encoded_, slope_; // Γ(render) and Γ'(render), [3 * imageCount][height][width]; filled only when SSIM is on
    AlignedVector<float> blurred_, scratch_;
};

} // namespace nacre
