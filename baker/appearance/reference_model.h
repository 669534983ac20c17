// What the reference renderer asks of an appearance model: numbers per splat that are blended like colours, and what a pixel makes of them.
// One implementation per model of appearance/models.h; the scalar math is that of formats/appearance.
#pragma once

#include "appearance/models.h"
#include "appearance/shown_part.h"
#include "appearance/sss/sss_edit.h"
#include "base/light.h"
#include "base/result.h"
#include "splats/splat_asset.h"

#include <memory>
#include <span>

namespace nacre {

class ReferenceModel {
public:
    virtual ~ReferenceModel() = default;
    virtual int channels(size_t lights) const = 0;
    /// Writes channels() numbers of one splat.
    virtual void shade(size_t splat, const float* eye, std::span<const Light> lights, float* channels) const = 0;
    /// From blended channels (premultiplied) to the pixel's premultiplied radiance. ray: unit, from the eye through the pixel.
    virtual void resolve(const float* blended, float alpha, const float* eye, const float* ray, std::span<const Light> lights, float* rgb) const = 0;
    virtual float opacity(size_t splat) const = 0;
    virtual Status setEdits(std::span<const SplatEdit> edits) = 0;
};

/// Of a light in a mean over lights (PartInfo::radiance).
inline float irradianceWeight(const Light& light, const LightSample<float>& l) { return (light.intensity[0] + light.intensity[1] + light.intensity[2]) * l.falloff; }

#define NACRE_MODEL(name) \
    namespace name { std::unique_ptr<ReferenceModel> makeReference(const SplatAsset& asset, ShownPart part); }
NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL

/// Of the asset's model; `part`: one that it has (partsOf). `asset` must outlive it. Null if there is no such model.
std::unique_ptr<ReferenceModel> makeReferenceModel(const SplatAsset& asset, ShownPart part = ShownPart::kImage);

} // namespace nacre
