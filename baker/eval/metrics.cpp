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

/// Whether anything is known of a pixel of the reference.
bool isKnown(const Image& reference, size_t pixel) { return !(reference.rgba[4 * pixel + 3] < 0); }

/// The image, black where nothing is known of the reference (which is black there).
Image whereKnown(const Image& image, const Image& reference)
{
    Image out = image;
    for (size_t i = 0; i < out.rgba.size(); i += 4)
        if (!isKnown(reference, i / 4)) std::fill_n(out.rgba.begin() + ptrdiff_t(i), 4, 0.0f);
    return out;
}

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

Plane lumaPlane(const Image& image)
{
    Plane luma(image.width, image.height);
    constexpr double kWeights[] = {0.2126, 0.7152, 0.0722};
    for (int c = 0; c < 3; ++c) {
        const Plane channel = displayPlane(image, c);
        for (size_t i = 0; i < luma.values.size(); ++i) luma.values[i] += kWeights[c] * channel.values[i];
    }
    return luma;
}

/// The largest value in the square around each pixel.
Plane largestNear(const Plane& in, int reach)
{
    const auto along = [&](const Plane& p, int dx, int dy) {
        Plane out(p.width, p.height);
        for (int y = 0; y < p.height; ++y)
            for (int x = 0; x < p.width; ++x) {
                double most = 0;
                for (int k = -reach; k <= reach; ++k) {
                    const int u = std::clamp(x + k * dx, 0, p.width - 1), v = std::clamp(y + k * dy, 0, p.height - 1);
                    most = std::max(most, p.values[size_t(v) * size_t(p.width) + size_t(u)]);
                }
                out.values[size_t(y) * size_t(p.width) + size_t(x)] = most;
            }
        return out;
    };
    return along(along(in, 1, 0), 0, 1);
}

void measureHighlights(const Image& render, const Image& reference, ImageMetrics& metrics)
{
    const Plane luma = lumaPlane(render);
    Plane referenceLuma = lumaPlane(reference);
    for (size_t i = 0; i < referenceLuma.values.size(); ++i)
        if (!isKnown(reference, i)) referenceLuma.values[i] = 1; // for its neighbours: may be a highlight
    const Plane near = largestNear(luma, kHighlightReach), referenceNear = largestNear(referenceLuma, kHighlightReach);
    size_t object = 0, missing = 0, invented = 0;
    for (size_t i = 0; i < luma.values.size(); ++i) {
        if (!(reference.rgba[4 * i + 3] > 0.5f)) continue; // nor what is not known
        ++object;
        missing += referenceLuma.values[i] > near.values[i] + kHighlightStep;
        invented += luma.values[i] > referenceNear.values[i] + kHighlightStep;
        if (!(referenceLuma.values[i] > kHighlightLuma)) continue;
        for (size_t c = 0; c < 3; ++c) {
            const auto display = [&](const Image& image) { return double(srgbFromLinear(std::clamp(image.rgba[4 * i + c], 0.0f, 1.0f))); };
            const double difference = display(render) - display(reference);
            metrics.highlightSquared += difference * difference, metrics.highlightSamples += 1;
        }
    }
    metrics.highlightMissing = double(missing) / double(std::max<size_t>(object, 1));
    metrics.highlightFalse = double(invented) / double(std::max<size_t>(object, 1));
}

/// Sum over the known pixels of one channel.
double ssimSum(const Plane& a, const Plane& b, const Image& reference)
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
        if (!isKnown(reference, i)) continue;
        const double ma = meanA.values[i], mb = meanB.values[i];
        const double varA = meanAA.values[i] - ma * ma, varB = meanBB.values[i] - mb * mb;
        const double cov = meanAB.values[i] - ma * mb;
        sum += (2 * ma * mb + kSsimC1) * (2 * cov + kSsimC2) / ((ma * ma + mb * mb + kSsimC1) * (varA + varB + kSsimC2));
    }
    return sum;
}

struct Sums {
    double squared = 0, relative = 0;
    size_t samples = 0;
};
struct ErrorSums {
    Sums whole, masked; // the latter the former if the reference shows nothing
};

ErrorSums sumErrors(const Image& render, const Image& reference)
{
    ErrorSums sums;
    const size_t pixels = size_t(render.width) * size_t(render.height);
    for (size_t i = 0; i < pixels; ++i) {
        if (!isKnown(reference, i)) continue;
        double squared = 0, relative = 0;
        for (size_t c = 0; c < 3; ++c) {
            const float a = render.rgba[4 * i + c], b = reference.rgba[4 * i + c];
            const double display = double(srgbFromLinear(std::clamp(a, 0.0f, 1.0f))) - srgbFromLinear(std::clamp(b, 0.0f, 1.0f));
            const double linear = double(a) - b;
            squared += display * display;
            relative += linear * linear / (double(b) * b + 0.01);
        }
        const auto add = [&](Sums& s) {
            s.squared += squared;
            s.relative += relative;
            s.samples += 3;
        };
        add(sums.whole);
        if (reference.rgba[4 * i + 3] > 0.5f) add(sums.masked);
    }
    if (sums.masked.samples == 0) sums.masked = sums.whole;
    return sums;
}

bool sameSizes(const Image& a, const Image& b)
{
    const bool same = a.width == b.width && a.height == b.height && a.width > 0 && a.height > 0 && a.rgba.size() == b.rgba.size();
    assert(same);
    return same;
}

} // namespace

double ssim(const Image& render, const Image& reference)
{
    double sum = 0;
    size_t known = 0;
    for (size_t i = 0; i < reference.rgba.size() / 4; ++i) known += isKnown(reference, i);
    const Image a = whereKnown(render, reference), b = whereKnown(reference, reference);
    for (int c = 0; c < 3; ++c) sum += ssimSum(displayPlane(a, c), displayPlane(b, c), reference);
    return known ? sum / (3.0 * double(known)) : 1.0;
}

ImageMetrics compareImages(const Image& render, const Image& reference)
{
    if (!sameSizes(render, reference)) {
        constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
        return {kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan};
    }

    const auto [whole, masked] = sumErrors(render, reference);
    ImageMetrics metrics;
    metrics.psnr = psnrOf(whole.squared, whole.samples);
    metrics.psnrMasked = psnrOf(masked.squared, masked.samples);
    metrics.ssim = ssim(render, reference);
    metrics.flip = meanFlip(render, reference);
    metrics.relMseLinear = masked.relative / double(masked.samples);
    measureHighlights(render, reference, metrics);
    return metrics;
}

double psnrMaskedOf(const Image& render, const Image& reference)
{
    if (!sameSizes(render, reference)) return std::numeric_limits<double>::quiet_NaN();
    const Sums masked = sumErrors(render, reference).masked;
    return psnrOf(masked.squared, masked.samples);
}

double highlightPsnr(const ImageMetrics& sums)
{
    return sums.highlightSamples > 0 ? psnrOf(sums.highlightSquared, size_t(std::lround(sums.highlightSamples))) : std::numeric_limits<double>::quiet_NaN();
}

} // namespace nacre
