// The bake: silhouettes -> initial splats -> steps with density control -> pruning -> asset.
#include "train/bake.h"

#include "appearance/model_table.h"
#include "base/file.h"
#include "base/color.h"
#include "base/hash.h"
#include "pack/leading_rows.h"
#include "splat/random.h"
#include "train/checkpoint.h"
#include "train/cluster_choice.h"
#include "train/data_check.h"
#include "train/trainer.h"
#include "train/training_images.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numeric>

namespace nacre {

namespace {

struct Quality {
    const char* name;
    int iterations, maxSplats, sFunctions;
};
// More steps only fit the noise of the images (wax bunny, 24 k splats, held out, masked: 29.98 dB after 6750 steps, 30.03 after
// 7500, 29.81 after 15000; marble: best after 13000), so a bake in minutes ends with them too.
constexpr Quality kQualities[] = {{"draft", 2000, 6000, 0}, {"standard", 10000, 24000, 9}, {"high", 40000, 48000, 9}};

constexpr int kHullResolution = 128;
constexpr size_t kHullCameras = 200;                                  // more silhouettes hardly change the hull
constexpr double kInitialShare = 0.5;                                 // of the cap
constexpr int kDensifyEvery = 100;                                    // steps, and at least one pass through the cameras
constexpr double kDensifyFrom = 0.02, kDensifyUntil = 0.5;            // of the bake
constexpr double kGrowth = 1.06;                                      // per densification
constexpr double kCheckpointSeconds = 60, kCheckpointProgress = 0.05; // whichever comes first,
constexpr double kCheckpointPause = 100,
                 kCheckpointLeast = 1;   // but no sooner than this many times what the last one took, or seconds
constexpr double kReferenceSteps = 3000; // a longer bake takes smaller steps (rate)
constexpr double kFinalRate = 0.01,
                 kLeastRate = 0.02;       // of the learning rates at the start, and of those of a bake of kReferenceSteps
constexpr int kRefineLightsEvery = 8;     // steps
constexpr double kRefineLightsFrom = 0.1; // of the bake: before, the splats are still too wrong to tell
constexpr double kTrialLength = 0.03, kTrialLeast = 150 /* steps */,
                 kTrialMost = 0.1;   // of the bake: with and without an optional part
constexpr double kTrackEvery = 0.05; // of the bake, with trackHeldOut

const Quality* findQuality(const std::string& name)
{
    const Quality* found =
        std::find_if(std::begin(kQualities), std::end(kQualities), [&](const Quality& q) { return name == q.name; });
    return found == std::end(kQualities) ? nullptr : found;
}

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

/// The images of one camera, to be trained together.
struct CameraImages {
    uint32_t camera;
    std::vector<uint32_t> images;
};

std::vector<CameraImages> groupByCamera(const OlatSplit& split)
{
    std::vector<CameraImages> groups(split.cameras.size());
    for (uint32_t i = 0; i < split.images.size(); ++i)
        if (split.images[i].light.isPunctual()) groups[split.images[i].camera].images.push_back(i);
    for (uint32_t c = 0; c < groups.size(); ++c) groups[c].camera = c;
    std::erase_if(groups, [](const CameraImages& g) { return g.images.empty(); });
    return groups;
}

template <class T> void shuffle(std::vector<T>& items, Random& random)
{
    for (size_t i = items.size(); i > 1; --i) std::swap(items[i - 1], items[random.below(uint32_t(i))]);
}

/// Which camera and lights each step sees: every camera once per pass, in random order, up to four of its lights at random.
class StepOrder {
public:
    StepOrder(std::vector<CameraImages> groups, uint64_t seed) : groups_(std::move(groups)), seed_(seed) {}
    CameraImages at(int step) // from 1
    {
        const size_t pass = size_t(step - 1) / groups_.size();
        if (order_.empty() || pass != pass_) {
            pass_ = pass;
            order_.resize(groups_.size());
            std::iota(order_.begin(), order_.end(), size_t(0));
            Random random(seed_, uint64_t(pass) << 8 | 2);
            shuffle(order_, random);
        }
        CameraImages group = groups_[order_[size_t(step - 1) % groups_.size()]];
        Random random(seed_, uint64_t(step) << 8 | 3);
        shuffle(group.images, random);
        if (group.images.size() > kMaxLightsPerStep) group.images.resize(kMaxLightsPerStep);
        return group;
    }
    size_t passLength() const { return groups_.size(); }

private:
    std::vector<CameraImages> groups_;
    uint64_t seed_;
    std::vector<size_t> order_;
    size_t pass_ = 0;
};

double psnrFrom(double squaredError, double count)
{
    return -10.0 * std::log10(std::max(squaredError / std::max(count, 1.0), 1e-10));
}

// From lights at one distance the sss network can learn nothing about distance that direction and position do not tell it, and errs at others.
// (4000 steps, masked, near and directional: bunny_wax 26.72 and 26.87 dB with the input, 26.77 and 27.02 without; knob_marble 27.17
// and 27.96, 27.27 and 28.02.)
bool lightDistancesVary(const OlatSplit& split, const glm::dvec3& centre)
{
    constexpr double kVarying = 1.5;
    double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
    for (const OlatImage& image : split.images) {
        if (!image.light.isPunctual()) continue;
        const bool point = image.light.type == LightType::kPoint;
        const double distance = point ? glm::distance(glm::dvec3(image.light.position), centre) : std::numeric_limits<double>::infinity();
        nearest = std::min(nearest, distance), farthest = std::max(farthest, distance);
    }
    return farthest > kVarying * nearest;
}

class Bake {
public:
    Bake(const OlatDataset& dataset, const BakeOptions& options, const std::function<void(const BakeProgress&)>& progress,
         const std::atomic<bool>* cancel)
        : dataset_(dataset), options_(options), report_(progress), cancel_(cancel), start_(now())
    {
    }

    Result<BakeResult> run();

private:
    Status prepare();
    Status resume();
    Status train();
    double progress() const;
    Result<std::vector<std::vector<uint8_t>>> loadMasks(std::vector<Camera>& cameras, Silhouettes* silhouettes);
    Result<double> brightness(const glm::dvec3& centre);
    Result<LossStats> trainStep(const Trainer::Moment& moment, bool onTrial = false, double* splatErrors = nullptr);
    double rate(double progress) const;
    double expectedSteps(double progress) const;
    Status track();
    /// What a trial found: mean squared error of the object, and how much of the sum each splat answers for (Trainer::step).
    struct TrialErrors {
        double mean = 0;
        std::vector<double> ofSplats;
    };
    Result<TrialErrors> trial(double progress, int steps, bool bySplat);
    Status leaveOutParts();
    Status checkpoint();
    void report(const char* stage, double progress);
    double elapsed() const { return now() - start_; }
    uint64_t optionsHash() const;
    bool cancelled() const { return cancel_ && cancel_->load(); }

    const OlatDataset& dataset_;
    BakeOptions options_;
    const std::function<void(const BakeProgress&)>& report_;
    const std::atomic<bool>* cancel_;
    double start_;               // of the bake; after a resume, as if it had never been interrupted
    double startedProgress_ = 0; // when this process began to train
    int resumedStep_ = 0;
    double resumedSeconds_ = 0, lastReport_ = 0, recentPsnr_ = 0;
    const OlatSplit* train_ = nullptr;
    int iterations_ = 0;
    bool byTime_ = false; // --minutes; else by iterations
    bool checkpointFailed_ = false;
    std::unique_ptr<TrainingImages> images_, heldOutImages_;
    std::unique_ptr<StepOrder> order_;
    std::unique_ptr<Trainer> trainer_;
    std::unique_ptr<LightRefinement> refinement_; // with refineLights
    BakeState state_;
    BakeResult result_;
};

uint64_t Bake::optionsHash() const
{
    uint64_t hash = kFnvOffset;
    for (const std::string& text : {dataset_.convention, options_.model, options_.quality})
        hash = fnv1a(text.data(), text.size() + 1, hash);
    const auto add = [&](const auto& x) { hash = fnv1a(&x, sizeof x, hash); };
    add(iterations_), add(options_.minutes), add(options_.seed), add(options_.maxSplats), add(options_.sFunctions),
        add(options_.dssim), add(options_.refineLights);
    for (const std::string& part : options_.without) hash = fnv1a(part.data(), part.size() + 1, hash);
    for (const Camera& c : train_->cameras)
        add(c.width), add(c.height), add(c.fx), add(c.fy), add(c.cx), add(c.cy), add(c.worldFromCamera);
    for (const OlatImage& image : train_->images) {
        const Light& l = image.light;
        add(image.camera), add(l.type), add(l.position), add(l.directionToLight), add(l.intensity), add(l.radius);
    }
    return hash;
}

void Bake::report(const char* stage, double progress)
{
    lastReport_ = now();
    if (!report_) return;
    const double seconds = elapsed(), done = progress - startedProgress_; // how much of the bake this process has done
    double left = -1;
    if (done > 0.01) left = (seconds - resumedSeconds_) * (1 - progress) / done;
    if (byTime_ && !(left >= 0 && left < 60 * options_.minutes - seconds)) left = std::max(0.0, 60 * options_.minutes - seconds);
    report_({stage, state_.step, byTime_ ? 0 : iterations_, seconds, left, trainer_ ? int(trainer_->count()) : 0, recentPsnr_});
}

// Where each camera sees the object.
Result<std::vector<std::vector<uint8_t>>> Bake::loadMasks(std::vector<Camera>& cameras, Silhouettes* silhouettes)
{
    std::vector<CameraImages> groups = groupByCamera(*train_);
    const size_t stride = (groups.size() + kHullCameras - 1) / kHullCameras;
    std::vector<std::vector<uint8_t>> masks;
    bool anyObject = false, anyBackground = false;
    for (size_t k = 0; k < groups.size(); k += stride) {
        if (cancelled()) return Error{ErrorCode::kCancelled, "cancelled before training started"};
        if (now() - lastReport_ > 0.5) report("loading", 0);
        auto image = images_->get(groups[k].images[0]);
        if (!image) return image.error();
        const size_t pixels = size_t((*image)->width) * (*image)->height;
        std::vector<uint8_t> mask(pixels);
        for (size_t i = 0; i < pixels; ++i) {
            mask[i] = (*image)->planes[3 * pixels + i] >= 32768; // alpha 0.5
            (mask[i] ? anyObject : anyBackground) = true;
        }
        masks.push_back(std::move(mask));
        cameras.push_back(train_->cameras[groups[k].camera]);
    }
    *silhouettes = !anyBackground ? Silhouettes::kOpaque : !anyObject ? Silhouettes::kEmpty : Silhouettes::kGood;
    return masks;
}

// What the object sends back of the light that falls on it: mean radiance against that of a white Lambertian surface at its centre whose
// cosine and visibility are kMeanFacing in the mean.
Result<double> Bake::brightness(const glm::dvec3& centre)
{
    constexpr size_t kImages = 50;
    constexpr double kMeanFacing = 0.35;
    double found = 0, white = 0;
    const size_t stride = (train_->images.size() + kImages - 1) / kImages;
    for (size_t i = 0; i < train_->images.size(); i += stride) {
        const Light& light = train_->images[i].light;
        if (!light.isPunctual()) continue;
        auto image = images_->get(uint32_t(i));
        if (!image) return image.error();
        const glm::vec3 at(centre);
        const double irradiance = double(sampleLight(light, &at.x).falloff) * (light.intensity.r + light.intensity.g + light.intensity.b);
        const size_t pixels = size_t((*image)->width) * (*image)->height;
        for (size_t p = 0; p < pixels; ++p) {
            if ((*image)->planes[3 * pixels + p] < 32768) continue;
            for (size_t c = 0; c < 3; ++c) found += linearFromSrgb(float((*image)->planes[c * pixels + p]) / 65535.0f);
            white += kMeanFacing * irradiance / 3.14159265358979;
        }
    }
    return white > 0 ? found / white : 1.0;
}

Status Bake::prepare()
{
    const Quality* quality = findQuality(options_.quality);
    if (!quality) return Error{ErrorCode::kBadInput, "--quality '" + options_.quality + "': expected draft, standard or high"};
    train_ = dataset_.find("train");
    if (!train_) return Error{ErrorCode::kBadInput, dataset_.path + ": no 'train' split (expected transforms_train.json)"};
    byTime_ = options_.iterations <= 0 && options_.minutes > 0;
    std::vector<CameraImages> groups = groupByCamera(*train_);
    if (groups.empty())
        return Error{ErrorCode::kBadInput, dataset_.path + ": the train split has no image with a point or directional light"};
    if (std::all_of(train_->images.begin(), train_->images.end(),
                    [](const OlatImage& i) { return i.light.intensity == glm::vec3(0.0f); }))
        return Error{ErrorCode::kBadInput,
                     dataset_.path + ": every light of the train split has intensity 0; nothing can be learned"};
    for (const CameraImages& g : groups) {
        const Camera& c = train_->cameras[g.camera];
        if (c.width > 8192 || c.height > 8192)
            return Error{ErrorCode::kUnsupported, dataset_.path + ": train images of " + std::to_string(c.width) + "x" +
                                                      std::to_string(c.height) +
                                                      " pixels; at most 8192 per side, scale them down"};
    }
    iterations_ = bakeIterations(options_);
    options_.maxSplats = bakeSplats(options_);
    if (options_.sFunctions < 0) options_.sFunctions = quality->sFunctions;
    if (options_.dssim < 0) options_.dssim = 0;

    TrainerOptions trainerOptions;
    trainerOptions.maxSplats = size_t(options_.maxSplats);
    trainerOptions.seed = options_.seed;
    trainerOptions.loss.dssim = float(options_.dssim);
    if (!makeTrainableAppearance(options_.model, {}))
        return Error{ErrorCode::kBadInput, "--model '" + options_.model + "': this build cannot bake it"};

    images_ = std::make_unique<TrainingImages>(dataset_, *train_, options_.imageBudgetBytes);
    order_ = std::make_unique<StepOrder>(std::move(groups), options_.seed);
    std::vector<Camera> cameras;
    Silhouettes silhouettes = Silhouettes::kGood;
    auto masks = loadMasks(cameras, &silhouettes);
    if (!masks) return masks.error();
    auto warnings = checkTrainingData(dataset_, *train_, silhouettes);
    if (!warnings) return warnings.error();
    result_.warnings = std::move(*warnings);
    report("hull", 0);
    VisualHull hull;
    if (silhouettes == Silhouettes::kGood) {
        hull = carveVisualHull(cameras, *masks, kHullResolution);
        if (hull.surface.empty())
            result_.warnings.push_back(
                "the alphas leave no visual hull: starting from random points in the common view of the cameras");
        if (Status s = checkLights(*train_, hull, result_.warnings); !s) return s;
    } else {
        frameCube(cameras, hull.center, &hull.halfSize);
        trainerOptions.loss.alphaWeight = 0;
    }
    float extent = 0;
    for (const SurfacePoint& p : hull.surface)
        for (int k = 0; k < 3; ++k) extent = std::max(extent, std::abs(p.position[k] - hull.center[k]));
    trainerOptions.sceneSize = extent > 0 ? extent : hull.halfSize;
    if (options_.refineLights)
        refinement_ = std::make_unique<LightRefinement>(*train_, glm::vec3(hull.center[0], hull.center[1], hull.center[2]));
    const size_t initial = std::max<size_t>(1, size_t(kInitialShare * options_.maxSplats));
    const bool onSurface = !hull.surface.empty();
    const double spacing =
        onSurface ? std::sqrt(hull.surfaceArea / double(initial)) : 2.0 * hull.halfSize / std::cbrt(double(initial));
    auto bright = brightness({hull.center[0], hull.center[1], hull.center[2]});
    if (!bright) return bright.error();
    const AppearanceOptions appearanceOptions{options_.sFunctions, options_.without, float(*bright),
                                              lightDistancesVary(*train_, {hull.center[0], hull.center[1], hull.center[2]})};
    trainer_ = std::make_unique<Trainer>(trainerOptions, makeTrainableAppearance(options_.model, appearanceOptions));
    trainer_->initialize(sampleHull(hull, initial, options_.seed), float(spacing), onSurface);
    return ok();
}

Result<LossStats> Bake::trainStep(const Trainer::Moment& moment, bool onTrial, double* splatErrors)
{
    const CameraImages view = order_->at(moment.step);
    std::vector<std::shared_ptr<const PreparedImage>> held;
    const PreparedImage* references[kMaxLightsPerStep];
    Light lights[kMaxLightsPerStep];
    for (size_t i = 0; i < view.images.size(); ++i) {
        auto image = images_->get(view.images[i]);
        if (!image) return image.error();
        held.push_back(*image);
        references[i] = held.back().get();
        lights[i] = refinement_ ? refinement_->light(view.images[i]) : train_->images[view.images[i]].light;
    }
    const Camera& camera = train_->cameras[view.camera];
    // before the step, when the splats have not just been fitted to these images
    if (refinement_ && !onTrial && moment.progress >= kRefineLightsFrom && moment.step % kRefineLightsEvery == 0)
        refinement_->observe(view.images, references,
                             [&](std::span<const Light> l, std::vector<float>& planes) { trainer_->render(camera, l, planes); });
    return trainer_->step(camera, std::span(lights, view.images.size()), references, moment, splatErrors);
}

Status Bake::track()
{
    const OlatSplit* test = dataset_.find("test");
    if (!test) return ok();
    const double before = now();
    if (!heldOutImages_) heldOutImages_ = std::make_unique<TrainingImages>(dataset_, *test, options_.imageBudgetBytes / 4);
    ImageLoss loss;
    std::vector<float> planes, dPlanes;
    double psnr = 0, masked = 0;
    int count = 0;
    for (uint32_t i = 0; i < test->images.size(); ++i) {
        const OlatImage& image = test->images[i];
        if (!image.light.isPunctual()) continue;
        auto reference = heldOutImages_->get(i);
        if (!reference) return reference.error();
        trainer_->render(test->cameras[image.camera], std::span(&image.light, 1), planes);
        dPlanes.resize(planes.size());
        const PreparedImage* r = reference->get();
        const LossStats s = loss.evaluate(planes.data(), &r, 1, {}, dPlanes.data());
        const double whole = psnrFrom(s.squaredError, s.count);
        psnr += whole, masked += s.countMasked > 0 ? psnrFrom(s.squaredErrorMasked, s.countMasked) : whole, ++count;
    }
    if (count)
        state_.history.push_back(
            {before - start_ - state_.trackSeconds, state_.step, int(trainer_->count()), psnr / count, masked / count});
    state_.trackSeconds += now() - before;
    return ok();
}

// Steps on, and how wrong the splats were on images that they had not been fitted to just now: masked squared error of the second
// half.
Result<Bake::TrialErrors> Bake::trial(double progress, int steps, bool bySplat)
{
    TrialErrors errors;
    double squared = 0, count = 0;
    if (bySplat) errors.ofSplats.resize(trainer_->count());
    const int first = state_.step + 1, last = state_.step + steps;
    for (int step = first; step <= last; ++step) {
        if (cancelled()) return Error{ErrorCode::kCancelled, "cancelled at step " + std::to_string(state_.step)};
        if (now() - lastReport_ > 0.5) report("training", progress);
        const bool counts = 2 * (step - first) >= steps;
        auto stats = trainStep({step, progress, rate(progress)}, true, counts && bySplat ? errors.ofSplats.data() : nullptr);
        if (!stats) return stats.error();
        if (!counts) continue;
        const bool masked = stats->countMasked > 0;
        squared += masked ? stats->squaredErrorMasked : stats->squaredError, count += masked ? stats->countMasked : stats->count;
    }
    errors.mean = squared / std::max(count, 1.0);
    return errors;
}

// The same steps are made twice, with a part and without it; the better splats are kept. Both have adapted to what they have by
// then: merely switching a part off says that s is worth as much to marble as to fur (0.6 dB), where it is worth 0 and 0.9 dB.
Status Bake::leaveOutParts()
{
    TrainableAppearance& appearance = trainer_->appearance();
    const auto restore = [&](const ByteWriter& saved) {
        ByteReader in(saved.bytes);
        if (!trainer_->load(in)) std::abort(); // its own bytes of a moment ago
    };
    for (const OptionalPart& part : appearance.optionalParts()) {
        const bool judged =
            std::any_of(state_.parts.begin(), state_.parts.end(), [&](const PartWorth& w) { return w.name == part.name; });
        const double at = progress();
        if (judged || at < part.judgedAt) continue;
        const double all = expectedSteps(at);
        const int steps = int(std::max(kTrialLength * all, std::min(kTrialLeast, kTrialMost * all))) + 1;
        ByteWriter before, after;
        trainer_->save(before);
        auto with = trial(at, steps, part.bySplat);
        trainer_->save(after);
        restore(before);
        Result<TrialErrors> without = with;
        if (with) {
            appearance.leaveOut(part.name, {});
            without = trial(at, steps, part.bySplat);
        }
        if (!without) { // cancelled: as if the trial had never begun
            restore(before);
            return without.error();
        }

        PartWorth worth;
        part.name.copy(worth.name, sizeof worth.name - 1);
        worth.decibel = decibelBetween(without->mean, with->mean);
        std::vector<uint8_t> kept(trainer_->count(), worth.decibel >= part.leastWorth);
        if (part.bySplat) kept = chooseClusters(with->ofSplats, without->ofSplats, part.leastWorth);
        const size_t keeping = size_t(std::count(kept.begin(), kept.end(), 1));
        worth.share = double(keeping) / double(kept.size());
        worth.cost = keeping == 0 ? worth.decibel : 0;
        if (keeping > 0) restore(after);
        if (keeping > 0 && keeping < kept.size()) {
            double errorWith = 0, errorSplit = 0;
            for (size_t i = 0; i < kept.size(); ++i)
                errorWith += with->ofSplats[i], errorSplit += (kept[i] ? with : without)->ofSplats[i];
            worth.cost = decibelBetween(errorSplit, errorWith);
            appearance.leaveOut(part.name, kept);
        }
        state_.parts.push_back(worth);
        state_.step += steps, state_.stepsSinceReset += steps;
    }
    return ok();
}

Status Bake::checkpoint()
{
    if (options_.checkpointPath.empty()) return ok();
    state_.seconds = elapsed();
    if (refinement_) state_.lights = refinement_->evidence();
    return writeFileAtomically(options_.checkpointPath, encodeCheckpoint(optionsHash(), state_, *trainer_));
}

Status Bake::resume()
{
    if (options_.checkpointPath.empty() || !std::filesystem::exists(options_.checkpointPath))
        return Error{ErrorCode::kBadInput,
                     "nothing to resume: no checkpoint at '" + options_.checkpointPath + "'; start again without --resume"};
    auto bytes = readFile(options_.checkpointPath, std::numeric_limits<size_t>::max());
    if (!bytes) return bytes.error();
    auto state = decodeCheckpoint(*bytes, optionsHash(), *trainer_);
    if (!state) return Error{state.error().code, options_.checkpointPath + ": " + state.error().message};
    state_ = std::move(*state);
    if (refinement_ && !refinement_->restore(std::move(state_.lights)))
        return Error{ErrorCode::kBadInput,
                     options_.checkpointPath +
                         ": checkpoint does not fit the lights of this dataset; start again without --resume"};
    start_ = now() - state_.seconds;
    resumedSeconds_ = state_.seconds;
    return ok();
}

// Of the steps or of the time, whichever ends first. Writing the asset takes a moment too: 1 % of a budget in minutes is left for
// it.
double Bake::progress() const
{
    const double steps = double(state_.step) / iterations_;
    return byTime_ ? std::max(steps, elapsed() / (0.99 * 60 * options_.minutes)) : steps;
}

// A bake of more than kReferenceSteps takes smaller steps, so that it travels the same way more finely. Less travel leaves gloss,
// and directions that few lights cover, near their initial values; more makes knob_marble worse. (6000 steps, 12 k splats,
// held-out, masked, for 3000 and 6000: knob_marble 27.0, 26.7 dB; bunny_wax 29.8, 29.8 dB. 21 k steps, 24 k splats, for 1500:
// knob_marble 26.7 dB.) All rates fall exponentially over the bake: to a hundredth, which is worth 1 dB, but not below
// kLeastRate, where a long bake would only learn noise. (10 k steps, 12 k splats, knob_marble, for kLeastRate 0, 0.006, 0.02 and
// 0.05: 27.18, 27.26, 27.35, 27.24 dB; bunny_wax, for 0 and 0.02: 29.63, 29.63 dB.)
double Bake::rate(double progress) const
{
    const double pace = std::min(1.0, kReferenceSteps / expectedSteps(progress));
    return pace * std::pow(std::clamp(kLeastRate / pace, kFinalRate, 1.0), progress);
}

// Of the whole bake.
double Bake::expectedSteps(double progress) const
{
    if (!byTime_) return iterations_;
    constexpr double kGuessSeconds = 0.03; // a step, until the clock says better
    const int done = state_.step - resumedStep_;
    const double perStep = done > 20 ? (progress - startedProgress_) / done : kGuessSeconds / (60 * options_.minutes);
    return std::min(double(iterations_), 1.0 / std::max(perStep, 1e-9));
}

Status Bake::train()
{
    resumedStep_ = state_.step;
    startedProgress_ = progress();
    double lastCheckpoint = now(), lastCheckpointAt = startedProgress_, checkpointTook = 0, psnrSum = 0;
    int psnrCount = 0;
    LossStats pass; // since the last whole pass through the cameras
    const int watch = std::max(kDensifyEvery, int(order_->passLength()));
    for (;;) {
        Status parts = cancelled() ? Status(Error{ErrorCode::kCancelled, "cancelled at step " + std::to_string(state_.step)})
                                   : leaveOutParts();
        if (!parts) {
            if (Status s = checkpoint(); !s) return s;
            return parts;
        }
        const double at = progress();
        if (at >= 1.0) break;
        if (options_.trackHeldOut && at >= state_.nextTrack) {
            if (Status s = track(); !s) return s;
            state_.nextTrack = (std::floor(at / kTrackEvery) + 1) * kTrackEvery;
        }

        ++state_.step, ++state_.stepsSinceReset;
        auto stats = trainStep({state_.step, at, rate(at)});
        if (!stats) return stats.error();
        if (!std::isfinite(stats->loss))
            return Error{ErrorCode::kIo, "training diverged at step " + std::to_string(state_.step) + ": the loss is not finite"};
        pass.squaredErrorMasked += stats->squaredErrorMasked, pass.countMasked += stats->countMasked;
        psnrSum += psnrFrom(stats->squaredError, stats->count), ++psnrCount;
        if (size_t(psnrCount) == order_->passLength()) {
            recentPsnr_ = psnrFrom(pass.squaredErrorMasked, pass.countMasked);
            result_.psnrTrain = psnrSum / psnrCount;
            pass = {}, psnrSum = 0, psnrCount = 0;
        }

        if (state_.stepsSinceReset >= watch && at > kDensifyFrom && at < kDensifyUntil) {
            trainer_->densify(size_t((kGrowth - 1) * double(trainer_->count())));
            state_.stepsSinceReset = 0;
        }
        if (now() - lastReport_ > 0.5) report("training", at);
        const double sinceCheckpoint = now() - lastCheckpoint;
        if ((sinceCheckpoint > kCheckpointSeconds || at - lastCheckpointAt > kCheckpointProgress) &&
            sinceCheckpoint > std::max(kCheckpointLeast, kCheckpointPause * checkpointTook)) {
            const double before = now();
            // A bake that could still end well does not die of a checkpoint that could not be written.
            if (Status s = checkpoint(); !s && !checkpointFailed_) {
                checkpointFailed_ = true;
                result_.warnings.push_back("no checkpoint at step " + std::to_string(state_.step) + ": " + s.error().message);
            }
            lastCheckpoint = now(), lastCheckpointAt = at, checkpointTook = lastCheckpoint - before;
        }
    }
    if (result_.psnrTrain == 0 && psnrCount) result_.psnrTrain = psnrSum / psnrCount; // less than one pass
    // What no camera has seen in a whole pass serves nobody.
    if (state_.stepsSinceReset >= watch) trainer_->prune();
    return options_.trackHeldOut ? track() : ok();
}

Result<BakeResult> Bake::run()
{
    report("loading", 0);
    if (Status s = prepare(); !s) return s.error();
    if (options_.resume)
        if (Status s = resume(); !s) return s.error();
    if (Status s = train(); !s) return s.error();
    report("writing", 1.0);
    SplatAsset& asset = result_.asset;
    asset.model = options_.model;
    trainer_->exportTo(asset);
    leaveOutZeroRows(asset);
    if (Status s = validate(asset); !s)
        return Error{ErrorCode::kIo, "the bake did not end in a usable asset: " + s.error().message};
    // Dataset +Z up becomes glTF +Y up by a quarter turn about X.
    if (dataset_.up.z > 0.5f) asset.yUpFromAsset = glm::quat(std::sqrt(0.5f), -std::sqrt(0.5f), 0, 0);
    asset.bakedWith =
        dataset_.convention + " dataset, " + std::to_string(state_.step) + " iterations, seed " + std::to_string(options_.seed);
    if (refinement_) result_.lights = refinement_->lights();
    result_.history = std::move(state_.history);
    result_.parts = std::move(state_.parts);
    result_.iterations = state_.step;
    result_.seconds = elapsed();
    return std::move(result_);
}

} // namespace

int bakeIterations(const BakeOptions& options)
{
    const Quality* quality = findQuality(options.quality);
    return options.iterations > 0 ? options.iterations : quality ? quality->iterations : 0;
}

int bakeSplats(const BakeOptions& options)
{
    const Quality* quality = findQuality(options.quality);
    return options.maxSplats > 0 ? options.maxSplats : quality ? quality->maxSplats : 0;
}

Result<BakeResult> bake(const OlatDataset& dataset, const BakeOptions& options,
                        const std::function<void(const BakeProgress&)>& progress, const std::atomic<bool>* cancel)
{
    tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
    return arena.execute([&] { return Bake(dataset, options, progress, cancel).run(); });
}

} // namespace nacre
