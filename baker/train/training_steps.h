// Feeds the trainer: which view a step sees, its images, and its lights as far as they have been corrected.
#pragma once

#include "train/light_refinement.h"
#include "train/step_order.h"
#include "train/trainer.h"
#include "train/training_images.h"

namespace nacre {

class TrainingSteps {
public:
    /// All that is referred to must outlive this object. `refinement`: nullptr to take the lights as they are stated.
    TrainingSteps(const OlatSplit& split, TrainingImages& images, StepOrder order, Trainer& trainer, LightRefinement* refinement);

    /// Errors: those of loading an image; then the trainer has not stepped.
    Result<LossStats> take(const Trainer::Moment& moment);
    /// A step that may be undone: nothing is learned about the lights. splatErrors as Trainer::step.
    Result<LossStats> takeOnTrial(const Trainer::Moment& moment, double* splatErrors);

    size_t passLength() const { return order_.passLength(); }

private:
    Result<LossStats> take(const Trainer::Moment& moment, bool refines, double* splatErrors);

    const OlatSplit& split_;
    TrainingImages& images_;
    StepOrder order_;
    Trainer& trainer_;
    LightRefinement* refinement_;
};

} // namespace nacre
