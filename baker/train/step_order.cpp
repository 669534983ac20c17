#include "train/step_order.h"

#include "appearance/trainable.h"
#include "base/random.h"

#include <numeric>

namespace nacre {

std::vector<CameraImages> groupByCamera(const OlatSplit& split)
{
    std::vector<CameraImages> groups(split.cameras.size());
    for (uint32_t i = 0; i < split.images.size(); ++i)
        if (split.images[i].light.isPunctual()) groups[split.images[i].camera].images.push_back(i);
    for (uint32_t c = 0; c < groups.size(); ++c) groups[c].camera = c;
    std::erase_if(groups, [](const CameraImages& g) { return g.images.empty(); });
    return groups;
}

template <class T> static void shuffle(std::vector<T>& items, Random random)
{
    for (size_t i = items.size(); i > 1; --i) std::swap(items[i - 1], items[random.below(uint32_t(i))]);
}

StepOrder::StepOrder(std::vector<CameraImages> groups, uint64_t seed) : groups_(std::move(groups)), seed_(seed) {}

CameraImages StepOrder::at(int step)
{
    const size_t pass = size_t(step - 1) / groups_.size();
    if (order_.empty() || pass != pass_) {
        pass_ = pass;
        order_.resize(groups_.size());
        std::iota(order_.begin(), order_.end(), size_t(0));
        shuffle(order_, Random(seed_, uint64_t(pass) << 8 | 2));
    }
    CameraImages group = groups_[order_[size_t(step - 1) % groups_.size()]];
    shuffle(group.images, Random(seed_, uint64_t(step) << 8 | 3));
    if (group.images.size() > kMaxLightsPerStep) group.images.resize(kMaxLightsPerStep);
    return group;
}

} // namespace nacre
