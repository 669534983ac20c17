// nacre report: error against run time, bytes and bake time of an asset on its dataset, as a page, JSON and tables.
#include "cli.h"

#include "base/file.h"
#include "pack/importance.h"
#include "report/device_profile.h"
#include "report/measure.h"
#include "report/report_files.h"
#include "report/report_page.h"

#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>

namespace nacre::cli {

struct ReportArguments {
    std::string asset, dataset, output, json, csv, bake;
    double minutes = 4;
    bool noSelftest = false, profileOnly = false;
    ThreadsOption threads;
};

/// What a bake wrote with --json: its history, and what it tried and left out.
static Status addBake(const std::string& path, report::ReportData& data)
{
    std::ifstream in(path);
    if (!in) return Error{ErrorCode::kBadInput, "--bake '" + path + "' cannot be read: no such file?"};
    const Json bake = Json::parse(in, nullptr, false);
    const Error bad{ErrorCode::kBadInput, "--bake '" + path + "' is not what 'nacre bake --json' writes"};
    if (bake.is_discarded() || !bake.is_object()) return bad;
    try {
        for (const Json& h : bake.value("history", Json::array()))
            data.history.push_back({h.at("seconds").get<double>(), h.at("psnr_masked").get<double>(), h.at("splats").get<size_t>(), true});
        for (const Json& p : bake.value("parts", Json::array())) {
            if (p.at("kept").get<bool>()) continue;
            const auto worth = p.at("worth_db").get<double>();
            data.ledger.push_back({p.at("part").get<std::string>(), true, NAN, NAN, worth, "left out by the bake, which tried it on this object"});
        }
    } catch (const Json::exception&) {
        return bad;
    }
    if (data.history.empty()) data.notes.push_back("the bake kept no history (it does with --track)");
    return ok();
}

static std::string today()
{
    const std::time_t now = std::time(nullptr);
    char text[32];
    std::strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", std::gmtime(&now));
    return text;
}

/// This machine's slopes, for nacre tune on another one.
static Status writeProfile(const ReportArguments& args)
{
    if (!args.asset.empty() || !args.json.empty() || !args.csv.empty() || !args.bake.empty())
        return Error{ErrorCode::kBadInput, "--profile-only measures the machine: no asset, no dataset, -o PROFILE.json and nothing else"};
    const std::atomic<bool>& stop = catchStopSignals();
    if (Status s = checkExtension(args.output, ".json"); !s) return s;
    if (Status s = checkWritable(args.output); !s) return s;
    Progress progress;
    const auto profile = report::measureDevice([&](const std::string& text) {
        progress.show("report: " + text);
        return !stop;
    });
    progress.clear();
    if (!profile) return stop ? stoppedBySignal("no profile was written") : profile.error();
    const std::string text = report::profileJson(*profile);
    if (Status s = writeFileAtomically(args.output, std::as_bytes(std::span(text))); !s) return s;
    std::printf("%s", text.c_str());
    return ok();
}

static Status runReport(const ReportArguments& args)
{
    if (args.profileOnly) return writeProfile(args);
    if (args.asset.empty() || args.dataset.empty()) return Error{ErrorCode::kBadInput, "give ASSET and DATASET, or --profile-only"};
    const auto start = std::chrono::steady_clock::now();
    const std::atomic<bool>& stop = catchStopSignals();
    const auto threads = limitThreads(args.threads.count);
    if (Status s = checkExtension(args.output, ".html"); !s) return s;
    if (Status s = checkOutputs({args.output, args.json}, {args.asset, args.dataset, args.bake}); !s) return s;
    if (!args.csv.empty())
        if (Status s = makeFolder(args.csv); !s) return s;
    report::ReportData bake;
    if (!args.bake.empty())
        if (Status s = addBake(args.bake, bake); !s) return s;
    auto file = openAsset(args.asset);
    if (!file) return file.error();
    const auto dataset = openDataset(args.dataset);
    if (!dataset) return dataset.error();
    if (const auto split = report::heldOutSplit(*dataset); !split) return split.error();

    Progress progress;
    report::MeasureOptions options;
    options.seconds = 60 * args.minutes, options.selftest = !args.noSelftest;
    options.stopped = [&] { return stop.load(); };
    options.says = [&](const std::string& text) {
        progress.show("report: " + text);
        return !stop;
    };
    std::string unordered;
    if (!file->asset.find("importance")) {
        options.says("ordering splats by importance");
        const Status s = ensureImportance(file->asset, dataset->find("train"));
        unordered = s ? "the file has no order of importance; the one of nacre pack was used" : "splats could not be ordered by importance: " + s.error().message;
    }
    auto data = report::measureReport(file->asset, file->bytes, *dataset, options);
    progress.clear();
    if (!data) return stop ? stoppedBySignal("no report was written") : data.error();
    if (!unordered.empty()) data->notes.insert(data->notes.begin(), unordered);
    data->history = std::move(bake.history);
    data->ledger.insert(data->ledger.end(), bake.ledger.begin(), bake.ledger.end());
    data->notes.insert(data->notes.end(), bake.notes.begin(), bake.notes.end());
    data->asset = args.asset, data->dataset = args.dataset, data->version = std::string("nacre ") + NACRE_VERSION_STRING, data->date = today();
    data->command = "nacre report " + args.asset + " " + args.dataset + " -o " + args.output;
    data->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

    if (Status s = report::writeReportPage(*data, args.output); !s) return s;
    if (!args.json.empty())
        if (Status s = writeJson(report::reportJson(*data), args.json); !s) return s;
    if (!args.csv.empty())
        if (Status s = report::writeReportTables(*data, args.csv); !s) return s;
    const auto onFront = [](const std::vector<report::FrontPoint>& points) {
        return size_t(std::count_if(points.begin(), points.end(), [](const report::FrontPoint& p) { return !p.dominated; }));
    };
    for (const report::SplitFigures& f : data->splits) std::printf("%-12s %3zu images  %.2f dB, %.2f dB over the object\n", f.split.c_str(), f.images, f.psnr, f.psnrMasked);
    std::printf("%.2f ms a frame, %zu bytes; %zu points on the front of time, %zu on that of bytes%s\n", data->fullFrame.ms, file->bytes.size(), onFront(data->frontTime), onFront(data->frontBytes),
                data->stabilityNote.empty() ? "" : ("; self-test: " + data->stabilityNote).c_str());
    std::printf("%s: made in %.0f s\n", args.output.c_str(), data->seconds);
    return ok();
}

Action addReport(CLI::App& app)
{
    auto args = std::make_shared<ReportArguments>();
    CLI::App* sub = app.add_subcommand("report", "Measure error against run time and bytes, and what each part of an asset is worth");
    sub->add_option("ASSET", args->asset, "Asset (.glb)");
    sub->add_option("DATASET", args->dataset, "OLAT dataset it was baked from, with held-out images: its folder or a transforms file");
    sub->add_option("-o,--output", args->output, "Page to write (.html): one file that opens without a network")->required();
    sub->add_option("--json", args->json, "Write the figures to this file");
    sub->add_option("--csv", args->csv, "Write the figures as tables into this folder");
    sub->add_option("--bake", args->bake, "What nacre bake --json wrote of this asset: adds error against bake time, and what the bake tried and left out");
    sub->add_option("--minutes", args->minutes, "About as long as it may take; more makes frame times surer [minutes]")->check(numberBetween(1.5, 600))->capture_default_str();
    sub->add_flag("--profile-only", args->profileOnly, "Measure this machine instead, for nacre tune --device-profile: -o is a .json, there is no ASSET and no DATASET");
    sub->add_flag("--no-selftest", args->noSelftest, "Leave out the stability suite (nacre selftest)");
    args->threads.addTo(*sub);
    return [args] { return runReport(*args); };
}

} // namespace nacre::cli
