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
    ReferenceSss(const SplatAsset& asset, ShownPart part) : cloud_(asset.cloud), channels_(asset), part_(part)
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
        float weights = 0;
        for (size_t t = 0; t < lights.size(); ++t) {
            const Light& light = lights[t];
            const LightSample<float> l = sampleLight(light, p);
            const VisibilityMap map = channels_.visibility(splat);
            const float visibility = map.texels ? mapVisibility(map, l.dir) : 1.0f;
            float& share = out[size_t(kShares) + t];
            share = visibility;
            SssActivations<float> a{};
            if (channels_.network()) {
                float in[kSssLightInputs];
                const float distance = light.type == LightType::kPoint ? glm::distance(light.position, cloud_.positions[splat]) : -1.0f;
                sssLightInputs(toEye.dir, l.dir, visibility, distance * channels_.network()[kSssFrame + 3], in);
                a = sssNetworkLight(channels_.network(), first_[splat].data(), in);
                share *= a.share;
            }
            const float weight = irradianceWeight(light, l);
            weights += weight;
            for (int c = 0; c < 3; ++c) {
                float& sum = out[kScattered + c];
                if (part_ == ShownPart::kIncident) sum += weight * share;
                else if (part_ == ShownPart::kResidual) sum += weight * m.residual[c] * a.residual[c];
                else sum += m.subsurface * m.residual[c] * light.intensity[c] * l.falloff * a.residual[c];
            }
        }
        const bool mean = part_ == ShownPart::kIncident || part_ == ShownPart::kResidual;
        for (int c = 0; c < 3 && mean && weights > 0; ++c) out[kScattered + c] /= weights;
    }

    void resolve(const float* g, float alpha, const float* eye, const float* ray, std::span<const Light> lights, float* rgb) const override
    {
        switch (part_) {
        case ShownPart::kBaseColor: return void(std::copy_n(g + kSssBase, 3, rgb));
        case ShownPart::kNormal: return void(std::copy_n(g + kSssNormal, 3, rgb));
        case ShownPart::kRoughness: return void(std::fill_n(rgb, 3, g[kSssRoughness]));
        case ShownPart::kMetalness: return void(std::fill_n(rgb, 3, g[kSssMetalness]));
        case ShownPart::kSubsurfaceness: return void(std::fill_n(rgb, 3, g[kSssSubsurface]));
        case ShownPart::kDepth: return void(std::fill_n(rgb, 3, g[kSssDepth]));
        case ShownPart::kIncident:
        case ShownPart::kResidual:
        case ShownPart::kScattered: return void(std::copy_n(g + kScattered, 3, rgb));
        default: break;
        }
        std::fill_n(rgb, 3, 0.0f);
        if (part_ == ShownPart::kImage) std::copy_n(g + kScattered, 3, rgb);
        const SssPixel<float> pixel = sssPixel(g, alpha, eye, ray);
        for (size_t t = 0; pixel.inverseLength > 0 && t < lights.size(); ++t) {
            const LightSample<float> l = sampleLight(lights[t], pixel.point);
            const SssReflection<float> o = sssReflect(pixel.surface, pixel.wo, l.dir, highlightWidening(lights[t]));
            const float own[kSssLightChannels] = {g[size_t(kShares) + t], 0, 0, 0};
            for (int c = 0; c < 3; ++c) rgb[c] += sssRadiance(own, lights[t].intensity[c] * l.falloff, reflected(pixel.surface, o, c), c);
        }
    }

    Status setEdits(std::span<const SplatEdit> edits) override
    {
        materials_ = baked_;
        for (size_t i = 0; i < materials_.size(); ++i) applyEdits(edits, cloud_.positions[i], materials_[i]);
        return ok();
    }

private:
    /// The part's share of SssReflection::value, from the same terms: a difference would lose the diffuse one beneath a highlight of 1e5.
    float reflected(const SssSurface<float>& s, const SssReflection<float>& o, int c) const
    {
        if (part_ == ShownPart::kSpecular) return o.d * o.vis * o.fresnel[c] * o.nl;
        if (part_ == ShownPart::kDiffuse) return (1 - o.fresnel[c]) * (1 - s.metalness) * s.diffuse * s.base[c] * float(kSssInversePi) * o.nl;
        return o.value[c];
    }

    const SplatCloud& cloud_;
    const SssChannels channels_;
    const ShownPart part_;
    std::vector<SssMaterial> baked_, materials_;
    std::vector<std::array<float, kSssHidden1>> first_; // of the network
};

} // namespace

std::unique_ptr<ReferenceModel> sss::makeReference(const SplatAsset& asset, ShownPart part) { return std::make_unique<ReferenceSss>(asset, part); }

} // namespace nacre
