// The engine of engine.h for CUDA cards. Only nvcc compiles this.
#include "device/cuda_engine.h"
#include "device/engine.h"

namespace nacre {

Result<CudaEngine> cudaEngine()
{
    try {
        const cuda::Device card;
        // Each bake opens the card anew: a fault of one ends with it.
        const auto make = [](SplatState& state, const StepOptions& options) -> std::unique_ptr<StepEngine> {
            return std::make_unique<cuda::DeviceEngine>(std::make_unique<cuda::Device>(), state, options);
        };
        return CudaEngine{make, card.name()};
    } catch (const DeviceError& e) {
        return Error{ErrorCode::kUnsupported, e.what()};
    }
}

} // namespace nacre
