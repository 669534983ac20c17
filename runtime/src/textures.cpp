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

void setNearest(const Gl& gl, GLenum target)
{
    gl.TexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.TexParameteri(target, GL_TEXTURE_MAX_LEVEL, 0);
}

GLuint createSlotTexture(NacreAssetImpl& asset, GLenum format, int slots) { return createRowTexture(asset, format, asset.rows * slots); }

GLuint createRowTexture(NacreAssetImpl& asset, GLenum format, int height)
{
    const Gl& gl = asset.context->gl;
    const bool index = format == GL_R32UI;
    GLuint texture = 0;
    gl.GenTextures(1, &texture);
    bindTexture(gl, 0, GL_TEXTURE_2D, texture);
    setNearest(gl, GL_TEXTURE_2D);
    gl.TexImage2D(GL_TEXTURE_2D, 0, GLint(format), asset.width, height, 0, index ? GL_RED_INTEGER : GL_RGBA,
                  index ? GL_UNSIGNED_INT : GL_FLOAT, nullptr);
    const uint64_t texelBytes = format == GL_RGBA32F ? 16 : format == GL_RGBA16F ? 8 : 4;
    asset.gpuBytes += texelBytes * uint64_t(asset.width) * uint64_t(height);
    return texture;
}

GLuint createTarget(const Gl& gl, GLuint texture)
{
    GLuint framebuffer = 0;
    gl.GenFramebuffers(1, &framebuffer);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture, 0);
    return framebuffer;
}

void clearHostErrors(const NacreContextImpl& context)
{
    if (const GLenum pending = takeGlError(context.gl); pending != GL_NO_ERROR)
        context.report(NACRE_WARNING, "the host had a pending GL error " + std::to_string(pending) + "; it was cleared");
}

bool allocated(const Gl& gl)
{
    const bool complete = gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    return takeGlError(gl) == GL_NO_ERROR && complete;
}

void runPass(const NacreAssetImpl& asset, GLuint framebuffer, int rows)
{
    const Gl& gl = asset.context->gl;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    const float box[4] = {0, 0, float(asset.width), float(rows)};
    setViewport(gl, box);
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
}

Failure fitLongRow(NacreAssetImpl& asset, const char* channel, size_t splats, int64_t texelsPerSplat)
{
    constexpr int kSmallestShift = 8; // drivers round smaller layers up
    const Gl& gl = asset.context->gl;
    const int largestShift = std::bit_width(unsigned(gl.maxTextureSize)) - 1;
    const int64_t texels = int64_t(splats) * texelsPerSplat;
    const auto layersAt = [&](int shift) { return (texels >> 2 * shift) + 1; };
    int& shift = asset.rowShift;
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

void uploadVisibility(NacreAssetImpl& asset, GLuint& texture, const Channel& visibility)
{
    const TexelFormat<uint8_t> bytes{GL_R8, GL_RED, GL_UNSIGNED_BYTE, 1};
    uploadLongRow(asset, texture, bytes, visibility.bytes.size(), [&](size_t t, uint8_t* out) { *out = visibility.bytes[t]; });
}

} // namespace nacre
