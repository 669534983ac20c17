// Draws an asset with the scalar reference math only: projection.h, bigs.h, reference_raster.h in float32, tiles in parallel.
#include "appearance/bigs/bigs.h"
#include "appearance/model_table.h"
#include "eval/splat_renderer.h"
#include "render/reference_raster.h"
#include "render/tiles.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>

namespace nacre {

namespace {

class ReferenceRenderer final : public SplatRenderer {
public:
    ReferenceRenderer(const SplatAsset& asset) : asset_(asset)
    {
        const SplatCloud& c = asset_.cloud;
        geometry_.resize(c.count);
        for (size_t i = 0; i < c.count; ++i)
            geometry_[i] = {{c.positions[i].x, c.positions[i].y, c.positions[i].z},
                            {c.scales[i].x, c.scales[i].y, c.scales[i].z},
                            {c.rotations[i].w, c.rotations[i].x, c.rotations[i].y, c.rotations[i].z},
                            c.opacities[i]};
        tDir_ = asset_.find("tDir"), tInd_ = asset_.find("tInd"), rho_ = asset_.find("rho"), s_ = asset_.find("s");
        lobe_ = asset_.find("lobe"), visibility_ = asset_.find("visibility"), shadow_ = asset_.find("shadow");
        sFunctions_ = s_ ? bigsScatterFunctions(s_->components) : 0;
    }

    Result<Image> render(const Camera& camera, std::span<const Light> lights) override
    {
        for (const Light& l : lights)
            if (!l.isPunctual())
                return Error{ErrorCode::kUnsupported, "the reference renderer takes point and directional lights; expand others first (rendererLights)"};
        const View<float> view = makeView<float>(camera, asset_.lowPassVariance);
        builder_.build(view, geometry_);
        colors_.assign(builder_.visible.count() * 3, 0.0f);
        tbb::parallel_for(tbb::blocked_range<size_t>(0, builder_.visible.count(), 64), [&](const tbb::blocked_range<size_t>& range) {
            for (size_t v = range.begin(); v < range.end(); ++v) shade(builder_.visible.splatFromVisible[v], view, lights, &colors_[3 * v]);
        });
        return blend(camera);
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

    std::string description() const override { return "scalar reference on the CPU"; }

private:
    void shade(size_t splat, const View<float>& view, std::span<const Light> lights, float* color) const
    {
        const BigsCoefficients<float> g{&tDir_->values[25 * splat], &tInd_->values[75 * splat], &rho_->values[3 * splat],
                                        s_ ? &s_->values[size_t(s_->components) * splat] : nullptr, sFunctions_,
                                        lobe_ ? &lobe_->values[kBigsLobeFloats * splat] : nullptr,
                                        visibility_ ? VisibilityMap{&visibility_->bytes[visibility_->components * splat], bigsVisibilitySize(visibility_->components)} : VisibilityMap{},
                                        shadow_ ? shadow_->values[splat] : 1.0f};
        const float* p = geometry_[splat].position;
        float y[kMaxShFunctions], a[3 * kMaxShFunctions];
        const LightSample<float> toEye = samplePointLight(view.eye, 0.0f, p);
        shBasis(25, toEye.dir[0], toEye.dir[1], toEye.dir[2], y);
        bigsContractView(g, y, a);
        for (const Light& light : lights) {
            LightSample<float> l{{light.directionToLight.x, light.directionToLight.y, light.directionToLight.z}, 1.0f};
            if (light.type == LightType::kPoint) l = samplePointLight(&light.position.x, light.radius, p);
            shBasis(25, l.dir[0], l.dir[1], l.dir[2], y);
            const BigsTerms<float> t = bigsTerms(g, a, y);
            const BigsSharpTerms<float> sharp = bigsSharpTerms(g, toEye.dir, l.dir);
            for (int c = 0; c < 3; ++c) color[c] += light.intensity[c] * l.falloff * bigsTransport(t, sharp, c);
        }
    }

    Image blend(const Camera& camera) const
    {
        Image image{camera.width, camera.height, std::vector<float>(size_t(4) * camera.width * camera.height)};
        const TileLists& tiles = builder_.tiles;
        tbb::parallel_for(size_t(0), tiles.tileStart.size() - 1, [&](size_t tile) {
            std::vector<uint32_t> order;
            for (uint32_t e = tiles.tileStart[tile]; e < tiles.tileStart[tile + 1]; ++e) order.push_back(tiles.entries[e].visible);
            const int x0 = int(tile % tiles.tilesX) * kTileSize, y0 = int(tile / tiles.tilesX) * kTileSize;
            for (int y = y0; y < std::min(y0 + kTileSize, camera.height); ++y)
                for (int x = x0; x < std::min(x0 + kTileSize, camera.width); ++x) {
                    float* pixel = image.pixel(x, y);
                    pixel[3] = blendPixel<float>(order, builder_.visible.projected.data(), colors_.data(), 3, float(x) + 0.5f, float(y) + 0.5f, pixel);
                }
        });
        return image;
    }

    const SplatAsset asset_;
    std::vector<GaussianGeometry<float>> geometry_;
    const Channel *tDir_, *tInd_, *rho_, *s_, *lobe_, *visibility_, *shadow_;
    int sFunctions_ = 0;
    TileBuilder builder_;
    std::vector<float> colors_;
};

} // namespace

Result<std::unique_ptr<SplatRenderer>> makeReferenceRenderer(const SplatAsset& asset)
{
    if (Status s = validate(asset); !s) return s.error();
    if (asset.model != "bigs") return Error{ErrorCode::kUnsupported, "the reference renderer knows the model 'bigs', not '" + asset.model + "'"};
    return std::unique_ptr<SplatRenderer>(new ReferenceRenderer(asset));
}

} // namespace nacre
