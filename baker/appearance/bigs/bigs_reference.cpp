#include "appearance/bigs/bigs_asset.h"
#include "appearance/reference_model.h"

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>

namespace nacre {

namespace {

class ReferenceBigs final : public ReferenceModel {
public:
    ReferenceBigs(const SplatAsset& asset, ShownPart part) : cloud_(asset.cloud), channels_(asset), part_(part) {}

    int channels(size_t) const override { return 3; }
    float opacity(size_t splat) const override { return cloud_.opacities[splat]; }

    void shade(size_t splat, const float* eye, std::span<const Light> lights, float* color) const override
    {
        const BigsCoefficients<float> g = channels_.at(splat);
        const float* p = &cloud_.positions[splat].x;
        float y[kMaxShFunctions], a[3 * kMaxShFunctions];
        const LightSample<float> toEye = samplePointLight(eye, 0.0f, p);
        shBasis(25, toEye.dir[0], toEye.dir[1], toEye.dir[2], y);
        bigsContractView(g, y, a);
        std::fill_n(color, 3, 0.0f);
        if (part_ == ShownPart::kNormal) return normal(splat, g, toEye.dir, color);
        if (part_ == ShownPart::kDepth) return void(std::fill_n(color, 3, std::hypot(p[0] - eye[0], p[1] - eye[1], p[2] - eye[2])));
        if (part_ == ShownPart::kRho) return void(std::copy_n(g.rho, 3, color));
        float weights = 0;
        for (const Light& light : lights) {
            const LightSample<float> l = sampleLight(light, p);
            shBasis(25, l.dir[0], l.dir[1], l.dir[2], y);
            const BigsTerms<float> t = bigsTerms(g, a, y);
            const BigsSharpTerms<float> sharp = bigsSharpTerms(g, toEye.dir, l.dir, highlightWidening(light));
            if (isMean()) {
                const float weight = irradianceWeight(light, l);
                weights += weight;
                for (int c = 0; c < 3; ++c) color[c] += weight * perIrradiance(g, t, sharp, c);
                continue;
            }
            for (int c = 0; c < 3; ++c) color[c] += light.intensity[c] * l.falloff * transport(g, t, sharp, toEye.dir, l.dir, c);
        }
        for (int c = 0; c < 3 && weights > 0; ++c) color[c] /= weights;
    }

    void resolve(const float* blended, float, const float*, const float*, std::span<const Light>, float* rgb) const override { std::copy_n(blended, 3, rgb); }

    Status setEdits(std::span<const SplatEdit> edits) override
    {
        if (edits.empty()) return ok();
        return Error{ErrorCode::kUnsupported, "an asset of the model 'bigs' has no materials to edit; bake with --model sss"};
    }

private:
    bool isMean() const { return part_ == ShownPart::kTDir || part_ == ShownPart::kTInd || part_ == ShownPart::kS || part_ == ShownPart::kVisibility; }

    float perIrradiance(const BigsCoefficients<float>& g, const BigsTerms<float>& t, const BigsSharpTerms<float>& sharp, int c) const
    {
        switch (part_) {
        case ShownPart::kTDir: return std::max(t.direct, 0.0f);
        case ShownPart::kTInd: return std::max(t.indirect[c], 0.0f);
        case ShownPart::kS: return t.scatter[c] - g.rho[c];
        default: return sharp.visible;
        }
    }

    /// The part's share of bigsTransport.
    float transport(const BigsCoefficients<float>& g, BigsTerms<float> t, BigsSharpTerms<float> sharp, const float* wo, const float* wi, int c) const
    {
        if (part_ == ShownPart::kImage) return bigsTransport(t, sharp, c);
        const float forward = g.forward ? g.forward[1 + c] * bigsForward(g.forward[0], wo, wi) : 0.0f;
        if (part_ == ShownPart::kForward) sharp.lobe[c] = forward;
        if (part_ == ShownPart::kLobe) sharp.lobe[c] -= forward;
        if (part_ == ShownPart::kDirect || part_ == ShownPart::kIndirect) sharp.lobe[c] = 0;
        if (part_ != ShownPart::kDirect) t.direct = 0;
        if (part_ != ShownPart::kIndirect) t.indirect[c] = 0;
        return bigsTransport(t, sharp, c);
    }

    /// That of the highlight, or the splat's thinnest axis, towards the eye.
    void normal(size_t splat, const BigsCoefficients<float>& g, const float* toEye, float* n) const
    {
        if (g.lobe) return void(std::copy_n(g.lobe, 3, n));
        const glm::vec3& s = cloud_.scales[splat];
        const int thinnest = s.x <= s.y && s.x <= s.z ? 0 : s.y <= s.z ? 1 : 2;
        glm::vec3 axis = glm::mat3_cast(glm::normalize(cloud_.rotations[splat]))[thinnest];
        if (axis.x * toEye[0] + axis.y * toEye[1] + axis.z * toEye[2] < 0) axis = -axis;
        std::copy_n(&axis.x, 3, n);
    }

    const SplatCloud& cloud_;
    BigsChannels channels_;
    ShownPart part_;
};

} // namespace

std::unique_ptr<ReferenceModel> bigs::makeReference(const SplatAsset& asset, ShownPart part) { return std::make_unique<ReferenceBigs>(asset, part); }

} // namespace nacre
