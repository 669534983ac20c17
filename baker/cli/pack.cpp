// nacre pack: an asset made small.
#include "cli.h"

#include "asset/asset_io.h"
#include "base/file.h"
#include "pack/importance.h"
#include "pack/neutral_look.h"
#include "pack/pack.h"
#include "pack/pack_curve.h"

#include <cstdio>
#include <filesystem>

namespace nacre::cli {

struct PackArguments {
    std::string in, out, profile = "compact", visibility = "drawn32", against, json, curve;
    double maxLoss = 0.3, bytesPerSplat = 0;
    bool givenLoss = false, givenVisibility = false;
    ThreadsOption threads;
};

static std::string sizeText(const PackArguments& args, const AssetFile& in, size_t splats, size_t bytes)
{
    return format("%s: %zu splats, %zu bytes (%.1f per splat; before %zu, %.1f)", args.out.c_str(), splats, bytes, double(bytes) / double(splats), in.bytes.size(),
                  double(in.bytes.size()) / double(in.asset.cloud.count));
}

static void print(const PackArguments& args, const AssetFile& in, const PackResult& packed)
{
    std::printf("%s, %.1f dB from the input\n", sizeText(args, in, packed.splats, packed.file.size()).c_str(), packed.psnr);
    std::printf("an asset 30 dB from the truth loses %.3f dB\n", packed.lossDecibel);
    if (packed.pruned > 0) std::printf("%zu splats are never seen and were left out\n", packed.pruned);
    for (const std::string& name : packed.leftOut) std::printf("%s does not earn its bytes and was left out\n", name.c_str());
    std::printf("%-24s %10s  %8s  %s\n", "part", "bytes", "per splat", "loss without it [dB]");
    for (const PackedPart& p : packed.parts)
        std::printf("%-24s %10zu  %8.2f  %s\n", p.name.c_str(), p.bytes, double(p.bytes) / double(packed.splats), p.lossWithout < 0 ? "-" : format("%.3f", p.lossWithout).c_str());
}

static Json figures(const PackArguments& args, const PackResult& packed)
{
    Json channels = Json::array(), curve = Json::array();
    for (const PackedPart& p : packed.parts) channels.push_back({{"name", p.name}, {"bytes", p.bytes}, {"loss_db", p.lossWithout < 0 ? Json(nullptr) : Json(p.lossWithout)}});
    for (const PackPoint& p : packed.curve) curve.push_back({{"bytes_per_splat", p.bytesPerSplat}, {"loss_db", p.lossDecibel}});
    return {{"profile", args.profile},       {"splats", packed.splats},   {"asset_bytes", packed.file.size()}, {"bytes_per_splat", double(packed.file.size()) / double(packed.splats)},
            {"loss_db", packed.lossDecibel}, {"psnr_to_input", packed.psnr}, {"pruned", packed.pruned},        {"left_out", packed.leftOut},
            {"channels", channels},          {"curve", curve}};
}

/// Codes stay codes. An asset without a look for other viewers gets one, under lights from everywhere.
static Result<std::vector<std::byte>> interopOf(const AssetFile& in)
{
    Result<SplatAsset> asset = decodeAsset(in.bytes);
    if (!asset) return asset.error();
    for (const char* name : {"importance", "growth"})
        if (const Channel* c = in.asset.find(name); c && !asset->find(name)) asset->channels.push_back(*c);
    if (asset->neutral.shFunctions == 0) {
        auto look = fitNeutralLook(in.asset, neutralLights(in.asset));
        if (!look) return look.error();
        asset->neutral = std::move(*look);
    }
    return encodeInterop(*asset);
}

/// Profiles that round nothing.
static Status writeUnpacked(const PackArguments& args, AssetFile in, const OlatSplit* seen)
{
    if (const Status s = ensureImportance(in.asset, seen); !s) warn("splats could not be ordered by importance (" + s.error().message + "): all or none can be drawn");
    const auto file = args.profile == "interop" ? interopOf(in) : encodeAsset(in.asset);
    if (!file) return file.error();
    if (Status s = writeFileAtomically(args.out, *file); !s) return s;
    const size_t splats = in.asset.cloud.count;
    std::printf("%s\n", sizeText(args, in, splats, file->size()).c_str());
    if (args.json.empty()) return ok();
    return writeJson({{"profile", args.profile}, {"splats", splats}, {"asset_bytes", file->size()}, {"bytes_per_splat", double(file->size()) / double(splats)}}, args.json);
}

/// Two files of one name would leave only the last; the input may be the output, which replaces it whole.
static Status checkPaths(const PackArguments& args)
{
    const auto real = [](const std::string& path) {
        std::error_code ignored;
        return std::filesystem::weakly_canonical(path, ignored);
    };
    const std::string picture = args.curve.empty() ? "" : std::filesystem::path(args.curve).replace_extension(".svg").string();
    std::vector<std::string> written;
    for (const std::string& path : {args.out, args.json, args.curve, picture}) {
        if (path.empty()) continue;
        for (const std::string& other : written)
            if (real(path) == real(other)) return Error{ErrorCode::kBadInput, "'" + path + "' would be written twice: give the asset, --json, and --curve with its .svg names of their own"};
        if (path != args.out && real(path) == real(args.in)) return Error{ErrorCode::kBadInput, "'" + path + "' is the input; give the figures another name"};
        if (Status s = checkWritable(path); !s) return s;
        written.push_back(path);
    }
    return ok();
}

static Status runPack(const PackArguments& args)
{
    const auto threads = limitThreads(args.threads.count);
    if (Status s = checkPaths(args); !s) return s;
    const bool chooses = args.bytesPerSplat > 0 || !args.curve.empty() || !args.against.empty() || args.givenLoss || args.givenVisibility;
    if (args.profile != "compact" && chooses)
        return Error{ErrorCode::kBadInput, "--profile " + args.profile + " rounds nothing: leave out --max-loss-db, --bytes-per-splat, --visibility, --against and --curve"};
    auto file = openAsset(args.in);
    if (!file) return file.error();
    if (file->asset.profile == "compact") warn("'" + args.in + "' is packed already: what that lost is not counted");
    OlatDataset dataset;
    const OlatSplit* seen = nullptr;
    if (!args.against.empty()) {
        Result<OlatDataset> opened = openDataset(args.against);
        if (!opened) return opened.error();
        dataset = std::move(*opened);
        const auto train = findSplit(dataset, "train");
        if (!train) return train.error();
        seen = *train;
    }
    if (args.profile != "compact") return writeUnpacked(args, std::move(*file), seen);

    PackOptions options;
    options.maxLossDecibel = args.maxLoss, options.bytesPerSplat = args.bytesPerSplat, options.curve = !args.curve.empty();
    options.drawnVisibility = args.visibility == "stored" ? 0 : args.visibility == "drawn16" ? 16 : 32;
    options.seen = seen;
    Progress progress;
    options.progress = [&](const std::string& text) { progress.show(text); };
    const Result<PackResult> packed = packCompact(file->asset, options);
    progress.clear();
    if (!packed) return packed.error();
    for (const std::string& line : packed->warnings) warn(line);
    if (Status s = writeFileAtomically(args.out, packed->file); !s) return s;
    print(args, *file, *packed);
    if (!args.curve.empty())
        if (Status s = writeCurve(packed->curve, args.curve); !s) return s;
    return args.json.empty() ? ok() : writeJson(figures(args, *packed), args.json);
}

Action addPack(CLI::App& app)
{
    auto args = std::make_shared<PackArguments>();
    CLI::App* sub = app.add_subcommand("pack", "Make an asset small: few bits where they do not show");
    sub->add_option("IN", args->in, "Asset (.glb)")->required();
    sub->add_option("-o,--output", args->out, "Asset to write (.glb)")->required();
    sub->add_option("--profile", args->profile, "compact: quantised and entropy-coded; lossless: float32; interop: float32 for any viewer of KHR_gaussian_splatting")
        ->check(CLI::IsMember({"compact", "lossless", "interop"}))->capture_default_str();
    auto* loss = sub->add_option("--max-loss-db", args->maxLoss, "Loss of PSNR that is allowed, for an asset 30 dB from the truth [dB]")->check(numberBetween(0.001, 20))->capture_default_str();
    sub->add_option("--bytes-per-splat", args->bytesPerSplat, "Size of the file to aim at instead [bytes per splat]")->check(numberBetween(4, 5000))->excludes(loss);
    auto* visibility = sub->add_option("--visibility", args->visibility, "drawn32, drawn16: none in the file, readers draw maps of so many texels a side from the splats; stored: codes, more bytes but quick to load")
        ->check(CLI::IsMember({"drawn32", "drawn16", "stored"}))->capture_default_str();
    sub->add_option("--against", args->against, "Dataset the asset was baked from: bits and the order of importance go by what its train cameras and lights show (default: views all around)");
    sub->add_option("--curve", args->curve, "Write bytes per splat and loss at other sizes, too: FILE.csv, and FILE.svg beside it");
    sub->add_option("--json", args->json, "Write the figures to this file");
    args->threads.addTo(*sub);
    return [args, loss, visibility] {
        args->givenLoss = loss->count() > 0, args->givenVisibility = visibility->count() > 0;
        return runPack(*args);
    };
}

} // namespace nacre::cli
