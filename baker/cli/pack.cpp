// nacre pack: an asset made small.
#include "cli.h"

#include "asset/asset_io.h"
#include "base/file.h"
#include "pack/pack.h"

#include <cstdio>

namespace nacre::cli {

struct PackArguments {
    std::string in, out, profile = "compact", against, json;
    std::string visibility = "drawn32";
    double maxLoss = 0.3, bytesPerSplat = 0;
    ThreadsOption threads;
};

static Status runPack(const PackArguments& args)
{
    const auto threads = limitThreads(args.threads.count);
    for (const std::string& path : {args.out, args.json})
        if (Status s = checkWritable(path); !s) return s;
    const auto file = openAsset(args.in);
    if (!file) return file.error();
    if (args.profile == "lossless") return writeAsset(file->asset, args.out);

    PackOptions options;
    options.maxLossDecibel = args.maxLoss, options.bytesPerSplat = args.bytesPerSplat;
    options.drawnVisibility = args.visibility == "stored" ? 0 : args.visibility == "drawn16" ? 16 : 32;
    OlatDataset dataset;
    if (!args.against.empty()) {
        Result<OlatDataset> opened = openDataset(args.against);
        if (!opened) return opened.error();
        dataset = std::move(*opened), options.against = &dataset;
    }
    Progress progress;
    options.progress = [&](const std::string& text) { progress.show(text); };
    const Result<PackResult> packed = packCompact(file->asset, options);
    progress.clear();
    if (!packed) return packed.error();
    for (const std::string& line : packed->warnings) warn(line);
    if (Status s = writeFileAtomically(args.out, packed->file); !s) return s;

    const double perSplat = double(packed->file.size()) / double(packed->splats);
    std::printf("%s: %zu splats (%zu never seen left out), %zu bytes (%.1f per splat, before %.1f), %.1f dB from the input; an asset 30 dB from the truth loses %.3f dB\n",
                args.out.c_str(), packed->splats, packed->pruned, packed->file.size(), perSplat, double(file->bytes.size()) / double(file->asset.cloud.count), packed->psnr,
                packed->lossDecibel);
    for (const PackedChannel& c : packed->channels)
        std::printf("%-20s %9zu bytes, %5.1f bits per splat, rounding costs %.3f dB\n", c.name.c_str(), c.bytes, 8 * double(c.bytes) / double(packed->splats), c.lossDecibel);
    for (const PackPoint& p : packed->curve) std::printf("  %7.1f bytes per splat: %.3f dB\n", p.bytesPerSplat, p.lossDecibel);
    return ok();
}

Action addPack(CLI::App& app)
{
    auto args = std::make_shared<PackArguments>();
    CLI::App* sub = app.add_subcommand("pack", "Make an asset small: few bits where they do not show");
    sub->add_option("IN", args->in, "Asset (.glb)")->required();
    sub->add_option("-o,--output", args->out, "Asset to write (.glb)")->required();
    sub->add_option("--profile", args->profile, "compact: quantised and entropy-coded; lossless: float32")->check(CLI::IsMember({"compact", "lossless"}))->capture_default_str();
    auto* loss = sub->add_option("--max-loss-db", args->maxLoss, "Loss of PSNR that is allowed, for an asset 30 dB from the truth [dB]")->check(numberBetween(0.001, 20))->capture_default_str();
    sub->add_option("--bytes-per-splat", args->bytesPerSplat, "Size of the file to aim at instead [bytes per splat]")->check(numberBetween(4, 5000))->excludes(loss);
    sub->add_option("--visibility", args->visibility, "drawn32, drawn16: none in the file, readers draw maps of so many texels a side from the splats; stored: codes")
        ->check(CLI::IsMember({"drawn32", "drawn16", "stored"}))->capture_default_str();
    sub->add_option("--against", args->against, "Dataset the asset was baked from: bits go where its train cameras and lights show them (default: views all around)");
    sub->add_option("--json", args->json, "Write the figures to this file");
    args->threads.addTo(*sub);
    return [args] { return runPack(*args); };
}

} // namespace nacre::cli
