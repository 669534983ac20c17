// Which images each step of a bake sees.
#pragma once

#include "dataset/olat_dataset.h"

#include <cstdint>
#include <vector>

namespace nacre {

/// One camera, and images of it that are trained together.
struct CameraImages {
    uint32_t camera;
    std::vector<uint32_t> images;
};

/// The images under point and directional lights, by camera; cameras without any are left out.
std::vector<CameraImages> groupByCamera(const OlatSplit& split);

/// Every camera once per pass, in random order, under up to kMaxLightsPerStep of its lights at random.
class StepOrder {
public:
    StepOrder(std::vector<CameraImages> groups, uint64_t seed);
    /// Depends on nothing but the seed and the step, which counts from 1.
    CameraImages at(int step);
    size_t passLength() const { return groups_.size(); }

private:
    std::vector<CameraImages> groups_;
    uint64_t seed_;
    std::vector<size_t> order_; // of the groups in pass_
    size_t pass_ = 0;
};

} // namespace nacre
