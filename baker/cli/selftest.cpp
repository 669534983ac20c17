// nacre selftest: is the arithmetic of this machine, in every back end it has, what it should be?
#include "cli.h"

#include "base/file.h"
#include "selftest/print.h"

#include <cstdio>
#include <sys/utsname.h>

namespace nacre::cli {

struct SelftestArguments {
    std::string json, markdown;
    selftest::Options options;
    bool noGl = false;
    ThreadsOption threads;
};

static std::string machineText()
{
    std::string cpu = "an unknown CPU";
    if (const auto file = readFile("/proc/cpuinfo")) {
        const std::string text(reinterpret_cast<const char*>(file->data()), file->size());
        if (const size_t at = text.find("model name"); at != std::string::npos) cpu = oneLine(text.substr(text.find(':', at) + 2, text.find('\n', at) - text.find(':', at) - 2));
    }
    utsname name{};
    return uname(&name) == 0 ? cpu + ", " + name.sysname + " " + name.machine : cpu;
}

static Status write(const std::string& path, const std::string& text)
{
    return path.empty() ? ok() : writeFileAtomically(path, std::as_bytes(std::span(text)));
}

static Status runSelftest(SelftestArguments& args)
{
    const std::atomic<bool>& stop = catchStopSignals();
    const auto threads = limitThreads(args.threads.count);
    if (Status s = checkOutputs({args.json, args.markdown}, {}); !s) return s;
    Progress progress;
    args.options.gl = !args.noGl;
    args.options.progress = [&](const std::string& next) {
        progress.show("selftest: " + next);
        return !stop;
    };
    const auto report = selftest::run(args.options);
    progress.clear();
    if (!report) return stop ? Status(stoppedBySignal("nothing was written")) : report.error();
    if (report->rows.empty() && !args.options.only.empty()) return Error{ErrorCode::kBadInput, "no case has " + inQuotes(args.options.only) + " in its name"};

    std::string command = "nacre selftest";
    if (!args.options.only.empty()) command += " --only " + inQuotes(args.options.only);
    command += format(" --random %zu --random-gl %zu --seed %llu", args.options.randomScenes, args.options.glEvery, static_cast<unsigned long long>(args.options.seed));
    std::fputs(selftest::asText(*report).c_str(), stdout);
    if (Status s = write(args.json, selftest::asJson(*report, command, machineText())); !s) return s;
    if (Status s = write(args.markdown, selftest::asMarkdown(*report, command, machineText())); !s) return s;
    const size_t failures = report->failures();
    return failures == 0 ? ok() : Error{ErrorCode::kIo, format("%zu rows of the table are beyond their bounds; they are named above", failures)};
}

Action addSelftest(CLI::App& app)
{
    auto args = std::make_shared<SelftestArguments>();
    CLI::App* sub = app.add_subcommand("selftest", "Check the arithmetic of this machine's CPU and GPU where it is hardest");
    sub->add_option("--only", args->options.only, "Cases whose names hold this text");
    sub->add_option("--random", args->options.randomScenes, "Random extreme scenes beside the cases")->check(wholeNumber(0, 100000000))->capture_default_str();
    sub->add_option("--random-gl", args->options.glEvery, "Of these, OpenGL draws one in so many")->check(wholeNumber(1, 100000000))->capture_default_str();
    sub->add_option("--seed", args->options.seed, "Of the random scenes")->capture_default_str();
    sub->add_flag("--no-gl", args->noGl, "Leave out the columns that need an OpenGL context");
    args->threads.addTo(*sub);
    sub->add_option("--json", args->json, "Write the table to this file");
    sub->add_option("--markdown", args->markdown, "Write it for people to this file");
    return [args] { return runSelftest(*args); };
}

} // namespace nacre::cli
