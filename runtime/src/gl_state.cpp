#include "gl_state.h"

#include <algorithm>

namespace nacre {

namespace {
/// A state, or a switch, and where it exists.
struct Known {
    GLenum name;
    enum { kEverywhere, kDesktop, kEs31, kWithClipDistances } where;
    bool in(const Gl& gl) const
    {
        return where == kEverywhere || (where == kWithClipDistances ? gl.clipDistances : !gl.es || (where == kEs31 && gl.version >= 31));
    }
};
} // namespace

static constexpr Known kUnpack[] = {
    {GL_UNPACK_SWAP_BYTES, Known::kDesktop},      {GL_UNPACK_LSB_FIRST, Known::kDesktop},      {GL_UNPACK_ROW_LENGTH, Known::kEverywhere},
    {GL_UNPACK_SKIP_ROWS, Known::kEverywhere},    {GL_UNPACK_SKIP_PIXELS, Known::kEverywhere}, {GL_UNPACK_SKIP_IMAGES, Known::kEverywhere},
    {GL_UNPACK_IMAGE_HEIGHT, Known::kEverywhere}, {GL_UNPACK_ALIGNMENT, Known::kEverywhere}};

// Switched off for the runtime's draws: each would drop, alter or duplicate fragments (or read what our shaders do not write).
static constexpr Known kToggles[] = {
    {GL_CULL_FACE, Known::kEverywhere}, {GL_COLOR_LOGIC_OP, Known::kDesktop}, {GL_RASTERIZER_DISCARD, Known::kEverywhere},
    {GL_POLYGON_OFFSET_FILL, Known::kEverywhere}, {GL_PRIMITIVE_RESTART, Known::kDesktop}, {GL_SAMPLE_ALPHA_TO_COVERAGE, Known::kEverywhere},
    {GL_SAMPLE_ALPHA_TO_ONE, Known::kDesktop}, {GL_SAMPLE_COVERAGE, Known::kEverywhere}, {GL_SAMPLE_MASK, Known::kEs31},
    {GL_POLYGON_SMOOTH, Known::kDesktop}, {GL_CLIP_DISTANCE0, Known::kWithClipDistances}, {GL_CLIP_DISTANCE1, Known::kWithClipDistances},
    {GL_CLIP_DISTANCE2, Known::kWithClipDistances}, {GL_CLIP_DISTANCE3, Known::kWithClipDistances}, {GL_CLIP_DISTANCE4, Known::kWithClipDistances},
    {GL_CLIP_DISTANCE5, Known::kWithClipDistances}, {GL_CLIP_DISTANCE6, Known::kWithClipDistances}, {GL_CLIP_DISTANCE7, Known::kWithClipDistances}};

// The same of a compatibility profile. Fixed functions that shaders replace (lighting, fog, texturing) do no harm.
static constexpr GLenum kAlphaTest = 0x0BC0, kPolygonStipple = 0x0B42, kClampFragmentColor = 0x891B; // not in the core header
static constexpr GLenum kLegacyToggles[] = {kAlphaTest, kPolygonStipple};

static void set(const Gl& gl, GLenum what, GLboolean on) { (on ? gl.Enable : gl.Disable)(what); }

ImageUnitGuard::ImageUnitGuard(const Gl& gl, HostState kind) : gl_(gl), kind_(kind)
{
    if (kind == HostState::kLeftToHost) return;
    gl.GetIntegeri_v(GL_IMAGE_BINDING_NAME, 0, &name_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_LEVEL, 0, &level_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_LAYERED, 0, &layered_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_LAYER, 0, &layer_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_ACCESS, 0, &access_);
    gl.GetIntegeri_v(GL_IMAGE_BINDING_FORMAT, 0, &format_);
}

ImageUnitGuard::~ImageUnitGuard()
{
    if (kind_ == HostState::kLeftToHost) return;
    gl_.BindImageTexture(0, GLuint(name_), level_, GLboolean(layered_), layer_, GLenum(access_), GLenum(format_));
}

void setViewport(const Gl& gl, const float box[4])
{
    if (gl.ViewportIndexedf) gl.ViewportIndexedf(0, box[0], box[1], box[2], box[3]);
    else gl.Viewport(GLint(box[0]), GLint(box[1]), GLsizei(box[2]), GLsizei(box[3]));
}

/// Indexed where viewports are: a plain call would switch the test of all.
static void setScissor(const Gl& gl, bool on)
{
    if (gl.ViewportIndexedf) (on ? gl.Enablei : gl.Disablei)(GL_SCISSOR_TEST, 0);
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

GlStateGuard::GlStateGuard(const Gl& gl, HostState kind)
    : gl_(gl), kind_(kind), drawBufferCount_(gl.ColorMaski ? std::min(gl.maxDrawBuffers, kMaxDrawBuffers) : 1)
{
    toggles_.fill(GL_TRUE); // for all that is known without asking
    if (kind == HostState::kPutBack) readAll();
    neutralise();
}

void GlStateGuard::readTarget()
{
    if (targetRead_) return;
    gl_.GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &target_.framebuffer);
    gl_.GetFloatv(GL_VIEWPORT, target_.viewport);
    target_.scissor = gl_.ViewportIndexedf ? gl_.IsEnabledi(GL_SCISSOR_TEST, 0) : gl_.IsEnabled(GL_SCISSOR_TEST);
    if (gl_.GetBooleani_v) gl_.GetBooleani_v(GL_COLOR_WRITEMASK, 0, target_.mask);
    else gl_.GetBooleanv(GL_COLOR_WRITEMASK, target_.mask);
    targetRead_ = true;
}

GlStateGuard::Blend GlStateGuard::readBlend(int i) const
{
    Blend b;
    const auto get = [&](GLenum name, GLint* value) {
        if (gl_.GetIntegeri_v) gl_.GetIntegeri_v(name, GLuint(i), value);
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

/// Premultiplied.
const GlStateGuard::Blend GlStateGuard::kOver{GL_ONE, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA, GL_FUNC_ADD, GL_FUNC_ADD};

void GlStateGuard::readAll()
{
    const Gl& gl = gl_;
    pauseTransformFeedback(); // first: while it runs, no other program can be used
    readTarget();
    gl.GetIntegerv(GL_READ_FRAMEBUFFER_BINDING, &readFramebuffer_);
    gl.GetIntegerv(GL_VERTEX_ARRAY_BINDING, &vertexArray_);
    gl.GetIntegerv(GL_CURRENT_PROGRAM, &program_); // 0: that of a pipeline object, which stays bound
    gl.GetIntegerv(GL_PIXEL_UNPACK_BUFFER_BINDING, &unpackBuffer_);
    gl.GetIntegerv(GL_ACTIVE_TEXTURE, &activeTexture_);
    for (int i = 0; i < kTextureUnits; ++i) {
        gl.ActiveTexture(GL_TEXTURE0 + i);
        gl.GetIntegerv(GL_TEXTURE_BINDING_2D, &units_[i].texture2D);
        gl.GetIntegerv(GL_TEXTURE_BINDING_2D_ARRAY, &units_[i].texture2DArray);
        gl.GetIntegerv(GL_SAMPLER_BINDING, &units_[i].sampler);
        if (i == kCubeMapUnit) gl.GetIntegerv(GL_TEXTURE_BINDING_CUBE_MAP, &cubeMap_);
    }
    static_assert(std::size(kUnpack) == kUnpackCount && std::size(kToggles) == kToggleCount && std::size(kLegacyToggles) == kLegacyToggleCount);
    for (size_t i = 0; i < kUnpackCount; ++i)
        if (kUnpack[i].in(gl)) gl.GetIntegerv(kUnpack[i].name, &unpack_[i]);
    for (size_t i = 0; i < kToggleCount; ++i)
        if (kToggles[i].in(gl)) toggles_[i] = gl.IsEnabled(kToggles[i].name);
    if (gl.compatibility) {
        for (size_t i = 0; i < kLegacyToggleCount; ++i) legacyToggles_[i] = gl.IsEnabled(kLegacyToggles[i]);
        gl.GetIntegerv(kClampFragmentColor, &clampFragmentColor_);
    }
    for (int i = 0; i < drawBufferCount_; ++i) {
        DrawBuffer& b = drawBuffers_[i];
        b.blend = gl.IsEnabledi ? gl.IsEnabledi(GL_BLEND, i) : gl.IsEnabled(GL_BLEND);
        if (i == 0) std::copy_n(target_.mask, 4, b.mask);
        else gl.GetBooleani_v(GL_COLOR_WRITEMASK, i, b.mask);
        if (i == 0) b.factors = readBlend(i);
    }
    if (gl.PolygonMode) {
        polygonMode_[0] = polygonMode_[1] = 0;
        gl.GetIntegerv(GL_POLYGON_MODE, polygonMode_); // core profiles may report one value, compatibility profiles two
        if (polygonMode_[1] == 0) polygonMode_[1] = polygonMode_[0];
    }
    depthTest_ = gl.IsEnabled(GL_DEPTH_TEST);
    gl.GetBooleanv(GL_DEPTH_WRITEMASK, &depthMask_);
}

/// What would harm any draw or upload of ours.
void GlStateGuard::neutralise()
{
    const Gl& gl = gl_;
    for (int i = 0; i < kTextureUnits; ++i) gl.BindSampler(i, 0);
    for (const Known& unpack : kUnpack)
        if (unpack.in(gl)) gl.PixelStorei(unpack.name, unpack.name == GL_UNPACK_ALIGNMENT ? 4 : 0);
    gl.BindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
    for (size_t i = 0; i < kToggleCount; ++i)
        if (toggles_[i] && kToggles[i].in(gl)) gl.Disable(kToggles[i].name);
    if (gl.compatibility) {
        for (const GLenum toggle : kLegacyToggles) gl.Disable(toggle);
        gl.ClampColor(kClampFragmentColor, GL_FALSE);
    }
    if (gl.PolygonMode) gl.PolygonMode(GL_FRONT_AND_BACK, GL_FILL);
}

/// Where blending has no index, of all draw buffers.
void GlStateGuard::setBlending(int i, const Blend& b) const
{
    if (gl_.BlendFuncSeparatei) {
        gl_.BlendEquationSeparatei(GLuint(i), GLenum(b.equationRgb), GLenum(b.equationAlpha));
        gl_.BlendFuncSeparatei(GLuint(i), GLenum(b.srcRgb), GLenum(b.dstRgb), GLenum(b.srcAlpha), GLenum(b.dstAlpha));
    } else {
        gl_.BlendEquationSeparate(GLenum(b.equationRgb), GLenum(b.equationAlpha));
        gl_.BlendFuncSeparate(GLenum(b.srcRgb), GLenum(b.dstRgb), GLenum(b.srcAlpha), GLenum(b.dstAlpha));
    }
}

void GlStateGuard::beginPasses()
{
    readTarget();
    disturbed_ = true;
    gl_.Disable(GL_DEPTH_TEST);
    setScissor(gl_, false);
    gl_.Disable(GL_BLEND);
    gl_.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

void GlStateGuard::beginDraw(bool depthTest)
{
    if (disturbed_) {
        gl_.BindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(target_.framebuffer));
        setViewport(gl_, target_.viewport);
        setScissor(gl_, target_.scissor);
        const GLboolean* mask = target_.mask;
        gl_.ColorMask(mask[0], mask[1], mask[2], mask[3]);
    }
    drawIntoFirst();
    beginBlending(depthTest);
}

void GlStateGuard::beginDepth()
{
    beginDraw(true);
    disturbed_ = true; // the colour mask
    gl_.DepthMask(GL_TRUE);
    gl_.ColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
}

void GlStateGuard::beginOffscreen(bool depthTest)
{
    readTarget();
    disturbed_ = true;
    if (gl_.BlendFuncSeparatei && !allBlending_) {
        for (int i = 1; i < drawBufferCount_; ++i) {
            if (kind_ == HostState::kPutBack) drawBuffers_[i].factors = readBlend(i);
            setBlending(i, kOver);
        }
        allBlending_ = true;
    }
    setViewport(gl_, target_.viewport);
    setScissor(gl_, false);
    gl_.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    beginBlending(depthTest);
}

void GlStateGuard::beginBlending(bool depthTest)
{
    set(gl_, GL_DEPTH_TEST, depthTest);
    gl_.DepthMask(GL_FALSE);
    gl_.Enable(GL_BLEND);
    setBlending(0, kOver);
}

/// The host's framebuffer is bound.
void GlStateGuard::drawIntoFirst()
{
    if (gl_.ColorMaski) {
        for (int i = 1; i < drawBufferCount_; ++i) gl_.ColorMaski(i, GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
        return;
    }
    std::vector<GLenum> buffers(size_t(std::min(gl_.maxDrawBuffers, kMaxDrawBuffers)), GL_NONE);
    for (size_t i = 0; i < buffers.size(); ++i) {
        GLint buffer = GL_NONE;
        gl_.GetIntegerv(GLenum(GL_DRAW_BUFFER0 + i), &buffer);
        buffers[i] = GLenum(buffer);
    }
    if (std::all_of(buffers.begin() + 1, buffers.end(), [](GLenum b) { return b == GL_NONE; })) return;
    gl_.DrawBuffers(1, buffers.data());
    hostDrawBuffers_ = std::move(buffers);
}

GlStateGuard::~GlStateGuard()
{
    const Gl& gl = gl_;
    if (!hostDrawBuffers_.empty()) {
        if (targetRead_) gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(target_.framebuffer));
        gl.DrawBuffers(GLsizei(hostDrawBuffers_.size()), hostDrawBuffers_.data()); // of the framebuffer: the host's for good
    }
    if (kind_ == HostState::kLeftToHost) return;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(target_.framebuffer));
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, GLuint(readFramebuffer_));
    gl.BindVertexArray(GLuint(vertexArray_));
    gl.UseProgram(GLuint(program_));
    gl.BindBuffer(GL_PIXEL_UNPACK_BUFFER, GLuint(unpackBuffer_));
    for (int i = 0; i < kTextureUnits; ++i) {
        gl.ActiveTexture(GL_TEXTURE0 + i);
        gl.BindTexture(GL_TEXTURE_2D, GLuint(units_[i].texture2D));
        gl.BindTexture(GL_TEXTURE_2D_ARRAY, GLuint(units_[i].texture2DArray));
        gl.BindSampler(i, GLuint(units_[i].sampler));
        if (i == kCubeMapUnit) gl.BindTexture(GL_TEXTURE_CUBE_MAP, GLuint(cubeMap_));
    }
    gl.ActiveTexture(GLenum(activeTexture_));
    for (size_t i = 0; i < kUnpackCount; ++i)
        if (kUnpack[i].in(gl)) gl.PixelStorei(kUnpack[i].name, unpack_[i]);
    for (size_t i = 0; i < kToggleCount; ++i)
        if (kToggles[i].in(gl)) set(gl, kToggles[i].name, toggles_[i]);
    const DrawBuffer& first = drawBuffers_[0]; // plain calls set all; where a state has an index, the others follow
    setBlending(0, first.factors);
    gl.ColorMask(first.mask[0], first.mask[1], first.mask[2], first.mask[3]);
    set(gl, GL_BLEND, first.blend);
    for (int i = 1; i < drawBufferCount_; ++i) {
        const DrawBuffer& b = drawBuffers_[i];
        (b.blend ? gl.Enablei : gl.Disablei)(GL_BLEND, i);
        gl.ColorMaski(i, b.mask[0], b.mask[1], b.mask[2], b.mask[3]);
        if (allBlending_) setBlending(i, b.factors);
    }
    if (gl.PolygonMode) {
        if (polygonMode_[0] == polygonMode_[1]) {
            gl.PolygonMode(GL_FRONT_AND_BACK, GLenum(polygonMode_[0]));
        } else {
            gl.PolygonMode(GL_FRONT, GLenum(polygonMode_[0]));
            gl.PolygonMode(GL_BACK, GLenum(polygonMode_[1]));
        }
    }
    set(gl, GL_DEPTH_TEST, depthTest_);
    gl.DepthMask(depthMask_);
    setScissor(gl, target_.scissor);
    setViewport(gl_, target_.viewport);
    if (gl.compatibility) {
        for (size_t i = 0; i < kLegacyToggleCount; ++i) set(gl, kLegacyToggles[i], legacyToggles_[i]);
        gl.ClampColor(kClampFragmentColor, GLenum(clampFragmentColor_));
    }
    if (feedbackPaused_) gl.ResumeTransformFeedback(); // last: it demands the program it was begun with
}

void GlStateGuard::pauseTransformFeedback()
{
    if (!gl_.PauseTransformFeedback) return; // cannot be asked nor paused; README tells the host
    GLint active = 0, paused = 0;
    gl_.GetIntegerv(GL_TRANSFORM_FEEDBACK_ACTIVE, &active);
    gl_.GetIntegerv(GL_TRANSFORM_FEEDBACK_PAUSED, &paused);
    feedbackPaused_ = active && !paused;
    if (feedbackPaused_) gl_.PauseTransformFeedback();
}

} // namespace nacre
