// The loss on the device, emulated: against its definition in float64 and the loss of the CPU, in every order of threads.
#include "base/half.h"
#include "device/loss.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <random>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 3}};

Image randomImage(int width, int height, uint64_t seed, size_t everyUnknown)
{
    std::mt19937_64 rng(seed);
    std::uniform_real_distribution<float> u(0, 1);
    Image image{width, height, std::vector<float>(size_t(4) * size_t(width) * size_t(height))};
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        for (size_t c = 0; c < 4; ++c) image.rgba[i + c] = c == 3 ? u(rng) : u(rng) * u(rng);
        if (everyUnknown && (i / 4 + seed) % everyUnknown == 0) image.rgba[i] = image.rgba[i + 1] = image.rgba[i + 2] = 0, image.rgba[i + 3] = kUnknownAlpha;
    }
    return image;
}

struct Scene {
    int width, height;
    std::vector<PreparedImage> references;
    std::vector<float> planes;

    Scene(int width, int height, size_t lights, size_t everyUnknown) : width(width), height(height)
    {
        for (size_t l = 0; l < lights; ++l) references.push_back(prepareImage(randomImage(width, height, 10 + l, everyUnknown ? everyUnknown + l : 0)));
        std::mt19937_64 rng(3);
        std::uniform_real_distribution<float> u(0, 1);
        planes.resize((3 * lights + 1) * size_t(width) * size_t(height));
        for (float& x : planes) x = u(rng) < 0.2f ? 0.0f : 1.2f * u(rng) * u(rng); // black, above white, below the bend of the display's curve
    }
    size_t pixels() const { return size_t(width) * size_t(height); }
    std::vector<const PreparedImage*> pointers() const
    {
        std::vector<const PreparedImage*> p;
        for (const PreparedImage& r : references) p.push_back(&r);
        return p;
    }
};

struct Result {
    LossStats stats;
    std::vector<float> gradient, errors;
};

Result onCpu(const Scene& s, const LossOptions& options)
{
    Result r{{}, std::vector<float>(s.planes.size()), std::vector<float>(s.pixels())};
    const auto references = s.pointers();
    r.stats = ImageLoss().evaluate(s.planes.data(), references.data(), int(references.size()), options, r.gradient.data());
    objectErrors(s.planes.data(), references.data(), int(references.size()), r.errors.data());
    return r;
}

Result onDevice(const Scene& s, const LossOptions& options, const Emulation& emulation)
{
    Device device(emulation);
    Result r{{}, std::vector<float>(s.planes.size()), std::vector<float>(s.pixels())};
    std::vector<Buffer<uint16_t>> buffers(3 * s.references.size());
    DeviceImage images[kMaxLightsPerStep];
    for (size_t l = 0; l < s.references.size(); ++l) {
        const PreparedImage& p = s.references[l];
        buffers[3 * l].upload(device, p.planes), buffers[3 * l + 1].upload(device, p.linear), buffers[3 * l + 2].upload(device, p.known);
        images[l] = {buffers[3 * l].data(), buffers[3 * l + 1].data(), p.known.empty() ? nullptr : buffers[3 * l + 2].data(), p.width, p.height, p.unknown};
    }
    Buffer<float> planes, gradient, errors;
    planes.upload(device, s.planes), gradient.reserve(device, s.planes.size()), errors.reserve(device, s.pixels());
    DeviceLoss loss;
    loss.run(device, planes.data(), images, int(s.references.size()), options, gradient.data());
    r.stats = loss.stats(device);
    objectErrors(device, planes.data(), images, int(s.references.size()), errors.data());
    gradient.download(device, r.gradient), errors.download(device, r.errors);
    return r;
}

double largest(const std::vector<float>& values)
{
    double worst = 0;
    for (float v : values) worst = std::max(worst, std::abs(double(v)));
    return worst;
}

void checkClose(const std::vector<float>& a, const std::vector<float>& b, double bound)
{
    double worst = 0;
    for (size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::isfinite(a[i]) ? std::abs(double(a[i]) - double(b[i])) : 1e30);
    CHECK(worst <= bound * largest(b));
}

} // namespace

TEST_CASE("device loss: figures, gradient and errors equal the CPU's, also of unknown pixels and SSIM, with the same bytes in every order of threads")
{
    for (const float dssim : {0.0f, 0.2f, 1.0f})
        for (const auto& [w, h, lights, unknown] : {std::tuple{37, 29, size_t(4), size_t(0)}, {20, 33, size_t(2), size_t(3)}, {3, 2, size_t(1), size_t(0)}, {9, 9, size_t(1), size_t(1)}}) {
            CAPTURE(dssim);
            CAPTURE(w);
            const Scene scene(w, h, lights, unknown);
            const LossOptions options{dssim, 0.3f};
            const Result cpu = onCpu(scene, options), device = onDevice(scene, options, kOrders[0]);
            for (const Emulation& order : {kOrders[1], kOrders[2]}) {
                const Result other = onDevice(scene, options, order);
                CHECK(other.gradient == device.gradient);
                CHECK(other.errors == device.errors);
                CHECK(other.stats.loss == device.stats.loss);
                CHECK(other.stats.squaredError == device.stats.squaredError);
                CHECK(other.stats.squaredErrorMasked == device.stats.squaredErrorMasked);
            }
            checkClose(device.gradient, cpu.gradient, dssim > 0 ? 1e-4 : 2e-6); // variances are differences of blurred squares
            checkClose(device.errors, cpu.errors, 1e-6);
            CHECK(device.stats.loss == doctest::Approx(cpu.stats.loss).epsilon(1e-5)); // the CPU adds rows in float32
            CHECK(device.stats.squaredError == doctest::Approx(cpu.stats.squaredError).epsilon(1e-5));
            CHECK(device.stats.squaredErrorMasked == doctest::Approx(cpu.stats.squaredErrorMasked).epsilon(1e-5));
            CHECK(device.stats.count == cpu.stats.count);
            CHECK(device.stats.countMasked == cpu.stats.countMasked);
        }
}

TEST_CASE("device loss: all halves of [0, 1] have their values")
{
    for (uint32_t i = 0; i <= 4096; ++i) {
        const float x = float(i) / 4096.0f;
        CHECK(std::abs(radianceFromHalf(halfFromFloat(x)) - x) <= std::max(x / 2048.0f, 0x1p-25f));
    }
    for (uint16_t h = 0; h <= 0x3c00; ++h) CHECK(halfFromFloat(radianceFromHalf(h)) == h);
}

TEST_CASE("device loss: equals its definition in float64")
{
    const Scene scene(21, 17, 2, 0);
    const size_t pixels = scene.pixels();
    const Result device = onDevice(scene, {0.0f, 0.5f}, kOrders[2]);
    double weighted = 0, squared = 0, alpha = 0;
    for (size_t plane = 0; plane < 6; ++plane)
        for (size_t i = 0; i < pixels; ++i) {
            const PreparedImage& r = scene.references[plane / 3];
            const double x = std::min(double(scene.planes[plane * pixels + i]), 1.0), reference = double(radianceFromHalf(r.linear[plane % 3 * pixels + i]));
            const double slope = x <= 0.0031308 ? 12.92 : 1.055 / 2.4 * std::pow(x, 1 / 2.4 - 1), shown = (x - reference) * slope;
            const double difference = srgbFromLinear(x) - double(r.planes[plane % 3 * pixels + i]) / 65535;
            weighted += shown * shown, squared += difference * difference;
            const double expected = shown * slope / (kLossScale * 6.0 * double(pixels));
            CHECK(std::abs(device.gradient[plane * pixels + i] - expected) <= 1e-5 * slope * slope / (kLossScale * 6.0 * double(pixels))); // float32
        }
    for (size_t i = 0; i < pixels; ++i) {
        const double difference = double(scene.planes[6 * pixels + i]) - double(scene.references[0].planes[3 * pixels + i]) / 65535;
        alpha += std::abs(difference);
        CHECK(device.gradient[6 * pixels + i] == doctest::Approx((difference > 0 ? 0.5 : -0.5) / double(pixels)).epsilon(1e-6));
    }
    CHECK(device.stats.loss == doctest::Approx(weighted / (2 * kLossScale * 6.0 * double(pixels)) + 0.5 * alpha / double(pixels)).epsilon(1e-5));
    CHECK(device.stats.squaredError == doctest::Approx(squared).epsilon(1e-5));
}

TEST_CASE("device loss: a render that is not a number is seen, not hidden")
{
    Scene scene(16, 4, 1, 0);
    scene.planes[5] = std::nanf("");
    const Result device = onDevice(scene, {}, kOrders[0]);
    CHECK(std::isnan(device.gradient[5]));
    CHECK(std::isnan(device.stats.loss));
}
