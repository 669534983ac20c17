// EGL without a surface: the first GPU among the EGL devices, else Mesa's surfaceless platform (any Mesa driver, or software; needs no device
// node), else a software device. The only file that knows EGL.
#include "eval/headless_context.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/glcorearb.h>

#include <cstring>
#include <vector>

namespace nacre {

template <class Function>
static Function eglFunction(const char* name) { return reinterpret_cast<Function>(eglGetProcAddress(name)); }

struct Candidate {
    EGLDisplay display = EGL_NO_DISPLAY;
    bool software = false; // known to be, before a context is made
};

/// Displays worth trying, best first.
static std::vector<Candidate> candidateDisplays()
{
    std::vector<Candidate> hardware, rest;
    const auto getDisplay = eglFunction<PFNEGLGETPLATFORMDISPLAYEXTPROC>("eglGetPlatformDisplayEXT");
    if (!getDisplay) return hardware;
    rest.push_back({getDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr)});
    const auto queryDevices = eglFunction<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
    const auto queryString = eglFunction<PFNEGLQUERYDEVICESTRINGEXTPROC>("eglQueryDeviceStringEXT");
    EGLDeviceEXT devices[16];
    EGLint count = 0;
    if (queryDevices && queryDevices(16, devices, &count))
        for (EGLint i = 0; i < count; ++i) {
            const char* extensions = queryString ? queryString(devices[i], EGL_EXTENSIONS) : nullptr;
            const bool software = extensions && std::strstr(extensions, "EGL_MESA_device_software");
            (software ? rest : hardware).push_back({getDisplay(EGL_PLATFORM_DEVICE_EXT, devices[i], nullptr), software});
        }
    hardware.insert(hardware.end(), rest.begin(), rest.end());
    std::erase_if(hardware, [](const Candidate& c) { return c.display == EGL_NO_DISPLAY; });
    return hardware;
}

/// Of the current context.
static bool drawsInSoftware()
{
    const auto getString = eglFunction<PFNGLGETSTRINGPROC>("glGetString");
    return !getString || isSoftwareRenderer(reinterpret_cast<const char*>(getString(GL_RENDERER)));
}

namespace {

class EglContext final : public HeadlessContext {
public:
    ~EglContext() override { eglDestroyContext(display, context); } // the display is shared by the process and stays initialised
    bool makeCurrent() override { return eglBindAPI(api) && eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context); }
    void release() override { eglBindAPI(api), eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT); }
    void* getProcAddress(const char* name) override { return reinterpret_cast<void*>(eglGetProcAddress(name)); }

    EGLDisplay display = EGL_NO_DISPLAY;
    EGLContext context = EGL_NO_CONTEXT;
    EGLenum api = EGL_OPENGL_API;
};

} // namespace

/// A current context without surface, or null.
static std::unique_ptr<EglContext> makeContext(EGLDisplay display, bool es)
{
    static const EGLint kCore[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 3,
                                   EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
    static const EGLint kEs[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 0, EGL_NONE};
    auto made = std::make_unique<EglContext>();
    made->display = display, made->api = es ? EGL_OPENGL_ES_API : EGL_OPENGL_API;
    if (!eglInitialize(display, nullptr, nullptr) || !eglBindAPI(made->api)) return nullptr;
    made->context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, es ? kEs : kCore);
    if (made->context == EGL_NO_CONTEXT || !made->makeCurrent()) return nullptr;
    made->software = drawsInSoftware();
    return made;
}

Result<std::unique_ptr<HeadlessContext>> makeEglContext(bool es)
{
    std::unique_ptr<EglContext> best;
    const std::vector<Candidate> displays = candidateDisplays();
    for (const Candidate& candidate : displays) {
        if (best && (candidate.software || !best->software)) continue;
        std::unique_ptr<EglContext> context = makeContext(candidate.display, es);
        if (context && (!best || !context->software)) best = std::move(context);
    }
    if (best && best->makeCurrent()) return std::unique_ptr<HeadlessContext>(std::move(best));
    return Error{ErrorCode::kGpu, std::string("no headless OpenGL ") + (es ? "ES 3.0" : "3.3 core") + " context: tried " + std::to_string(displays.size()) +
                                      " EGL displays (surfaceless, devices); install libegl1 and libgl1-mesa-dri, or use --renderer reference"};
}

} // namespace nacre
