// What sss keeps of its splats from step to step, and what a step needs to be told: all that a device has to know.
#pragma once

#include "appearance/sss/sss_network_simd.h"
#include "appearance/sss/sss_row.h"

#include <array>
#include <cstdint>
#include <vector>

namespace nacre {

using SssRow = std::array<float, kSssRowFloats>;

struct SssState {
    std::vector<SssRow> row, momentum, second;
    std::vector<uint8_t> visibility;    // [splats][kVisibilityTexels]; empty: nothing shades anything
    SssWeights weights;
    std::vector<float> networkMomentum, networkSecond; // [kSssAllWeights]
    float frame[4] = {0, 0, 0, 0};      // centre and 1 / half-size of the object
    bool residualOn = true, codeOn = true;
    bool nearness = false;              // the network is told how near a light is

    // Of the step in progress: set by beginStep. Corrections of Adam's moments.
    float rate = 1, correction1 = 1, correction2 = 1;
};

/// What the step in progress does to all splats alike, under so many lights.
SssStep sssStep(const SssState& state, int lights);

/// Of a model that is sss; else null.
SssState* sssState(TrainableAppearance& model);

} // namespace nacre
