#include "pack/pack_views.h"

#include "base/asset_frame.h"
#include "base/color.h"
#include "base/fibonacci_sphere.h"
#include "eval/splat_renderer.h"
#include "render/cloud_geometry.h"
#include "render/reference_raster.h"
#include "render/tiles.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nacre {

namespace {

constexpr int kSize = 192; // pixels a side of views around

/// In the units of the asset: pictures of what `frame` would turn into the dataset's.
SplatAsset inOwnFrame(SplatAsset asset) { return asset.frame = {}, asset; }

Camera lookFrom(const glm::dvec3& direction, const glm::dvec3& centre, double radius)
{
    constexpr double kFieldOfView = 40 * std::numbers::pi / 180;
    const glm::dvec3 side = std::abs(direction.y) < 0.9 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0);
    const glm::dvec3 x = glm::normalize(glm::cross(side, direction)), y = glm::cross(direction, x);
    Camera camera;
    camera.width = camera.height = kSize;
    camera.fx = camera.fy = 0.5 * kSize / std::tan(0.5 * kFieldOfView);
    camera.cx = camera.cy = 0.5 * kSize;
    const glm::dvec3 eye = centre + direction * (radius / std::sin(0.5 * kFieldOfView));
    camera.worldFromCamera = glm::dmat4(glm::dvec4(x, 0), glm::dvec4(y, 0), glm::dvec4(direction, 0), glm::dvec4(eye, 1));
    return camera;
}

/// Centre and radius of what holds 98 % of the splats by opacity; a few far away must not shrink the rest to a dot.
void robustSphere(const SplatCloud& cloud, glm::dvec3& centre, double& radius)
{
    centre = glm::dvec3(0);
    double total = 0;
    for (size_t i = 0; i < cloud.count; ++i) centre += double(cloud.opacities[i]) * glm::dvec3(cloud.positions[i]), total += cloud.opacities[i];
    centre /= std::max(total, 1e-30);
    std::vector<double> distances;
    for (size_t i = 0; i < cloud.count; ++i)
        distances.push_back(glm::distance(glm::dvec3(cloud.positions[i]), centre) + 2 * std::max({cloud.scales[i].x, cloud.scales[i].y, cloud.scales[i].z}));
    const auto place = distances.begin() + ptrdiff_t(0.98 * double(distances.size() - 1));
    std::nth_element(distances.begin(), place, distances.end());
    radius = std::max(*place, 1e-6);
}

Result<Image> renderView(SplatRenderer& renderer, const PackView& view) { return renderer.render(view.camera, std::span(&view.light, 1)); }

float displayed(float linear) { return srgbFromLinear(std::clamp(linear, 0.0f, 1.0f)); }

std::vector<float> display(const Image& image)
{
    std::vector<float> out = image.rgba;
    for (size_t p = 0; p < out.size(); p += 4)
        for (size_t c = 0; c < 3; ++c) out[p + c] = displayed(out[p + c]);
    return out;
}

} // namespace

Result<std::vector<PackView>> viewsAround(const SplatAsset& asset, size_t count)
{
    glm::dvec3 centre;
    double radius = 0;
    robustSphere(asset.cloud, centre, radius);
    std::vector<PackView> views;
    for (size_t i = 0; i < count; ++i) {
        PackView view;
        const glm::dvec3 from = fibonacciDirection(int(i), int(count)), lit = fibonacciDirection(int((i * 7 + count / 3) % count), int(count));
        view.camera = lookFrom(from, centre, radius);
        const glm::dvec3 towards = glm::normalize(lit + 0.7 * from); // mostly the side that is seen, also from behind
        view.light.type = i % 2 ? LightType::kDirectional : LightType::kPoint;
        view.light.directionToLight = glm::vec3(towards);
        view.light.position = glm::vec3(centre + 3 * radius * towards);
        view.light.intensity = glm::vec3(float(i % 2 ? 1.0 : 9 * radius * radius));
        views.push_back(view);
    }
    const auto renderer = makeReferenceRenderer(inOwnFrame(asset));
    if (!renderer) return renderer.error();
    std::vector<float> luminances;
    for (const PackView& view : views) {
        const auto image = renderView(**renderer, view);
        if (!image) return image.error();
        for (size_t p = 0; p < image->rgba.size(); p += 4)
            if (image->rgba[p + 3] > 0.5f) luminances.push_back(std::max({image->rgba[p], image->rgba[p + 1], image->rgba[p + 2]}));
    }
    if (luminances.empty()) return Error{ErrorCode::kBadInput, "nothing of the asset shows: all its splats are too small or too faint to be compared; --against a dataset shows it from nearer"};
    const auto bright = luminances.begin() + ptrdiff_t(0.95 * double(luminances.size() - 1));
    std::nth_element(luminances.begin(), bright, luminances.end());
    if (*bright > 0)
        for (PackView& view : views) view.light.intensity *= 0.8f / *bright;
    return views;
}

std::vector<PackView> viewsOf(const OlatSplit& split, const AssetFrame& frame, size_t count)
{
    std::vector<const OlatImage*> usable;
    for (const OlatImage& image : split.images)
        if (image.light.isPunctual()) usable.push_back(&image);
    std::vector<PackView> views;
    const size_t n = std::min(count, usable.size());
    for (size_t i = 0; i < n; ++i) {
        const OlatImage& image = *usable[i * usable.size() / n];
        views.push_back({cameraInAsset(frame, split.cameras[image.camera]), lightInAsset(frame, image.light)});
    }
    return views;
}

Result<std::vector<PackView>> viewsFor(const SplatAsset& asset, const OlatSplit* seen, size_t count)
{
    std::vector<PackView> views = seen ? viewsOf(*seen, asset.frame, count) : std::vector<PackView>();
    return views.empty() ? viewsAround(asset, count) : views;
}

std::vector<PackView> someOf(std::span<const PackView> views, size_t count)
{
    std::vector<PackView> some;
    const size_t n = std::min(count, views.size());
    for (size_t i = 0; i < n; ++i) some.push_back(views[i * views.size() / n]);
    return some;
}

std::vector<float> splatImportance(const SplatAsset& asset, std::span<const PackView> views)
{
    const std::vector<GaussianGeometry<float>> geometry = geometryOf(asset.cloud);
    std::vector<double> sums(geometry.size());
    TileBuilder builder;
    for (const PackView& view : views) {
        builder.build(makeView<float>(view.camera, asset.lowPassVariance), geometry);
        const TileLists& tiles = builder.tiles;
        // Tiles add up one after the other: the same sum for any number of threads.
        std::vector<std::vector<float>> byTile(tiles.tileStart.size() - 1);
        tbb::parallel_for(size_t(0), byTile.size(), [&](size_t tile) {
            const uint32_t first = tiles.tileStart[tile], end = tiles.tileStart[tile + 1];
            std::vector<float>& squares = byTile[tile];
            squares.assign(end - first, 0.0f);
            const int x0 = int(tile % size_t(tiles.tilesX)) * kTileSize, y0 = int(tile / size_t(tiles.tilesX)) * kTileSize;
            for (int y = y0; y < std::min(y0 + kTileSize, view.camera.height); ++y)
                for (int x = x0; x < std::min(x0 + kTileSize, view.camera.width); ++x) {
                    float transmittance = 1, dx, dy;
                    for (uint32_t e = first; e < end && transmittance >= kMinTransmittance; ++e) {
                        const float alpha = std::min(splatAlpha(builder.visible.projected[tiles.entries[e].visible], float(x) + 0.5f, float(y) + 0.5f, &dx, &dy), kMaxAlpha);
                        if (!(alpha >= kMinAlpha)) continue;
                        squares[e - first] += transmittance * alpha * transmittance * alpha;
                        transmittance *= 1 - alpha;
                    }
                }
        });
        for (size_t tile = 0; tile < byTile.size(); ++tile)
            for (size_t e = 0; e < byTile[tile].size(); ++e)
                sums[builder.visible.splatFromVisible[tiles.entries[tiles.tileStart[tile] + e].visible]] += byTile[tile][e];
    }
    std::vector<float> importance;
    for (const double sum : sums) importance.push_back(float(sum / double(std::max<size_t>(1, views.size()))));
    return importance;
}

Result<PackReference> PackReference::render(const SplatAsset& asset, std::vector<PackView> views)
{
    PackReference reference;
    const auto renderer = makeReferenceRenderer(inOwnFrame(asset));
    if (!renderer) return renderer.error();
    for (const PackView& view : views) {
        const auto image = renderView(**renderer, view);
        if (!image) return image.error();
        reference.images_.push_back(display(*image));
    }
    reference.views_ = std::move(views);
    return reference;
}

Result<double> PackReference::error(const SplatAsset& other) const { return errorOver(other, false); }
Result<double> PackReference::errorEverywhere(const SplatAsset& other) const { return errorOver(other, true); }

Result<double> PackReference::errorOver(const SplatAsset& other, bool everywhere) const
{
    const auto renderer = makeReferenceRenderer(inOwnFrame(other));
    if (!renderer) return renderer.error();
    double sum = 0;
    size_t pixels = 0;
    for (size_t v = 0; v < views_.size(); ++v) {
        const auto image = renderView(**renderer, views_[v]);
        if (!image) return image.error();
        const std::vector<float>& reference = images_[v];
        for (size_t p = 0; p < reference.size(); p += 4) {
            const bool object = reference[p + 3] > 0.5f;
            if (!object && !everywhere) continue;
            for (size_t c = 0; c < 3; ++c) {
                const double d = double(displayed(image->rgba[p + c])) - double(reference[p + c]);
                sum += d * d;
            }
            pixels += object;
        }
    }
    return pixels > 0 ? sum / (3 * double(pixels)) : 0.0;
}

} // namespace nacre
