#include "eval/headless_gl.h"

#include "eval/headless_context.h"

#include <GL/glcorearb.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <utility>
#include <vector>

namespace nacre {

#define NACRE_HEADLESS_FUNCTIONS(X)                                                                                              \
    X(BINDFRAMEBUFFER, BindFramebuffer) X(BLITFRAMEBUFFER, BlitFramebuffer) X(FINISH, Finish) X(BINDRENDERBUFFER, BindRenderbuffer) X(CHECKFRAMEBUFFERSTATUS, CheckFramebufferStatus)  \
    X(CLEARBUFFERFV, ClearBufferfv) X(DELETEFRAMEBUFFERS, DeleteFramebuffers) X(DELETERENDERBUFFERS, DeleteRenderbuffers)        \
    X(FRAMEBUFFERRENDERBUFFER, FramebufferRenderbuffer) X(GENFRAMEBUFFERS, GenFramebuffers)                                      \
    X(GENRENDERBUFFERS, GenRenderbuffers) X(GETINTEGERV, GetIntegerv) X(GETSTRING, GetString) X(PIXELSTOREI, PixelStorei)        \
    X(READPIXELS, ReadPixels) X(RENDERBUFFERSTORAGE, RenderbufferStorage) X(VIEWPORT, Viewport)

struct HeadlessGl::Impl {
    std::unique_ptr<HeadlessContext> context;
#define X(TYPE, name) PFNGL##TYPE##PROC name = nullptr;
    NACRE_HEADLESS_FUNCTIONS(X)
#undef X
    GLuint framebuffer = 0, color = 0, depth = 0;
    int width = 0, height = 0;
    GLenum format = 0;
};

/// Two libraries do not know of one another's contexts: one lets go before the other takes over.
static thread_local HeadlessContext* current = nullptr;

static void switchTo(HeadlessContext* next)
{
    if (current && current != next) current->release();
    current = next;
}

bool isSoftwareRenderer(const char* name)
{
    for (const char* software : {"llvmpipe", "softpipe", "swrast", "Software Rasterizer", "SwiftShader"})
        if (!name || std::strstr(name, software)) return true;
    return false;
}

HeadlessGl::HeadlessGl() : impl_(std::make_unique<Impl>()) {}

Result<std::unique_ptr<HeadlessGl>> HeadlessGl::create(HeadlessKind kind)
{
    switchTo(nullptr);
    auto context = kind == HeadlessKind::kOsMesa ? makeOsMesaContext() : makeEglContext(kind == HeadlessKind::kEglEs);
    if (!context) return context.error();
    std::unique_ptr<HeadlessGl> self(new HeadlessGl);
    Impl& gl = *self->impl_;
    gl.context = std::move(*context);
    self->makeCurrent();
#define X(TYPE, name) gl.name = reinterpret_cast<PFNGL##TYPE##PROC>(getProcAddress("gl" #name, nullptr));
    NACRE_HEADLESS_FUNCTIONS(X)
#undef X
    GLint major = 0, minor = 0;
    gl.GetIntegerv(GL_MAJOR_VERSION, &major);
    gl.GetIntegerv(GL_MINOR_VERSION, &minor);
    self->description_ = std::string(reinterpret_cast<const char*>(gl.GetString(GL_RENDERER))) + (kind == HeadlessKind::kEglEs ? ", GL ES " : ", GL ") + std::to_string(major) +
                         "." + std::to_string(minor);
    return self;
}

HeadlessGl::~HeadlessGl()
{
    Impl& gl = *impl_;
    makeCurrent();
    const GLuint renderbuffers[] = {gl.color, gl.depth};
    gl.DeleteFramebuffers(1, &gl.framebuffer);
    gl.DeleteRenderbuffers(2, renderbuffers);
    switchTo(nullptr);
}

void HeadlessGl::makeCurrent()
{
    switchTo(impl_->context.get());
    impl_->context->makeCurrent();
}

bool HeadlessGl::isSoftware() const { return impl_->context->software; }

Status HeadlessGl::beginFrame(int width, int height, unsigned format)
{
    Impl& gl = *impl_;
    if (!format) format = GL_RGBA32F;
    if (!gl.framebuffer) {
        gl.GenFramebuffers(1, &gl.framebuffer);
        gl.GenRenderbuffers(1, &gl.color);
        gl.GenRenderbuffers(1, &gl.depth);
    }
    gl.BindFramebuffer(GL_FRAMEBUFFER, gl.framebuffer);
    if (width != gl.width || height != gl.height || format != gl.format) {
        GLint most = 0;
        gl.GetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &most);
        if (width < 1 || height < 1 || width > most || height > most)
            return Error{ErrorCode::kGpu, "the frame is " + std::to_string(width) + " x " + std::to_string(height) +
                                              " pixels, this OpenGL draws 1 to " + std::to_string(most) + " a side"};
        gl.BindRenderbuffer(GL_RENDERBUFFER, gl.color);
        gl.RenderbufferStorage(GL_RENDERBUFFER, format, width, height);
        gl.BindRenderbuffer(GL_RENDERBUFFER, gl.depth);
        gl.RenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT24, width, height);
        gl.FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, gl.color);
        gl.FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, gl.depth);
        gl.width = gl.height = 0;
        if (gl.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
            return Error{ErrorCode::kGpu, "cannot make a float framebuffer of " + std::to_string(width) + " x " +
                                              std::to_string(height) + " pixels; try a smaller size or --renderer reference"};
        gl.width = width;
        gl.height = height;
        gl.format = format;
    }
    gl.Viewport(0, 0, width, height);
    const float nothing[4] = {0, 0, 0, 0}, farthest = 1;
    gl.ClearBufferfv(GL_COLOR, 0, nothing);
    gl.ClearBufferfv(GL_DEPTH, 0, &farthest);
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

double HeadlessGl::enlargedSeconds(int width, int height)
{
    Impl& gl = *impl_;
    GLuint framebuffer = 0, color = 0;
    gl.GenFramebuffers(1, &framebuffer);
    gl.GenRenderbuffers(1, &color);
    gl.BindRenderbuffer(GL_RENDERBUFFER, color);
    gl.RenderbufferStorage(GL_RENDERBUFFER, gl.format, width, height);
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, gl.framebuffer);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    gl.FramebufferRenderbuffer(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, color);
    std::vector<double> seconds;
    for (int i = 0; i < 25; ++i) {
        gl.Finish();
        const auto start = std::chrono::steady_clock::now();
        gl.BlitFramebuffer(0, 0, gl.width, gl.height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_LINEAR);
        gl.Finish();
        if (i >= 5) seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    gl.DeleteFramebuffers(1, &framebuffer);
    gl.DeleteRenderbuffers(1, &color);
    gl.BindFramebuffer(GL_FRAMEBUFFER, gl.framebuffer);
    std::nth_element(seconds.begin(), seconds.begin() + ptrdiff_t(seconds.size() / 2), seconds.end());
    return seconds[seconds.size() / 2];
}

Result<double> enlargingMilliseconds(int fromWidth, int fromHeight, int width, int height)
{
    const Result<std::unique_ptr<HeadlessGl>> gl = HeadlessGl::create();
    if (!gl) return gl.error();
    if (Status s = (*gl)->beginFrame(fromWidth, fromHeight); !s) return s.error();
    return 1e3 * (*gl)->enlargedSeconds(width, height);
}

void* HeadlessGl::getProcAddress(const char* name, void*) { return current ? current->getProcAddress(name) : nullptr; }

} // namespace nacre
