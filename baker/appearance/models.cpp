// What is asked of a model by its name.
#include "appearance/reference_model.h"
#include "appearance/splat_radiance.h"
#include "appearance/trainable.h"

namespace nacre {

std::unique_ptr<TrainableAppearance> makeTrainableAppearance(const std::string& model, const AppearanceOptions& options)
{
#define NACRE_MODEL(name) \
    if (model == #name) return name::makeTrainable(options);
    NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    return nullptr;
}

std::unique_ptr<ReferenceModel> makeReferenceModel(const SplatAsset& asset, ShownPart part)
{
#define NACRE_MODEL(name) \
    if (asset.model == #name) return name::makeReference(asset, part);
    NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    return nullptr;
}

RadianceSampler makeRadianceSampler(const SplatAsset& asset)
{
#define NACRE_MODEL(name) \
    if (asset.model == #name) return name::makeRadianceSampler(asset);
    NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    return {};
}

} // namespace nacre
