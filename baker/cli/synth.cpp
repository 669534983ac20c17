// nacre synth: a glTF mesh in, an OLAT dataset out, rendered by the light stage.
#include "cli.h"

#include "capture_spec.h"

#include "base/file.h"
#include "base/hash.h"
#include "dataset/dataset_writer.h"
#include "interchange/gltf.h"
#include "light_stage/placement.h"
#include "light_stage/surroundings.h"
#include "light_stage/synth.h"
#include "stage_spec.h"
#include "synth_plan.h"
#include "synth_report.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <optional>
#include <thread>

namespace nacre::cli {

namespace fs = std::filesystem;

/// Of the file and of what it refers to: buffers and images end up in the arrays.
static Result<uint64_t> hashMesh(const std::string& path, const MeshScene& scene)
{
    const auto bytes = readFile(path);
    if (!bytes) return bytes.error();
    uint64_t hash = hashOf(*bytes, kFnvOffset);
    for (const TriangleMesh& m : scene.meshes) {
        hash = hashOf(m.triangles, hashOf(m.colors, hashOf(m.tangents, hashOf(m.normals, hashOf(m.positions, hash)))));
        for (const auto& texcoords : m.texcoords) hash = hashOf(texcoords, hash);
    }
    for (const MeshTexture& t : scene.textures) hash = hashOf(t.rgba, hash);
    return hash;
}

static Result<std::vector<SubsurfaceOverride>> readSubsurface(const SynthArguments& args, const MeshScene& mesh)
{
    std::vector<SubsurfaceOverride> out;
    if (!args.subsurfaceFile.empty()) {
        auto file = readSubsurfaceFile(args.subsurfaceFile);
        if (!file) return file.error();
        out = std::move(*file);
    }
    for (const std::string& text : args.subsurface) {
        const auto one = parseSubsurface(text);
        if (!one) return one.error();
        out.push_back(*one);
    }
    for (const SubsurfaceOverride& o : out)
        if (Status s = checkMaterial(o, mesh); !s) return s.error();
    return out;
}

/// train and all_on get --spp, splits to measure against get --test-spp and half the noise.
static SynthJob makeJob(const SynthArguments& args, OlatDataset plan, const Placement& placement, int testSamples, Shard shard,
                        const std::optional<CaptureOptions>& capture)
{
    const std::string captureText = capture ? textOf(*capture) : "";
    SynthJob job;
    Json matrix = Json::array();
    for (int r = 0; r < 4; ++r) {
        const glm::dmat4& m = placement.worldFromMesh;
        matrix.push_back({m[0][r], m[1][r], m[2][r], m[3][r]});
    }
    for (const OlatSplit& split : plan.splits) {
        const bool measured = split.name != "train" && split.name != "all_on";
        RenderSettings render;
        render.samplesPerPixel = measured ? testSamples : args.samples;
        render.noiseTarget = float(measured ? 0.5 * args.noise : args.noise);
        render.seed = args.stage.seed;
        render.indirectRoughness = float(args.indirectRoughness);
        render.threads = std::min(args.threads, int(std::thread::hardware_concurrency()));
        Json top{{"object", fs::path(args.mesh).stem().string()},
                       {"renderer", "Nacre light stage " NACRE_VERSION_STRING},
                       {"seed", args.stage.seed},
                       {"samples_per_pixel", render.samplesPerPixel},
                       {"noise_target", render.noiseTarget},
                       {"world_from_mesh", matrix}};
        if (capture) top["capture"] = captureText;
        job.splits.push_back({render, top.dump(-1, ' ', false, Json::error_handler_t::replace), nullptr, {}});
    }
    job.plan = std::move(plan);
    job.plan.path = args.output;
    job.shard = shard.index, job.shards = shard.count;
    return job;
}

/// The object in its own frame, and what it is made of.
struct StageObject {
    MeshScene mesh;
    uint64_t hash = 0;
    std::vector<SubsurfaceOverride> subsurface;
    std::optional<FurSettings> fur;
    HairStrands hair;
};

static Result<StageObject> loadObject(const SynthArguments& args)
{
    StageObject object;
    if (!args.fur.empty()) {
        const auto fur = parseFur(args.fur);
        if (!fur) return fur.error();
        object.fur = *fur;
        object.fur->seed = args.stage.seed;
    }
    auto mesh = readGltf(args.mesh);
    if (!mesh) return mesh.error();
    object.mesh = std::move(*mesh);
    for (const std::string& line : object.mesh.warnings) warn(line);
    const auto hash = hashMesh(args.mesh, object.mesh);
    if (!hash) return hash.error();
    object.hash = *hash;
    auto subsurface = readSubsurface(args, object.mesh);
    if (!subsurface) return subsurface.error();
    object.subsurface = std::move(*subsurface);
    if (object.fur) {
        auto hair = growFur(object.mesh, *object.fur); // in the mesh's own frame, where -Y is down
        if (!hair) return hair.error();
        object.hair = std::move(*hair);
    }
    return object;
}

/// Everything that pixels depend on; --splits, --shard and --threads are free to differ between runs.
static Result<SynthSettings> settingsOf(const SynthArguments& args, const StageWork& work, const StageObject& object, int testSamples,
                                        const std::optional<CaptureOptions>& capture)
{
    const StageOptions& s = args.stage;
    const bool own = args.like.empty();
    const auto ifOwn = [&](const std::string& value) { return own ? value : std::string(); };
    std::string scattering, maps;
    for (const SubsurfaceOverride& o : object.subsurface) scattering += (scattering.empty() ? "" : "; ") + textOf(o);
    for (const EnvironmentFile& map : work.maps) {
        const auto hash = hashMap(map);
        if (!hash) return hash.error();
        maps += (maps.empty() ? "" : "; ") + map.name + " " + hexText(*hash);
    }
    return SynthSettings{
        {"renderer", "nacre " NACRE_VERSION_STRING},
        {"mesh", fs::path(args.mesh).filename().string() + " " + hexText(object.hash)},
        {"--like", work.likeText},
        {"--convention", args.convention},
        {"--cameras", ifOwn(std::to_string(s.cameras))},
        {"--lights", ifOwn(std::to_string(s.lights))},
        {"--lights-per-camera", ifOwn(args.lightsPerCamera)},
        {"--layout", ifOwn(args.layout)},
        {"--hemisphere", ifOwn(args.hemisphere)},
        {"--radius", ifOwn(format("%.17g", s.lightRadius))},
        {"--camera-distance", ifOwn(format("%.17g", s.cameraDistance))},
        {"--fov", ifOwn(s.fovDegrees > 0 ? format("%.17g", s.fovDegrees) : "")},
        {"--size", own ? format("%dx%d", s.width, s.height) : args.size},
        {"--environment", maps},
        {"--spp", std::to_string(args.samples)},
        {"--test-spp", std::to_string(testSamples)},
        {"--noise", args.noise > 0 ? format("%.17g", args.noise) : ""},
        {"--seed", std::to_string(s.seed)},
        {"--indirect-roughness", format("%.9g", args.indirectRoughness)},
        {"--sss", scattering},
        {"--fur", object.fur ? textOf(*object.fur) : ""},
        {"--keep-scale", args.keepScale ? "yes" : "no"},
        {"--capture", capture ? textOf(*capture) : ""},
    };
}

/// With --keep-scale: whether positions and intensities of lights, which are float, can say what is meant.
static Status checkPlacement(const Placement& p)
{
    constexpr double kMostRounding = 1e-3; // of the radius: 0.01 degrees for lights five radii away
    constexpr double kSmallest = 1e-15, kLargest = 1e15; // intensities go with the square
    if (const double rounding = glm::length(p.center) * double(std::numeric_limits<float>::epsilon()); rounding > kMostRounding * p.radius)
        return Error{ErrorCode::kBadInput, format("--keep-scale: the mesh has a radius of %.3g m and lies %.4g m from the origin, where positions of lights "
                                                  "are rounded to %.2g m; leave --keep-scale out (world_from_mesh in the dataset keeps the place)",
                                                  p.radius, glm::length(p.center), rounding)};
    if (!(p.radius >= kSmallest && p.radius <= kLargest))
        return Error{ErrorCode::kBadInput, format("--keep-scale: the mesh has a radius of %.3g m, expected %g to %g; leave --keep-scale out", p.radius, kSmallest, kLargest)};
    return ok();
}

static Result<PathTracer> putOnStage(StageObject object, const Placement& placement, bool surroundings)
{
    StageScene scene;
    transformMesh(object.mesh, placement);
    transformHair(object.hair, placement);
    scene.mesh = std::move(object.mesh);
    scene.hair = std::move(object.hair);
    scene.subsurface = std::move(object.subsurface);
    scene.unitsPerMetre = float(placement.unitsPerMetre);
    if (surroundings) addSurroundings(scene);
    auto tracer = PathTracer::create(std::move(scene));
    if (tracer && !surroundings) // whose scene is there without them, too
        for (const std::string& line : tracer->warnings()) warn(line);
    return tracer;
}

/// Without --capture: nothing.
static Result<std::optional<CaptureOptions>> readCaptureOptions(SynthArguments& args)
{
    if (args.capture.empty()) return std::optional<CaptureOptions>();
    const auto capture = parseCapture(args.capture);
    if (!capture) return capture.error();
    if (args.convention != "canonical") return Error{ErrorCode::kBadInput, "--capture: only the canonical convention can say what is known of photographs"};
    if (capture->kind != CaptureKind::kPhone) return std::optional(*capture);
    if (!args.like.empty()) return Error{ErrorCode::kBadInput, "--capture phone chooses its own cameras and lights; leave --like out"};
    if (!args.hasCameras) args.stage.cameras = 500;
    return std::optional(*capture);
}

static Status runSynth(SynthArguments args)
{
    const std::atomic<bool>& stop = catchStopSignals();
    if (Status s = checkWritable(args.json); !s) return s;
    const auto shard = parseShard(args.shard);
    if (!shard) return shard.error();
    const auto testSamples = parseTestSamples(args.testSamples, args.samples);
    if (!testSamples) return testSamples.error();
    const bool own = args.like.empty();
    const auto capture = readCaptureOptions(args);
    if (!capture) return capture.error();
    if (own)
        if (Status s = readStageOptions(args); !s) return s;
    for (const std::string& map : args.stage.environments)
        if (Status s = checkMap(map); !s) return s;

    // The plan is made in the world of its source, then turned to the convention's; the mesh is put into that one.
    Result<StageWork> work = own ? StageWork{} : planLike(args);
    if (!work) return work.error();
    auto object = loadObject(args);
    if (!object) return object.error();
    if (own) {
        warnIfCut(args.stage);
        work = planOwn(args, placeMesh(object->mesh, object->hair, work->plan.up, !args.keepScale), *capture);
    }
    const auto settings = settingsOf(args, *work, *object, *testSamples, *capture);
    if (!settings) return settings.error();
    if (Status s = keepSplits(work->plan, args.splits); !s) return s;
    auto plan = fitToConvention(std::move(work->plan), args.convention);
    if (!plan) return plan.error();
    for (const std::string& line : plan->warnings) warn(line);
    if (Status s = checkDatasetFolder(args.output, *settings); !s) return s;

    const Placement placement = placeMesh(object->mesh, object->hair, plan->up, !args.keepScale);
    if (Status s = checkPlacement(placement); !s) return s;
    const size_t triangles = object->mesh.triangleCount(), fibres = object->hair.segmentCount();
    const bool photographed = *capture && !(*capture)->clean && plan->find("train");
    std::optional<PathTracer> withSurroundings;
    if (photographed && (*capture)->kind == CaptureKind::kPhone) {
        auto more = putOnStage(*object, placement, true);
        if (!more) return more.error();
        withSurroundings = std::move(*more);
    }
    const auto tracer = putOnStage(std::move(*object), placement, false);
    if (!tracer) return tracer.error();
    std::shared_ptr<const Capture> taken;
    if (photographed) {
        taken = std::make_shared<const Capture>(planCapture(**capture, *plan, placement.center, placement.radius, args.stage.seed));
    }

    if (Status s = claimDatasetFolder(args.output, *settings); !s) return s;
    if (Status s = writeMaps(args.output, *plan, work->maps); !s) return s;
    SynthJob job = makeJob(args, std::move(*plan), placement, *testSamples, *shard, *capture);
    Progress progress;
    size_t done = 0, count = 0;
    const auto renderWith = [&placement](const PathTracer& scene) -> StageRender {
        return [&](const Camera& camera, std::span<const Light> lights, const RenderSettings& s, RenderStats* stats) {
            std::vector<Light> staged;
            for (const Light& light : lights) staged.push_back(onStage(light, placement));
            return scene.render(onStage(camera, placement), staged, s, stats);
        };
    };
    if (taken) {
        const auto train = size_t(job.plan.find("train") - job.plan.splits.data());
        job.splits[train].capture = taken;
        if (withSurroundings) job.splits[train].renderer = renderWith(*withSurroundings);
        const std::string truth = truthText(*taken, job.plan.splits[train]);
        if (Status s = writeFileAtomically((fs::path(args.output) / "truth.json").string(), std::as_bytes(std::span(truth))); !s) return s;
    }
    const auto show = [&](const SynthProgress& p) {
        done = p.imagesDone, count = p.imageCount;
        progress.show(format("synth %zu/%zu images, split %s, %s left", done, count, p.split.c_str(), clockText(p.secondsLeft).c_str()));
    };
    const auto report = synthesise(job, renderWith(*tracer), show, &stop);
    progress.clear();
    if (!report) {
        if (report.error().code != ErrorCode::kCancelled) return report.error();
        return stoppedBySignal(format("%zu of %zu images are in '%s'; give the same command again to go on", done, count, args.output.c_str()));
    }
    warnAbout(*report);
    const Totals totals = totalsOf(*report);
    printReport(args, *report, totals);
    if (args.json.empty()) return ok();
    Json json = reportJson(args, *report, totals);
    json["triangles"] = triangles;
    json["fibres"] = fibres;
    json["scene_bytes"] = tracer->memoryBytes();
    return writeJson(json, args.json);
}

Action addSynth(CLI::App& app)
{
    auto args = std::make_shared<SynthArguments>();
    StageOptions& s = args->stage;
    std::vector<std::string> conventions(writableConventions().begin(), writableConventions().end());

    CLI::App* sub = app.add_subcommand("synth", "Render an OLAT dataset of a glTF mesh (light stage)");
    sub->add_option("MESH", args->mesh, "glTF 2.0 mesh (.glb or .gltf)")->required();
    sub->add_option("-o,--output", args->output, "Folder of the dataset; one that was begun before is completed")->required();
    auto* like = sub->add_option("--like", args->like, "Take cameras, lights and splits from this dataset instead");
    const auto ofStage = [&](CLI::Option* option) { return option->excludes(like); };
    auto* cameras = sub->add_option("--cameras", s.cameras, "Cameras of train (--capture phone: 500)");
    ofStage(cameras->check(wholeNumber(1, 1000000))->capture_default_str());
    ofStage(sub->add_option("--lights", s.lights, "Lights of the stage")->check(wholeNumber(1, 1000000))->capture_default_str());
    ofStage(sub->add_option("--lights-per-camera", args->lightsPerCamera, "Images of each train camera, or 'all'")->capture_default_str());
    ofStage(sub->add_option("--layout", args->layout, "Where the lights are: rings of equal size, equal areas, or a grid of equal areas")
                ->check(CLI::IsMember({"rings", "fibonacci", "grid"}))->capture_default_str());
    ofStage(sub->add_option("--hemisphere", args->hemisphere, "Lights above the horizon and cameras down to just below it, or all around")
                ->check(CLI::IsMember({"upper", "full"}))->capture_default_str());
    ofStage(sub->add_option("--radius", s.lightRadius, "Distance of the lights, in radii of the object")->check(numberBetween(2, 1e6))->capture_default_str());
    ofStage(sub->add_option("--camera-distance", s.cameraDistance, "Distance of the cameras, in radii of the object")
                ->check(numberBetween(1.05, 1e6))->capture_default_str());
    ofStage(sub->add_option("--fov", s.fovDegrees, "Horizontal field of view, degrees (default: the object fills the picture)")
                ->check(numberBetween(0.1, 170)));
    ofStage(sub->add_option("--environment", s.environments, "Equirectangular EXR for the split environment; repeat for more\n"
                                                             "(default: two built-in maps, a sunset and a studio)")->allow_extra_args(false));
    sub->add_option("--size", args->size, "Pixels of a square or WxH (default: 256, with --like as there)");
    sub->add_option("--splits", args->splits, "Only these, with commas between: train,test,near,directional,environment,all_on (default: all; with --like: those of OTHER);\n"
                                              "a later run with the same options adds others to the folder")->delimiter(',')->allow_extra_args(false);
    sub->add_option("--spp", args->samples, "Samples per pixel of train and all_on, rounded up to a multiple of 16")
        ->check(wholeNumber(1, 1 << 20))->capture_default_str();
    sub->add_option("--test-spp", args->testSamples, "Samples of the other splits: a number or a multiple of --spp")->capture_default_str();
    sub->add_option("--noise", args->noise, "Stop sampling a camera when the relative noise of its images is below this (test splits: half of it);\n"
                                            "--spp is then the most it may take")->check(positiveNumber());
    sub->add_option("--indirect-roughness", args->indirectRoughness,
                    "What a diffuse surface sees counts as at least this rough: blurs caustics, which would be noise; 0: unbiased")
        ->check(numberBetween(0, 1))->capture_default_str();
    sub->add_option("--seed", s.seed, "Same options and seed: same files")->check(wholeNumber(0, 1ll << 53))->capture_default_str();
    sub->add_option("--threads", args->threads, "0: all cores; the result does not depend on it")->check(wholeNumber(0, 4096))->capture_default_str();
    sub->add_option("--convention", args->convention, "How the dataset is written")->check(CLI::IsMember(conventions))->capture_default_str();
    sub->add_option("--shard", args->shard, "I/N: render every N-th camera only, e.g. on N machines that share the folder");
    sub->add_option("--sss", args->subsurface, "MATERIAL:albedo=r,g,b:mfp=r,g,b:g=0:boundary=diffuse|none|dielectric makes a material scatter light\n"
                                               "inside: diffuse albedo (or alpha=, single scattering), mean free path in metres;\n"
                                               "one number stands for three, repeat for more materials, * is all")->allow_extra_args(false);
    sub->add_option("--sss-file", args->subsurfaceFile, "The same as JSON: [{\"material\": ..., \"albedo\": ..., \"mfp\": ...}]");
    sub->add_option("--fur", args->fur, "DENSITY,LENGTH,RADIUS: grow fibres, per square metre and in metres, coloured as the surface beneath;\n"
                                        "then :material=NAME, :variation=, :tip=, :lean=, :disorder=, :clump=, each 0 to 1");
    sub->add_option("--capture", args->capture, "stage | phone, then :KEY=VALUE,...: photographs in place of renders for train, with errors of stated sizes; the truth\n"
                                                "goes to truth.json\n" + captureKeys());
    sub->add_flag("--keep-scale", args->keepScale, "Leave the mesh in its own units and place; else its bounding sphere becomes the unit sphere");
    sub->add_option("--json", args->json, "Write the figures of the report to this file");
    return [args, cameras] {
        args->hasCameras = cameras->count() > 0;
        return runSynth(*args);
    };
}

} // namespace nacre::cli
