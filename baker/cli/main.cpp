// The `nacre` command line: finds the subcommand, prints its error, gives the exit code.
#include "cli.h"

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>

namespace nacre::cli {

// A new subcommand is one file and one line here.
static constexpr Action (*kSubcommands[])(CLI::App&) = {addSynth, addPrepare, addBake, addEval, addRender, addConvert, addInfo, addPack, addReport, addTune, addSelftest};

static int fail(const std::string& message, int code)
{
    std::fprintf(stderr, "nacre: error: %s\n", oneLine(message).c_str());
    return code;
}

static int exitCode(ErrorCode code) { return code == ErrorCode::kBadInput || code == ErrorCode::kUnsupported ? 2 : 1; }

static int run(int argc, char** argv)
{
    CLI::App app{"Nacre: relightable Gaussian splats from one-light-at-a-time (OLAT) images.", "nacre"};
    app.set_version_flag("--version", "nacre " NACRE_VERSION_STRING);
    app.footer("Exit code: 0 success, 1 the work failed, 2 bad arguments or bad input. Errors are one line on stderr.\n"
               "`nacre COMMAND --help` lists the options of a command.");
    std::vector<Action> actions;
    for (auto add : kSubcommands) actions.push_back(add(app));
    const std::vector<CLI::App*> subcommands = app.get_subcommands([](CLI::App*) { return true; });
    const CLI::Validator hasText([](std::string& text) { return std::string(text.empty() ? "a value is missing, found ''" : ""); }, ""); // $NAME that is not set
    for (CLI::App* sub : subcommands)
        for (CLI::Option* option : sub->get_options([](const CLI::Option* o) { return o->get_items_expected_max() > 0; })) option->check(hasText);

    std::string names;
    bool known = false;
    for (const CLI::App* sub : subcommands) {
        names += (names.empty() ? "" : ", ") + sub->get_name();
        known = known || (argc > 1 && sub->get_name() == argv[1]);
    }
    if (argc < 2) return fail("no command given; there are: " + names + " (try: nacre --help)", 2);
    if (argv[1][0] != '-' && !known)
        return fail("unknown command '" + std::string(argv[1]) + "'; there are: " + names + " (try: nacre --help)", 2);
    app.require_subcommand(1);

    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error); // --help and --version
        const std::string command = argv[1][0] == '-' ? "" : std::string(" ") + argv[1];
        return fail(oneLine(error.what()) + " (try: nacre" + command + " --help)", 2);
    }
    for (size_t i = 0; i < subcommands.size(); ++i) {
        if (!subcommands[i]->parsed()) continue;
        const Status status = actions[i]();
        if (!status) return fail(status.error().message, exitCode(status.error().code));
    }
    if (std::fflush(stdout) != 0 || std::ferror(stdout)) return fail("standard output could not be written: disk full?", 1);
    return 0;
}

} // namespace nacre::cli

int main(int argc, char** argv)
{
    std::signal(SIGXFSZ, SIG_IGN); // a file size limit is then a failed write with a message, as a full disk is
    try {
        return nacre::cli::run(argc, argv);
    } catch (const std::bad_alloc&) {
        return nacre::cli::fail("out of memory; try fewer splats (--max-splats) or smaller images", 1);
    } catch (const std::exception& error) {
        return nacre::cli::fail(std::string("internal fault: ") + error.what(), 1);
    }
}
