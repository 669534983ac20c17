// `--model auto`: which appearance model suits an object, found by trying.
#pragma once

#include "train/bake.h"

namespace nacre {

/// What a short bake of one model reached on cameras that it did not see.
struct ModelTrial {
    std::string model;
    double psnrMasked = 0;
};

/// A small bake of every model, 6 % of the work of `options` each: a quarter of the splats and images of down to 100 pixels, on train
/// images without every eighth camera, which judge them. Best first. The bake proper has the rest: restOf(options).
Result<std::vector<ModelTrial>> tryModels(const OlatDataset& dataset, const BakeOptions& options,
                                          const std::function<void(const BakeProgress&)>& progress, const std::atomic<bool>* cancel);

/// `options` less what the trials have used.
BakeOptions restOf(BakeOptions options);

} // namespace nacre
