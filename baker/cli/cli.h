// What the subcommands share. A subcommand is one file with one function that declares its options and returns the work; main.cpp
// prints the error, if any, and turns it into the exit code. Contract: 0 success, 1 the work failed, 2 bad arguments or bad input.
#pragma once

#include "base/image.h"
#include "base/light.h"
#include "base/result.h"
#include "base/text.h"
#include "dataset/olat_dataset.h"
#include "eval/splat_renderer.h"
#include "splats/splat_asset.h"
#include "train/image_screen.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace nacre::cli {

using Json = nlohmann::ordered_json;

/// Runs after parsing, once, with the options the function that made it has bound.
using Action = std::function<Status()>;

Action addBake(CLI::App& app);
Action addConvert(CLI::App& app);
Action addEval(CLI::App& app);
Action addRender(CLI::App& app);
Action addInfo(CLI::App& app);
Action addPack(CLI::App& app);
Action addPrepare(CLI::App& app);
Action addReport(CLI::App& app);
Action addSelftest(CLI::App& app);
Action addSynth(CLI::App& app);
Action addTune(CLI::App& app);

/// Ctrl-C and SIGTERM from now on only set the returned flag; poll it between pieces of work.
const std::atomic<bool>& catchStopSignals();
Error stoppedBySignal(const std::string& whatIsLeft);

/// "nacre: warning: ..." on stderr, on one line.
void warn(const std::string& message);

/// One line on stderr about long work: rewritten in place on a terminal, a new line every 30 s otherwise.
class Progress {
public:
    Progress();
    ~Progress() { clear(); }
    void show(const std::string& text);
    void clear(); // so that other output starts on a clean line
private:
    bool terminal_ = false, shown_ = false;
    std::chrono::steady_clock::time_point last_;
};

/// --threads: at most so many while the result lives; 0: all cores.
std::unique_ptr<tbb::global_control> limitThreads(int threads);

/// "1:05" or "2:03:20"; "?" when negative.
std::string clockText(double seconds);
/// printf into a string.
std::string format(const char* pattern, ...) __attribute__((format(printf, 1, 2)));

/// Says before hours of work, not after, that `path` cannot be written. Empty paths pass.
Status checkWritable(const std::string& path);
/// The same of all that a command writes, and that none is written twice or is one of its inputs. Empty paths pass.
Status checkOutputs(std::initializer_list<std::string> outputs, std::initializer_list<std::string> inputs);
/// Kind of a file by its name, e.g. ".glb".
Status checkExtension(const std::string& path, const char* extension);
/// Creates `folder` and its parents.
Status makeFolder(const std::string& folder);
Status writeJson(const Json& json, const std::string& path);
size_t fileBytes(const std::string& path);
/// What --memory and --disk say.
uint64_t bytesOfGigabytes(double gigabytes);

/// [{"path", "why"}, ...]
Json skippedJson(const std::vector<UnusableImage>& skipped);

/// loadDataset, with its warnings shown.
Result<OlatDataset> openDataset(const std::string& path);
Result<const OlatSplit*> findSplit(const OlatDataset& dataset, const std::string& name);

/// An asset file as bytes and as what they mean. Errors name the file.
struct AssetFile {
    std::vector<std::byte> bytes;
    SplatAsset asset;
};
/// `withMaps`: visibility that follows from the splats is drawn, which takes seconds.
Result<AssetFile> openAsset(const std::string& path, bool withMaps = true);

/// --threads N, of commands whose result does not depend on it.
struct ThreadsOption {
    int count = 0;
    void addTo(CLI::App& app);
};

/// --renderer gl|reference, and --preset.
struct RendererOption {
    std::string name = "gl", preset;
    void addTo(CLI::App& app);
    Result<std::unique_ptr<SplatRenderer>> make(const AssetFile& file) const;
};

// CLI11 checks. Its own range checks let NaN pass.
CLI::Validator positiveNumber();
CLI::Validator numberBetween(double lowest, double highest);
CLI::Validator wholeNumber(long long lowest, long long highest);

} // namespace nacre::cli
