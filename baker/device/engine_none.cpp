// In place of engine_cuda.cu where there is no nvcc.
#include "device/cuda_engine.h"

namespace nacre {

Result<CudaEngine> cudaEngine() { return Error{ErrorCode::kUnsupported, "this nacre was built without CUDA"}; }

} // namespace nacre
