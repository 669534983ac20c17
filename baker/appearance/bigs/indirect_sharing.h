// Indirect light changes slowly along a surface, and training images are noisy: neighbours share how T_ind depends on the light.
#pragma once

#include "appearance/bigs/bigs_training.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

/// r_k below, of function k, from the quotient of the sums. |c_lm| <= sqrt(2l+1) c_00 of a function that is nowhere negative, by the addition theorem.
NACRE_HD inline float sharedRatio(int k, float quotient)
{
    const float bound = std::sqrt(2 * std::floor(std::sqrt(float(k))) + 1);
    return std::clamp(quotient, -bound, bound);
}

/// Draws the bands of degree 1 and up of each splat's T_ind towards those of its neighbours, in proportion to band 0, per channel:
///   t_k <- t_k + rate (t_0 r_k - t_k),   r_k = sum of the neighbours' t_k / sum of their t_0, within the bound of a non-negative function.
/// Band 0, how bright and of what colour a splat is in the mean, stays: textures are not blurred. neighbours: splatNeighbours.
/// `functions`: bands in use, 1 to 25. A splat whose band 0 is not positive, or whose neighbours' is not, stays as it is.
void shareIndirect(BigsParameters& parameters, std::span<const uint32_t> neighbours, int functions, float rate, std::vector<float>& scratch);

} // namespace nacre
