// All that `nacre report` measures, in one run on one machine.
#pragma once

#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "report/fronts.h"
#include "report/report_data.h"
#include "splats/splat_asset.h"

#include <span>

namespace nacre::report {

struct MeasureOptions {
    double seconds = 240;      // about as long as all may take; fronts get what is left for them
    size_t frontImages = 8;    // held-out images that the fronts use
    bool selftest = true;
    Says says;                 // may not be empty
    std::function<bool()> stopped = [] { return false; }; // asked more often than anything is said
};

/// `asset` is expanded, with its maps and an order of importance; `file`: the bytes it was read from. Fills everything but the names, the bake's
/// history, what that left out, and the seconds. Errors: of images, OpenGL; kCancelled.
Result<ReportData> measureReport(const SplatAsset& asset, std::span<const std::byte> file, const OlatDataset& dataset, const MeasureOptions& options);

/// The split that fronts are measured on: test, or the first that is not train. Error: there is none.
Result<const OlatSplit*> heldOutSplit(const OlatDataset& dataset);

/// e.g. "AMD EPYC 9R14, 2 threads".
std::string machineText();

} // namespace nacre::report
