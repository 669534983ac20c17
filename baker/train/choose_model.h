// `--model auto`: which appearance model suits an object, found by trying.
#pragma once

#include "train/bake.h"

#include <span>

namespace nacre {

/// What a short bake of one model reached on cameras that it did not see.
struct ModelTrial {
    std::string model;
    double psnrMasked = 0;
};

/// What is left of an interrupted `--model auto`: what it does without, and the models that had been tried.
struct TrialRecord {
    std::vector<UnusableImage> skipped;
    std::vector<ModelTrial> trials;
};

/// As a file. `identity` as bakeIdentity gives it for the options before the choice. Errors kBadInput: damaged, of another bake.
std::vector<std::byte> encodeTrials(const std::string& identity, const TrialRecord& record);
Result<TrialRecord> decodeTrials(std::span<const std::byte> bytes);
Status checkTrials(std::span<const std::byte> bytes, const std::string& identity);

/// A small bake of every model, 6 % of the work of `options` each: a quarter of the splats and images of down to 100 pixels, on train
/// images without every eighth camera, which judge them. Best first. The bake proper has the rest: restOf(options).
/// Models in `trials` are not tried again; `tried` is called with all whenever one more has been.
Result<std::vector<ModelTrial>> tryModels(const OlatDataset& dataset, const BakeOptions& options, std::vector<ModelTrial> trials,
                                          const std::function<Status(const std::vector<ModelTrial>&)>& tried,
                                          const std::function<void(const BakeProgress&)>& progress, const std::atomic<bool>* cancel);

/// `options` less what the trials have used.
BakeOptions restOf(BakeOptions options);

} // namespace nacre
