#include "appearance/bigs/bigs_asset.h"
#include "appearance/reference_model.h"

#include <algorithm>

namespace nacre {

namespace {

class ReferenceBigs final : public ReferenceModel {
public:
    explicit ReferenceBigs(const SplatAsset& asset) : cloud_(asset.cloud), channels_(asset) {}

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
        for (const Light& light : lights) {
            const LightSample<float> l = sampleLight(light, p);
            shBasis(25, l.dir[0], l.dir[1], l.dir[2], y);
            const BigsTerms<float> t = bigsTerms(g, a, y);
            const BigsSharpTerms<float> sharp = bigsSharpTerms(g, toEye.dir, l.dir, highlightWidening(light));
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
    BigsChannels channels_;
};

} // namespace

std::unique_ptr<ReferenceModel> bigs::makeReference(const SplatAsset& asset) { return std::make_unique<ReferenceBigs>(asset); }

} // namespace nacre
