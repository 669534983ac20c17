// A splat in an image of transmittance (splat_visibility.h): per-item mathematics of all who draw them. Host and device.
#pragma once

#include "base/host_device.h"
#include "base/octahedral.h"

#include <glm/glm.hpp>

#include <algorithm>
#include <cmath>

namespace nacre {

constexpr int kShadowSize = 128;             // pixels per side of the image of transmittance
constexpr float kShadowLowPass = 0.1f;       // px^2
constexpr float kShadowLeastAlpha = 0.01f, kShadowMostAlpha = 0.999f;

/// A splat in the image: alpha = opacity * exp(-(a dx^2 + b dx dy + c dy^2)).
struct FlatSplat {
    float x, y, depth, a, b, c, opacity;
};

/// a, b: rows of the projection times the local axes, in pixels.
NACRE_HD inline FlatSplat flatSplat(float x, float y, float depth, const glm::vec3& a, const glm::vec3& b, float opacity)
{
    const float aa = glm::dot(a, a), ab = glm::dot(a, b), bb = glm::dot(b, b);
    const glm::vec3 n = glm::cross(a, b);
    const float raw = glm::dot(n, n), det = raw + kShadowLowPass * (aa + bb) + kShadowLowPass * kShadowLowPass;
    return {x, y, depth, 0.5f * (bb + kShadowLowPass) / det, -ab / det, 0.5f * (aa + kShadowLowPass) / det, opacity * std::sqrt(raw / det)};
}

/// The oversample^2 directions of a texel of maps of size^2.
template <class Visit>
inline void forTexelDirections(int size, int texel, int oversample, const Visit& visit)
{
    const int fine = size * oversample, i0 = texel % size * oversample, j0 = texel / size * oversample;
    for (int j = j0; j < j0 + oversample; ++j)
        for (int i = i0; i < i0 + oversample; ++i) visit(octahedralDirection((2 * float(i) + 1) / float(fine) - 1, (2 * float(j) + 1) / float(fine) - 1));
}

/// How a direction sees splats from infinity, the sphere around them filling the image.
struct ShadowDirection {
    glm::vec3 center, w, x, y; // w: unit; x, y: in pixels
};

inline ShadowDirection shadowDirection(const glm::vec3& center, float radius, const glm::vec3& w)
{
    const float scale = 0.5f * float(kShadowSize) / radius;
    const glm::vec3 side = std::abs(w.z) < 0.9f ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0);
    const glm::vec3 x = scale * glm::normalize(glm::cross(side, w));
    return {center, w, x, glm::cross(w, x)};
}

NACRE_HD inline FlatSplat flatAlong(const ShadowDirection& view, const glm::vec3& position, const glm::mat3& axes, float opacity)
{
    const glm::vec3 p = position - view.center, a = view.x * axes, b = view.y * axes;
    return flatSplat(glm::dot(p, view.x) + 0.5f * kShadowSize, glm::dot(p, view.y) + 0.5f * kShadowSize, -glm::dot(p, view.w), a, b, opacity);
}

/// A splat as a light sees it through one face of a cube around it; depth is the distance. False if it is not in front of the face.
NACRE_HD inline bool flatInFace(const glm::vec3& light, int face, const glm::vec3& position, const glm::mat3& axes, float opacity, FlatSplat& out)
{
    constexpr float kBeside = 0.2f; // of the distance: what lies farther beside the face than this is in front of it does not reach into it
    const int along = face / 2;
    const float sign = face % 2 ? -1.0f : 1.0f, focal = 0.5f * float(kShadowSize);
    const glm::vec3 p = position - light;
    const float distance = glm::length(p), z = sign * p[along];
    if (!(z > kBeside * distance)) return false;
    const float u = p[(along + 1) % 3] / z, v = p[(along + 2) % 3] / z;
    glm::vec3 right(0), down(0); // gradient of u and v at the splat
    right[(along + 1) % 3] = down[(along + 2) % 3] = 1;
    right[along] = -sign * u, down[along] = -sign * v;
    const float scale = focal / z;
    out = flatSplat(focal * u + focal, focal * v + focal, distance, scale * right * axes, scale * down * axes, opacity);
    return true;
}

/// The pixels that a splat reaches: its alpha is kShadowLeastAlpha or more where a dx^2 + b dx dy + c dy^2 <= reach. Empty: x1 < x0.
struct ShadowReach {
    int x0 = 0, x1 = -1, y0 = 0, y1 = -1;
    float reach = 0;
};

NACRE_HD inline ShadowReach shadowReach(const FlatSplat& s)
{
    const float reach = std::log(s.opacity / kShadowLeastAlpha), det = 4 * s.a * s.c - s.b * s.b;
    if (!(reach > 0) || !(det > 0)) return {};
    const float ex = std::sqrt(4 * s.c * reach / det), ey = std::sqrt(4 * s.a * reach / det);
    if (!(ex < 1e6f && ey < 1e6f)) return {};
    return {std::max(0, int(std::ceil(s.x - ex - 0.5f))), std::min(kShadowSize - 1, int(std::floor(s.x + ex - 0.5f))), std::max(0, int(std::ceil(s.y - ey - 0.5f))),
            std::min(kShadowSize - 1, int(std::floor(s.y + ey - 0.5f))), reach};
}

/// Where a splat reads the image, between four pixels.
struct ShadowPlace {
    int x, y; // of the first; the others are one to the right and one down
    float fx, fy;

    NACRE_HD float value(float here, float right, float below, float across) const { return (1 - fy) * ((1 - fx) * here + fx * right) + fy * ((1 - fx) * below + fx * across); }
};

NACRE_HD inline ShadowPlace shadowPlace(float x, float y)
{
    x = std::clamp(x - 0.5f, 0.0f, float(kShadowSize) - 1.001f), y = std::clamp(y - 0.5f, 0.0f, float(kShadowSize) - 1.001f);
    return {int(x), int(y), x - float(int(x)), y - float(int(y))};
}

/// Whether a splat reads the image at all: those that lie farther than `margin` pixels beside it get all light.
NACRE_HD inline bool insideShadow(const FlatSplat& s, float margin)
{
    return s.x >= -margin && s.x <= kShadowSize + margin && s.y >= -margin && s.y <= kShadowSize + margin;
}
constexpr float kShadowMargin = 0.5f; // of directions; that of faces is 0

} // namespace nacre
