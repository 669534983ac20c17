// Morton (Z-curve) order of points, so that neighbours in space are neighbours in memory.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace nacre {

/// order[k] is the index of the k-th point along the curve. `position(i)` returns a pointer to three floats.
std::vector<uint32_t> mortonOrder(size_t count, const std::function<const float*(size_t)>& position);

} // namespace nacre
