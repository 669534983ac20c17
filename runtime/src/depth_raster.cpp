#include "depth_raster.h"

#include "host_depth.h"
#include "shader_sources.h"

#include <algorithm>

namespace nacre {

Failure DepthRaster::drawCasters(const ViewFrame& frame, const DrawList& list, std::span<const ListSpan> spans, float leastAlpha, GlStateGuard& state)
{
    const Gl& gl = context_.gl;
    const Program* program = nullptr;
    if (Failure f = findProgram(context_, {"caster", define("UNORDERED", 1) + shaders::kListGlsl + shaders::kDepthVertGlsl, shaders::kDepthCasterFragGlsl,
                                           {"uProjected0", "uProjected1"}}, &program))
        return f;
    uint32_t most = 0;
    for (const ListSpan& span : spans) most = std::max(most, span.count);
    if (Failure f = growIndexBuffer(context_, most)) return f;
    state.beginDepth();
    program->use();
    list.projected0.bind(0), list.projected1.bind(1);
    program->set("uListWidth", list.width());
    program->set("uViewport", frame.viewport);
    program->set("uLeastAlpha", leastAlpha);
    for (const ListSpan& span : spans) {
        program->set("uFirstIndex", int(span.first));
        gl.DrawElements(GL_TRIANGLES, GLsizei(6 * span.count), GL_UNSIGNED_INT, nullptr);
    }
    return {};
}

Failure DepthRaster::check() const
{
    if (context_.gl.floatBlend) return {};
    return {NACRE_ERROR_UNSUPPORTED, "depthWrite blends depth in 32-bit floats, which this OpenGL ES or WebGL cannot (EXT_float_blend); draw with depthWrite = 0"};
}

/// Under the host's pixels, so that its depth buffer fits.
Failure DepthRaster::grow(int width, int height)
{
    if (layer_ && layer_.width() == width && layer_.height() == height) return {};
    clearHostErrors(context_);
    layer_ = {}, framebuffer_ = {};
    layer_ = Texture(context_, GL_RGBA32F, width, height);
    framebuffer_ = Framebuffer(context_);
    framebuffer_.attach(0, layer_);
    if (allocated(context_.gl)) return {};
    layer_ = {};
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for the depth of " + std::to_string(width) + " x " + std::to_string(height) +
                                           " pixels; draw into a smaller viewport, or with depthWrite = 0"};
}

Failure DepthRaster::blend(const ViewFrame& frame, const DrawList& list, uint32_t splats, bool depthTest, GlStateGuard& state)
{
    const Gl& gl = context_.gl;
    const Program* program = nullptr;
    if (Failure f = findProgram(context_, {"depth", std::string(shaders::kListGlsl) + shaders::kDepthVertGlsl, shaders::kDepthFragGlsl,
                                           {"uProjected0", "uProjected1", "uOrder"}}, &program))
        return f;
    constexpr float kNothing[4] = {0, 0, 0, 0};
    state.beginOffscreen(depthTest);
    framebuffer_.bind();
    gl.ClearBufferfv(GL_COLOR, 0, kNothing);
    if (depthTest)
        if (Failure f = attachHostDepth(context_, state.hostFramebuffer(), framebuffer_.name(), state.viewport())) return f;
    program->use();
    list.projected0.bind(0), list.projected1.bind(1), list.order.bind(2);
    program->set("uListWidth", list.width());
    program->set("uViewport", frame.viewport);
    gl.DrawElements(GL_TRIANGLES, GLsizei(6 * splats), GL_UNSIGNED_INT, nullptr);
    if (depthTest) detachHostDepth(gl);
    return {};
}

Failure DepthRaster::write(const ViewFrame& frame, const DrawList& list, uint32_t splats, bool depthTest, float leastAlpha, GlStateGuard& state)
{
    const Gl& gl = context_.gl;
    const float* viewport = state.viewport();
    if (Failure f = grow(int(std::max(viewport[0], 0.0f) + viewport[2]), int(std::max(viewport[1], 0.0f) + viewport[3]))) return f;
    if (Failure f = blend(frame, list, splats, depthTest, state)) return f;
    const Program* program = nullptr;
    if (Failure f = findProgram(context_, {"depth", shaders::kFullscreenVertGlsl, shaders::kDepthWriteFragGlsl, {"uLayer"}}, &program)) return f;
    state.beginDepth();
    program->use();
    layer_.bind(0);
    program->set("uLeastAlpha", leastAlpha);
    program->set("uZeroToOne", int(frame.clip.zeroToOne));
    GLint hosts = GL_LESS;
    if (!depthTest) gl.GetIntegerv(GL_DEPTH_FUNC, &hosts), gl.DepthFunc(GL_ALWAYS); // GL writes depth only where it tests it
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
    if (!depthTest) gl.DepthFunc(GLenum(hosts));
    return {};
}

} // namespace nacre
