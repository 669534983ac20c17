// LDR-FLIP (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: "FLIP: A Difference Evaluator for Alternating
// Images", HPG 2020).
//
//   dE = dEc ^ (1 - dEf)
//   dEc: HyAB distance of the Hunt-adjusted CIELab of both images after the eye's contrast sensitivity filter (in YCxCz), to the
//        power qc, mapped to [0, 1] so that the first pc of the range takes pt of it
//   dEf: (max(difference of edge strength, difference of point strength) / sqrt 2) ^ qf on the achromatic channel
//
// Every filter here is a sum of products of 1-D kernels, so all run as separable passes. Borders replicate, as in the paper's
// code.
#include "eval/flip.h"

#include "eval/plane_filter.h"

#include <glm/glm.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numbers>

namespace nacre {
namespace {

constexpr double kQc = 0.7, kPc = 0.4, kPt = 0.95, kQf = 0.5, kFeatureWidthDegrees = 0.082;
constexpr double kPi = std::numbers::pi;

using Planes = std::array<Plane, 3>;

// ---- Colour spaces (Rec.709 primaries, D65 white = XYZ of rgb (1, 1, 1)) ------------------------------------------------------

// Columns are the XYZ of red, green and blue (glm is column-major).
const glm::dmat3 kXyzFromRgb{{10135552.0 / 24577794.0, 2613072.0 / 12288897.0, 1425312.0 / 73733382.0},
                             {8788810.0 / 24577794.0, 8788810.0 / 12288897.0, 8788810.0 / 73733382.0},
                             {4435075.0 / 24577794.0, 887015.0 / 12288897.0, 70074185.0 / 73733382.0}};
const glm::dmat3 kRgbFromXyz = glm::inverse(kXyzFromRgb);
const glm::dvec3 kWhite = kXyzFromRgb * glm::dvec3(1.0);

/// Linearised CIELab: achromatic, red-green, blue-yellow.
glm::dvec3 ycxczFromRgb(const glm::dvec3& rgb)
{
    const glm::dvec3 t = (kXyzFromRgb * rgb) / kWhite;
    return {116.0 * t.y - 16.0, 500.0 * (t.x - t.y), 200.0 * (t.y - t.z)};
}

glm::dvec3 rgbFromYcxcz(const glm::dvec3& c)
{
    const double y = (c.x + 16.0) / 116.0;
    return kRgbFromXyz * (glm::dvec3(y + c.y / 500.0, y, y - c.z / 200.0) * kWhite);
}

/// CIELab with the Hunt effect: colour counts less where it is dark.
glm::dvec3 huntLabFromRgb(const glm::dvec3& rgb)
{
    const auto f = [](double t) {
        constexpr double kDelta = 6.0 / 29.0;
        return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3.0 * kDelta * kDelta) + 4.0 / 29.0;
    };
    const glm::dvec3 t = (kXyzFromRgb * rgb) / kWhite;
    const double fx = f(t.x), fy = f(t.y), fz = f(t.z);
    const double lightness = 116.0 * fy - 16.0;
    return {lightness, 0.01 * lightness * 500.0 * (fx - fy), 0.01 * lightness * 200.0 * (fy - fz)};
}

double hyab(const glm::dvec3& a, const glm::dvec3& b) { return std::abs(a.x - b.x) + std::hypot(a.y - b.y, a.z - b.z); }

// ---- Contrast sensitivity -----------------------------------------------------------------------------------------------------

struct Gaussian {
    double a, b;
}; // a * sqrt(pi / b) * exp(-pi^2 d^2 / b), d in degrees

/// Filters with the normalised sum of Gaussians.
Plane filterGaussians(const Plane& in, std::initializer_list<Gaussian> gaussians, int radius, double pixelsPerDegree)
{
    Plane out(in.width, in.height);
    double total = 0;
    for (const Gaussian& g : gaussians) {
        std::vector<double> kernel;
        double sum = 0;
        for (int i = -radius; i <= radius; ++i) {
            const double d = i / pixelsPerDegree;
            kernel.push_back(std::exp(-kPi * kPi * d * d / g.b));
            sum += kernel.back();
        }
        const double weight = g.a * std::sqrt(kPi / g.b);
        const Plane filtered = filterSeparable(in, kernel, kernel, Border::kReplicate);
        for (size_t i = 0; i < out.values.size(); ++i) out.values[i] += weight * filtered.values[i];
        total += weight * sum * sum;
    }
    for (double& v : out.values) v /= total;
    return out;
}

/// YCxCz planes -> Hunt-adjusted Lab of what the eye resolves.
std::vector<glm::dvec3> perceived(const Planes& ycxcz, double pixelsPerDegree)
{
    constexpr double kWidest = 0.04; // the largest b below sets the radius of all three
    const int radius = int(std::ceil(3.0 * std::sqrt(kWidest / (2.0 * kPi * kPi)) * pixelsPerDegree));
    const Plane y = filterGaussians(ycxcz[0], {{1.0, 0.0047}}, radius, pixelsPerDegree);
    const Plane cx = filterGaussians(ycxcz[1], {{1.0, 0.0053}}, radius, pixelsPerDegree);
    const Plane cz = filterGaussians(ycxcz[2], {{34.1, 0.04}, {13.5, 0.025}}, radius, pixelsPerDegree);
    std::vector<glm::dvec3> lab(y.values.size());
    for (size_t i = 0; i < lab.size(); ++i) {
        const glm::dvec3 rgb = rgbFromYcxcz({y.values[i], cx.values[i], cz.values[i]});
        lab[i] = huntLabFromRgb(glm::clamp(rgb, 0.0, 1.0));
    }
    return lab;
}

/// To [0, 1], piecewise linear: small errors take most of the range.
double colorDifference(const glm::dvec3& a, const glm::dvec3& b)
{
    static const double cMax = std::pow(hyab(huntLabFromRgb({0, 1, 0}), huntLabFromRgb({0, 0, 1})), kQc);
    const double knee = kPc * cMax, d = std::pow(hyab(a, b), kQc);
    return d < knee ? kPt / knee * d : kPt + (d - knee) / (cMax - knee) * (1.0 - kPt);
}

// ---- Features
// -------------------------------------------------------------------------------------------------------------------

/// Scales the positive taps to sum 1 and the negative ones to sum -1.
void normalizeSides(std::vector<double>& kernel)
{
    double positive = 0, negative = 0;
    for (double k : kernel) (k > 0 ? positive : negative) += k;
    for (double& k : kernel) k /= k > 0 ? positive : -negative;
}

struct Features {
    std::vector<double> edge, point;
}; // strengths per pixel

Features detectFeatures(const Plane& achromatic, double pixelsPerDegree)
{
    const double sd = 0.5 * kFeatureWidthDegrees * pixelsPerDegree;
    const int radius = int(std::ceil(3.0 * sd));
    std::vector<double> smooth, edge, point;
    double sum = 0;
    for (int i = -radius; i <= radius; ++i) {
        const double g = std::exp(-0.5 * i * i / (sd * sd));
        smooth.push_back(g);
        edge.push_back(-i * g);
        point.push_back((i * i / (sd * sd) - 1.0) * g);
        sum += g;
    }
    for (double& s : smooth) s /= sum;
    normalizeSides(edge);
    normalizeSides(point);
    const auto strength = [&](const std::vector<double>& kernel) {
        Plane x = filterSeparable(achromatic, kernel, smooth, Border::kReplicate);
        const Plane y = filterSeparable(achromatic, smooth, kernel, Border::kReplicate);
        for (size_t i = 0; i < x.values.size(); ++i) x.values[i] = std::hypot(x.values[i], y.values[i]);
        return std::move(x.values);
    };
    return {strength(edge), strength(point)};
}

bool isKnown(const Image& image, size_t pixel) { return !(image.rgba[4 * pixel + 3] < 0); }

/// Black where one of the two is unknown.
Planes ycxczPlanes(const Image& image, const Image& other)
{
    Planes planes{Plane(image.width, image.height), Plane(image.width, image.height), Plane(image.width, image.height)};
    for (size_t i = 0; i < planes[0].values.size(); ++i) {
        const float* p = image.rgba.data() + 4 * i;
        const glm::dvec3 rgb = isKnown(image, i) && isKnown(other, i) ? glm::dvec3(p[0], p[1], p[2]) : glm::dvec3(0.0);
        const glm::dvec3 c = ycxczFromRgb(glm::clamp(rgb, 0.0, 1.0));
        for (int k = 0; k < 3; ++k) planes[size_t(k)].values[i] = c[k];
    }
    return planes;
}

} // namespace

double meanFlip(const Image& a, const Image& b, double pixelsPerDegree)
{
    assert(a.width == b.width && a.height == b.height);
    Planes ycxczA = ycxczPlanes(a, b), ycxczB = ycxczPlanes(b, a);
    const std::vector<glm::dvec3> labA = perceived(ycxczA, pixelsPerDegree), labB = perceived(ycxczB, pixelsPerDegree);
    for (Planes* planes : {&ycxczA, &ycxczB})
        for (double& y : (*planes)[0].values) y = (y + 16.0) / 116.0; // to [0, 1]
    const Features featuresA = detectFeatures(ycxczA[0], pixelsPerDegree), featuresB = detectFeatures(ycxczB[0], pixelsPerDegree);

    double sum = 0;
    size_t known = 0;
    for (size_t i = 0; i < labA.size(); ++i) {
        if (!isKnown(a, i) || !isKnown(b, i)) continue;
        ++known;
        const double edge = std::abs(featuresA.edge[i] - featuresB.edge[i]);
        const double point = std::abs(featuresA.point[i] - featuresB.point[i]);
        const double feature = std::pow(std::max(edge, point) / std::numbers::sqrt2, kQf);
        sum += std::pow(colorDifference(labA[i], labB[i]), 1.0 - feature);
    }
    return known ? sum / double(known) : 0.0;
}

} // namespace nacre
