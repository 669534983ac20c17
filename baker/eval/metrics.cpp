// PSNR, SSIM and relative squared error; FLIP is in flip.cpp. Definitions: metrics.h.
#include "eval/metrics.h"

#include "base/color.h"
#include "eval/flip.h"
#include "eval/plane_filter.h"
#include "render/ssim_window.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace nacre {
namespace {

/// Γ of one colour channel as a plane.
Plane displayPlane(const Image& image, int channel)
{
    Plane plane(image.width, image.height);
    for (size_t i = 0; i < plane.values.size(); ++i)
        plane.values[i] = srgbFromLinear(std::clamp(image.rgba[4 * i + size_t(channel)], 0.0f, 1.0f));
    return plane;
}

double psnrOf(double squaredError, size_t samples)
{
    const double mse = squaredError / double(samples);
    return mse > 0 ? std::min(kMaxPsnr, -10.0 * std::log10(mse)) : (mse == 0 ? kMaxPsnr : mse); // NaN stays NaN
}

/// Sum over the pixels of one channel.
double ssimSum(const Plane& a, const Plane& b)
{
    static const auto weights = ssimWindow();
    static const std::vector<double> window(weights.begin(), weights.end());
    const auto blur = [](const Plane& p) { return filterSeparable(p, window, window, Border::kZero); };
    const auto blurProduct = [&](const Plane& p, const Plane& q) {
        Plane product(p.width, p.height);
        for (size_t i = 0; i < product.values.size(); ++i) product.values[i] = p.values[i] * q.values[i];
        return blur(product);
    };
    const Plane meanA = blur(a), meanB = blur(b);
    const Plane meanAA = blurProduct(a, a), meanBB = blurProduct(b, b), meanAB = blurProduct(a, b);
    double sum = 0;
    for (size_t i = 0; i < a.values.size(); ++i) {
        const double ma = meanA.values[i], mb = meanB.values[i];
        const double varA = meanAA.values[i] - ma * ma, varB = meanBB.values[i] - mb * mb;
        const double cov = meanAB.values[i] - ma * mb;
        sum += (2 * ma * mb + kSsimC1) * (2 * cov + kSsimC2) / ((ma * ma + mb * mb + kSsimC1) * (varA + varB + kSsimC2));
    }
    return sum;
}

} // namespace

double ssim(const Image& a, const Image& b)
{
    double sum = 0;
    for (int c = 0; c < 3; ++c) sum += ssimSum(displayPlane(a, c), displayPlane(b, c));
    return sum / (3.0 * a.width * a.height);
}

ImageMetrics compareImages(const Image& render, const Image& reference)
{
    const bool sameSize = render.width == reference.width && render.height == reference.height && render.width > 0 &&
                          render.height > 0 && render.rgba.size() == reference.rgba.size();
    assert(sameSize);
    if (!sameSize) {
        constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
        return {kNan, kNan, kNan, kNan, kNan};
    }

    struct Sums {
        double squared = 0, relative = 0;
        size_t samples = 0;
    } whole, masked;
    const size_t pixels = size_t(render.width) * size_t(render.height);
    for (size_t i = 0; i < pixels; ++i) {
        double squared = 0, relative = 0;
        for (size_t c = 0; c < 3; ++c) {
            const float a = render.rgba[4 * i + c], b = reference.rgba[4 * i + c];
            const double display = double(srgbFromLinear(std::clamp(a, 0.0f, 1.0f))) - srgbFromLinear(std::clamp(b, 0.0f, 1.0f));
            const double linear = double(a) - b;
            squared += display * display;
            relative += linear * linear / (double(b) * b + 0.01);
        }
        const auto add = [&](Sums& sums) {
            sums.squared += squared;
            sums.relative += relative;
            sums.samples += 3;
        };
        add(whole);
        if (reference.rgba[4 * i + 3] > 0.5f) add(masked);
    }
    if (masked.samples == 0) masked = whole;

    ImageMetrics metrics;
    metrics.psnr = psnrOf(whole.squared, whole.samples);
    metrics.psnrMasked = psnrOf(masked.squared, masked.samples);
    metrics.ssim = ssim(render, reference);
    metrics.flip = meanFlip(render, reference);
    metrics.relMseLinear = masked.relative / double(masked.samples);
    return metrics;
}

} // namespace nacre
