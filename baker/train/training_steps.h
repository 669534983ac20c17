// Feeds the trainer: which view a step sees, its images, and its lights as far as they have been corrected.
#pragma once

#include "train/image_screen.h"
#include "train/light_refinement.h"
#include "train/step_order.h"
#include "train/trainer.h"
#include "train/training_images.h"

#include <functional>
#include <map>

namespace nacre {

class TrainingSteps {
public:
    /// All that is referred to must outlive this object. `refinement`: nullptr to take the lights as they are stated.
    TrainingSteps(const OlatSplit& split, TrainingImages& images, StepOrder order, Trainer& trainer, LightRefinement* refinement);

    /// An image that cannot be read any more is left out of its step; a step that has none left changes nothing, its stats are empty.
    /// kIo once more than a third of all images are lost: then the disk is gone, not a file.
    Result<LossStats> take(const Trainer::Moment& moment);
    /// A step that may be undone: nothing is learned about the lights. splatErrors as Trainer::step.
    Result<LossStats> takeOnTrial(const Trainer::Moment& moment, double* splatErrors);

    /// What the views show beyond a render without highlights: of those of the pass from `step` on, as many as say enough and fit into memory; none
    /// if those would be too few. False once `goOn`, asked for each view, says no.
    bool gatherEvidence(int step, const std::function<bool()>& goOn, std::vector<ViewEvidence>& views);

    size_t passLength() const { return order_.passLength(); }
    std::vector<UnusableImage> lost() const;

private:
    void expectFrom(int step);
    Result<LossStats> take(const Trainer::Moment& moment, bool refines, double* splatErrors);

    const OlatSplit& split_;
    TrainingImages& images_;
    StepOrder order_, ahead_; // the same; each remembers the pass it is in
    Trainer& trainer_;
    LightRefinement* refinement_;
    std::map<uint32_t, std::string> lost_; // why, by image
};

} // namespace nacre
