#include "light_stage/environment_light.h"

#include <algorithm>

namespace nacre::stage {

namespace {

constexpr double kPiD = std::numbers::pi;

/// Index i with cdf[i] <= u < cdf[i + 1] and how far u lies in that interval.
int searchCdf(const double* cdf, int count, double u, double* fraction)
{
    u *= cdf[count];
    const int i = std::clamp(int(std::upper_bound(cdf, cdf + count + 1, u) - cdf) - 1, 0, count - 1);
    const double width = cdf[i + 1] - cdf[i];
    *fraction = width > 0.0 ? std::min(0.999999, (u - cdf[i]) / width) : 0.5;
    return i;
}

} // namespace

EnvironmentLight::EnvironmentLight(const Image& map, const glm::vec3& scale)
    : width_(map.width), height_(map.height), texels_(size_t(map.width) * size_t(map.height)), density_(texels_.size()),
      rowCdf_(size_t(map.height) + 1), columnCdf_(size_t(map.height) * (size_t(map.width) + 1))
{
    for (int y = 0; y < height_; ++y) {
        const double solidAngle = 2.0 * kPiD / width_ * (std::cos(kPiD * y / height_) - std::cos(kPiD * (y + 1) / height_));
        double* cdf = columnCdf_.data() + size_t(y) * (size_t(width_) + 1);
        for (int x = 0; x < width_; ++x) {
            const float* p = map.pixel(x, y);
            glm::vec3& texel = texels_[size_t(y) * size_t(width_) + size_t(x)];
            texel = glm::max(glm::vec3(p[0], p[1], p[2]) * scale, 0.0f);
            cdf[x + 1] = cdf[x] + double(luminance(texel)) * solidAngle;
        }
        rowCdf_[size_t(y) + 1] = rowCdf_[size_t(y)] + cdf[width_];
    }
    const double total = rowCdf_.back();
    if (total > 0.0)
        for (size_t i = 0; i < texels_.size(); ++i) density_[i] = float(double(luminance(texels_[i])) / total);
}

size_t EnvironmentLight::texelOf(const glm::vec3& d) const
{
    const float u = 0.5f - std::atan2(d.y, d.x) / (2.0f * kPi), v = std::acos(std::clamp(d.z, -1.0f, 1.0f)) / kPi;
    const int x = std::clamp(int(u * float(width_)), 0, width_ - 1), y = std::clamp(int(v * float(height_)), 0, height_ - 1);
    return size_t(y) * size_t(width_) + size_t(x);
}

bool EnvironmentLight::sample(const glm::vec2& u, glm::vec3* direction, glm::vec3* radiance, float* pdf) const
{
    if (!(rowCdf_.back() > 0.0)) return false;
    double fx = 0, fy = 0;
    const int y = searchCdf(rowCdf_.data(), height_, u.y, &fy);
    const int x = searchCdf(columnCdf_.data() + size_t(y) * (size_t(width_) + 1), width_, u.x, &fx);
    // Uniform within the texel: in azimuth and in cos(theta).
    const double z0 = std::cos(kPiD * y / height_), z1 = std::cos(kPiD * (y + 1) / height_), z = z0 + (z1 - z0) * fy;
    const double r = std::sqrt(std::max(0.0, 1.0 - z * z)), phi = kPiD - 2.0 * kPiD * (x + fx) / width_;
    *direction = {float(r * std::cos(phi)), float(r * std::sin(phi)), float(z)};
    const size_t texel = size_t(y) * size_t(width_) + size_t(x);
    *radiance = texels_[texel];
    *pdf = density_[texel];
    return *pdf > 0.0f;
}

} // namespace nacre::stage
