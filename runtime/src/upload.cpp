// Puts a decoded asset on the GPU: geometry as float, the rest as its model wants it.
#include "textures.h"
#include "appearance/visibility_map.h"

#include "gl_state.h"

#include <algorithm>

namespace nacre {

/// Chooses the narrowest grid that keeps every slot texture within the limits under all lights, or the widest, under fewer lights.
static Failure chooseLayout(NacreAssetImpl& asset)
{
    const Gl& gl = asset.context->gl;
    const int64_t maxSize = gl.maxTextureSize, count = asset.count, fixedSlots = asset.model->mostSlots();
    const int64_t allSlots = std::max<int64_t>(fixedSlots, NACRE_MAX_LIGHTS / kLightsPerSlot);
    int64_t width = 64;
    const auto rows = [&] { return (count + width - 1) / width; };
    while (rows() * allSlots > maxSize && 2 * width <= maxSize) width *= 2;
    if (rows() * fixedSlots > maxSize)
        return {NACRE_ERROR_UNSUPPORTED, "the asset has " + std::to_string(count) + " splats, this GPU's textures (GL_MAX_TEXTURE_SIZE " +
                                             std::to_string(maxSize) + ") hold at most " + std::to_string(maxSize / fixedSlots * width)};
    asset.width = int(width);
    asset.rows = int(rows());
    asset.mostLights = int(std::min<int64_t>(NACRE_MAX_LIGHTS, maxSize / rows() * kLightsPerSlot));
    return {};
}

static void uploadGeometry(NacreAssetImpl& asset, const SplatCloud& cloud)
{
    std::vector<float> staging;
    asset.geometry = createSlotTexture(asset, GL_RGBA32F, kCommonSlots + asset.model->geometrySlots());
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
}

static void createCommonTextures(NacreAssetImpl& asset)
{
    const Gl& gl = asset.context->gl;
    asset.order = createSlotTexture(asset, GL_R32UI, 1);
    gl.GenTextures(1, &asset.lights);
    bindTexture(gl, 0, GL_TEXTURE_2D, asset.lights);
    setNearest(gl, GL_TEXTURE_2D);
    gl.TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, NACRE_MAX_LIGHTS, 2, 0, GL_RGBA, GL_FLOAT, nullptr);
    asset.gpuBytes += uint64_t(NACRE_MAX_LIGHTS) * 2 * 16;
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
    asset.model = makeGpuModel(source.model, asset);
    asset.modelName = source.model;
    if (!asset.model) return {NACRE_ERROR_UNSUPPORTED, "this version does not draw the model '" + source.model + "'"};
    if (source.cloud.count > (size_t(1) << 28))
        return {NACRE_ERROR_UNSUPPORTED, "the asset has " + std::to_string(source.cloud.count) + " splats, the most is 2^28"};

    asset.count = uint32_t(source.cloud.count);
    asset.lowPassVariance = source.lowPassVariance;
    const Channel* maps = source.find("visibility");
    asset.visibilitySize = maps ? visibilitySize(maps->components) : 0;
    asset.yUpFromAsset = source.yUpFromAsset;
    asset.frame = source.frame;
    asset.positions = source.cloud.positions;
    asset.boundsMin = asset.boundsMax = asset.positions.at(0);
    for (const glm::vec3& p : asset.positions) {
        asset.boundsMin = glm::min(asset.boundsMin, p);
        asset.boundsMax = glm::max(asset.boundsMax, p);
    }
    for (const glm::vec3& v : source.cloud.scales) asset.maxScales.push_back(std::max({v.x, v.y, v.z}));
    if (Failure f = chooseLayout(asset)) return f;
    if (Failure f = asset.model->checkLayout(source)) return f;

    clearHostErrors(context);
    GlStateGuard guard(gl);
    createCommonTextures(asset);
    uploadGeometry(asset, source.cloud);
    Failure incomplete = asset.model->upload(source);
    if (Failure f = uploadFailure(takeGlError(gl), asset)) return f; // first: a target without storage is incomplete as well
    if (incomplete) return incomplete;
    if (Failure f = growIndexBuffer(context, asset)) return f;
    if (Failure f = asset.model->compilePrograms()) return f;
    return uploadFailure(takeGlError(gl), asset);
}

void destroyAsset(NacreAssetImpl& asset)
{
    if (!asset.context) return; // upload did not start
    asset.model.reset();
    const GLuint textures[] = {asset.geometry, asset.lights, asset.order}; // GL ignores 0
    asset.context->gl.DeleteTextures(GLsizei(std::size(textures)), textures);
}

} // namespace nacre
