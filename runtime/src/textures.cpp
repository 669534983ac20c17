#include "textures.h"

#include "base/half.h"
#include "base/text.h"
#include "gl_state.h"

#include <bit>
#include <cmath>
#include <limits>

namespace nacre {

void bindTexture(const Gl& gl, int unit, GLenum target, GLuint texture)
{
    gl.ActiveTexture(GL_TEXTURE0 + GLenum(unit));
    gl.BindTexture(target, texture);
}

namespace {
struct TexelFormat {
    GLenum internal, layout, type;
    int bytes;
};
} // namespace
static const TexelFormat& texelFormat(GLenum internal)
{
    static constexpr TexelFormat kFormats[] = {{GL_RGBA32F, GL_RGBA, GL_FLOAT, 16},
                                               {GL_RGBA16F, GL_RGBA, GL_HALF_FLOAT, 8},
                                               {GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, 4},
                                               {GL_RG32UI, GL_RG_INTEGER, GL_UNSIGNED_INT, 8},
                                               {GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE, 4},
                                               {GL_R8, GL_RED, GL_UNSIGNED_BYTE, 1}};
    return *std::find_if(std::begin(kFormats), std::end(kFormats), [&](const TexelFormat& f) { return f.internal == internal; });
}

Texture::Texture(Context& context, GLenum format, int width, int height)
    : target_(GL_TEXTURE_2D), format_(format), width_(width), height_(height), layers_(1)
{
    create(context);
    const TexelFormat& f = texelFormat(format);
    context.gl.TexImage2D(target_, 0, GLint(format), width, height, 0, f.layout, f.type, nullptr);
}

Texture::Texture(Context& context, GLenum format, int width, int height, int layers)
    : target_(GL_TEXTURE_2D_ARRAY), format_(format), width_(width), height_(height), layers_(layers)
{
    create(context);
    const TexelFormat& f = texelFormat(format);
    context.gl.TexImage3D(target_, 0, GLint(format), width, height, layers, 0, f.layout, f.type, nullptr);
}

void Texture::create(Context& context)
{
    const Gl& gl = context.gl;
    gl.GenTextures(1, &name_);
    bindTexture(gl, 0, target_, name_);
    gl.TexParameteri(target_, GL_TEXTURE_MIN_FILTER, GL_NEAREST); // the default filter would make one without mip levels incomplete
    gl.TexParameteri(target_, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.TexParameteri(target_, GL_TEXTURE_MAX_LEVEL, 0);
    gl.TexParameteri(target_, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    gl.TexParameteri(target_, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    context_ = &context;
    context.gpuBytes += bytes();
}

Texture::~Texture()
{
    if (!context_) return;
    context_->gl.DeleteTextures(1, &name_);
    context_->gpuBytes -= bytes();
}

void Texture::swap(Texture& o) noexcept
{
    std::swap(context_, o.context_), std::swap(name_, o.name_), std::swap(target_, o.target_), std::swap(format_, o.format_);
    std::swap(width_, o.width_), std::swap(height_, o.height_), std::swap(layers_, o.layers_);
}

uint64_t Texture::bytes() const
{
    return name_ ? uint64_t(texelFormat(format_).bytes) * uint64_t(width_) * uint64_t(height_) * uint64_t(layers_) : 0;
}

void Texture::bind(int unit) const
{
    if (name_) bindTexture(context_->gl, unit, target_, name_);
}

Framebuffer::Framebuffer(Context& context) : context_(&context)
{
    context.gl.GenFramebuffers(1, &name_);
    bind();
}

Framebuffer::~Framebuffer()
{
    if (context_) context_->gl.DeleteFramebuffers(1, &name_);
}

void Framebuffer::attach(int color, const Texture& texture, int layer) const
{
    const GLenum attachment = GL_COLOR_ATTACHMENT0 + GLenum(color);
    if (texture.target() == GL_TEXTURE_2D_ARRAY) context_->gl.FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, attachment, texture.name(), 0, layer);
    else context_->gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, attachment, GL_TEXTURE_2D, texture.name(), 0);
}

void Framebuffer::drawTo(int colors) const
{
    GLenum attachments[16];
    for (int k = 0; k < colors; ++k) attachments[k] = GL_COLOR_ATTACHMENT0 + GLenum(k);
    context_->gl.DrawBuffers(colors, attachments);
}

void clearHostErrors(const Context& context)
{
    if (const GLenum pending = takeGlError(context.gl); pending != GL_NO_ERROR)
        context.report(NACRE_WARNING, "the host had a pending GL error " + std::to_string(pending) + "; it was cleared");
}

bool allocated(const Gl& gl)
{
    const bool complete = gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    return takeGlError(gl) == GL_NO_ERROR && complete;
}

void SplatGrid::set(const Program& program) const
{
    program.set("uCount", int(count));
    program.set("uWidth", width);
    program.set("uRows", rows);
    program.set("uRowShift", rowShift);
}

Texture slotTexture(Context& context, const SplatGrid& grid, GLenum format, int slots) { return Texture(context, format, grid.width, grid.rows * slots); }

void runPass(Context& context, int width, int first, int rows)
{
    const Gl& gl = context.gl;
    context.passes.pass();
    const float box[4] = {0, float(first), float(width), float(rows)};
    setViewport(gl, box);
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
}

void uploadLights(const Gl& gl, const Texture& texture, const std::vector<PackedLight>& lights, size_t first, size_t end)
{
    if (first >= end) return;
    const size_t count = end - first;
    std::vector<glm::vec4> texels(kLightRows * count);
    for (size_t row = 0; row < kLightRows; ++row)
        for (size_t i = 0; i < count; ++i) texels[row * count + i] = lights[first + i].row[row];
    texture.bind(0);
    gl.TexSubImage2D(GL_TEXTURE_2D, 0, GLint(first), 0, GLsizei(count), kLightRows, GL_RGBA, GL_FLOAT, texels.data());
}

void copyRows(Context& context, const Texture& from, const Texture& to, int rows)
{
    const Gl& gl = context.gl;
    const Framebuffer source(context);
    source.attach(0, from);
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, source.name());
    to.bind(0);
    gl.CopyTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, 0, 0, from.width(), rows);
}

/// Of draw buffer 0 alone: the state guard reads those of the others only where all are blended into.
static void beginBlending(const Gl& gl, GLenum srcRgb, GLenum dstRgb, GLenum srcAlpha, GLenum dstAlpha)
{
    gl.Enable(GL_BLEND);
    if (gl.BlendFuncSeparatei) {
        gl.BlendEquationSeparatei(0, GL_FUNC_ADD, GL_FUNC_ADD);
        gl.BlendFuncSeparatei(0, srcRgb, dstRgb, srcAlpha, dstAlpha);
    } else {
        gl.BlendEquationSeparate(GL_FUNC_ADD, GL_FUNC_ADD);
        gl.BlendFuncSeparate(srcRgb, dstRgb, srcAlpha, dstAlpha);
    }
}

void beginAdding(const Gl& gl) { beginBlending(gl, GL_ONE, GL_ONE, GL_ONE, GL_ONE); }

void beginMultiplying(const Gl& gl, GLenum colorFactor, GLenum alphaFactor) { beginBlending(gl, GL_ZERO, colorFactor, GL_ZERO, alphaFactor); }

Failure fitLongRow(const Gl& gl, SplatGrid& grid, const char* channel, size_t splats, int64_t texelsPerSplat)
{
    constexpr int kSmallestShift = 8; // drivers round smaller layers up
    const int largestShift = std::bit_width(unsigned(gl.maxTextureSize)) - 1;
    const int64_t texels = int64_t(splats) * texelsPerSplat;
    const auto layersAt = [&](int shift) { return (texels >> 2 * shift) + 1; };
    int& shift = grid.rowShift;
    shift = std::max(shift, std::min(kSmallestShift, largestShift));
    while (layersAt(shift) > gl.maxArrayLayers && shift < largestShift) ++shift;
    const int64_t layers = layersAt(shift);
    if (layers <= gl.maxArrayLayers && texels <= std::numeric_limits<int32_t>::max()) return {};
    return {NACRE_ERROR_UNSUPPORTED, std::string("the ") + channel + " of " + std::to_string(splats) + " splats needs " +
                                         std::to_string(texels) + " texels in " + std::to_string(layers) +
                                         " layers, drawn are at most 2^31 - 1 and, by this GPU, " + std::to_string(gl.maxArrayLayers) +
                                         " layers; bake with fewer splats or a smaller s"};
}

Failure checkHalfRange(const Channel& channel)
{
    for (size_t i = 0; i < channel.values.size(); ++i)
        if (!(std::abs(channel.values[i]) <= kMaxHalf))
            return {NACRE_ERROR_BAD_ASSET, "channel '" + channel.name + "' has a value of " + numberText(channel.values[i]) +
                                               " at splat " + std::to_string(i / channel.components) +
                                               ", the largest that can be drawn is 65504"};
    return {};
}

void UploadQueue::step(uint64_t budget)
{
    for (uint64_t done = 0; !empty() && (done == 0 || done + pieces_[next_].bytes <= budget); ++next_) {
        Piece& piece = pieces_[next_];
        piece.upload();
        piece.upload = nullptr;
        done += std::max<uint64_t>(piece.bytes, 1);
        left_ -= piece.bytes;
    }
}

void queueVisibility(UploadQueue& queue, Context& context, const SplatGrid& grid, Texture& texture, const Channel& visibility)
{
    queueLongRow<uint8_t>(queue, context, grid, texture, GL_R8, 1, visibility.bytes.size(), [&visibility](size_t t, uint8_t* out) { *out = visibility.bytes[t]; });
}

} // namespace nacre
