#include "gpu_model.h"

#include "asset.h"

namespace nacre {

GpuModel::GpuModel(NacreAssetImpl& asset) : asset_(asset), kept_(asset.context->gl) {}

std::unique_ptr<GpuModel> makeGpuModel(const std::string& model, NacreAssetImpl& asset)
{
#define NACRE_MODEL(name) \
    if (model == #name) return name::makeGpuModel(asset);
    NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    return nullptr;
}

} // namespace nacre
