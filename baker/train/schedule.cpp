#include "train/schedule.h"

#include "appearance/trainable.h"
#include "train/step_order.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace nacre {

namespace {

struct Quality {
    const char* name;
    int iterations, maxSplats, sFunctions;
};
// More steps only fit the noise of the images (wax bunny, 24 k splats, held out, masked: 29.98 dB after 6750 steps, 30.03 after
// 7500, 29.81 after 15000; marble: best after 13000), so a bake in minutes ends with them too.
constexpr Quality kQualities[] = {{"draft", 2000, 6000, 0}, {"standard", 10000, 24000, 9}, {"high", 40000, 48000, 9}};

const Quality* findQuality(const std::string& name)
{
    const Quality* found =
        std::find_if(std::begin(kQualities), std::end(kQualities), [&](const Quality& q) { return name == q.name; });
    return found == std::end(kQualities) ? nullptr : found;
}

double clockSeconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

} // namespace

/// What steps show of the images, in the mean.
struct Shown {
    double stepsForAll = 0; // show every image once: 75 in the sets that the qualities were tuned on (75 cameras, 4 lights each)
    double perStep = 0;     // images
};

static Shown shownBy(const OlatDataset& dataset)
{
    const OlatSplit* train = dataset.find("train");
    double images = 0, perPass = 0, passLength = 0;
    for (const CameraImages& view : groupByCamera(train ? *train : OlatSplit()))
        images += double(view.images.size()), perPass += double(std::min<size_t>(view.images.size(), kMaxLightsPerStep)), ++passLength;
    return images > 0 ? Shown{images / perPass * passLength, perPass / passLength} : Shown();
}
constexpr double kTunedStepsForAll = 75;

double saturation(int steps, const BakeOptions& options, const OlatDataset& dataset)
{
    const Quality* quality = findQuality(options.quality);
    return quality ? double(steps) / quality->iterations * kTunedStepsForAll / std::max(shownBy(dataset).stepsForAll, 1.0) : 0;
}

int bakeIterations(const BakeOptions& options, const OlatDataset& dataset)
{
    constexpr double kMost = 1e8;
    constexpr double kLeastVisits = 5; // an image that was photographed is worth looking at
    const Quality* quality = findQuality(options.quality);
    if (options.iterations > 0 || !quality) return std::max(options.iterations, 0);
    const Shown shown = shownBy(dataset);
    double steps = quality->iterations;
    if (options.minutes > 0) steps *= std::max(1.0, shown.stepsForAll / kTunedStepsForAll);
    else if (shown.perStep > 0) steps = std::max(steps * std::max(1.0, kMaxLightsPerStep / shown.perStep), kLeastVisits * shown.stepsForAll);
    return int(std::min(steps, kMost));
}

int bakeSplats(const BakeOptions& options)
{
    const Quality* quality = findQuality(options.quality);
    return options.maxSplats > 0 ? options.maxSplats : quality ? quality->maxSplats : 0;
}

Result<BakeOptions> withDefaults(BakeOptions options, const OlatDataset& dataset)
{
    const Quality* quality = findQuality(options.quality);
    if (!quality) return Error{ErrorCode::kBadInput, "--quality '" + options.quality + "': expected draft, standard or high"};
    options.iterations = bakeIterations(options, dataset);
    options.splatsByPixels = options.maxSplats <= 0;
    options.maxSplats = bakeSplats(options);
    if (options.sFunctions < 0) options.sFunctions = quality->sFunctions;
    if (options.dssim < 0) options.dssim = 0;
    return options;
}

Schedule::Schedule(const BakeOptions& options, const OlatDataset& dataset)
    : start_(clockSeconds() - options.secondsBefore), iterations_(bakeIterations(options, dataset)),
      budgetSeconds_(options.iterations > 0 ? 0.0 : std::max(0.0, 60 * options.minutes))
{
}

double Schedule::seconds() const { return clockSeconds() - start_; }

void Schedule::resume(double seconds)
{
    start_ = clockSeconds() - seconds;
    resumedSeconds_ = seconds;
}

constexpr int kDensifyEvery = 100;                         // steps, and at least one pass through the cameras,
constexpr int kEnoughCameras = 200;                        // or through so many: what none of them has seen is hidden
constexpr double kDensifyFrom = 0.02, kDensifyUntil = 0.5; // of the bake
constexpr double kGrowth = 1.06;                           // in kDensifyEvery steps

void Schedule::beginTraining(int step, size_t passLength)
{
    startedStep_ = step;
    startedProgress_ = progress(step);
    pass_ = std::max(kDensifyEvery, int(passLength));
    watch_ = std::min(pass_, kEnoughCameras);
}

bool Schedule::densifies(int stepsSinceReset, double progress) const
{
    return stepsSinceReset >= watch_ && progress > kDensifyFrom && progress < kDensifyUntil;
}

size_t Schedule::growth(size_t splats) const
{
    return size_t((std::pow(kGrowth, double(watch_) / kDensifyEvery) - 1) * double(splats));
}

double Schedule::progress(int step) const
{
    constexpr double kTraining = 0.99; // of the time; writing the asset takes a moment too
    const double steps = double(step) / iterations_;
    return byTime() ? std::max(steps, seconds() / (kTraining * budgetSeconds_)) : steps;
}

double Schedule::expectedSteps(int step, double progress) const
{
    if (!byTime()) return iterations_;
    constexpr double kGuessSeconds = 0.03; // a step, until the clock says better
    constexpr int kFewSteps = 20;
    const int done = step - startedStep_;
    const double perStep = done > kFewSteps ? (progress - startedProgress_) / done : kGuessSeconds / budgetSeconds_;
    return std::min(double(iterations_), 1.0 / std::max(perStep, 1e-9));
}

constexpr double kReferenceSteps = 3000; // a longer bake takes smaller steps
constexpr double kFinalRate = 0.01,
                 kLeastRate = 0.02; // of the learning rates at the start, and of those of a bake of kReferenceSteps

// A bake of more than kReferenceSteps takes smaller steps, so that it travels the same way more finely. Less travel leaves gloss,
// and directions that few lights cover, near their initial values; more makes knob_marble worse. (6000 steps, 12 k splats,
// held-out, masked, for 3000 and 6000: knob_marble 27.0, 26.7 dB; bunny_wax 29.8, 29.8 dB. 21 k steps, 24 k splats, for 1500:
// knob_marble 26.7 dB.) All rates fall exponentially over the bake: to a hundredth, which is worth 1 dB, but not below
// kLeastRate, where a long bake would only learn noise. (10 k steps, 12 k splats, knob_marble, for kLeastRate 0, 0.006, 0.02 and
// 0.05: 27.18, 27.26, 27.35, 27.24 dB; bunny_wax, for 0 and 0.02: 29.63, 29.63 dB.)
double Schedule::rate(int step, double progress) const
{
    const double pace = std::min(1.0, kReferenceSteps / expectedSteps(step, progress));
    return pace * std::pow(std::clamp(kLeastRate / pace, kFinalRate, 1.0), progress);
}

double Schedule::secondsLeft(double progress) const
{
    constexpr double kEnough = 0.01; // of the bake done by this process, to go by
    const double done = progress - startedProgress_, left = budgetSeconds_ - seconds();
    const double atThisPace = done > kEnough ? (seconds() - resumedSeconds_) * (1 - progress) / done : -1;
    if (!byTime() || (atThisPace >= 0 && atThisPace < left)) return atThisPace;
    return std::max(0.0, left);
}

} // namespace nacre
