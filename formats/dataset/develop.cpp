#include "dataset/develop.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

bool hasLens(const FileCamera& file)
{
    return std::any_of(std::begin(file.k), std::end(file.k), [](double k) { return k != 0; }) || file.p[0] != 0 || file.p[1] != 0;
}

/// Weights of the four pixels around a position that is `t` beyond the second.
void cubicWeights(float t, float w[4])
{
    w[0] = ((-0.5f * t + 1.0f) * t - 0.5f) * t;
    w[1] = (1.5f * t - 2.5f) * t * t + 1.0f;
    w[2] = ((-1.5f * t + 2.0f) * t + 0.5f) * t;
    w[3] = (0.5f * t - 0.5f) * t * t;
}

void sample(const Image& image, const glm::dvec2& at, float out[4])
{
    const double x = at.x - 0.5, y = at.y - 0.5; // pixel centres
    out[0] = out[1] = out[2] = 0, out[3] = kUnknownAlpha;
    if (!(x >= -0.5 && y >= -0.5 && x <= image.width - 0.5 && y <= image.height - 0.5)) return;
    const int x0 = int(std::floor(x)), y0 = int(std::floor(y));
    float wx[4], wy[4], sum[4] = {};
    cubicWeights(float(x - x0), wx), cubicWeights(float(y - y0), wy);
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i) {
            const float w = wx[i] * wy[j];
            const float* p = image.pixel(std::clamp(x0 - 1 + i, 0, image.width - 1), std::clamp(y0 - 1 + j, 0, image.height - 1));
            if (p[3] < 0) {
                if (w != 0) return;
                continue;
            }
            for (int c = 0; c < 4; ++c) sum[c] += w * p[c];
        }
    std::copy_n(sum, 4, out);
    out[3] = std::clamp(out[3], 0.0f, 1.0f);
}

} // namespace

glm::dvec2 positionInFile(const FileCamera& file, const Camera& camera, double px, double py)
{
    const double x = (px - camera.cx) / camera.fx, y = (py - camera.cy) / camera.fy; // y down, as OpenCV has it
    const double r2 = x * x + y * y;
    const double* k = file.k;
    const double numerator = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2])), denominator = 1 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]));
    // d(r radial)/dr: where it is not positive, two directions meet in one pixel
    const double dNumerator = 1 + r2 * (3 * k[0] + r2 * (5 * k[1] + r2 * 7 * k[2])), dDenominator = r2 * (2 * k[3] + r2 * (4 * k[4] + r2 * 6 * k[5]));
    if (!(denominator > 0 && numerator > 0 && dNumerator * denominator - numerator * dDenominator > 0)) return {kNan, kNan};
    const double radial = numerator / denominator;
    const double dx = 2 * file.p[0] * x * y + file.p[1] * (r2 + 2 * x * x), dy = file.p[0] * (r2 + 2 * y * y) + 2 * file.p[1] * x * y;
    return {file.fx * (x * radial + dx) + file.cx, file.fy * (y * radial + dy) + file.cy};
}

Image resampled(const Image& image, const FileCamera& file, const Camera& camera)
{
    Image out{camera.width, camera.height, {}};
    out.rgba.resize(size_t(4) * camera.width * camera.height);
    const double left = file.cx - camera.cx, top = file.cy - camera.cy;
    const bool isPart = !hasLens(file) && file.fx == camera.fx && file.fy == camera.fy && std::fabs(left - std::round(left)) < 1e-6 &&
                        std::fabs(top - std::round(top)) < 1e-6;
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            float* to = out.pixel(x, y);
            if (!isPart) {
                sample(image, positionInFile(file, camera, x + 0.5, y + 0.5), to);
                continue;
            }
            const double fromX = x + std::round(left), fromY = y + std::round(top);
            if (fromX >= 0 && fromY >= 0 && fromX < image.width && fromY < image.height) std::copy_n(image.pixel(int(fromX), int(fromY)), 4, to);
            else to[3] = kUnknownAlpha;
        }
    return out;
}

void subtractAmbient(Image& image, const Image& ambient)
{
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        if (image.rgba[i + 3] < 0) continue;
        if (ambient.rgba[i + 3] < 0) {
            image.rgba[i] = image.rgba[i + 1] = image.rgba[i + 2] = 0, image.rgba[i + 3] = kUnknownAlpha;
            continue;
        }
        for (size_t c = 0; c < 3; ++c) image.rgba[i + c] -= ambient.rgba[i + c];
    }
}

void applyMask(Image& image, const Image& mask)
{
    float leastAlpha = 1, brightest = 0;
    for (size_t i = 0; i < mask.rgba.size(); i += 4) leastAlpha = std::min(leastAlpha, mask.rgba[i + 3]), brightest = std::max(brightest, mask.rgba[i]);
    const bool isAlpha = leastAlpha < 1;
    const float scale = !isAlpha && brightest > 0 && brightest <= 1.01f / 255 ? 1 / brightest : 1.0f;
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        const float coverage = std::clamp(scale * mask.rgba[i + (isAlpha ? 3 : 0)], 0.0f, 1.0f);
        if (image.rgba[i + 3] < 0) {
            if (coverage == 0) image.rgba[i + 3] = 0; // saturated, and not the object: background all the same
            continue;
        }
        for (size_t c = 0; c < 4; ++c) image.rgba[i + c] *= coverage;
    }
}

} // namespace nacre
