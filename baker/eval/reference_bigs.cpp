#include "appearance/bigs/bigs.h"
#include "eval/reference_model.h"

#include <algorithm>

namespace nacre {

namespace {

class ReferenceBigs final : public ReferenceModel {
public:
    explicit ReferenceBigs(const SplatAsset& asset)
        : cloud_(asset.cloud), tDir_(asset.find("tDir")), tInd_(asset.find("tInd")), rho_(asset.find("rho")), s_(asset.find("s")),
          lobe_(asset.find("lobe")), visibility_(asset.find("visibility")), shadow_(asset.find("shadow")),
          sFunctions_(s_ ? bigsScatterFunctions(s_->components) : 0)
    {
    }

    int channels(size_t) const override { return 3; }
    float opacity(size_t splat) const override { return cloud_.opacities[splat]; }

    void shade(size_t splat, const float* eye, std::span<const Light> lights, float* color) const override
    {
        const BigsCoefficients<float> g{&tDir_->values[25 * splat], &tInd_->values[75 * splat], &rho_->values[3 * splat],
                                        s_ ? &s_->values[size_t(s_->components) * splat] : nullptr, sFunctions_,
                                        lobe_ ? &lobe_->values[kBigsLobeFloats * splat] : nullptr,
                                        visibility_ ? VisibilityMap{&visibility_->bytes[visibility_->components * splat], visibilitySize(visibility_->components)} : VisibilityMap{},
                                        shadow_ ? shadow_->values[splat] : 1.0f};
        const float* p = &cloud_.positions[splat].x;
        float y[kMaxShFunctions], a[3 * kMaxShFunctions];
        const LightSample<float> toEye = samplePointLight(eye, 0.0f, p);
        shBasis(25, toEye.dir[0], toEye.dir[1], toEye.dir[2], y);
        bigsContractView(g, y, a);
        std::fill_n(color, 3, 0.0f);
        for (const Light& light : lights) {
            const LightSample<float> l = sampleLight(light, p);
            shBasis(25, l.dir[0], l.dir[1], l.dir[2], y);
            const BigsTerms<float> t = bigsTerms(g, a, y);
            const BigsSharpTerms<float> sharp = bigsSharpTerms(g, toEye.dir, l.dir);
            for (int c = 0; c < 3; ++c) color[c] += light.intensity[c] * l.falloff * bigsTransport(t, sharp, c);
        }
    }

    void resolve(const float* blended, float, const float*, const float*, std::span<const Light>, float* rgb) const override { std::copy_n(blended, 3, rgb); }

    Status setEdits(std::span<const SplatEdit> edits) override
    {
        if (edits.empty()) return ok();
        return Error{ErrorCode::kUnsupported, "an asset of the model 'bigs' has no materials to edit; bake with --model sss"};
    }

private:
    const SplatCloud& cloud_;
    const Channel *tDir_, *tInd_, *rho_, *s_, *lobe_, *visibility_, *shadow_;
    int sFunctions_;
};

} // namespace

std::unique_ptr<ReferenceModel> makeReferenceBigs(const SplatAsset& asset) { return std::make_unique<ReferenceBigs>(asset); }

} // namespace nacre
