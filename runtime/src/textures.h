// Textures that hold numbers per splat: slots of a grid, and long rows (layout.glsl says where a splat sits in them).
#pragma once

#include "asset.h"

#include <algorithm>
#include <vector>

namespace nacre {

void bindTexture(const Gl& gl, int unit, GLenum target, GLuint texture);
/// Nearest texel, one level: the default filter would make a texture without mip levels incomplete.
void setNearest(const Gl& gl, GLenum target);

/// Allocates a texture of `slots` slots; adds to gpuBytes. R32UI has one number a texel, the other formats four.
GLuint createSlotTexture(NacreAssetImpl& asset, GLenum format, int slots);
/// The same with any number of rows.
GLuint createRowTexture(NacreAssetImpl& asset, GLenum format, int rows);

/// A framebuffer that draws into `texture`. Leaves it bound.
GLuint createTarget(const Gl& gl, GLuint texture);

/// Before memory is asked for: GL errors that the host had pending are cleared, with a warning, so that those after it are ours. Draws
/// that ask for none never wait for GL.
void clearHostErrors(const NacreContextImpl& context);
/// After it: what was bound can be drawn into and nothing has failed. GL may notice a lack of memory in either way.
bool allocated(const Gl& gl);

/// A draw over the first `rows` rows of a target.
void runPass(const NacreAssetImpl& asset, GLuint framebuffer, int rows);

/// A channel of one long row, `texelsPerSplat` for each of `splats`: its indices must fit an int, its layers the GPU. Makes the layers of
/// the asset as large as that takes and no larger: the last one is allocated whole.
Failure fitLongRow(NacreAssetImpl& asset, const char* channel, size_t splats, int64_t texelsPerSplat);
/// Every value must fit a half float: for channels that are stored as such.
Failure checkHalfRange(const Channel& channel);

/// texel(g, out) for every splat of one slot of the texture bound to unit 0, then one upload. T is float or uint16_t (half).
template <class T, class Texel>
void uploadSlot(const NacreAssetImpl& asset, std::vector<T>& staging, int slot, Texel texel)
{
    const Gl& gl = asset.context->gl;
    staging.assign(size_t(4) * size_t(asset.width) * size_t(asset.rows), T(0));
    for (size_t g = 0; g < asset.count; ++g) texel(g, &staging[4 * g]);
    const GLenum type = sizeof(T) == 2 ? GL_HALF_FLOAT : GL_FLOAT;
    gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, slot * asset.rows, asset.width, asset.rows, GL_RGBA, type, staging.data());
}

/// How texels of one long row lie in memory: `components` of type T each.
template <class T>
struct TexelFormat {
    GLenum internal, layout, type;
    size_t components;
};

/// Makes the array texture that holds one long row of `texels`, wrapped at its width and then at its height; fill(t, out) writes texel t.
template <class T, class Fill>
void uploadLongRow(NacreAssetImpl& asset, GLuint& texture, const TexelFormat<T>& format, size_t texels, Fill fill)
{
    const Gl& gl = asset.context->gl;
    const size_t width = size_t(1) << asset.rowShift, rows = (texels + width - 1) / width;
    const size_t layerRows = std::min(rows, width), layers = (rows + layerRows - 1) / layerRows;
    gl.GenTextures(1, &texture);
    bindTexture(gl, 0, GL_TEXTURE_2D_ARRAY, texture);
    setNearest(gl, GL_TEXTURE_2D_ARRAY);
    gl.TexImage3D(GL_TEXTURE_2D_ARRAY, 0, GLint(format.internal), GLsizei(width), GLsizei(layerRows), GLsizei(layers), 0, format.layout,
                  format.type, nullptr);
    asset.gpuBytes += sizeof(T) * format.components * uint64_t(width * layerRows * layers);

    std::vector<T> staging;
    constexpr size_t kChunkRows = 16;
    for (size_t row = 0, n = 0; row < rows; row += n) {
        n = std::min({kChunkRows, rows - row, layerRows - row % layerRows});
        staging.assign(format.components * width * n, T(0));
        const size_t first = row * width, last = std::min(first + n * width, texels);
        for (size_t t = first; t < last; ++t) fill(t, &staging[format.components * (t - first)]);
        gl.TexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, GLint(row % layerRows), GLint(row / layerRows), GLsizei(width), GLsizei(n), 1,
                         format.layout, format.type, staging.data());
    }
}

/// The maps of appearance/visibility_map.h, as visibilityTexels reads them.
void uploadVisibility(NacreAssetImpl& asset, GLuint& texture, const Channel& visibility);

} // namespace nacre
