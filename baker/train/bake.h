// `nacre bake` as a library: OLAT dataset in, asset out.
#pragma once

#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "splats/splat_asset.h"
#include "train/image_screen.h"
#include "train/initial_splats.h"
#include "train/light_refinement.h"
#include "train/step_engine.h"

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nacre {

struct BakeOptions {
    std::string model = "bigs";
    std::string quality = "standard";  // draft | standard | high: default iterations, splats and channel sizes
    double minutes = 0;                // > 0: at most so much wall time for the whole bake; learning rates anneal over it
    int iterations = 0;                // > 0: instead of minutes; exactly reproducible
    MakeStepEngine makeEngine = makeCpuEngine; // what makes the steps
    int threads = 0;                   // 0: all cores
    uint64_t seed = 1;
    int maxSplats = 0;                 // hard cap; 0: from quality, and no more than the images can resolve
    bool splatsByPixels = false;       // the latter; withDefaults sets it
    int sFunctions = -1;               // 0, 1, 4, 9, 16, 25; -1: from quality
    std::vector<std::string> without;  // for comparisons: see AppearanceOptions
    double dssim = -1;                 // lambda of the loss (loss.h), the weight of 1-SSIM; -1: default
    bool refineLights = false;         // correct the training lights' gains and directions on the way
    std::optional<glm::dvec4> bounds;  // of the object, in images without masks: centre and radius in the dataset's units; else what cameras look at
    bool keepBackground = false;       // what is outside of them, and the table the object stands on, stays in the asset
    std::shared_ptr<const InitialSplats> init; // to start from, instead of the visual hull
    size_t imageBudgetBytes = size_t(1) << 30;
    std::string checkpointPath;        // empty: none
    bool resume = false;
    bool heldOutJudges = false;        // the test split is of training cameras: images without masks cannot serve
    std::vector<UnusableImage> skipped{}; // images that the caller left out of the dataset: a checkpoint remembers them
    double secondsBefore = 0;          // of `minutes`, that the caller has used already
    enum class Track { kNever, kAtEnd, kNowAndThen };
    Track track = Track::kNever;       // evaluate the test split, a part of it where it is large, for the history; on time of its own
};

struct BakeProgress {
    std::string stage;                 // "loading", "hull", "training", "writing"
    int iteration = 0, iterations = 0; // iterations = 0 while it is not known yet
    double seconds = 0, secondsLeft = -1; // -1: unknown
    int splats = 0;
    double psnrTrain = 0;              // running mean, masked
};

struct HistoryPoint { double seconds; int iteration; int splats; double psnrTest, psnrMaskedTest; };

/// An optional part of the model (TrainableAppearance::optionalParts): what it was worth on training images, and where it stayed.
struct PartWorth {
    char name[24] = {};
    double decibel = 0;                // PSNR of images not just trained on that is lost without it, object only
    double cost = 0;                   // dB of it that are given up where the part is left out
    double share = 1;                  // of the splats, that keep it
};

struct BakeResult {
    SplatAsset asset;
    std::vector<UnusableImage> lost;   // images that could be read at first and no more when their turn came
    int iterations = 0;
    double seconds = 0;
    double psnrTrain = 0;              // whole image, mean over the last pass
    std::vector<HistoryPoint> history; // held-out error against seconds
    std::vector<RefinedLight> lights;  // with refineLights: every distinct light of the train split
    std::vector<PartWorth> parts;
    std::string cut;                   // what was cut off around the object, in a line; empty: nothing
    std::vector<std::string> warnings;
};

/// How many steps a bake makes unless its minutes end first: those of its quality, more where a step shows fewer images than it could, and enough to see
/// each image a few times; in minutes, so many that each is seen as often as those that the quality was tuned on. 0: no such quality.
int bakeIterations(const BakeOptions& options, const OlatDataset& dataset);

/// How often so many steps show a training image, in the mean, against the most that has been found to help at this quality; above 1 they
/// only fit noise.
double saturation(int steps, const BakeOptions& options, const OlatDataset& dataset);

/// How many splats it may end with. 0: no such quality.
int bakeSplats(const BakeOptions& options);

/// `progress` is called at least every second from the calling thread. Setting `*cancel` writes a checkpoint and returns kCancelled.
Result<BakeResult> bake(const OlatDataset& dataset, const BakeOptions& options,
                        const std::function<void(const BakeProgress&)>& progress, const std::atomic<bool>* cancel);

} // namespace nacre
