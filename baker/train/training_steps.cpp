#include "train/training_steps.h"

#include <algorithm>
#include <iterator>

namespace nacre {

constexpr int kRefineLightsEvery = 8;     // steps
constexpr double kRefineLightsFrom = 0.1; // of the bake: before, the splats are still too wrong to tell

TrainingSteps::TrainingSteps(const OlatSplit& split, TrainingImages& images, StepOrder order, Trainer& trainer,
                             LightRefinement* refinement)
    : split_(split), images_(images), order_(order), ahead_(std::move(order)), trainer_(trainer), refinement_(refinement)
{
}

/// Tells what the steps from this one on will see.
void TrainingSteps::expectFrom(int step)
{
    constexpr int kSteps = 8; // enough that no thread waits for the step to end; few bytes beside those of a step
    std::vector<uint32_t> images;
    for (int k = 0; k < kSteps; ++k) {
        const CameraImages view = ahead_.at(step + k);
        std::copy_if(view.images.begin(), view.images.end(), std::back_inserter(images), [&](uint32_t i) { return !lost_.count(i); });
    }
    images_.expect(images);
}

Result<LossStats> TrainingSteps::take(const Trainer::Moment& moment)
{
    const bool refines = moment.progress >= kRefineLightsFrom && moment.step % kRefineLightsEvery == 0;
    return take(moment, refines, nullptr);
}

Result<LossStats> TrainingSteps::takeOnTrial(const Trainer::Moment& moment, double* splatErrors)
{
    return take(moment, false, splatErrors);
}

Result<LossStats> TrainingSteps::take(const Trainer::Moment& moment, bool refines, double* splatErrors)
{
    CameraImages view = order_.at(moment.step);
    std::vector<std::shared_ptr<const PreparedImage>> held;
    const PreparedImage* references[kMaxLightsPerStep];
    Light lights[kMaxLightsPerStep];
    std::vector<uint32_t> readable;
    for (const uint32_t i : view.images) {
        if (lost_.count(i)) continue;
        auto image = images_.get(i);
        if (image) held.push_back(*image), readable.push_back(i);
        else lost_[i] = image.error().message;
    }
    expectFrom(moment.step + 1);
    if (3 * lost_.size() > split_.images.size())
        return Error{ErrorCode::kIo, "more than a third of the training images can no longer be read; " + lost_.begin()->second};
    if (readable.empty()) return LossStats{};
    view.images = std::move(readable);
    for (size_t i = 0; i < view.images.size(); ++i) {
        references[i] = held[i].get();
        lights[i] = refinement_ ? refinement_->light(view.images[i]) : split_.images[view.images[i]].light;
    }
    const Camera& camera = split_.cameras[view.camera];
    // before the step, when the splats have not just been fitted to these images
    if (refinement_ && refines)
        refinement_->observe(view.images, references,
                             [&](std::span<const Light> l, std::vector<float>& planes) { trainer_.render(camera, l, planes); });
    return trainer_.step(camera, std::span(lights, view.images.size()), references, moment, splatErrors);
}

bool TrainingSteps::gatherEvidence(int step, const std::function<bool()>& goOn, std::vector<ViewEvidence>& views)
{
    constexpr size_t kEnough = 400, kTooFew = 20, kBytes = size_t(512) << 20, kBytesPerSplat = sizeof(SplatEvidence) + 8;
    const size_t count = std::min({order_.passLength(), kEnough, kBytes / (kBytesPerSplat * std::max<size_t>(trainer_.count(), 1))});
    if (count < std::min(kTooFew, order_.passLength())) return true;
    for (size_t k = 0; k < count; ++k) {
        if (!goOn()) return false;
        const CameraImages view = order_.at(step + int(k));
        expectFrom(step + int(k));
        std::vector<std::shared_ptr<const PreparedImage>> held;
        const PreparedImage* references[kMaxLightsPerStep];
        std::vector<Light> lights;
        for (const uint32_t i : view.images) {
            const auto image = lost_.count(i) ? Result<std::shared_ptr<const PreparedImage>>(Error{}) : images_.get(i);
            if (!image) continue; // the next step that needs it says so
            references[held.size()] = image->get();
            held.push_back(*image), lights.push_back(refinement_ ? refinement_->light(i) : split_.images[i].light);
        }
        if (!held.empty()) views.push_back(trainer_.evidence(split_.cameras[view.camera], lights, references));
    }
    return true;
}

std::vector<UnusableImage> TrainingSteps::lost() const
{
    std::vector<UnusableImage> out;
    for (const auto& [image, why] : lost_) out.push_back({split_.images[image].path, why});
    return out;
}

} // namespace nacre
