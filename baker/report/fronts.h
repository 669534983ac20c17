// Error against frame time and against bytes: what each knob buys on this object, measured.
#pragma once

#include "dataset/olat_dataset.h"
#include "report/variant_meter.h"

#include <functional>
#include <string>
#include <vector>

namespace nacre::report {

struct TimedVariant {
    Variant variant;
    double psnrMasked = 0;
    VariantTime time;
    bool dominated = false;  // another is at least as good in both and better in one, and at as many pixels: fewer are the host's work
};

/// `says` is told what is done next; false stops with kCancelled.
using Says = std::function<bool(const std::string&)>;

struct TimeFront {
    std::vector<TimedVariant> points; // the first is everything; then by time
    std::vector<TimedVariant> knobs;  // one thing changed
    std::vector<TimedVariant> shares; // of the splats, all else as it is: everything, then fewer
    std::vector<std::string> neverPays, notes;
};

/// Shares of the splats, resolutions, parts and coarser maps and transport, alone and together; first roughly, then those that are on the front or
/// near it in interleaved rounds. `seconds`: about as long as it may take. `scales`: whether to draw at fewer pixels may be a choice.
Result<TimeFront> measureTimeFront(VariantMeter& meter, const SplatAsset& asset, double seconds, bool scales, const Says& says);

struct SizedVariant {
    Variant variant;
    double rate = 0;         // of packVersions; NaN: of the file as it was given
    size_t bytes = 0;
    double psnrMasked = 0;
    bool dominated = false;
    std::vector<std::byte> file; // empty for the one that was given
};
std::string sizedText(const SizedVariant& point);

/// Files of profile compact of some shares at some rates, and the one that was given (of `givenBytes`).
Result<std::vector<SizedVariant>> measureBytesFront(VariantMeter& meter, const SplatAsset& asset, const OlatSplit* seen, size_t givenBytes, const Says& says);

/// Which of some points (a cost, a quality) are worse than another.
std::vector<bool> dominated(std::span<const double> costs, std::span<const double> qualities);

/// Frame time against one quantity: x, ms, and a line by least squares.
struct ScalingLine {
    std::string quantity;
    std::vector<double> x, ms;
    double slope = 0, offset = 0, residual = 0; // the latter: largest deviation from the line over what was measured
};
/// lights, splats and pixels, one at a time.
Result<std::vector<ScalingLine>> measureScaling(VariantMeter& meter, size_t splats, const Says& says);

} // namespace nacre::report
