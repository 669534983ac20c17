// The bake: silhouettes -> initial splats -> steps with density control -> pruning -> asset.
// This file only drives: what to start from (preparation), how long and how fast (schedule), which images (training_steps), what the model
// can do without (part_trials) and the step itself (trainer) are each found in a file of that name.
#include "train/bake.h"

#include "appearance/model_table.h"
#include "base/file.h"
#include "dataset/normalise.h"
#include "device/device_error.h"
#include "pack/leading_rows.h"
#include "train/checkpoint.h"
#include "train/held_out.h"
#include "train/learning_light.h"
#include "train/part_trials.h"
#include "train/preparation.h"
#include "train/schedule.h"
#include "train/training_steps.h"

#include <tbb/task_arena.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

namespace nacre {

namespace {

constexpr double kReportSeconds = 0.5;
constexpr double kTrackEvery = 0.05; // of the bake, with trackHeldOut
// When masks are learnt, of the bake: before it judges what the object can do without, for what shines through it has no shadows. (A vase on a table in a room,
// 80 photographs with the flash, 4000 steps, masked: never 12.4 dB, at 0.35 11.9, at 0.18 14.1, at 0.1 13.5; given masks 16.2.)
constexpr double kMasksAt = 0.18, kLeastObject = 1e-3, kMostOpen = 0.2; // of all pixels

/// PSNR of the training images, from the steps' own renders.
class TrainingPsnr {
public:
    explicit TrainingPsnr(size_t passLength) : passLength_(passLength) {}
    void add(const LossStats& s)
    {
        squaredErrorMasked_ += s.squaredErrorMasked, countMasked_ += s.countMasked;
        sum_ += psnrFrom(s.squaredError, s.count), ++steps_;
        if (steps_ < passLength_) return;
        masked = psnrFrom(squaredErrorMasked_, countMasked_), whole_ = sum_ / double(steps_);
        squaredErrorMasked_ = countMasked_ = sum_ = 0, steps_ = 0;
    }
    double whole() const { return whole_ == 0 && steps_ ? sum_ / double(steps_) : whole_; } // of less than a pass, if there was no whole one

    double masked = 0; // of the last whole pass

private:
    size_t passLength_, steps_ = 0;
    double squaredErrorMasked_ = 0, countMasked_ = 0, sum_ = 0, whole_ = 0;
};

class Bake {
public:
    /// `dataset` is `stated` in its frame, under lights `gain` times as bright.
    Bake(const OlatDataset& dataset, const OlatDataset& stated, double gain, const BakeOptions& options, const std::function<void(const BakeProgress&)>& progress,
         const std::atomic<bool>* cancel)
        : dataset_(dataset), stated_(stated), options_(options), report_(progress), cancel_(cancel), schedule_(options, dataset)
    {
        state_.gain = gain;
    }

    Result<BakeResult> run();

private:
    Status setUp();
    Status resume();
    Status train();
    Result<LossStats> step(double progress);
    void track();
    Status lookAhead(double progress);
    Status showEvidence(double progress);
    Status checkpoint();
    std::string cutBackground();
    Status learnMasks(double progress);
    void useMasks();
    Result<BakeResult> finish();
    Status tick(const char* stage, double progress);
    void report(const char* stage, double progress);

    std::string identity() const { return bakeIdentity(stated_, *stated_.find("train"), options_); }

    const OlatDataset &dataset_, &stated_;
    BakeOptions options_;
    const std::function<void(const BakeProgress&)>& report_;
    const std::atomic<bool>* cancel_;
    Schedule schedule_;
    double lastReport_ = 0; // seconds of the schedule
    std::string lastStage_;

    Preparation preparation_;
    std::unique_ptr<TrainingImages> heldOutImages_;
    std::unique_ptr<Trainer> trainer_;
    std::unique_ptr<LightRefinement> refinement_; // with refineLights
    std::unique_ptr<TrainingSteps> steps_;
    double recentPsnr_ = 0;
    bool checkpointFailed_ = false;
    BakeState state_;
    BakeResult result_;
};

void Bake::report(const char* stage, double progress)
{
    lastReport_ = schedule_.seconds(), lastStage_ = stage;
    if (report_)
        report_({stage, state_.step, schedule_.byTime() ? 0 : options_.iterations, schedule_.seconds(), schedule_.secondsLeft(progress),
                 trainer_ ? int(trainer_->count()) : 0, recentPsnr_});
}

// To be called often. An error once the bake is cancelled.
Status Bake::tick(const char* stage, double progress)
{
    if (cancel_ && cancel_->load())
        return Error{ErrorCode::kCancelled,
                     trainer_ ? "cancelled at step " + std::to_string(state_.step) : "cancelled before training started"};
    if (stage != lastStage_ || schedule_.seconds() - lastReport_ > kReportSeconds) report(stage, progress);
    return ok();
}

static std::string percent(double share) { return std::to_string(int(std::lround(100 * share))) + " %"; }

Status Bake::setUp()
{
    auto options = withDefaults(options_, dataset_);
    if (!options) return options.error();
    options_ = std::move(*options);
    if (!makeTrainableAppearance(options_.model, {}))
        return Error{ErrorCode::kBadInput, "--model '" + options_.model + "': this build cannot bake it"};

    auto prepared = prepare(dataset_, options_, [&](const char* stage) { return tick(stage, 0); });
    if (!prepared) return prepared.error();
    preparation_ = std::move(*prepared);
    Preparation& p = preparation_;
    result_.warnings = std::move(p.warnings);
    if (options_.heldOutJudges && p.region && !options_.keepBackground)
        return Error{ErrorCode::kBadInput, "--hold-out needs masks, or --keep-background: without them the surroundings are cut off after a fifth of the bake, and held-out images show "
                                           "them before and after"};

    trainer_ = std::make_unique<Trainer>(p.trainer, makeTrainableAppearance(options_.model, p.appearance), options_.makeEngine);
    if (p.init.cloud.count > 0) trainer_->initialize(p.init.cloud, p.init.colors);
    else trainer_->initialize(p.points, p.spacing, p.flat);
    if (options_.refineLights) refinement_ = std::make_unique<LightRefinement>(*p.split, p.center);
    steps_ = std::make_unique<TrainingSteps>(*p.split, *p.images, StepOrder(std::move(p.views), options_.seed), *trainer_, refinement_.get());
    return ok();
}

Status Bake::checkpoint()
{
    if (options_.checkpointPath.empty()) return ok();
    state_.seconds = schedule_.seconds();
    if (refinement_) state_.lights = refinement_->evidence();
    return writeFileAtomically(options_.checkpointPath, encodeCheckpoint(identity(), options_.skipped, state_, *trainer_));
}

Status Bake::resume()
{
    auto bytes = readFile(options_.checkpointPath, std::numeric_limits<size_t>::max());
    if (!bytes) return bytes.error();
    auto state = decodeCheckpoint(*bytes, identity(), preparation_.split->cameras.size(), *trainer_);
    if (!state) return Error{state.error().code, options_.checkpointPath + ": " + state.error().message};
    state_ = std::move(*state);
    if (refinement_ && !refinement_->restore(std::move(state_.lights)))
        return Error{ErrorCode::kBadInput,
                     options_.checkpointPath +
                         ": checkpoint does not fit the lights of this dataset; start again with --restart"};
    if (state_.masks) useMasks();
    schedule_.resume(state_.seconds);
    return ok();
}

void Bake::track()
{
    const OlatSplit* test = dataset_.find("test");
    if (!test) return;
    const double before = schedule_.seconds();
    if (!heldOutImages_) heldOutImages_ = std::make_unique<TrainingImages>(dataset_, *test, options_.imageBudgetBytes / 4);
    const HeldOutPsnr psnr = measureHeldOut(*trainer_, *test, *heldOutImages_);
    if (psnr.images) state_.history.push_back({before, state_.step, int(trainer_->count()), psnr.whole, psnr.masked});
    schedule_.leaveOut(schedule_.seconds() - before);
}

// What the model does before the next step may take minutes, in which a user wants to see that the bake is alive, and may stop it.
Status Bake::lookAhead(double progress)
{
    Status goesOn = ok();
    trainer_->prepareStep(progress, [&] {
        goesOn = tick("training", progress);
        return bool(goesOn);
    });
    return goesOn;
}

// Takes as long as a pass, likewise.
Status Bake::showEvidence(double progress)
{
    if (!trainer_->appearance().wantsEvidence(progress)) return ok();
    std::vector<ViewEvidence> views;
    Status goesOn = ok();
    const auto goOn = [&] {
        goesOn = tick("training", progress);
        return bool(goesOn);
    };
    if (steps_->gatherEvidence(state_.step + 1, goOn, views)) trainer_->useEvidence(progress, views);
    return goesOn;
}

void Bake::useMasks()
{
    preparation_.images->useMasks(*state_.masks);
    trainer_->weighAlpha(LossOptions().alphaWeight);
}

// Images without masks get those that the splats of the object cover, and the splats of the surroundings have served. Once, and not if hardly anything was found.
Status Bake::learnMasks(double progress)
{
    if (state_.masksTried || !preparation_.region || options_.keepBackground || progress < kMasksAt) return ok();
    const OlatSplit& split = *preparation_.split;
    auto masks = std::make_shared<LearntMasks>(split.cameras.size());
    const std::vector<std::byte> before = trainer_->snapshot();
    const std::string cut = cutBackground();
    std::vector<uint8_t> drawn(split.cameras.size());
    std::vector<float> planes;
    Status goesOn = ok();
    for (const OlatImage& image : split.images) {
        if (std::exchange(drawn[image.camera], uint8_t(1)) || !(goesOn = tick("masks", progress))) continue;
        const Camera& camera = split.cameras[image.camera];
        const size_t pixels = size_t(camera.width) * size_t(camera.height);
        trainer_->render(camera, std::span(&image.light, 1), planes);
        masks->set(image.camera, camera.width, camera.height, planes.data() + 3 * pixels);
    }
    const LearntMasks::Shares shares = masks->shares();
    if (!goesOn || shares.object < kLeastObject) { // as if nothing had been tried
        if (Status s = trainer_->restore(before); !s) return s;
        if (!goesOn) return goesOn;
        state_.masksTried = true;
        result_.warnings.push_back("no masks, and the splats cover too little to draw any (" + cut + "): the surroundings may shine through the object; give masks, or --bounds");
        return ok();
    }
    state_.masks = masks, state_.masksTried = true, state_.stepsSinceReset = 0;
    char text[160];
    std::snprintf(text, sizeof text, "; from step %d on by masks that these cover, %.1f %% of the pixels and %.1f %% left open", state_.step, 100 * shares.object, 100 * shares.unknown);
    result_.cut = cut + text;
    useMasks();
    if (shares.unknown > kMostOpen)
        result_.warnings.push_back(percent(shares.unknown) + " of the pixels are neither object nor surroundings by these masks, and are not learnt from: the bounds may hold only a part of the "
                                   "object, or the cameras, too; --bounds CX,CY,CZ,R says where the object is");
    return ok();
}

Result<LossStats> Bake::step(double progress)
{
    const int next = state_.step + 1;
    auto stats = steps_->take({next, progress, schedule_.rate(next, progress)});
    if (!stats) { // the disk is gone: the bake can go on from here when it is back
        if (Status s = checkpoint(); !s) return s.error();
        return stats;
    }
    ++state_.step, ++state_.stepsSinceReset;
    if (!std::isfinite(stats->loss))
        return Error{ErrorCode::kIo, "training diverged at step " + std::to_string(state_.step) + ": the loss is not finite"};
    return stats;
}

Status Bake::train()
{
    schedule_.beginTraining(state_.step, steps_->passLength());
    CheckpointPace pace(schedule_.seconds(), schedule_.progress(state_.step));
    TrainingPsnr psnr(steps_->passLength());
    const TrialStep trialStep = [&](const Trainer::Moment& moment, double* splatErrors) -> Result<LossStats> {
        if (Status s = tick("training", moment.progress); !s) return s.error();
        if (Status s = lookAhead(moment.progress); !s) return s.error();
        return steps_->takeOnTrial(moment, splatErrors);
    };
    for (;;) {
        Status goesOn = tick("training", schedule_.progress(state_.step));
        if (goesOn) goesOn = leaveOutParts(*trainer_, schedule_, trialStep, state_);
        if (!goesOn) {
            if (Status s = checkpoint(); !s) return s;
            return goesOn;
        }
        const double progress = schedule_.progress(state_.step);
        if (progress >= 1.0) break;
        if (options_.track == BakeOptions::Track::kNowAndThen && progress >= state_.nextTrack) {
            track();
            state_.nextTrack = (std::floor(progress / kTrackEvery) + 1) * kTrackEvery;
        }

        Status ready = learnMasks(progress);
        if (ready) ready = lookAhead(progress);
        if (ready) ready = showEvidence(progress);
        if (!ready) {
            if (Status written = checkpoint(); !written) return written;
            return ready;
        }
        auto stats = step(progress);
        if (!stats) return stats.error();
        if (stats->count > 0) psnr.add(*stats);
        recentPsnr_ = psnr.masked;

        if (schedule_.densifies(state_.stepsSinceReset, progress)) {
            trainer_->densify(schedule_.growth(trainer_->count()));
            state_.stepsSinceReset = 0;
        }
        if (const double before = schedule_.seconds(); pace.due(before, progress)) {
            // A bake that could still end well does not die of a checkpoint that could not be written.
            if (Status s = checkpoint(); !s && !checkpointFailed_) {
                checkpointFailed_ = true;
                result_.warnings.push_back("no checkpoint at step " + std::to_string(state_.step) + ": " + s.error().message);
            }
            pace.written(before, schedule_.seconds(), progress);
        }
    }
    result_.psnrTrain = psnr.whole();
    // What no camera has seen in a whole pass serves nobody.
    if (schedule_.allHaveLooked(state_.stepsSinceReset)) trainer_->prune();
    if (options_.track != BakeOptions::Track::kNever) track();
    return ok();
}

std::string Bake::cutBackground()
{
    const size_t before = trainer_->count();
    const ObjectCut cut = trainer_->keepObject(*preparation_.region, preparation_.split->cameras);
    const glm::dvec3 centre = dataset_.frame.positionInDataset(glm::dvec3(preparation_.region->center));
    char text[320];
    std::snprintf(text, sizeof text, "no masks: kept %zu of %zu splats; cut off are %zu outside of the object's bounds %.4g,%.4g,%.4g,%.4g, %zu %s and %zu loose ones",
                  trainer_->count(), before, cut.outside, centre.x, centre.y, centre.z, double(preparation_.region->radius) * dataset_.frame.scale, cut.below,
                  cut.plane ? "of the plane it stands on and below" : "below (no plane that it stands on was found)", cut.loose);
    return text;
}

Result<BakeResult> Bake::finish()
{
    SplatAsset& asset = result_.asset;
    asset.model = options_.model;
    if (preparation_.region && !options_.keepBackground && !state_.masks) result_.cut = cutBackground();
    trainer_->exportTo(asset);
    leaveOutZeroRows(asset);
    if (asset.cloud.count == 0)
        return Error{ErrorCode::kBadInput, "all splats faded: no arrangement of them explains the training images; check poses, camera axes, "
                                           "light intensities and masks (nacre info names what looks wrong)"};
    if (Status s = validate(asset); !s)
        return Error{ErrorCode::kIo, "the bake did not end in a usable asset: " + s.error().message};
    // Dataset +Z up becomes glTF +Y up by a quarter turn about X.
    if (dataset_.up.z > 0.5f) asset.yUpFromAsset = glm::quat(std::sqrt(0.5f), -std::sqrt(0.5f), 0, 0);
    asset.frame = dataset_.frame;
    asset.bakedWith =
        dataset_.convention + " dataset, " + std::to_string(state_.step) + " iterations, seed " + std::to_string(options_.seed);
    if (refinement_) result_.lights = refinement_->lights();
    result_.lost = steps_->lost();
    for (RefinedLight& l : result_.lights) l.stated = lightInDataset(asset.frame, l.stated), l.refined = lightInDataset(asset.frame, l.refined);
    result_.history = std::move(state_.history);
    result_.parts = std::move(state_.parts);
    result_.iterations = state_.step;
    result_.seconds = schedule_.seconds();
    return std::move(result_);
}

Result<BakeResult> Bake::run()
{
    report("loading", 0);
    if (Status s = setUp(); !s) return s.error();
    if (options_.resume)
        if (Status s = resume(); !s) return s.error();
    if (Status s = train(); !s) return s.error();
    report("writing", 1.0);
    return finish();
}

/// That of an interrupted bake holds on: today's pixels may be those of a pack.
Result<double> gainFor(const OlatDataset& inFrame, const BakeOptions& options)
{
    if (!options.resume) return learningGain(inFrame, options.model);
    const auto checkpoint = readFile(options.checkpointPath, std::numeric_limits<size_t>::max());
    if (!checkpoint) return Error{ErrorCode::kBadInput, "nothing to resume: " + checkpoint.error().message + "; start again without --resume"};
    auto gain = learningGainOf(*checkpoint);
    if (!gain) return Error{gain.error().code, options.checkpointPath + ": " + gain.error().message};
    return gain;
}

} // namespace

Result<BakeResult> bake(const OlatDataset& dataset, const BakeOptions& options,
                        const std::function<void(const BakeProgress&)>& progress, const std::atomic<bool>* cancel)
{
    tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
    return arena.execute([&]() -> Result<BakeResult> {
        const Result<OlatDataset> inFrame = normalised(dataset);
        if (!inFrame) return inFrame.error();
        const Result<double> gain = gainFor(*inFrame, options);
        if (!gain) return gain.error();
        const OlatDataset lit = underGain(*inFrame, *gain);
        try {
            Result<BakeResult> result = Bake(lit, dataset, *gain, options, progress, cancel).run();
            if (result) absorbGain(result->asset, *gain, inFrame->frame);
            return result;
        } catch (const DeviceError& e) {
            return Error{ErrorCode::kGpu, e.what()};
        }
    });
}

} // namespace nacre
