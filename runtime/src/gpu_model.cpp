#include "gpu_model.h"

namespace nacre {

std::unique_ptr<GpuModel> makeGpuBigs(NacreAssetImpl& asset);
std::unique_ptr<GpuModel> makeGpuSss(NacreAssetImpl& asset);

static constexpr struct {
    const char* name;
    std::unique_ptr<GpuModel> (*make)(NacreAssetImpl&);
} kModels[] = {
    {"bigs", makeGpuBigs},
    {"sss", makeGpuSss},
};

std::unique_ptr<GpuModel> makeGpuModel(const std::string& model, NacreAssetImpl& asset)
{
    for (const auto& m : kModels)
        if (model == m.name) return m.make(asset);
    return nullptr;
}

} // namespace nacre
