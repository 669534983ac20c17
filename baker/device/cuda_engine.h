// Training on a CUDA card, where this build and this machine can.
#pragma once

#include "base/result.h"
#include "train/step_engine.h"

#include <string>

namespace nacre {

struct CudaEngine {
    MakeStepEngine make;
    std::string card; // its name
};

/// kUnsupported with the reason: no CUDA in this build, no driver, no card.
Result<CudaEngine> cudaEngine();

} // namespace nacre
