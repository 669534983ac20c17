#include "host_depth.h"

#include "textures.h"

namespace nacre {

static GLint attachmentValue(const Gl& gl, GLenum attachment, GLenum what)
{
    GLint value = 0;
    gl.GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, attachment, what, &value);
    return value;
}

/// Shares what the host has attached. The host's framebuffer is bound.
static void shareDepth(const Gl& gl, GLuint ours)
{
    const auto get = [&](GLenum what) { return attachmentValue(gl, GL_DEPTH_ATTACHMENT, what); };
    const bool texture = get(GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE) == GL_TEXTURE;
    const GLuint name = GLuint(get(GL_FRAMEBUFFER_ATTACHMENT_OBJECT_NAME));
    const GLint level = texture ? get(GL_FRAMEBUFFER_ATTACHMENT_TEXTURE_LEVEL) : 0;
    const GLint face = texture ? get(GL_FRAMEBUFFER_ATTACHMENT_TEXTURE_CUBE_MAP_FACE) : 0, layer = texture ? get(GL_FRAMEBUFFER_ATTACHMENT_TEXTURE_LAYER) : 0;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, ours);
    if (!texture) gl.FramebufferRenderbuffer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, name);
    else if (face) gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GLenum(face), name, level);
    else if (layer) gl.FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, name, level, layer);
    else gl.FramebufferTexture(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, name, level);
}

/// A blit of depth needs the same format on both sides.
struct DepthFormat {
    GLenum internal, layout, type;
};
static DepthFormat depthFormat(GLint depthBits, GLint stencilBits, bool real)
{
    if (real) return stencilBits ? DepthFormat{GL_DEPTH32F_STENCIL8, GL_DEPTH_STENCIL, GL_FLOAT_32_UNSIGNED_INT_24_8_REV} : DepthFormat{GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT};
    if (stencilBits) return {GL_DEPTH24_STENCIL8, GL_DEPTH_STENCIL, GL_UNSIGNED_INT_24_8};
    return {GLenum(depthBits == 16 ? GL_DEPTH_COMPONENT16 : depthBits == 32 ? GL_DEPTH_COMPONENT32 : GL_DEPTH_COMPONENT24), GL_DEPTH_COMPONENT, GL_UNSIGNED_INT};
}

static void copyDepth(NacreContextImpl& context, GLuint host, GLuint ours, GLenum depth, GLenum stencil, const float viewport[4])
{
    const Gl& gl = context.gl;
    const bool hasStencil = attachmentValue(gl, stencil, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE) != GL_NONE;
    const DepthFormat format = depthFormat(attachmentValue(gl, depth, GL_FRAMEBUFFER_ATTACHMENT_DEPTH_SIZE),
                                           hasStencil ? attachmentValue(gl, stencil, GL_FRAMEBUFFER_ATTACHMENT_STENCIL_SIZE) : 0,
                                           attachmentValue(gl, depth, GL_FRAMEBUFFER_ATTACHMENT_COMPONENT_TYPE) == GL_FLOAT);
    const int x1 = int(viewport[0] + viewport[2]), y1 = int(viewport[1] + viewport[3]);
    DepthCopy& copy = context.depthCopy;
    if (!copy.texture || copy.format != format.internal || copy.width < x1 || copy.height < y1) {
        freeDepthCopy(context);
        copy = {0, format.internal, x1, y1};
        gl.GenTextures(1, &copy.texture);
        bindTexture(gl, 0, GL_TEXTURE_2D, copy.texture);
        setNearest(gl, GL_TEXTURE_2D);
        gl.TexImage2D(GL_TEXTURE_2D, 0, GLint(format.internal), x1, y1, 0, format.layout, format.type, nullptr);
    }
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, host);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, ours);
    gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, copy.texture, 0);
    const int x0 = int(viewport[0]), y0 = int(viewport[1]);
    gl.BlitFramebuffer(x0, y0, x1, y1, x0, y0, x1, y1, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
}

Failure attachHostDepth(NacreContextImpl& context, GLuint host, GLuint ours, const float viewport[4])
{
    const Gl& gl = context.gl;
    const GLenum depth = host ? GL_DEPTH_ATTACHMENT : GL_DEPTH, stencil = host ? GL_STENCIL_ATTACHMENT : GL_STENCIL;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, host);
    GLint samples = 0;
    gl.GetIntegerv(GL_SAMPLES, &samples);
    const bool none = attachmentValue(gl, depth, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE) == GL_NONE;
    if (none) gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, ours);
    else if (host && samples == 0) shareDepth(gl, ours);
    else copyDepth(context, host, ours, depth, stencil, viewport);
    if (gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE) return {};
    detachHostDepth(gl);
    return {NACRE_ERROR_UNSUPPORTED, "this asset cannot be tested against the bound depth buffer; draw with depthTest = 0, or bind a framebuffer "
                                     "whose depth is a 2D texture or a renderbuffer"};
}

void detachHostDepth(const Gl& gl) { gl.FramebufferRenderbuffer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, 0); }

void freeDepthCopy(NacreContextImpl& context)
{
    context.gl.DeleteTextures(1, &context.depthCopy.texture);
    context.depthCopy = {};
}

} // namespace nacre
