// What `nacre report` has measured: error against run time and bytes, what each part is worth. Filled by measure.cpp, written as a page, JSON
// and tables by report_page.cpp and report_files.cpp.
#pragma once

#include "eval/contact_sheet.h"

#include <string>
#include <vector>

namespace nacre::report {

/// Frame time in milliseconds: the median over frames of one run, and the range that holds the medians of re-runs nine times in ten.
struct TimedFrame {
    double ms = 0, low = 0, high = 0;
    double relightMs = 0, sortMs = 0, rasterMs = 0; // shares of the median frame
};

/// One choice of what to leave out, measured.
struct FrontPoint {
    std::string settings;        // e.g. "50 % of the splats, no lobe, 0.75 of the pixels a side"
    std::string preset;          // its name, where it is one of the asset's presets
    TimedFrame time;             // front_time
    double bytes = 0;            // front_bytes: of the file
    double psnrMasked = 0;       // dB, on the held-out images that the fronts use
    bool scaled = false;         // drawn at fewer pixels than the host shows, and enlarged
    bool dominated = false;      // another that is scaled no more point is at least as good in both and better in one
};

/// Held-out error of the whole asset on one split, at the pixels of the dataset.
struct SplitFigures {
    std::string split;
    size_t images = 0;
    double psnr = 0, psnrMasked = 0, ssim = 0, flip = 0, relMseLinear = 0, highlightMissing = 0, highlightFalse = 0, psnrHighlight = 0; // NaN: none
    double noiseFloor = 0;       // dB between two renders of the same references, as the dataset states it; NaN: not stated
};

/// One part of the asset or of the build: what leaving it out saves and costs here. Or one that was left out already: what it would cost and win.
struct LedgerRow {
    std::string part;            // channel, band, splats, shader branch, light kind, back end, dependency
    bool leftOut = false;        // of this asset; then figures are of switching it back on
    double bytes = 0, ms = 0, lossDecibel = 0; // saved by leaving it out; dB lost by that. NaN: not measured
    std::string note;            // how it was measured, or why it could not be
};

/// Frame time against one quantity, with the line that was fitted.
struct Scaling {
    std::string quantity;        // "lights", "splats", "pixels"
    std::vector<double> x, ms;
    double slope = 0, offset = 0;// ms per unit, ms
    double residual = 0;         // largest |measured - line| / measured
};

struct HistoryPoint { double seconds = 0, psnr = 0; size_t splats = 0; bool heldOut = false; };

/// Reference | render | 4x error.
struct ReportImage {
    std::string caption;         // "worst of test: 0007, 24.31 dB masked"
    Picture picture;
};

struct NamedPicture {
    std::string name;
    Picture picture;
};
struct ChannelSheet {
    std::string caption;         // "under the light of test 0003"
    std::vector<NamedPicture> channels;
};

struct StabilityRow {
    std::string name, quantity, reason;
    double bound = 0, largest = 0;  // largest deviation of all back ends
    std::string backEnd;            // which one has it
    bool ok = true;
};

struct MemoryRow { std::string what; double bytes = 0; }; // "file", "host, decoded", "GPU"

struct ReportData {
    std::string asset, dataset, model, bakedWith;        // names as given on the command line
    std::string command, machine, renderer, version, date;
    size_t splats = 0;
    int width = 0, height = 0;                            // of the images
    double seconds = 0;                                   // that this report took
    std::vector<SplitFigures> splits;
    TimedFrame fullFrame;
    std::vector<FrontPoint> frontTime, frontBytes;
    std::vector<FrontPoint> levels;                       // prefixes of the splats: settings, bytes, time, error
    std::vector<std::string> neverPays;                   // knobs without a point on a front, and why they are not offered
    std::vector<HistoryPoint> history;                    // empty: the bake's history is not there
    std::vector<LedgerRow> ledger;
    std::vector<Scaling> scalings;
    std::vector<ReportImage> images;
    std::vector<ChannelSheet> channels;
    std::vector<StabilityRow> stability;                  // the nearest to their bounds; worst first
    std::string stabilityNote;                            // "150 cases in 4 back ends, 0 failed"
    std::vector<MemoryRow> memory;
    std::vector<std::string> notes;                       // what was skipped, and why
};

} // namespace nacre::report
