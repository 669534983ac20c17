// The engine that bakes: SIMD projection, tiles and raster, and each model's SIMD shading.
#include "appearance/bigs/bigs_training.h"
#include "appearance/sss/sss_asset.h"
#include "appearance/sss/sss_network_simd.h"
#include "appearance/sss/sss_resolve.h"
#include "base/half.h"
#include "render/cloud_geometry.h"
#include "render/raster.h"
#include "selftest/back_end.h"
#include "selftest/scalar_image.h"
#include "train/step_engine.h"

#include <algorithm>
#include <cmath>

namespace nacre::selftest {

namespace {

/// Coefficients as bakes hold them, of an asset.
BigsParameters parametersOf(const SplatAsset& asset)
{
    BigsParameters p;
    const auto values = [&](const char* name, size_t splat) { return asset.find(name) ? &asset.find(name)->values[splat * asset.find(name)->components] : nullptr; };
    p.sFunctions = asset.find("s") ? bigsScatterFunctions(asset.find("s")->components) : 0;
    p.resize(asset.cloud.count);
    for (size_t i = 0; i < p.count; ++i) {
        const auto set = [&](int first, const float* from, int count) {
            for (int k = 0; k < count && from; ++k) p.value[p.index(i, first + k)] = from[k];
        };
        const auto logOf = [](float sharpness) { return std::log(std::max(sharpness, 1e-30f)); };
        set(kTDir, values("tDir", i), 25), set(kTInd, values("tInd", i), 75), set(kRho, values("rho", i), 3);
        set(kScatter, values("s", i), 3 * bigsPairCount(p.sFunctions));
        p.value[p.index(i, kShadow)] = 1;
        set(kShadow, values("shadow", i), 1);
        if (const float* lobe = values("lobe", i)) {
            set(kLobe, lobe, kBigsLobeFloats);
            p.value[p.index(i, kLobeSharpness)] = logOf(lobe[3]);
        }
        if (const float* forward = values("forward", i)) {
            set(kForward, forward, kBigsForwardFloats);
            p.value[p.index(i, kForward)] = logOf(forward[0]);
        }
    }
    if (const Channel* maps = asset.find("visibility")) p.visibility = maps->bytes;
    return p;
}

LitView litBy(const Scene& scene)
{
    LitView lit = litView(scene.camera, scene.lights);
    if (scene.lights.empty()) lit.lightCount = 1, lit.lights[0] = pointLight({0, 0, 1e3f}, 0); // the engine always has one
    return lit;
}

/// A view of a scene from projection to channels.
struct SimdView {
    LitView lit;
    View<float> view;
    std::vector<GaussianGeometry<float>> geometry;
    TileBuilder builder;
    std::vector<uint32_t> visibleFromSplat;
    int channels;
    std::vector<float> colors; // [visible][channelStride]
    size_t pixels;

    explicit SimdView(const Scene& scene)
        : lit(litBy(scene)), view(makeView<float>(scene.camera, double(scene.asset.lowPassVariance))), geometry(geometryOf(scene.asset.cloud)),
          pixels(size_t(scene.camera.width) * size_t(scene.camera.height))
    {
        builder.build(view, geometry);
        visibleFromSplat.assign(geometry.size(), ~0u);
        for (size_t v = 0; v < builder.visible.count(); ++v) visibleFromSplat[builder.visible.splatFromVisible[v]] = uint32_t(v);
        const bool sss = scene.asset.model == "sss";
        channels = sss ? kSssSurfaceChannels + kSssLightChannels * lit.lightCount : 3 * lit.lightCount;
        colors.resize(builder.visible.count() * size_t(channelStride(channels)));
        if (sss) shadeSss(scene.asset);
        else shadeBigs(scene);
    }

private:
    void shadeBigs(const Scene& scene)
    {
        const SplatAsset& asset = scene.asset;
        const BigsParameters parameters = parametersOf(asset);
        const VisibleView visible{geometry, visibleFromSplat, builder.visible.count()};
        AlignedVector<float> terms(parameters.blocks() * kBigsTermStride * kLanes16);
        const BigsBands bands{25, 25, parameters.sFunctions, asset.find("lobe") != nullptr, asset.find("forward") != nullptr};
        bigsForward(parameters, visible, lit, bands, {}, colors.data(), terms.data());
        if (scene.halfTarget)
            for (float& c : colors) c = std::min(c, kMaxHalf);
    }

    void shadeSss(const SplatAsset& asset)
    {
        const SssChannels source(asset);
        SssWeights weights;
        weights.share = source.shares();
        if (source.network()) std::copy_n(source.network(), kSssWeights, weights.value.begin());
        const Channel *code = asset.find("code"), *codeWeights = asset.find("codeWeights");
        if (code && codeWeights) std::copy(codeWeights->values.begin(), codeWeights->values.end(), weights.value.begin() + kSssCode);
        weights.transpose();
        SssBatch batch;
        float falloff[kSssRows];
        for (size_t first = 0; first < geometry.size(); first += kSssLanes) {
            const size_t lanes = std::min<size_t>(kSssLanes, geometry.size() - first);
            for (size_t lane = 0; lane < size_t(kSssLanes); ++lane) fill(source, code, first + std::min(lane, lanes - 1), lane, batch, falloff);
            if (source.network()) sssBatchForward(weights, lit.lightCount, batch);
            for (size_t lane = 0; lane < lanes; ++lane) write(source, weights.share, first + lane, lane, batch, falloff);
        }
    }

    void fill(const SssChannels& source, const Channel* code, size_t splat, size_t lane, SssBatch& batch, float* falloff) const
    {
        const float* p = geometry[splat].position;
        const SssMaterial m = source.material(splat);
        if (source.network()) sssFixedInputs(p, m.normal, source.network() + kSssFrame, batch.fixed[lane]);
        if (code) std::copy_n(&code->values[kSssCodeInputs * splat], kSssCodeInputs, batch.code[lane]);
        const LightSample<float> toEye = samplePointLight(lit.eye, 0.0f, p);
        for (int l = 0; l < lit.lightCount; ++l) {
            const Light& light = lit.lights[l];
            const size_t row = size_t(l * kSssLanes) + lane;
            const LightSample<float> s = sampleLight(light, p);
            const float distance = light.type == LightType::kPoint ? glm::distance(light.position, glm::vec3(p[0], p[1], p[2])) : -1.0f;
            const VisibilityMap map = source.visibility(splat);
            sssLightInputs(toEye.dir, s.dir, map.texels ? mapVisibility(map, s.dir) : 1.0f, source.network() ? distance * source.network()[kSssFrame + 3] : 0.0f, batch.light[row]);
            falloff[row] = s.falloff;
        }
    }

    void write(const SssChannels& source, bool shares, size_t splat, size_t lane, const SssBatch& batch, const float* falloff)
    {
        const uint32_t v = visibleFromSplat[splat];
        if (v == ~0u) return;
        float* out = &colors[size_t(v) * size_t(channelStride(channels))];
        const SssMaterial m = source.material(splat);
        std::copy_n(m.normal, 3, out + kSssNormal), std::copy_n(m.base, 3, out + kSssBase);
        out[kSssRoughness] = m.roughness, out[kSssMetalness] = m.metalness, out[kSssSubsurface] = m.subsurface;
        float d2 = 0;
        for (int k = 0; k < 3; ++k) d2 += (geometry[splat].position[k] - lit.eye[k]) * (geometry[splat].position[k] - lit.eye[k]);
        out[kSssDepth] = std::sqrt(d2);
        for (int l = 0; l < lit.lightCount; ++l) {
            const size_t row = size_t(l * kSssLanes) + lane;
            float* to = out + kSssSurfaceChannels + kSssLightChannels * l;
            to[kSssIncident] = batch.light[row][kSssVisibilityInput] * (shares ? batch.share[row] : 1.0f);
            for (int c = 0; c < 3; ++c)
                to[kSssScattered + c] = source.scatters() ? m.subsurface * falloff[row] * lit.lights[l].intensity[c] * batch.residual[row][c] : 0.0f;
        }
    }
};

class SimdBackEnd final : public BackEnd {
public:
    bool trains() const override { return true; }

    Result<Values> draw(const Scene& scene) override
    {
        const bool sss = scene.asset.model == "sss";
        const bool wide = std::any_of(scene.lights.begin(), scene.lights.end(), [](const Light& l) { return highlightWidening(l) > 0; }); // no dataset has such
        if ((sss && scene.halfTarget) || wide) return notHere();
        const SimdView seen(scene);
        std::vector<float> planes(seen.pixels * size_t(seen.channels + 1)), image;
        rasterForward(seen.builder.visible, seen.builder.tiles, seen.colors.data(), seen.channels, planes.data());
        if (sss) {
            image.resize(seen.pixels * size_t(3 * seen.lit.lightCount + 1));
            sssResolve(pixelRays(scene.camera), seen.lit, planes.data(), image.data());
        } else {
            image = std::move(planes);
        }
        ValueGroup color{"colour", std::vector<double>(3 * seen.pixels), 0}, coverage{"alpha", {}, 1};
        for (size_t p = 0; p < seen.pixels; ++p)
            for (int plane = 0; plane < 3 * seen.lit.lightCount; ++plane) color.values[3 * p + size_t(plane % 3)] += double(image[size_t(plane) * seen.pixels + p]);
        for (size_t p = 0; p < seen.pixels; ++p) coverage.values.push_back(double(image[size_t(3 * seen.lit.lightCount) * seen.pixels + p]));
        return Values{std::move(color), std::move(coverage)};
    }

    /// The gradient of the raster is SIMD; that of the projection, which bakes take together with the step, is the scalar one.
    Result<Values> gradients(const Scene& scene) override
    {
        const SimdView seen(scene);
        if (seen.channels != 3) return notHere();
        const size_t count = seen.builder.visible.count(), stride = size_t(channelStride(3));
        std::vector<float> planes(4 * seen.pixels), dPlanes(4 * seen.pixels), dColors(count * stride);
        std::vector<ScreenGradient<float>> dSplats(count);
        rasterForward(seen.builder.visible, seen.builder.tiles, seen.colors.data(), 3, planes.data());
        for (size_t p = 0; p < seen.pixels; ++p)
            for (size_t c = 0; c < 4; ++c) dPlanes[c * seen.pixels + p] = lossWeight(p, int(c));
        RasterScratch scratch;
        rasterBackward(seen.builder.visible, seen.builder.tiles, seen.colors.data(), 3, planes.data(), dPlanes.data(), scratch, dColors.data(), dSplats.data());
        const std::vector<size_t> splats(seen.builder.visible.splatFromVisible.begin(), seen.builder.visible.splatFromVisible.end());
        Values out = geometryGradients<float>(seen.view, seen.geometry, splats, dSplats.data(), {});
        ValueGroup of{"gradient of colours", std::vector<double>(3 * seen.geometry.size()), 0};
        for (size_t v = 0; v < count; ++v)
            for (size_t c = 0; c < 3; ++c) of.values[3 * splats[v] + c] = double(dColors[v * stride + c]);
        out.push_back(std::move(of));
        return out;
    }
};

} // namespace

Column makeSimdColumn(const Hooks&) { return {"SIMD", "the engine that bakes", std::make_unique<SimdBackEnd>()}; }

} // namespace nacre::selftest
