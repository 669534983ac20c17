// What a bake keeps of its splats from one step to the next.
#pragma once

#include "appearance/trainable.h"
#include "splat/geometry.h"
#include "train/ambient.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace nacre {

struct SplatState {
    SplatGeometry geometry;
    std::vector<AmbientRow> ambient;    // of all splats; empty: images hold no light of the surroundings
    std::vector<float> gradientSum;     // per splat, since the last change of splats: |d loss / d mean| in pixels,
    std::vector<uint32_t> seen;         // and how often it was active
    std::unique_ptr<TrainableAppearance> appearance;

    size_t count() const { return geometry.count(); }
    bool hasAmbient(int lights) const { return !ambient.empty() && appearance->channels(lights) == 3 * lights; }
};

} // namespace nacre
