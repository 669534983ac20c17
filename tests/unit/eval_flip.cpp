// LDR-FLIP against a direct transcription of the paper: two-dimensional kernels, no separation, own colour code.
#include "eval/flip.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

using namespace nacre;

namespace {

constexpr double kPi = 3.14159265358979323846;
using Color = std::array<double, 3>;
using Field = std::vector<double>;

Color xyz(const Color& c) // Rec.709 to 10 digits; the paper's code uses rationals that differ by 4e-6
{
    return {0.4123907993 * c[0] + 0.3575843394 * c[1] + 0.1804807884 * c[2],
            0.2126390059 * c[0] + 0.7151686788 * c[1] + 0.0721923154 * c[2],
            0.0193308187 * c[0] + 0.1191947798 * c[1] + 0.9505321522 * c[2]};
}
const Color kWhite = xyz({1, 1, 1});

Color ycxcz(const Color& rgb)
{
    const Color t = xyz(rgb);
    const double x = t[0] / kWhite[0], y = t[1] / kWhite[1], z = t[2] / kWhite[2];
    return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

Color rgbOf(const Color& c)
{
    const double y = (c[0] + 16) / 116;
    const double X = (y + c[1] / 500) * kWhite[0], Y = y * kWhite[1], Z = (y - c[2] / 200) * kWhite[2];
    return {3.2409699419 * X - 1.5373831776 * Y - 0.4986107603 * Z, -0.9692436363 * X + 1.8759675015 * Y + 0.0415550574 * Z,
            0.0556300797 * X - 0.2039769589 * Y + 1.0569715142 * Z};
}

Color huntLab(const Color& rgb)
{
    const Color t = xyz(rgb);
    const auto f = [](double v) { return v > 216.0 / 24389 ? std::cbrt(v) : (24389.0 / 27 * v + 16) / 116; };
    const double x = f(t[0] / kWhite[0]), y = f(t[1] / kWhite[1]), z = f(t[2] / kWhite[2]);
    const double l = 116 * y - 16;
    return {l, 0.01 * l * 500 * (x - y), 0.01 * l * 200 * (y - z)};
}

double hyab(const Color& a, const Color& b)
{
    return std::abs(a[0] - b[0]) + std::sqrt((a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

/// sum over the kernel of kernel(dx, dy) * in at the clamped pixel
Field convolve(const Field& in, int w, int h, int radius, const std::function<double(int, int)>& kernel)
{
    Field out(in.size());
    for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x)
            for (int dy = -radius; dy <= radius; ++dy)
                for (int dx = -radius; dx <= radius; ++dx)
                    out[size_t(y * w + x)] +=
                        kernel(dx, dy) * in[size_t(std::clamp(y + dy, 0, h - 1) * w + std::clamp(x + dx, 0, w - 1))];
    return out;
}

/// Kernel scaled so that its positive weights sum to 1 and its negative ones to -1.
std::function<double(int, int)> balanced(int radius, const std::function<double(int, int)>& kernel)
{
    double positive = 0, negative = 0;
    for (int dy = -radius; dy <= radius; ++dy)
        for (int dx = -radius; dx <= radius; ++dx) (kernel(dx, dy) > 0 ? positive : negative) += kernel(dx, dy);
    return [=](int dx, int dy) {
        const double k = kernel(dx, dy);
        return k > 0 ? k / positive : k < 0 ? -k / negative : 0.0;
    };
}

struct Seen {
    std::vector<Color> lab;
    Field edge, point;
};

Seen see(const Image& image, double ppd)
{
    const int w = image.width, h = image.height;
    std::array<Field, 3> planes;
    for (size_t i = 0; i < size_t(w * h); ++i) {
        const Color c = ycxcz({image.rgba[4 * i], image.rgba[4 * i + 1], image.rgba[4 * i + 2]});
        for (size_t k = 0; k < 3; ++k) planes[k].push_back(c[k]);
    }
    const double table[3][4] = {
        {1, 0.0047, 0, 1e-5}, {1, 0.0053, 0, 1e-5}, {34.1, 0.04, 13.5, 0.025}}; // a1 b1 a2 b2, paper table 1
    const int radius = int(std::ceil(3 * std::sqrt(0.04 / (2 * kPi * kPi)) * ppd));
    std::array<Field, 3> filtered;
    for (size_t k = 0; k < 3; ++k) {
        const double* t = table[k];
        const auto csf = [=](int dx, int dy) {
            const double d2 = (dx * dx + dy * dy) / (ppd * ppd);
            return t[0] * std::sqrt(kPi / t[1]) * std::exp(-kPi * kPi * d2 / t[1]) +
                   t[2] * std::sqrt(kPi / t[3]) * std::exp(-kPi * kPi * d2 / t[3]);
        };
        filtered[k] = convolve(planes[k], w, h, radius, balanced(radius, csf));
    }
    Seen seen;
    for (size_t i = 0; i < size_t(w * h); ++i) {
        Color rgb = rgbOf({filtered[0][i], filtered[1][i], filtered[2][i]});
        for (double& c : rgb) c = std::clamp(c, 0.0, 1.0);
        seen.lab.push_back(huntLab(rgb));
    }
    const double sd = 0.5 * 0.082 * ppd;
    const int featureRadius = int(std::ceil(3 * sd));
    Field achromatic;
    for (double y : planes[0]) achromatic.push_back((y + 16) / 116);
    const auto gaussian = [=](int dx, int dy) { return std::exp(-(dx * dx + dy * dy) / (2 * sd * sd)); };
    const auto edgeX = balanced(featureRadius, [=](int dx, int dy) { return -dx * gaussian(dx, dy); });
    const auto pointX = balanced(featureRadius, [=](int dx, int dy) { return (dx * dx / (sd * sd) - 1) * gaussian(dx, dy); });
    const auto strength = [&](const std::function<double(int, int)>& kernel) {
        const Field x = convolve(achromatic, w, h, featureRadius, kernel);
        const Field y = convolve(achromatic, w, h, featureRadius, [&](int dx, int dy) { return kernel(dy, dx); });
        Field out;
        for (size_t i = 0; i < x.size(); ++i) out.push_back(std::sqrt(x[i] * x[i] + y[i] * y[i]));
        return out;
    };
    seen.edge = strength(edgeX);
    seen.point = strength(pointX);
    return seen;
}

double directFlip(const Image& a, const Image& b, double ppd)
{
    const Seen seenA = see(a, ppd), seenB = see(b, ppd);
    const double cMax = std::pow(hyab(huntLab({0, 1, 0}), huntLab({0, 0, 1})), 0.7), knee = 0.4 * cMax;
    double sum = 0;
    for (size_t i = 0; i < seenA.lab.size(); ++i) {
        const double c = std::pow(hyab(seenA.lab[i], seenB.lab[i]), 0.7);
        const double color = c < knee ? 0.95 / knee * c : 0.95 + (c - knee) / (cMax - knee) * 0.05;
        const double difference = std::max(std::abs(seenA.edge[i] - seenB.edge[i]), std::abs(seenA.point[i] - seenB.point[i]));
        sum += std::pow(color, 1 - std::sqrt(difference / std::sqrt(2.0)));
    }
    return sum / double(seenA.lab.size());
}

Image blocks(unsigned seed)
{
    std::mt19937 random(seed);
    Image image{26, 19, std::vector<float>(26 * 19 * 4, 1.0f)};
    for (int by = 0; by < 19; by += 4)
        for (int bx = 0; bx < 26; bx += 5) {
            const float c[3] = {float(random() % 256) / 255, float(random() % 256) / 255, float(random() % 256) / 255};
            for (int y = by; y < std::min(19, by + 4); ++y)
                for (int x = bx; x < std::min(26, bx + 5); ++x) std::copy(c, c + 3, image.pixel(x, y));
        }
    return image;
}

} // namespace

TEST_CASE("separable FLIP agrees with the paper's definition")
{
    for (double ppd : {67.0, 40.0})
        for (unsigned seed : {1u, 2u}) {
            const Image a = blocks(seed), b = blocks(seed + 10);
            CHECK(meanFlip(a, b, ppd) == doctest::Approx(directFlip(a, b, ppd)).epsilon(1e-4)); // matrix rounded otherwise: 1e-5
        }
}
