#include "train/held_out.h"

namespace nacre {

Result<HeldOutPsnr> measureHeldOut(Trainer& trainer, const OlatSplit& split, TrainingImages& images)
{
    ImageLoss loss;
    std::vector<float> planes, dPlanes;
    HeldOutPsnr sum;
    for (uint32_t i = 0; i < split.images.size(); ++i) {
        const OlatImage& image = split.images[i];
        if (!image.light.isPunctual()) continue;
        auto reference = images.get(i);
        if (!reference) return reference.error();
        trainer.render(split.cameras[image.camera], std::span(&image.light, 1), planes);
        dPlanes.resize(planes.size());
        const PreparedImage* r = reference->get();
        const LossStats stats = loss.evaluate(planes.data(), &r, 1, {}, dPlanes.data());
        const double whole = psnrFrom(stats.squaredError, stats.count);
        sum.whole += whole;
        sum.masked += stats.countMasked > 0 ? psnrFrom(stats.squaredErrorMasked, stats.countMasked) : whole;
        ++sum.images;
    }
    if (sum.images) sum.whole /= sum.images, sum.masked /= sum.images;
    return sum;
}

} // namespace nacre
