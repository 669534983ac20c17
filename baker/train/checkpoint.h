// The state of an interrupted bake in one file, so that --resume continues where it stopped.
#pragma once

#include "base/result.h"
#include "train/trainer.h"

#include <string>

namespace nacre {

/// What must agree between the interrupted bake and the one that resumes it, and how far it got.
struct CheckpointHeader {
    uint64_t optionsHash = 0; // of everything that shapes the result: dataset, model, quality, seed, caps, schedule
    int32_t step = 0;
    double seconds = 0;       // training time so far
};

Status writeCheckpoint(const std::string& path, const CheckpointHeader& header, const Trainer& trainer);

/// Errors kBadInput: unreadable, damaged (checksum), from another bake (hash).
Result<CheckpointHeader> readCheckpoint(const std::string& path, uint64_t optionsHash, Trainer& trainer);

} // namespace nacre
