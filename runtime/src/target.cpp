#include "target.h"

#include <cstdio>
#include <limits>

namespace nacre {

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

Failure checkTarget(const Gl& gl, bool colors)
{
    const GLenum status = gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER);
    GLint framebuffer = 0;
    gl.GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer);
    if (status == GL_FRAMEBUFFER_COMPLETE) {
        if (!colors || !holdsIntegers(gl)) return {};
        return {NACRE_ERROR_GL, "the first draw buffer of framebuffer " + std::to_string(framebuffer) +
                                    " holds integers, into which nothing can be blended; bind a linear float target (RGBA16F)"};
    }
    char hex[16];
    std::snprintf(hex, sizeof hex, "0x%04X", status);
    return {NACRE_ERROR_GL, "the bound draw framebuffer " + std::to_string(framebuffer) + " is incomplete (status " + hex +
                                "); complete it before you draw"};
}

} // namespace nacre
