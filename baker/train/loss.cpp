// Rows of each plane are processed with SIMD; partial sums per row are added in row order.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "train/loss.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "render/simd_math-inl.h"
#include "render/ssim_window.h"
#include "train/loss.h"

#include <cmath>

#ifndef NACRE_LOSS_SHARED
#define NACRE_LOSS_SHARED
namespace nacre {

constexpr int kRadius = kSsimRadius, kTaps = 2 * kRadius + 1;

struct RowSums { double weighted = 0, squared = 0, masked = 0, maskedCount = 0; };

struct RowTask {
    const float* render;       // one row of one channel, linear
    const uint16_t* reference; // encoded
    const uint16_t* radiance;  // reference, half floats
    const uint16_t* mask;      // reference alpha
    const uint16_t* known;     // may be null: all is known
    float* gradient;
    float* encoded;            // may be null
    float* slope;
    int width;
    float weight;              // of the weighted squares in the gradient
};

struct Taps {
    float w[kTaps];
    Taps()
    {
        const auto window = ssimWindow();
        for (size_t i = 0; i < window.size(); ++i) w[i] = float(window[i]);
    }
};
static const Taps kGaussian;

} // namespace nacre
#endif

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

void lossRow(const RowTask& t, RowSums& sums)
{
    const D d;
    const hn::Rebind<uint16_t, D> d16;
    const hn::RebindToSigned<D> di;
    const size_t n = hn::Lanes(d);
    HWY_ALIGN float tail[3][hn::MaxLanes(D())];
    HWY_ALIGN uint16_t tail16[4][hn::MaxLanes(D())];
    V weighted = hn::Zero(d), squared = hn::Zero(d), masked = hn::Zero(d), maskedCount = hn::Zero(d);
    const V unorm = hn::Set(d, 1.0f / 65535.0f);
    for (int x = 0; x < t.width; x += int(n)) {
        const bool whole = x + int(n) <= t.width;
        const int left = whole ? int(n) : t.width - x;
        if (!whole) {
            for (size_t i = 0; i < n; ++i) { // pixels beyond the row equal their reference
                const bool in = int(i) < left;
                tail16[3][i] = in && t.known ? t.known[x + i] : 0;
                tail[0][i] = in ? t.render[x + i] : 0.0f, tail16[0][i] = in ? t.reference[x + i] : 0, tail16[1][i] = in ? t.mask[x + i] : 0, tail16[2][i] = in ? t.radiance[x + i] : 0;
            }
        }
        V loaded = whole ? hn::LoadU(d, t.render + x) : hn::Load(d, tail[0]);
        auto known = hn::FirstN(d, n);
        if (t.known) { // the reference is black where it is unknown: so is the render, then
            const auto known16 = whole ? hn::LoadU(d16, t.known + x) : hn::Load(d16, tail16[3]);
            known = hn::RebindMask(d, hn::Ne(hn::PromoteTo(di, known16), hn::Zero(di)));
            loaded = hn::IfThenElseZero(known, loaded);
        }
        const V linear = hn::IfThenElse(hn::Gt(loaded, hn::Set(d, 1.0f)), hn::Set(d, 1.0f), loaded); // lets NaN through
        const auto ref16 = whole ? hn::LoadU(d16, t.reference + x) : hn::Load(d16, tail16[0]);
        const auto mask16 = whole ? hn::LoadU(d16, t.mask + x) : hn::Load(d16, tail16[1]);
        const auto radiance16 = whole ? hn::LoadU(d16, t.radiance + x) : hn::Load(d16, tail16[2]);
        const V alpha = hn::Mul(hn::ConvertTo(d, hn::PromoteTo(di, mask16)), unorm);
        const auto in = hn::Gt(alpha, hn::Set(d, 0.5f));
        maskedCount = hn::Add(maskedCount, hn::IfThenElseZero(in, hn::Set(d, 1.0f)));
        // Most of an image is background, black in both.
        if (whole && hn::AllTrue(d, hn::Eq(loaded, hn::Zero(d))) && hn::AllTrue(d16, hn::Eq(hn::Or(ref16, radiance16), hn::Zero(d16)))) {
            hn::StoreU(hn::Zero(d), d, t.gradient + x);
            if (t.encoded) hn::StoreU(hn::Zero(d), d, t.encoded + x), hn::StoreU(hn::IfThenElseZero(known, hn::Set(d, 12.92f)), d, t.slope + x);
            continue;
        }
        const V reference = hn::Mul(hn::ConvertTo(d, hn::PromoteTo(di, ref16)), unorm);

        // sRGB: 12.92 x below 0.0031308, else 1.055 x^(1/2.4) - 0.055
        const V safe = hn::Max(linear, hn::Set(d, 0.0031308f));
        const V power = hn::Mul(hn::Set(d, 1.055f), exp2(d, hn::Mul(log2(d, safe), hn::Set(d, 1.0f / 2.4f))));
        const auto low = hn::Le(linear, hn::Set(d, 0.0031308f));
        const V value = hn::IfThenElse(hn::IsNaN(linear), linear, hn::IfThenElse(low, hn::Mul(linear, hn::Set(d, 12.92f)), hn::Sub(power, hn::Set(d, 0.055f))));
        const V slope = hn::IfThenElse(low, hn::Set(d, 12.92f), hn::Div(power, hn::Mul(safe, hn::Set(d, 2.4f))));

        const V difference = hn::Sub(value, reference);
        const auto half = hn::BitCast(hn::Rebind<hwy::float16_t, D>(), radiance16);
        const V shown = hn::Mul(hn::Sub(linear, hn::PromoteTo(d, half)), slope);
        const V gradient = hn::Mul(hn::Mul(shown, slope), hn::Set(d, t.weight));
        const V square = hn::Mul(difference, difference);
        weighted = hn::MulAdd(shown, shown, weighted);
        squared = hn::Add(squared, square);
        masked = hn::Add(masked, hn::IfThenElseZero(in, square));
        if (whole) {
            hn::StoreU(gradient, d, t.gradient + x);
            if (t.encoded) hn::StoreU(value, d, t.encoded + x), hn::StoreU(hn::IfThenElseZero(known, slope), d, t.slope + x);
        } else {
            hn::Store(gradient, d, tail[0]), hn::Store(value, d, tail[1]), hn::Store(hn::IfThenElseZero(known, slope), d, tail[2]);
            for (int i = 0; i < left; ++i) {
                t.gradient[x + i] = tail[0][i];
                if (t.encoded) t.encoded[x + i] = tail[1][i], t.slope[x + i] = tail[2][i];
            }
        }
    }
    sums.weighted = hn::GetLane(hn::SumOfLanes(d, weighted));
    sums.squared = hn::GetLane(hn::SumOfLanes(d, squared));
    sums.masked = hn::GetLane(hn::SumOfLanes(d, masked));
    sums.maskedCount = hn::GetLane(hn::SumOfLanes(d, maskedCount));
}

// out = Gaussian blur of in (zero outside), separable; scratch holds one plane.
void blurPlane(const float* in, int width, int height, float* scratch, float* out)
{
    const D d;
    const int n = int(hn::Lanes(d));
    for (int y = 0; y < height; ++y) {
        const float* row = in + size_t(y) * width;
        float* to = scratch + size_t(y) * width;
        const auto scalar = [&](int x) {
            float sum = 0;
            for (int k = 0; k < kTaps; ++k) {
                const int i = x + k - kRadius;
                if (i >= 0 && i < width) sum += kGaussian.w[k] * row[i];
            }
            to[x] = sum;
        };
        int x = 0;
        for (; x < kRadius && x < width; ++x) scalar(x);
        for (; x + n + kRadius <= width; x += n) {
            V sum = hn::Zero(d);
            for (int k = 0; k < kTaps; ++k) sum = hn::MulAdd(hn::Set(d, kGaussian.w[k]), hn::LoadU(d, row + x + k - kRadius), sum);
            hn::StoreU(sum, d, to + x);
        }
        for (; x < width; ++x) scalar(x);
    }
    for (int y = 0; y < height; ++y) {
        float* to = out + size_t(y) * width;
        for (int x = 0; x < width; ++x) to[x] = 0;
        for (int k = 0; k < kTaps; ++k) {
            const int i = y + k - kRadius;
            if (i < 0 || i >= height) continue;
            const float* row = scratch + size_t(i) * width;
            int x = 0;
            for (; x + n <= width; x += n)
                hn::StoreU(hn::MulAdd(hn::Set(d, kGaussian.w[k]), hn::LoadU(d, row + x), hn::LoadU(d, to + x)), d, to + x);
            for (; x < width; ++x) to[x] += kGaussian.w[k] * row[x];
        }
    }
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include "base/color.h"
#include "base/half.h"
#include "train/display_code.h"
#include "train/loss_pixel.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace nacre {

HWY_EXPORT(lossRow);
HWY_EXPORT(blurPlane);

PreparedImage prepareImage(const Image& linear)
{
    PreparedImage p;
    p.width = linear.width, p.height = linear.height;
    const size_t pixels = size_t(p.width) * p.height;
    p.planes.resize(4 * pixels), p.linear.resize(3 * pixels);
    const DisplayCodes& codes = DisplayCodes::table();
    for (size_t i = 0; i < pixels; ++i) {
        if (linear.rgba[4 * i + 3] < 0) {
            if (p.unknown++ == 0) p.known.assign(pixels, 65535);
            p.known[i] = 0;
            continue;
        }
        for (int c = 0; c < 3; ++c) {
            const float x = std::clamp(linear.rgba[4 * i + c], 0.0f, 1.0f);
            p.planes[c * pixels + i] = codes(x);
            p.linear[c * pixels + i] = halfFromFloat(x);
        }
        p.planes[3 * pixels + i] = uint16_t(std::lround(65535.0f * std::clamp(linear.rgba[4 * i + 3], 0.0f, 1.0f)));
    }
    return p;
}

void objectErrors(const float* planes, const PreparedImage* const* references, int imageCount, float* errors)
{
    const size_t width = size_t(references[0]->width), pixels = width * size_t(references[0]->height);
    tbb::parallel_for(size_t(0), pixels / width, [&](size_t y) {
        for (size_t i = y * width; i < (y + 1) * width; ++i) {
            errors[i] = 0;
            for (int plane = 0; plane < 3 * imageCount; ++plane) {
                errors[i] += objectError(planes[size_t(plane) * pixels + i], references[plane / 3]->planes.data(), pixels, size_t(plane % 3), i);
            }
        }
    });
}

LossStats ImageLoss::evaluate(const float* planes, const PreparedImage* const* references, int imageCount, const LossOptions& options,
                              float* dPlanes)
{
    const int width = references[0]->width, height = references[0]->height;
    const size_t pixels = size_t(width) * height;
    const int channels = 3 * imageCount;
    const bool ssim = options.dssim > 0;
    if (ssim) encoded_.resize(channels * pixels), slope_.resize(channels * pixels);
    size_t known = size_t(imageCount) * pixels; // over all images
    for (int l = 0; l < imageCount; ++l) known -= references[l]->unknown;
    const size_t samples = 3 * std::max<size_t>(known, 1);
    const float weight = (1.0f - options.dssim) / (kLossScale * float(samples));
    const auto run = HWY_DYNAMIC_DISPATCH(lossRow);

    std::vector<RowSums> rows(size_t(channels) * height);
    tbb::parallel_for(size_t(0), rows.size(), [&](size_t r) {
        const size_t plane = r / height, y = r % height, image = plane / 3, c = plane % 3, at = plane * pixels + y * width;
        run({planes + at, references[image]->planes.data() + c * pixels + y * width, references[image]->linear.data() + c * pixels + y * width,
             references[image]->planes.data() + 3 * pixels + y * width, references[image]->unknown ? references[image]->known.data() + y * width : nullptr,
             dPlanes + at, ssim ? encoded_.data() + at : nullptr, ssim ? slope_.data() + at : nullptr, width, weight},
            rows[r]);
    });

    // The views' coverage is one plane; the references' alphas of one view agree, so the first that knows it stands for all.
    std::vector<double> alphaRows(height);
    const auto whoKnows = [&](size_t pixel) {
        int l = 0;
        while (l < imageCount && !references[l]->isKnown(pixel)) ++l;
        return l;
    };
    size_t covered = pixels;
    if (references[0]->unknown > 0) {
        covered = 0;
        for (size_t i = 0; i < pixels; ++i) covered += whoKnows(i) < imageCount;
    }
    const float alphaWeight = options.alphaWeight / float(std::max<size_t>(covered, 1));
    tbb::parallel_for(0, height, [&](int y) {
        double sum = 0;
        for (int x = 0; x < width; ++x) {
            const size_t i = size_t(y) * width + x;
            const int l = whoKnows(i);
            if (l == imageCount) {
                dPlanes[channels * pixels + i] = 0;
                continue;
            }
            const float difference = planes[channels * pixels + i] - float(references[l]->planes[3 * pixels + i]) / 65535.0f;
            dPlanes[channels * pixels + i] = difference > 0 ? alphaWeight : difference < 0 ? -alphaWeight : 0.0f;
            sum += std::abs(difference);
        }
        alphaRows[y] = sum;
    });

    LossStats stats;
    for (const RowSums& r : rows) {
        stats.loss += 0.5 * weight * r.weighted;
        stats.squaredError += r.squared;
        stats.squaredErrorMasked += r.masked, stats.countMasked += r.maskedCount;
    }
    stats.count = 3.0 * double(known);
    for (double a : alphaRows) stats.loss += alphaWeight * a;
    if (ssim) addDssim(references, imageCount, samples, options.dssim, dPlanes, &stats.loss);
    return stats;
}

// SSIM per plane: with blurred means m, n, second moments, the derivative with respect to each moment is blurred back to the pixels.
// Unknown pixels are black in both and have no slope. `samples`: values that are known.
void ImageLoss::addDssim(const PreparedImage* const* references, int imageCount, size_t samples, float lambda, float* dPlanes, double* loss)
{
    const int width = references[0]->width, height = references[0]->height, channels = 3 * imageCount;
    const size_t pixels = size_t(width) * height;
    blurred_.resize(channels * pixels * 5), scratch_.resize(channels * pixels * 3);
    const auto blur = HWY_DYNAMIC_DISPATCH(blurPlane);
    std::vector<double> sums(channels);
    tbb::parallel_for(0, channels, [&](int p) {
        const float* a = encoded_.data() + p * pixels;
        float* moments = blurred_.data() + size_t(p) * pixels * 5;
        float *b = scratch_.data() + size_t(p) * pixels * 3, *product = b + pixels, *temp = product + pixels;
        const uint16_t* reference = references[p / 3]->planes.data() + (p % 3) * pixels;
        for (size_t i = 0; i < pixels; ++i) b[i] = float(reference[i]) / 65535.0f;
        float *ma = moments, *mb = ma + pixels, *maa = mb + pixels, *mbb = maa + pixels, *mab = mbb + pixels;
        blur(a, width, height, temp, ma);
        blur(b, width, height, temp, mb);
        for (size_t i = 0; i < pixels; ++i) product[i] = a[i] * a[i];
        blur(product, width, height, temp, maa);
        for (size_t i = 0; i < pixels; ++i) product[i] = b[i] * b[i];
        blur(product, width, height, temp, mbb);
        for (size_t i = 0; i < pixels; ++i) product[i] = a[i] * b[i];
        blur(product, width, height, temp, mab);

        double sum = 0;
        for (size_t i = 0; i < pixels; ++i) { // gradient of SSIM with respect to ma, maa, mab, in place
            if (!references[p / 3]->isKnown(i)) {
                ma[i] = maa[i] = mab[i] = 0;
                continue;
            }
            const SsimPixel at = ssimPixel(ma[i], mb[i], maa[i], mbb[i], mab[i]);
            sum += 1.0 - double(at.ssim);
            ma[i] = at.dMa, maa[i] = at.dMaa, mab[i] = at.dMab;
        }
        sums[p] = sum;
        blur(ma, width, height, temp, product);
        blur(maa, width, height, temp, mbb);
        blur(mab, width, height, temp, mb);
        const float weight = -lambda / float(samples);
        for (size_t i = 0; i < pixels; ++i)
            dPlanes[p * pixels + i] += weight * (product[i] + 2 * a[i] * mbb[i] + b[i] * mb[i]) * slope_[p * pixels + i];
    });
    double sum = 0;
    for (double s : sums) sum += s;
    *loss += lambda * sum / double(samples);
}

} // namespace nacre
#endif
