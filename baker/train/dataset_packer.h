// `nacre prepare`: reads every image of a dataset once, leaves out what cannot be used, and writes a packed dataset (packed_images.h).
#pragma once

#include "dataset/packed_images.h"
#include "train/image_screen.h"

namespace nacre {

struct PackerOptions {
    std::string output;          // folder; made in output.part, which is renamed when all is there
    enum class Pixels { kAuto, kBytes, kHalves };
    Pixels pixels = Pixels::kAuto; // auto: bytes for 8-bit files, if the disk does not suffice for all; else halves. Bytes end at 1, as losses and metrics do
    uint64_t diskBytes = 0;      // at most so many; 0: what is free, but for a reserve
    bool strict = false;         // an image that cannot be used is an error
    size_t memoryBytes = size_t(1) << 30; // for images on their way
};

struct PackerReport {
    size_t images = 0, halves = 0, reused = 0; // written; of them as halves, and by an interrupted run before this one
    std::vector<SkippedImage> skipped;
    uint64_t bytes = 0;
    double decodeSeconds = 0;    // wall time of reading, checking and writing what was not reused
    std::vector<std::string> notes; // one line each: what was found in the files and may not be meant
};

/// kBadInput, and what to do, if a packed dataset cannot be made at `output`: it is there already, or nothing can be written beside it.
Status checkPackedOutput(const std::string& output);

/// `progress(done, all, seconds left or -1)` is called at least every few seconds from the calling thread. An interrupted run leaves output.part;
/// the same call goes on with it: what it wrote is kept if it is undamaged and its files are as they were. Errors: kBadInput if the output is there
/// already, if more than a third of a split cannot be used, if diskBytes do not suffice; kIo if the disk does not; kCancelled.
Result<PackerReport> packDataset(const OlatDataset& dataset, const PackerOptions& options, const std::function<void(size_t, size_t, double)>& progress,
                                 const std::atomic<bool>* cancel);

/// PackedImages::sourceState of a dataset as it is now; looks at the size and date of every file.
uint64_t sourceState(const OlatDataset& dataset);

} // namespace nacre
