#include "appearance/reference_model.h"
#include "appearance/sss/sss.h"
#include "appearance/sss/sss_asset.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace nacre {

namespace {

// Channels: those of sss.h once per view, scattered light of all lights, then the incident share of each light.
constexpr int kScattered = kSssSurfaceChannels, kShares = kScattered + 3;

class ReferenceSss final : public ReferenceModel {
public:
    explicit ReferenceSss(const SplatAsset& asset) : cloud_(asset.cloud), channels_(asset)
    {
        for (size_t i = 0; i < cloud_.count; ++i) materials_.push_back(channels_.material(i));
        baked_ = materials_;
        if (!channels_.network()) return;
        first_.resize(cloud_.count);
        for (size_t i = 0; i < cloud_.count; ++i) channels_.firstLayer(i, first_[i].data());
    }

    int channels(size_t lights) const override { return kShares + int(lights); }
    float opacity(size_t splat) const override { return materials_[splat].opacity; }

    void shade(size_t splat, const float* eye, std::span<const Light> lights, float* out) const override
    {
        const SssMaterial& m = materials_[splat];
        const float* p = &cloud_.positions[splat].x;
        const LightSample<float> toEye = samplePointLight(eye, 0.0f, p);
        std::copy_n(m.normal, 3, out + kSssNormal);
        std::copy_n(m.base, 3, out + kSssBase);
        out[kSssRoughness] = m.roughness, out[kSssMetalness] = m.metalness, out[kSssSubsurface] = m.subsurface;
        out[kSssDepth] = std::hypot(p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]);
        std::fill_n(out + kScattered, 3, 0.0f);
        for (size_t t = 0; t < lights.size(); ++t) {
            const Light& light = lights[t];
            const LightSample<float> l = sampleLight(light, p);
            const VisibilityMap map = channels_.visibility(splat);
            const float visibility = map.texels ? mapVisibility(map, l.dir) : 1.0f;
            out[size_t(kShares) + t] = visibility;
            if (!channels_.network()) continue;
            float in[kSssLightInputs];
            const float distance = light.type == LightType::kPoint ? glm::distance(light.position, cloud_.positions[splat]) : -1.0f;
            sssLightInputs(toEye.dir, l.dir, visibility, distance * channels_.network()[kSssFrame + 3], in);
            const SssActivations<float> a = sssNetworkLight(channels_.network(), first_[splat].data(), in);
            out[size_t(kShares) + t] *= a.share;
            for (int c = 0; c < 3; ++c) out[kScattered + c] += m.subsurface * m.residual[c] * light.intensity[c] * l.falloff * a.residual[c];
        }
    }

    void resolve(const float* g, float alpha, const float* eye, const float* ray, std::span<const Light> lights, float* rgb) const override
    {
        std::copy_n(g + kScattered, 3, rgb);
        const SssPixel<float> pixel = sssPixel(g, alpha, eye, ray);
        for (size_t t = 0; pixel.inverseLength > 0 && t < lights.size(); ++t) {
            const LightSample<float> l = sampleLight(lights[t], pixel.point);
            const SssReflection<float> o = sssReflect(pixel.surface, pixel.wo, l.dir, highlightWidening(lights[t]));
            const float own[kSssLightChannels] = {g[size_t(kShares) + t], 0, 0, 0};
            for (int c = 0; c < 3; ++c) rgb[c] += sssRadiance(own, lights[t].intensity[c] * l.falloff, o.value[c], c);
        }
    }

    Status setEdits(std::span<const SplatEdit> edits) override
    {
        materials_ = baked_;
        for (size_t i = 0; i < materials_.size(); ++i) applyEdits(edits, cloud_.positions[i], materials_[i]);
        return ok();
    }

private:
    const SplatCloud& cloud_;
    const SssChannels channels_;
    std::vector<SssMaterial> baked_, materials_;
    std::vector<std::array<float, kSssHidden1>> first_; // of the network
};

} // namespace

std::unique_ptr<ReferenceModel> sss::makeReference(const SplatAsset& asset) { return std::make_unique<ReferenceSss>(asset); }

} // namespace nacre
