#include "host_depth.h"

#include "textures.h"

#include <algorithm>

namespace nacre {

static GLint attachmentValue(const Gl& gl, GLenum attachment, GLenum what)
{
    GLint value = 0;
    gl.GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, attachment, what, &value);
    return value;
}

/// Attaches a texture's level to our framebuffer, which is bound, where nothing tells whether it is the first layer of an array (ES before
/// 3.2): by trying the kind that this name had last. GL remembers a wrong guess as an error, so a new name is tried without the host's.
static void attachUnknownTexture(Context& context, GLuint name, GLint level)
{
    const Gl& gl = context.gl;
    GLuint& knownArray = context.depthCopy.knownArray;
    const auto attached = [&] { return GLuint(attachmentValue(gl, GL_DEPTH_ATTACHMENT, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_NAME)) == name; };
    const auto attach = [&](bool array) {
        if (array) gl.FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, name, level, 0);
        else gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, name, level);
    };
    const bool array = knownArray == name;
    if (name != context.depthCopy.knownTexture) clearHostErrors(context);
    detachHostDepth(gl);
    attach(array);
    if (!attached()) {
        takeGlError(gl);
        attach(!array);
        knownArray = array ? 0 : name;
    }
    context.depthCopy.knownTexture = name;
}

/// Shares the image that the host has attached; its framebuffer is bound. False for one with layers, of which splats are drawn into the
/// first: GL 3.3 does not say how to name that one alone.
static bool shareDepth(Context& context, GLuint ours)
{
    const Gl& gl = context.gl;
    const auto get = [&](GLenum what) { return attachmentValue(gl, GL_DEPTH_ATTACHMENT, what); };
    const bool texture = get(GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE) == GL_TEXTURE, layersKnown = gl.FramebufferTexture;
    const GLuint name = GLuint(get(GL_FRAMEBUFFER_ATTACHMENT_OBJECT_NAME));
    const GLint level = texture ? get(GL_FRAMEBUFFER_ATTACHMENT_TEXTURE_LEVEL) : 0;
    const GLint face = texture ? get(GL_FRAMEBUFFER_ATTACHMENT_TEXTURE_CUBE_MAP_FACE) : 0, layer = texture ? get(GL_FRAMEBUFFER_ATTACHMENT_TEXTURE_LAYER) : 0;
    if (texture && layersKnown && get(GL_FRAMEBUFFER_ATTACHMENT_LAYERED)) return false;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, ours);
    if (!texture) gl.FramebufferRenderbuffer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, name);
    else if (face) gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GLenum(face), name, level);
    else if (layer) gl.FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, name, level, layer);
    else if (!layersKnown) attachUnknownTexture(context, name, level);
    else {
        gl.FramebufferTexture(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, name, level);
        // layer 0 of an array looks like a plain texture from outside, but attached as a whole it shows its layers
        if (get(GL_FRAMEBUFFER_ATTACHMENT_LAYERED)) gl.FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, name, level, 0);
    }
    return true;
}

struct DepthFormat {
    GLenum internal, layout, type;
};
static constexpr DepthFormat k24{GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT}, k24Stencil{GL_DEPTH24_STENCIL8, GL_DEPTH_STENCIL, GL_UNSIGNED_INT_24_8},
    k32Real{GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT}, k32RealStencil{GL_DEPTH32F_STENCIL8, GL_DEPTH_STENCIL, GL_FLOAT_32_UNSIGNED_INT_24_8_REV},
    k16{GL_DEPTH_COMPONENT16, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT}, k32{GL_DEPTH_COMPONENT32, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT};

/// The format that depth of this kind usually has.
static const DepthFormat& likelyFormat(const DepthSource& source)
{
    if (source.real) return source.stencilBits ? k32RealStencil : k32Real;
    if (source.stencilBits) return k24Stencil;
    return source.depthBits == 16 ? k16 : source.depthBits == 32 ? k32 : k24;
}

/// What can be asked about the depth buffer of the bound framebuffer.
static DepthSource describeDepth(const Gl& gl, GLuint host)
{
    const GLenum depth = host ? GL_DEPTH_ATTACHMENT : GL_DEPTH, stencil = host ? GL_STENCIL_ATTACHMENT : GL_STENCIL;
    DepthSource s;
    s.type = attachmentValue(gl, depth, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE);
    if (s.type == GL_NONE) return s;
    if (host) s.name = attachmentValue(gl, depth, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_NAME);
    s.depthBits = attachmentValue(gl, depth, GL_FRAMEBUFFER_ATTACHMENT_DEPTH_SIZE);
    s.real = attachmentValue(gl, depth, GL_FRAMEBUFFER_ATTACHMENT_COMPONENT_TYPE) == GL_FLOAT;
    if (attachmentValue(gl, stencil, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE) != GL_NONE)
        s.stencilBits = attachmentValue(gl, stencil, GL_FRAMEBUFFER_ATTACHMENT_STENCIL_SIZE);
    gl.GetIntegerv(GL_SAMPLES, &s.samples);
    return s;
}

/// The copy in this format, of at least this size.
static void growCopy(Context& context, const DepthFormat& format, int width, int height)
{
    const Gl& gl = context.gl;
    DepthCopy& copy = context.depthCopy;
    if (copy.texture && copy.format == format.internal && copy.width >= width && copy.height >= height) return;
    gl.DeleteTextures(1, &copy.texture);
    copy.format = format.internal, copy.width = width, copy.height = height;
    gl.GenTextures(1, &copy.texture);
    bindTexture(gl, 0, GL_TEXTURE_2D, copy.texture);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
    gl.TexImage2D(GL_TEXTURE_2D, 0, GLint(format.internal), width, height, 0, format.layout, format.type, nullptr);
}

/// And attached to our framebuffer.
static void makeCopy(Context& context, GLuint ours, const DepthFormat& format, int width, int height)
{
    const Gl& gl = context.gl;
    DepthCopy& copy = context.depthCopy;
    growCopy(context, format, width, height);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, ours);
    gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, copy.texture, 0);
}

/// Of one sample, in desktop GL: it converts between formats, and stencil is left behind.
static void copyConverted(Context& context, const DepthSource& source, int x0, int y0, int x1, int y1)
{
    growCopy(context, likelyFormat({.depthBits = source.depthBits, .real = source.real}), x1, y1);
    bindTexture(context.gl, 0, GL_TEXTURE_2D, context.depthCopy.texture);
    context.gl.CopyTexSubImage2D(GL_TEXTURE_2D, 0, x0, y0, x0, y0, x1 - x0, y1 - y0);
}

namespace {
struct PixelBox {
    int x0, y0, x1, y1;
};
} // namespace
static PixelBox pixelsOf(const float viewport[4])
{
    return {std::max(int(viewport[0]), 0), std::max(int(viewport[1]), 0), int(viewport[0] + viewport[2]), int(viewport[1] + viewport[3])};
}

HostDepth copyHostDepth(Context& context, GLuint host, const float viewport[4])
{
    const Gl& gl = context.gl;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, host);
    const DepthSource source = describeDepth(gl, host);
    if (source.type == GL_NONE) return HostDepth::kNone;
    if (source.samples > 0) return HostDepth::kCannot;
    const auto [x0, y0, x1, y1] = pixelsOf(viewport);
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, host);
    copyConverted(context, source, x0, y0, x1, y1);
    return HostDepth::kCopied;
}

/// Of several, and in ES: a blit, which demands the same format on both sides, and GL does not tell the host's. It is found by trying,
/// with one pixel, once for each depth buffer. In ES the pixels of a multisampled one must keep their places.
static bool copySameFormat(Context& context, GLuint ours, const DepthSource& source, int x0, int y0, int x1, int y1)
{
    const Gl& gl = context.gl;
    DepthCopy& copy = context.depthCopy;
    if (!(copy.source == source)) {
        clearHostErrors(context);
        copy.source = source, copy.blits = nullptr;
        for (const DepthFormat* format : {&likelyFormat(source), &k24, &k24Stencil, &k32Real, &k32RealStencil, &k16, &k32}) {
            if (gl.es && format == &k32) continue;
            makeCopy(context, ours, *format, x0 + 1, y0 + 1);
            gl.BlitFramebuffer(x0, y0, x0 + 1, y0 + 1, x0, y0, x0 + 1, y0 + 1, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
            if (takeGlError(gl) != GL_NO_ERROR) continue;
            copy.blits = format;
            break;
        }
    }
    if (!copy.blits) return false;
    makeCopy(context, ours, *copy.blits, x1, y1);
    gl.BlitFramebuffer(x0, y0, x1, y1, x0, y0, x1, y1, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
    return true;
}

Failure attachHostDepth(Context& context, GLuint host, GLuint ours, const float viewport[4])
{
    const Gl& gl = context.gl;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, host);
    const DepthSource source = describeDepth(gl, host);
    bool attached = true;
    if (source.type == GL_NONE) gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, ours);
    else if (!host || source.samples > 0 || !shareDepth(context, ours)) {
        const auto [x0, y0, x1, y1] = pixelsOf(viewport);
        gl.BindFramebuffer(GL_READ_FRAMEBUFFER, host);
        gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, ours);
        if (source.samples > 0 || gl.es) attached = copySameFormat(context, ours, source, x0, y0, x1, y1);
        else {
            copyConverted(context, source, x0, y0, x1, y1);
            gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, context.depthCopy.texture, 0);
        }
    }
    if (attached && gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE) return {};
    detachHostDepth(gl);
    return {NACRE_ERROR_UNSUPPORTED, "this asset cannot be tested against the bound depth buffer (" + std::to_string(source.depthBits) + " bits, " +
                                         std::to_string(source.stencilBits) + " bits of stencil, " + std::to_string(source.samples) +
                                         " samples), which GL can neither share nor copy; draw with depthTest = 0, or into a framebuffer of one "
                                         "sample whose depth is a 2D texture or a renderbuffer"};
}

void detachHostDepth(const Gl& gl) { gl.FramebufferRenderbuffer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, 0); }

void freeDepthCopy(Context& context)
{
    context.gl.DeleteTextures(1, &context.depthCopy.texture);
    context.depthCopy = {};
}

} // namespace nacre
