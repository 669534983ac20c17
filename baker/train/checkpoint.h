// The state of an interrupted bake in one file, so that --resume continues where it stopped.
#pragma once

#include "base/result.h"
#include "train/bake.h"
#include "train/learnt_masks.h"
#include "train/trainer.h"

#include <span>
#include <vector>

namespace nacre {

/// How far the bake got.
struct BakeState {
    int32_t step = 0;
    int32_t stepsSinceReset = 0;  // of the trainer's statistics
    double gain = 1;              // of the lights that it learns under; follows from pixels, which a pack rounds
    double seconds = 0;           // training time so far
    double nextTrack = 0;         // progress at which the next one is due
    std::vector<HistoryPoint> history;
    std::vector<PartWorth> parts; // what was tried to leave out; empty until then
    std::vector<LightEvidence> lights; // with refineLights
    bool masksTried = false;            // of images that have none: they are learnt once, or not at all
    std::shared_ptr<LearntMasks> masks; // null: none
};

/// Everything that shapes the result, as lines: model, quality, seed, caps, schedule, and a hash of the dataset. `options` as withDefaults
/// leaves them; `dataset` is as it was stated, before pixels have a say in its frame and lights.
std::string bakeIdentity(const OlatDataset& dataset, const OlatSplit& split, const BakeOptions& options);

/// Of two identities: what the first has and the second has not, in words.
std::string identityDifference(const std::string& theirs, const std::string& ours);

/// `skipped` are the images that the bake does without (BakeOptions).
std::vector<std::byte> encodeCheckpoint(const std::string& identity, const std::vector<UnusableImage>& skipped, const BakeState& state,
                                        const Trainer& trainer);

/// `cameras`: of the training images. Errors kBadInput: damaged (checksum), from another bake (says what differs), does not fit. `trainer` is unusable after an error.
Result<BakeState> decodeCheckpoint(std::span<const std::byte> bytes, const std::string& identity, size_t cameras, Trainer& trainer);

/// The images that the interrupted bake does without, so that it goes on without them whatever has become of the files.
Result<std::vector<UnusableImage>> skippedImages(std::span<const std::byte> checkpoint);
/// BakeState::gain, which must be known before there is a trainer.
Result<double> learningGainOf(std::span<const std::byte> checkpoint);

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
