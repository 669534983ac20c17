// Gradient of the sss network (formats/appearance/sss/sss_network.h). Scalar reference.
#pragma once

#include "appearance/sss/sss_network.h"

namespace nacre {

/// Of sssLayer: adds to the gradients of weight, bias and in. dBias and dIn may be null.
template <class T>
NACRE_HD inline void sssLayerBackward(const T* weight, const T* in, int inputs, int outputs, const T* dOut, T* dWeight, T* dBias,
                                      T* dIn)
{
    for (int j = 0; j < outputs; ++j) {
        if (dBias) dBias[j] += dOut[j];
        for (int i = 0; i < inputs; ++i) {
            dWeight[j * inputs + i] += dOut[j] * in[i];
            if (dIn) dIn[i] += dOut[j] * weight[j * inputs + i];
        }
    }
}

/// Through the logistic functions at the ends. dEnd [3], dShareEnd: gradient of what goes into them.
template <class T>
NACRE_HD inline void sssEndsBackward(const T* residual, T share, const T* dResidual, T dShare, T* dEnd, T* dShareEnd)
{
    for (int c = 0; c < 3; ++c) dEnd[c] = dResidual[c] * residual[c] * (T(1) - residual[c]);
    *dShareEnd = dShare * share * (T(1) - T(0.5) * share); // of 2 logistic(x)
}

/// Adds the gradient of one Gaussian under one light. `a` from sssNetworkLight. dFirst [64]: of sssNetworkFixed's result, which
/// holds the bias as well; dLight [8].
template <class T>
NACRE_HD inline void sssNetworkLightBackward(const T* w, const T* first, const T* light, const SssActivations<T>& a,
                                             const T* dResidual, T dShare, T* dWeights, T* dFirst, T* dLight)
{
    (void)first;
    const auto rectifier = [](const T* h, T* d, int n) {
        for (int k = 0; k < n; ++k) d[k] *= h[k] > T(0) ? T(1) : T(kSssLeak);
    };
    T d1[kSssHidden1] = {}, d2[kSssHidden2] = {}, d3[kSssHidden3] = {}, ds[kSssHiddenShare] = {}, dr[3];
    T dOut;
    sssEndsBackward(a.residual, a.share, dResidual, dShare, dr, &dOut);
    sssLayerBackward(w + kSssShareOut, a.hs, kSssHiddenShare, 1, &dOut, dWeights + kSssShareOut, dWeights + kSssShareOutBias, ds);
    rectifier(a.hs, ds, kSssHiddenShare);
    sssLayerBackward(w + kSssShare, a.h3, kSssHidden3, kSssHiddenShare, ds, dWeights + kSssShare, dWeights + kSssShareBias, d3);
    sssLayerBackward(w + kSssResidual, a.h3, kSssHidden3, 3, dr, dWeights + kSssResidual, dWeights + kSssResidualBias, d3);
    rectifier(a.h3, d3, kSssHidden3);
    sssLayerBackward(w + kSssThird, a.h2, kSssHidden2, kSssHidden3, d3, dWeights + kSssThird, dWeights + kSssThirdBias, d2);
    rectifier(a.h2, d2, kSssHidden2);
    sssLayerBackward(w + kSssSecond, a.h1, kSssHidden1, kSssHidden2, d2, dWeights + kSssSecond, dWeights + kSssSecondBias, d1);
    rectifier(a.h1, d1, kSssHidden1);
    sssLayerBackward(w + kSssFirstLight, light, kSssLightInputs, kSssHidden1, d1, dWeights + kSssFirstLight,
                     static_cast<T*>(nullptr), dLight);
    for (int k = 0; k < kSssHidden1; ++k) dFirst[k] += d1[k];
}

/// After all lights of a Gaussian. Adds to dWeights and dFixed [kSssFixedInputs].
template <class T>
NACRE_HD inline void sssNetworkFixedBackward(const T* w, const T* fixed, const T* dFirst, T* dWeights, T* dFixed)
{
    sssLayerBackward(w + kSssFirstFixed, fixed, kSssFixedInputs, kSssHidden1, dFirst, dWeights + kSssFirstFixed,
                     dWeights + kSssFirstBias, dFixed);
}

} // namespace nacre
