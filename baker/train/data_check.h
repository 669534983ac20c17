// What is wrong with training data that can be read and yet cannot become a good asset.
#pragma once

#include "dataset/olat_dataset.h"
#include "splat/visual_hull.h"

#include <string>
#include <vector>

namespace nacre {

/// What the alphas of the training images say about where the object is.
enum class Silhouettes {
    kGood,   // object and background
    kOpaque, // the object everywhere: images without alpha
    kEmpty,  // the object nowhere
};

/// Looks at cameras, lights and the pixels of some images. One line per finding: what is wrong and what to try; none if the data is sound.
/// Errors: those of loading an image.
Result<std::vector<std::string>> checkTrainingData(const OlatDataset& dataset, const OlatSplit& split, Silhouettes silhouettes);

/// Point lights that touch the object get one warning. One deep inside it has no direction that the splats could agree on:
/// a mistake in the data, kBadInput.
/// `frame` is that of the dataset, in whose units messages speak.
Status checkLights(const AssetFrame& frame, const OlatSplit& split, const VisualHull& hull, std::vector<std::string>& warnings);

} // namespace nacre
