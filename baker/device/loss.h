// The image loss on the device: twin of ImageLoss and objectErrors (train/loss.h). Sums are doubles, added within blocks and over blocks in a
// fixed order.
#pragma once

#include "device/device.h"
#include "appearance/trainable.h"
#include "render/ssim_window.h"
#include "train/loss.h"
#include "train/loss_pixel.h"

#include <array>

namespace nacre::NACRE_BACKEND {

/// A PreparedImage on the device.
struct DeviceImage {
    const uint16_t *planes, *linear, *known; // known: null if all is known
    int width, height;
    size_t unknown;
};

namespace detail {

struct LossSums {
    double weighted, squared, masked, maskedCount, alpha, dissimilar;
};
constexpr uint32_t kLossSums = sizeof(LossSums) / sizeof(double);

struct LossImages {
    DeviceImage image[kMaxLightsPerStep];
    int count;
    uint32_t width, height;
    NACRE_DEVICE uint32_t pixels() const { return width * height; }
    NACRE_DEVICE bool isKnown(uint32_t light, uint32_t pixel) const { return !image[light].known || image[light].known[pixel] != 0; }
    /// The first image that knows the pixel, or count.
    NACRE_DEVICE uint32_t whoKnows(uint32_t pixel) const
    {
        uint32_t l = 0;
        while (l < uint32_t(count) && !isKnown(l, pixel)) ++l;
        return l;
    }
};

struct BlockSum {
    double warp[32];
};

/// The sum of `value` over a block, for thread 0.
NACRE_DEVICE inline double addBlock(const Thread& t, BlockSum& s, uint32_t warps, double value)
{
    for (uint32_t bit = kWarp / 2; bit > 0; bit /= 2) value += t.shuffleXor(kFullWarp, value, bit);
    t.sync(); // the last sum has been read
    if (t.lane() == 0) s.warp[t.warp()] = value;
    t.sync();
    double sum = 0;
    for (uint32_t w = 0; w < warps; ++w) sum += s.warp[w];
    return sum;
}

struct CoveredKernel {
    static constexpr uint32_t kThreads = 256;
    LossImages images;
    uint32_t* covered;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const uint32_t i = uint32_t(t.index());
        const uint32_t votes = t.ballot(kFullWarp, i < images.pixels() && images.whoKnows(i) < uint32_t(images.count));
        uint32_t count = 0;
        for (uint32_t bits = votes; bits; bits &= bits - 1) ++count;
        if (t.lane() == 0 && count) deviceAdd(covered, count);
    }
};

/// A thread a pixel of one channel; the blocks after those of the channels have the pixels of alpha. Floor: 4 bytes read, 4 written and 6 of the
/// reference, 8 more with SSIM; one power.
struct LossKernel {
    static constexpr uint32_t kThreads = 256;
    using Shared = BlockSum;
    LossImages images;
    const float* planes;
    const uint32_t* covered; // pixels that are known under any light; null: all
    float weight, alphaWeight;
    float *dPlanes, *encoded, *slope; // the last two may be null
    LossSums* sums; // [blocks]

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        BlockSum& s = t.shared<BlockSum>();
        const uint32_t pixels = images.pixels(), perPlane = (pixels + kThreads - 1) / kThreads;
        const uint32_t plane = t.block() / perPlane, i = t.block() % perPlane * kThreads + t.thread();
        const size_t at = size_t(plane) * pixels + i;
        LossSums own{};
        if (i < pixels) {
            if (plane < 3 * uint32_t(images.count)) channel(plane, i, at, own);
            else alpha(i, at, own);
        }
        LossSums total;
        total.weighted = addBlock(t, s, kThreads / kWarp, own.weighted), total.squared = addBlock(t, s, kThreads / kWarp, own.squared);
        total.masked = addBlock(t, s, kThreads / kWarp, own.masked), total.maskedCount = addBlock(t, s, kThreads / kWarp, own.maskedCount);
        total.alpha = addBlock(t, s, kThreads / kWarp, own.alpha), total.dissimilar = 0;
        if (t.thread() == 0) sums[t.block()] = total;
    }

private:
    NACRE_DEVICE void channel(uint32_t plane, uint32_t i, size_t at, LossSums& own) const
    {
        const DeviceImage& r = images.image[plane / 3];
        const size_t pixels = images.pixels(), from = size_t(plane % 3) * pixels + i;
        const bool known = images.isKnown(plane / 3, i), masked = r.planes[3 * pixels + i] > 32767;
        const PixelLoss p = pixelLoss(known ? planes[at] : 0.0f, r.linear[from]); // the reference is black where it is unknown: so is the render, then
        const float difference = p.encoded - float(r.planes[from]) * (1.0f / 65535.0f);
        dPlanes[at] = p.shown * p.slope * weight;
        if (encoded) encoded[at] = p.encoded, slope[at] = known ? p.slope : 0.0f;
        const float square = difference * difference;
        own.weighted = p.shown * p.shown, own.squared = square, own.masked = masked ? square : 0.0f, own.maskedCount = masked;
    }
    NACRE_DEVICE void alpha(uint32_t i, size_t at, LossSums& own) const
    {
        const uint32_t l = images.whoKnows(i);
        if (l == uint32_t(images.count)) {
            dPlanes[at] = 0.0f;
            return;
        }
        const uint32_t count = covered ? *covered : images.pixels();
        const float w = alphaWeight / float(count > 0 ? count : 1);
        const float difference = planes[at] - float(images.image[l].planes[3 * size_t(images.pixels()) + i]) / 65535.0f;
        dPlanes[at] = difference > 0 ? w : difference < 0 ? -w : 0.0f;
        own.alpha = std::abs(difference);
    }
};

constexpr uint32_t kSsimTile = 16, kSsimRegion = kSsimTile + 2 * kSsimRadius, kSsimTaps = 2 * kSsimRadius + 1;

struct SsimTaps {
    float w[kSsimTaps];
};

/// Where in its plane a block of 16 x 16 threads is.
struct SsimPlace {
    uint32_t plane, x0, y0, x, y;
    NACRE_DEVICE SsimPlace(const Thread& t, uint32_t width, uint32_t height)
    {
        const uint32_t across = (width + kSsimTile - 1) / kSsimTile, down = (height + kSsimTile - 1) / kSsimTile;
        const uint32_t tile = t.block() % (across * down);
        plane = t.block() / (across * down), x0 = tile % across * kSsimTile, y0 = tile / across * kSsimTile;
        x = t.thread() % kSsimTile, y = t.thread() / kSsimTile;
    }
};

/// SSIM per pixel and its derivatives with respect to the blurred moments. Floor: 6 bytes read and 12 written per value, 5 x 2 x 11 multiply-adds (the
/// rows between tiles are blurred twice: 26 of 16).
struct SsimKernel {
    static constexpr uint32_t kThreads = kSsimTile * kSsimTile;
    struct Shared {
        float a[kSsimRegion][kSsimRegion + 1], b[kSsimRegion][kSsimRegion + 1];
        float rows[5][kSsimRegion][kSsimTile];
        BlockSum sum;
    };
    LossImages images;
    SsimTaps taps;
    const float* encoded;
    float* derivatives; // [3][channels][height][width]
    LossSums* sums;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const uint32_t width = images.width, height = images.height, pixels = images.pixels();
        const SsimPlace at(t, width, height);
        const uint16_t* reference = images.image[at.plane / 3].planes + size_t(at.plane % 3) * pixels;
        for (uint32_t i = t.thread(); i < kSsimRegion * kSsimRegion; i += kThreads) {
            const uint32_t row = i / kSsimRegion, column = i % kSsimRegion;
            const uint32_t x = at.x0 + column - kSsimRadius, y = at.y0 + row - kSsimRadius; // below 0: beyond the size
            const bool in = x < width && y < height;
            s.a[row][column] = in ? encoded[size_t(at.plane) * pixels + y * width + x] : 0.0f;
            s.b[row][column] = in ? float(reference[y * width + x]) / 65535.0f : 0.0f;
        }
        t.sync();
        for (uint32_t i = t.thread(); i < kSsimRegion * kSsimTile; i += kThreads) {
            const uint32_t row = i / kSsimTile, column = i % kSsimTile;
            float m[5] = {};
            for (uint32_t k = 0; k < kSsimTaps; ++k) {
                const float a = s.a[row][column + k], b = s.b[row][column + k], w = taps.w[k];
                m[0] += w * a, m[1] += w * b, m[2] += w * (a * a), m[3] += w * (b * b), m[4] += w * (a * b);
            }
            for (uint32_t j = 0; j < 5; ++j) s.rows[j][row][column] = m[j];
        }
        t.sync();
        double dissimilar = 0;
        const uint32_t x = at.x0 + at.x, y = at.y0 + at.y;
        if (x < width && y < height) {
            float m[5] = {};
            for (uint32_t k = 0; k < kSsimTaps; ++k)
                for (uint32_t j = 0; j < 5; ++j) m[j] += taps.w[k] * s.rows[j][at.y + k][at.x];
            SsimPixel p{1.0f, 0.0f, 0.0f, 0.0f};
            if (images.isKnown(at.plane / 3, y * width + x)) p = ssimPixel(m[0], m[1], m[2], m[3], m[4]);
            dissimilar = 1.0 - double(p.ssim);
            const size_t to = size_t(at.plane) * pixels + y * width + x, size = size_t(3 * images.count) * pixels;
            derivatives[to] = p.dMa, derivatives[size + to] = p.dMaa, derivatives[2 * size + to] = p.dMab;
        }
        const double total = addBlock(t, s.sum, kThreads / kWarp, dissimilar);
        if (t.thread() == 0) sums[t.block()] = {0, 0, 0, 0, 0, total};
    }
};

/// The derivatives blurred back to the pixels. Floor: 22 bytes read and 8 of the gradient per value, 3 x 2 x 11 multiply-adds (26 rows of 16).
struct SsimBackwardKernel {
    static constexpr uint32_t kThreads = kSsimTile * kSsimTile;
    struct Shared {
        float d[3][kSsimRegion][kSsimRegion + 1], rows[3][kSsimRegion][kSsimTile];
    };
    LossImages images;
    SsimTaps taps;
    const float *encoded, *slope, *derivatives;
    float weight;
    float* dPlanes;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const uint32_t width = images.width, height = images.height, pixels = images.pixels();
        const SsimPlace at(t, width, height);
        const size_t size = size_t(3 * images.count) * pixels, plane = size_t(at.plane) * pixels;
        for (uint32_t i = t.thread(); i < kSsimRegion * kSsimRegion; i += kThreads) {
            const uint32_t row = i / kSsimRegion, column = i % kSsimRegion;
            const uint32_t x = at.x0 + column - kSsimRadius, y = at.y0 + row - kSsimRadius;
            const bool in = x < width && y < height;
            for (uint32_t j = 0; j < 3; ++j) s.d[j][row][column] = in ? derivatives[j * size + plane + y * width + x] : 0.0f;
        }
        t.sync();
        for (uint32_t i = t.thread(); i < kSsimRegion * kSsimTile; i += kThreads) {
            const uint32_t row = i / kSsimTile, column = i % kSsimTile;
            for (uint32_t j = 0; j < 3; ++j) {
                float sum = 0.0f;
                for (uint32_t k = 0; k < kSsimTaps; ++k) sum += taps.w[k] * s.d[j][row][column + k];
                s.rows[j][row][column] = sum;
            }
        }
        t.sync();
        const uint32_t x = at.x0 + at.x, y = at.y0 + at.y;
        if (x >= width || y >= height) return;
        float d[3] = {};
        for (uint32_t k = 0; k < kSsimTaps; ++k)
            for (uint32_t j = 0; j < 3; ++j) d[j] += taps.w[k] * s.rows[j][at.y + k][at.x];
        const size_t i = plane + y * width + x;
        const float b = float(images.image[at.plane / 3].planes[size_t(at.plane % 3) * pixels + y * width + x]) / 65535.0f;
        dPlanes[i] += weight * (d[0] + 2 * encoded[i] * d[1] + b * d[2]) * slope[i];
    }
};

/// Adds the sums of all blocks.
struct SumLossKernel {
    static constexpr uint32_t kThreads = 256;
    using Shared = BlockSum;
    const LossSums* sums;
    uint32_t count;
    LossSums* total;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        BlockSum& s = t.shared<BlockSum>();
        const double* from = reinterpret_cast<const double*>(sums);
        for (uint32_t k = 0; k < kLossSums; ++k) {
            double sum = 0;
            for (uint32_t i = t.thread(); i < count; i += kThreads) sum += from[size_t(i) * kLossSums + k];
            sum = addBlock(t, s, kThreads / kWarp, sum);
            if (t.thread() == 0) reinterpret_cast<double*>(total)[k] = sum;
        }
    }
};

/// Floor: 4 bytes and 4 of the reference per value.
struct ObjectErrorsKernel {
    static constexpr uint32_t kThreads = 256;
    LossImages images;
    const float* planes;
    float* errors;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t i = t.index(), pixels = images.pixels();
        if (i >= pixels) return;
        float sum = 0.0f;
        for (int plane = 0; plane < 3 * images.count; ++plane)
            sum += objectError(planes[size_t(plane) * pixels + i], images.image[plane / 3].planes, pixels, size_t(plane % 3), i);
        errors[i] = sum;
    }
};

inline LossImages lossImages(const DeviceImage* references, int count)
{
    LossImages images{};
    for (int l = 0; l < count; ++l) images.image[l] = references[l];
    images.count = count, images.width = uint32_t(references[0].width), images.height = uint32_t(references[0].height);
    return images;
}

} // namespace detail

/// As that of the CPU; errors: [height][width].
inline void objectErrors(Device& device, const float* planes, const DeviceImage* references, int imageCount, float* errors)
{
    const detail::ObjectErrorsKernel kernel{detail::lossImages(references, imageCount), planes, errors};
    launch(device, blocksFor(size_t(kernel.images.width) * kernel.images.height, kernel.kThreads), kernel);
}

class DeviceLoss {
public:
    /// planes, references, dPlanes: as ImageLoss::evaluate takes them.
    void run(Device& device, const float* planes, const DeviceImage* references, int imageCount, const LossOptions& options, float* dPlanes)
    {
        using namespace detail;
        const LossImages images = lossImages(references, imageCount);
        const uint32_t channels = 3 * uint32_t(imageCount);
        pixels_ = size_t(images.width) * images.height;
        known_ = size_t(imageCount) * pixels_;
        for (int l = 0; l < imageCount; ++l) known_ -= references[l].unknown;
        options_ = options;
        const bool ssim = options.dssim > 0;
        covered_.reserve(device, 1);
        counted_ = references[0].unknown > 0; // the first knows all: nothing to count
        if (counted_) {
            covered_.zero(device);
            launch(device, blocksFor(pixels_, CoveredKernel::kThreads), CoveredKernel{images, covered_.data()});
        }
        const uint32_t blocks = (channels + 1) * blocksFor(pixels_, LossKernel::kThreads);
        const uint32_t tiles = channels * blocksFor(images.width, kSsimTile) * blocksFor(images.height, kSsimTile), ssimBlocks = ssim ? tiles : 0;
        sums_.reserve(device, blocks + ssimBlocks), total_.reserve(device, 1);
        if (ssim) encoded_.reserve(device, channels * pixels_), slope_.reserve(device, channels * pixels_), derivatives_.reserve(device, 3 * channels * pixels_);
        launch(device, blocks, LossKernel{images, planes, counted_ ? covered_.data() : nullptr, weight(), options.alphaWeight, dPlanes,
                                          ssim ? encoded_.data() : nullptr, ssim ? slope_.data() : nullptr, sums_.data()});
        if (ssim) {
            SsimTaps taps;
            const auto window = ssimWindow();
            for (size_t k = 0; k < window.size(); ++k) taps.w[k] = float(window[k]);
            launch(device, ssimBlocks, SsimKernel{images, taps, encoded_.data(), derivatives_.data(), sums_.data() + blocks});
            launch(device, ssimBlocks, SsimBackwardKernel{images, taps, encoded_.data(), slope_.data(), derivatives_.data(), -options.dssim / float(samples()), dPlanes});
        }
        launch(device, 1, SumLossKernel{sums_.data(), blocks + ssimBlocks, total_.data()});
    }

    /// Of the last run; waits for it.
    LossStats stats(Device& device) const
    {
        std::array<detail::LossSums, 1> s;
        std::array<uint32_t, 1> covered{uint32_t(pixels_)};
        total_.download(device, s);
        if (counted_) covered_.download(device, covered);
        LossStats stats;
        stats.loss = 0.5 * weight() * s[0].weighted + options_.alphaWeight / float(std::max<uint32_t>(covered[0], 1)) * s[0].alpha;
        if (options_.dssim > 0) stats.loss += options_.dssim * s[0].dissimilar / double(samples());
        stats.squaredError = s[0].squared, stats.count = 3.0 * double(known_);
        stats.squaredErrorMasked = s[0].masked, stats.countMasked = s[0].maskedCount;
        return stats;
    }

private:
    size_t samples() const { return 3 * std::max<size_t>(known_, 1); }
    float weight() const { return (1.0f - options_.dssim) / (kLossScale * float(samples())); }

    LossOptions options_;
    size_t pixels_ = 0, known_ = 0; // known_: over all images
    bool counted_ = false;
    Buffer<uint32_t> covered_;
    Buffer<float> encoded_, slope_, derivatives_;
    Buffer<detail::LossSums> sums_, total_;
};

} // namespace nacre::NACRE_BACKEND
