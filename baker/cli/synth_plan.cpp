// Plans of nacre synth.
#include "synth_plan.h"

#include "cli.h"

#include "base/file.h"
#include "interchange/exr.h"
#include "stage_spec.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

namespace nacre::cli {

namespace fs = std::filesystem;

std::string hexText(uint64_t hash) { return format("%016llx", static_cast<unsigned long long>(hash)); }

Result<uint64_t> hashMap(const EnvironmentFile& file)
{
    if (file.make) return fnv1a(file.name.data(), file.name.size());
    const auto bytes = readFile(file.source);
    if (!bytes) return bytes.error();
    return hashOf(*bytes, kFnvOffset);
}

/// Gives each distinct map file a name of its own in the dataset.
class MapNames {
public:
    MapNames(std::string folder, std::vector<EnvironmentFile>& files) : folder_(std::move(folder)), files_(files) {}

    std::string add(const std::string& source, Image (*make)() = nullptr)
    {
        for (const EnvironmentFile& f : files_)
            if (f.source == source) return (fs::path(folder_) / f.name).string();
        const std::string stem = fs::path(source).stem().string();
        std::string name = stem + ".exr";
        const auto taken = [&] { return std::any_of(files_.begin(), files_.end(), [&](const EnvironmentFile& f) { return f.name == name; }); };
        for (int i = 2; taken(); ++i) name = stem + format("_%d.exr", i);
        files_.push_back({source, name, make});
        return (fs::path(folder_) / name).string();
    }

private:
    std::string folder_;
    std::vector<EnvironmentFile>& files_;
};

Status checkMap(const std::string& path)
{
    const auto size = readExr(path);
    if (!size) return Error{size.error().code, "--environment: " + size.error().message};
    if (size->width != 2 * size->height)
        warn("--environment '" + path + format("': %dx%d pixels; an equirectangular map is twice as wide as high", size->width, size->height));
    return ok();
}

/// The camera for an image `width` pixels wide.
static Camera scaled(Camera camera, PixelSize size)
{
    const double s = double(size.width) / camera.width;
    camera.width = size.width, camera.height = size.height;
    for (double* x : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *x *= s;
    return camera;
}

static uint64_t hashLight(const Light& light, uint64_t hash)
{
    const float numbers[] = {float(light.type), light.position.x, light.position.y, light.position.z, light.directionToLight.x,
                             light.directionToLight.y, light.directionToLight.z, light.intensity.r, light.intensity.g, light.intensity.b};
    hash = fnv1a(numbers, sizeof numbers, hash);
    if (light.group)
        for (const Light& member : *light.group) hash = hashLight(member, hash);
    return hash;
}

static uint64_t hashPlan(const OlatDataset& plan)
{
    uint64_t hash = kFnvOffset;
    for (const OlatSplit& split : plan.splits) {
        hash = fnv1a(split.name.data(), split.name.size(), hash);
        for (const OlatImage& image : split.images) {
            const Camera& c = split.cameras[image.camera];
            const double numbers[] = {double(c.width), double(c.height), c.fx, c.fy, c.cx, c.cy};
            hash = hashLight(image.light, fnv1a(&c.worldFromCamera, sizeof c.worldFromCamera, fnv1a(numbers, sizeof numbers, hash)));
        }
    }
    return hash;
}

Result<StageWork> planLike(const SynthArguments& args)
{
    StageWork work;
    auto dataset = openDataset(args.like);
    if (!dataset) return dataset.error();
    work.plan = std::move(*dataset);
    work.plan.warnings.clear(); // shown
    PixelSize size;
    if (!args.size.empty()) {
        const auto parsed = parseStageSize(args.size);
        if (!parsed) return parsed.error();
        size = *parsed;
    }
    MapNames maps(args.output, work.maps);
    for (OlatSplit& split : work.plan.splits) {
        for (Camera& camera : split.cameras) {
            if (size.width == 0) continue;
            if (int64_t(size.width) * camera.height != int64_t(size.height) * camera.width)
                return Error{ErrorCode::kBadInput, format("--size %dx%d: the cameras of '%s' have %dx%d pixels; keep that shape", size.width,
                                                          size.height, args.like.c_str(), camera.width, camera.height)};
            camera = scaled(camera, size);
        }
        for (OlatImage& image : split.images)
            if (image.light.type == LightType::kEnvironment) image.light.environmentPath = maps.add(image.light.environmentPath);
    }
    uint64_t hash = hashPlan(work.plan);
    for (const EnvironmentFile& map : work.maps) {
        const auto mapHash = hashMap(map);
        if (!mapHash) return mapHash.error();
        hash = fnv1a(&*mapHash, sizeof *mapHash, hash);
    }
    work.likeText = fs::path(args.like).lexically_normal().filename().string() + " " + hexText(hash);
    return work;
}

Status readStageOptions(SynthArguments& args)
{
    StageOptions& stage = args.stage;
    const auto lightsPerCamera = parseLightsPerCamera(args.lightsPerCamera);
    if (!lightsPerCamera) return lightsPerCamera.error();
    stage.lightsPerCamera = *lightsPerCamera;
    const auto size = parseStageSize(args.size.empty() ? "256" : args.size);
    if (!size) return size.error();
    stage.width = size->width, stage.height = size->height;
    stage.layout = args.layout == "rings" ? StageLayout::kRings : args.layout == "fibonacci" ? StageLayout::kFibonacci : StageLayout::kGrid;
    stage.fullSphere = args.hemisphere == "full";
    return checkStage(stage);
}

void warnIfCut(const StageOptions& stage)
{
    if (!(stage.fovDegrees > 0)) return;
    const double shorter = double(std::min(stage.width, stage.height)) / stage.width;
    const double tanOfSide = shorter * std::tan(0.5 * stage.fovDegrees * std::numbers::pi / 180), d = stage.cameraDistance;
    if (tanOfSide < 1.0 / std::sqrt(d * d - 1.0)) warn("--fov: the bounding sphere of the object does not fit into the picture; parts may be cut off");
}

StageWork planOwn(const SynthArguments& args, const Placement& placement, const std::optional<CaptureOptions>& capture)
{
    StageWork work;
    StageOptions stage = args.stage;
    stage.center = placement.center;
    stage.objectRadius = placement.radius;
    MapNames maps(args.output, work.maps);
    std::vector<std::string> paths;
    for (const std::string& file : stage.environments) paths.push_back(maps.add(file));
    if (paths.empty()) paths = {maps.add("env_sunset.exr", sunsetMap), maps.add("env_studio.exr", studioMap)};
    stage.environments = paths;
    work.plan = planStage(stage, stageSplits());
    if (capture && capture->kind == CaptureKind::kPhone) work.plan.splits[0] = planPhone(stage, *capture);
    return work;
}

Status keepSplits(OlatDataset& plan, const std::vector<std::string>& wanted)
{
    if (wanted.empty()) return ok();
    std::string names;
    for (const OlatSplit& split : plan.splits) names += (names.empty() ? "" : ", ") + split.name;
    for (const std::string& name : wanted)
        if (!plan.find(name)) return Error{ErrorCode::kBadInput, "--splits: no split '" + name + "'; there are: " + names};
    std::erase_if(plan.splits, [&](const OlatSplit& s) { return std::find(wanted.begin(), wanted.end(), s.name) == wanted.end(); });
    return ok();
}

static bool isUsed(const OlatDataset& plan, const std::string& path)
{
    for (const OlatSplit& split : plan.splits)
        for (const OlatImage& image : split.images)
            if (image.light.type == LightType::kEnvironment && image.light.environmentPath == path) return true;
    return false;
}

Status writeMaps(const std::string& folder, const OlatDataset& plan, const std::vector<EnvironmentFile>& maps)
{
    for (const EnvironmentFile& map : maps) {
        const std::string path = (fs::path(folder) / map.name).string();
        if (!isUsed(plan, path)) continue;
        std::error_code ignored;
        if (fs::exists(path, ignored)) continue; // from a run before; the settings say that it is the same
        if (map.make) {
            if (Status s = writeExr(map.make(), path); !s) return s;
            continue;
        }
        const auto bytes = readFile(map.source);
        if (!bytes) return bytes.error();
        if (Status s = writeFileAtomically(path, *bytes); !s) return s;
    }
    return ok();
}

} // namespace nacre::cli
