#include "appearance/splat_visibility.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace nacre {

namespace {

// One splat far away must not make the pixels of all others coarse.
void limitBox(std::span<const glm::vec3> splats, glm::vec3& lo, glm::vec3& hi)
{
    constexpr double kOutside = 0.01; // of the splats, on each side of each axis
    constexpr float kAround = 1.0f;   // of the size of the rest, on each side
    std::vector<float> along(splats.size());
    const auto outside = ptrdiff_t(kOutside * double(splats.size()));
    for (int k = 0; k < 3; ++k) {
        for (size_t i = 0; i < splats.size(); ++i) along[i] = splats[i][k];
        std::nth_element(along.begin(), along.begin() + outside, along.end());
        const float low = along[size_t(outside)];
        std::nth_element(along.begin(), along.end() - 1 - outside, along.end());
        const float high = *(along.end() - 1 - outside);
        lo[k] = std::max(lo[k], low - kAround * (high - low)), hi[k] = std::min(hi[k], high + kAround * (high - low));
    }
}

/// The splats as seen against the direction w (unit), the object's sphere filling the image.
void flatten(const ShadowScene& scene, const glm::vec3& w, ShadowWorkspace& work)
{
    const ShadowDirection view = shadowDirection(scene.center, scene.radius, w);
    const size_t n = scene.count();
    work.flat.resize(n), work.keys.resize(n), work.order.resize(n);
    for (size_t i = 0; i < n; ++i) {
        work.flat[i] = flatAlong(view, scene.positions[i], scene.axes[i], scene.opacities[i]);
        work.keys[i] = radixKey(work.flat[i].depth), work.order[i] = uint32_t(i);
    }
    radixSort<uint32_t>(work.keys, work.order, work.scratch);
}

/// e^-x of 0 <= x < 80, relative error below 1e-5.
inline float expNegative(float x)
{
    const float t = x * -1.44269504f;
    const int whole = int(t);
    const float f = t - float(whole); // (-1, 0]
    const float p = 1 + f * (0.69314718f + f * (0.24022651f + f * (0.05550411f + f * (0.00961813f + f * 0.00133336f))));
    return p * std::bit_cast<float>((whole + 127) << 23);
}

} // namespace

void drawShadowScalar(const FlatSplat& s, float* image)
{
    constexpr int kTogether = 4;
    const ShadowReach r = shadowReach(s);
    for (int y = r.y0; y <= r.y1; ++y) {
        const float dy = float(y) + 0.5f - s.y, cy = s.c * dy * dy, by = s.b * dy, first = 0.5f - s.x;
        float* row = image + y * kShadowRow;
        for (int x = r.x0; x <= r.x1; x += kTogether) { // without branches, so that compilers can do several at once
            float lit[kTogether];
            for (int k = 0; k < kTogether; ++k) {
                const float dx = first + float(x + k), q = (s.a * dx + by) * dx + cy, alpha = s.opacity * expNegative(q < r.reach ? q : r.reach);
                lit[k] = q < r.reach ? 1 - (alpha < kShadowMostAlpha ? alpha : kShadowMostAlpha) : 1.0f;
            }
            for (int k = 0; k < kTogether; ++k) row[x + k] *= lit[k];
        }
    }
}

float readShadow(const float* image, float x, float y)
{
    const ShadowPlace at = shadowPlace(x, y);
    const float *row = image + at.y * kShadowRow + at.x, *next = row + kShadowRow;
    return at.value(row[0], row[1], next[0], next[1]);
}

void finishScene(ShadowScene& scene, float medianSize)
{
    glm::vec3 lo(std::numeric_limits<float>::max()), hi(-lo);
    for (const glm::vec3& p : scene.positions) lo = glm::min(lo, p), hi = glm::max(hi, p);
    limitBox(scene.positions, lo, hi);
    scene.bias = visibilityBias(medianSize);
    scene.center = 0.5f * (lo + hi);
    scene.radius = std::max(0.5f * glm::length(hi - lo), 1e-6f);
}

void addDirection(const ShadowScene& scene, const glm::vec3& w, DrawShadow draw, ShadowWorkspace& work)
{
    flatten(scene, w, work);
    work.image.assign(size_t(kShadowRow) * kShadowSize, 1.0f);
    size_t drawn = 0;
    for (const uint32_t i : work.order) {
        const FlatSplat& s = work.flat[i];
        for (; work.flat[work.order[drawn]].depth < s.depth - scene.bias; ++drawn) draw(work.flat[work.order[drawn]], work.image.data());
        work.sum[i] += insideShadow(s, kShadowMargin) ? readShadow(work.image.data(), s.x, s.y) : 1.0f;
    }
}

void drawTexel(const ShadowScene& scene, int size, int texel, int oversample, DrawShadow draw, ShadowWorkspace& work)
{
    work.sum.assign(scene.count(), 0.0f);
    forTexelDirections(size, texel, oversample, [&](const glm::vec3& w) { addDirection(scene, w, draw, work); });
    const float scale = 255.0f / float(oversample * oversample);
    for (float& s : work.sum) s *= scale;
}

VisibilityDrawing::VisibilityDrawing(const SplatCloud& cloud, int size) : size_(size)
{
    std::vector<float> sizes;
    for (size_t i = 0; i < cloud.count; ++i) {
        const glm::mat3 m = glm::mat3_cast(glm::normalize(cloud.rotations[i]));
        const glm::vec3& s = cloud.scales[i];
        scene_.axes.push_back({s.x * m[0], s.y * m[1], s.z * m[2]});
        sizes.push_back(std::max({s.x, s.y, s.z}));
    }
    scene_.positions = cloud.positions, scene_.opacities = cloud.opacities;
    std::nth_element(sizes.begin(), sizes.begin() + ptrdiff_t(sizes.size() / 2), sizes.end());
    finishScene(scene_, std::max(sizes[sizes.size() / 2], 1e-6f));
    maps_.name = "visibility", maps_.components = uint32_t(size * size);
    maps_.bytes.resize(cloud.count * maps_.components);
}

bool VisibilityDrawing::step()
{
    constexpr int kTexels = 16; // written together: bytes of a splat's map lie side by side
    if (next_ == size_ * size_) return false;
    const size_t n = scene_.count(), place = size_t(next_ % kTexels);
    texels_.resize(n * kTexels);
    drawTexel(scene_, size_, next_++, 1, drawShadowScalar, work_);
    for (size_t i = 0; i < n; ++i) texels_[place * n + i] = uint8_t(work_.sum[i] + 0.5f);
    if (next_ % kTexels == 0)
        for (size_t i = 0; i < n; ++i)
            for (size_t t = 0; t < kTexels; ++t) maps_.bytes[i * maps_.components + size_t(next_ - kTexels) + t] = texels_[t * n + i];
    return next_ < size_ * size_;
}

Channel VisibilityDrawing::take() { return std::move(maps_); }

void drawVisibility(SplatAsset& asset)
{
    if (asset.drawnVisibility == 0) return;
    VisibilityDrawing drawing(asset.cloud, asset.drawnVisibility);
    while (drawing.step()) {}
    asset.channels.push_back(drawing.take()), asset.drawnVisibility = 0;
}

} // namespace nacre
