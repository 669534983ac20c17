// The state of an interrupted bake in one file, so that --resume continues where it stopped.
#pragma once

#include "base/result.h"
#include "train/bake.h"
#include "train/trainer.h"

#include <span>
#include <vector>

namespace nacre {

/// How far the bake got.
struct BakeState {
    int32_t step = 0;
    int32_t stepsSinceReset = 0;  // of the trainer's statistics
    double seconds = 0;           // training time so far
    double trackSeconds = 0;      // of it, spent on held-out evaluation
    double nextTrack = 0;         // progress at which the next one is due
    std::vector<HistoryPoint> history;
    std::vector<PartWorth> parts; // what was tried to leave out; empty until then
    std::vector<LightEvidence> lights; // with refineLights
};

/// Of everything that shapes the result: dataset, model, quality, seed, caps, schedule. `options` as withDefaults leaves them.
uint64_t optionsHash(const OlatDataset& dataset, const OlatSplit& split, const BakeOptions& options);

std::vector<std::byte> encodeCheckpoint(uint64_t optionsHash, const BakeState& state, const Trainer& trainer);

/// Errors kBadInput: damaged (checksum), from another bake (hash), does not fit. `trainer` is unusable after an error.
Result<BakeState> decodeCheckpoint(std::span<const std::byte> bytes, uint64_t optionsHash, Trainer& trainer);

/// When the next checkpoint is due.
class CheckpointPace {
public:
    CheckpointPace(double seconds, double progress) : seconds_(seconds), progress_(progress) {}
    bool due(double seconds, double progress) const;
    void written(double began, double ended, double progress);

private:
    double seconds_, progress_, took_ = 0; // of the last one
};

} // namespace nacre
