// Where on an object an optional part of the model earns its bytes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

/// dB from one mean squared error to another.
double decibelBetween(double worse, double better);

/// kept[splat] = 1 where a part stays, from the errors that each splat answers for with the part and without it (Trainer::step).
/// Decided for 32 runs of splats, which Morton order makes clusters in space. A cluster keeps the part if that saves `leastWorth`
/// dB of the cluster's error, and as much error as `leastWorth` dB are for a cluster of average error. All 0 if fewer than a
/// fifth of the splats would keep it.
std::vector<uint8_t> chooseClusters(std::span<const double> with, std::span<const double> without, double leastWorth);

} // namespace nacre
