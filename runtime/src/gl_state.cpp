#include "gl_state.h"

#include <algorithm>

namespace nacre {

static constexpr GLenum kUnpack[] = {GL_UNPACK_SWAP_BYTES, GL_UNPACK_LSB_FIRST,   GL_UNPACK_ROW_LENGTH,  GL_UNPACK_SKIP_ROWS,
                                     GL_UNPACK_SKIP_PIXELS, GL_UNPACK_SKIP_IMAGES, GL_UNPACK_IMAGE_HEIGHT, GL_UNPACK_ALIGNMENT};

// Switched off for the runtime's draws: each would drop, alter or duplicate fragments (or read what our shaders do not write).
static constexpr GLenum kToggles[] = {
    GL_CULL_FACE, GL_COLOR_LOGIC_OP, GL_RASTERIZER_DISCARD, GL_POLYGON_OFFSET_FILL, GL_PRIMITIVE_RESTART,
    GL_SAMPLE_ALPHA_TO_COVERAGE, GL_SAMPLE_ALPHA_TO_ONE, GL_SAMPLE_COVERAGE, GL_SAMPLE_MASK, GL_POLYGON_SMOOTH,
    GL_CLIP_DISTANCE0, GL_CLIP_DISTANCE1, GL_CLIP_DISTANCE2, GL_CLIP_DISTANCE3, GL_CLIP_DISTANCE4, GL_CLIP_DISTANCE5,
    GL_CLIP_DISTANCE6, GL_CLIP_DISTANCE7};

// The same of a compatibility profile. Fixed functions that shaders replace (lighting, fog, texturing) do no harm.
static constexpr GLenum kAlphaTest = 0x0BC0, kPolygonStipple = 0x0B42, kClampFragmentColor = 0x891B; // not in the core header
static constexpr GLenum kLegacyToggles[] = {kAlphaTest, kPolygonStipple};

static void set(const Gl& gl, GLenum what, GLboolean on) { (on ? gl.Enable : gl.Disable)(what); }

ImageUnitGuard::ImageUnitGuard(const Gl& gl) : gl_(gl)
{
    gl.GetIntegeri_v(GL_IMAGE_BINDING_NAME, 0, &name_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_LEVEL, 0, &level_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_LAYERED, 0, &layered_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_LAYER, 0, &layer_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_ACCESS, 0, &access_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_FORMAT, 0, &format_);
}

ImageUnitGuard::~ImageUnitGuard()
{
    gl_.BindImageTexture(0, GLuint(name_), level_, GLboolean(layered_), layer_, GLenum(access_), GLenum(format_));
}

GlStateGuard::Blend GlStateGuard::readBlend(int i) const
{
    Blend b;
    const auto get = [&](GLenum name, GLint* value) {
        if (gl_.version >= 40) gl_.GetIntegeri_v(name, GLuint(i), value);
        else gl_.GetIntegerv(name, value);
    };
    get(GL_BLEND_SRC_RGB, &b.srcRgb);
    get(GL_BLEND_DST_RGB, &b.dstRgb);
    get(GL_BLEND_SRC_ALPHA, &b.srcAlpha);
    get(GL_BLEND_DST_ALPHA, &b.dstAlpha);
    get(GL_BLEND_EQUATION_RGB, &b.equationRgb);
    get(GL_BLEND_EQUATION_ALPHA, &b.equationAlpha);
    return b;
}

void setViewport(const Gl& gl, const float box[4])
{
    if (gl.ViewportIndexedf) gl.ViewportIndexedf(0, box[0], box[1], box[2], box[3]);
    else gl.Viewport(GLint(box[0]), GLint(box[1]), GLsizei(box[2]), GLsizei(box[3]));
}

/// Indexed from 4.1 on, like the viewports: a plain call would switch the test of all.
static void setScissor(const Gl& gl, bool on)
{
    if (gl.version >= 41) (on ? gl.Enablei : gl.Disablei)(GL_SCISSOR_TEST, 0);
    else set(gl, GL_SCISSOR_TEST, on);
}

ClipControl clipControl(const Gl& gl)
{
    if (!gl.clipControl) return {};
    GLint origin = GL_LOWER_LEFT, depth = GL_NEGATIVE_ONE_TO_ONE;
    gl.GetIntegerv(GL_CLIP_ORIGIN, &origin);
    gl.GetIntegerv(GL_CLIP_DEPTH_MODE, &depth);
    return {origin == GL_UPPER_LEFT, depth == GL_ZERO_TO_ONE};
}

GlStateGuard::GlStateGuard(const Gl& gl) : gl_(gl), drawBufferCount_(std::min(gl.maxDrawBuffers, kMaxDrawBuffers))
{
    pauseTransformFeedback(); // first: while it runs, no other program can be used
    gl.GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &drawFramebuffer_);
    gl.GetIntegerv(GL_READ_FRAMEBUFFER_BINDING, &readFramebuffer_);
    gl.GetIntegerv(GL_VERTEX_ARRAY_BINDING, &vertexArray_);
    gl.GetIntegerv(GL_CURRENT_PROGRAM, &program_);
    gl.GetIntegerv(GL_PIXEL_UNPACK_BUFFER_BINDING, &unpackBuffer_);
    gl.GetIntegerv(GL_ACTIVE_TEXTURE, &activeTexture_);
    for (int i = 0; i < kTextureUnits; ++i) {
        gl.ActiveTexture(GL_TEXTURE0 + i);
        gl.GetIntegerv(GL_TEXTURE_BINDING_2D, &units_[i].texture2D);
        gl.GetIntegerv(GL_TEXTURE_BINDING_2D_ARRAY, &units_[i].texture2DArray);
        gl.GetIntegerv(GL_SAMPLER_BINDING, &units_[i].sampler);
        gl.BindSampler(i, 0);
    }
    for (size_t i = 0; i < std::size(kUnpack); ++i) {
        gl.GetIntegerv(kUnpack[i], &unpack_[i]);
        gl.PixelStorei(kUnpack[i], kUnpack[i] == GL_UNPACK_ALIGNMENT ? 4 : 0);
    }
    gl.BindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
    static_assert(std::size(kToggles) == kToggleCount);
    for (size_t i = 0; i < std::size(kToggles); ++i) {
        toggles_[i] = gl.IsEnabled(kToggles[i]);
        if (toggles_[i]) gl.Disable(kToggles[i]);
    }
    if (gl.compatibility) {
        static_assert(std::size(kLegacyToggles) == kLegacyToggleCount);
        for (size_t i = 0; i < std::size(kLegacyToggles); ++i) {
            legacyToggles_[i] = gl.IsEnabled(kLegacyToggles[i]);
            gl.Disable(kLegacyToggles[i]);
        }
        gl.GetIntegerv(kClampFragmentColor, &clampFragmentColor_);
        gl.ClampColor(kClampFragmentColor, GL_FALSE);
    }
    for (int i = 0; i < drawBufferCount_; ++i) {
        DrawBuffer& b = drawBuffers_[i];
        b.blend = gl.IsEnabledi(GL_BLEND, i);
        gl.GetBooleani_v(GL_COLOR_WRITEMASK, i, b.mask);
        gl.ColorMaski(i, GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
        b.factors = readBlend(i);
    }
    polygonMode_[0] = polygonMode_[1] = 0;
    gl.GetIntegerv(GL_POLYGON_MODE, polygonMode_); // core profiles may report one value, compatibility profiles two
    if (polygonMode_[1] == 0) polygonMode_[1] = polygonMode_[0];
    gl.PolygonMode(GL_FRONT_AND_BACK, GL_FILL);
    depthTest_ = gl.IsEnabled(GL_DEPTH_TEST);
    scissor_ = gl.version >= 41 ? gl.IsEnabledi(GL_SCISSOR_TEST, 0) : gl.IsEnabled(GL_SCISSOR_TEST);
    GLint depthMask = 0;
    gl.GetIntegerv(GL_DEPTH_WRITEMASK, &depthMask);
    depthMask_ = GLboolean(depthMask != 0);
    gl.GetFloatv(GL_VIEWPORT, viewport_);
}

void GlStateGuard::beginPasses()
{
    gl_.Disable(GL_DEPTH_TEST);
    setScissor(gl_, false);
    gl_.Disable(GL_BLEND);
}

void GlStateGuard::beginDraw(bool depthTest)
{
    gl_.BindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(drawFramebuffer_));
    setViewport(gl_, viewport_);
    setScissor(gl_, scissor_);
    const GLboolean* mask = drawBuffers_[0].mask;
    gl_.ColorMaski(0, mask[0], mask[1], mask[2], mask[3]);
    for (int i = 1; i < drawBufferCount_; ++i) gl_.ColorMaski(i, GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE); // splats have one output
    beginBlending(depthTest);
}

void GlStateGuard::beginOffscreen(bool depthTest)
{
    setViewport(gl_, viewport_);
    setScissor(gl_, false);
    for (int i = 0; i < drawBufferCount_; ++i) gl_.ColorMaski(i, GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    beginBlending(depthTest);
}

void GlStateGuard::beginBlending(bool depthTest)
{
    set(gl_, GL_DEPTH_TEST, depthTest);
    gl_.DepthMask(GL_FALSE);
    gl_.Enable(GL_BLEND);
    gl_.BlendEquationSeparate(GL_FUNC_ADD, GL_FUNC_ADD);
    gl_.BlendFuncSeparate(GL_ONE, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
}

GlStateGuard::~GlStateGuard()
{
    const Gl& gl = gl_;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(drawFramebuffer_));
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, GLuint(readFramebuffer_));
    gl.BindVertexArray(GLuint(vertexArray_));
    gl.UseProgram(GLuint(program_));
    gl.BindBuffer(GL_PIXEL_UNPACK_BUFFER, GLuint(unpackBuffer_));
    for (int i = 0; i < kTextureUnits; ++i) {
        gl.ActiveTexture(GL_TEXTURE0 + i);
        gl.BindTexture(GL_TEXTURE_2D, GLuint(units_[i].texture2D));
        gl.BindTexture(GL_TEXTURE_2D_ARRAY, GLuint(units_[i].texture2DArray));
        gl.BindSampler(i, GLuint(units_[i].sampler));
    }
    gl.ActiveTexture(GLenum(activeTexture_));
    for (size_t i = 0; i < std::size(kUnpack); ++i) gl.PixelStorei(kUnpack[i], unpack_[i]);
    for (size_t i = 0; i < std::size(kToggles); ++i) set(gl, kToggles[i], toggles_[i]);
    const Blend& first = drawBuffers_[0].factors;
    gl.BlendEquationSeparate(first.equationRgb, first.equationAlpha);
    gl.BlendFuncSeparate(first.srcRgb, first.dstRgb, first.srcAlpha, first.dstAlpha);
    for (int i = 0; i < drawBufferCount_; ++i) {
        const DrawBuffer& b = drawBuffers_[i];
        (b.blend ? gl.Enablei : gl.Disablei)(GL_BLEND, i);
        gl.ColorMaski(i, b.mask[0], b.mask[1], b.mask[2], b.mask[3]);
        if (gl.BlendFuncSeparatei) {
            gl.BlendEquationSeparatei(i, b.factors.equationRgb, b.factors.equationAlpha);
            gl.BlendFuncSeparatei(i, b.factors.srcRgb, b.factors.dstRgb, b.factors.srcAlpha, b.factors.dstAlpha);
        }
    }
    if (polygonMode_[0] == polygonMode_[1]) {
        gl.PolygonMode(GL_FRONT_AND_BACK, GLenum(polygonMode_[0]));
    } else {
        gl.PolygonMode(GL_FRONT, GLenum(polygonMode_[0]));
        gl.PolygonMode(GL_BACK, GLenum(polygonMode_[1]));
    }
    set(gl, GL_DEPTH_TEST, depthTest_);
    gl.DepthMask(depthMask_);
    setScissor(gl, scissor_);
    setViewport(gl_, viewport_);
    if (gl.compatibility) {
        for (size_t i = 0; i < std::size(kLegacyToggles); ++i) set(gl, kLegacyToggles[i], legacyToggles_[i]);
        gl.ClampColor(kClampFragmentColor, GLenum(clampFragmentColor_));
    }
    if (feedbackPaused_) gl.ResumeTransformFeedback(); // last: it demands the program it was begun with
}

void GlStateGuard::pauseTransformFeedback()
{
    if (gl_.version < 40) return; // cannot be asked nor paused; README tells the host
    GLint active = 0, paused = 0;
    gl_.GetIntegerv(GL_TRANSFORM_FEEDBACK_ACTIVE, &active);
    gl_.GetIntegerv(GL_TRANSFORM_FEEDBACK_PAUSED, &paused);
    feedbackPaused_ = active && !paused;
    if (feedbackPaused_) gl_.PauseTransformFeedback();
}

} // namespace nacre
