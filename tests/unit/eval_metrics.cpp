// The image metrics: values known from their definitions, and the properties that make them metrics.
#include "base/color.h"
#include "eval/flip.h"
#include "eval/metrics.h"

#include <doctest/doctest.h>
#include <glm/glm.hpp>

#include <cmath>
#include <functional>

using namespace nacre;

namespace {

Image makeImage(int width, int height, const std::function<glm::vec4(int x, int y)>& value)
{
    Image image{width, height, {}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < 4; ++c) image.rgba.push_back(value(x, y)[c]);
    return image;
}

Image flat(float value)
{
    return makeImage(40, 30, [&](int, int) { return glm::vec4(glm::vec3(value), 1.0f); });
}

/// Display value g as a linear pixel.
glm::vec4 display(float g, float alpha = 1.0f) { return glm::vec4(glm::vec3(linearFromSrgb(g)), alpha); }

/// Smooth and detailed at once, display values in [0, 1].
float pattern(int x, int y) { return 0.5f + 0.25f * std::sin(0.9f * float(x)) + 0.25f * std::cos(0.7f * float(y + x / 3)); }

Image patterned(float offset)
{
    return makeImage(48, 40, [&](int x, int y) { return display(pattern(x, y) * (1 - offset) + offset); });
}

constexpr double kNear = 1e-5; // f32 sRGB transfer and back

} // namespace

TEST_CASE("PSNR of a constant display offset is its definition")
{
    for (float offset : {0.1f, 0.01f, 0.5f}) {
        const Image a = makeImage(16, 8, [&](int, int) { return display(0.25f + offset); });
        const Image b = makeImage(16, 8, [&](int, int) { return display(0.25f); });
        CHECK(compareImages(a, b).psnr == doctest::Approx(-20 * std::log10(double(offset))).epsilon(1e-4)); // f32 transfer
    }
}

TEST_CASE("identical images score the best of every metric")
{
    const Image image = patterned(0.2f);
    const ImageMetrics m = compareImages(image, image);
    CHECK(m.psnr == kMaxPsnr);
    CHECK(m.psnrMasked == kMaxPsnr);
    CHECK(m.ssim == doctest::Approx(1.0).epsilon(1e-12));
    CHECK(m.flip == 0.0);
    CHECK(m.relMseLinear == 0.0);
}

TEST_CASE("Γ clips: values beyond the display range are equal to its ends, except in linear error")
{
    const ImageMetrics m = compareImages(flat(7.0f), flat(1.0f));
    CHECK(m.psnr == kMaxPsnr);
    CHECK(m.flip == 0.0);
    CHECK(m.relMseLinear == doctest::Approx(36.0 / 1.01));
    CHECK(compareImages(flat(-1.0f), flat(0.0f)).psnr == kMaxPsnr);
}

TEST_CASE("masked figures ignore the background, whole-image figures do not")
{
    const auto object = [](int x) { return x < 10; };
    const Image reference = makeImage(40, 30, [&](int x, int) { return object(x) ? display(0.5f) : display(0.0f, 0.5f); });
    const Image render = makeImage(40, 30, [&](int x, int) { return object(x) ? display(0.6f) : display(0.9f); });
    const ImageMetrics m = compareImages(render, reference);
    CHECK(m.psnrMasked == doctest::Approx(20.0).epsilon(kNear));
    CHECK(m.psnr == doctest::Approx(-10 * std::log10(0.25 * 0.01 + 0.75 * 0.81)).epsilon(kNear));
    const double a = linearFromSrgb(0.6), b = linearFromSrgb(0.5);
    CHECK(m.relMseLinear == doctest::Approx((a - b) * (a - b) / (b * b + 0.01)).epsilon(1e-4)); // f32 pixels
}

TEST_CASE("what the reference does not know counts in no figure")
{
    const Image render = patterned(0.1f);
    Image reference = patterned(0), other = render;
    const auto unknown = [](size_t i) { return i % 7 == 3 || i < 200; };
    double squared = 0;
    size_t known = 0;
    for (size_t i = 0; i < reference.rgba.size() / 4; ++i) {
        if (!unknown(i)) {
            const double d = double(srgbFromLinear(render.rgba[4 * i])) - double(srgbFromLinear(reference.rgba[4 * i]));
            squared += d * d, ++known;
            continue;
        }
        for (size_t c = 0; c < 3; ++c) reference.rgba[4 * i + c] = 0, other.rgba[4 * i + c] = 0.7f;
        reference.rgba[4 * i + 3] = kUnknownAlpha;
    }
    const ImageMetrics a = compareImages(render, reference), b = compareImages(other, reference);
    CHECK(a.psnr == doctest::Approx(-10 * std::log10(squared / double(known))).epsilon(kNear));
    for (auto figure : {&ImageMetrics::psnr, &ImageMetrics::psnrMasked, &ImageMetrics::ssim, &ImageMetrics::flip, &ImageMetrics::relMseLinear})
        CHECK(a.*figure == b.*figure);
    CHECK(compareImages(reference, reference).flip == 0);
    CHECK(compareImages(reference, reference).ssim == doctest::Approx(1));
}

TEST_CASE("image without an object is measured whole")
{
    const Image reference = makeImage(9, 9, [](int, int) { return display(0.0f, 0.0f); });
    const ImageMetrics m = compareImages(makeImage(9, 9, [](int, int) { return display(0.1f); }), reference);
    CHECK(m.psnrMasked == m.psnr);
    CHECK(m.relMseLinear > 0);
}

TEST_CASE("SSIM of flat images is the luminance term, away from the zero-padded border")
{
    // Inside, variances vanish: SSIM = (2ab + C1) / (a^2 + b^2 + C1). The border sees black beyond the edge, the same in both.
    const Image a = makeImage(300, 300, [](int, int) { return display(0.8f); });
    const Image b = makeImage(300, 300, [](int, int) { return display(0.4f); });
    const double inside = (2 * 0.32 + 1e-4) / (0.64 + 0.16 + 1e-4);
    CHECK(ssim(a, b) == doctest::Approx(inside).epsilon(0.02)); // border: 5 of 150 pixels on each side differ
}

TEST_CASE("SSIM is symmetric and sees inverted structure")
{
    const Image a = patterned(0.0f);
    const Image inverted = makeImage(48, 40, [](int x, int y) { return display(1.0f - pattern(x, y)); });
    CHECK(ssim(a, inverted) < 0.2);
    CHECK(ssim(a, inverted) == doctest::Approx(ssim(inverted, a)).epsilon(1e-12));
    CHECK(ssim(a, patterned(0.1f)) > ssim(a, patterned(0.3f)));
}

TEST_CASE("FLIP of black and white is the published maximum for flat images")
{
    // HyAB = 100, 100^0.7 = 25.12; the largest colour distance (green to blue) is 203.4^0.7 = 41.3; no features:
    // 0.95 + 0.05 (25.12 - 0.4 * 41.3) / (0.6 * 41.3) = 0.967.
    CHECK(meanFlip(flat(0.0f), flat(1.0f)) == doctest::Approx(0.967).epsilon(1e-3));
}

TEST_CASE("FLIP of green and blue is 1")
{
    const Image green = makeImage(20, 20, [](int, int) { return glm::vec4(0, 1, 0, 1); });
    const Image blue = makeImage(20, 20, [](int, int) { return glm::vec4(0, 0, 1, 1); });
    CHECK(meanFlip(green, blue) == doctest::Approx(1.0).epsilon(1e-9));
}

TEST_CASE("FLIP is symmetric, between 0 and 1, and grows with the error")
{
    const Image reference = patterned(0.0f);
    double last = 0;
    for (float offset : {0.01f, 0.03f, 0.1f, 0.3f, 0.8f}) {
        const double error = meanFlip(patterned(offset), reference);
        CHECK(error > last);
        CHECK(error < 1);
        CHECK(error == doctest::Approx(meanFlip(reference, patterned(offset))).epsilon(1e-12));
        last = error;
    }
}

TEST_CASE("FLIP forgives noise the eye cannot resolve, and weighs edges")
{
    const auto checkers = [](int cell) {
        return makeImage(64, 64, [=](int x, int y) { return display((x / cell + y / cell) % 2 ? 0.6f : 0.4f); });
    };
    const Image grey = makeImage(64, 64, [](int, int) { return display(0.51f); });
    CHECK(meanFlip(checkers(1), grey) < 0.5 * meanFlip(checkers(8), grey)); // one pixel is 1/67 degree
}

TEST_CASE("single-pixel and one-row images are measured")
{
    for (const auto& [w, h] : {std::pair(1, 1), std::pair(17, 1), std::pair(1, 5)}) {
        const Image a = makeImage(w, h, [](int, int) { return display(0.3f); });
        const Image b = makeImage(w, h, [](int, int) { return display(0.6f); });
        const ImageMetrics m = compareImages(a, b);
        CHECK(m.psnr == doctest::Approx(-20 * std::log10(0.3)).epsilon(kNear));
        CHECK(std::isfinite(m.ssim));
        CHECK(m.flip > 0);
    }
}

TEST_CASE("a highlight that is a few pixels off is neither missing nor invented; one that only one image has is")
{
    const auto spot = [](int atX, int atY, float luma) {
        return makeImage(40, 30, [&](int x, int y) { return display(x == atX && y == atY ? luma : 0.3f); });
    };
    constexpr double kOnePixel = 1.0 / (40 * 30);
    const Image here = spot(20, 15, 0.9f), near = spot(22, 13, 0.9f), far = spot(23, 15, 0.9f), dull = spot(20, 15, 0.45f), none = spot(20, 15, 0.3f);
    CHECK(compareImages(here, near).highlightMissing == 0);
    CHECK(compareImages(here, near).highlightFalse == 0);
    CHECK(compareImages(here, far).highlightMissing == doctest::Approx(kOnePixel));
    CHECK(compareImages(here, far).highlightFalse == doctest::Approx(kOnePixel));
    CHECK(compareImages(dull, here).highlightMissing == doctest::Approx(kOnePixel));
    CHECK(compareImages(dull, here).highlightFalse == 0);
    CHECK(compareImages(dull, none).highlightFalse == 0); // 0.15 brighter: not yet a highlight
    CHECK(compareImages(here, none).highlightFalse == doctest::Approx(kOnePixel));
}

TEST_CASE("highlights are shares of the object, and their PSNR is over bright reference pixels only")
{
    const auto image = [](float bright) {
        return makeImage(20, 10, [&](int x, int y) { return display(x == 4 && y == 4 ? bright : 0.2f, x < 10 ? 1.0f : 0.0f); });
    };
    const ImageMetrics m = compareImages(image(0.6f), image(0.9f));
    CHECK(m.highlightMissing == doctest::Approx(1.0 / 100));
    CHECK(m.highlightSamples == 3);
    CHECK(highlightPsnr(m) == doctest::Approx(-20 * std::log10(0.3)).epsilon(1e-4));
    CHECK(std::isnan(highlightPsnr(compareImages(image(0.9f), image(0.6f)))));
}
