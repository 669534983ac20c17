// One draw: relight, sort, raster, inside the host's frame.
#include "gl_state.h"
#include "textures.h"

#include <chrono>
#include <cstdio>
#include <limits>

namespace nacre {

/// Seconds since the last lap; with profiling on, GPU work up to here included.
class Stopwatch {
public:
    explicit Stopwatch(const NacreContextImpl& context) : context_(context) { lap(); }
    double lap()
    {
        if (context_.profiling) context_.gl.Finish();
        const auto now = std::chrono::steady_clock::now();
        const double seconds = std::chrono::duration<double>(now - last_).count();
        last_ = now;
        return seconds;
    }

private:
    const NacreContextImpl& context_;
    std::chrono::steady_clock::time_point last_{};
};

/// A property of the first draw buffer of the bound framebuffer object; `none` for a window or where nothing is drawn.
static GLint targetValue(const Gl& gl, GLenum what, GLint none)
{
    GLint framebuffer = 0, attachment = GL_NONE, type = GL_NONE, value = none;
    gl.GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer);
    if (framebuffer != 0) gl.GetIntegerv(GL_DRAW_BUFFER0, &attachment);
    if (attachment == GL_NONE) return none;
    const auto get = [&](GLenum name, GLint* out) { gl.GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, GLenum(attachment), name, out); };
    get(GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE, &type);
    if (type != GL_NONE) get(what, &value);
    return value;
}

// A half-float target turns values above 65504 into infinity, so colours stop there; a float target takes everything, and so does a
// window, whose fixed point GL itself clamps.
float largestColor(const Gl& gl)
{
    const GLint bits = targetValue(gl, GL_FRAMEBUFFER_ATTACHMENT_RED_SIZE, 32);
    return bits > 16 ? std::numeric_limits<float>::max() : bits == 16 ? 65504.0f : 65024.0f; // the last: R11F_G11F_B10F
}

static bool holdsIntegers(const Gl& gl)
{
    const GLint type = targetValue(gl, GL_FRAMEBUFFER_ATTACHMENT_COMPONENT_TYPE, GL_NONE);
    return type == GL_INT || type == GL_UNSIGNED_INT;
}

static Failure checkTarget(const Gl& gl)
{
    const GLenum status = gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER);
    GLint framebuffer = 0;
    gl.GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer);
    if (status == GL_FRAMEBUFFER_COMPLETE) {
        if (!holdsIntegers(gl)) return {};
        return {NACRE_ERROR_GL, "the first draw buffer of framebuffer " + std::to_string(framebuffer) +
                                    " holds integers, into which nothing can be blended; bind a linear float target (RGBA16F)"};
    }
    char hex[16];
    std::snprintf(hex, sizeof hex, "0x%04X", status);
    return {NACRE_ERROR_GL, "the bound draw framebuffer " + std::to_string(framebuffer) + " is incomplete (status " + hex +
                                "); complete it before nacreAssetDraw"};
}

static void uploadOrder(const NacreAssetImpl& asset)
{
    const Gl& gl = asset.context->gl;
    const int drawn = int(asset.farToNear.size()), rows = drawn / asset.width, rest = drawn % asset.width;
    const uint32_t* data = asset.farToNear.data();
    bindTexture(gl, 2, GL_TEXTURE_2D, asset.order);
    if (rows > 0) gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, asset.width, rows, GL_RED_INTEGER, GL_UNSIGNED_INT, data);
    if (rest > 0)
        gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, rows, rest, 1, GL_RED_INTEGER, GL_UNSIGNED_INT, data + size_t(rows) * size_t(asset.width));
}

void drawQuads(const NacreAssetImpl& asset)
{
    asset.context->gl.DrawElements(GL_TRIANGLES, GLsizei(6 * asset.farToNear.size()), GL_UNSIGNED_INT, nullptr);
}

static Failure checkViewport(const NacreDrawDesc& desc)
{
    if (desc.viewportWidth >= 0 && desc.viewportHeight >= 0) return {};
    return {NACRE_ERROR_INVALID_ARGUMENT, "the viewport is " + std::to_string(desc.viewportWidth) + " x " +
                                              std::to_string(desc.viewportHeight) + " pixels, neither may be negative"};
}

/// A minimised window, whose aspect ratio and targets need not be valid.
static bool isEmpty(const NacreDrawDesc& desc) { return desc.viewportWidth == 0 || desc.viewportHeight == 0; }

/// Relights and sorts. What it finds done stays.
static Failure update(NacreAssetImpl& asset, const DrawFrame& frame, GlStateGuard& state, Stopwatch& watch)
{
    asset.context->gl.BindVertexArray(asset.context->vertexArray);
    state.beginPasses();
    if (Failure f = relight(asset, frame)) return f;
    asset.stats.relightSeconds = watch.lap();

    const bool resorted = sortSplats(asset, frame);
    if (resorted) uploadOrder(asset);
    asset.stats.sorted = resorted;
    asset.stats.splatsDrawn = uint32_t(asset.farToNear.size());
    asset.stats.sortSeconds = watch.lap();
    return {};
}

Failure prepare(NacreAssetImpl& asset, const NacreDrawDesc* desc, int mostLights)
{
    const NacreContextImpl& context = *asset.context;
    if (Failure f = checkGlContext(context)) return f;
    if (desc)
        if (Failure f = checkViewport(*desc)) return f;
    if (desc && isEmpty(*desc)) desc = nullptr;
    DrawFrame frame;
    if (desc)
        if (Failure f = makeFrame(*desc, clipControl(context.gl), &frame)) return f;
    Stopwatch watch(context);
    GlStateGuard state(context.gl);
    if (Failure f = asset.model->compileAhead(mostLights)) return f;
    return desc ? update(asset, frame, state, watch) : Failure{};
}

Failure draw(NacreAssetImpl& asset, const NacreDrawDesc& desc)
{
    const NacreContextImpl& context = *asset.context;
    if (Failure f = checkViewport(desc)) return f;
    if (isEmpty(desc)) {
        asset.stats = {};
        return {};
    }
    if (Failure f = checkGlContext(context)) return f;
    DrawFrame frame;
    if (Failure f = makeFrame(desc, clipControl(context.gl), &frame)) return f;
    if (Failure f = checkTarget(context.gl)) return f;

    Stopwatch watch(context);
    GlStateGuard state(context.gl);
    if (Failure f = update(asset, frame, state, watch)) return f;
    if (!asset.farToNear.empty())
        if (Failure f = asset.model->raster(frame, desc.depthTest != 0, state)) return f;
    asset.stats.rasterSeconds = watch.lap();
    return {};
}

} // namespace nacre
