// For every direction the splats are seen from infinity: sorted by depth and drawn front to back into one small image of transmittance.
// A splat reads the image at its centre before anything within `bias` of it has been drawn.
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

#include <glm/glm.hpp>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

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
};

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
        const float aa = glm::dot(a, a), ab = glm::dot(a, b), bb = glm::dot(b, b);
        const glm::vec3 n2 = glm::cross(a, b);
        const float raw = glm::dot(n2, n2), det = raw + kShadowLowPass * (aa + bb) + kShadowLowPass * kShadowLowPass;
        work.flat[i] = {glm::dot(p, x) + 0.5f * kShadowSize, glm::dot(p, y) + 0.5f * kShadowSize, -glm::dot(p, w),
                        0.5f * (bb + kShadowLowPass) / det, -ab / det, 0.5f * (aa + kShadowLowPass) / det, g.opacity * std::sqrt(raw / det)};
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
        work.sum[i] += bilinear(work.image.data(), s.x, s.y);
    }
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

std::vector<uint8_t> lightVisibility(std::span<const GaussianGeometry<float>> splats, int size, int oversample)
{
    const size_t n = splats.size(), texels = size_t(size) * size_t(size);
    if (n == 0) return {};
    const Scene scene = prepareScene(splats);
    std::vector<uint8_t> byTexel(texels * n), maps(n * texels);
    tbb::enumerable_thread_specific<Workspace> workspaces;
    tbb::parallel_for(size_t(0), texels, [&](size_t texel) {
        Workspace& work = workspaces.local();
        work.sum.assign(n, 0.0f);
        const int fine = size * oversample, i0 = int(texel) % size * oversample, j0 = int(texel) / size * oversample;
        for (int j = j0; j < j0 + oversample; ++j)
            for (int i = i0; i < i0 + oversample; ++i)
                addDirection(scene, octahedralDirection((2 * float(i) + 1) / float(fine) - 1, (2 * float(j) + 1) / float(fine) - 1), work);
        const float scale = 255.0f / float(oversample * oversample);
        for (size_t k = 0; k < n; ++k) byTexel[texel * n + k] = uint8_t(std::lround(scale * work.sum[k]));
    });
    tbb::parallel_for(size_t(0), n, [&](size_t k) {
        for (size_t t = 0; t < texels; ++t) maps[k * texels + t] = byTexel[t * n + k];
    });
    return maps;
}

} // namespace nacre
#endif
