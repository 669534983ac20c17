// The order of things on disk: synth.json, then images, each by rename, then description files. So a folder without transforms_*.json is
// not yet a dataset, and synth.json says how to go on.
//
// Shards share nothing but the folder. Their camera groups are disjoint, so no two write the same image; whichever finishes last finds
// every image of a split and writes its description. If two finish at the same moment both write the same bytes.
#include "light_stage/synth.h"

#include "base/file.h"
#include "base/hash.h"
#include "base/text.h"
#include "dataset/dataset_writer.h"
#include "interchange/image_file.h"
#include "interchange/json.h"

#include <nlohmann/json.hpp>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <optional>

namespace nacre {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSettingsFile = "synth.json";
constexpr size_t kMaxSettingsBytes = size_t(1) << 24;

double secondsSince(std::chrono::steady_clock::time_point start)
{
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::string settingsText(const SynthSettings& settings)
{
    nlohmann::ordered_json json;
    json["about"] = "Settings of nacre synth. Give the same command again to go on with a dataset that is not complete.";
    for (const auto& [option, value] : settings) json["settings"][option] = value;
    return json.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

Error otherSettings(const std::string& folder, const std::string& option, const std::string& before, const std::string& now)
{
    const auto text = [&](const std::string& value) { return value.empty() ? "without " + option : option + " " + oneLine(value, 200); };
    return {ErrorCode::kBadInput, inQuotes(folder) + " was begun " + (before.empty() ? "" : "with ") + text(before) + ", this run is " +
                                      (now.empty() ? "" : "with ") + text(now) + "; give the same options to go on, or another folder"};
}

/// Both sides through the same encoding, so that texts that are not UTF-8 compare equal to themselves.
Status compareSettings(const std::string& folder, const SynthSettings& settings)
{
    const std::string path = (fs::path(folder) / kSettingsFile).string();
    const auto stored = readFile(path, kMaxSettingsBytes);
    if (!stored) return stored.error();
    const auto before = JsonDocument::parse(*stored, path);
    if (!before) return before.error();
    const std::string text = settingsText(settings);
    const auto now = JsonDocument::parse(std::as_bytes(std::span(text)), path);
    if (!now) return now.error();
    for (const auto& [option, value] : settings) {
        const JsonNode was = before->root()["settings"][option.c_str()];
        const std::string wasText = was.exists() ? was.string() : "", isText = now->root()["settings"][option.c_str()].string();
        if (before->failed()) return before->error();
        if (wasText != isText) return otherSettings(folder, option, wasText, isText);
    }
    return ok();
}

/// One camera of one split.
struct Group {
    size_t split;
    uint32_t camera;
    std::vector<size_t> images; // of the split
    bool done = false;
};

class Synthesis {
public:
    Synthesis(const SynthJob& job, const StageRender& render, const std::function<void(const SynthProgress&)>& progress,
              const std::atomic<bool>* stop)
        : job_(job), plan_(job.plan), render_(render), progress_(progress), stop_(stop)
    {
        assert(job.splits.size() == plan_.splits.size());
        const int threads = job.splits.empty() ? 0 : job.splits[0].render.threads;
        if (threads > 0) arena_.initialize(std::min(threads, tbb::this_task_arena::max_concurrency())); // TBB complains about more
    }

    Result<SynthReport> run();

private:
    std::string pathOf(const OlatImage& image) const { return (fs::path(plan_.path) / image.path).string(); }
    bool isThere(const OlatSplit& split, const OlatImage& image, bool decode) const;
    void collectGroups();
    Status renderGroup(const Group& group);
    /// An image that is complete, and what of it shines without the flash.
    struct Finished {
        size_t image;
        Image radiance;
        std::optional<Image> ambient;
    };
    Status writeImages(size_t split, std::span<Finished> images);
    const OlatSplit& rendered(size_t s) const { return job_.splits[s].capture ? job_.splits[s].capture->truth : plan_.splits[s]; }
    Status describe(size_t split);
    double costOf(const Group& group) const;
    void show(const Group& group, double fractionOfGroup);
    template <class Work>
    void inParallel(size_t count, Work work) { arena_.execute([&] { tbb::parallel_for(size_t(0), count, work); }); }

    const SynthJob& job_;
    const OlatDataset& plan_;
    const StageRender& render_;
    const std::function<void(const SynthProgress&)>& progress_;
    const std::atomic<bool>* stop_;

    tbb::task_arena arena_;
    std::vector<Group> groups_; // of this shard
    SynthReport report_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
    size_t imageCount_ = 0, imagesDone_ = 0;
    double cost_ = 0, costDone_ = 0; // of what this run renders
};

bool Synthesis::isThere(const OlatSplit& split, const OlatImage& image, bool decode) const
{
    const std::string path = pathOf(image);
    std::error_code ignored;
    if (!fs::is_regular_file(path, ignored)) return false;
    for (const std::string& beside : {image.maskPath, image.ambientPath})
        if (!beside.empty() && !fs::is_regular_file(fs::path(plan_.path) / beside, ignored)) return false;
    const Result<Image> found = decode ? readImageFile(path) : readImageFileSize(path);
    const Camera& camera = split.cameras[image.camera];
    return found && found->width == camera.width && found->height == camera.height;
}

void Synthesis::collectGroups()
{
    size_t ordinal = 0;
    for (size_t s = 0; s < plan_.splits.size(); ++s) {
        const OlatSplit& split = plan_.splits[s];
        std::vector<Group> ofSplit(split.cameras.size());
        for (size_t i = 0; i < split.images.size(); ++i) ofSplit[split.images[i].camera].images.push_back(i);
        for (uint32_t c = 0; c < ofSplit.size(); ++c) {
            if (ofSplit[c].images.empty()) continue;
            ofSplit[c].split = s, ofSplit[c].camera = c;
            if (int(ordinal++ % size_t(job_.shards)) == job_.shard - 1) groups_.push_back(std::move(ofSplit[c]));
        }
    }
    inParallel(groups_.size(), [&](size_t g) {
        const OlatSplit& split = plan_.splits[groups_[g].split];
        groups_[g].done = std::all_of(groups_[g].images.begin(), groups_[g].images.end(),
                                      [&](size_t i) { return isThere(split, split.images[i], true); });
    });
    for (const Group& group : groups_) {
        imageCount_ += group.images.size();
        if (group.done) imagesDone_ += group.images.size();
        else cost_ += costOf(group);
    }
}

const std::vector<Light>& lightsOf(const Light& light, std::vector<Light>& storage)
{
    if (light.type == LightType::kGroup) return *light.group;
    storage.assign(1, light);
    return storage;
}

/// Samples, each worth a path and one shadow ray per light on each of its vertices. Only ratios matter: for the time that is left.
double Synthesis::costOf(const Group& group) const
{
    const OlatSplit& split = rendered(group.split);
    const Camera& camera = split.cameras[group.camera];
    double lights = 4;
    for (const size_t i : group.images) lights += split.images[i].light.group ? double(split.images[i].light.group->size()) : 1.0;
    return lights * camera.width * camera.height * job_.splits[group.split].render.samplesPerPixel;
}

void Synthesis::show(const Group& group, double fraction)
{
    if (!progress_) return;
    const double done = costDone_ + fraction * costOf(group);
    const double left = done > 0 ? secondsSince(start_) * (cost_ - done) / done : -1.0;
    progress_({plan_.splits[group.split].name, imagesDone_, imageCount_, left});
}

/// Of luminance as shown, like RenderStats::noise.
double luminanceSum(const Image& image)
{
    double sum = 0;
    for (size_t i = 0; i < image.rgba.size(); i += 4)
        sum += std::min(1.0, 0.2126 * double(image.rgba[i]) + 0.7152 * double(image.rgba[i + 1]) + 0.0722 * double(image.rgba[i + 2]));
    return sum;
}

double clippedShare(const Image& image)
{
    size_t object = 0, clipped = 0;
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        object += image.rgba[i + 3] > 0;
        clipped += std::max({image.rgba[i], image.rgba[i + 1], image.rgba[i + 2]}) > 1.0f;
    }
    return object > 0 ? double(clipped) / double(object) : 0.0;
}

void addRadiance(Image& to, const Image& from)
{
    for (size_t i = 0; i < to.rgba.size(); ++i)
        if (i % 4 != 3) to.rgba[i] += from.rgba[i]; // coverage is the same under every light
}

/// An image that several calls of `render` add up to.
struct Pending {
    size_t lightsLeft = 0;
    Image image;
    std::optional<Image> ambient; // of a capture with photographs without the flash
    double noise = 0, weight = 0; // luminance-weighted: the standard error of a sum is at most the sum of standard errors
};

Status Synthesis::renderGroup(const Group& group)
{
    const OlatSplit &split = rendered(group.split), &stated = plan_.splits[group.split];
    const SynthJob::Split& job = job_.splits[group.split];
    const Camera& camera = split.cameras[group.camera];
    SynthReport::Split& report = report_.splits[group.split];

    std::vector<Light> lights, storage;
    std::vector<size_t> imageOfLight; // index into pending
    std::vector<Pending> pending(group.images.size());
    for (size_t k = 0; k < pending.size(); ++k)
        for (const Light& light : lightsOf(split.images[group.images[k]].light, storage)) {
            lights.push_back(light);
            imageOfLight.push_back(k);
            pending[k].lightsLeft++;
        }

    // The stream of random numbers is the split's and camera's own: noise does not repeat from image to image.
    RenderSettings settings = job.render;
    if (job.capture) settings.optics = job.capture->optics;
    settings.seed = fnv1a(&group.camera, sizeof group.camera, fnv1a(split.name.data(), split.name.size(), settings.seed ^ kFnvOffset));
    settings.stop = stop_;
    const size_t lightBytes = size_t(camera.width) * size_t(camera.height) * kFilmBytesPerPixel, chunk = std::max<size_t>(1, kChunkBytes / lightBytes);
    bool seesObject = true;
    for (size_t first = 0; first < lights.size(); first += chunk) {
        const size_t count = std::min(chunk, lights.size() - first);
        settings.progress = [&](double f) { show(group, (double(first) + f * double(count)) / double(lights.size())); };
        RenderStats stats;
        auto images = (job.renderer ? job.renderer : render_)(camera, std::span(lights).subspan(first, count), settings, &stats);
        if (!images) return images.error();
        assert(images->size() == count && stats.noise.size() == count);
        report.seconds += stats.seconds;
        report.rays += stats.pathRays + stats.shadowRays + stats.walkRays;
        seesObject = stats.seesObject;
        report.backFaces = std::max(report.backFaces, stats.backFaces);
        report.leakedWalks = std::max(report.leakedWalks, stats.leakedWalks);
        report.cutWalks = std::max(report.cutWalks, stats.cutWalks);

        std::vector<Finished> finished;
        for (size_t l = 0; l < count; ++l) {
            Pending& p = pending[imageOfLight[first + l]];
            Image& image = (*images)[l];
            const double weight = luminanceSum(image);
            p.noise += weight * double(stats.noise[l]), p.weight += weight;
            const OlatImage& to = stated.images[group.images[imageOfLight[first + l]]];
            if (!to.ambientPath.empty() && lights[first + l].type == LightType::kEnvironment) p.ambient = image;
            if (p.image.rgba.empty()) p.image = std::move(image);
            else addRadiance(p.image, image);
            if (--p.lightsLeft > 0) continue;
            // sums until the end, then divided by the number of images
            report.noise += p.weight > 0 ? p.noise / p.weight : 0.0;
            report.samplesPerPixel += stats.samplesPerPixel;
            if (!job.capture && plan_.colorSpace == ColorSpace::kSrgb && fs::path(to.path).extension() == ".png") report.clipped += clippedShare(p.image);
            finished.push_back({group.images[imageOfLight[first + l]], std::move(p.image), std::move(p.ambient)});
        }
        if (Status s = writeImages(group.split, finished); !s) return s;
        report.written += finished.size();
        imagesDone_ += finished.size();
    }
    report.cameras++;
    report.emptyCameras += !seesObject;
    costDone_ += costOf(group);
    show(group, 0.0);
    return ok();
}

Status Synthesis::writeImages(size_t s, std::span<Finished> images)
{
    const OlatSplit& split = plan_.splits[s];
    const Capture* capture = job_.splits[s].capture.get();
    if (capture && !images.empty()) // before the photographs: where these are, so is the matte
        if (Status status = writeMatte(*capture, split, images[0].image, images[0].radiance, plan_.path); !status) return status;
    std::vector<Status> statuses(images.size(), ok());
    inParallel(images.size(), [&](size_t k) {
        Finished& finished = images[k];
        if (capture) {
            const Image* ambient = finished.ambient ? &*finished.ambient : nullptr;
            statuses[k] = writePhotograph(*capture, split, finished.image, std::move(finished.radiance), ambient, plan_.path);
            return;
        }
        const std::string path = pathOf(split.images[finished.image]);
        std::error_code error;
        fs::create_directories(fs::path(path).parent_path(), error);
        statuses[k] = error ? Status(Error{ErrorCode::kIo, "cannot create a folder for '" + path + "': " + error.message()})
                            : writeDatasetImage(plan_, finished.radiance, path);
    });
    for (Status& status : statuses)
        if (!status) return status;
    return ok();
}

Status Synthesis::describe(size_t s)
{
    for (const DescriptionFile& file : describeSplit(plan_, plan_.splits[s], job_.splits[s].topLevel)) {
        const fs::path path = fs::path(plan_.path) / file.path;
        std::error_code error;
        fs::create_directories(path.parent_path(), error); // if it fails, so does writing
        if (Status status = writeFileAtomically(path.string(), std::as_bytes(std::span(file.text))); !status) return status;
    }
    return ok();
}

Result<SynthReport> Synthesis::run()
{
    for (const OlatSplit& split : plan_.splits) {
        report_.splits.emplace_back();
        report_.splits.back().name = split.name;
        report_.splits.back().images = split.images.size();
    }
    collectGroups();
    start_ = std::chrono::steady_clock::now();
    for (const Group& group : groups_) {
        if (group.done) continue;
        if (stop_ && *stop_) return Error{ErrorCode::kCancelled, "stopped"};
        if (Status s = renderGroup(group); !s) return s.error();
    }
    for (size_t s = 0; s < plan_.splits.size(); ++s) {
        SynthReport::Split& report = report_.splits[s];
        if (report.written > 0)
            for (double* mean : {&report.noise, &report.samplesPerPixel, &report.clipped}) *mean /= double(report.written);
        if (job_.shards > 1)
            for (const OlatImage& image : plan_.splits[s].images) report.missing += !isThere(plan_.splits[s], image, false);
        if (report.missing > 0) continue;
        if (Status status = describe(s); !status) return status.error();
    }
    report_.seconds = secondsSince(start_);
    return report_;
}

Status checkFolder(const std::string& folder, const SynthSettings& settings, bool& begun)
{
    begun = false;
    std::error_code error;
    if (!fs::exists(folder, error)) return ok();
    if (!fs::is_directory(folder, error)) return Error{ErrorCode::kBadInput, inQuotes(folder) + " is a file; give the name of a folder to write"};
    begun = fs::exists(fs::path(folder) / kSettingsFile, error);
    if (begun) return compareSettings(folder, settings);
    for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
        if (it->path().filename().string().find(".tmp-") == std::string::npos) // what a killed run may leave
            return Error{ErrorCode::kBadInput, "folder " + inQuotes(folder) + " holds " + inQuotes(it->path().filename().string()) +
                                                   " and no " + kSettingsFile + ": it is not a dataset of nacre synth; give a new or empty folder"};
    if (error) return Error{ErrorCode::kIo, "cannot list folder " + inQuotes(folder) + ": " + error.message()};
    return ok();
}

} // namespace

Status checkDatasetFolder(const std::string& folder, const SynthSettings& settings)
{
    bool begun;
    return checkFolder(folder, settings, begun);
}

Status claimDatasetFolder(const std::string& folder, const SynthSettings& settings)
{
    bool begun;
    if (Status s = checkFolder(folder, settings, begun); !s || begun) return s;
    std::error_code error;
    fs::create_directories(folder, error);
    if (error) return Error{ErrorCode::kIo, "cannot create folder " + inQuotes(folder) + ": " + error.message()};
    const std::string text = settingsText(settings);
    if (Status s = writeFileAtomically((fs::path(folder) / kSettingsFile).string(), std::as_bytes(std::span(text))); !s) return s;
    return compareSettings(folder, settings); // another shard may have been quicker, with other settings
}

Result<SynthReport> synthesise(const SynthJob& job, const StageRender& render, const std::function<void(const SynthProgress&)>& progress,
                               const std::atomic<bool>* stop)
{
    return Synthesis(job, render, progress, stop).run();
}

} // namespace nacre
