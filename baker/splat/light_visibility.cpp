// What appearance/splat_visibility.h draws, on all cores and several pixels at a time. Lights among the splats see them through the six faces
// of a cube in the same way.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "splat/light_visibility.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "render/simd_math-inl.h"
#include "splat/light_visibility.h"

#include <algorithm>
#include <cmath>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// drawShadowScalar (appearance/splat_visibility.h), several pixels at a time.
void drawShadow(const FlatSplat& s, float* image)
{
    const hn::ScalableTag<float> d;
    const ShadowReach r = shadowReach(s);
    const auto lanes = hn::Iota(d, 0.5f - s.x);
    const auto limit = hn::Set(d, r.reach), one = hn::Set(d, 1.0f), most = hn::Set(d, kShadowMostAlpha);
    for (int y = r.y0; y <= r.y1; ++y) {
        const float dy = float(y) + 0.5f - s.y;
        const auto cy = hn::Set(d, s.c * dy * dy), by = hn::Set(d, s.b * dy);
        for (int x = r.x0; x <= r.x1; x += int(hn::Lanes(d))) {
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
#include "render/cloud_geometry.h"
#include "splat/splat_grid.h"
#include "appearance/visibility_map.h"

#include <glm/glm.hpp>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace nacre {

HWY_EXPORT(drawShadow);

ShadowScene shadowScene(std::span<const GaussianGeometry<float>> splats)
{
    ShadowScene scene;
    for (const GaussianGeometry<float>& g : splats) {
        float unit[4], m[9];
        detail::normalizeQuaternion(g.rotation, unit);
        detail::rotationMatrix(unit, m);
        glm::mat3& axes = scene.axes.emplace_back();
        for (int k = 0; k < 3; ++k) axes[k] = g.scale[k] * glm::vec3(m[k], m[3 + k], m[6 + k]);
        scene.positions.push_back({g.position[0], g.position[1], g.position[2]});
        scene.opacities.push_back(g.opacity);
    }
    finishScene(scene, medianSplatSize(splats));
    return scene;
}

std::vector<glm::vec3> lightsAmong(const ShadowScene& scene, std::span<const glm::vec3> lights)
{
    constexpr size_t kMostBytes = size_t(1) << 28, kMostLights = 512;
    std::vector<glm::vec3> all, among;
    for (const glm::vec3& light : lights)
        if (glm::distance(light, scene.center) < scene.radius) all.push_back(light);
    const size_t count = std::min({all.size(), kMostLights, std::max<size_t>(1, kMostBytes / scene.count())});
    for (size_t k = 0; k < count; ++k) among.push_back(all[k * all.size() / count]);
    return among;
}

namespace {

/// The splats in front of a light as it sees them through one face of a cube around it, nearest first.
void flattenFace(const ShadowScene& scene, const glm::vec3& light, int face, ShadowWorkspace& work)
{
    work.flat.clear(), work.keys.clear(), work.order.clear(), work.splats.clear();
    FlatSplat flat;
    for (size_t i = 0; i < scene.count(); ++i) {
        if (!flatInFace(light, face, scene.positions[i], scene.axes[i], scene.opacities[i], flat)) continue;
        work.order.push_back(uint32_t(work.flat.size())), work.splats.push_back(uint32_t(i));
        work.flat.push_back(flat);
        work.keys.push_back(radixKey(flat.depth));
    }
    radixSort<uint32_t>(work.keys, work.order, work.scratch);
}

/// arrives[splat]: the transmittance between a light and each splat, 255 = all.
void drawFromLight(const ShadowScene& scene, const glm::vec3& light, ShadowWorkspace& work, uint8_t* arrives)
{
    const auto draw = HWY_DYNAMIC_DISPATCH(drawShadow);
    std::fill_n(arrives, scene.count(), uint8_t(255));
    for (int face = 0; face < 6; ++face) {
        flattenFace(scene, light, face, work);
        work.image.assign(size_t(kShadowRow) * kShadowSize, 1.0f);
        size_t drawn = 0;
        for (const uint32_t i : work.order) {
            const FlatSplat& s = work.flat[i];
            for (; work.flat[work.order[drawn]].depth < s.depth - scene.bias; ++drawn) draw(work.flat[work.order[drawn]], work.image.data());
            if (insideShadow(s, 0))
                arrives[work.splats[i]] = uint8_t(std::lround(255 * readShadow(work.image.data(), s.x, s.y)));
        }
    }
}

/// Replaces the four texels that a splat looks up towards each light among the splats; where several lights meet, their mean.
bool lookAtNearLights(const ShadowScene& scene, std::span<const glm::vec3> lights, int size, const std::function<bool()>& goOn, std::vector<uint8_t>& maps)
{
    const std::vector<glm::vec3> near = lightsAmong(scene, lights);
    const size_t n = scene.count(), texels = size_t(size) * size_t(size);
    std::vector<uint8_t> arrives(near.size() * n);
    tbb::enumerable_thread_specific<ShadowWorkspace> workspaces;
    const size_t atOnce = size_t(tbb::this_task_arena::max_concurrency());
    for (size_t first = 0; first < near.size(); first += atOnce) {
        if (goOn && !goOn()) return false;
        tbb::parallel_for(first, std::min(first + atOnce, near.size()),
                          [&](size_t l) { drawFromLight(scene, near[l], workspaces.local(), &arrives[l * n]); });
    }
    if (near.empty()) return true;
    tbb::parallel_for(size_t(0), n, [&](size_t i) {
        std::vector<std::pair<uint32_t, uint32_t>> sums(texels); // of what arrives, and how many
        for (size_t l = 0; l < near.size(); ++l) {
            int looked[4];
            if (!texelsTowards(near[l] - scene.positions[i], scene.bias, size, looked)) continue;
            for (const int texel : looked) {
                auto& [sum, lightsHere] = sums[size_t(texel)];
                sum += arrives[l * n + i], ++lightsHere;
            }
        }
        for (size_t t = 0; t < texels; ++t)
            if (sums[t].second > 0) maps[i * texels + t] = uint8_t((sums[t].first + sums[t].second / 2) / sums[t].second);
    });
    return true;
}

} // namespace

std::vector<uint8_t> lightVisibilityWithin(const glm::vec4& ball, std::span<const GaussianGeometry<float>> splats, int size, int oversample,
                                           std::span<const glm::vec3> lights, const std::function<bool()>& goOn, const VisibilityDrawer& drawer)
{
    const auto draw = [&](std::span<const GaussianGeometry<float>> these) {
        return drawer ? drawer(these, size, oversample, lights) : lightVisibility(these, size, oversample, lights, goOn);
    };
    if (!(ball.w > 0)) return draw(splats);
    std::vector<GaussianGeometry<float>> inside;
    std::vector<size_t> from;
    for (size_t i = 0; i < splats.size(); ++i) {
        const float* p = splats[i].position;
        if (glm::distance(glm::vec3(p[0], p[1], p[2]), glm::vec3(ball)) <= ball.w) inside.push_back(splats[i]), from.push_back(i);
    }
    const size_t texels = size_t(size) * size_t(size);
    std::vector<uint8_t> maps;
    if (!inside.empty() && (maps = draw(inside)).empty()) return {};
    std::vector<uint8_t> all(splats.size() * texels, 255);
    for (size_t k = 0; k < from.size(); ++k) std::copy_n(maps.begin() + ptrdiff_t(k * texels), texels, all.begin() + ptrdiff_t(from[k] * texels));
    return all;
}

float visibilityBias(std::span<const GaussianGeometry<float>> splats) { return visibilityBias(medianSplatSize(splats)); }

std::vector<uint8_t> lightVisibility(std::span<const GaussianGeometry<float>> splats, int size, int oversample,
                                     std::span<const glm::vec3> lights, const std::function<bool()>& goOn)
{
    const size_t n = splats.size(), texels = size_t(size) * size_t(size);
    if (n == 0) return {};
    constexpr size_t kManySplats = 100000; // a texel of so many takes a tenth of a second
    const ShadowScene scene = shadowScene(splats);
    std::vector<uint8_t> byTexel(texels * n), maps(n * texels);
    tbb::enumerable_thread_specific<ShadowWorkspace> workspaces;
    // Looked up at each call: the first one, which chooses the target, must not be the one that is kept.
    const auto draw = [](const FlatSplat& splat, float* image) { HWY_DYNAMIC_DISPATCH(drawShadow)(splat, image); };
    const auto drawOne = [&](size_t texel) {
        ShadowWorkspace& work = workspaces.local();
        drawTexel(scene, size, int(texel), oversample, draw, work);
        for (size_t k = 0; k < n; ++k) byTexel[texel * n + k] = uint8_t(std::lround(work.sum[k]));
    };
    const size_t atOnce = size_t(tbb::this_task_arena::max_concurrency()) * (n < kManySplats ? 4 : 1);
    for (size_t first = 0; first < texels; first += atOnce) {
        if (goOn && !goOn()) return {};
        tbb::parallel_for(first, std::min(first + atOnce, texels), drawOne);
    }
    tbb::parallel_for(size_t(0), n, [&](size_t k) {
        for (size_t t = 0; t < texels; ++t) maps[k * texels + t] = byTexel[t * n + k];
    });
    return lookAtNearLights(scene, lights, size, goOn, maps) ? maps : std::vector<uint8_t>();
}

void drawVisibilityInParallel(SplatAsset& asset)
{
    if (asset.drawnVisibility == 0) return;
    Channel maps;
    maps.name = "visibility", maps.components = uint32_t(asset.drawnVisibility * asset.drawnVisibility);
    maps.bytes = lightVisibility(geometryOf(asset.cloud), asset.drawnVisibility, 1);
    asset.channels.push_back(std::move(maps)), asset.drawnVisibility = 0;
}

} // namespace nacre
#endif
