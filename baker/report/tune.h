// The best of an asset within a bound on time, bytes or error: `nacre tune`.
#pragma once

#include "report/device_profile.h"
#include "report/fronts.h"

#include <optional>

namespace nacre::report {

/// One of the first three is above 0.
struct TuneGoal {
    double mostMilliseconds = 0, leastPsnr = 0;
    size_t mostBytes = 0;
    bool fastest = false;     // with leastPsnr: the fastest instead of the smallest
    bool scales = false;      // drawing at fewer pixels is a choice, which the host has to make
    const DeviceProfile *here = nullptr, *there = nullptr; // times are of `there`; both null: of this machine
};

struct Tuned {
    Variant variant;
    std::string settings;                      // what was left out or rounded
    double psnrMasked = 0, fullPsnrMasked = 0; // on the meter's images
    VariantTime time, fullTime;                // zeros for goals of bytes
    std::vector<std::byte> file;               // of goals of bytes: the file itself; else empty
};

/// Errors kBadInput: the bound cannot be kept, with the nearest that can.
Result<Tuned> tune(VariantMeter& meter, const SplatAsset& asset, const OlatSplit* seen, size_t givenBytes, const TuneGoal& goal, double seconds, const Says& says);

} // namespace nacre::report
