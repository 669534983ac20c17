// How far a render is from its reference: the figures of `nacre eval`.
//
// Γ(x) = sRGB transfer of clamp(x, 0, 1), in float (no 8-bit rounding). All figures are per image; callers take means over
// images, but of highlights, which few pixels of few images show, the PSNR over all of them. Masked: pixels whose reference alpha is above 0.5.
// Pixels of which the reference knows nothing (kUnknownAlpha) are in no sum.
#pragma once

#include "base/image.h"

namespace nacre {

struct ImageMetrics {
    double psnr = 0;         // dB of Γ images, rgb, whole image; at most kMaxPsnr
    double psnrMasked = 0;   // the same over the masked pixels; the whole image if there are none
    double ssim = 0;         // Γ images, see ssim()
    double flip = 0;         // see flip.h; 0 is identical, 1 the worst
    double relMseLinear = 0; // mean of |a-b|^2 / (b^2 + 0.01) over linear masked rgb; catches HDR errors that Γ hides
    // Shares of the masked pixels. Luma has the weights of Rec. 709, on Γ values.
    double highlightMissing = 0; // luma of the reference exceeds by kHighlightStep the largest of the render in the 5x5 pixels around
    double highlightFalse = 0;   // the other way round: light that the render has invented
    double highlightSquared = 0, highlightSamples = 0; // squared error of Γ rgb, and how many, where reference luma exceeds kHighlightLuma
};
constexpr double kHighlightStep = 0.2, kHighlightLuma = 0.8;
constexpr int kHighlightReach = 2; // pixels to each side

/// dB over the highlights of all images whose figures were added up; NaN if there are none.
double highlightPsnr(const ImageMetrics& sums);

/// Identical images would score infinity; a finite cap keeps means and JSON sane, far above any real comparison.
constexpr double kMaxPsnr = 100.0;

/// The images must have one size (else every figure is NaN). NaN pixels give NaN figures.
ImageMetrics compareImages(const Image& render, const Image& reference);

/// ImageMetrics::psnrMasked alone, in a hundredth of the time.
double psnrMaskedOf(const Image& render, const Image& reference);

/// Structural similarity of Γ(render) and Γ(reference) (Wang et al. 2004): 11x11 Gaussian window, sigma 1.5, C1 = 0.01^2, C2 = 0.03^2, mean
/// over all pixels and rgb. Zero padding at the border, as in the 3DGS code, so that the figure compares with published ones.
double ssim(const Image& render, const Image& reference);

} // namespace nacre
