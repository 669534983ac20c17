// nacre eval: how far an asset's renders are from the photographs of a split. Figures as in the evaluation section of the README.
#include "cli.h"

#include "eval/components.h"
#include "eval/contact_sheet.h"
#include "eval/evaluate.h"
#include "interchange/exr.h"
#include "interchange/png.h"

#include <cmath>
#include <cstdio>
#include <filesystem>

namespace nacre::cli {

// The joined sheet is for looking through: more rows make it neither readable nor, in the end, a PNG that can be written.
constexpr size_t kMaxJoinedRows = 64, kMaxJoinedPixels = size_t(1) << 26;

struct EvalArguments {
    std::string asset, dataset, split = "test", json, images;
    RendererOption renderer;
    ThreadsOption threads;
    int frames = 50;
};

/// 0000_render.exr, 0000_reference.exr and 0000_sheet.png.
static Status writeImages(const std::string& folder, const EvalImage& image, const Picture& row)
{
    const std::string stem = (std::filesystem::path(folder) / format("%04zu_", image.index)).string();
    if (Status s = writeExr(image.render, stem + "render.exr"); !s) return s;
    if (Status s = writeExr(image.reference, stem + "reference.exr"); !s) return s;
    return writePng(stem + "sheet.png", row.width, row.height, 3, row.rgb);
}

static void printRow(const char* name, const ImageMetrics& m, const std::string& note)
{
    std::printf("%6s  %6.2f  %6.2f  %7.4f  %7.4f  %8.5f  %s\n", name, m.psnr, m.psnrMasked, m.ssim, m.flip, m.relMseLinear, note.c_str());
}

static Status writeFigures(const EvalArguments& args, const AssetFile& file, const EvalResult& result, std::optional<double> scattered,
                           const std::string& drawnBy)
{
    const auto timed = [&](double ms) { return args.frames > 0 ? Json(ms) : Json(nullptr); };
    return writeJson({{"split", args.split},
                      {"images", result.images.size()},
                      {"psnr", result.mean.psnr},
                      {"psnr_masked", result.mean.psnrMasked},
                      {"psnr_highlight", std::isfinite(result.psnrHighlight) ? Json(result.psnrHighlight) : Json(nullptr)},
                      {"highlight_missing", result.mean.highlightMissing},
                      {"highlight_false", result.mean.highlightFalse},
                      {"ssim", result.mean.ssim},
                      {"flip", result.mean.flip},
                      {"rel_mse_linear", result.mean.relMseLinear},
                      {"ms_per_frame", timed(result.times.frameMs)},
                      {"splats", file.asset.cloud.count},
                      {"asset_bytes", file.bytes.size()},
                      {"bytes_per_splat", double(file.bytes.size()) / double(file.asset.cloud.count)},
                      {"renderer", args.renderer.name},
                      {"psnr_min", result.psnrMin},
                      {"relight_ms", timed(result.times.relightMs)},
                      {"sort_ms", timed(result.times.sortMs)},
                      {"raster_ms", timed(result.times.rasterMs)},
                      {"scattered_share", scattered ? Json(*scattered) : Json(nullptr)},
                      {"drawn_by", drawnBy},
                      {"skipped", skippedJson(result.skipped)}},
                     args.json);
}

static Status writeJoinedSheet(const std::string& folder, const std::vector<Picture>& rows, size_t images)
{
    const Picture all = tile(rows, 2);
    const std::string path = (std::filesystem::path(folder) / "all_sheets.png").string();
    if (Status s = writePng(path, all.width, all.height, 3, all.rgb); !s) return s;
    if (rows.size() < images) std::printf("%s shows the first %zu of %zu images\n", path.c_str(), rows.size(), images);
    return ok();
}

static Status runEval(const EvalArguments& args)
{
    const std::atomic<bool>& stop = catchStopSignals();
    const auto threads = limitThreads(args.threads.count);
    if (Status s = checkWritable(args.json); !s) return s;
    const auto file = openAsset(args.asset);
    if (!file) return file.error();
    const auto dataset = openDataset(args.dataset);
    if (!dataset) return dataset.error();
    const auto split = findSplit(*dataset, args.split);
    if (!split) return split.error();
    const auto renderer = args.renderer.make(*file);
    if (!renderer) return renderer.error();
    if (!args.images.empty())
        if (Status s = makeFolder(args.images); !s) return s;

    ImageCache references(*dataset, size_t(64) << 20); // each image is looked at once
    if (const auto suspicions = checkConventions(*dataset, references)) // else no image can be read, and that is said below
        for (const std::string& line : *suspicions) warn(line);
    std::vector<Picture> rows; // the first few, for the joined sheet
    size_t rowPixels = 0;
    bool full = false;
    Progress progress;
    const auto start = std::chrono::steady_clock::now();
    const auto done = [&](const EvalImage& image) -> Status {
        if (stop) return stoppedBySignal("no figures were written");
        if (!args.images.empty()) {
            Picture row = contactRow(image.reference, image.render);
            if (Status s = writeImages(args.images, image, row); !s) return s;
            rowPixels += size_t(row.width) * size_t(row.height);
            full = full || rows.size() == kMaxJoinedRows || (!rows.empty() && rowPixels > kMaxJoinedPixels);
            if (!full) rows.push_back(std::move(row));
        }
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        const size_t n = image.index + 1;
        progress.show(format("eval %zu/%zu, %s left", n, image.count, clockText(seconds / double(n) * double(image.count - n)).c_str()));
        return ok();
    };
    const auto result = evaluate(**split, references, **renderer, {args.frames}, done);
    progress.clear();
    if (!result) return result.error();
    for (const UnusableImage& image : result->skipped) warn("skipped: " + image.why);
    if (!result->skipped.empty())
        warn(format("%zu of %zu images of split '%s' are skipped: the figures are of the rest", result->skipped.size(), (*split)->images.size(), args.split.c_str()));

    const auto scattered = scatteredShare(**split, *result, **renderer);
    if (!scattered) return scattered.error();

    const size_t splats = file->asset.cloud.count, bytes = file->bytes.size();
    const double perSplat = double(bytes) / double(splats);
    std::printf("%6s  %6s  %6s  %7s  %7s  %8s  %s\n", "image", "psnr", "masked", "ssim", "flip", "rel_mse", "reference");
    for (size_t i = 0; i < result->images.size(); ++i)
        printRow(format("%04zu", result->indices[i]).c_str(), result->images[i], (*split)->images[result->indices[i]].path);
    printRow("mean", result->mean, format("%zu images of split '%s', renderer %s", result->images.size(), args.split.c_str(), args.renderer.name.c_str()));
    std::printf("highlights: %.3f %% of the object missing, %.3f %% invented; %s\n", 100 * result->mean.highlightMissing, 100 * result->mean.highlightFalse,
                std::isfinite(result->psnrHighlight) ? format("%.2f dB where the reference is bright", result->psnrHighlight).c_str()
                                                     : "the reference is bright nowhere");
    std::printf("%zu splats, %zu bytes (%.1f per splat), drawn by %s\n", splats, bytes, perSplat, (*renderer)->description().c_str());
    if (*scattered) std::printf("%.1f %% of the light has travelled beneath the surface (residual), the rest was reflected\n", 100 * **scattered);
    const RenderTimes& t = result->times;
    if (args.frames > 0)
        std::printf("%.2f ms per frame: relight %.2f, sort %.2f, raster %.2f (median of %d)\n", t.frameMs, t.relightMs, t.sortMs,
                    t.rasterMs, args.frames);
    if (!args.json.empty())
        if (Status s = writeFigures(args, *file, *result, *scattered, (*renderer)->description()); !s) return s;
    return rows.empty() ? ok() : writeJoinedSheet(args.images, rows, result->images.size());
}

Action addEval(CLI::App& app)
{
    auto args = std::make_shared<EvalArguments>();
    CLI::App* sub = app.add_subcommand("eval", "Compare an asset with held-out images");
    sub->add_option("ASSET", args->asset, "Asset (.glb)")->required();
    sub->add_option("DATASET", args->dataset, "OLAT dataset: its folder or a transforms file")->required();
    sub->add_option("--split", args->split, "Split of the dataset: test, train, near, directional, environment, all_on")->capture_default_str();
    args->renderer.addTo(*sub);
    args->threads.addTo(*sub);
    sub->add_option("--frames", args->frames, "Frames to time after 10 for warming up; 0: no timing")
        ->check(wholeNumber(0, 100000))->capture_default_str();
    sub->add_option("--json", args->json, "Write the means to this file");
    sub->add_option("--images", args->images, "Write 0000_render.exr, 0000_reference.exr and 0000_sheet.png (reference | render | 4x error)\n"
                                              "per image, and all_sheets.png with the first 64, into this folder");
    return [args] { return runEval(*args); };
}

} // namespace nacre::cli
