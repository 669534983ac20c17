#include "light_stage/capture_camera.h"

#include "base/color.h"
#include "base/random.h"
#include "dataset/develop.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nacre {
namespace {

/// A pair of independent numbers of mean 0 and variance 1 (Box and Muller 1958).
glm::dvec2 normalPair(Random& random)
{
    const double radius = std::sqrt(-2.0 * std::log((double(random.next() >> 11) + 0.5) * 0x1p-53));
    const double angle = 2.0 * std::numbers::pi * double(random.next() >> 11) * 0x1p-53;
    return {radius * std::cos(angle), radius * std::sin(angle)};
}

} // namespace

glm::dvec2 lookedAt(const FileCamera& file, double x, double y)
{
    // Newton's iteration, derivatives by differences; lenses are so nearly linear that four steps leave nothing.
    constexpr int kSteps = 8;
    constexpr double kDifference = 1e-4, kEnough = 1e-10;
    Camera plane; // positions are those on the plane z = -1, y down
    plane.fx = plane.fy = 1;
    const glm::dvec2 goal(x, y);
    glm::dvec2 at((x - file.cx) / file.fx, (y - file.cy) / file.fy);
    for (int i = 0; i < kSteps; ++i) {
        const glm::dvec2 here = positionInFile(file, plane, at.x, at.y);
        const glm::dmat2 slope((positionInFile(file, plane, at.x + kDifference, at.y) - positionInFile(file, plane, at.x - kDifference, at.y)) / (2 * kDifference),
                               (positionInFile(file, plane, at.x, at.y + kDifference) - positionInFile(file, plane, at.x, at.y - kDifference)) / (2 * kDifference));
        const glm::dvec2 step = glm::inverse(slope) * (goal - here);
        at += step;
        if (!(glm::length(step) > kEnough)) break; // NaN ends it as well
    }
    return {at.x, -at.y};
}

FileCamera plausibleLens(const Camera& camera, double strength)
{
    FileCamera file{camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy};
    if (!(strength > 0)) return file;
    file.k[0] = -0.13 * strength, file.k[1] = 0.05 * strength; // grows with the angle for ever, as 9 k1^2 < 20 k2: one to one in pictures of any width
    file.p[0] = 6e-4 * strength, file.p[1] = -9e-4 * strength;
    file.cx += 0.012 * strength * camera.width, file.cy -= 0.008 * strength * camera.height;
    return file;
}

void addNoise(Image& image, const SensorNoise& noise, uint64_t seed)
{
    if (!(noise.electrons > 0)) return;
    const auto sigma = [&](float value) {
        return std::sqrt(std::max(0.0, double(value)) * noise.electrons + noise.readElectrons * noise.readElectrons) / noise.electrons;
    };
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        Random random(seed, i);
        const glm::dvec2 a = normalPair(random), b = normalPair(random);
        const double normals[3] = {a.x, a.y, b.x};
        for (size_t c = 0; c < 3; ++c) image.rgba[i + c] += float(sigma(image.rgba[i + c]) * normals[c]);
    }
}

std::vector<uint8_t> displayRgb(const Image& image)
{
    std::vector<uint8_t> out;
    out.reserve(image.rgba.size() / 4 * 3);
    for (size_t i = 0; i < image.rgba.size(); ++i)
        if (i % 4 != 3) out.push_back(uint8_t(std::lround(255.0f * srgbFromLinear(std::clamp(image.rgba[i], 0.0f, 1.0f)))));
    return out;
}

std::vector<uint8_t> imperfectMatte(const Image& image, double spill, int holes, uint64_t seed)
{
    const int width = image.width, height = image.height, reach = int(std::ceil(1.5 * spill));
    const auto ramp = [&](int dx, int dy) { // 1/2 at a distance of `spill`
        return spill > 0 ? float(std::clamp(1.5 - std::hypot(dx, dy) / spill, 0.0, 1.0)) : 1.0f;
    };
    std::vector<float> matte(size_t(width) * size_t(height));
    std::vector<size_t> covered;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const size_t at = size_t(y) * size_t(width) + size_t(x);
            const float own = image.pixel(x, y)[3];
            if (own > 0.5f) covered.push_back(at);
            if (!(own > 0)) continue;
            for (int j = std::max(0, y - reach); j <= std::min(height - 1, y + reach); ++j)
                for (int i = std::max(0, x - reach); i <= std::min(width - 1, x + reach); ++i) {
                    float& to = matte[size_t(j) * size_t(width) + size_t(i)];
                    if (to < own) to = std::max(to, own * ramp(i - x, j - y));
                }
        }
    Random random(seed);
    for (int h = 0; h < holes && !covered.empty(); ++h) {
        const size_t at = covered[random.below(uint32_t(covered.size()))];
        const double radius = (0.01 + 0.02 * double(random.uniform())) * std::min(width, height);
        const int cx = int(at % size_t(width)), cy = int(at / size_t(width)), r = int(std::ceil(radius));
        for (int j = std::max(0, cy - r); j <= std::min(height - 1, cy + r); ++j)
            for (int i = std::max(0, cx - r); i <= std::min(width - 1, cx + r); ++i)
                if (std::hypot(i - cx, j - cy) <= radius) matte[size_t(j) * size_t(width) + size_t(i)] = 0;
    }
    std::vector<uint8_t> out;
    for (const float m : matte) out.push_back(uint8_t(std::lround(255.0f * m)));
    return out;
}

} // namespace nacre
