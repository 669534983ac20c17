#include "train/held_out.h"

#include <algorithm>

namespace nacre {

constexpr size_t kMostImages = 48; // enough to tell models and moments apart; a large split would take longer than the training

OlatDataset holdOut(OlatDataset dataset, uint32_t every)
{
    std::erase_if(dataset.splits, [](const OlatSplit& s) { return s.name == "test"; });
    for (OlatSplit& train : dataset.splits) {
        if (train.name != "train") continue;
        OlatSplit judges = train;
        judges.name = "test";
        const auto judge = [every](const OlatImage& image) { return image.camera % every == every - 1; };
        std::erase_if(judges.images, [&](const OlatImage& image) { return !judge(image); });
        std::erase_if(train.images, judge);
        dataset.splits.push_back(std::move(judges));
        break;
    }
    return dataset;
}

HeldOutPsnr measureHeldOut(Trainer& trainer, const OlatSplit& split, TrainingImages& images)
{
    ImageLoss loss;
    std::vector<float> planes, dPlanes;
    HeldOutPsnr sum;
    std::vector<uint32_t> usable;
    for (uint32_t i = 0; i < split.images.size(); ++i)
        if (split.images[i].light.isPunctual()) usable.push_back(i);
    const size_t count = std::min(usable.size(), kMostImages);
    for (size_t k = 0; k < count; ++k) {
        const uint32_t i = usable[k * usable.size() / count];
        const OlatImage& image = split.images[i];
        auto reference = images.get(i);
        if (!reference) continue;
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
