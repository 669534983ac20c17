// From an asset to the smallest one that looks the same, or to one of so many bytes: `nacre pack`.
//
// What rounding a number costs is measured where it shows, in rendered images: each group's error at one step, which grows as the square of
// the step. Then every number of every group gets the step at which it adds as much error as any other: no bit would be better spent
// elsewhere (reverse water-filling, Cover and Thomas, Elements of Information Theory, 10.3.3). One unknown is left, this error, and found by
// the bound on loss or bytes.
#pragma once

#include "asset/compact.h"
#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "splats/splat_asset.h"

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace nacre {

/// What packing adds is measured against an error that assets have anyway on held-out images: 30 dB, what good bakes reach. A loss of x dB
/// is an added mean squared error of (10^(x/10) - 1) times this one.
constexpr double kTypicalError = 1e-3;

struct PackOptions {
    double maxLossDecibel = 0.3;           // used unless bytesPerSplat > 0
    double bytesPerSplat = 0;              // of the file
    const OlatSplit* seen = nullptr;       // cameras and lights that say from where the asset will be seen; else views all around
    int drawnVisibility = 32;              // texels a side of maps that readers draw from the splats; 0: stored
    bool curve = false;                    // also measure other sizes
    std::function<void(const std::string&)> progress; // may be empty
};

struct PackedPart {
    std::string name;                      // of a block, or of a channel without bytes
    size_t bytes = 0;
    double lossWithout = -1;               // dB, of leaving it out; < 0: it cannot be left out
};

struct PackPoint {
    double bytesPerSplat = 0, lossDecibel = 0;
};

struct PackResult {
    std::vector<std::byte> file;
    size_t splats = 0, pruned = 0;
    double lossDecibel = 0, psnr = 0;      // the latter against the input
    std::vector<PackedPart> parts;
    std::vector<std::string> leftOut;      // channels that do not earn their bytes
    std::vector<PackPoint> curve;          // by bytes; the result's own, and others with options.curve
    std::vector<std::string> warnings;     // e.g. a bound that cannot be kept
};

/// `asset` is expanded. Same bytes for any number of threads. Errors kBadInput: invalid asset, or nothing of it shows.
Result<PackResult> packCompact(const SplatAsset& asset, const PackOptions& options);

/// One of several files of an asset, and what readers make of it.
struct PackedVersion {
    Detail detail;
    double rate = 0;
    std::vector<std::byte> file;
    SplatAsset asset;                      // expanded; its maps are those of the input, not drawn anew, which takes seconds and changes little
};

/// Files for each of `details` at each of `rates`: log2 of the error that each number adds, about 2^rate times 2e-6 of display space. Steps are
/// measured once, on the whole asset: seconds a file, where packCompact takes a minute. `asset` is expanded and has an order of importance.
/// Errors as packCompact; kCancelled if `progress` returns false.
Result<std::vector<PackedVersion>> packVersions(const SplatAsset& asset, const OlatSplit* seen, std::span<const Detail> details, std::span<const double> rates,
                                                const std::function<bool(const std::string&)>& progress);

} // namespace nacre
