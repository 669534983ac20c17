// Signals, progress, files and checks that every subcommand uses.
#include "cli.h"

#include "appearance/coded_channels.h"
#include "appearance/detail.h"
#include "asset/asset_io.h"
#include "base/file.h"
#include "splat/light_visibility.h"

#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <unistd.h>

namespace nacre::cli {

static std::atomic<bool> gStop{false};
static_assert(std::atomic<bool>::is_always_lock_free); // a store from a signal handler is then safe

const std::atomic<bool>& catchStopSignals()
{
    struct sigaction action{};
    action.sa_handler = [](int) { gStop.store(true); };
    action.sa_flags = SA_RESTART; // file reads and writes go on, so that no error is reported that is only the signal
    sigaction(SIGINT, &action, nullptr);
    sigaction(SIGTERM, &action, nullptr);
    return gStop;
}

Error stoppedBySignal(const std::string& whatIsLeft) { return {ErrorCode::kCancelled, "stopped by a signal; " + whatIsLeft}; }

void warn(const std::string& message) { std::fprintf(stderr, "nacre: warning: %s\n", oneLine(message).c_str()); }

Progress::Progress() : terminal_(isatty(STDERR_FILENO) != 0), last_(std::chrono::steady_clock::now()) {}

void Progress::show(const std::string& text)
{
    using namespace std::chrono_literals;
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < (terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(30s))) return;
    last_ = now;
    shown_ = true;
    std::fprintf(stderr, terminal_ ? "\r\033[K%s" : "%s\n", text.c_str());
    std::fflush(stderr);
}

void Progress::clear()
{
    if (terminal_ && shown_) std::fputs("\r\033[K", stderr);
    shown_ = false;
}

std::unique_ptr<tbb::global_control> limitThreads(int threads)
{
    if (threads <= 0) return nullptr;
    // Mesa's software renderer has threads of its own; read when the first context is made.
    setenv("LP_NUM_THREADS", std::to_string(std::min(threads, 16)).c_str(), 0);
    return std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, size_t(threads));
}

void ThreadsOption::addTo(CLI::App& app)
{
    app.add_option("--threads", count, "0: all cores; the result does not depend on it")->check(wholeNumber(0, 4096))->capture_default_str();
}

std::string clockText(double seconds)
{
    if (!(seconds >= 0) || seconds > 1e7) return "?";
    const int s = int(seconds + 0.5);
    return s < 3600 ? format("%d:%02d", s / 60, s % 60) : format("%d:%02d:%02d", s / 3600, s / 60 % 60, s % 60);
}

std::string format(const char* pattern, ...)
{
    va_list args, again;
    va_start(args, pattern);
    va_copy(again, args);
    std::string text(size_t(std::vsnprintf(nullptr, 0, pattern, args)), '\0');
    std::vsnprintf(text.data(), text.size() + 1, pattern, again);
    va_end(again);
    va_end(args);
    return text;
}

Status checkWritable(const std::string& path)
{
    if (path.empty()) return ok();
    std::error_code ignored;
    if (std::filesystem::is_directory(path, ignored))
        return Error{ErrorCode::kBadInput, "'" + path + "' is a folder; give the name of a file to write"};
    std::string folder = std::filesystem::path(path).parent_path().string();
    if (folder.empty()) folder = ".";
    if (!std::filesystem::is_directory(folder, ignored))
        return Error{ErrorCode::kBadInput, "cannot write '" + path + "': there is no folder '" + folder + "'; create it first"};
    if (access(folder.c_str(), W_OK | X_OK) != 0)
        return Error{ErrorCode::kBadInput, "cannot write into folder '" + folder + "': " + std::strerror(errno) + "; give a name elsewhere"};
    return ok();
}

Status checkOutputs(std::initializer_list<std::string> outputs, std::initializer_list<std::string> inputs)
{
    const auto real = [](const std::string& path) {
        std::error_code ignored;
        return std::filesystem::weakly_canonical(path, ignored);
    };
    std::vector<std::string> written;
    for (const std::string& path : outputs) {
        if (path.empty()) continue;
        for (const std::string& other : written)
            if (real(path) == real(other)) return Error{ErrorCode::kBadInput, "'" + path + "' would be written twice; give each output a name of its own"};
        for (const std::string& input : inputs)
            if (!input.empty() && real(path) == real(input)) return Error{ErrorCode::kBadInput, "'" + path + "' is an input, which would be lost; give the output another name"};
        if (Status s = checkWritable(path); !s) return s;
        written.push_back(path);
    }
    return ok();
}

Status checkExtension(const std::string& path, const char* extension)
{
    if (std::filesystem::path(path).extension() == extension) return ok();
    return Error{ErrorCode::kBadInput, "'" + path + "': the name must end in " + extension};
}

Status makeFolder(const std::string& folder)
{
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) return Error{ErrorCode::kBadInput, "cannot create folder '" + folder + "': " + error.message() + "; give a name elsewhere"};
    return checkWritable((std::filesystem::path(folder) / "x").string());
}

Status writeJson(const Json& json, const std::string& path)
{
    // `replace`: a file name need not be UTF-8
    const std::string text = json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
    return writeFileAtomically(path, std::as_bytes(std::span(text)));
}

size_t fileBytes(const std::string& path)
{
    std::error_code error;
    const auto bytes = std::filesystem::file_size(path, error);
    return error ? 0 : size_t(bytes);
}

uint64_t bytesOfGigabytes(double gigabytes) { return uint64_t(std::min(gigabytes * 1e9, 1e18)); }

Json skippedJson(const std::vector<UnusableImage>& skipped)
{
    Json out = Json::array();
    for (const UnusableImage& image : skipped) out.push_back({{"path", image.path}, {"why", image.why}});
    return out;
}

Result<OlatDataset> openDataset(const std::string& path)
{
    Result<OlatDataset> dataset = loadDataset(path);
    if (dataset)
        for (const std::string& line : dataset->warnings) warn(line);
    return dataset;
}

Result<const OlatSplit*> findSplit(const OlatDataset& dataset, const std::string& name)
{
    if (const OlatSplit* split = dataset.find(name)) return split;
    std::string names;
    for (const OlatSplit& split : dataset.splits) names += (names.empty() ? "" : ", ") + split.name;
    return Error{ErrorCode::kBadInput, "dataset '" + dataset.path + "' has no split '" + name + "'; it has: " + names};
}

Result<AssetFile> openAsset(const std::string& path, bool withMaps)
{
    auto bytes = readFile(path);
    if (!bytes) return bytes.error();
    auto asset = decodeAsset(*bytes);
    if (!asset) return Error{asset.error().code, "'" + path + "': " + asset.error().message};
    expandChannels(*asset);
    if (withMaps) drawVisibilityInParallel(*asset);
    return AssetFile{std::move(*bytes), std::move(*asset)};
}

void RendererOption::addTo(CLI::App& app)
{
    app.add_option("--renderer", name, "gl: the OpenGL runtime; reference: scalar code on the CPU")
        ->check(CLI::IsMember({"gl", "reference"}))->capture_default_str();
    app.add_option("--preset", preset, "Load only what this preset of the asset keeps (nacre info lists them); its scale of the resolution is left to you");
}

Result<std::unique_ptr<SplatRenderer>> RendererOption::make(const AssetFile& file) const
{
    if (preset.empty()) return name == "gl" ? makeGlRenderer(file.bytes) : makeReferenceRenderer(file.asset);
    std::string names;
    for (const Preset& p : file.asset.presets) {
        names += (names.empty() ? "" : ", ") + p.name;
        if (p.name != preset) continue;
        if (name == "gl") return makeGlRenderer(file.bytes, p.detail);
        SplatAsset reduced = file.asset;
        if (Status s = reduceDetail(reduced, p.detail); !s) return s.error();
        return makeReferenceRenderer(reduced);
    }
    return Error{ErrorCode::kBadInput, "--preset " + inQuotes(preset) + ": the asset has " + (names.empty() ? std::string("no presets; nacre tune --as-preset makes them") : "the presets " + names)};
}

/// The whole text as a number; NaN, which fails every comparison, if it is none.
static double numberFrom(const std::string& text)
{
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    return !text.empty() && *end == '\0' ? value : NAN;
}

CLI::Validator positiveNumber()
{
    return CLI::Validator(
        [](std::string& text) -> std::string {
            const double value = numberFrom(text);
            return value > 0 && std::isfinite(value) ? "" : inQuotes(text) + " is not a number above 0";
        },
        "> 0");
}

CLI::Validator numberBetween(double lowest, double highest)
{
    return CLI::Validator(
        [=](std::string& text) -> std::string {
            const double value = numberFrom(text);
            return value >= lowest && value <= highest ? "" : inQuotes(text) + format(" is not a number from %g to %g", lowest, highest);
        },
        format("%g..%g", lowest, highest));
}

CLI::Validator wholeNumber(long long lowest, long long highest)
{
    return CLI::Validator(
        [=](std::string& text) -> std::string {
            char* end = nullptr;
            errno = 0;
            const long long value = std::strtoll(text.c_str(), &end, 10);
            if (!text.empty() && *end == '\0' && errno == 0 && value >= lowest && value <= highest) return "";
            return format("'%s' is not a whole number from %lld to %lld", text.c_str(), lowest, highest);
        },
        format("%lld..%lld", lowest, highest));
}

} // namespace nacre::cli
