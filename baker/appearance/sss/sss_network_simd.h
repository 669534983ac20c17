// The sss network for sixteen Gaussians under one light at a time. SIMD twin of sss_network.h and sss_network_backward.h; parity test:
// tests/unit/train_sss.cpp.
//
// Lanes are Gaussians, so a layer is a product of a matrix of weights, the same for all, with sixteen columns. Sums over Gaussians (the
// gradient of the weights) turn the lanes around: columns become rows of features, and a weight row is a vector.
#pragma once

#include "appearance/sss/sss_network.h"
#include "render/aligned_vector.h"

#include <span>

namespace nacre {

constexpr int kSssLanes = 16;

/// Weights as they are stored, and each matrix transposed for the forward pass.
struct SssWeights {
    AlignedVector<float> value, transposed; // [kSssWeights]
    SssWeights() : value(kSssWeights), transposed(kSssWeights) {}
    /// After `value` has changed.
    void transpose();
};

/// One batch; features by lanes.
struct SssBatch {
    alignas(64) float fixed[kSssFixedInputs][kSssLanes];
    alignas(64) float first[kSssHidden1][kSssLanes]; // from sssBatchFixed
    alignas(64) float light[kSssLightInputs][kSssLanes];
    alignas(64) float h1[kSssHidden1][kSssLanes], h2[kSssHidden2][kSssLanes], h3[kSssHidden3][kSssLanes], hs[kSssHiddenShare][kSssLanes];
    alignas(64) float residual[3][kSssLanes], share[kSssLanes];
    // gradients
    alignas(64) float dResidual[3][kSssLanes], dShare[kSssLanes];
    alignas(64) float dFirst[kSssHidden1][kSssLanes]; // summed over the lights
};

/// fixed -> first.
void sssBatchFixed(const SssWeights& weights, SssBatch& batch);
/// first, light -> the hidden layers, residual and share.
void sssBatchLight(const SssWeights& weights, SssBatch& batch);
/// After sssBatchLight: dResidual, dShare -> adds to dFirst and dWeights [kSssWeights]. Lanes with zero gradients add nothing.
void sssBatchLightBackward(const SssWeights& weights, SssBatch& batch, float* dWeights);
/// After all lights: dFirst -> adds to dWeights.
void sssBatchFixedBackward(const SssBatch& batch, float* dWeights);

} // namespace nacre
