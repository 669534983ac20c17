// Which GL context a NacreContext belongs to. Vertex arrays, framebuffers and queries are not shared, not even within a share group, and
// GL has no identity of a context to compare. So the vertex array carries one: a number in a part of it that nothing reads.
#include "context.h"

#include <cstdint>

namespace nacre {

/// Different in all contexts that live at once, and no divisor anybody would set.
static GLuint mark(const NacreContextImpl& context) { return GLuint(reinterpret_cast<uintptr_t>(&context) >> 4) | 0x80000000u; }

void markGlContext(NacreContextImpl& context)
{
    const Gl& gl = context.gl;
    GLint hosts = 0;
    gl.GetIntegerv(GL_VERTEX_ARRAY_BINDING, &hosts);
    gl.GenVertexArrays(1, &context.vertexArray);
    gl.BindVertexArray(context.vertexArray);
    gl.VertexAttribDivisor(0, mark(context)); // the attribute is never enabled
    gl.BindVertexArray(GLuint(hosts));
}

Failure checkGlContext(const NacreContextImpl& context)
{
    const Gl& gl = context.gl;
    if (gl.IsVertexArray(context.vertexArray)) {
        GLint hosts = 0, found = 0;
        gl.GetIntegerv(GL_VERTEX_ARRAY_BINDING, &hosts);
        gl.BindVertexArray(context.vertexArray);
        gl.GetVertexAttribiv(0, GL_VERTEX_ATTRIB_ARRAY_DIVISOR, &found);
        gl.BindVertexArray(GLuint(hosts));
        if (GLuint(found) == mark(context)) return {};
    }
    if (!gl.GetString(GL_VERSION)) return {NACRE_ERROR_GL, "no OpenGL context is current on this thread; make the one of nacreContextCreate current"};
    return {NACRE_ERROR_GL, "another OpenGL context is current than in nacreContextCreate; framebuffers and vertex arrays are not shared, even "
                            "between contexts that share: make that one current, or create a NacreContext and assets for each"};
}

ForgottenObjects::ForgottenObjects(NacreContextImpl& context) : gl_(context.gl), functions_(context.gl)
{
    static constexpr auto kForget = [](GLsizei, const GLuint*) {};
    gl_.DeleteTextures = gl_.DeleteFramebuffers = gl_.DeleteBuffers = gl_.DeleteVertexArrays = gl_.DeleteQueries = kForget;
    gl_.DeleteProgram = [](GLuint) {};
}

} // namespace nacre
