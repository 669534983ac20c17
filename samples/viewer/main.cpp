// An interactive host of the Nacre runtime: arguments, window, asset and the loop over frames. See kUsage.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include "display.h"
#include "scene.h"

#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>

using namespace viewer;

constexpr const char* kUsage = "usage: viewer ASSET.glb [options]\n"
                               "  --edit TARGET=VALUE[@REGION]  change a material, as in nacre render; may be repeated\n"
                               "  --size WIDTHxHEIGHT           of the window in pixels (1280x800)\n"
                               "  --no-panel                    only the picture (H shows the panel)\n"
                               "  --frames N                    end after N frames\n"
                               "  --screenshot FILE.ppm         no window: write the last of N (3) frames\n";

struct Arguments {
    std::string asset, screenshot;
    std::vector<NacreEdit> edits;
    int width = 1280, height = 800;
    int frames = 0; // 0: until the window is closed
    bool panel = true;
};

/// Code 1: the work failed, 2: bad arguments, bad asset or no display.
static int fail(int code, const std::string& text)
{
    std::fprintf(stderr, "viewer: error: %s\n", text.c_str());
    return code;
}

/// Empty, or what is wrong.
static std::string parseValue(const std::string& option, const char* value, Arguments* args)
{
    const std::string bad = option + " '" + value + "': expected ";
    const int length = int(std::strlen(value));
    int used = -1;
    if (option == "--edit") {
        NacreEdit edit;
        if (!parseEdit(value, &edit)) return bad + "what nacre render --edit takes, e.g. roughness=0.5 or basecolor=x1,0.5,0.5@sphere:X,Y,Z,R";
        args->edits.push_back(edit);
    } else if (option == "--size") {
        if (std::sscanf(value, "%5dx%5d%n", &args->width, &args->height, &used) != 2 || used != length ||
            std::min(args->width, args->height) < 16 || std::max(args->width, args->height) > 8192)
            return bad + "WIDTHxHEIGHT in pixels, 16 to 8192";
    } else if (option == "--frames") {
        if (std::sscanf(value, "%9d%n", &args->frames, &used) != 1 || used != length || args->frames < 1)
            return bad + "a number of frames, 1 or more";
    } else {
        args->screenshot = value;
        if (!args->screenshot.ends_with(".ppm")) return bad + "a name that ends in .ppm";
    }
    return {};
}

static std::string parseArguments(int argc, char** argv, Arguments* args)
{
    for (int i = 1; i < argc; ++i) {
        const std::string option = argv[i];
        if (option == "--no-panel") {
            args->panel = false;
        } else if (option == "--edit" || option == "--size" || option == "--frames" || option == "--screenshot") {
            if (++i == argc) return option + " needs a value; see viewer --help";
            if (std::string wrong = parseValue(option, argv[i], args); !wrong.empty()) return wrong;
        } else if (option.starts_with("-") || !args->asset.empty()) {
            return "unknown argument '" + option + "'; see viewer --help";
        } else {
            args->asset = option;
        }
    }
    if (args->asset.empty()) return "no asset given; see viewer --help";
    if (!args->screenshot.empty() && args->frames == 0) args->frames = 3; // in the first two the panel finds its layout
    return {};
}

static bool readFile(const std::string& path, std::vector<char>* bytes)
{
    std::error_code error;
    const auto size = std::filesystem::file_size(path, error); // of a folder: an error
    if (error) return false;
    bytes->resize(size);
    return bool(std::ifstream(path, std::ios::binary).read(bytes->data(), std::streamsize(size)));
}

/// What lasts from frame to frame.
struct Viewer {
    GLFWwindow* window = nullptr;
    NacreContext context{};
    NacreAsset asset{};
    NacreInstance instance{};
    NacreView view{};
    std::string lastError; // of the runtime
    Display display;
    Scene scene;
    Status status;
    PanelState panel;
    bool showPanel = true;
    float panelWidth = 390;       // in the window's coordinates
    std::vector<NacreEdit> edits; // that the runtime has
    std::vector<float> times;     // ms of the last frames, a ring
};

static void onKey(GLFWwindow* window, int key, int, int action, int)
{
    Viewer& v = *static_cast<Viewer*>(glfwGetWindowUserPointer(window));
    if (action != GLFW_PRESS || ImGui::GetIO().WantTextInput) return;
    if (key == GLFW_KEY_R) v.panel.reset = true;
    if (key == GLFW_KEY_H) v.showPanel = !v.showPanel;
}

/// False with GLFW's reason in lastError.
static bool openWindow(const Arguments& args, Viewer& v)
{
    if (glfwInit()) {
        glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
        glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
        glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
        glfwWindowHint(GLFW_VISIBLE, args.screenshot.empty());
        v.window = glfwCreateWindow(args.width, args.height, "Nacre viewer", nullptr, nullptr);
    }
    if (!v.window) {
        const char* reason = nullptr;
        glfwGetError(&reason);
        v.lastError = reason ? reason : "no reason given";
        return false;
    }
    glfwMakeContextCurrent(v.window);
    glfwSwapInterval(args.screenshot.empty() ? 1 : 0);
    glfwSetWindowUserPointer(v.window, &v);
    glfwSetKeyCallback(v.window, onKey); // ImGui's is installed later and calls it

    ImGui::CreateContext();
    ImGui::GetIO().IniFilename = nullptr; // leaves no file behind
    float scale = 1; // the built-in font stays sharp at whole ones
    glfwGetWindowContentScale(v.window, &scale, nullptr);
    scale = std::max(std::floor(scale), 1.0f);
    ImGui::GetIO().FontGlobalScale = scale;
    ImGui::GetStyle().ScaleAllSizes(scale);
    v.panelWidth *= scale;
    ImGui_ImplGlfw_InitForOpenGL(v.window, true);
    ImGui_ImplOpenGL3_Init("#version 330");
    return true;
}

static void closeWindow(Viewer& v)
{
    if (v.window) {
        ImGui_ImplOpenGL3_Shutdown();
        ImGui_ImplGlfw_Shutdown();
        ImGui::DestroyContext();
    }
    glfwTerminate();
}

/// Returns an exit code; 0: loaded.
static int loadAsset(const Arguments& args, const std::vector<char>& bytes, Viewer& v)
{
    NacreContextDesc desc{};
    desc.structSize = sizeof desc;
    desc.getProcAddress = [](const char* name, void*) { return reinterpret_cast<void*>(glfwGetProcAddress(name)); };
    desc.message = [](NacreSeverity severity, const char* text, void* user) {
        if (severity == NACRE_ERROR) static_cast<Viewer*>(user)->lastError = text;
        if (severity == NACRE_WARNING) std::fprintf(stderr, "viewer: warning: %s\n", text);
    };
    desc.messageUser = &v;
    if (nacreContextCreate(&desc, &v.context) != NACRE_OK) return fail(2, v.lastError);
    const NacreResult result = nacreAssetCreate(v.context, bytes.data(), bytes.size(), &v.asset);
    if (result != NACRE_OK) return fail(result == NACRE_ERROR_BAD_ASSET ? 2 : 1, args.asset + ": " + v.lastError);
    NacreInstanceDesc instance{};
    instance.structSize = sizeof instance, instance.asset = v.asset;
    if (nacreInstanceCreate(&instance, &v.instance) != NACRE_OK || nacreViewCreate(v.context, nullptr, &v.view) != NACRE_OK) return fail(1, v.lastError);

    v.status.asset = args.asset;
    v.status.info.structSize = sizeof v.status.info;
    v.status.draw.structSize = sizeof v.status.draw;
    if (nacreAssetGetInfo(v.asset, &v.status.info) != NACRE_OK) return fail(1, v.lastError);
    v.scene.subject = findSubject(v.status.info);
    std::vector<NacreEdit> edits; // of the command line
    for (const NacreEdit& edit : args.edits) edits.push_back(inAsset(v.scene.subject, edit));
    // Edits are for assets with materials; the runtime says which those are when asked for an edit, be it one that changes nothing.
    v.edits = edits;
    if (v.edits.empty()) v.edits = {{NACRE_EDIT_ROUGHNESS, NACRE_EDIT_MULTIPLY, {1, 1, 1}, NACRE_REGION_EVERYWHERE, {}, {}}};
    if (nacreInstanceSetEdits(v.instance, v.edits.data(), v.edits.size()) != NACRE_OK) {
        if (!args.edits.empty()) return fail(2, args.asset + ": " + v.lastError);
        v.status.noEdits = v.lastError;
        v.edits.clear();
    }

    v.scene.lamps = defaultLamps(homeOrbit(v.scene.subject, 1));
    for (const NacreEdit& edit : edits) addEdit(edit, &v.scene.edits);
    return 0;
}

/// Left drag turns the camera, right drag moves the chosen light, the wheel goes closer.
static void handleMouse(Viewer& v)
{
    const ImGuiIO& io = ImGui::GetIO();
    if (io.WantCaptureMouse) return;
    const auto turn = [&](float& azimuth, float& elevation, float sign) {
        constexpr float kDegreesPerPixel = 0.4f;
        azimuth = std::remainder(azimuth + sign * kDegreesPerPixel * io.MouseDelta.x, 360.0f);
        elevation = std::clamp(elevation - sign * kDegreesPerPixel * io.MouseDelta.y, -90.0f, 90.0f);
    };
    Orbit& camera = v.scene.camera;
    std::vector<Lamp>& lamps = v.scene.lamps;
    if (io.MouseDown[0]) turn(camera.azimuth, camera.elevation, -1);
    if (io.MouseDown[1] && v.panel.lamp < lamps.size()) turn(lamps[v.panel.lamp].azimuth, lamps[v.panel.lamp].elevation, 1);
    const float r = v.scene.subject.radius;
    camera.distance = std::clamp(camera.distance * std::pow(0.9f, io.MouseWheel), 0.3f * r, 30 * r);
}

/// The runtime relights only if lights changed, but takes every list of edits for a change.
static bool drawSplats(Viewer& v)
{
    std::vector<NacreLight> lights;
    for (const Lamp& lamp : v.scene.lamps) lights.push_back(toNacre(lamp, v.scene.camera, v.scene.subject));
    if (nacreContextSetLights(v.context, lights.data(), lights.size()) != NACRE_OK) return false;

    const std::vector<NacreEdit> edits = toNacre(v.scene.edits);
    const bool same = edits.size() == v.edits.size() &&
                      (edits.empty() || std::memcmp(edits.data(), v.edits.data(), edits.size() * sizeof edits[0]) == 0);
    if (!same && nacreInstanceSetEdits(v.instance, edits.data(), edits.size()) != NACRE_OK) return false;
    v.edits = edits;

    nacreContextSetProfiling(v.context, v.panel.profiling);
    const NacreDrawDesc desc = drawDesc(v.scene.subject, v.scene.camera, v.display.radiance.width, v.display.radiance.height);
    return nacreViewDraw(v.view, &desc) == NACRE_OK && nacreViewGetStats(v.view, &v.status.draw) == NACRE_OK;
}

/// False: there is nothing to draw on, or the runtime could not (status.trouble).
static bool drawFrame(Viewer& v)
{
    int width = 0, height = 0, windowWidth = 0, windowHeight = 0;
    glfwGetFramebufferSize(v.window, &width, &height);
    glfwGetWindowSize(v.window, &windowWidth, &windowHeight);
    const float panelWidth = v.showPanel ? std::min(v.panelWidth, 0.5f * float(windowWidth)) : 0;
    const int left = int(panelWidth * float(width) / float(std::max(windowWidth, 1)));
    if (width <= left || height < 1) return false; // minimised

    ImGui_ImplOpenGL3_NewFrame();
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
    if (v.showPanel) drawPanel(v.scene, v.status, v.panel, panelWidth);
    handleMouse(v);
    ImGui::Render();
    if (v.panel.reset) v.scene.camera = homeOrbit(v.scene.subject, float(width - left) / float(height));
    v.panel.reset = false;

    beginSplats(v.display, width - left, height);
    const bool drawn = drawSplats(v);
    v.status.trouble = drawn ? "" : v.lastError;
    tonemap(v.display, left, width, height, std::exp2(v.scene.exposureStops), v.scene.background);
    ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
    copyToWindow(v.display);
    return drawn;
}

static void keepTime(Viewer& v, int frame, float ms)
{
    constexpr size_t kFrames = 60;
    if (v.times.size() < kFrames) v.times.push_back(0);
    v.times[size_t(frame) % v.times.size()] = ms;
    float sum = 0;
    for (const float t : v.times) sum += t;
    v.status.lastMs = ms, v.status.meanMs = sum / float(v.times.size());
}

static int run(const Arguments& args, Viewer& v)
{
    std::vector<char> bytes;
    if (!readFile(args.asset, &bytes)) return fail(2, "cannot read '" + args.asset + "'");
    if (!openWindow(args, v)) return fail(2, "cannot open a window with OpenGL 3.3: " + v.lastError);
    if (const int code = loadAsset(args, bytes, v)) return code;
    bytes = {};
    if (!createDisplay(&v.display)) return fail(1, "the shader of the display does not compile");
    v.showPanel = args.panel;
    v.panel.reset = true;
    bool drawn = true;
    for (int frame = 0; !glfwWindowShouldClose(v.window) && (args.frames == 0 || frame < args.frames); ++frame) {
        glfwPollEvents();
        const auto start = std::chrono::steady_clock::now();
        drawn = drawFrame(v);
        keepTime(v, frame, std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - start).count());
        glfwSwapBuffers(v.window);
    }
    if (args.screenshot.empty()) return 0;
    if (!drawn) return fail(1, v.lastError);
    return writePpm(v.display, args.screenshot) ? 0 : fail(1, "cannot write '" + args.screenshot + "'");
}

int main(int argc, char** argv)
{
    Arguments args;
    if (argc == 2 && std::string(argv[1]) == "--help") return std::fputs(kUsage, stdout) < 0;
    if (const std::string wrong = parseArguments(argc, argv, &args); !wrong.empty()) return fail(2, wrong);
    Viewer v;
    const int code = run(args, v);
    nacreContextDestroy(v.context); // and what is in it
    closeWindow(v);
    return code;
}
