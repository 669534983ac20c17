// Draws an asset with the scalar reference math only: projection.h, the model's header, reference_raster.h in float32, tiles in parallel.
#include "appearance/model_table.h"
#include "appearance/reference_model.h"
#include "base/spherical_harmonics.h"
#include "eval/splat_renderer.h"
#include "render/cloud_geometry.h"
#include "render/reference_raster.h"
#include "render/tiles.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>

namespace nacre {

namespace {

/// Splats that only shine.
class PlainModel final : public ReferenceModel {
public:
    PlainModel(const SplatCloud& cloud, const NeutralLook& look) : cloud_(cloud), look_(look) {}
    int channels(size_t) const override { return 3; }
    float opacity(size_t splat) const override { return cloud_.opacities[splat]; }
    void shade(size_t splat, const float* eye, std::span<const Light>, float* color) const override
    {
        const glm::vec3 d = glm::normalize(cloud_.positions[splat] - glm::vec3(eye[0], eye[1], eye[2]));
        float y[kMaxShFunctions];
        shBasis(look_.shFunctions, d.x, d.y, d.z, y);
        for (int c = 0; c < 3; ++c) {
            color[c] = 0.5f;
            for (int f = 0; f < look_.shFunctions; ++f) color[c] += look_.sh[splat * size_t(look_.shFunctions) + size_t(f)][c] * y[f];
            color[c] = std::max(0.0f, color[c]);
        }
    }
    void resolve(const float* blended, float, const float*, const float*, std::span<const Light>, float* rgb) const override { std::copy_n(blended, 3, rgb); }
    Status setEdits(std::span<const SplatEdit>) override { return Error{ErrorCode::kUnsupported, "plain splats have no materials to edit"}; }

private:
    const SplatCloud& cloud_;
    const NeutralLook& look_;
};

class ReferenceRenderer final : public SplatRenderer {
public:
    explicit ReferenceRenderer(const SplatAsset& asset, const PartInfo& part = {}) : asset_(asset), part_(part)
    {
        geometry_ = geometryOf(asset_.cloud);
        model_ = makeReferenceModel(asset_, part.part);
    }
    ReferenceRenderer(const PlainSplats& splats, float lowPassVariance) : look_(splats.look)
    {
        asset_.cloud = splats.cloud;
        asset_.lowPassVariance = lowPassVariance;
        geometry_ = geometryOf(asset_.cloud);
        model_ = std::make_unique<PlainModel>(asset_.cloud, look_);
    }

    Result<Image> render(const Camera& camera, std::span<const Light> lights) override
    {
        for (const Light& l : lights)
            if (!l.isPunctual())
                return Error{ErrorCode::kUnsupported, "the reference renderer takes point and directional lights; expand others first (rendererLights)"};
        const View<float> view = makeView<float>(camera, asset_.lowPassVariance);
        for (size_t i = 0; i < geometry_.size(); ++i) geometry_[i].opacity = model_->opacity(i);
        builder_.build(view, geometry_);
        const size_t channels = size_t(model_->channels(lights.size()));
        channels_.assign(builder_.visible.count() * channels, 0.0f);
        tbb::parallel_for(tbb::blocked_range<size_t>(0, builder_.visible.count(), 64), [&](const tbb::blocked_range<size_t>& range) {
            for (size_t v = range.begin(); v < range.end(); ++v) model_->shade(builder_.visible.splatFromVisible[v], view.eye, lights, &channels_[channels * v]);
        });
        return blend(camera, view.eye, lights);
    }

    Result<RenderTimes> time(const Camera& camera, std::span<const Light> lights, int warmup, int frames) override
    {
        std::vector<double> ms;
        for (int i = 0; i < warmup + std::max(1, frames); ++i) {
            const auto start = std::chrono::steady_clock::now();
            if (auto image = render(camera, lights); !image) return image.error();
            if (i >= warmup) ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
        }
        std::nth_element(ms.begin(), ms.begin() + ms.size() / 2, ms.end());
        RenderTimes times; // one pass: relight, sort and raster are not told apart
        times.frameMs = ms[ms.size() / 2];
        return times;
    }

    Status setEdits(std::span<const SplatEdit> edits) override { return model_->setEdits(edits); }

    std::string description() const override { return "scalar reference on the CPU"; }

private:
    Image blend(const Camera& camera, const float* eye, std::span<const Light> lights) const
    {
        Image image{camera.width, camera.height, std::vector<float>(size_t(4) * camera.width * camera.height)};
        const TileLists& tiles = builder_.tiles;
        const int channels = model_->channels(lights.size());
        tbb::parallel_for(size_t(0), tiles.tileStart.size() - 1, [&](size_t tile) {
            std::vector<uint32_t> order;
            std::vector<float> blended(static_cast<size_t>(channels));
            for (uint32_t e = tiles.tileStart[tile]; e < tiles.tileStart[tile + 1]; ++e) order.push_back(tiles.entries[e].visible);
            const int x0 = int(tile % tiles.tilesX) * kTileSize, y0 = int(tile / tiles.tilesX) * kTileSize;
            for (int y = y0; y < std::min(y0 + kTileSize, camera.height); ++y)
                for (int x = x0; x < std::min(x0 + kTileSize, camera.width); ++x) {
                    float* pixel = image.pixel(x, y);
                    pixel[3] = blendPixel<float>(order, builder_.visible.projected.data(), channels_.data(), channels, float(x) + 0.5f, float(y) + 0.5f,
                                                 blended.data());
                    const glm::vec3 ray(pixelRay(camera, x + 0.5, y + 0.5));
                    if (part_.part == ShownPart::kOverdraw) std::fill_n(pixel, 3, float(layers(order, float(x) + 0.5f, float(y) + 0.5f)));
                    else if (pixel[3] > 0) model_->resolve(blended.data(), pixel[3], eye, &ray.x, lights, pixel);
                    if (part_.part != ShownPart::kOverdraw && !part_.radiance) divide(pixel);
                }
        });
        return image;
    }

    /// As blendPixel goes through them.
    int layers(std::span<const uint32_t> order, float x, float y) const
    {
        int count = 0;
        float transmittance = 1, dx, dy;
        for (uint32_t i : order) {
            const float alpha = splatAlpha(builder_.visible.projected[i], x, y, &dx, &dy);
            if (!(alpha >= float(kMinAlpha))) continue;
            ++count;
            transmittance *= 1 - std::min(alpha, float(kMaxAlpha));
            if (transmittance < float(kMinTransmittance)) break;
        }
        return count;
    }

    /// From a sum over the splats of a pixel to their mean.
    void divide(float* pixel) const
    {
        float by = pixel[3];
        if (part_.part == ShownPart::kNormal) by = glm::length(glm::vec3(pixel[0], pixel[1], pixel[2]));
        if (part_.part == ShownPart::kDepth) by = float(by / asset_.frame.scale);
        for (int c = 0; c < 3; ++c) pixel[c] = by > 0 ? pixel[c] / by : 0.0f;
    }

    SplatAsset asset_;
    PartInfo part_;
    NeutralLook look_; // of plain splats
    std::vector<GaussianGeometry<float>> geometry_;
    std::unique_ptr<ReferenceModel> model_;
    TileBuilder builder_;
    std::vector<float> channels_;
};

} // namespace

Result<std::unique_ptr<SplatRenderer>> makeReferenceRenderer(const SplatAsset& asset)
{
    if (Status s = validate(asset); !s) return s.error();
    if (!makeReferenceModel(asset)) return Error{ErrorCode::kUnsupported, "the reference renderer does not know the model '" + asset.model + "'"};
    return inDatasetFrame(asset.frame, std::make_unique<ReferenceRenderer>(asset));
}

Result<std::unique_ptr<SplatRenderer>> makePartRenderer(const SplatAsset& asset, const std::string& name)
{
    if (Status s = validate(asset); !s) return s.error();
    if (!makeReferenceModel(asset)) return Error{ErrorCode::kUnsupported, "the reference renderer does not know the model '" + asset.model + "'"};
    const auto part = findPart(asset, name);
    if (!part) return part.error();
    return inDatasetFrame(asset.frame, std::make_unique<ReferenceRenderer>(asset, *part));
}

std::unique_ptr<SplatRenderer> makePlainRenderer(const PlainSplats& splats, float lowPassVariance)
{
    return std::make_unique<ReferenceRenderer>(splats, lowPassVariance);
}

} // namespace nacre
