// What sss keeps of its splats from step to step, and what a step needs to be told: all that a device has to know.
#pragma once

#include "appearance/sss/sss_network_simd.h"

#include <array>
#include <cstdint>
#include <vector>

namespace nacre {

// One row per splat. All before the normal go through a logistic function.
constexpr int kSssRowBase = 0, kSssRowRough = 3, kSssRowMetal = 4, kSssRowScatter = 5, kSssRowNormal = 6, kSssRowCode = 9,
              kSssRowFloats = kSssRowCode + kSssCodeInputs;
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

/// Of a model that is sss; else null.
SssState* sssState(TrainableAppearance& model);

} // namespace nacre
