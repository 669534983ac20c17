// nacre tune: the best of an asset within a bound on frame time, bytes or error.
#include "cli.h"

#include "appearance/detail.h"
#include "asset/asset_io.h"
#include "base/file.h"
#include "pack/importance.h"
#include "pack/pack.h"
#include "report/measure.h"
#include "report/tune.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

namespace nacre::cli {

struct TuneArguments {
    std::string asset, dataset, output, profile, preset, json;
    double maxMs = 0, minPsnr = 0, minutes = 2.5;
    long long maxBytes = 0;
    bool fastest = false, scales = false;
    ThreadsOption threads;
};

/// Without what the choice leaves out, in the profile of the input.
static Result<std::vector<std::byte>> reducedFile(const AssetFile& in, const report::Tuned& tuned, const Preset& preset, const OlatSplit* seen)
{
    SplatAsset asset = in.asset;
    if (Status s = reduceDetail(asset, tuned.variant.detail); !s) return s.error();
    std::erase_if(asset.channels, [](const Channel& c) { return c.name == "importance" || c.name == "growth"; }); // of other splats
    if (Status s = ensureImportance(asset, seen); !s) return s.error();
    asset.presets = {preset};
    if (in.asset.profile != "compact") return in.asset.profile == "interop" ? encodeInterop(asset) : encodeAsset(asset);
    PackOptions options;
    options.seen = seen, options.maxLossDecibel = 0.1; // once more on top of what the first packing lost
    auto packed = packCompact(asset, options);
    if (!packed) return packed.error();
    return std::move(packed->file);
}

static Status checkGoal(const TuneArguments& args)
{
    if ((args.maxMs > 0) + (args.maxBytes > 0) + (args.minPsnr > 0) != 1) return Error{ErrorCode::kBadInput, "give one of --max-ms, --max-bytes and --min-psnr"};
    if (args.fastest && args.minPsnr == 0) return Error{ErrorCode::kBadInput, "--fastest goes with --min-psnr"};
    if (!args.preset.empty() && args.maxMs == 0 && !args.fastest) return Error{ErrorCode::kBadInput, "--as-preset goes with --max-ms, or --min-psnr and --fastest: bytes cannot be left out of a file that keeps everything"};
    if (args.preset.size() > 31 || !std::all_of(args.preset.begin(), args.preset.end(), [](char c) { return c > 0x20 && c < 0x7f; }))
        return Error{ErrorCode::kBadInput, "--as-preset: a name has 1 to 31 printable ASCII characters without spaces"};
    return ok();
}

static void print(const TuneArguments& args, const report::Tuned& t, size_t before, size_t bytes)
{
    std::printf("%s: %s\n", args.output.c_str(), t.settings.c_str());
    if (t.time.ms > 0) std::printf("%.2f ms a frame%s (%.2f to %.2f) instead of %.2f\n", t.time.ms, args.profile.empty() ? "" : " on the device of the profile, about,", t.time.low, t.time.high, t.fullTime.ms);
    std::printf("%zu bytes instead of %zu\n", bytes, before);
    const double lost = t.fullPsnrMasked - t.psnrMasked;
    std::printf("%.2f dB over the object instead of %.2f: %s\n", t.psnrMasked, t.fullPsnrMasked, lost > 0 ? format("%.2f dB were given up", lost).c_str() : "nothing was given up");
    if (t.variant.resolutionScale < 1) std::printf("the host has to draw splats at %.0f %% of the width and height, and enlarge them\n", 100 * double(t.variant.resolutionScale));
}

static Status runTune(const TuneArguments& args)
{
    const std::atomic<bool>& stop = catchStopSignals();
    const auto threads = limitThreads(args.threads.count);
    if (Status s = checkGoal(args); !s) return s;
    if (Status s = checkExtension(args.output, ".glb"); !s) return s;
    if (Status s = checkOutputs({args.output, args.json}, {args.asset, args.dataset, args.profile}); !s) return s;
    auto file = openAsset(args.asset);
    if (!file) return file.error();
    const auto dataset = openDataset(args.dataset);
    if (!dataset) return dataset.error();
    const auto split = report::heldOutSplit(*dataset);
    if (!split) return split.error();
    const OlatSplit* seen = dataset->find("train");

    Progress progress;
    const report::Says says = [&](const std::string& text) {
        progress.show("tune: " + text);
        return !stop;
    };
    report::DeviceProfile here, there;
    report::TuneGoal goal{args.maxMs, args.minPsnr, size_t(args.maxBytes), args.fastest, args.scales, nullptr, nullptr};
    if (!args.profile.empty()) {
        auto read = report::readProfile(args.profile);
        if (!read) return read.error();
        auto measured = report::measureDevice(says);
        if (!measured) return stop ? stoppedBySignal("nothing was written") : measured.error();
        there = std::move(*read), here = std::move(*measured);
        goal.here = &here, goal.there = &there;
    }
    if (!args.preset.empty() && !file->asset.find("importance")) warn("'" + args.asset + "' has no order of importance, so that a preset can leave out no splats; nacre pack makes one");
    else if (!file->asset.find("importance")) {
        says("ordering splats by importance");
        if (const Status s = ensureImportance(file->asset, seen); !s) return s;
    }
    ImageCache references(*dataset, size_t(512) << 20);
    constexpr size_t kImages = 8;
    auto meter = report::VariantMeter::create(file->asset, **split, references, kImages);
    if (!meter) return meter.error();
    meter->stopped = [&] { return stop.load(); };
    auto tuned = report::tune(*meter, file->asset, seen, file->bytes.size(), goal, 60 * args.minutes, says);
    if (!tuned) return stop ? stoppedBySignal("nothing was written") : tuned.error();

    const auto renderer = meter->rendererDescription();
    if (!renderer) return renderer.error();
    Preset preset{args.preset.empty() ? "tuned" : args.preset, args.preset.empty() ? Detail{} : tuned->variant.detail, tuned->variant.resolutionScale, 0, tuned->time.ms, tuned->psnrMasked,
                  args.profile.empty() ? report::machineText() + ", " + *renderer : there.machine + ", " + there.renderer};
    says("writing");
    Result<std::vector<std::byte>> out = tuned->file;
    if (!args.preset.empty()) {
        std::vector<Preset> presets = file->asset.presets;
        std::erase_if(presets, [&](const Preset& p) { return p.name == preset.name; });
        presets.push_back(preset);
        out = withPresets(file->bytes, presets);
    } else if (tuned->variant == report::Variant{} && tuned->file.empty()) out = file->bytes;
    else if (tuned->file.empty()) out = reducedFile(*file, *tuned, preset, seen);
    if (!out) return out.error();
    // The file has the last word: packing rounds once more, and readers draw maps anew from the splats that are left.
    if (args.preset.empty() && tuned->file.empty()) {
        says("loading what was made");
        const auto psnr = meter->psnrMaskedOfFile(*out);
        if (!psnr) return stop ? stoppedBySignal("nothing was written") : psnr.error();
        tuned->psnrMasked = *psnr;
        if (args.profile.empty() && tuned->time.ms > 0) {
            const auto time = meter->timeOfFile(*out, tuned->variant.resolutionScale, 12, 4);
            if (!time) return stop ? stoppedBySignal("nothing was written") : time.error();
            tuned->time = *time;
        }
    }
    progress.clear();
    if (stop) return stoppedBySignal("nothing was written");
    if (args.minPsnr > 0 && tuned->psnrMasked < args.minPsnr) warn(format("the file has %.2f dB, less than --min-psnr: rounding, and maps that readers draw anew, cost more than was foreseen; ask for that much more", tuned->psnrMasked));
    constexpr double kAlien = 15, kNoisy = 1.5;
    if (tuned->fullPsnrMasked < kAlien) warn(format("the asset and the dataset hardly agree (%.2f dB): is it the one it was baked from?", tuned->fullPsnrMasked));
    if (tuned->time.high > kNoisy * tuned->time.low && tuned->time.low > 0) warn("frame times are unsure: other work on this machine came between");
    if (Status s = writeFileAtomically(args.output, *out); !s) return s;
    print(args, *tuned, file->bytes.size(), out->size());
    if (args.json.empty()) return ok();
    const auto measured = [](double x) { return x > 0 ? Json(x) : Json(nullptr); };
    return writeJson({{"settings", tuned->settings}, {"splats", tuned->variant.detail.splats}, {"resolution_scale", tuned->variant.resolutionScale},
                      {"ms", measured(tuned->time.ms)}, {"ms_before", measured(tuned->fullTime.ms)}, {"psnr_masked", tuned->psnrMasked}, {"psnr_masked_before", tuned->fullPsnrMasked},
                      {"bytes", out->size()}, {"bytes_before", file->bytes.size()}},
                     args.json);
}

Action addTune(CLI::App& app)
{
    auto args = std::make_shared<TuneArguments>();
    CLI::App* sub = app.add_subcommand("tune", "Leave out of an asset what a bound on frame time, bytes or error asks for, and no more");
    sub->add_option("ASSET", args->asset, "Asset (.glb)")->required();
    sub->add_option("DATASET", args->dataset, "OLAT dataset it was baked from, with held-out images")->required();
    sub->add_option("-o,--output", args->output, "Asset to write (.glb)")->required();
    sub->add_option("--max-ms", args->maxMs, "Most time of a frame of the dataset's size under one of its lights, everything evaluated [ms]")->check(positiveNumber());
    sub->add_option("--max-bytes", args->maxBytes, "Most bytes of the file")->check(wholeNumber(1, 1LL << 40));
    sub->add_option("--min-psnr", args->minPsnr, "Least PSNR over the object, of held-out images [dB]: the smallest file that has it")->check(numberBetween(1, 100));
    sub->add_flag("--fastest", args->fastest, "With --min-psnr: the fastest instead of the smallest");
    sub->add_flag("--allow-scale", args->scales, "Drawing at fewer pixels, and enlarging, is a choice, too; the host has to do it");
    sub->add_option("--as-preset", args->preset, "Keep everything, and add the choice to the file as a preset of this name (NacreDetail.preset)");
    sub->add_option("--device-profile", args->profile, "Times are of the machine that this file is of (nacre report --profile-only)");
    sub->add_option("--minutes", args->minutes, "About as long as measuring the front may take [minutes]")->check(numberBetween(0.5, 600))->capture_default_str();
    sub->add_option("--json", args->json, "Write the choice to this file");
    args->threads.addTo(*sub);
    return [args] { return runTune(*args); };
}

} // namespace nacre::cli
