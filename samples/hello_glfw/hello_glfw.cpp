// The smallest host of the Nacre runtime with a window: GLFW, C++, one asset that turns under one light. Escape ends it.
//   hello_glfw ASSET.glb [FRAMES]
#define GLFW_INCLUDE_GLCOREARB
#define GL_GLEXT_PROTOTYPES
#include <GLFW/glfw3.h>
#include <nacre/nacre.hpp>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <vector>

using namespace nacre::runtime;

static int fail(const char* text)
{
    std::fprintf(stderr, "hello_glfw: %s\n", text);
    return 1;
}

/// The window's own framebuffer is the target: GL_FRAMEBUFFER_SRGB makes of it a linear one, as splats want it. Highlights are cut off; a
/// game draws into RGBA16F and maps tones.
static GLFWwindow* openWindow()
{
    if (!glfwInit()) return nullptr;
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_SRGB_CAPABLE, GLFW_TRUE);
    GLFWwindow* window = glfwCreateWindow(768, 768, "hello_glfw", nullptr, nullptr);
    if (!window) return nullptr;
    glfwMakeContextCurrent(window);
    glEnable(GL_FRAMEBUFFER_SRGB);
    return window;
}

/// Column-major: turned about the vertical through the asset's centre, which is put at the origin.
static void place(const NacreAssetInfo& info, float angle, float (&m)[16])
{
    const float half[2] = {std::cos(angle / 2), std::sin(angle / 2)}, *a = info.yUpFromAsset;
    const float x = half[0] * a[0] + half[1] * a[2], y = half[0] * a[1] + half[1] * a[3]; // (0, sin, 0, cos) * yUpFromAsset
    const float z = half[0] * a[2] - half[1] * a[0], w = half[0] * a[3] - half[1] * a[1];
    const float columns[9] = {1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 2 * (x * y - w * z), 1 - 2 * (x * x + z * z),
                              2 * (y * z + w * x),     2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)};
    m[12] = m[13] = m[14] = 0, m[15] = 1;
    for (int c = 0; c < 3; ++c)
        for (int row = 0; row < 3; ++row) {
            m[4 * c + row] = columns[3 * c + row];
            m[12 + row] -= columns[3 * c + row] * 0.5f * (info.boundsMax[c] + info.boundsMin[c]);
        }
}

static int run(GLFWwindow* window, const std::vector<char>& bytes, long frames)
{
    NacreContextDesc desc = make<NacreContextDesc>();
    desc.getProcAddress = [](const char* name, void*) { return reinterpret_cast<void*>(glfwGetProcAddress(name)); };
    desc.message = [](NacreSeverity, const char* text, void*) { std::fprintf(stderr, "nacre: %s\n", text); };
    auto context = Context::create(desc);
    if (!context) return 1;
    auto asset = context->loadAsset(bytes.data(), bytes.size());
    if (!asset) return 1;
    auto info = asset->info();
    auto instance = asset->instance();
    auto view = context->view();
    if (!info || !instance || !view) return 1;

    const float *low = info->boundsMin, *high = info->boundsMax;
    const float d = 1.5f * std::hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) + 0.02f;
    NacreLight light = make<NacreLight>();
    for (int c = 0; c < 3; ++c) light.position[c] = d, light.intensity[c] = 6 * d * d; // irradiance I / r^2 of about 2
    if (nacreContextSetLights(context->id(), &light, 1) != NACRE_OK) return 1;

    NacreDrawDesc draw = make<NacreDrawDesc>();
    draw.viewFromWorld[0] = draw.viewFromWorld[5] = draw.viewFromWorld[10] = draw.viewFromWorld[15] = 1;
    draw.viewFromWorld[14] = -d;
    draw.clipFromView[10] = draw.clipFromView[11] = -1; // infinite far plane, near plane at 0.01
    draw.clipFromView[14] = -0.02f;
    for (long n = 0; n != frames && !glfwWindowShouldClose(window) && glfwGetKey(window, GLFW_KEY_ESCAPE) != GLFW_PRESS; ++n) {
        glfwGetFramebufferSize(window, &draw.viewportWidth, &draw.viewportHeight);
        glViewport(0, 0, draw.viewportWidth, draw.viewportHeight);
        glClear(GL_COLOR_BUFFER_BIT);
        draw.clipFromView[5] = 2.4f; // 45 degrees
        draw.clipFromView[0] = draw.viewportWidth > 0 ? 2.4f * float(draw.viewportHeight) / float(draw.viewportWidth) : 2.4f;
        float worldFromAsset[16];
        place(*info, float(glfwGetTime()), worldFromAsset);
        if (instance->setTransform(worldFromAsset) != NACRE_OK || view->draw(draw) != NACRE_OK) return 1;
        glfwSwapBuffers(window);
        glfwPollEvents();
    }
    return 0;
}

int main(int argc, char** argv)
{
    if (argc < 2 || argc > 3) return fail("usage: hello_glfw ASSET.glb [FRAMES]");
    std::ifstream file(argv[1], std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
    if (bytes.empty()) return fail("cannot read the asset");
    GLFWwindow* window = openWindow();
    const int result = window ? run(window, bytes, argc == 3 ? std::atol(argv[2]) : -1) : fail("GLFW opens no window with OpenGL 3.3 core");
    glfwTerminate(); // after everything that belongs to its context
    return result;
}
