// EGL without a surface: the first GPU among the EGL devices, else Mesa's surfaceless platform (any Mesa driver, or software; needs no device
// node), else a software device. The only file that knows EGL.
#include "eval/headless_gl.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/glcorearb.h>

#include <algorithm>
#include <cstring>
#include <vector>

namespace nacre {

#define NACRE_HEADLESS_FUNCTIONS(X)                                                                                              \
    X(BINDFRAMEBUFFER, BindFramebuffer) X(BINDRENDERBUFFER, BindRenderbuffer) X(CHECKFRAMEBUFFERSTATUS, CheckFramebufferStatus)  \
    X(CLEAR, Clear) X(CLEARCOLOR, ClearColor) X(CLEARDEPTH, ClearDepth) X(DELETEFRAMEBUFFERS, DeleteFramebuffers)                \
    X(DELETERENDERBUFFERS, DeleteRenderbuffers) X(FRAMEBUFFERRENDERBUFFER, FramebufferRenderbuffer)                              \
    X(GENFRAMEBUFFERS, GenFramebuffers) X(GENRENDERBUFFERS, GenRenderbuffers) X(GETINTEGERV, GetIntegerv)                        \
    X(GETSTRING, GetString) X(PIXELSTOREI, PixelStorei) X(READPIXELS, ReadPixels)                                                \
    X(RENDERBUFFERSTORAGE, RenderbufferStorage) X(VIEWPORT, Viewport)

struct HeadlessGl::Impl {
    EGLDisplay display = EGL_NO_DISPLAY;
    EGLContext context = EGL_NO_CONTEXT;
#define X(TYPE, name) PFNGL##TYPE##PROC name = nullptr;
    NACRE_HEADLESS_FUNCTIONS(X)
#undef X
    GLuint framebuffer = 0, color = 0, depth = 0;
    int width = 0, height = 0;
};

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

/// By the name of the renderer of the current context.
static bool drawsInSoftware()
{
    const auto getString = eglFunction<PFNGLGETSTRINGPROC>("glGetString");
    const char* name = getString ? reinterpret_cast<const char*>(getString(GL_RENDERER)) : nullptr;
    for (const char* software : {"llvmpipe", "softpipe", "swrast", "Software Rasterizer", "SwiftShader"})
        if (!name || std::strstr(name, software)) return true;
    return false;
}

/// A current GL 3.3 core context without surface, or EGL_NO_CONTEXT.
static EGLContext makeContext(EGLDisplay display)
{
    static const EGLint kAttributes[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 3,
                                         EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
    if (!eglInitialize(display, nullptr, nullptr) || !eglBindAPI(EGL_OPENGL_API)) return EGL_NO_CONTEXT;
    const EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, kAttributes);
    if (context == EGL_NO_CONTEXT) return context;
    if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) return context;
    eglDestroyContext(display, context);
    return EGL_NO_CONTEXT;
}

HeadlessGl::HeadlessGl() : impl_(std::make_unique<Impl>()) {}

Result<std::unique_ptr<HeadlessGl>> HeadlessGl::create()
{
    std::unique_ptr<HeadlessGl> self(new HeadlessGl);
    Impl& gl = *self->impl_;
    const std::vector<Candidate> displays = candidateDisplays();
    for (const Candidate& candidate : displays) {
        if (gl.context != EGL_NO_CONTEXT && (candidate.software || !self->software_)) continue;
        const EGLContext context = makeContext(candidate.display);
        if (context == EGL_NO_CONTEXT) continue;
        const bool software = drawsInSoftware();
        if (gl.context != EGL_NO_CONTEXT) eglDestroyContext(software ? candidate.display : gl.display, software ? context : gl.context);
        if (gl.context == EGL_NO_CONTEXT || !software) gl.display = candidate.display, gl.context = context, self->software_ = software;
    }
    if (gl.context != EGL_NO_CONTEXT) self->makeCurrent();
    if (gl.context == EGL_NO_CONTEXT)
        return Error{ErrorCode::kGpu, "no headless OpenGL 3.3 core context: tried " + std::to_string(displays.size()) +
                                          " EGL displays (surfaceless, devices); install libegl1 and libgl1-mesa-dri, or use "
                                          "--renderer reference"};
#define X(TYPE, name) gl.name = eglFunction<PFNGL##TYPE##PROC>("gl" #name);
    NACRE_HEADLESS_FUNCTIONS(X)
#undef X
    GLint major = 0, minor = 0;
    gl.GetIntegerv(GL_MAJOR_VERSION, &major);
    gl.GetIntegerv(GL_MINOR_VERSION, &minor);
    self->description_ = std::string(reinterpret_cast<const char*>(gl.GetString(GL_RENDERER))) + ", GL " + std::to_string(major) +
                         "." + std::to_string(minor);
    return self;
}

HeadlessGl::~HeadlessGl()
{
    Impl& gl = *impl_;
    if (gl.context == EGL_NO_CONTEXT) return;
    makeCurrent();
    const GLuint renderbuffers[] = {gl.color, gl.depth};
    gl.DeleteFramebuffers(1, &gl.framebuffer);
    gl.DeleteRenderbuffers(2, renderbuffers);
    eglMakeCurrent(gl.display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(gl.display, gl.context); // the display is shared by the process and stays initialised
}

void HeadlessGl::makeCurrent() { eglMakeCurrent(impl_->display, EGL_NO_SURFACE, EGL_NO_SURFACE, impl_->context); }

Status HeadlessGl::beginFrame(int width, int height)
{
    Impl& gl = *impl_;
    if (!gl.framebuffer) {
        gl.GenFramebuffers(1, &gl.framebuffer);
        gl.GenRenderbuffers(1, &gl.color);
        gl.GenRenderbuffers(1, &gl.depth);
    }
    gl.BindFramebuffer(GL_FRAMEBUFFER, gl.framebuffer);
    if (width != gl.width || height != gl.height) {
        GLint most = 0;
        gl.GetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &most);
        if (width < 1 || height < 1 || width > most || height > most)
            return Error{ErrorCode::kGpu, "the frame is " + std::to_string(width) + " x " + std::to_string(height) +
                                              " pixels, this OpenGL draws 1 to " + std::to_string(most) + " a side"};
        gl.BindRenderbuffer(GL_RENDERBUFFER, gl.color);
        gl.RenderbufferStorage(GL_RENDERBUFFER, GL_RGBA32F, width, height);
        gl.BindRenderbuffer(GL_RENDERBUFFER, gl.depth);
        gl.RenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT24, width, height);
        gl.FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, gl.color);
        gl.FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, gl.depth);
        gl.width = gl.height = 0;
        if (gl.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
            return Error{ErrorCode::kGpu, "cannot make an RGBA32F framebuffer of " + std::to_string(width) + " x " +
                                              std::to_string(height) + " pixels; try a smaller size or --renderer reference"};
        gl.width = width;
        gl.height = height;
    }
    gl.Viewport(0, 0, width, height);
    gl.ClearColor(0, 0, 0, 0);
    gl.ClearDepth(1);
    gl.Clear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    return ok();
}

Image HeadlessGl::readFrame()
{
    Impl& gl = *impl_;
    Image image{gl.width, gl.height, std::vector<float>(size_t(4) * size_t(gl.width) * size_t(gl.height))};
    gl.BindFramebuffer(GL_FRAMEBUFFER, gl.framebuffer);
    gl.PixelStorei(GL_PACK_ALIGNMENT, 4);
    gl.ReadPixels(0, 0, gl.width, gl.height, GL_RGBA, GL_FLOAT, image.rgba.data());
    for (int y = 0; y < gl.height / 2; ++y) // GL rows run bottom to top
        std::swap_ranges(image.pixel(0, y), image.pixel(0, y) + 4 * gl.width, image.pixel(0, gl.height - 1 - y));
    return image;
}

void* HeadlessGl::getProcAddress(const char* name, void*) { return reinterpret_cast<void*>(eglGetProcAddress(name)); }

} // namespace nacre
