#include "appearance/bigs/indirect_sharing.h"

#include "splat/splat_normals.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>


namespace nacre {

void shareIndirect(BigsParameters& parameters, std::span<const uint32_t> neighbours, int functions, float rate, std::vector<float>& scratch)
{
    constexpr size_t kRow = 80; // 75 and what makes rows start on a cache line
    const size_t n = parameters.count, numbers = size_t(3 * functions);

    // Side by side in memory first: a neighbour is one run of numbers then, and nobody reads what is being written.
    scratch.resize(n * kRow);
    tbb::parallel_for(size_t(0), parameters.blocks(), [&](size_t block) {
        const float* value = parameters.value.data() + parameters.index(block * kLanes16, kTInd);
        const size_t first = block * kLanes16, lanes = std::min<size_t>(kLanes16, n - first);
        for (size_t k = 0; k < numbers; ++k)
            for (size_t lane = 0; lane < lanes; ++lane) scratch[(first + lane) * kRow + k] = value[k * kLanes16 + lane];
    });
    tbb::parallel_for(tbb::blocked_range<size_t>(0, n, 64), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) {
            float sum[kRow] = {};
            for (size_t j = 0; j < kSplatNeighbours; ++j) {
                const float* row = &scratch[size_t(neighbours[i * kSplatNeighbours + j]) * kRow];
                for (size_t k = 0; k < numbers; ++k) sum[k] += row[k];
            }
            const float* own = &scratch[i * kRow];
            float* value = parameters.value.data() + parameters.index(i, kTInd);
            for (size_t c = 0; c < 3; ++c) {
                if (!(own[c] > 0) || !(sum[c] > 1e-12f)) continue;
                for (size_t k = 1; k < size_t(functions); ++k) {
                    const float ratio = sharedRatio(int(k), sum[3 * k + c] / sum[c]);
                    value[(3 * k + c) * kLanes16] += rate * (own[c] * ratio - own[3 * k + c]);
                }
            }
        }
    });
}

} // namespace nacre
