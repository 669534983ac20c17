// The image loss: exact values, gradient against finite differences, and the SSIM part against the metric.
#include "base/color.h"
#include "eval/metrics.h"
#include "train/loss.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <random>

using namespace nacre;

namespace {

Image randomImage(int width, int height, uint64_t seed, float alpha)
{
    std::mt19937_64 rng(seed);
    std::uniform_real_distribution<float> u(0, 1);
    Image image{width, height, std::vector<float>(size_t(4) * width * height)};
    for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] = i % 4 == 3 ? alpha : u(rng) * u(rng);
    return image;
}

std::vector<float> planesOf(const std::vector<Image>& images, float alpha)
{
    const size_t pixels = size_t(images[0].width) * images[0].height;
    std::vector<float> planes(pixels * (3 * images.size() + 1), alpha);
    for (size_t k = 0; k < images.size(); ++k)
        for (size_t i = 0; i < pixels; ++i)
            for (int c = 0; c < 3; ++c) planes[(3 * k + c) * pixels + i] = images[k].rgba[4 * i + c];
    return planes;
}

void makeUnknown(Image& image, size_t pixel)
{
    std::fill_n(image.rgba.begin() + ptrdiff_t(4 * pixel), 3, 0.0f);
    image.rgba[4 * pixel + 3] = kUnknownAlpha;
}

} // namespace

TEST_CASE("loss, its gradient and errors equal their definition, also for widths that do not fill a vector")
{
    for (auto [w, h] : {std::pair{16, 8}, {13, 7}, {3, 2}}) {
        const std::vector<Image> render = {randomImage(w, h, 1, 1), randomImage(w, h, 2, 1)};
        const Image ref[2] = {randomImage(w, h, 3, 1), randomImage(w, h, 4, 0.2f)};
        const PreparedImage prepared[2] = {prepareImage(ref[0]), prepareImage(ref[1])};
        const PreparedImage* references[2] = {&prepared[0], &prepared[1]};
        const std::vector<float> planes = planesOf(render, 0.75f);
        std::vector<float> gradient(planes.size());
        const LossStats stats = ImageLoss().evaluate(planes.data(), references, 2, {0.0f, 0.5f}, gradient.data());
        double weighted = 0, squared = 0, masked = 0;
        for (int k = 0; k < 2; ++k)
            for (size_t i = 0; i < render[k].rgba.size(); ++i) {
                if (i % 4 == 3) continue;
                const double d = srgbFromLinear(double(render[k].rgba[i])) - srgbFromLinear(double(ref[k].rgba[i]));
                const double x = render[k].rgba[i], r = ref[k].rgba[i];
                const double slope = x <= 0.0031308 ? 12.92 : 1.055 / 2.4 * std::pow(x, 1 / 2.4 - 1), shown = (x - r) * slope;
                weighted += shown * shown;
                const size_t pixels = size_t(w) * size_t(h), at = (3 * size_t(k) + i % 4) * pixels + i / 4;
                const double expected = shown * slope / (kLossScale * 6.0 * double(pixels));
                CHECK(std::abs(gradient[at] - expected) < 2e-3 * slope * slope / (kLossScale * 6.0 * double(pixels))); // half-float references
                squared += d * d;
                if (k == 0) masked += d * d;
            }
        const double count = 6.0 * w * h;
        CHECK(stats.count == count);
        CHECK(stats.loss == doctest::Approx(weighted / (2 * kLossScale * count) + 0.5 * 0.25).epsilon(1e-3)); // half-float references
        CHECK(stats.squaredError == doctest::Approx(squared).epsilon(1e-4));
        CHECK(stats.squaredErrorMasked == doctest::Approx(masked).epsilon(1e-4));
        CHECK(stats.countMasked == count / 2);
    }
}

TEST_CASE("gradient of the SSIM part matches finite differences")
{
    const int w = 19, h = 14;
    std::vector<Image> render = {randomImage(w, h, 5, 1)};
    const Image ref = randomImage(w, h, 6, 1);
    const PreparedImage prepared = prepareImage(ref);
    const PreparedImage* references[1] = {&prepared};
    std::vector<float> planes = planesOf(render, 0.6f), gradient(planes.size()), unused(planes.size());
    for (float dssim : {1.0f}) {
        ImageLoss loss;
        const LossOptions options{dssim, 0.1f};
        loss.evaluate(planes.data(), references, 1, options, gradient.data());
        double scale = 0;
        for (float g : gradient) scale = std::max(scale, double(std::abs(g)));
        for (size_t i = 0; i < planes.size(); i += 7) {
            const float x = planes[i], step = 2e-3f * (x + 0.05f);
            planes[i] = x + step;
            const double hi = loss.evaluate(planes.data(), references, 1, options, unused.data()).loss;
            planes[i] = x - step;
            const double lo = loss.evaluate(planes.data(), references, 1, options, unused.data()).loss;
            planes[i] = x;
            CAPTURE(dssim);
            CAPTURE(i);
            CHECK(std::abs((hi - lo) / (2 * step) - gradient[i]) < 0.02 * std::abs(gradient[i]) + 0.01 * scale); // f32 loss, finite step
        }
    }
}

TEST_CASE("unknown pixels have no part in any figure and no gradient; that of the pixels beside them is right")
{
    constexpr int w = 21, h = 12;
    constexpr size_t pixels = size_t(w) * h;
    const auto unknown = [&](size_t image, size_t i) { return image == 0 ? i % 5 == 2 : i % 3 == 0 || i < 40; };
    Image ref[2] = {randomImage(w, h, 11, 0.8f), randomImage(w, h, 12, 0.8f)};
    size_t known = 2 * pixels;
    for (size_t k = 0; k < 2; ++k)
        for (size_t i = 0; i < pixels; ++i)
            if (unknown(k, i)) makeUnknown(ref[k], i), --known;
    const PreparedImage prepared[2] = {prepareImage(ref[0]), prepareImage(ref[1])};
    const PreparedImage* references[2] = {&prepared[0], &prepared[1]};
    std::vector<float> planes = planesOf({randomImage(w, h, 9, 1), randomImage(w, h, 10, 1)}, 0.6f), changed = planes;
    for (size_t i = 0; i < pixels; ++i) {
        for (size_t c = 0; c < 6; ++c)
            if (unknown(c / 3, i)) changed[c * pixels + i] += 0.5f;
        if (unknown(0, i) && unknown(1, i)) changed[6 * pixels + i] = 0.1f;
    }
    std::vector<float> gradient(planes.size()), other(planes.size()), errors(pixels), otherErrors(pixels);
    for (float dssim : {0.0f, 0.5f, 1.0f}) {
        CAPTURE(dssim);
        ImageLoss loss;
        const LossOptions options{dssim, 0.1f};
        const LossStats stats = loss.evaluate(planes.data(), references, 2, options, gradient.data());
        const LossStats same = loss.evaluate(changed.data(), references, 2, options, other.data());
        CHECK(stats.count == 3.0 * double(known));
        CHECK(stats.countMasked == stats.count);
        CHECK(same.loss == stats.loss);
        CHECK(same.squaredErrorMasked == stats.squaredErrorMasked);
        CHECK(other == gradient);
        for (size_t i = 0; i < pixels; ++i)
            if (unknown(1, i)) CHECK(gradient[4 * pixels + i] == 0);
    }
    objectErrors(planes.data(), references, 2, errors.data()), objectErrors(changed.data(), references, 2, otherErrors.data());
    CHECK(errors == otherErrors);

    ImageLoss loss; // gradient still that of the SSIM part and of alpha: in the squared part the slope of the display is held constant
    double scale = 0;
    for (float g : gradient) scale = std::max(scale, double(std::abs(g)));
    for (size_t i = 0; i < planes.size(); i += 5) {
        const float x = planes[i], step = 2e-3f * (x + 0.05f);
        planes[i] = x + step;
        const double hi = loss.evaluate(planes.data(), references, 2, {1.0f, 0.1f}, other.data()).loss;
        planes[i] = x - step;
        const double lo = loss.evaluate(planes.data(), references, 2, {1.0f, 0.1f}, other.data()).loss;
        planes[i] = x;
        CAPTURE(i);
        CHECK(std::abs((hi - lo) / (2 * step) - gradient[i]) < 0.02 * std::abs(gradient[i]) + 0.01 * scale);
    }
}

TEST_CASE("1 - SSIM of the loss is the metric's SSIM, also beside unknown pixels")
{
    const Image a = randomImage(40, 33, 7, 1);
    Image b = randomImage(40, 33, 8, 1);
    SUBCASE("all known") {}
    SUBCASE("some unknown")
    {
        for (size_t i = 0; i < 40 * 33; i += 3) makeUnknown(b, i);
    }
    const PreparedImage prepared = prepareImage(b);
    const PreparedImage* references[1] = {&prepared};
    std::vector<float> planes = planesOf({a}, 1.0f), gradient(planes.size());
    const double loss = ImageLoss().evaluate(planes.data(), references, 1, {1.0f, 0.0f}, gradient.data()).loss;
    CHECK(1 - loss == doctest::Approx(compareImages(a, b).ssim).epsilon(1e-3).scale(1.0));
}

TEST_CASE("a render above white feels the pull towards a darker reference and none towards white")
{
    Image render = randomImage(4, 4, 1, 1), gray = render, white = render;
    for (size_t i = 0; i < render.rgba.size(); ++i)
        if (i % 4 != 3) render.rgba[i] = 50.0f, gray.rgba[i] = 0.5f, white.rgba[i] = 3.0f;
    std::vector<float> planes = planesOf({render}, 1.0f), gradient(planes.size());
    for (const auto& [reference, pulls] : {std::pair{gray, true}, {white, false}}) {
        const PreparedImage prepared = prepareImage(reference);
        const PreparedImage* references[1] = {&prepared};
        ImageLoss().evaluate(planes.data(), references, 1, {}, gradient.data());
        CHECK((gradient[5] > 0) == pulls);
    }
}
