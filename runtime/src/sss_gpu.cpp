// sss on the GPU (sss.h and sss_network.h have the equations):
//   light     per splat and light: scattered light per unit of subsurfaceness, incident share. Network and visibility map. From GL 4.3
//             on in a compute shader, which has the weights in shared memory.
//   sum       per splat: scattered light of all lights
//   G-buffer  surface and incident shares of up to eleven lights, blended over the splats; 24 further lights per further pass
//   resolve   per pixel: GGX under every light, into the host's frame; of several passes into a sum, and that into the host's frame
// light and sum run only when lights, camera or edits have changed in any bit.
//
// Textures beyond those of every model:
//   geometry    slots: normal+roughness, base colour+metalness, subsurfaceness, subsurfaceness * residual tint
//   visibility  R8       array: octahedral maps, one long row
//   weights     RGBA32F  of the network, see packNetwork
//   first       RGBA16F  16 slots: first layer of the network without light and view
//   lit         RGBA32F  light pass: array, see litTexel
//   scattered   RGBA32F  sum pass
//   layers, further      RGBA16F  arrays of the size of the viewport; RGBA32F where light is too bright for halves and the host's target not
//   summed      RGBA32F  of that size, with more than eleven lights
// first and weights exist only with a network.
#include "appearance/sss/sss.h"
#include "appearance/sss/sss_asset.h"
#include "appearance/sss/sss_edit.h"
#include "base/half.h"
#include "gl_state.h"
#include "host_depth.h"
#include "program.h"
#include "shader_sources.h"
#include "textures.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace nacre {

namespace {

enum SssPass { kLightPass, kSumPass };
enum SssSlot { kNormalRoughness = kCommonSlots, kBaseMetalness, kSubsurfaceSlot, kScatterTint, kSssSlots };
constexpr int kMostLayers = 8;                       // of a pass: what GL 3.3 guarantees
constexpr int kSurfaceLayers = 5;                    // the fifth has room for two lights
constexpr int kFirstLights = 2 + 3 * (kMostLayers - kSurfaceLayers), kFurtherLights = 3 * kMostLayers;
constexpr int kWeightsWidth = 1024;

// The light pass takes lights in groups, so that each weight is fetched once for all lights of a group: as few groups as kMostLanes allow,
// and all of one size, as small as so many groups can be.
constexpr int kMostLanes = kLightsPerSlot;
constexpr int kWorkgroup = 64;                       // splats of the compute shader
int groupsOf(int lights) { return std::max(1, (lights + kMostLanes - 1) / kMostLanes); }
int lanesOf(int lights) { return std::max(1, (lights + groupsOf(lights) - 1) / groupsOf(lights)); }

int layersFor(int lights) { return kSurfaceLayers + (std::max(lights - 2, 0) + 2) / 3; }
int furtherLayersFor(int lights) { return (lights + 2) / 3; }

// Where the layers of the network lie in the weight texture (sss_network.glsl).
constexpr int kAtLight = 0;
constexpr int kAtSecond = kAtLight + kSssHidden1 / 4 * kSssLightInputs;
constexpr int kAtThird = kAtSecond + kSssHidden2 / 4 * (1 + kSssHidden1);
constexpr int kAtShare = kAtThird + kSssHidden3 / 4 * (1 + kSssHidden2);
constexpr int kAtOut = kAtShare + kSssHiddenShare / 4 * (1 + kSssHidden3);
constexpr int kWeightTexels = kAtOut + 1 + kSssHidden3 + kSssHiddenShare;
static_assert(16 * kWeightTexels <= 32768); // the shared memory that GL 4.3 guarantees

// Four outputs to a texel: biases of a layer, then for every four outputs what they take from each input.
std::vector<float> packNetwork(const float* w)
{
    std::vector<float> texels(size_t(4) * kWeightsWidth * ((kWeightTexels + kWeightsWidth - 1) / kWeightsWidth));
    const auto layer = [&](int at, const float* matrix, const float* bias, int inputs, int outputs) {
        if (bias) std::copy_n(bias, outputs, &texels[size_t(4 * at)]), at += outputs / 4;
        for (int j = 0; j < outputs; ++j)
            for (int i = 0; i < inputs; ++i) texels[size_t(4 * (at + inputs * (j / 4) + i) + j % 4)] = matrix[j * inputs + i];
    };
    layer(kAtLight, w + kSssFirstLight, nullptr, kSssLightInputs, kSssHidden1); // the bias is in `first`
    layer(kAtSecond, w + kSssSecond, w + kSssSecondBias, kSssHidden1, kSssHidden2);
    layer(kAtThird, w + kSssThird, w + kSssThirdBias, kSssHidden2, kSssHidden3);
    layer(kAtShare, w + kSssShare, w + kSssShareBias, kSssHidden3, kSssHiddenShare);
    float* out = &texels[size_t(4) * kAtOut];
    for (int c = 0; c < 3; ++c) {
        out[c] = w[kSssResidualBias + c];
        for (int i = 0; i < kSssHidden3; ++i) out[4 * (1 + i) + c] = w[kSssResidual + c * kSssHidden3 + i];
    }
    out[3] = w[kSssShareOutBias];
    for (int i = 0; i < kSssHiddenShare; ++i) out[4 * (1 + kSssHidden3 + i) + 3] = w[kSssShareOut + i];
    return texels;
}

/// Viewport-sized layers that splats are blended into.
struct LayerTarget {
    GLuint texture = 0, framebuffer = 0;
    GLenum format = GL_RGBA16F;
    int width = 0, height = 0, layers = 0;

    uint64_t bytes() const { return (format == GL_RGBA32F ? 16 : 8) * uint64_t(width) * uint64_t(height) * uint64_t(layers); }
};

class GpuSss final : public GpuModel {
public:
    using GpuModel::GpuModel;
    ~GpuSss() override;
    Failure checkLayout(const SplatAsset& source) override;
    int mostSlots() const override { return kSssHidden1 / 4; }
    int geometrySlots() const override { return int(kSssSlots) - int(kCommonSlots); }
    Failure upload(const SplatAsset& source) override;
    Failure compilePrograms() override;
    Failure compileAhead(int mostLights) override;
    Failure setEdits(std::span<const SplatEdit> edits) override;
    Failure relight(const DrawFrame& frame, bool lightsChanged) override;
    Failure raster(const DrawFrame& frame, bool depthTest, GlStateGuard& state) override;

private:
    /// Splats into layers, layers into the host's frame. Compiled when a draw first needs so many layers.
    struct RasterPrograms {
        Program splat, resolve;
    };

    const Gl& gl() const { return asset_.context->gl; }
    bool computes() const { return hasNetwork_ && gl().hasCompute(); } // without network there is nothing to share
    void uploadMaterials();
    void uploadNetwork(const SssChannels& channels);
    void freeLit();
    Failure growLit(int lights);
    void dispatchLights(int lights) const;
    void drawLights(int lights) const;
    void runLightPass(const Program& program, const glm::vec3& camera) const;
    void runSumPass() const;
    Failure lightProgram(int lanes, const Program** program);
    Failure composeProgram();
    Failure rasterPrograms(bool further, int layers, RasterPrograms** programs);
    Failure growLayers(LayerTarget& target, GLenum format, int width, int height, int layers);
    bool tooBrightForHalves() const;
    void freeLayers(LayerTarget& target);
    void clearLayers(const LayerTarget& target, int layers) const;
    Failure drawLayers(LayerTarget& target, const Program& program, const DrawFrame& frame, int layers, int firstLight, bool depthTest, GlStateGuard& state);
    void resolve(const Program& program, const DrawFrame& frame, int firstLight, const float viewport[4], float maxColor) const;
    void compose(float maxColor) const;

    std::vector<SssMaterial> baked_;   // as in the file
    std::vector<SplatEdit> edits_;
    float inverseSize_ = 0;
    bool hasVisibility_ = false, hasNetwork_ = false, hasShare_ = false, edited_ = false, seen_ = false;
    GLuint visibility_ = 0, weights_ = 0, first_ = 0, lit_ = 0, scattered_ = 0;
    GLuint litFramebuffer_ = 0, sumFramebuffer_ = 0;
    LayerTarget layers_, further_, summed_;
    Program lightPass_[kMostLanes + 1], sumPass_, compose_; // by lanes, compiled when first needed, as is compose
    RasterPrograms programs_[2][kMostLayers + 1]{};
    glm::vec3 seenFrom_{0};
    int litGroups_ = 0;                // room in lit
    float depthOrigin_ = 0, depthUnit_ = 1; // of the last G-buffer pass
    float mostScatter_ = 0;            // largest factor of scattered light among the materials
};

GpuSss::~GpuSss()
{
    freeLayers(layers_), freeLayers(further_), freeLayers(summed_);
    const GLuint textures[] = {visibility_, weights_, first_, lit_, scattered_}, framebuffers[] = {litFramebuffer_, sumFramebuffer_}; // GL ignores 0
    gl().DeleteFramebuffers(GLsizei(std::size(framebuffers)), framebuffers);
    gl().DeleteTextures(GLsizei(std::size(textures)), textures);
    for (const Program& p : lightPass_) gl().DeleteProgram(p.name);
    gl().DeleteProgram(sumPass_.name), gl().DeleteProgram(compose_.name);
    for (const auto& kind : programs_)
        for (const RasterPrograms& p : kind) gl().DeleteProgram(p.splat.name), gl().DeleteProgram(p.resolve.name);
}

Failure GpuSss::checkLayout(const SplatAsset& source)
{
    hasVisibility_ = source.find("visibility") != nullptr;
    hasNetwork_ = source.find("network") != nullptr;
    hasShare_ = SssChannels(source).shares();
    return fitLongRow(asset_, "visibility", asset_.count, asset_.visibilitySize * asset_.visibilitySize);
}

void GpuSss::uploadMaterials()
{
    std::vector<SssMaterial> materials = baked_;
    mostScatter_ = 0;
    for (size_t g = 0; g < materials.size(); ++g) {
        SssMaterial& m = materials[g];
        applyEdits(edits_, asset_.positions[g], m);
        mostScatter_ = std::max(mostScatter_, m.subsurface * std::max({m.residual[0], m.residual[1], m.residual[2]}));
    }
    std::vector<float> staging;
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    uploadSlot(asset_, staging, kMeanOpacity, [&](size_t g, float* t) {
        const glm::vec3& p = asset_.positions[g];
        t[0] = p.x, t[1] = p.y, t[2] = p.z, t[3] = materials[g].opacity;
    });
    uploadSlot(asset_, staging, kNormalRoughness, [&](size_t g, float* t) { std::copy_n(materials[g].normal, 3, t), t[3] = materials[g].roughness; });
    uploadSlot(asset_, staging, kBaseMetalness, [&](size_t g, float* t) { std::copy_n(materials[g].base, 3, t), t[3] = materials[g].metalness; });
    uploadSlot(asset_, staging, kSubsurfaceSlot, [&](size_t g, float* t) { t[0] = materials[g].subsurface; });
    uploadSlot(asset_, staging, kScatterTint, [&](size_t g, float* t) {
        for (int c = 0; c < 3; ++c) t[c] = materials[g].subsurface * materials[g].residual[c];
    });
}

void GpuSss::uploadNetwork(const SssChannels& channels)
{
    const std::vector<float> packed = packNetwork(channels.network());
    const int height = int(packed.size()) / (4 * kWeightsWidth);
    gl().GenTextures(1, &weights_);
    bindTexture(gl(), 0, GL_TEXTURE_2D, weights_);
    setNearest(gl(), GL_TEXTURE_2D);
    gl().TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, kWeightsWidth, height, 0, GL_RGBA, GL_FLOAT, packed.data());
    asset_.gpuBytes += packed.size() * sizeof(float);
    inverseSize_ = channels.network()[kSssFrame + 3];

    std::vector<std::array<float, kSssHidden1>> values(asset_.count);
    for (size_t g = 0; g < asset_.count; ++g) channels.firstLayer(g, values[g].data());
    std::vector<uint16_t> staging;
    first_ = createSlotTexture(asset_, GL_RGBA16F, kSssHidden1 / 4);
    for (int j = 0; j < kSssHidden1 / 4; ++j)
        uploadSlot(asset_, staging, j, [&](size_t g, uint16_t* t) {
            for (int c = 0; c < 4; ++c) t[c] = halfFromFloat(std::clamp(values[g][size_t(4 * j + c)], -kMaxHalf, kMaxHalf));
        });
}

Failure GpuSss::upload(const SplatAsset& source)
{
    const SssChannels channels(source);
    for (size_t g = 0; g < asset_.count; ++g) baked_.push_back(channels.material(g));
    uploadMaterials();
    if (const Channel* visibility = source.find("visibility")) uploadVisibility(asset_, visibility_, *visibility);
    if (hasNetwork_) uploadNetwork(channels);
    scattered_ = createSlotTexture(asset_, GL_RGBA32F, 1);
    sumFramebuffer_ = createTarget(gl(), scattered_);
    if (gl().CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
        return {NACRE_ERROR_GL, "this GPU cannot render into RGBA32F textures, which relighting needs"};
    gl().GenFramebuffers(1, &litFramebuffer_); // its texture is made when the number of lights is known
    return {};
}

Failure GpuSss::compilePrograms()
{
    const std::string common = commonDefines(asset_);
    return compile(gl(), "sum", common + shaders::kFullscreenVertGlsl, common + shaders::kPassGlsl + shaders::kSssSumFragGlsl, {"uGeometry", "uLit"}, &sumPass_);
}

Failure GpuSss::lightProgram(int lanes, const Program** program)
{
    *program = &lightPass_[lanes];
    if ((*program)->name) return {};
    const std::string common = define("LANES", lanes) + define("COMPUTE", int(computes())) + define("GROUP", kWorkgroup) +
                               define("HAS_VISIBILITY", int(hasVisibility_)) +
                               define("HAS_NETWORK", int(hasNetwork_)) + define("HAS_SHARE", int(hasShare_)) + define("H1", kSssHidden1) +
                               define("H2", kSssHidden2) + define("H3", kSssHidden3) + define("HS", kSssHiddenShare) + define("AT_LIGHT", kAtLight) +
                               define("AT_SECOND", kAtSecond) + define("AT_THIRD", kAtThird) + define("AT_SHARE", kAtShare) + define("AT_OUT", kAtOut) +
                               define("AT_END", kWeightTexels) + define("LEAK", kSssLeak) + shaders::kLightGlsl + shaders::kVisibilityMapGlsl +
                               (hasNetwork_ ? shaders::kSssNetworkGlsl : "") + shaders::kSssLightGlsl;
    const auto samplers = {"uGeometry", "uLights", "uFirst", "uWeights", "uVisibility"};
    if (computes()) return compileCompute(gl(), "light", commonDefines(asset_, 430) + common + shaders::kSssLightCompGlsl, samplers, &lightPass_[lanes]);
    return compile(gl(), "light", commonDefines(asset_) + shaders::kFullscreenVertGlsl,
                   commonDefines(asset_) + shaders::kPassGlsl + common + shaders::kSssLightFragGlsl, samplers, &lightPass_[lanes]);
}

Failure GpuSss::rasterPrograms(bool further, int layers, RasterPrograms** programs)
{
    *programs = &programs_[further][layers];
    if ((*programs)->resolve.name) return {};
    const std::string common = commonDefines(asset_) + define("LAYERS", layers) + define("EXTRA", int(further)) +
                               define("LIGHTS", further ? 3 * layers : 2 + 3 * (layers - kSurfaceLayers)) + define("MIN_ROUGHNESS", kSssMinRoughness) +
                               define("DIELECTRIC_F0", kSssDielectricF0) + define("MIN_PIXEL_ALPHA", kSssMinAlpha) + define("MIN_NORMAL", kSssMinLength);
    if (Failure f = compile(gl(), "G-buffer", common + shaders::kProjectGlsl + shaders::kSssGbufferVertGlsl, common + shaders::kSssGbufferFragGlsl,
                            {"uGeometry", "uOrder", "uScattered", "uLit"}, &(*programs)->splat))
        return f;
    return compile(gl(), "resolve", common + shaders::kFullscreenVertGlsl, common + shaders::kLightGlsl + shaders::kSssGlsl + shaders::kSssResolveFragGlsl,
                   {"uLayers", "uFurther", "uLights"}, &(*programs)->resolve);
}

Failure GpuSss::composeProgram()
{
    if (compose_.name) return {};
    const std::string common = commonDefines(asset_);
    return compile(gl(), "compose", common + shaders::kFullscreenVertGlsl, common + shaders::kSssComposeFragGlsl, {"uSum"}, &compose_);
}

Failure GpuSss::compileAhead(int mostLights)
{
    const Program* light = nullptr;
    RasterPrograms* raster = nullptr;
    for (int lights = 0; lights <= mostLights; ++lights) {
        if (Failure f = lightProgram(lanesOf(lights), &light)) return f;
        if (Failure f = rasterPrograms(false, layersFor(std::min(lights, kFirstLights)), &raster)) return f;
        const int further = std::min(lights - kFirstLights, kFurtherLights);
        if (further <= 0) continue;
        if (Failure f = rasterPrograms(true, furtherLayersFor(further), &raster)) return f;
        if (Failure f = composeProgram()) return f;
    }
    return {};
}

Failure GpuSss::setEdits(std::span<const SplatEdit> edits)
{
    edits_.assign(edits.begin(), edits.end());
    edited_ = true;
    return {};
}

void GpuSss::freeLit()
{
    gl().DeleteTextures(1, &lit_);
    asset_.gpuBytes -= 16 * uint64_t(kMostLanes * litGroups_) * uint64_t(asset_.width) * uint64_t(asset_.rows);
    lit_ = 0, litGroups_ = 0;
}

/// Room for so many lights.
Failure GpuSss::growLit(int lights)
{
    const int groups = groupsOf(lights), height = groups * asset_.rows;
    if (groups <= litGroups_) return {};
    clearHostErrors(*asset_.context);
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, litFramebuffer_); // deletion detaches, and so frees, only while bound
    freeLit();
    litGroups_ = groups;
    gl().GenTextures(1, &lit_);
    bindTexture(gl(), 0, GL_TEXTURE_2D_ARRAY, lit_);
    setNearest(gl(), GL_TEXTURE_2D_ARRAY);
    gl().TexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RGBA32F, asset_.width, height, kMostLanes, 0, GL_RGBA, GL_FLOAT, nullptr);
    asset_.gpuBytes += 16 * uint64_t(kMostLanes * groups) * uint64_t(asset_.width) * uint64_t(asset_.rows);
    for (int l = 0; l < kMostLanes; ++l) gl().FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0 + GLenum(l), lit_, 0, l);
    if (allocated(gl())) return {};
    freeLit();
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(lights) + " lights; use fewer"};
}

/// The light pass, its program and textures bound.
void GpuSss::dispatchLights(int lights) const
{
    const ImageUnitGuard hosts(gl());
    gl().BindImageTexture(0, lit_, 0, GL_TRUE, 0, GL_WRITE_ONLY, GL_RGBA32F);
    gl().MemoryBarrier(GL_SHADER_IMAGE_ACCESS_BARRIER_BIT); // the frame before has read what is overwritten
    gl().DispatchCompute(GLuint(asset_.width + kWorkgroup - 1) / kWorkgroup, GLuint(asset_.rows), GLuint(groupsOf(lights)));
    gl().MemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT);
    gl().UseProgram(0); // Mesa holds on to a program that comes right after one of compute, even if it is deleted
}

void GpuSss::drawLights(int lights) const
{
    constexpr GLenum attachments[kMostLanes] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1, GL_COLOR_ATTACHMENT2, GL_COLOR_ATTACHMENT3};
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, litFramebuffer_);
    gl().DrawBuffers(lanesOf(lights), attachments);
    runPass(asset_, litFramebuffer_, asset_.rows * groupsOf(lights));
}

void GpuSss::runLightPass(const Program& p, const glm::vec3& camera) const
{
    const int lights = asset_.packed.count;
    gl().UseProgram(p.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    bindTexture(gl(), 1, GL_TEXTURE_2D, asset_.lights);
    if (hasNetwork_) bindTexture(gl(), 2, GL_TEXTURE_2D, first_), bindTexture(gl(), 3, GL_TEXTURE_2D, weights_);
    if (hasVisibility_) bindTexture(gl(), 4, GL_TEXTURE_2D_ARRAY, visibility_);
    gl().Uniform3f(p.cameraAsset, camera.x, camera.y, camera.z);
    gl().Uniform1f(p.worldScale2, asset_.packed.worldScale2);
    gl().Uniform1f(p.inverseSize, inverseSize_);
    gl().Uniform1i(p.lightCount, lights);
    gl().Uniform1i(p.oneLoop, 1);
    if (computes()) dispatchLights(lights);
    else drawLights(lights);
}

void GpuSss::runSumPass() const
{
    gl().UseProgram(sumPass_.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    bindTexture(gl(), 1, GL_TEXTURE_2D_ARRAY, lit_);
    gl().Uniform1i(sumPass_.lightCount, asset_.packed.count);
    gl().Uniform1i(sumPass_.lanes, lanesOf(asset_.packed.count));
    runPass(asset_, sumFramebuffer_, asset_.rows);
}

Failure GpuSss::relight(const DrawFrame& frame, bool lightsChanged)
{
    const bool viewChanged = hasNetwork_ && (!seen_ || seenFrom_ != frame.cameraAsset);
    const int lights = asset_.packed.count;
    const Program* program = nullptr;
    if (Failure f = growLit(lights)) return f;
    if (lights > 0)
        if (Failure f = lightProgram(lanesOf(lights), &program)) return f;
    if (edited_) uploadMaterials();
    kept_.update();
    if (lightsChanged || viewChanged) kept_.outdate(kLightPass);
    if (lightsChanged || viewChanged || edited_) kept_.outdate(kSumPass);
    edited_ = false;
    seenFrom_ = frame.cameraAsset;
    seen_ = true;
    const bool light = !kept_.has(kLightPass), sum = light || !kept_.has(kSumPass);
    if (sum) {
        kept_.begin();
        if (light && program) runLightPass(*program, frame.cameraAsset);
        runSumPass();
        kept_.end(1u << kSumPass | unsigned(light) << kLightPass);
    }
    asset_.stats.lightPassesRun = light;
    asset_.stats.viewPassesRun = 0;
    asset_.stats.combinePassesRun = sum;
    return {};
}

void GpuSss::freeLayers(LayerTarget& t)
{
    gl().DeleteFramebuffers(1, &t.framebuffer);
    gl().DeleteTextures(1, &t.texture);
    asset_.gpuBytes -= t.bytes();
    t = {};
}

/// Exactly this size, as a host's window keeps its own; more layers than asked for stay, and so do finer ones.
Failure GpuSss::growLayers(LayerTarget& t, GLenum format, int width, int height, int layers)
{
    if (t.width == width && t.height == height && t.layers >= layers && (t.format == format || t.format == GL_RGBA32F)) return {};
    clearHostErrors(*asset_.context);
    freeLayers(t);
    t.format = format, t.width = width, t.height = height, t.layers = layers;
    gl().GenTextures(1, &t.texture);
    bindTexture(gl(), 0, GL_TEXTURE_2D_ARRAY, t.texture);
    setNearest(gl(), GL_TEXTURE_2D_ARRAY);
    gl().TexImage3D(GL_TEXTURE_2D_ARRAY, 0, GLint(format), width, height, layers, 0, GL_RGBA, GL_HALF_FLOAT, nullptr);
    asset_.gpuBytes += t.bytes();
    gl().GenFramebuffers(1, &t.framebuffer);
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, t.framebuffer);
    for (int k = 0; k < layers; ++k) gl().FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0 + GLenum(k), t.texture, 0, k);
    if (allocated(gl())) return {};
    freeLayers(t);
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(layers) + " layers of " + std::to_string(width) + " x " +
                                           std::to_string(height) + " pixels; draw into a smaller viewport"};
}

/// Binds the first layers for drawing, cleared.
void GpuSss::clearLayers(const LayerTarget& t, int layers) const
{
    GLenum attachments[kMostLayers];
    const float nothing[4] = {0, 0, 0, 0};
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, t.framebuffer);
    for (int k = 0; k < layers; ++k) attachments[k] = GL_COLOR_ATTACHMENT0 + GLenum(k);
    gl().DrawBuffers(layers, attachments);
    for (int k = 0; k < layers; ++k) gl().ClearBufferfv(GL_COLOR, k, nothing);
}

Failure GpuSss::drawLayers(LayerTarget& t, const Program& p, const DrawFrame& frame, int layers, int firstLight, bool depthTest, GlStateGuard& state)
{
    state.beginOffscreen(depthTest);
    clearLayers(t, layers);
    if (depthTest)
        if (Failure f = attachHostDepth(*asset_.context, state.hostFramebuffer(), t.framebuffer, state.viewport())) return f;
    gl().UseProgram(p.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    bindTexture(gl(), 1, GL_TEXTURE_2D, asset_.order);
    bindTexture(gl(), 2, GL_TEXTURE_2D, scattered_);
    bindTexture(gl(), 3, GL_TEXTURE_2D_ARRAY, lit_);
    setSplatUniforms(asset_, p, frame);
    gl().Uniform3f(p.cameraAsset, frame.cameraAsset.x, frame.cameraAsset.y, frame.cameraAsset.z);
    gl().Uniform1f(p.depthOrigin, depthOrigin_);
    gl().Uniform1f(p.depthUnit, depthUnit_);
    gl().Uniform1f(p.layerMax, t.format == GL_RGBA32F ? std::numeric_limits<float>::max() : kMaxHalf);
    gl().Uniform1i(p.firstLight, firstLight);
    gl().Uniform1i(p.lightCount, asset_.packed.count);
    gl().Uniform1i(p.lanes, lanesOf(asset_.packed.count));
    drawQuads(asset_);
    if (depthTest) detachHostDepth(gl());
    return {};
}

void GpuSss::resolve(const Program& p, const DrawFrame& frame, int firstLight, const float viewport[4], float maxColor) const
{
    gl().UseProgram(p.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D_ARRAY, layers_.texture);
    bindTexture(gl(), 1, GL_TEXTURE_2D_ARRAY, further_.texture);
    bindTexture(gl(), 2, GL_TEXTURE_2D, asset_.lights);
    const WindowRays rays = windowRays(frame, viewport);
    gl().Uniform3f(p.eye, frame.cameraAsset.x, frame.cameraAsset.y, frame.cameraAsset.z);
    gl().Uniform3f(p.rayOrigin, rays.origin.x, rays.origin.y, rays.origin.z);
    gl().Uniform3f(p.rayRight, rays.right.x, rays.right.y, rays.right.z);
    gl().Uniform3f(p.rayUp, rays.up.x, rays.up.y, rays.up.z);
    gl().Uniform1f(p.depthOrigin, depthOrigin_);
    gl().Uniform1f(p.depthUnit, depthUnit_);
    gl().Uniform1f(p.worldScale2, asset_.packed.worldScale2);
    gl().Uniform1f(p.maxColor, maxColor);
    gl().Uniform1i(p.firstLight, firstLight);
    gl().Uniform1i(p.lightCount, asset_.packed.count);
    gl().DrawArrays(GL_TRIANGLES, 0, 3);
}

void GpuSss::compose(float maxColor) const
{
    gl().UseProgram(compose_.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D_ARRAY, summed_.texture);
    gl().Uniform1f(compose_.maxColor, maxColor);
    gl().DrawArrays(GL_TRIANGLES, 0, 3);
}

/// Whether scattered light may not fit layers of half floats: a bound from the lights where they are nearest to the box of the splats.
bool GpuSss::tooBrightForHalves() const
{
    if (!hasNetwork_) return false;
    float arriving = 0;
    for (int t = 0; t < asset_.packed.count; ++t) {
        const glm::vec4 &shape = asset_.packed.shape[t], &intensity = asset_.packed.intensity[t];
        const glm::vec3 nearest = glm::clamp(glm::vec3(shape), asset_.boundsMin, asset_.boundsMax) - glm::vec3(shape);
        const float falloff = shape.w < 0 ? 1.0f : 1.0f / std::max(glm::dot(nearest, nearest) * asset_.packed.worldScale2, shape.w);
        arriving += falloff * std::max({intensity.x, intensity.y, intensity.z});
    }
    constexpr float kNetwork = 256; // it answers with numbers around 1
    return arriving * mostScatter_ * kNetwork > kMaxHalf;
}

Failure GpuSss::raster(const DrawFrame& frame, bool depthTest, GlStateGuard& state)
{
    const float* viewport = state.viewport(); // the layers lie under the host's pixels, so that its depth buffer fits
    const int width = int(std::max(viewport[0], 0.0f) + viewport[2]), height = int(std::max(viewport[1], 0.0f) + viewport[3]);
    const glm::vec3 size = asset_.boundsMax - asset_.boundsMin;
    depthOrigin_ = glm::distance(frame.cameraAsset, 0.5f * (asset_.boundsMin + asset_.boundsMax));
    const float exponent = std::round(std::log2(std::max({size.x, size.y, size.z})));
    depthUnit_ = std::exp2(std::clamp(exponent, -100.0f, 100.0f)); // a power of two: dividing rounds nothing
    const int lights = asset_.packed.count;
    const bool sums = lights > kFirstLights;
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, state.hostFramebuffer());
    const float maxColor = largestColor(gl());
    const GLenum format = maxColor > kMaxHalf && tooBrightForHalves() ? GL_RGBA32F : GL_RGBA16F;
    if (sums) {
        if (Failure f = composeProgram()) return f;
        if (Failure f = growLayers(summed_, GL_RGBA32F, width, height, 1)) return f;
        state.beginOffscreen(false);
        clearLayers(summed_, 1);
    }
    RasterPrograms* programs = nullptr;
    for (int first = 0; first == 0 || first < lights;) {
        const bool further = first > 0;
        const int now = std::min(lights - first, further ? kFurtherLights : kFirstLights);
        const int layers = further ? furtherLayersFor(now) : layersFor(now);
        LayerTarget& target = further ? further_ : layers_;
        if (Failure f = rasterPrograms(further, layers, &programs)) return f;
        if (Failure f = growLayers(target, further ? GL_RGBA16F : format, width, height, layers)) return f;
        if (Failure f = drawLayers(target, programs->splat, frame, layers, first, depthTest, state)) return f;
        if (sums) {
            gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, summed_.framebuffer);
            state.beginOffscreen(false);
            resolve(programs->resolve, frame, first, viewport, std::numeric_limits<float>::max());
        } else {
            state.beginDraw(false);
            resolve(programs->resolve, frame, first, viewport, maxColor);
        }
        first += std::max(now, 1);
    }
    if (sums) {
        state.beginDraw(false);
        compose(maxColor);
    }
    return {};
}

} // namespace

std::unique_ptr<GpuModel> sss::makeGpuModel(NacreAssetImpl& asset) { return std::make_unique<GpuSss>(asset); }

} // namespace nacre
