// What bigs keeps of its splats from step to step, and what a step needs to be told: all that a device has to know.
#pragma once

#include "appearance/bigs/bigs_training.h"
#include "appearance/shared_adam.h"

#include <cstdint>
#include <vector>

namespace nacre {

// Bounds of the logarithms of sharpness.
constexpr float kMinLogSharpness = 0.7f, kMaxLogSharpness = 7.0f; // GGX roughness (square root of alpha) 0.76 down to 0.17
constexpr float kMinLogForward = -1, kMaxLogForward = 5;          // g of Henyey and Greenstein 0.16 up to 0.89

struct BigsState {
    BigsParameters parameters;
    SharedAdam shared, sharedForward;   // of the lobe's sharpness and colour, and of the light that goes on forward
    std::vector<uint32_t> neighbours;   // splatNeighbours, [splats][kSplatNeighbours]; empty: not needed yet, or splats have changed places

    // Of the step in progress: set by beginStep.
    BigsBands bands;
    BigsUpdate update;
    BigsRandomLight random;
    SharedAdam::Rates sharedRates;
    float shareRate = 0;                // of shareIndirect, before the step looks at T_ind; 0: not in this step
};

/// Of a model that is bigs; else null.
BigsState* bigsState(TrainableAppearance& model);

} // namespace nacre
