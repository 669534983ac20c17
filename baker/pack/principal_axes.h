// Principal components of weighted rows.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace nacre {

struct PrincipalAxes {
    size_t count = 0;
    std::vector<float> mean; // [numbers]
    std::vector<float> axes; // [count][numbers], orthonormal, by falling variance
};

/// `numbers`: [number][row]. The `count` leading axes, by orthogonal iteration. Same result for any number of threads.
PrincipalAxes principalAxes(const std::vector<std::vector<float>>& numbers, std::span<const float> weights, size_t count);

} // namespace nacre
