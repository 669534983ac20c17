// nacre info: what a dataset or an asset holds.
#include "cli.h"

#include "appearance/detail.h"
#include "appearance/model_table.h"
#include "asset/asset_io.h"
#include "dataset/normalise.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <set>
#include <tuple>

namespace nacre::cli {

struct InfoArguments {
    std::string path, json;
    ThreadsOption threads;
    bool models = false;
};

struct Range {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    void add(double x) { low = std::min(low, x), high = std::max(high, x); }
    std::string text() const { return low > high ? "-" : format("%.4g..%.4g", low, high); }
};

/// Two lights are the same if they shine the same, to the last bit.
static size_t distinctLights(const OlatSplit& split)
{
    std::set<std::tuple<std::array<float, 11>, std::string, const void*>> lights;
    for (const OlatImage& image : split.images) {
        const Light& l = image.light;
        lights.insert({{float(l.type), l.position.x, l.position.y, l.position.z, l.directionToLight.x, l.directionToLight.y,
                        l.directionToLight.z, l.intensity.x, l.intensity.y, l.intensity.z, l.radius}, l.environmentPath, l.group.get()});
    }
    return lights.size();
}

static void printSplit(const OlatSplit& split, size_t lights)
{
    static constexpr const char* kLightNames[] = {"point", "directional", "environment", "all_on"};
    Range cameraDistance, lightDistance, intensity, focal;
    std::array<size_t, 4> ofType{};
    for (const Camera& c : split.cameras) {
        cameraDistance.add(glm::length(c.position()));
        focal.add(c.fx), focal.add(c.fy);
    }
    for (const OlatImage& image : split.images) {
        const Light& l = image.light;
        ++ofType[size_t(l.type)];
        if (l.type == LightType::kPoint) lightDistance.add(glm::length(l.position));
        if (l.isPunctual())
            for (int c = 0; c < 3; ++c) intensity.add(l.intensity[c]);
    }
    std::string types;
    for (size_t t = 0; t < ofType.size(); ++t)
        if (ofType[t] > 0) types += format("%s%zu %s", types.empty() ? "" : ", ", ofType[t], kLightNames[t]);
    const Camera& first = split.cameras.front();
    std::printf("%-12s %zu images (%s light), %zu cameras, %zu lights, %dx%d pixels\n", oneLine(split.name).c_str(), split.images.size(), types.c_str(),
                split.cameras.size(), lights, first.width, first.height);
    std::printf("%-12s focal length %s px; distance from the origin: cameras %s, lights %s; intensity %s\n", "", focal.text().c_str(),
                cameraDistance.text().c_str(), lightDistance.text().c_str(), intensity.text().c_str());
}

/// What the checks measured; JSON has null where there is nothing to measure.
static void printFigures(const DatasetExamination& found)
{
    if (found.reflectance) std::printf("apparent reflectance %.2g (%g to %g is plausible)\n", *found.reflectance, kLeastReflectance, kMostReflectance);
    for (const SplitFigures& f : found.splits) {
        std::string text;
        if (f.agreement) text += format("shading agrees with the lights: %.2f (above %g is right)", *f.agreement, kLeastAgreement);
        if (f.uncovered) text += format("%ssilhouettes excluded by other cameras: %.2f (0 is right)", text.empty() ? "" : "; ", *f.uncovered);
        if (!text.empty()) std::printf("%-12s %s\n", oneLine(f.split).c_str(), text.c_str());
    }
}

static Json figuresJson(const DatasetExamination& found)
{
    const auto orNull = [](const std::optional<double>& x) { return x ? Json(*x) : Json(nullptr); };
    Json out = {{"apparent_reflectance", orNull(found.reflectance)}, {"splits", Json::object()}};
    for (const SplitFigures& f : found.splits) out["splits"][f.split] = {{"light_agreement", orNull(f.agreement)}, {"uncovered_silhouettes", orNull(f.uncovered)}};
    return out;
}

static Status datasetInfo(const InfoArguments& args)
{
    const auto dataset = loadDataset(args.path);
    if (!dataset) return dataset.error();
    std::vector<std::string> warnings = dataset->warnings;
    ImageCache images(*dataset, size_t(64) << 20);
    const auto found = examineDataset(*dataset, images);
    if (!found) return found.error();
    warnings.insert(warnings.end(), found->warnings.begin(), found->warnings.end());

    const char* colorSpace = dataset->colorSpace == ColorSpace::kLinear ? "linear" : "srgb";
    std::printf("%s: %s convention, %s files, %s alpha, up (%g, %g, %g)\n", args.path.c_str(), dataset->convention.c_str(), colorSpace,
                dataset->premultiplied ? "premultiplied" : "straight", dataset->up.x, dataset->up.y, dataset->up.z);
    Json splits = Json::object();
    for (const OlatSplit& split : dataset->splits) {
        if (split.cameras.empty() || split.images.empty())
            return Error{ErrorCode::kBadInput, "dataset '" + args.path + "': split '" + split.name + "' is empty"};
        const size_t lights = distinctLights(split);
        printSplit(split, lights);
        splits[split.name] = {{"images", split.images.size()}, {"cameras", split.cameras.size()}, {"lights", lights},
                              {"width", split.cameras.front().width}, {"height", split.cameras.front().height}};
    }
    printFigures(*found);
    for (const std::string& line : warnings) std::printf("warning: %s\n", oneLine(line).c_str());
    if (warnings.empty()) std::printf("convention checks: nothing suspicious\n");
    if (args.json.empty()) return ok();
    return writeJson({{"convention", dataset->convention}, {"color_space", colorSpace}, {"splits", splits}, {"warnings", warnings}, {"checks", figuresJson(*found)}}, args.json);
}

static std::string presetText(const Preset& p)
{
    std::string text = detailText(p.detail);
    if (p.resolutionScale < 1) text += format(", at %.3g of the width and height", double(p.resolutionScale));
    if (p.environmentDirections > 0) text += format(", environments as %u lights", p.environmentDirections);
    std::string measured;
    if (p.milliseconds != 0) measured = format("%.3g ms", p.milliseconds);
    if (p.psnrMasked != 0) measured += format("%s%.2f dB", measured.empty() ? "" : ", ", p.psnrMasked);
    if (!measured.empty()) text += "; measured: " + measured + (p.measuredOn.empty() ? "" : ", on " + oneLine(p.measuredOn, 200));
    return text;
}

static Json presetsJson(const std::vector<Preset>& presets)
{
    Json out = Json::array();
    for (const Preset& p : presets) {
        Json parts = Json::array();
        for (const DetailPartName& part : kDetailParts)
            if (p.detail.leaveOut & part.part) parts.push_back(part.name);
        out.push_back({{"name", p.name}, {"splats", p.detail.splats}, {"leave_out", parts}, {"transport_functions", p.detail.transportFunctions},
                       {"visibility_size", p.detail.visibilitySize}, {"resolution_scale", p.resolutionScale}, {"environment_directions", p.environmentDirections},
                       {"milliseconds", p.milliseconds}, {"psnr_masked", p.psnrMasked}, {"measured_on", p.measuredOn}});
    }
    return out;
}

static Status assetInfo(const InfoArguments& args)
{
    const auto file = openAsset(args.path, false);
    if (!file) return file.error();
    const SplatAsset& asset = file->asset;
    const AssetSummary summary = summarizeAsset(asset, file->bytes);
    const size_t splats = asset.cloud.count, bytes = file->bytes.size();
    const double perSplat = double(bytes) / double(splats);
    std::printf("%s: model %s, %zu splats, %zu bytes (%.1f per splat), profile %s\n", args.path.c_str(), asset.model.c_str(), splats,
                bytes, perSplat, summary.profile.c_str());
    if (!asset.bakedWith.empty()) std::printf("baked with   %s\n", oneLine(asset.bakedWith).c_str());
    const AssetFrame& frame = asset.frame;
    if (frame != AssetFrame{})
        std::printf("in dataset   position = %.9g * position in the asset + (%.9g, %.9g, %.9g); irradiances x %.9g\n", frame.scale, frame.translation.x,
                    frame.translation.y, frame.translation.z, frame.lightGain);
    Json channels = Json::array();
    for (const auto& channel : summary.channels) {
        std::printf("%-24s %10zu bytes, %.1f per splat\n", channel.name.c_str(), channel.bytes, double(channel.bytes) / double(splats));
        channels.push_back({{"name", channel.name}, {"bytes", channel.bytes}});
    }
    if (asset.drawnVisibility > 0) std::printf("visibility: %d x %d texels a splat, drawn from the splats when the asset is used\n", asset.drawnVisibility, asset.drawnVisibility);
    const bool ordered = asset.find("importance") != nullptr;
    std::printf("%s\n", ordered ? "splats have an order of importance: any share of them can be drawn" : "splats have no order of importance: all or none can be drawn (nacre pack makes one)");
    for (const Preset& p : asset.presets) std::printf("preset %-17s %s\n", p.name.c_str(), presetText(p).c_str());
    if (args.json.empty()) return ok();
    return writeJson({{"model", asset.model}, {"splats", splats}, {"asset_bytes", bytes}, {"bytes_per_splat", perSplat},
                      {"profile", summary.profile}, {"channels", channels}, {"importance_order", ordered}, {"presets", presetsJson(asset.presets)},
                      {"dataset_frame", {{"scale", frame.scale}, {"translation", {frame.translation.x, frame.translation.y, frame.translation.z}},
                                         {"light_gain", frame.lightGain}}}}, args.json);
}

static Status listModels()
{
    for (const AppearanceModel& model : appearanceModels()) {
        std::printf("%-6s %s\n", model.name, model.summary);
        for (const ChannelSpec& channel : model.channels) {
            std::string sizes;
            for (uint32_t n : channel.components) sizes += format("%s%u", sizes.empty() ? "" : ", ", n);
            std::printf("       %s: %s %s %s\n", channel.name, sizes.c_str(), channel.type == ChannelType::kFloat ? "floats" : "bytes", channel.perAsset ? "once" : "per splat");
        }
    }
    return ok();
}

static Status runInfo(const InfoArguments& args)
{
    if (args.models) return listModels();
    const auto threads = limitThreads(args.threads.count);
    if (args.path.empty()) return Error{ErrorCode::kBadInput, "info needs an asset, a dataset or --models (try: nacre info --help)"};
    if (Status s = checkWritable(args.json); !s) return s;
    std::error_code ignored;
    const std::filesystem::path path(args.path);
    if (!std::filesystem::exists(path, ignored))
        return Error{ErrorCode::kBadInput, "there is no '" + args.path + "'; give an asset (.glb) or the folder of a dataset"};
    return std::filesystem::is_directory(path, ignored) || path.extension() == ".json" ? datasetInfo(args) : assetInfo(args);
}

Action addInfo(CLI::App& app)
{
    auto args = std::make_shared<InfoArguments>();
    CLI::App* sub = app.add_subcommand("info", "Say what an asset or a dataset holds, and whether its conventions look right");
    sub->add_option("PATH", args->path, "Asset (.glb), or OLAT dataset: its folder or a transforms file");
    sub->add_flag("--models", args->models, "List the appearance models and what they store per splat");
    sub->add_option("--json", args->json, "Write the same to this file");
    args->threads.addTo(*sub);
    return [args] { return runInfo(*args); };
}

} // namespace nacre::cli
