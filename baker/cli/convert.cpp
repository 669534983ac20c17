// nacre convert: assets and splats in the formats of others.
#include "cli.h"

#include "base/file.h"
#include "base/glb_container.h"
#include "eval/evaluate.h"
#include "interchange/ply.h"
#include "interchange/rotate_splats.h"
#include "interchange/splat_glb.h"
#include "pack/lit_snapshot.h"
#include "scene_spec.h"

#include <cstdio>
#include <filesystem>
#include <string_view>

namespace nacre::cli {

struct ConvertArguments {
    std::string input, output, colorSpace, axes = "own";
    std::vector<std::string> lights;
    double exposure = 1;
    bool exposed = false;
    ThreadsOption threads;
};

static bool holdsAsset(std::span<const std::byte> bytes)
{
    const auto chunks = splitGlb(bytes);
    if (!chunks) return false;
    const std::string_view json(reinterpret_cast<const char*>(chunks->json.data()), chunks->json.size());
    return json.find("\"NACRE_gaussian_splatting_relight\"") != json.npos;
}

static Result<PlainSplats> snapshotOf(const ConvertArguments& args, bool toPly)
{
    if (args.lights.empty())
        return Error{ErrorCode::kBadInput, "'" + args.input + "' is a relightable asset: give the lights under which to take the snapshot (--light, see --help)"};
    const auto file = openAsset(args.input);
    if (!file) return file.error();
    const SplatAsset& asset = file->asset;
    std::vector<Light> lights;
    for (const std::string& text : args.lights) {
        auto light = parseLight(text);
        if (!light) return light.error();
        if (light->type == LightType::kEnvironment) light->directionToLight = findSubject(asset).up;
        const auto expanded = rendererLights(*light);
        if (!expanded) return expanded.error();
        lights.insert(lights.end(), expanded->begin(), expanded->end());
    }
    const std::atomic<bool>& stop = catchStopSignals();
    Progress progress;
    const auto goOn = [&](double done) {
        progress.show(format("convert %.0f %%", 100 * done));
        return !stop.load();
    };
    auto splats = litSnapshot(asset, lights, {args.colorSpace != "linear", args.exposure}, goOn);
    progress.clear();
    if (!splats) return splats.error().code == ErrorCode::kCancelled ? stoppedBySignal("nothing was written") : splats.error();
    if (toPly) placeInDataset(asset.frame, splats->cloud);
    return splats;
}

/// Splats that were made elsewhere.
static Result<PlainSplats> readPlain(const ConvertArguments& args, std::span<const std::byte> bytes)
{
    const char* what = !args.lights.empty() ? "--light" : args.exposed ? "--exposure" : nullptr;
    if (what) return Error{ErrorCode::kBadInput, format("%s: '%s' has no relighting data, its look stays as it is", what, args.input.c_str())};
    if (looksLikePly(bytes)) {
        auto file = decodePly(bytes);
        if (!file) return Error{file.error().code, "'" + args.input + "': " + file.error().message};
        for (const std::string& line : file->warnings) warn("'" + args.input + "': " + line);
        return std::move(file->splats);
    }
    if (!looksLikeGlb(bytes)) return Error{ErrorCode::kBadInput, "'" + args.input + "' is neither a .ply nor a .glb"};
    return decodeSplatGlb(bytes, "'" + args.input + "'");
}

/// What turns the splats of a .ply with such axes to glTF's, +Y up; of "own" axes nothing is known.
static glm::dquat yUpFromPly(const std::string& axes, const glm::dquat& yUpFromOwn)
{
    if (axes == "own") return yUpFromOwn;
    return axes == "y-up" ? glm::dquat(1, 0, 0, 0) : glm::dquat(0, 0, 0, 1); // y-down: half a turn about Z, as PlayCanvas does
}

static Status runConvert(const ConvertArguments& args)
{
    const std::string extension = std::filesystem::path(args.output).extension().string();
    const bool toPly = extension == ".ply";
    if (!toPly && extension != ".glb") return Error{ErrorCode::kBadInput, "OUT '" + args.output + "': the name must end in .ply or .glb"};
    if (Status s = checkWritable(args.output); !s) return s;
    std::error_code ignored;
    if (std::filesystem::equivalent(args.input, args.output, ignored))
        return Error{ErrorCode::kBadInput, "'" + args.output + "' is the input itself; give another name for the output"};
    const auto threads = limitThreads(args.threads.count);
    const auto bytes = readFile(args.input);
    if (!bytes) return bytes.error();

    const bool asset = looksLikeGlb(*bytes) && holdsAsset(*bytes), fromPly = looksLikePly(*bytes);
    if (args.axes != "own" && !toPly && !fromPly) return Error{ErrorCode::kBadInput, "--axes: says how a .ply lies, and there is none here"};
    if (args.axes != "own" && toPly && fromPly) return Error{ErrorCode::kBadInput, "--axes: from .ply to .ply nothing is turned; leave it out"};
    auto splats = asset ? snapshotOf(args, toPly) : readPlain(args, *bytes);
    if (!splats) return splats.error();
    if (!args.colorSpace.empty()) changeColorSpace(args.colorSpace == "srgb", *splats);
    else if (toPly && !splats->srgb) changeColorSpace(true, *splats); // as viewers of .ply take it
    if (fromPly && !toPly) splats->yUpFromSplats = glm::quat(yUpFromPly(args.axes, {1, 0, 0, 0}));
    if (toPly && !fromPly && args.axes != "own") rotateSplats(glm::conjugate(yUpFromPly(args.axes, {})) * glm::dquat(splats->yUpFromSplats), *splats);

    const auto out = toPly ? Result<std::vector<std::byte>>(encodePly(*splats)) : encodeSplatGlb(*splats);
    if (!out) return out.error();
    if (Status s = writeFileAtomically(args.output, *out); !s) return s;
    std::printf("%s: %zu splats, SH degree %d, colours %s, %zu bytes\n", args.output.c_str(), splats->cloud.count,
                splats->look.shFunctions == 16 ? 3 : splats->look.shFunctions == 9 ? 2 : splats->look.shFunctions == 4 ? 1 : 0,
                splats->srgb ? "sRGB" : "linear", out->size());
    return ok();
}

Action addConvert(CLI::App& app)
{
    auto args = std::make_shared<ConvertArguments>();
    CLI::App* sub = app.add_subcommand("convert", "Turn an asset into splats of one lighting (3DGS .ply, plain glTF), or such splats into one another");
    sub->add_option("IN", args->input, "Relightable asset (.glb), splats of 3D Gaussian splatting (.ply) or of plain KHR_gaussian_splatting (.glb)")->required();
    sub->add_option("OUT", args->output, "File to write: .ply of 3D Gaussian splatting, or .glb of plain KHR_gaussian_splatting")->required();
    sub->add_option("--light", args->lights,
                    "Of an asset, which needs at least one; may be repeated; in axes and units of the dataset. I, E: a number or r,g,b\n"
                    "  point:X,Y,Z:I          radiant intensity: irradiance I / distance^2\n"
                    "  directional:X,Y,Z:E    direction to the light, irradiance\n"
                    "  environment:FILE.exr   equirectangular radiance, its zenith at the asset's up, as 128 directional lights")
        ->allow_extra_args(false)->take_all();
    auto* exposure = sub->add_option("--exposure", args->exposure, "Of an asset: scales all lights, so that 1 is white")->check(positiveNumber())->capture_default_str();
    sub->add_option("--color-space", args->colorSpace,
                    "srgb: encoded colours, blended as they are, as viewers of .ply do, cut at white; linear: radiance\n"
                    "(default: srgb of an asset and of a .ply; a .glb to .glb stays as it is)")
        ->check(CLI::IsMember({"srgb", "linear"}));
    sub->add_option("--axes", args->axes,
                    "How the .ply lies. own: as the splats are, which of an asset is in axes and units of its dataset (nacre bake --init takes\n"
                    "it back), of a .glb +Y up; y-up; y-down, by half a turn about Z: as viewers of .ply expect. A .glb is +Y up by its node's rotation")
        ->check(CLI::IsMember({"own", "y-up", "y-down"}))->capture_default_str();
    sub->footer("A snapshot holds per splat what the lights make of it, as spherical harmonics of degree 3: shadows stay, highlights get soft.");
    args->threads.addTo(*sub);
    return [args, exposure] {
        args->exposed = exposure->count() > 0;
        return runConvert(*args);
    };
}

} // namespace nacre::cli
