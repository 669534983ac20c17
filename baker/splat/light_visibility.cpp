// For every direction the splats are seen from infinity: sorted by depth and drawn front to back into one small image of transmittance.
// A splat reads the image at its centre before anything within `bias` of it has been drawn. Lights among the splats see them through the
// six faces of a cube in the same way.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "splat/light_visibility.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "render/aligned_vector.h"
#include "render/simd_math-inl.h"
#include "splat/light_visibility.h"

#include <algorithm>
#include <cmath>

#ifndef NACRE_LIGHT_VISIBILITY_SHARED
#define NACRE_LIGHT_VISIBILITY_SHARED
namespace nacre {

constexpr int kShadowSize = 128;            // pixels per side of the image of transmittance
constexpr int kShadowRow = kShadowSize + 16; // floats per row: whole vectors may be written beyond the last pixel
constexpr float kShadowLowPass = 0.1f;      // px^2
constexpr float kLeastAlpha = 0.01f;

/// A splat in the image: alpha = opacity * exp(-(a dx^2 + b dx dy + c dy^2)).
struct FlatSplat {
    float x, y, depth, a, b, c, opacity;
};

} // namespace nacre
#endif

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Multiplies what the splat lets through into the image.
void drawShadow(const FlatSplat& s, float* image)
{
    const hn::ScalableTag<float> d;
    const float reach = std::log(s.opacity / kLeastAlpha), det = 4 * s.a * s.c - s.b * s.b;
    if (!(reach > 0) || !(det > 0)) return;
    const float ex = std::sqrt(4 * s.c * reach / det), ey = std::sqrt(4 * s.a * reach / det);
    if (!(ex < 1e6f && ey < 1e6f)) return;
    const int x0 = std::max(0, int(std::ceil(s.x - ex - 0.5f))), x1 = std::min(kShadowSize - 1, int(std::floor(s.x + ex - 0.5f)));
    const int y0 = std::max(0, int(std::ceil(s.y - ey - 0.5f))), y1 = std::min(kShadowSize - 1, int(std::floor(s.y + ey - 0.5f)));
    const auto lanes = hn::Iota(d, 0.5f - s.x);
    const auto limit = hn::Set(d, reach), one = hn::Set(d, 1.0f), most = hn::Set(d, 0.999f);
    for (int y = y0; y <= y1; ++y) {
        const float dy = float(y) + 0.5f - s.y;
        const auto cy = hn::Set(d, s.c * dy * dy), by = hn::Set(d, s.b * dy);
        for (int x = x0; x <= x1; x += int(hn::Lanes(d))) {
            float* at = image + y * kShadowRow + x;
            const auto dx = hn::Add(lanes, hn::Set(d, float(x)));
            const auto q = hn::MulAdd(hn::MulAdd(hn::Set(d, s.a), dx, by), dx, cy);
            const auto shape = exp2(d, hn::Mul(hn::Min(q, limit), hn::Set(d, -1.44269504f)));
            const auto alpha = hn::IfThenElseZero(hn::Lt(q, limit), hn::Min(hn::Mul(hn::Set(d, s.opacity), shape), most));
            hn::StoreU(hn::Mul(hn::LoadU(d, at), hn::Sub(one, alpha)), d, at);
        }
    }
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include "base/radix_sort.h"
#include "splat/splat_grid.h"
#include "appearance/visibility_map.h"

#include <glm/glm.hpp>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace nacre {

HWY_EXPORT(drawShadow);

namespace {

/// What no direction changes.
struct Scene {
    std::span<const GaussianGeometry<float>> splats;
    std::vector<glm::mat3> axes; // columns: the local axes times the standard deviations
    glm::vec3 center{0};
    float radius = 0, bias = 0;
};

// One splat far away must not make the pixels of all others coarse.
void limitBox(std::span<const GaussianGeometry<float>> splats, glm::vec3& lo, glm::vec3& hi)
{
    constexpr double kOutside = 0.01; // of the splats, on each side of each axis
    constexpr float kAround = 1.0f;   // of the size of the rest, on each side
    std::vector<float> along(splats.size());
    const auto outside = ptrdiff_t(kOutside * double(splats.size()));
    for (int k = 0; k < 3; ++k) {
        for (size_t i = 0; i < splats.size(); ++i) along[i] = splats[i].position[k];
        std::nth_element(along.begin(), along.begin() + outside, along.end());
        const float low = along[size_t(outside)];
        std::nth_element(along.begin(), along.end() - 1 - outside, along.end());
        const float high = *(along.end() - 1 - outside);
        lo[k] = std::max(lo[k], low - kAround * (high - low)), hi[k] = std::min(hi[k], high + kAround * (high - low));
    }
}

Scene prepareScene(std::span<const GaussianGeometry<float>> splats)
{
    Scene scene{splats, {}};
    glm::vec3 lo(std::numeric_limits<float>::max()), hi(-lo);
    for (const GaussianGeometry<float>& g : splats) {
        float unit[4], m[9];
        detail::normalizeQuaternion(g.rotation, unit);
        detail::rotationMatrix(unit, m);
        glm::mat3& axes = scene.axes.emplace_back();
        for (int k = 0; k < 3; ++k) axes[k] = g.scale[k] * glm::vec3(m[k], m[3 + k], m[6 + k]);
        const glm::vec3 p(g.position[0], g.position[1], g.position[2]);
        lo = glm::min(lo, p), hi = glm::max(hi, p);
    }
    limitBox(splats, lo, hi);
    scene.bias = visibilityBias(splats);
    scene.center = 0.5f * (lo + hi);
    scene.radius = std::max(0.5f * glm::length(hi - lo), 1e-6f);
    return scene;
}

struct Workspace {
    std::vector<FlatSplat> flat;
    std::vector<uint32_t> keys, order;
    RadixScratch<uint32_t> scratch;
    AlignedVector<float> image;
    std::vector<float> sum; // per splat, over the directions of a texel
    std::vector<uint32_t> splats; // of flat, where these are not all
};

/// a, b: rows of the projection times the local axes, in pixels.
FlatSplat flatSplat(float x, float y, float depth, const glm::vec3& a, const glm::vec3& b, float opacity)
{
    const float aa = glm::dot(a, a), ab = glm::dot(a, b), bb = glm::dot(b, b);
    const glm::vec3 n = glm::cross(a, b);
    const float raw = glm::dot(n, n), det = raw + kShadowLowPass * (aa + bb) + kShadowLowPass * kShadowLowPass;
    return {x, y, depth, 0.5f * (bb + kShadowLowPass) / det, -ab / det, 0.5f * (aa + kShadowLowPass) / det, opacity * std::sqrt(raw / det)};
}

/// The splats as seen against the direction w (unit), the object's sphere filling the image.
void flatten(const Scene& scene, const glm::vec3& w, Workspace& work)
{
    const float scale = 0.5f * float(kShadowSize) / scene.radius;
    const glm::vec3 side = std::abs(w.z) < 0.9f ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0);
    const glm::vec3 x = scale * glm::normalize(glm::cross(side, w)), y = glm::cross(w, x);
    const size_t n = scene.splats.size();
    work.flat.resize(n), work.keys.resize(n), work.order.resize(n);
    for (size_t i = 0; i < n; ++i) {
        const GaussianGeometry<float>& g = scene.splats[i];
        const glm::vec3 p = glm::vec3(g.position[0], g.position[1], g.position[2]) - scene.center;
        const glm::vec3 a = x * scene.axes[i], b = y * scene.axes[i];
        work.flat[i] = flatSplat(glm::dot(p, x) + 0.5f * kShadowSize, glm::dot(p, y) + 0.5f * kShadowSize, -glm::dot(p, w), a, b, g.opacity);
        work.keys[i] = radixKey(work.flat[i].depth), work.order[i] = uint32_t(i);
    }
    radixSort<uint32_t>(work.keys, work.order, work.scratch);
}

float bilinear(const float* image, float x, float y)
{
    x = std::clamp(x - 0.5f, 0.0f, float(kShadowSize) - 1.001f), y = std::clamp(y - 0.5f, 0.0f, float(kShadowSize) - 1.001f);
    const int i = int(x), j = int(y);
    const float fx = x - float(i), fy = y - float(j), *row = image + j * kShadowRow + i, *next = row + kShadowRow;
    return (1 - fy) * ((1 - fx) * row[0] + fx * row[1]) + fy * ((1 - fx) * next[0] + fx * next[1]);
}

/// Adds to work.sum what arrives from direction w.
void addDirection(const Scene& scene, const glm::vec3& w, Workspace& work)
{
    const auto draw = HWY_DYNAMIC_DISPATCH(drawShadow);
    flatten(scene, w, work);
    work.image.assign(size_t(kShadowRow) * kShadowSize, 1.0f);
    size_t drawn = 0;
    for (const uint32_t i : work.order) {
        const FlatSplat& s = work.flat[i];
        for (; work.flat[work.order[drawn]].depth < s.depth - scene.bias; ++drawn) draw(work.flat[work.order[drawn]], work.image.data());
        const bool inside = s.x >= -0.5f && s.x <= kShadowSize + 0.5f && s.y >= -0.5f && s.y <= kShadowSize + 0.5f; // of the limited box
        work.sum[i] += inside ? bilinear(work.image.data(), s.x, s.y) : 1.0f;
    }
}

/// The splats in front of a light as it sees them through one face of a cube around it, nearest first. Depth is the distance.
void flattenFace(const Scene& scene, const glm::vec3& light, int face, Workspace& work)
{
    constexpr float kBeside = 0.2f; // of the distance: what lies farther beside the face than this is in front of it does not reach into it
    const int along = face / 2;
    const float sign = face % 2 ? -1.0f : 1.0f, focal = 0.5f * float(kShadowSize);
    work.flat.clear(), work.keys.clear(), work.order.clear(), work.splats.clear();
    for (size_t i = 0; i < scene.splats.size(); ++i) {
        const GaussianGeometry<float>& g = scene.splats[i];
        const glm::vec3 p = glm::vec3(g.position[0], g.position[1], g.position[2]) - light;
        const float distance = glm::length(p), z = sign * p[along];
        if (!(z > kBeside * distance)) continue;
        const float u = p[(along + 1) % 3] / z, v = p[(along + 2) % 3] / z;
        glm::vec3 right(0), down(0); // gradient of u and v at the splat
        right[(along + 1) % 3] = down[(along + 2) % 3] = 1;
        right[along] = -sign * u, down[along] = -sign * v;
        const float scale = focal / z;
        work.order.push_back(uint32_t(work.flat.size())), work.splats.push_back(uint32_t(i));
        work.flat.push_back(flatSplat(focal * u + focal, focal * v + focal, distance, scale * right * scene.axes[i], scale * down * scene.axes[i], g.opacity));
        work.keys.push_back(radixKey(distance));
    }
    radixSort<uint32_t>(work.keys, work.order, work.scratch);
}

/// arrives[splat]: the transmittance between a light and each splat, 255 = all.
void drawFromLight(const Scene& scene, const glm::vec3& light, Workspace& work, uint8_t* arrives)
{
    const auto draw = HWY_DYNAMIC_DISPATCH(drawShadow);
    std::fill_n(arrives, scene.splats.size(), uint8_t(255));
    for (int face = 0; face < 6; ++face) {
        flattenFace(scene, light, face, work);
        work.image.assign(size_t(kShadowRow) * kShadowSize, 1.0f);
        size_t drawn = 0;
        for (const uint32_t i : work.order) {
            const FlatSplat& s = work.flat[i];
            for (; work.flat[work.order[drawn]].depth < s.depth - scene.bias; ++drawn) draw(work.flat[work.order[drawn]], work.image.data());
            if (s.x >= 0 && s.x <= kShadowSize && s.y >= 0 && s.y <= kShadowSize)
                arrives[work.splats[i]] = uint8_t(std::lround(255 * bilinear(work.image.data(), s.x, s.y)));
        }
    }
}

/// Texel (u, v) of the map from a unit direction: the inverse of octahedralDirection, in texels from the first one's centre.
glm::vec2 octahedralPlace(const glm::vec3& w, int size)
{
    const glm::vec3 p = w / (std::abs(w.x) + std::abs(w.y) + std::abs(w.z));
    glm::vec2 uv(p.x, p.y);
    if (p.z < 0) uv = {(1 - std::abs(p.y)) * (p.x < 0 ? -1.0f : 1.0f), (1 - std::abs(p.x)) * (p.y < 0 ? -1.0f : 1.0f)};
    return 0.5f * float(size) * (uv + 1.0f) - 0.5f;
}

/// Replaces the four texels that a splat looks up towards each light among the splats; where several lights meet, their mean.
bool lookAtNearLights(const Scene& scene, std::span<const glm::vec3> lights, int size, const std::function<bool()>& goOn, std::vector<uint8_t>& maps)
{
    constexpr size_t kMostBytes = size_t(1) << 28, kMostLights = 512; // lights are left out evenly beyond
    std::vector<glm::vec3> all, near;
    for (const glm::vec3& light : lights)
        if (glm::distance(light, scene.center) < scene.radius) all.push_back(light);
    const size_t n = scene.splats.size(), texels = size_t(size) * size_t(size);
    const size_t count = std::min({all.size(), kMostLights, std::max<size_t>(1, kMostBytes / n)});
    for (size_t k = 0; k < count; ++k) near.push_back(all[k * all.size() / count]);

    std::vector<uint8_t> arrives(near.size() * n);
    tbb::enumerable_thread_specific<Workspace> workspaces;
    const size_t atOnce = size_t(tbb::this_task_arena::max_concurrency());
    for (size_t first = 0; first < near.size(); first += atOnce) {
        if (goOn && !goOn()) return false;
        tbb::parallel_for(first, std::min(first + atOnce, near.size()),
                          [&](size_t l) { drawFromLight(scene, near[l], workspaces.local(), &arrives[l * n]); });
    }
    if (near.empty()) return true;
    tbb::parallel_for(size_t(0), n, [&](size_t i) {
        std::vector<std::pair<uint32_t, uint32_t>> sums(texels); // of what arrives, and how many
        const float* position = scene.splats[i].position;
        for (size_t l = 0; l < near.size(); ++l) {
            const glm::vec3 toLight = near[l] - glm::vec3(position[0], position[1], position[2]);
            if (!(glm::length(toLight) > scene.bias)) continue;
            const glm::vec2 place = octahedralPlace(glm::normalize(toLight), size);
            const int x = int(std::floor(place.x)), y = int(std::floor(place.y));
            for (int j = 0; j < 4; ++j) {
                auto& [sum, lightsHere] = sums[size_t(visibilityTexel(x + j % 2, y + j / 2, size))];
                sum += arrives[l * n + i], ++lightsHere;
            }
        }
        for (size_t t = 0; t < texels; ++t)
            if (sums[t].second > 0) maps[i * texels + t] = uint8_t((sums[t].first + sums[t].second / 2) / sums[t].second);
    });
    return true;
}

} // namespace

float visibilityBias(std::span<const GaussianGeometry<float>> splats)
{
    constexpr float kBias = 4; // in median splat sizes
    return kBias * medianSplatSize(splats);
}

glm::vec3 octahedralDirection(float u, float v) // in [-1, 1]
{
    const float z = 1 - std::abs(u) - std::abs(v);
    if (z >= 0) return glm::normalize(glm::vec3(u, v, z));
    return glm::normalize(glm::vec3((1 - std::abs(v)) * (u < 0 ? -1.0f : 1.0f), (1 - std::abs(u)) * (v < 0 ? -1.0f : 1.0f), z));
}

std::vector<uint8_t> lightVisibility(std::span<const GaussianGeometry<float>> splats, int size, int oversample,
                                     std::span<const glm::vec3> lights, const std::function<bool()>& goOn)
{
    const size_t n = splats.size(), texels = size_t(size) * size_t(size);
    if (n == 0) return {};
    constexpr size_t kManySplats = 100000; // a texel of so many takes a tenth of a second
    const Scene scene = prepareScene(splats);
    std::vector<uint8_t> byTexel(texels * n), maps(n * texels);
    tbb::enumerable_thread_specific<Workspace> workspaces;
    const auto drawTexel = [&](size_t texel) {
        Workspace& work = workspaces.local();
        work.sum.assign(n, 0.0f);
        const int fine = size * oversample, i0 = int(texel) % size * oversample, j0 = int(texel) / size * oversample;
        for (int j = j0; j < j0 + oversample; ++j)
            for (int i = i0; i < i0 + oversample; ++i)
                addDirection(scene, octahedralDirection((2 * float(i) + 1) / float(fine) - 1, (2 * float(j) + 1) / float(fine) - 1), work);
        const float scale = 255.0f / float(oversample * oversample);
        for (size_t k = 0; k < n; ++k) byTexel[texel * n + k] = uint8_t(std::lround(scale * work.sum[k]));
    };
    const size_t atOnce = size_t(tbb::this_task_arena::max_concurrency()) * (n < kManySplats ? 4 : 1);
    for (size_t first = 0; first < texels; first += atOnce) {
        if (goOn && !goOn()) return {};
        tbb::parallel_for(first, std::min(first + atOnce, texels), drawTexel);
    }
    tbb::parallel_for(size_t(0), n, [&](size_t k) {
        for (size_t t = 0; t < texels; ++t) maps[k * texels + t] = byTexel[t * n + k];
    });
    return lookAtNearLights(scene, lights, size, goOn, maps) ? maps : std::vector<uint8_t>();
}

} // namespace nacre
#endif
