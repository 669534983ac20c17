// How much memory a bake may use, and for what.
#pragma once

#include "train/bake.h"

namespace nacre {

/// Of this machine, or of the container that this process runs in.
size_t machineMemory();

/// What all images of the split take when they are ready for the loss.
size_t preparedBytes(const OlatSplit& split);

/// What is left of `memoryBytes` for prepared images (BakeOptions::imageBudgetBytes), beside a step and all else. kBadInput if that is too little to go on.
Result<size_t> imageBudget(size_t memoryBytes, const OlatDataset& dataset, const BakeOptions& options);

} // namespace nacre
