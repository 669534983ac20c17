// Two procedural radiance maps for the environment split, so that a dataset needs no files from elsewhere.
//
// sunset: a sky that fades from a warm horizon to blue overhead, a small bright sun low in it, a dark ground.
// studio: a dim grey room with a large key soft box, a cool strip light opposite and a faint top light, each with soft edges.
// Equirectangular, axes as in eval/environment.cpp: theta = pi v from +Z, phi = pi - 2 pi u from +X towards +Y. Each map is scaled so that the
// mean radiance over the sphere is kMeanRadiance: what a white diffuse object shows, about as bright as under the stage's lights.
#include "light_stage/stage_plan.h"

#include <cmath>
#include <numbers>

namespace nacre {
namespace {

constexpr int kWidth = 128, kHeight = 64, kSub = 4; // kSub^2 samples per texel: soft edges without ringing
constexpr double kMeanRadiance = 0.5, kPi = std::numbers::pi;

glm::dvec3 towards(double azimuthDegrees, double elevationDegrees)
{
    const double a = azimuthDegrees * kPi / 180, e = elevationDegrees * kPi / 180;
    return {std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)};
}

double smooth(double edge0, double edge1, double x)
{
    const double t = std::fmin(std::fmax((x - edge0) / (edge1 - edge0), 0.0), 1.0);
    return t * t * (3 - 2 * t);
}

glm::dvec3 sunset(const glm::dvec3& d)
{
    const glm::dvec3 sun = towards(35, 12);
    const double angle = std::acos(std::fmin(glm::dot(d, sun), 1.0)) * 180 / kPi;
    if (d.z < 0) return glm::dvec3(0.06, 0.05, 0.045) * (1.0 - 0.5 * d.z);
    const glm::dvec3 zenith(0.10, 0.22, 0.55), horizon(0.95, 0.55, 0.28);
    const glm::dvec3 sky = glm::mix(horizon, zenith, std::pow(d.z, 0.45));
    const glm::dvec3 glow = glm::dvec3(1.6, 0.75, 0.25) * std::exp(-angle / 14.0);
    return sky + glow + glm::dvec3(420, 230, 95) * (1.0 - smooth(2.5, 4.0, angle)); // a sun of 3 degrees: a few texels
}

/// A rectangle of light about `middle`, half sizes in degrees, seen from the origin.
double softBox(const glm::dvec3& d, const glm::dvec3& middle, double halfWidth, double halfHeight)
{
    if (glm::dot(d, middle) <= 0) return 0;
    const glm::dvec3 x = glm::normalize(glm::cross(glm::dvec3(0.02, 0, 1), middle)), y = glm::cross(middle, x), p = d / glm::dot(d, middle);
    const auto side = [](double value, double halfDegrees) {
        const double half = std::tan(halfDegrees * kPi / 180);
        return 1.0 - smooth(0.85 * half, 1.15 * half, std::fabs(value));
    };
    return side(glm::dot(p, x), halfWidth) * side(glm::dot(p, y), halfHeight);
}

glm::dvec3 studio(const glm::dvec3& d)
{
    const glm::dvec3 room = glm::dvec3(0.07) * (0.6 + 0.4 * d.z);
    const glm::dvec3 key = glm::dvec3(14, 13, 11.5) * softBox(d, towards(60, 40), 18, 14);
    const glm::dvec3 strip = glm::dvec3(4, 5, 6.5) * softBox(d, towards(-115, 15), 6, 28);
    const glm::dvec3 top = glm::dvec3(2.5) * softBox(d, towards(170, 80), 20, 12);
    return room + key + strip + top;
}

template <class Radiance>
Image makeMap(Radiance radiance)
{
    Image map{kWidth, kHeight, std::vector<float>(size_t(kWidth) * kHeight * 4, 1.0f)};
    std::vector<glm::dvec3> texels(size_t(kWidth) * kHeight);
    double sum = 0, area = 0;
    for (int y = 0; y < kHeight; ++y) {
        const double weight = std::sin(kPi * (y + 0.5) / kHeight);
        for (int x = 0; x < kWidth; ++x) {
            glm::dvec3& texel = texels[size_t(y) * kWidth + size_t(x)];
            for (int s = 0; s < kSub * kSub; ++s) {
                const double theta = kPi * (y + (s / kSub + 0.5) / kSub) / kHeight;
                const double phi = kPi - 2 * kPi * (x + (s % kSub + 0.5) / kSub) / kWidth;
                texel += radiance(glm::dvec3(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)));
            }
            sum += weight * (0.2126 * texel.r + 0.7152 * texel.g + 0.0722 * texel.b);
            area += weight;
        }
    }
    const double scale = kMeanRadiance * area / sum;
    for (size_t i = 0; i < texels.size(); ++i)
        for (int c = 0; c < 3; ++c) map.rgba[4 * i + size_t(c)] = float(texels[i][c] * scale);
    return map;
}

} // namespace

Image sunsetMap() { return makeMap(sunset); }
Image studioMap() { return makeMap(studio); }

} // namespace nacre
