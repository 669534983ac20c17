#include "splats/morton.h"

#include <algorithm>
#include <cfloat>
#include <utility>

namespace nacre {

static uint64_t spread(uint64_t x) // 21 bits to every third bit
{
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

std::vector<uint32_t> mortonOrder(size_t count, const std::function<const float*(size_t)>& position)
{
    float lo[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, hi[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    for (size_t i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) lo[k] = std::min(lo[k], position(i)[k]), hi[k] = std::max(hi[k], position(i)[k]);
    std::vector<std::pair<uint64_t, uint32_t>> keyed(count);
    for (size_t i = 0; i < count; ++i) {
        uint64_t key = 0;
        for (int k = 0; k < 3; ++k) {
            const float extent = hi[k] - lo[k], unit = extent > 0 ? (position(i)[k] - lo[k]) / extent : 0.0f;
            key |= spread(uint64_t(unit * 2097151.0f)) << k;
        }
        keyed[i] = {key, uint32_t(i)};
    }
    std::sort(keyed.begin(), keyed.end());
    std::vector<uint32_t> order(count);
    for (size_t i = 0; i < count; ++i) order[i] = keyed[i].second;
    return order;
}

} // namespace nacre
