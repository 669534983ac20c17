// Which GL context a NacreContext belongs to. Vertex arrays, framebuffers and queries are not shared, not even within a share group, and
// GL has no identity of a context to compare. So the vertex array carries one: a number in a part of it that nothing reads.
#include "context.h"

#include "asset.h"
#include "host_depth.h"
#include "instance.h"
#include "program.h"
#include "splat_shadows.h"
#include "textures.h"
#include "view.h"

#include <cstdint>

namespace nacre {

/// Different in all contexts that live at once, and no divisor anybody would set.
static GLuint mark(const Context& context) { return GLuint(reinterpret_cast<uintptr_t>(&context) >> 4) | 0x80000000u; }

void markGlContext(Context& context)
{
    const Gl& gl = context.gl;
    GLint hosts = 0;
    gl.GetIntegerv(GL_VERTEX_ARRAY_BINDING, &hosts);
    gl.GenVertexArrays(1, &context.vertexArray);
    gl.BindVertexArray(context.vertexArray);
    gl.VertexAttribDivisor(0, mark(context)); // the attribute is never enabled
    gl.BindVertexArray(GLuint(hosts));
}

Failure checkGlContext(const Context& context)
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

Context::Context() : splatShadows(std::make_unique<SplatShadows>(*this)) {}

Context::~Context() = default;

void Context::destroyObjects()
{
    for (const auto& view : views.all()) views.remove(view->handle);
    for (const auto& instance : instances.all()) instances.remove(instance->handle);
    for (const auto& asset : assets.all()) assets.remove(asset->handle);
    splatShadows.reset();
    programs.clear();
    passes.destroyQueries();
    freeDepthCopy(*this);
    gl.DeleteSamplers(1, &plainSampler);
    gl.DeleteVertexArrays(1, &vertexArray);
    gl.DeleteBuffers(1, &indexBuffer);
}

Failure growIndexBuffer(Context& context, size_t splats)
{
    const Gl& gl = context.gl;
    if (splats <= context.indexedSplats) return {};
    clearHostErrors(context);
    std::vector<uint32_t> indices(6 * splats);
    for (size_t n = 0; n < splats; ++n)
        for (size_t k = 0; k < 6; ++k) indices[6 * n + k] = uint32_t(4 * n + (k < 3 ? k : k == 3 ? 2 : k == 4 ? 1 : 3));
    gl.BindVertexArray(context.vertexArray);
    GLuint larger = 0;
    gl.GenBuffers(1, &larger);
    gl.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, larger);
    gl.BufferData(GL_ELEMENT_ARRAY_BUFFER, GLsizeiptr(indices.size() * sizeof(uint32_t)), indices.data(), GL_STATIC_DRAW);
    if (takeGlError(gl) != GL_NO_ERROR) {
        gl.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, context.indexBuffer);
        gl.DeleteBuffers(1, &larger);
        return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for the indices of " + std::to_string(splats) + " splats"};
    }
    std::swap(larger, context.indexBuffer);
    context.indexedSplats = splats;
    gl.DeleteBuffers(1, &larger);
    return {};
}

ForgottenObjects::ForgottenObjects(Context& context) : gl_(context.gl), functions_(context.gl)
{
    static constexpr auto kForget = [](GLsizei, const GLuint*) {};
    gl_.DeleteTextures = gl_.DeleteFramebuffers = gl_.DeleteBuffers = gl_.DeleteVertexArrays = gl_.DeleteQueries = gl_.DeleteSamplers = kForget;
    gl_.DeleteProgram = [](GLuint) {};
}

} // namespace nacre
