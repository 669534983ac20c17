// Where the object of a dataset is, how large, and how bright its lights make it: what a bake makes equal for all datasets, whatever
// unit, origin and light unit they were captured in.
#pragma once

#include "dataset/olat_dataset.h"

#include <optional>

namespace nacre {

/// What the cameras of a dataset look at.
struct Framing {
    glm::dvec3 centre{0.0};
    double halfSize = 0;     // of what the middle camera sees around the centre
    bool met = false;        // the cameras' axes meet there; else it is a guess
};

/// From poses and intrinsics alone, those of the train split if there is one. Moves and grows with the world, exactly up to rounding; a few
/// cameras that look elsewhere do not matter. Cameras in one place or with parallel axes: the object is as far away as the lights.
Framing frameCameras(const std::vector<OlatSplit>& splits);

/// Mean radiance of the object over the irradiance / pi at `framing.centre`: median over some images with a point or directional light.
/// A white diffuse ball lit from everywhere has about 0.35. Empty if no image tells (no such light, object black or
/// invisible, file unreadable).
Result<std::optional<double>> apparentReflectance(const OlatDataset& dataset, const OlatSplit& split, const Framing& framing, ImageCache& images);

/// Beyond these no material explains it, but a wrong unit of light does. (Mean radiance: black velvet 0.005, a black car 0.02; a white wall
/// beside a flash 0.9.)
constexpr double kLeastReflectance = 0.003, kMostReflectance = 1.5;
constexpr double kLeastAgreement = 0.6; // of shading with the lights: right data above; lights of other images up to 0.5, when all are above the object
constexpr double kUsualReflectance = 0.25; // what a dataset beyond them is brought to
constexpr double kFarthestUnit = 1e25;     // units of light and length that far from usual ones are damage; an asset holds up to 1e30

/// The dataset in the frame that it is baked in: `frame` says which (joined to the one it already has). Datasets with an object of about
/// unit size near the origin and plausible lights stay as they are. Error kBadInput: units beyond kFarthestUnit.
Result<OlatDataset> normalised(const OlatDataset& dataset);

} // namespace nacre
