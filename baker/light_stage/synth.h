// From a plan to a dataset on disk: renders camera by camera, writes image by image, can stop and go on anywhere.
#pragma once

#include "dataset/olat_dataset.h"
#include "light_stage/capture_plan.h"
#include "light_stage/path_tracer.h"

#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace nacre {

/// PathTracer::render, or something with its contract.
using StageRender = std::function<Result<std::vector<Image>>(const Camera&, std::span<const Light>, const RenderSettings&, RenderStats*)>;

/// Option and value, as text: everything that pixels depend on.
using SynthSettings = std::vector<std::pair<std::string, std::string>>;

/// Makes the folder, if it is new, and writes down the settings (synth.json); if it was begun before, compares them.
/// Errors kBadInput: it was begun with other settings (names the first that differs), or holds something else; kIo.
Status claimDatasetFolder(const std::string& folder, const SynthSettings& settings);
/// The same without making or writing anything: for before the long work.
Status checkDatasetFolder(const std::string& folder, const SynthSettings& settings);

struct SynthJob {
    OlatDataset plan;                   // fitted to its convention (fitToConvention); `path` is a claimed folder
    struct Split {
        RenderSettings render;          // `stop` and `progress` are set by synthesise
        std::string topLevel;           // JSON object for the description files
        std::shared_ptr<const Capture> capture{}; // what was really there, where images are photographs; null: they are what is rendered
        StageRender renderer{};         // of this split's own scene; empty: that of all
    };
    std::vector<Split> splits;          // one for each of the plan's
    int shard = 1, shards = 1;          // this run renders every camera group g with g % shards == shard - 1
};

struct SynthProgress {
    std::string split;
    size_t imagesDone = 0, imageCount = 0; // of this shard
    double secondsLeft = -1;            // -1: not known yet
};

struct SynthReport {
    struct Split {
        std::string name;
        size_t images = 0, written = 0, missing = 0; // in the plan; by this run; not there yet (another shard's)
        size_t cameras = 0;             // rendered by this run
        double seconds = 0;             // rendering them
        double samplesPerPixel = 0, noise = 0; // means over the images written; noise as in RenderStats
        uint64_t rays = 0;
        size_t emptyCameras = 0;               // that see nothing of the object
        double backFaces = 0;                  // RenderStats::backFaces, largest of any camera
        double leakedWalks = 0, cutWalks = 0;  // largest of any camera
        double clipped = 0;             // share of the object's pixels above 1, where the file format clips there (8-bit PNG)
    };
    std::vector<Split> splits;
    double seconds = 0;
};

/// Renders what is missing. All images of a camera in one split are one group of work, rendered in one call (in chunks of lights where they
/// would not fit in kChunkBytes). An image that is there, decodes and has the right size stays as it is. Images appear atomically, and the
/// description files of a split when its last image is there, whichever run makes it; the bytes do not depend on how the work was divided.
/// A light group is the sum of the images of its lights.
/// Of a capture, the truth is rendered, and photographs and mattes are made of it.
/// Errors: those of `render`, kIo, kCancelled.
Result<SynthReport> synthesise(const SynthJob& job, const StageRender& render, const std::function<void(const SynthProgress&)>& progress,
                               const std::atomic<bool>* stop);

/// Bound on the film of one call of `render`; a pixel of one light takes sums, moments and the finished image.
constexpr size_t kChunkBytes = size_t(512) << 20, kFilmBytesPerPixel = 36;

} // namespace nacre
