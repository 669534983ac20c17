// How good the splats are on images that they are not trained on, while they train.
#pragma once

#include "train/trainer.h"
#include "train/training_images.h"

namespace nacre {

/// Train images of every so many-th camera become the test split, which a bake tracks, instead of the one that there is. Empty if there are too few cameras.
OlatDataset holdOut(OlatDataset dataset, uint32_t every);

/// PSNR in dB, means over images.
struct HeldOutPsnr {
    double whole = 0, masked = 0; // masked: of the object's pixels
    int images = 0;
};

/// Over the images of the split under point and directional lights, at most 48 of them, evenly spread. Those that cannot be read are left out.
HeldOutPsnr measureHeldOut(Trainer& trainer, const OlatSplit& split, TrainingImages& images);

} // namespace nacre
