#include "train/cluster_choice.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nacre {

constexpr size_t kClusters = 32;
constexpr double kLeastShare = 0.2; // below, a shader branch and a texture for so few splats are not worth it

double decibelBetween(double worse, double better) { return 10 * std::log10(std::max(worse, 1e-12) / std::max(better, 1e-12)); }

// Either measure alone is not enough: the first gives s to the darkest third of marble, where it is learnt from noise and
// held-out views gain nothing; the second to what is wrong anyway.
std::vector<uint8_t> chooseClusters(std::span<const double> with, std::span<const double> without, double leastWorth)
{
    const size_t count = with.size(), clusters = std::min(kClusters, count);
    const double least = std::pow(10, 0.1 * leastWorth) - 1;
    const double average = std::accumulate(with.begin(), with.end(), 0.0) / double(std::max<size_t>(clusters, 1));
    std::vector<uint8_t> kept(count);
    for (size_t c = 0; c < clusters; ++c) {
        const size_t first = c * count / clusters, size = (c + 1) * count / clusters - first;
        const auto sum = [&](std::span<const double> errors) {
            const auto run = errors.subspan(first, size);
            return std::accumulate(run.begin(), run.end(), 0.0);
        };
        const double error = sum(with), saved = sum(without) - error;
        if (saved > 0 && saved >= least * std::max(error, average)) std::fill_n(&kept[first], size, uint8_t(1));
    }
    const auto keeping = std::count(kept.begin(), kept.end(), 1);
    if (double(keeping) < kLeastShare * double(count)) kept.assign(count, 0);
    return kept;
}

} // namespace nacre
