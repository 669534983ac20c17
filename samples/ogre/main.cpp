// Splats in an OGRE scene: several objects under OGRE's lights and shadow maps, which move. See kUsage.
#include "nacre_ogre.h"
#include "ogre_scene.h"

#include <OgreWindowEventUtilities.h>

#include <chrono>
#include <cstdio>
#include <cstring>

constexpr const char* kUsage = "usage: ogre ASSET.glb... [options]\n"
                               "  --size WIDTHxHEIGHT   in pixels (960x720)\n"
                               "  --headless OUT.png    no window to be seen (there must be a display, xvfb-run makes one): write the last frame\n"
                               "  --frames N            end after N frames (headless: 30, a thirtieth of a second apart)\n";

struct Arguments {
    std::vector<std::string> assets;
    std::string picture;
    int width = 960, height = 720, frames = 0;
};

static int fail(int code, const std::string& text)
{
    std::fprintf(stderr, "ogre: error: %s\n", text.c_str());
    return code;
}

/// Empty, or what is wrong.
static std::string parse(int argc, char** argv, Arguments* args)
{
    for (int i = 1; i < argc; ++i) {
        const std::string option = argv[i];
        if (option[0] != '-') {
            args->assets.push_back(option);
            continue;
        }
        if (i + 1 == argc) return option + ": unknown, or it needs a value";
        const char* value = argv[++i];
        int used = -1;
        if (option == "--headless") args->picture = value;
        else if (option == "--frames" && std::sscanf(value, "%6d%n", &args->frames, &used) == 1 && !value[used] && args->frames > 0) continue;
        else if (option == "--size" && std::sscanf(value, "%5dx%5d%n", &args->width, &args->height, &used) == 2 && !value[used] &&
                 std::min(args->width, args->height) >= 16 && std::max(args->width, args->height) <= 8192) continue;
        else return option + " '" + value + "': unknown, or not a value it takes";
    }
    return args->assets.empty() ? "no asset" : "";
}

/// sRGB, without tone mapping.
static void writePicture(const OgreScene& scene, const std::string& path)
{
    const std::vector<float> rgba = scene.pixels();
    std::vector<Ogre::uint8> rgb;
    for (size_t i = 0; i < rgba.size(); ++i) {
        if (i % 4 == 3) continue;
        const float c = std::clamp(rgba[i], 0.0f, 1.0f);
        rgb.push_back(Ogre::uint8(255 * (c < 0.0031308f ? 12.92f * c : 1.055f * std::pow(c, 1 / 2.4f) - 0.055f) + 0.5f));
    }
    Ogre::Image image;
    image.loadDynamicImage(rgb.data(), scene.target->getWidth(), scene.target->getHeight(), Ogre::PF_BYTE_RGB);
    image.save(path);
}

static void run(const Arguments& args)
{
    OgreScene scene(args.width, args.height, !args.picture.empty());
    NacreOgre nacre(scene.manager, OgreScene::getProcAddress);
    std::vector<NacreAsset> assets;
    for (const std::string& path : args.assets) assets.push_back(nacre.load(Ogre::Root::openFileStream(path)));
    const Ogre::Vector3 places[] = {{-1.2f, 0, 0.2f}, {-0.1f, 0, -0.1f}, {0.9f, 0, -0.1f}, {-0.75f, 0, -1.1f}, {0.5f, 0, -1.2f}};
    for (size_t i = 0; i < std::max(std::size(places), assets.size()); ++i)
        scene.stand(nacre.createObject(assets[i % assets.size()]), places[i % std::size(places)], 0.8f, Ogre::Degree(50.0f * i));

    if (!args.picture.empty()) {
        for (int i = 0; i < (args.frames ? args.frames : 30); ++i) scene.setTime(i / 30.0), scene.render();
        return writePicture(scene, args.picture);
    }
    OgreBites::WindowEventUtilities::_addRenderWindow(scene.window);
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; !scene.window->isClosed() && (args.frames == 0 || i < args.frames); ++i) {
        OgreBites::WindowEventUtilities::messagePump();
        scene.setTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
        scene.render();
    }
}

int main(int argc, char** argv)
{
    Arguments args;
    if (argc == 2 && !std::strcmp(argv[1], "--help")) return std::fputs(kUsage, stdout), 0;
    if (const std::string wrong = parse(argc, argv, &args); !wrong.empty()) return fail(2, wrong + "; ogre --help tells what there is");
    try {
        run(args);
    } catch (const std::exception& e) { // OGRE's are
        return fail(1, e.what());
    }
    return 0;
}
