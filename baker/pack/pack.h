// From an asset to the smallest one that looks the same, or to one of so many bytes: `nacre pack`.
#pragma once

#include "asset/compact.h"
#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "pack/quantise.h"
#include "splats/splat_asset.h"

#include <functional>
#include <string>
#include <vector>

namespace nacre {

/// An asset stands so far from the truth on held-out images; what packing adds is measured against it: a loss of x dB is an added squared
/// error of (10^(x/10) - 1) times this one. 30 dB: what good bakes reach.
constexpr double kTypicalError = 1e-3;

struct PackOptions {
    double maxLossDecibel = 0.3;           // used unless bytesPerSplat > 0
    double bytesPerSplat = 0;              // of the file
    const OlatDataset* against = nullptr;  // its train split says from where the asset will be seen; else views all around
    int drawnVisibility = 32;              // texels a side of maps that readers draw from the splats; 0: stored
    std::function<void(const std::string&)> progress; // may be empty
};

struct PackedChannel {
    std::string name;
    size_t bytes = 0;
    double lossDecibel = 0;                // of this part's rounding alone
};

struct PackPoint {
    double bytesPerSplat = 0, lossDecibel = 0;
};

struct PackResult {
    std::vector<std::byte> file;
    SplatAsset asset;                      // as a reader gets it, expanded
    size_t splats = 0, pruned = 0;
    double lossDecibel = 0, psnr = 0;      // the latter against the input
    std::vector<PackedChannel> channels;
    std::vector<PackPoint> curve;
    std::vector<std::string> warnings;     // e.g. a bound that could not be kept
};

/// `asset` is expanded.
Result<PackResult> packCompact(const SplatAsset& asset, const PackOptions& options);

} // namespace nacre
