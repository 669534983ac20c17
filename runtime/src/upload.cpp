// Puts a decoded asset into textures. Coefficients of SH are stored as half floats (relative error at most 2^-11), geometry and lobe
// as float (half a normal would shift a sharp highlight by a percent of its width), visibility as the bytes of the file.
#include "asset.h"

#include "appearance/bigs/bigs.h"
#include "base/half.h"
#include "gl_state.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace nacre {

void bindTexture(const Gl& gl, int unit, GLenum target, GLuint texture)
{
    gl.ActiveTexture(GL_TEXTURE0 + GLenum(unit));
    gl.BindTexture(target, texture);
}

static void setNearest(const Gl& gl, GLenum target)
{
    gl.TexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_NEAREST); // no mip levels: the default filter would make it incomplete
    gl.TexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.TexParameteri(target, GL_TEXTURE_MAX_LEVEL, 0);
}

GLuint createSlotTexture(NacreAssetImpl& asset, GLenum format, int slots)
{
    const Gl& gl = asset.context->gl;
    const bool index = format == GL_R32UI;
    const int height = asset.rows * slots;
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

/// A channel of one long row, `texelsPerSplat` per splat: its indices must fit an int, its layers the GPU.
static Failure checkLongRow(const NacreAssetImpl& asset, const char* channel, int64_t texelsPerSplat)
{
    const Gl& gl = asset.context->gl;
    const int64_t texels = asset.count * texelsPerSplat, layers = (texels >> 2 * asset.rowShift) + 1;
    if (layers <= gl.maxArrayLayers && texels <= std::numeric_limits<int32_t>::max()) return {};
    return {NACRE_ERROR_UNSUPPORTED, std::string("the ") + channel + " of " + std::to_string(asset.count) + " splats needs " +
                                         std::to_string(texels) + " texels in " + std::to_string(layers) +
                                         " layers, drawn are at most 2^31 - 1 and, by this GPU, " + std::to_string(gl.maxArrayLayers) +
                                         " layers; bake with fewer splats or a smaller s"};
}

/// Chooses the narrowest grid that keeps every slot texture within the limits, and how many texels of a long row a layer holds.
static Failure chooseLayout(NacreAssetImpl& asset)
{
    constexpr int kMostSlots = NACRE_MAX_LIGHTS / 4; // of the textures the light pass writes
    const Gl& gl = asset.context->gl;
    const int64_t maxSize = gl.maxTextureSize, count = asset.count;
    int64_t width = 64;
    const auto rows = [&] { return (count + width - 1) / width; };
    while (rows() * kMostSlots > maxSize && 2 * width <= maxSize) width *= 2;
    if (rows() * kMostSlots > maxSize)
        return {NACRE_ERROR_UNSUPPORTED, "the asset has " + std::to_string(count) + " splats, this GPU's textures (GL_MAX_TEXTURE_SIZE " +
                                             std::to_string(maxSize) + ") hold at most " + std::to_string(maxSize / kMostSlots * width)};
    asset.width = int(width);
    asset.rows = int(rows());

    asset.rowShift = std::bit_width(unsigned(maxSize)) - 1;
    if (Failure f = checkLongRow(asset, "s", bigsPairCount(asset.sFunctions))) return f;
    return checkLongRow(asset, "visibility", asset.visibilitySize * asset.visibilitySize);
}

static Failure checkHalfRange(const Channel& channel)
{
    for (size_t i = 0; i < channel.values.size(); ++i)
        if (!(std::abs(channel.values[i]) <= kMaxHalf))
            return {NACRE_ERROR_BAD_ASSET, "channel '" + channel.name + "' has a value of " + std::to_string(channel.values[i]) +
                                               " at splat " + std::to_string(i / channel.components) +
                                               ", the largest that can be drawn is 65504"};
    return {};
}

/// texel(g) for every splat of one slot, then one upload. T is float or uint16_t (half).
template <class T, class Texel>
static void uploadSlot(const NacreAssetImpl& asset, std::vector<T>& staging, int slot, Texel texel)
{
    const Gl& gl = asset.context->gl;
    staging.assign(size_t(4) * size_t(asset.width) * size_t(asset.rows), T(0));
    for (size_t g = 0; g < asset.count; ++g) texel(g, &staging[4 * g]);
    const GLenum type = sizeof(T) == 2 ? GL_HALF_FLOAT : GL_FLOAT;
    gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, slot * asset.rows, asset.width, asset.rows, GL_RGBA, type, staging.data());
}

static void uploadGeometry(NacreAssetImpl& asset, const SplatCloud& cloud, const Channel& rho, const Channel* shadow, const Channel* lobe)
{
    std::vector<float> staging;
    asset.geometry = createSlotTexture(asset, GL_RGBA32F, lobe ? kGeometrySlots : kNormalSharpness);
    uploadSlot(asset, staging, kMeanOpacity, [&](size_t g, float* t) {
        const glm::vec3& p = cloud.positions[g];
        t[0] = p.x, t[1] = p.y, t[2] = p.z, t[3] = cloud.opacities[g];
    });
    uploadSlot(asset, staging, kRotation, [&](size_t g, float* t) {
        const glm::quat q = glm::normalize(cloud.rotations[g]);
        t[0] = q.x, t[1] = q.y, t[2] = q.z, t[3] = q.w;
    });
    uploadSlot(asset, staging, kScale, [&](size_t g, float* t) {
        for (int c = 0; c < 3; ++c) t[c] = cloud.scales[g][c];
    });
    uploadSlot(asset, staging, kRhoShadow, [&](size_t g, float* t) {
        for (int c = 0; c < 3; ++c) t[c] = rho.values[3 * g + size_t(c)];
        t[3] = shadow ? shadow->values[g] : 1.0f;
    });
    if (!lobe) return;
    uploadSlot(asset, staging, kNormalSharpness, [&](size_t g, float* t) { std::copy_n(&lobe->values[kBigsLobeFloats * g], 4, t); });
    uploadSlot(asset, staging, kLobeColor, [&](size_t g, float* t) { std::copy_n(&lobe->values[kBigsLobeFloats * g + 4], 3, t); });
}

static void uploadTransport(NacreAssetImpl& asset, const Channel& tDir, const Channel& tInd)
{
    std::vector<uint16_t> staging;
    asset.transport = createSlotTexture(asset, GL_RGBA16F, kBigsTransportFunctions);
    for (int i = 0; i < kBigsTransportFunctions; ++i)
        uploadSlot(asset, staging, i, [&](size_t g, uint16_t* t) {
            const size_t k = g * kBigsTransportFunctions + size_t(i);
            for (size_t c = 0; c < 3; ++c) t[c] = halfFromFloat(tInd.values[3 * k + c]);
            t[3] = halfFromFloat(tDir.values[k]);
        });
}

/// How texels of one long row lie in memory: `components` of type T each.
template <class T>
struct TexelFormat {
    GLenum internal, layout, type;
    size_t components;
};

/// Makes the array texture that holds one long row of `texels`, wrapped at its width and then at its height; fill(t, out) writes texel t.
template <class T, class Fill>
static void uploadLongRow(NacreAssetImpl& asset, GLuint& texture, const TexelFormat<T>& format, size_t texels, Fill fill)
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

static void uploadScatter(NacreAssetImpl& asset, const Channel& s)
{
    const TexelFormat<uint16_t> halves{GL_RGBA16F, GL_RGBA, GL_HALF_FLOAT, 4};
    uploadLongRow(asset, asset.scatter, halves, s.values.size() / 3, [&](size_t t, uint16_t* out) {
        for (size_t c = 0; c < 3; ++c) out[c] = halfFromFloat(s.values[3 * t + c]);
    });
}

static void uploadVisibility(NacreAssetImpl& asset, const Channel& visibility)
{
    const TexelFormat<uint8_t> bytes{GL_R8, GL_RED, GL_UNSIGNED_BYTE, 1};
    uploadLongRow(asset, asset.visibility, bytes, visibility.bytes.size(), [&](size_t t, uint8_t* out) { *out = visibility.bytes[t]; });
}

static GLuint createTarget(NacreAssetImpl& asset, GLuint texture)
{
    const Gl& gl = asset.context->gl;
    GLuint framebuffer = 0;
    gl.GenFramebuffers(1, &framebuffer);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture, 0);
    return framebuffer;
}

static Failure createTargets(NacreAssetImpl& asset)
{
    const Gl& gl = asset.context->gl;
    asset.color = createSlotTexture(asset, GL_RGBA32F, 1);
    asset.combineFramebuffer = createTarget(asset, asset.color);
    bool complete = gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    if (asset.sFunctions > 0) {
        asset.contracted = createSlotTexture(asset, GL_RGBA32F, asset.sFunctions);
        asset.viewFramebuffer = createTarget(asset, asset.contracted);
        complete = complete && gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    }
    if (!complete) return {NACRE_ERROR_GL, "this GPU cannot render into RGBA32F textures, which relighting needs"};
    gl.GenFramebuffers(1, &asset.lightFramebuffer); // its textures are made when the number of lights is known

    asset.order = createSlotTexture(asset, GL_R32UI, 1);
    gl.GenTextures(1, &asset.lights);
    bindTexture(gl, 0, GL_TEXTURE_2D, asset.lights);
    setNearest(gl, GL_TEXTURE_2D);
    gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, NACRE_MAX_LIGHTS, 2, 0, GL_RGBA, GL_FLOAT, nullptr);
    asset.gpuBytes += uint64_t(NACRE_MAX_LIGHTS) * 2 * 16;
    return {};
}

static Failure uploadFailure(GLenum error, const NacreAssetImpl& asset)
{
    if (error == GL_NO_ERROR) return {};
    if (error == GL_OUT_OF_MEMORY)
        return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory: the asset needs " + std::to_string(asset.gpuBytes >> 20) + " MiB"};
    return {NACRE_ERROR_GL, "uploading the asset raised GL error " + std::to_string(error)};
}

/// The quads of all splats as triangles, shared by the assets of a context: these keep the old buffer if there is no room for a larger.
static Failure growIndexBuffer(NacreContextImpl& context, const NacreAssetImpl& asset)
{
    const Gl& gl = context.gl;
    const size_t splats = asset.count;
    if (splats <= context.indexedSplats) return {};
    std::vector<uint32_t> indices(6 * splats);
    for (size_t n = 0; n < splats; ++n)
        for (size_t k = 0; k < 6; ++k) indices[6 * n + k] = uint32_t(4 * n + (k < 3 ? k : k == 3 ? 2 : k == 4 ? 1 : 3));
    if (!context.vertexArray) gl.GenVertexArrays(1, &context.vertexArray);
    gl.BindVertexArray(context.vertexArray);
    GLuint larger = 0;
    gl.GenBuffers(1, &larger);
    gl.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, larger);
    gl.BufferData(GL_ELEMENT_ARRAY_BUFFER, GLsizeiptr(indices.size() * sizeof(uint32_t)), indices.data(), GL_STATIC_DRAW);
    const Failure failure = uploadFailure(takeGlError(gl), asset);
    if (failure) {
        gl.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, context.indexBuffer);
    } else {
        std::swap(larger, context.indexBuffer);
        context.indexedSplats = splats;
    }
    gl.DeleteBuffers(1, &larger);
    return failure;
}

Failure uploadAsset(NacreContextImpl& context, const SplatAsset& source, NacreAssetImpl& asset)
{
    const Gl& gl = context.gl;
    asset.context = &context;
    const Channel *tDir = source.find("tDir"), *tInd = source.find("tInd"), *rho = source.find("rho"), *s = source.find("s");
    const Channel *lobe = source.find("lobe"), *visibility = source.find("visibility"), *shadow = source.find("shadow");
    if (source.model != "bigs" || !tDir || !tInd || !rho)
        return {NACRE_ERROR_UNSUPPORTED, "this version draws the model 'bigs', the asset's is '" + source.model + "'"};
    if (source.cloud.count > (size_t(1) << 28))
        return {NACRE_ERROR_UNSUPPORTED, "the asset has " + std::to_string(source.cloud.count) + " splats, the most is 2^28"};
    for (const Channel& channel : source.channels)
        if (Failure f = checkHalfRange(channel)) return f;

    asset.count = uint32_t(source.cloud.count);
    asset.sFunctions = s ? bigsScatterFunctions(s->components) : 0;
    asset.hasLobe = lobe != nullptr;
    asset.visibilitySize = visibility ? bigsVisibilitySize(visibility->components) : 0;
    asset.lowPassVariance = source.lowPassVariance;
    asset.yUpFromAsset = source.yUpFromAsset;
    asset.positions = source.cloud.positions;
    asset.boundsMin = asset.boundsMax = asset.positions.at(0);
    for (const glm::vec3& p : asset.positions) {
        asset.boundsMin = glm::min(asset.boundsMin, p);
        asset.boundsMax = glm::max(asset.boundsMax, p);
    }
    for (const glm::vec3& v : source.cloud.scales) asset.maxScales.push_back(std::max({v.x, v.y, v.z}));
    if (Failure f = chooseLayout(asset)) return f;

    if (const GLenum pending = takeGlError(gl); pending != GL_NO_ERROR)
        context.report(NACRE_WARNING, "the host had a pending GL error " + std::to_string(pending) + "; it was cleared");
    GlStateGuard guard(gl);
    uploadGeometry(asset, source.cloud, *rho, shadow, lobe);
    uploadTransport(asset, *tDir, *tInd);
    if (s) uploadScatter(asset, *s);
    if (visibility) uploadVisibility(asset, *visibility);
    Failure incomplete = createTargets(asset);
    if (Failure f = uploadFailure(takeGlError(gl), asset)) return f; // first: a target without storage is incomplete as well
    if (incomplete) return incomplete;
    if (Failure f = growIndexBuffer(context, asset)) return f;
    if (Failure f = compilePrograms(asset)) return f;
    return uploadFailure(takeGlError(gl), asset);
}

void destroyAsset(NacreAssetImpl& asset)
{
    if (!asset.context) return; // upload did not start
    const Gl& gl = asset.context->gl; // names of zero are ignored by GL
    const GLuint textures[] = {asset.geometry, asset.transport, asset.scatter, asset.visibility, asset.contracted, asset.direct,
                               asset.indirect, asset.visible,   asset.color,   asset.lights,     asset.order};
    const GLuint framebuffers[] = {asset.lightFramebuffer, asset.viewFramebuffer, asset.combineFramebuffer};
    gl.DeleteFramebuffers(GLsizei(std::size(framebuffers)), framebuffers);
    gl.DeleteTextures(GLsizei(std::size(textures)), textures);
    for (const Program* p : {&asset.lightPass, &asset.viewPass, &asset.combinePass, &asset.splatProgram}) gl.DeleteProgram(p->name);
}

} // namespace nacre
