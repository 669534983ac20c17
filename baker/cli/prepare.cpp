// nacre prepare: a dataset read once, checked, and packed for bakes.
#include "cli.h"

#include "peak_memory.h"
#include "train/dataset_packer.h"

#include <cstdio>
#include <filesystem>

namespace nacre::cli {

struct PrepareArguments {
    std::string dataset, format = "auto", json;
    double disk = 0;
    PackerOptions options;
    ThreadsOption threads;
};

static Status runPrepare(PrepareArguments args)
{
    const auto threads = limitThreads(args.threads.count);
    if (Status s = checkWritable(args.json); !s) return s;
    std::filesystem::path output = std::filesystem::path(args.options.output).lexically_normal();
    if (output.filename().empty()) output = output.parent_path(); // "folder/"
    args.options.output = output.string();
    if (std::filesystem::path(args.dataset).lexically_normal() == output) return Error{ErrorCode::kBadInput, "'" + args.options.output + "' is the dataset; give the packed one another name"};
    if (Status s = checkPackedOutput(args.options.output); !s) return s;
    args.options.pixels = args.format == "bytes" ? PackerOptions::Pixels::kBytes : args.format == "halves" ? PackerOptions::Pixels::kHalves : PackerOptions::Pixels::kAuto;
    args.options.diskBytes = bytesOfGigabytes(args.disk);

    const std::atomic<bool>& stop = catchStopSignals();
    Progress progress;
    const auto dataset = openDataset(args.dataset);
    if (!dataset) return dataset.error();
    if (dataset->packed) return Error{ErrorCode::kBadInput, "'" + args.dataset + "' is prepared already; use it as it is, or prepare the dataset that it was made of"};
    const auto show = [&](size_t done, size_t all, double left) {
        progress.show(format("preparing %zu/%zu images", done, all) + (left >= 0 ? ", " + clockText(left) + " left" : std::string()));
    };
    const auto report = packDataset(*dataset, args.options, show, &stop);
    progress.clear();
    if (!report) return report.error();
    for (const std::string& line : report->notes) warn(line);
    constexpr size_t kNamed = 10;
    for (size_t i = 0; i < std::min(report->skipped.size(), kNamed); ++i) warn("skipped: " + report->skipped[i].why);
    if (!report->skipped.empty())
        warn(format("%zu of %zu images skipped, listed in ", report->skipped.size(), report->skipped.size() + report->images) + (output / "skipped.txt").string());
    const size_t fresh = report->images + report->skipped.size() - report->reused;
    std::printf("%s: %zu images, %zu of them as halves, %.1f MB; %zu read in %.1f s%s\n", args.options.output.c_str(), report->images, report->halves, double(report->bytes) / 1e6, fresh,
                report->decodeSeconds, report->reused ? format(", %zu were there from an interrupted run", report->reused).c_str() : "");
    if (args.json.empty()) return ok();
    Json skipped = Json::array();
    for (const SkippedImage& s : report->skipped) skipped.push_back({{"split", s.split}, {"path", s.path}, {"why", s.why}});
    return writeJson({{"images", report->images}, {"halves", report->halves}, {"reused", report->reused}, {"bytes", report->bytes}, {"seconds", report->decodeSeconds},
                      {"peak_rss_bytes", peakMemoryBytes()}, {"skipped", skipped}}, args.json);
}

Action addPrepare(CLI::App& app)
{
    auto args = std::make_shared<PrepareArguments>();
    CLI::App* sub = app.add_subcommand("prepare", "Read a dataset once, leave out what cannot be used, and pack the rest for bakes");
    sub->add_option("DATASET", args->dataset, "OLAT dataset: its folder or a transforms file")->required();
    sub->add_option("-o,--output", args->options.output, "Folder to make: a dataset for every command")->required();
    sub->add_option("--format", args->format, "Pixels as sRGB bytes (4 a pixel) or linear halves (8); auto: bytes for 8-bit files, halves for others while the disk suffices")
        ->check(CLI::IsMember({"auto", "bytes", "halves"}))->capture_default_str();
    sub->add_option("--disk", args->disk, "At most so much disk [GB] (default: what is free)")->check(positiveNumber());
    sub->add_flag("--strict", args->options.strict, "An image that cannot be used is an error");
    sub->add_option("--json", args->json, "Write the figures, and what was skipped and why, to this file");
    args->threads.addTo(*sub);
    sub->footer("An interrupted run leaves OUTPUT.part; the same command goes on with it.");
    return [args] { return runPrepare(*args); };
}

} // namespace nacre::cli
