// Saves every piece of GL state the runtime touches and puts it back on scope exit; what only compute shaders touch has a guard of its own.
//
// Left as the host set it, on purpose: during the final draw the host's framebuffer, draw buffers, colour mask of draw buffer 0,
// viewport, scissor, stencil test, depth function, depth clamp, sRGB encoding, multisampling and clip control apply. Draw buffers after
// the first are masked off (in ES before 3.2, where masks have no index, switched off): the splats have one output, and GL would leave the
// others undefined.
//
// For a host that restores its own state nothing is put back, and nothing is read but what the draw itself needs once passes have
// disturbed it: framebuffer, viewport, scissor test and colour mask. At rest that is nothing.
#pragma once

#include "gl_api.h"

#include <array>
#include <vector>

namespace nacre {

constexpr int kTextureUnits = 6; // units 0..5 are used
constexpr int kCubeMapUnit = 1;  // the one that cube maps are bound to

/// Whether the host finds its state as it left it.
enum class HostState { kPutBack, kLeftToHost };

/// x, y, width, height of viewport 0; leaves the host's other viewports alone.
void setViewport(const Gl& gl, const float box[4]);

/// What glClipControl says: where y = -1 of clip space lies, and whether its z starts at 0.
struct ClipControl {
    bool upperLeft = false, zeroToOne = false;
    bool operator==(const ClipControl&) const = default;
};
ClipControl clipControl(const Gl& gl);

class GlStateGuard {
public:
    explicit GlStateGuard(const Gl& gl, HostState kind = HostState::kPutBack);
    ~GlStateGuard();
    GlStateGuard(const GlStateGuard&) = delete;
    GlStateGuard& operator=(const GlStateGuard&) = delete;

    /// State for the relighting passes: plain overwrite of float targets, no tests.
    void beginPasses();
    /// Back to the host's framebuffer, colour mask, viewport and scissor, with premultiplied blending and no depth writes.
    void beginDraw(bool depthTest);
    /// Same blending, viewport and depth test in a framebuffer of ours, all draw buffers, without the host's scissor. Binds none.
    void beginOffscreen(bool depthTest);
    /// In the host's framebuffer, as beginDraw: depth is tested and written, colours are not.
    void beginDepth();

    GLuint hostFramebuffer() { return readTarget(), GLuint(target_.framebuffer); }
    const float* viewport() { return readTarget(), target_.viewport; } // x, y, width, height

private:
    static constexpr int kMaxDrawBuffers = 8;
    static constexpr size_t kToggleCount = 18, kLegacyToggleCount = 2, kUnpackCount = 8;
    struct Unit { GLint texture2D, texture2DArray, sampler; };
    struct Blend { GLint srcRgb, dstRgb, srcAlpha, dstAlpha, equationRgb, equationAlpha; };
    static const Blend kOver;
    struct DrawBuffer { GLboolean blend, mask[4]; Blend factors; };
    struct Target { // what passes replace and the draw wants back
        GLint framebuffer;
        float viewport[4];
        GLboolean scissor, mask[4];
    };

    void readTarget();
    void readAll();
    Blend readBlend(int drawBuffer) const;
    void neutralise();
    void setBlending(int drawBuffer, const Blend& b) const;
    void beginBlending(bool depthTest);
    void drawIntoFirst();
    void pauseTransformFeedback();

    const Gl& gl_;
    const HostState kind_;
    const int drawBufferCount_; // that have a state of their own
    bool targetRead_ = false, disturbed_ = false, allBlending_ = false; // the last: functions of all draw buffers have been read, and changed
    Target target_;
    std::vector<GLenum> hostDrawBuffers_; // empty unless they have been replaced
    GLint readFramebuffer_, vertexArray_, program_, activeTexture_, unpackBuffer_;
    std::array<Unit, kTextureUnits> units_;
    GLint cubeMap_;
    std::array<DrawBuffer, kMaxDrawBuffers> drawBuffers_;
    std::array<GLint, kUnpackCount> unpack_;
    std::array<GLboolean, kToggleCount> toggles_;
    std::array<GLboolean, kLegacyToggleCount> legacyToggles_; // compatibility profile
    GLint clampFragmentColor_;
    bool feedbackPaused_ = false;
    GLint polygonMode_[2];
    GLboolean depthTest_, depthMask_;
};

/// Image unit 0. Only where there are compute shaders.
class ImageUnitGuard {
public:
    ImageUnitGuard(const Gl& gl, HostState kind);
    ~ImageUnitGuard();
    ImageUnitGuard(const ImageUnitGuard&) = delete;
    ImageUnitGuard& operator=(const ImageUnitGuard&) = delete;

private:
    const Gl& gl_;
    const HostState kind_;
    GLint name_ = 0, level_ = 0, layered_ = 0, layer_ = 0, access_ = 0, format_ = 0;
};

} // namespace nacre
