// Puts a decoded asset on the GPU: geometry as float, the rest as its model wants it.
#include "asset.h"

#include "appearance/coded_channels.h"
#include "appearance/detail.h"
#include "appearance/splat_visibility.h"
#include "appearance/visibility_map.h"
#include "asset/asset_decode.h"
#include "base/text.h"
#include "gl_state.h"

#include <algorithm>

namespace nacre {

std::unique_ptr<AssetModel> makeAssetModel(const std::string& model, Asset& asset)
{
#define NACRE_MODEL(name) \
    if (model == #name) return name::makeAssetModel(asset);
    NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL
    return nullptr;
}

static NacreResult decodeResult(ErrorCode code)
{
    switch (code) {
    case ErrorCode::kUnsupported: return NACRE_ERROR_UNSUPPORTED;
    case ErrorCode::kIo: return NACRE_ERROR_OUT_OF_MEMORY; // decoding reads no files: memory is all of the world it needs
    default: return NACRE_ERROR_BAD_ASSET;
    }
}

/// Chooses the narrowest grid that keeps every slot texture within the limits.
static Failure chooseLayout(Asset& asset)
{
    const int64_t maxSize = asset.context.gl.maxTextureSize, count = asset.grid.count;
    const int64_t slots = std::max<int64_t>(asset.model->mostSlots(), kBatchLights / kLightsPerGroup);
    int64_t width = 64;
    const auto rows = [&] { return (count + width - 1) / width; };
    while (rows() * slots > maxSize && 2 * width <= maxSize) width *= 2;
    if (rows() * slots > maxSize)
        return {NACRE_ERROR_UNSUPPORTED, "the asset has " + std::to_string(count) + " splats, this GPU's textures (GL_MAX_TEXTURE_SIZE " +
                                             std::to_string(maxSize) + ") hold at most " + std::to_string(maxSize / slots * width)};
    asset.grid.width = int(width);
    asset.grid.rows = int(rows());
    return {};
}

/// Those of the file by name; else none, with the detail that was asked for.
static Failure choosePreset(const SplatAsset& source, const DetailChoice& choice, Preset* preset)
{
    *preset = {};
    preset->detail = choice.detail;
    if (choice.preset.empty()) return {};
    std::string names;
    for (const Preset& p : source.presets) {
        if (p.name == choice.preset) return *preset = p, Failure{};
        names += names.empty() ? "; there are: " : ", ";
        names += p.name;
    }
    return invalid("the asset has no preset " + inQuotes(choice.preset) + (names.empty() ? std::string(", nor any other") : names));
}

Failure decode(Context& context, std::span<const std::byte> bytes, const DetailChoice& choice, std::shared_ptr<Asset>* out)
{
    Result<SplatAsset> decoded = decodeAsset(bytes);
    if (!decoded) return {decodeResult(decoded.error().code), decoded.error().message};
    auto asset = std::make_shared<Asset>(context);
    for (const CodedChannels& c : decoded->coded) asset->coded |= c.channels == std::vector<std::string>{"tDir", "tInd"};
    asset->bakedSplats = uint32_t(std::min<size_t>(decoded->cloud.count, ~0u));
    if (Failure f = choosePreset(*decoded, choice, &asset->preset)) return f;
    expandChannels(*decoded);
    if (asset->preset.detail.leaveOut & kPartVisibility) decoded->drawnVisibility = 0; // not drawn in vain
    drawVisibility(*decoded); // here, since decoding may run on any thread: no upload and no frame waits for it
    if (const Status s = reduceDetail(*decoded, asset->preset.detail); !s) return invalid(s.error().message); // the maps of all, which the rest keeps
    asset->source = std::make_unique<SplatAsset>(std::move(*decoded));
    const SplatAsset& source = *asset->source;
    asset->model = makeAssetModel(source.model, *asset);
    asset->modelName = source.model;
    if (!asset->model) return {NACRE_ERROR_UNSUPPORTED, "this version does not draw the model '" + source.model + "'"};
    if (source.cloud.count > (size_t(1) << 28))
        return {NACRE_ERROR_UNSUPPORTED, "the asset has " + std::to_string(source.cloud.count) + " splats, the most is 2^28"};

    asset->grid.count = uint32_t(source.cloud.count);
    asset->lowPassVariance = source.lowPassVariance;
    const Channel* maps = source.find("visibility");
    asset->visibilitySize = maps ? visibilitySize(maps->components) : 0;
    asset->yUpFromAsset = source.yUpFromAsset;
    asset->frame = source.frame;
    asset->positions = source.cloud.positions;
    asset->boundsMin = asset->boundsMax = asset->positions.at(0);
    for (const glm::vec3& p : asset->positions) {
        asset->boundsMin = glm::min(asset->boundsMin, p);
        asset->boundsMax = glm::max(asset->boundsMax, p);
    }
    for (const glm::vec3& v : source.cloud.scales) asset->maxScales.push_back(std::max({v.x, v.y, v.z}));
    asset->largestScale = *std::max_element(asset->maxScales.begin(), asset->maxScales.end());
    if (Failure f = chooseLayout(*asset)) return f;
    if (Failure f = asset->model->checkLayout(source)) return f;
    *out = std::move(asset);
    return {};
}

static void queueGeometry(Asset& asset)
{
    const Gl& gl = asset.context.gl;
    const SplatCloud& cloud = asset.source->cloud;
    asset.geometry = slotTexture(asset.context, asset.grid, GL_RGBA32F, kCommonSlots + asset.model->geometrySlots());
    queueSlot<float>(asset.queue, gl, asset.grid, asset.geometry, kMeanOpacity, [&cloud](size_t g, float* t) {
        const glm::vec3& p = cloud.positions[g];
        t[0] = p.x, t[1] = p.y, t[2] = p.z, t[3] = cloud.opacities[g];
    });
    queueSlot<float>(asset.queue, gl, asset.grid, asset.geometry, kRotation, [&cloud](size_t g, float* t) {
        const glm::quat q = glm::normalize(cloud.rotations[g]);
        t[0] = q.x, t[1] = q.y, t[2] = q.z, t[3] = q.w;
    });
    queueSlot<float>(asset.queue, gl, asset.grid, asset.geometry, kScale, [&cloud](size_t g, float* t) {
        for (int c = 0; c < 3; ++c) t[c] = cloud.scales[g][c];
    });
}

static Failure uploadFailure(GLenum error, const Asset& asset)
{
    if (error == GL_NO_ERROR) return {};
    if (error == GL_OUT_OF_MEMORY)
        return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory: the asset needs " + std::to_string(asset.gpuBytes >> 20) + " MiB"};
    return {NACRE_ERROR_GL, "uploading the asset raised GL error " + std::to_string(error)};
}

Failure uploadStep(Asset& asset, uint64_t budget)
{
    if (asset.complete()) return {};
    Context& context = asset.context;
    clearHostErrors(context);
    GlStateGuard guard(context.gl);
    const uint64_t before = context.gpuBytes;
    Failure failure;
    if (!asset.started) {
        asset.started = true;
        queueGeometry(asset);
        failure = asset.model->upload(*asset.source, asset.queue);
        asset.gpuBytes = context.gpuBytes - before;
    }
    if (Failure f = uploadFailure(takeGlError(context.gl), asset)) return f; // first: a target without storage is incomplete as well
    if (failure) return failure;
    asset.queue.step(budget);
    if (Failure f = uploadFailure(takeGlError(context.gl), asset)) return f;
    if (!asset.queue.empty()) return {};
    if (Failure f = growIndexBuffer(context, asset.grid.count)) return f; // a view of one instance needs no more
    asset.source.reset(), asset.queue = {};
    return {};
}

} // namespace nacre
