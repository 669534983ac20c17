// nacre render: an asset from any camera under any lights, as one image or as a turn of frames.
#include "cli.h"

#include "eval/channel_pictures.h"
#include "eval/contact_sheet.h"
#include "eval/evaluate.h"
#include "interchange/exr.h"
#include "interchange/png.h"
#include "scene_spec.h"

#include <cstdio>
#include <filesystem>
#include <numbers>

namespace nacre::cli {

struct RenderArguments {
    std::string asset, output, size, camera, orbit, spin = "light", channel;
    RendererOption renderer;
    ThreadsOption threads;
    std::vector<std::string> lights, edits;
    double fovYDegrees = 40;
    int frames = 1;
};

struct Scene {
    Camera camera;
    std::vector<Light> lights; // point and directional
};

static Status addLight(const Light& light, std::vector<Light>& lights)
{
    const auto expanded = rendererLights(light);
    if (!expanded) return expanded.error();
    lights.insert(lights.end(), expanded->begin(), expanded->end());
    return ok();
}

/// White light from the upper left of the camera; a white diffuse surface that faces it would reach radiance 1.
static Light defaultLight(const Camera& camera, const Subject& subject)
{
    const glm::dmat3 axes(camera.worldFromCamera);
    const double distance = glm::length(camera.position() - subject.center);
    const glm::dvec3 fromSubject = axes[2] - 0.7 * axes[0] + 0.7 * axes[1];
    Light light;
    light.position = subject.center + distance * fromSubject;
    light.intensity = glm::vec3(std::numbers::pi * distance * distance * glm::dot(fromSubject, fromSubject));
    return light;
}

static Result<Scene> buildScene(const RenderArguments& args, const SplatAsset& asset, const Subject& subject)
{
    PixelSize size{512, 512};
    if (!args.size.empty()) {
        const auto parsed = parseSize(args.size);
        if (!parsed) return parsed.error();
        size = *parsed;
    }
    Scene scene;
    for (const std::string& text : args.lights) {
        auto light = parseLight(text);
        if (!light) return light.error();
        if (light->type == LightType::kEnvironment) light->directionToLight = subject.up;
        if (Status s = addLight(*light, scene.lights); !s) return s.error();
    }
    if (args.camera.empty()) {
        Orbit orbit;
        if (!args.orbit.empty()) {
            const auto parsed = parseOrbit(args.orbit);
            if (!parsed) return parsed.error();
            orbit = *parsed;
        }
        scene.camera = orbitCamera(orbit, subject, asset.yUpFromAsset, args.fovYDegrees, size);
    } else {
        const auto reference = parseImageReference(args.camera);
        if (!reference) return reference.error();
        const auto dataset = openDataset(reference->dataset);
        if (!dataset) return dataset.error();
        const auto split = findSplit(*dataset, reference->split);
        if (!split) return split.error();
        const std::vector<OlatImage>& images = (*split)->images;
        if (reference->index >= images.size())
            return Error{ErrorCode::kBadInput, format("--camera '%s': split '%s' has images 0 to %zu", args.camera.c_str(),
                                                      reference->split.c_str(), images.size() - 1)};
        const OlatImage& image = images[reference->index];
        scene.camera = (*split)->cameras[image.camera];
        if (!args.size.empty()) scene.camera = resized(scene.camera, size);
        if (args.lights.empty())
            if (Status s = addLight(image.light, scene.lights); !s) return s.error();
    }
    if (scene.lights.empty()) {
        const Light light = defaultLight(scene.camera, subject);
        scene.lights.push_back(light);
        std::printf("no --light given: --light point:%g,%g,%g:%g\n", light.position.x, light.position.y, light.position.z, light.intensity.x);
    }
    return scene;
}

static Status writeFrame(const Image& image, const std::filesystem::path& path)
{
    if (path.extension() == ".exr") return writeExr(image, path.string());
    const Picture picture = displayPicture(image);
    return writePng(path.string(), picture.width, picture.height, 3, picture.rgb);
}

/// turn.png -> turn_0007.png
static std::filesystem::path frameName(const std::filesystem::path& output, int frame, int frames)
{
    if (frames == 1) return output;
    return output.parent_path() / (output.stem().string() + format("_%04d", frame) + output.extension().string());
}

static Result<std::vector<SplatEdit>> parseEdits(const RenderArguments& args)
{
    std::vector<SplatEdit> edits;
    for (const std::string& text : args.edits) {
        const auto edit = parseEdit(text);
        if (!edit) return edit.error();
        edits.push_back(*edit);
    }
    return edits;
}

/// --channel NAME: its numbers (.exr) or a picture of them (.png). --channel all: a sheet of the pictures (.png).
static Status runChannels(const RenderArguments& args)
{
    const auto threads = limitThreads(args.threads.count);
    const bool all = args.channel == "all", numbers = std::filesystem::path(args.output).extension() == ".exr";
    if (!numbers && std::filesystem::path(args.output).extension() != ".png")
        return Error{ErrorCode::kBadInput, "-o '" + args.output + "': the name must end in .exr (numbers) or .png (for eyes)"};
    if (all && numbers) return Error{ErrorCode::kBadInput, "-o '" + args.output + "': --channel all writes one sheet, a .png; .exr takes one channel by its name"};
    if (Status s = checkWritable(args.output); !s) return s;
    const auto file = openAsset(args.asset);
    if (!file) return file.error();
    const auto scene = buildScene(args, file->asset, findSubject(file->asset));
    if (!scene) return scene.error();
    const auto edits = parseEdits(args);
    if (!edits) return edits.error();
    if (all) {
        const auto channels = channelPictures(file->asset, scene->camera, scene->lights, *edits);
        if (!channels) return channels.error();
        const Picture sheet = channelSheet(*channels);
        if (Status s = writePng(args.output, sheet.width, sheet.height, 3, sheet.rgb); !s) return s;
        std::printf("%s: %zu channels, %dx%d each\n", args.output.c_str(), channels->size(), scene->camera.width, scene->camera.height);
        for (const ChannelPicture& c : *channels) std::printf("  %-15s %s\n", c.name.c_str(), c.scale.c_str());
        return ok();
    }
    const auto channel = channelPicture(file->asset, args.channel, scene->camera, scene->lights, *edits);
    if (!channel) return channel.error();
    const Picture& picture = channel->picture;
    if (Status s = numbers ? writeExr(channel->values, args.output) : writePng(args.output, picture.width, picture.height, 3, picture.rgb); !s) return s;
    std::printf("%s: %s, %s\n", args.output.c_str(), args.channel.c_str(), numbers ? "its numbers" : channel->scale.c_str());
    return ok();
}

static Status runRender(const RenderArguments& args)
{
    if (!args.channel.empty()) return runChannels(args);
    const std::atomic<bool>& stop = catchStopSignals();
    const auto threads = limitThreads(args.threads.count);
    const std::filesystem::path output(args.output);
    if (output.extension() != ".exr" && output.extension() != ".png")
        return Error{ErrorCode::kBadInput, "-o '" + args.output + "': the name must end in .exr (linear) or .png (sRGB)"};
    if (Status s = checkWritable(args.output); !s) return s;
    const auto file = openAsset(args.asset);
    if (!file) return file.error();
    const Subject subject = findSubject(file->asset);
    const auto scene = buildScene(args, file->asset, subject);
    if (!scene) return scene.error();
    const auto renderer = args.renderer.make(*file);
    if (!renderer) return renderer.error();

    const auto edits = parseEdits(args);
    if (!edits) return edits.error();
    if (Status s = (*renderer)->setEdits(*edits); !s) return s;

    Progress progress;
    const auto start = std::chrono::steady_clock::now();
    for (int frame = 0; frame < args.frames; ++frame) {
        if (stop) return stoppedBySignal(format("%d of %d frames were written", frame, args.frames));
        const glm::dmat4 spin = spinMatrix(subject, 2 * std::numbers::pi * frame / args.frames);
        const bool spinCamera = args.spin == "camera" && frame > 0, spinLight = args.spin == "light" && frame > 0;
        std::vector<Light> lights = scene->lights;
        if (spinLight)
            for (Light& light : lights) light = spun(light, spin);
        const auto image = (*renderer)->render(spinCamera ? spun(scene->camera, spin) : scene->camera, lights);
        if (!image) return image.error();
        if (Status s = writeFrame(*image, frameName(output, frame, args.frames)); !s) return s;
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        progress.show(format("render %d/%d, %s left", frame + 1, args.frames,
                             clockText(seconds / (frame + 1) * (args.frames - frame - 1)).c_str()));
    }
    progress.clear();
    std::printf("%s%s: %dx%d, %zu lights, drawn by %s\n", frameName(output, 0, args.frames).string().c_str(),
                args.frames > 1 ? format(" and %d more", args.frames - 1).c_str() : "", scene->camera.width, scene->camera.height,
                scene->lights.size(), (*renderer)->description().c_str());
    return ok();
}

Action addRender(CLI::App& app)
{
    auto args = std::make_shared<RenderArguments>();
    CLI::App* sub = app.add_subcommand("render", "Draw an asset from a camera under lights of your choice");
    sub->add_option("ASSET", args->asset, "Asset (.glb)")->required();
    sub->add_option("-o,--output", args->output, "Image to write: .exr (linear, with alpha) or .png (sRGB over black)")->required();
    sub->add_option("--size", args->size, "Image size WIDTHxHEIGHT in pixels (default: that of --camera, else 512x512)");
    auto* camera = sub->add_option("--camera", args->camera, "DATASET:SPLIT:INDEX, the camera of an image; its light too if there is no --light");
    sub->add_option("--orbit", args->orbit,
                                  "AZ,EL[,DIST]: azimuth and elevation in degrees, distance in units of the dataset from the middle of the\n"
                                  "object (default: 30,20 at a distance that shows all of it)")->excludes(camera);
    sub->add_option("--fov", args->fovYDegrees, "Vertical field of view of --orbit, degrees, 1 to 170")->check(numberBetween(1, 170))
        ->excludes(camera)->capture_default_str();
    sub->add_option("--light", args->lights,
                    "May be repeated; in axes and units of the dataset. I, E: a number or r,g,b\n"
                    "  point:X,Y,Z:I          radiant intensity: irradiance I / distance^2\n"
                    "  directional:X,Y,Z:E    direction to the light, irradiance\n"
                    "  environment:FILE.exr   equirectangular radiance, its zenith at the asset's up, as 128 directional lights")
        ->allow_extra_args(false)->take_all();
    sub->add_option("--edit", args->edits,
                    "May be repeated; changes materials of an asset of the model sss:\n"
                    "  TARGET=VALUE or TARGET=xFACTOR, TARGET one of basecolor, roughness, metalness, subsurface, opacity (0 to 1)\n"
                    "  and residual, also called tint (factor of the light from beneath the surface); VALUE a number or r,g,b\n"
                    "  then perhaps @sphere:X,Y,Z,R or @box:X,Y,Z,X,Y,Z, in axes and units of the dataset: only there")
        ->allow_extra_args(false)->take_all();
    CLI::Option* channel = sub->add_option("--channel", args->channel,
                    "What the image is made of, by scalar code on the CPU: a part of the asset by its name, or \"all\": one labelled sheet of all that it has\n"
                    "  bigs: direct, indirect, lobe, forward (light: they add up to the image); rho; T_dir, T_ind, s, visibility\n"
                    "  sss:  specular, diffuse, scattered (light: they add up to the image); basecolor, roughness, metalness,\n"
                    "        subsurfaceness; incident (share of the light that arrives), residual (scattered per irradiance)\n"
                    "  both: normal, depth (distance from the camera), overdraw (splats blended in a pixel)\n"
                    "  .exr: the numbers, light premultiplied, all else divided by coverage; .png: black to white as the output says.\n"
                    "  Under several lights, transports, visibility, incident and residual are means weighted by irradiance");
    sub->add_option("--frames", args->frames, "More than 1: OUT_0000.png, OUT_0001.png, ... of one turn about the up axis")
        ->check(wholeNumber(1, 100000))->capture_default_str()->excludes(channel);
    sub->add_option("--spin", args->spin, "What turns with --frames")->check(CLI::IsMember({"light", "camera"}))->capture_default_str();
    args->renderer.addTo(*sub);
    channel->excludes(sub->get_option("--renderer"));
    args->threads.addTo(*sub);
    return [args] { return runRender(*args); };
}

} // namespace nacre::cli
