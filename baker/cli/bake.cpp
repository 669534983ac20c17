// nacre bake: OLAT dataset in, relightable asset out.
#include "cli.h"

#include "appearance/model_table.h"
#include "asset/asset_io.h"
#include "base/file.h"
#include "device/cuda_engine.h"
#include "pack/importance.h"
#include "pack/neutral_look.h"
#include "pack/pack.h"
#include "peak_memory.h"
#include "train/checkpoint.h"
#include "train/choose_model.h"
#include "train/dataset_packer.h"
#include "train/held_out.h"
#include "train/memory.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>

namespace nacre::cli {

struct BakeArguments {
    std::string dataset, output, device = "auto", profile = "compact", json, init, bounds;
    bool restart = false;
    double holdOut = 0; // share of the training cameras
    double memory = 0; // GB; 0: half of the machine's
    BakeOptions options;
    std::string packedPath() const { return output + ".packed"; } // of a set that does not fit the memory: its images, until the bake ends
    std::string trialsPath() const { return output + ".trials"; } // of --model auto; what it has tried
};

static std::string progressText(const BakeProgress& p)
{
    std::string text = p.stage;
    if (p.iterations > 0)
        text += format(" %d/%d", p.iteration, p.iterations);
    else if (p.iteration > 0)
        text += format(" %d", p.iteration);
    text += ", " + clockText(p.seconds) + " elapsed";
    if (p.secondsLeft >= 0) text += ", " + clockText(p.secondsLeft) + " left";
    if (p.splats > 0) text += format(", %d splats", p.splats);
    if (p.psnrTrain > 0) text += format(", %.2f dB (train, masked)", p.psnrTrain);
    return text;
}

static bool exists(const std::string& path)
{
    std::error_code ignored;
    return std::filesystem::exists(path, ignored);
}

/// What a user can still do when the bake was stopped or the disk failed. After other errors the same command would fail again.
static Error withResumeHint(Error error, const BakeArguments& args)
{
    const bool canGoOn = error.code == ErrorCode::kCancelled || error.code == ErrorCode::kIo || error.code == ErrorCode::kGpu;
    if (error.code == ErrorCode::kGpu) error.message += "; --device cpu does without the card";
    for (const std::string& left : {args.options.checkpointPath, args.trialsPath()}) {
        if (!canGoOn || !exists(left)) continue;
        error.message += "; the checkpoint is '" + left + "': give the same command with --resume to go on";
        break;
    }
    return error;
}

/// What an interrupted bake has left is hours of work: it is neither overwritten nor continued unless the user says so.
static Status checkLeftovers(const BakeArguments& args)
{
    const std::string &checkpoint = args.options.checkpointPath, trials = args.trialsPath();
    if (args.restart) return ok();
    if (!args.options.resume) {
        for (const std::string& left : {checkpoint, trials})
            if (exists(left))
                return Error{ErrorCode::kBadInput, "'" + left + "' is left from a bake that was interrupted: --resume goes on with it, --restart discards it"};
        return ok();
    }
    if (!exists(checkpoint) && !exists(trials))
        return Error{ErrorCode::kBadInput, "--resume: there is no checkpoint '" + checkpoint + "'; leave --resume out to start anew"};
    if (args.options.model == "auto" && !exists(trials))
        return Error{ErrorCode::kBadInput, "--resume: the bake of '" + checkpoint + "' was told which model to use; name it, too, instead of --model auto"};
    if (args.options.model != "auto" && exists(trials))
        return Error{ErrorCode::kBadInput, "--resume: the interrupted bake chose its model itself ('" + trials + "'); give --model auto as then"};
    return ok();
}

/// The training images that the bake has to do without: as the interrupted bake found, or as they are now.
static Result<std::vector<UnusableImage>> findSkipped(const BakeArguments& args, const OlatDataset& dataset, const OlatSplit& train,
                                                      Progress& progress, const std::atomic<bool>& stop)
{
    if (dataset.packed) { // those that it has can be used
        std::vector<UnusableImage> skipped;
        for (const SkippedImage& s : dataset.packed->skipped)
            if (s.split == train.name) skipped.push_back({s.path, s.why});
        return skipped;
    }
    const std::string& left = exists(args.options.checkpointPath) ? args.options.checkpointPath : args.trialsPath();
    if (!args.options.resume) {
        const auto show = [&](size_t done, size_t all) { progress.show(format("checking images %zu/%zu", done, all)); };
        return unusableImages(dataset, train, show, &stop);
    }
    const auto bytes = readFile(left, std::numeric_limits<size_t>::max());
    if (!bytes) return bytes.error();
    auto skipped = skippedImages(*bytes);
    if (left == args.trialsPath()) {
        auto trials = decodeTrials(*bytes);
        skipped = trials ? Result<std::vector<UnusableImage>>(trials->skipped) : trials.error();
    }
    if (!skipped) return Error{skipped.error().code, left + ": " + skipped.error().message};
    return skipped;
}

static void warnOfImages(const std::vector<UnusableImage>& images, size_t all, const char* what)
{
    constexpr size_t kNamed = 10; // the rest is in --json
    if (images.empty()) return;
    for (size_t i = 0; i < std::min(images.size(), kNamed); ++i) warn(format("%s: ", what) + images[i].why);
    warn(format("%zu of %zu training images %s", images.size(), all, what) +
         (images.size() > kNamed ? format(", %zu of them named above", kNamed) : std::string()));
}

/// The dataset prepared for this bake alone: a set that does not fit the memory would be decoded again and again. What an interrupted bake has left is
/// used if the files are as they were.
static Result<OlatDataset> packedForThis(const BakeArguments& args, const OlatDataset& dataset, size_t memoryBytes, Progress& progress, const std::atomic<bool>& stop)
{
    const std::string path = args.packedPath();
    std::error_code ignored;
    if (exists(path)) {
        auto left = loadDataset(path);
        if (left && left->packed && left->packed->sourceState == sourceState(dataset)) return left;
        std::filesystem::remove_all(path, ignored);
    }
    PackerOptions options;
    options.output = path, options.memoryBytes = memoryBytes / 4;
    const auto show = [&](size_t done, size_t all, double left) {
        progress.show(format("preparing %zu/%zu images", done, all) + (left >= 0 ? ", " + clockText(left) + " left" : std::string()));
    };
    const auto report = packDataset(dataset, options, show, &stop);
    progress.clear();
    if (!report) return report.error();
    for (const std::string& line : report->notes) warn(line);
    std::printf("the images do not fit the memory: prepared in %s (%.1f GB), which goes when the bake ends; nacre prepare would keep it\n", path.c_str(), double(report->bytes) / 1e9);
    return loadDataset(path);
}

/// --model auto: tries the models, or those that an interrupted bake has not tried, and says what to go on with.
static Result<BakeOptions> chooseModel(const BakeArguments& args, const OlatDataset& dataset, const OlatSplit& train,
                                       const std::function<void(const BakeProgress&)>& show, const std::atomic<bool>& stop)
{
    const std::string identity = bakeIdentity(dataset, train, args.options);
    TrialRecord record{args.options.skipped, {}};
    if (args.options.resume) {
        const auto bytes = readFile(args.trialsPath());
        if (!bytes) return bytes.error();
        auto read = decodeTrials(*bytes);
        if (Status s = checkTrials(*bytes, identity); !s || !read) return Error{s.error().code, args.trialsPath() + ": " + s.error().message};
        record = std::move(*read);
    }
    const auto keep = [&](const std::vector<ModelTrial>& trials) {
        record.trials = trials;
        return writeFileAtomically(args.trialsPath(), encodeTrials(identity, record));
    };
    if (Status s = keep(record.trials); !s) return s.error();
    const auto trials = tryModels(dataset, args.options, record.trials, keep, show, &stop);
    if (!trials) return trials.error();
    for (const ModelTrial& t : *trials)
        std::printf("trial of %s: %.2f dB (masked, cameras that it did not see)\n", t.model.c_str(), t.psnrMasked);
    BakeOptions options = restOf(args.options);
    options.model = trials->front().model;
    options.resume = args.options.resume && exists(options.checkpointPath);
    std::printf("going on with --model %s%s\n", options.model.c_str(),
                options.minutes > 0 ? format(" --minutes %g", options.minutes).c_str() : "");
    return options;
}

static Json historyJson(const std::vector<HistoryPoint>& history)
{
    Json out = Json::array();
    for (const HistoryPoint& h : history)
        out.push_back({{"seconds", h.seconds},
                       {"iteration", h.iteration},
                       {"splats", h.splats},
                       {"psnr", h.psnrTest},
                       {"psnr_masked", h.psnrMaskedTest}});
    return out;
}

static Json partsJson(const std::vector<PartWorth>& parts)
{
    Json out = Json::array();
    for (const PartWorth& p : parts)
        out.push_back(
            {{"part", p.name}, {"worth_db", p.decibel}, {"cost_db", p.cost}, {"kept", p.share > 0}, {"share", p.share}});
    return out;
}

/// What the object turned out to need, and what leaving out the rest cost.
static std::string partsText(const std::vector<PartWorth>& parts)
{
    std::string text;
    for (const PartWorth& p : parts) {
        text += format("%s%s %s (%+.2f dB without it", text.empty() ? "" : ", ", p.name, p.share > 0 ? "kept" : "left out",
                       -p.decibel);
        if (p.share > 0 && p.share < 1) text += format("; only in %.0f %% of the splats: %+.2f dB", 100 * p.share, -p.cost);
        text += ")";
    }
    return text;
}

static Json lightsJson(const std::vector<RefinedLight>& lights)
{
    Json out = Json::array();
    for (const RefinedLight& l : lights) {
        const bool point = l.stated.type == LightType::kPoint;
        const auto place = [&](const Light& light) {
            const glm::vec3& v = point ? light.position : light.directionToLight;
            return Json{v.x, v.y, v.z};
        };
        out.push_back({{"type", point ? "point" : "directional"},
                       {point ? "position" : "direction_to_light", place(l.stated)},
                       {"refined", place(l.refined)},
                       {"degrees", l.degrees},
                       {"gain", l.gain},
                       {"views", l.views}});
    }
    return out;
}

/// How far the lights were moved. A capture that is well measured has small numbers here.
static std::string lightsText(const std::vector<RefinedLight>& lights)
{
    std::vector<double> degrees, percent;
    for (const RefinedLight& l : lights) degrees.push_back(l.degrees), percent.push_back(100 * std::abs(l.gain - 1));
    std::sort(degrees.begin(), degrees.end()), std::sort(percent.begin(), percent.end());
    return format("%zu lights refined: median correction %.2f degrees and %.1f %% of gain, largest %.2f degrees and %.1f %%",
                  lights.size(), degrees[degrees.size() / 2], percent[percent.size() / 2], degrees.back(), percent.back());
}

/// Whether the last steps were of use.
static std::string heldOutText(const std::vector<HistoryPoint>& history)
{
    constexpr double kWorse = 0.05; // dB: less is chance
    const auto psnr = [](const HistoryPoint& a, const HistoryPoint& b) { return a.psnrMaskedTest < b.psnrMaskedTest; };
    const HistoryPoint &last = history.back(), &best = *std::max_element(history.begin(), history.end(), psnr);
    std::string text = format("held-out cameras: %.2f dB in the end (masked)", last.psnrMaskedTest);
    if (best.psnrMaskedTest < last.psnrMaskedTest + kWorse) return text + "; no step was too many";
    return text + format(", %.2f dB at step %d: what came after only fit noise, --iterations %d would do better", best.psnrMaskedTest, best.iteration, best.iteration);
}

struct StoredAsset {
    std::vector<std::byte> file;
    size_t splats = 0;
    std::string note;
    std::vector<std::string> warnings;
};

/// In full, with the look of other viewers under the training lights.
static Result<StoredAsset> unpacked(bool interop, SplatAsset asset, const OlatSplit& train)
{
    std::vector<Light> lights;
    for (const OlatImage& image : train.images) lights.push_back(lightInAsset(asset.frame, image.light));
    auto neutral = fitNeutralLook(asset, lights);
    if (!neutral) return neutral.error();
    asset.neutral = std::move(*neutral);
    std::vector<std::string> warnings;
    if (const Status s = ensureImportance(asset, &train); !s) warnings.push_back("splats could not be ordered by importance (" + s.error().message + "): all or none can be drawn");
    auto file = interop ? encodeInterop(asset) : encodeAsset(asset);
    if (!file) return file.error();
    return StoredAsset{std::move(*file), asset.cloud.count, "", std::move(warnings)};
}

static Result<StoredAsset> storedAs(const std::string& profile, const SplatAsset& asset, const OlatSplit& train, Progress& progress)
{
    if (profile != "compact") return unpacked(profile == "interop", asset, train);
    PackOptions options;
    options.seen = &train;
    options.progress = [&](const std::string& text) { progress.show("packing: " + text); };
    auto packed = packCompact(asset, options);
    progress.clear();
    if (!packed) { // the bake is worth more than its size
        auto lossless = unpacked(false, asset, train);
        if (lossless) lossless->warnings.push_back("could not be packed (" + packed.error().message + "); written with --profile lossless");
        return lossless;
    }
    std::string note = format("packed: an asset 30 dB from the truth loses %.2f dB (--profile lossless keeps everything; nacre pack chooses)", packed->lossDecibel);
    for (const std::string& name : packed->leftOut) note += ", " + name + " left out";
    return StoredAsset{std::move(packed->file), packed->splats, std::move(note), std::move(packed->warnings)};
}

/// Seconds of --minutes that packing will need, about.
static double packingSeconds(const BakeArguments& args)
{
    if (args.profile != "compact") return 0;
    const double perSplat = 2.2e-3; // on two cores 48 s for 24,000
    return std::min(0.1 * 60 * args.options.minutes, perSplat * double(bakeSplats(args.options)));
}

static Result<glm::dvec4> parseBounds(const std::string& text)
{
    glm::dvec4 b(0);
    char rest = 0;
    const bool read = std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf%c", &b.x, &b.y, &b.z, &b.w, &rest) == 4;
    if (!read || !std::isfinite(b.x + b.y + b.z + b.w) || !(b.w > 0))
        return Error{ErrorCode::kBadInput, "--bounds '" + text + "': expected CX,CY,CZ,R, the centre and the radius of the object in the dataset's units"};
    return b;
}

struct ChosenDevice {
    MakeStepEngine make;
    std::string name, text; // of the figures: cpu or cuda; for people
};

static Result<ChosenDevice> chooseDevice(const std::string& device)
{
    if (device == "cpu") return ChosenDevice{makeCpuEngine, "cpu", "the cpu"};
    auto cuda = cudaEngine();
    if (cuda) return ChosenDevice{std::move(cuda->make), "cuda", cuda->card + (device == "auto" ? " (auto; --device cpu trains on the cpu)" : "")};
    if (device == "cuda") return Error{cuda.error().code, "--device cuda: " + cuda.error().message + "; --device cpu needs none"};
    return ChosenDevice{makeCpuEngine, "cpu", "the cpu (auto: " + cuda.error().message + ")"};
}

static Status runBake(BakeArguments args)
{
    auto device = chooseDevice(args.device);
    if (!device) return device.error();
    args.options.makeEngine = device->make;
    if (Status s = checkWritable(args.output); !s) return s;
    if (Status s = checkWritable(args.json); !s) return s;
    BakeOptions& options = args.options;
    options.checkpointPath = args.output + ".ckpt";
    if (Status s = checkLeftovers(args); !s) return s;
    for (const std::string& path : {args.output, options.checkpointPath}) removeAbandonedTemporaries(path);

    if (!args.bounds.empty()) {
        auto bounds = parseBounds(args.bounds);
        if (!bounds) return bounds.error();
        options.bounds = *bounds;
    }
    if (!args.init.empty()) {
        auto init = readInitialSplats(args.init);
        if (!init) return init.error();
        for (const std::string& line : init->warnings) warn(line);
        options.init = std::make_shared<const InitialSplats>(std::move(*init));
    }

    const auto begun = std::chrono::steady_clock::now();
    const auto threads = limitThreads(options.threads);
    const std::atomic<bool>& stop = catchStopSignals();
    Progress progress;
    auto dataset = openDataset(args.dataset);
    if (!dataset) return dataset.error();
    auto train = findSplit(*dataset, "train");
    if (!train) return train.error();
    size_t memoryBytes = args.memory > 0 ? bytesOfGigabytes(args.memory) : machineMemory() / 2;
    if (args.holdOut > 0 || (!args.json.empty() && dataset->find("test"))) options.track = BakeOptions::Track::kNowAndThen;
    auto budget = imageBudget(memoryBytes, *dataset, options);
    if (!budget && args.memory <= 0) budget = imageBudget(memoryBytes = machineMemory(), *dataset, options); // nobody asked to be modest
    if (!budget) return budget.error();
    options.imageBudgetBytes = *budget;
    if (!dataset->packed && preparedBytes(**train) > *budget) {
        auto packed = packedForThis(args, *dataset, memoryBytes, progress, stop);
        if (packed) {
            *dataset = std::move(*packed);
            train = findSplit(*dataset, "train");
            if (!train) return train.error();
        } else if (packed.error().code == ErrorCode::kIo) {
            warn(packed.error().message + "; images are decoded whenever they are needed instead");
        } else {
            return packed.error();
        }
    }
    size_t imageCount = (*train)->images.size();
    auto skipped = findSkipped(args, *dataset, **train, progress, stop);
    progress.clear();
    if (!skipped) return skipped.error();
    if (dataset->packed) imageCount += skipped->size();
    warnOfImages(*skipped, imageCount, "skipped");
    options.skipped = std::move(*skipped);
    *dataset = without(std::move(*dataset), "train", options.skipped);
    options.heldOutJudges = args.holdOut > 0;
    if (args.holdOut > 0) {
        const auto every = uint32_t(std::lround(1 / args.holdOut));
        *dataset = holdOut(std::move(*dataset), every);
        if (dataset->find("test")->images.empty() || dataset->find("train")->images.empty())
            return Error{ErrorCode::kBadInput, format("--hold-out %g holds out every %u. camera, and there are too few to train", args.holdOut, every)};
    }
    train = findSplit(*dataset, "train");
    {
        ImageCache images(*dataset, size_t(64) << 20);
        const auto suspicions = checkConventions(*dataset, images);
        if (!suspicions) return suspicions.error();
        for (const std::string& line : *suspicions) warn(line);
    }
    options.secondsBefore = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count() + packingSeconds(args);
    std::error_code ignored;
    if (args.restart)
        for (const std::string& left : {options.checkpointPath, args.trialsPath()}) std::filesystem::remove(left, ignored);

    const auto show = [&](const BakeProgress& p) { progress.show(progressText(p)); };
    if (options.model == "auto") {
        auto chosen = chooseModel(args, *dataset, **train, show, stop);
        progress.clear();
        if (!chosen) return withResumeHint(chosen.error(), args);
        options = std::move(*chosen);
    }
    auto result = bake(*dataset, options, show, &stop);
    progress.clear();
    if (!result) return withResumeHint(result.error(), args);
    warnOfImages(result->lost, imageCount, "lost on the way");
    for (const std::string& line : result->warnings) warn(line);
    result->asset.bakedWith = "nacre " NACRE_VERSION_STRING ", " + result->asset.bakedWith;
    auto stored = storedAs(args.profile, result->asset, *dataset->find("train"), progress);
    if (!stored) return stored.error();
    for (const std::string& line : stored->warnings) warn(line);
    if (Status s = writeFileAtomically(args.output, stored->file); !s) return withResumeHint(s.error(), args);
    for (const std::string& done : {options.checkpointPath, args.trialsPath()}) std::filesystem::remove(done, ignored);
    std::filesystem::remove_all(args.packedPath(), ignored);

    const size_t splats = stored->splats, bytes = stored->file.size(), peak = peakMemoryBytes();
    std::printf("%s: model %s, %zu splats, %zu bytes (%.1f per splat)\n", args.output.c_str(), result->asset.model.c_str(),
                splats, bytes, double(bytes) / double(splats));
    if (!result->cut.empty()) std::printf("%s (--bounds places them, --keep-background keeps all)\n", result->cut.c_str());
    if (!stored->note.empty()) std::printf("%s\n", stored->note.c_str());
    std::printf("%d iterations in %.1f s on %s, train PSNR %.2f dB, peak memory %.0f MiB\n", result->iterations, result->seconds,
                device->text.c_str(), result->psnrTrain, double(peak) / 1048576.0);
    const double saturated = saturation(result->iterations, options, *dataset);
    if (options.iterations <= 0 && options.minutes > 0 && result->iterations >= bakeIterations(options, *dataset))
        std::printf("all %d steps that --quality %s makes of these images are made%s (--iterations insists)\n", result->iterations,
                    options.quality.c_str(), saturated >= 0.99 ? ": more would only fit noise" : "");
    else if (options.iterations <= 0 && saturated < 0.25)
        std::printf("each image was seen %.0f %% as often as helps at --quality %s: more --minutes or --iterations would do better\n",
                    100 * saturated, options.quality.c_str());
    if (args.holdOut > 0 && !result->history.empty()) std::printf("%s\n", heldOutText(result->history).c_str());
    if (!result->parts.empty()) std::printf("%s\n", partsText(result->parts).c_str());
    if (!result->lights.empty()) std::printf("%s\n", lightsText(result->lights).c_str());
    if (args.json.empty()) return ok();
    Json figures = {{"model", result->asset.model},
                    {"splats", splats},
                    {"iterations", result->iterations},
                    {"seconds", result->seconds},
                    {"device", device->name},
                    {"seed", options.seed},
                    {"psnr_train", result->psnrTrain},
                    {"peak_rss_bytes", peak},
                    {"asset_bytes", bytes},
                    {"parts", partsJson(result->parts)},
                    {"history", historyJson(result->history)},
                    {"skipped", skippedJson(options.skipped)}};
    if (options.refineLights) figures["lights"] = lightsJson(result->lights);
    return writeJson(figures, args.json);
}

Action addBake(CLI::App& app)
{
    auto args = std::make_shared<BakeArguments>();
    BakeOptions& o = args->options;
    std::vector<std::string> models;
    for (const AppearanceModel& model : appearanceModels()) models.push_back(model.name);

    CLI::App* sub = app.add_subcommand("bake", "Turn an OLAT dataset into a relightable asset");
    sub->add_option("DATASET", args->dataset, "OLAT dataset: its folder or a transforms file")->required();
    sub->add_option("-o,--output", args->output, "Asset to write (.glb)")->required();
    models.push_back("auto");
    sub->add_option("--model", o.model,
                    "Appearance model; auto: the one that does better in a small bake of each (12 % of the time)")
        ->check(CLI::IsMember(models))
        ->capture_default_str();
    sub->add_option("--quality", o.quality, "Sets iterations, splats and channel sizes that are not given")
        ->check(CLI::IsMember({"draft", "standard", "high"}))
        ->capture_default_str();
    auto* minutes =
        sub->add_option(
               "--minutes", o.minutes,
               "At most this long, in minutes; ends sooner when the steps of --quality are made, as more would only fit noise")
            ->check(positiveNumber());
    sub->add_option("--iterations", o.iterations, "Training steps, instead of --minutes; same seed, same bytes")
        ->check(wholeNumber(1, 100000000))
        ->excludes(minutes);
    sub->add_option("--device", args->device, "Where to train; auto: on a CUDA card if there is one")
        ->check(CLI::IsMember({"cpu", "cuda", "auto"}))
        ->capture_default_str();
    sub->add_option("--threads", o.threads, "0: all cores; the result does not depend on it")
        ->check(wholeNumber(0, 4096))
        ->capture_default_str();
    sub->add_option("--memory", args->memory, "At most so much [GB] (default: half of the machine's); sets that do not fit are prepared beside the output first")->check(positiveNumber());
    sub->add_option("--hold-out", args->holdOut, "Share of the training cameras to do without, which then tell from where on steps only fit noise (and take the place of the test split in --json)")
        ->check(numberBetween(0.01, 0.5));
    sub->add_option("--seed", o.seed, "Of every random choice")->check(wholeNumber(0, INT64_MAX))->capture_default_str();
    sub->add_option("--max-splats", o.maxSplats, "Hard cap on the number of Gaussians (default: from --quality, and no more than the images can resolve)")
        ->check(wholeNumber(1, 100000000));
    sub->add_option("--init", args->init,
                    "Start from these splats instead of the visual hull: a .ply of 3D Gaussian splatting in axes and units of the dataset, or an\n"
                    "asset (.glb) of it; of more than --max-splats those that cover most");
    sub->add_option("--bounds", args->bounds,
                    "CX,CY,CZ,R: the ball that holds the object, in the dataset's units, for images without masks (default: where the cameras look, as much as they\n"
                    "frame). Splats outside learn the surroundings and are cut off in the end, as is the plane that the object stands on");
    sub->add_flag("--keep-background", o.keepBackground, "Cut nothing off");
    sub->add_option("--s-functions", o.sFunctions,
                    "bigs: spherical harmonics of the view-dependent term s, while it earns its bytes (default: from --quality)")
        ->check(CLI::IsMember({0, 1, 4, 9, 16, 25}));
    sub->add_option("--without", o.without,
                    "For comparisons: train without these (s: other view dependence, lobe: highlights, normal-search: their normals by what all images show, forward: light that goes on through hairs and leaves, visibility: hard shadows, "
                    "sharing: gloss and "
                    "indirect light learnt together by neighbours, schedule: rates of each channel that fall; else plain Adam; "
                    "sss: residual, share, visibility, code: numbers that the network has of each splat, roughness-restart: the trial of starting "
                    "roughness again from 0.2)")
        ->check(CLI::IsMember({"lobe", "forward", "normal-search", "visibility", "sharing", "schedule", "s", "residual", "share", "code", "roughness-restart"}))
        ->delimiter(',');
    sub->add_option("--dssim", o.dssim, "Weight of 1-SSIM in the loss, 0 to 1 (default: 0, the squared error alone)")
        ->check(numberBetween(0, 1));
    sub->add_flag(
        "--refine-lights", o.refineLights,
        "Correct gain and direction of each training light on the way, for captures that are off by a few per cent or degrees");
    auto* resume = sub->add_flag("--resume", o.resume, "Go on with what an interrupted bake has left: ASSET.glb.ckpt or, of --model auto, ASSET.glb.trials");
    sub->add_flag("--restart", args->restart, "Discard what an interrupted bake has left and start anew")->excludes(resume);
    sub->add_option("--profile", args->profile, "How the asset is stored. compact: quantised where it does not show, 0.3 dB at most (see nacre pack); lossless: float32, 40 times as large; interop: for any viewer of KHR_gaussian_splatting, float32 without visibility maps")
        ->check(CLI::IsMember({"compact", "lossless", "interop"}))->capture_default_str();
    sub->add_option("--json", args->json, "Write figures of the bake, and its held-out error over time (up to 48 images of the test split; no time of --minutes is spent on it), to this file");
    sub->footer("Ctrl-C and SIGTERM write a checkpoint next to the output; --resume goes on from there.");
    return [args] { return runBake(*args); };
}

} // namespace nacre::cli
