// The sss network for sixteen Gaussians and up to four lights at a time. SIMD twin of sss_network.h and sss_network_backward.h;
// parity test: tests/unit/train_sss.cpp.
//
// A row per Gaussian and light, features side by side. A layer is then a product of matrices with vectors along its outputs, the
// gradient of its inputs one with vectors along the inputs, and the gradient of its weights a sum of outer products of rows:
// nothing is ever transposed but the weights, once a step. Activations are kept from the forward pass for the backward pass (45
// kB a batch): to compute them again would cost a quarter of the step.
#pragma once

#include "appearance/sss/sss_network.h"
#include "appearance/trainable.h"
#include "render/aligned_vector.h"

namespace nacre {

constexpr int kSssLanes = 16;                                  // Gaussians of a batch
constexpr int kSssRows = kSssLanes * kMaxLightsPerStep;        // light * kSssLanes + Gaussian
constexpr int kSssFixedStride = (kSssFixedInputs + 7) / 8 * 8; // whole vectors; the rest is zero

/// Weights as they are stored, and each matrix transposed for the forward pass.
struct SssWeights {
    AlignedVector<float> value, transposed; // [kSssAllWeights]
    bool share = true;                      // false: that head is not evaluated, the share is 1
    SssWeights() : value(kSssAllWeights), transposed(kSssAllWeights) {}
    /// After `value` has changed.
    void transpose();
};

struct alignas(64) SssBatch {
    // inputs
    float fixed[kSssLanes][kSssFixedStride] = {};
    float light[kSssRows][kSssLightInputs] = {};
    float code[kSssLanes][kSssCodeInputs] = {};
    // what sssBatchForward makes of them
    float first[kSssLanes][kSssHidden1];
    float h1[kSssRows][kSssHidden1], h2[kSssRows][kSssHidden2], h3[kSssRows][kSssHidden3], hs[kSssRows][kSssHiddenShare];
    float residual[kSssRows][3], share[kSssRows];
    // gradients of these two, inputs of sssBatchBackward
    float dResidual[kSssRows][3], dShare[kSssRows];
    // what that makes of them
    float dCode[kSssLanes][kSssCodeInputs];
};

/// fixed, code, light -> the hidden layers, residual and share, of the first `lights` lights.
void sssBatchForward(const SssWeights& weights, int lights, SssBatch& batch);
/// After sssBatchForward: dResidual, dShare -> dCode, and adds to dWeights [kSssAllWeights]. Rows with zero gradients add nothing.
void sssBatchBackward(const SssWeights& weights, int lights, SssBatch& batch, float* dWeights);

} // namespace nacre
