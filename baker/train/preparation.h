// What a bake starts from: all that is found in the dataset before the first step.
#pragma once

#include "train/bake.h"
#include "train/object_region.h"
#include "train/step_order.h"
#include "train/trainer.h"
#include "train/training_images.h"

#include <functional>

namespace nacre {

struct Preparation {
    const OlatSplit* split = nullptr; // to train
    std::vector<CameraImages> views;  // its images that train
    std::unique_ptr<TrainingImages> images;
    glm::vec3 center{0};              // of the object
    std::optional<ObjectRegion> region; // of the object, in images without masks
    TrainerOptions trainer;
    AppearanceOptions appearance;
    std::vector<OrientedPoint> points; // where the first splats lie,
    float spacing = 0;                // so far apart,
    bool flat = false;                // and whether on a surface; or, if there are any,
    InitialSplats init;               // the first splats themselves
    std::vector<std::string> warnings;
};

/// Called often, with the name of what is being done ("loading", "hull"). An error ends the preparation with it.
using Tick = std::function<Status(const char* stage)>;

/// What a step with images of this camera takes.
size_t stepBytes(const Camera& camera);
/// kUnsupported: images so large that a step does not fit a machine with so much memory.
Status checkMemory(const Camera& camera, size_t machineBytes);

/// `options` as withDefaults leaves them. The result refers to the dataset. Errors: a dataset that nothing can be learned from.
Result<Preparation> prepare(const OlatDataset& dataset, const BakeOptions& options, const Tick& tick);

} // namespace nacre
