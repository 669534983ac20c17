// sss on the GPU (sss.h and sss_network.h have the equations):
//   light     per splat and light: scattered light per unit of subsurfaceness, incident share. Network and visibility map. From GL 4.3
//             on in a compute shader, which has the weights in shared memory.                   of a view, by groups of lights
//   sum       per splat: scattered light of all lights, into the draw list                      of a view
//   gather    surface and incident shares into the draw list, from where splats are blended into the view's G-buffer (gbuffer.cpp)
// Each runs only when its inputs have changed in any bit.
//
// Textures beyond those of every model:
//   asset      geometry    slots: normal+roughness, base colour+metalness, subsurfaceness, subsurfaceness * residual tint
//              visibility  R8       array: octahedral maps, one long row
//              weights     RGBA32F  of the network, see packNetwork
//              first       RGBA16F  16 slots: first layer of the network without light and view
//   instance   geometry    its own, when it is edited
//   view       lit         RGBA32F  light pass: arrays, see litTexel, one for each kBatchLights lights
// first and weights exist only with a network.
#include "appearance/sss/sss.h"
#include "appearance/sss/sss_asset.h"
#include "appearance/sss/sss_edit.h"
#include "base/half.h"
#include "draw_list.h"
#include "gl_state.h"
#include "instance.h"
#include "shader_sources.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace nacre {

namespace {

enum SssSlot { kNormalRoughness = kCommonSlots, kBaseMetalness, kSubsurfaceSlot, kScatterTint, kSssSlots };
constexpr int kWeightsWidth = 1024;

// The light pass takes lights in groups, so that each weight is fetched once for all lights of a group: as few groups as kMostLanes allow,
// and all of one size, as small as so many groups can be.
constexpr int kMostLanes = 4;
constexpr int kWorkgroup = 64;                       // splats of the compute shader
int groupsOf(int lights) { return std::max(1, (lights + kMostLanes - 1) / kMostLanes); }
int lanesOf(int lights) { return std::max(1, (lights + groupsOf(lights) - 1) / groupsOf(lights)); }

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

class SssAsset final : public AssetModel {
public:
    explicit SssAsset(Asset& asset) : asset_(asset) {}
    Failure checkLayout(const SplatAsset& source) override;
    int mostSlots() const override { return kSssHidden1 / 4; }
    int geometrySlots() const override { return int(kSssSlots) - int(kCommonSlots); }
    Failure upload(const SplatAsset& source, UploadQueue& queue) override;
    bool shadesPixels() const override { return true; }
    std::unique_ptr<InstanceModel> makeInstance(Instance& instance) override;
    Failure compileAhead(int mostLights) override;

    bool computes() const { return hasNetwork && asset_.context.gl.hasCompute(); } // without network there is nothing to share
    Failure lightProgram(int lanes, bool occluded, const Program** program) const;
    Failure sumProgram(const Program** program) const;
    Failure surfaceProgram(const Program** program) const;
    Failure incidentProgram(int layers, const Program** program) const;

    std::vector<SssMaterial> baked;   // as in the file
    bool hasVisibility = false, hasNetwork = false, hasShare = false;
    float inverseSize = 0;
    Texture visibility, weights, first;

private:
    void uploadNetwork(const SssChannels& channels, UploadQueue& queue);
    Failure findLightProgram(int lanes, bool occluded, const Program** program) const;

    Asset& asset_;
    mutable ProgramOnce light_[2][kMostLanes + 1], sum_, surface_, incident_[9]; // [occluded][lanes], [layers]
};

class SssInstance final : public InstanceModel {
public:
    SssInstance(Instance& instance, const SssAsset& model) : instance_(instance), model_(model) { mostScatter_ = mostScatter(model.baked); }
    Failure setEdits(std::span<const SplatEdit> edits) override;
    Failure updateGeometry() override;
    const Texture& geometry() const override { return edited_ ? edited_ : instance_.asset->geometry; }
    Failure relight(RelightBudget& budget, bool* done) override;
    float brightest() const override;
    std::unique_ptr<ViewModel> makeView() override;

private:
    static float mostScatter(const std::vector<SssMaterial>& materials);
    void uploadMaterials(const std::vector<SssMaterial>& materials) const;

    Instance& instance_;
    const SssAsset& model_;
    std::vector<SplatEdit> edits_;
    bool outdated_ = false;
    Texture edited_;           // all slots of the geometry, with edits
    float mostScatter_ = 0;    // largest factor of scattered light among the materials
};

class SssView final : public ViewModel {
public:
    SssView(Instance& instance, const SssAsset& model) : instance_(instance), model_(model) {}
    Failure relight(const InstanceFrame& frame, DrawList& list, const ListRows& rows, RelightBudget& budget, bool* done) override;
    Failure gather(const InstanceFrame& frame, DrawList& list, const ListRows& rows, std::span<const int> viewLights) override;

private:
    /// Lights of one group of lanes: what it was made from, and in which draw.
    struct Group {
        uint64_t lights = 0, draw = 0;
        glm::vec4 camera{0};
        bool occluded = false;
    };
    /// Results of the light pass for kBatchLights lights.
    struct Batch {
        Texture lit;
        Framebuffer framebuffer;
        int lights = 0, lanes = 0;
        std::vector<Group> made;
    };
    Group wanted(size_t batch, int group, const glm::vec4& camera) const;
    bool outdated(size_t batch, int group, const glm::vec4& camera) const;
    Failure growBatches();
    Failure runGroups(size_t batch, int first, int count, const glm::vec4& camera);
    void dispatch(const Program& program, const Texture& lit, int first, int count) const;
    Failure relightGroups(const glm::vec4& camera, RelightBudget& budget, bool* done);
    Failure sum(DrawList& list, const ListRows& rows);
    Failure gatherSurface(const InstanceFrame& frame, DrawList& list, const ListRows& rows);
    Failure gatherLayers(DrawList& list, const ListRows& rows, std::span<const int> viewLights, size_t batch, int first, int count);
    Failure gatherIncident(DrawList& list, const ListRows& rows, std::span<const int> viewLights);

    Instance& instance_;
    const SssAsset& model_;
    std::vector<Batch> batches_;
    uint64_t litRevision_ = 1;          // of what light passes have made
    uint64_t summedLit_ = 0, summedLooks_ = 0, summedList_ = 0, summedIn_ = 0;
    // of what gather has written
    uint64_t gatheredLit_ = 0, gatheredLooks_ = 0, gatheredList_ = 0, surfacesIn_ = 0, incidentsIn_ = 0;
    glm::mat3 gatheredPlace_{0};
    std::vector<int> gatheredLights_;
};

// ---- asset

Failure SssAsset::checkLayout(const SplatAsset& source)
{
    hasVisibility = source.find("visibility") != nullptr;
    hasNetwork = source.find("network") != nullptr;
    hasShare = SssChannels(source).shares();
    return fitLongRow(asset_.context.gl, asset_.grid, "visibility", asset_.grid.count, asset_.visibilitySize * asset_.visibilitySize);
}

void SssAsset::uploadNetwork(const SssChannels& channels, UploadQueue& queue)
{
    Context& context = asset_.context;
    const std::vector<float> packed = packNetwork(channels.network());
    const int height = int(packed.size()) / (4 * kWeightsWidth);
    weights = Texture(context, GL_RGBA32F, kWeightsWidth, height);
    context.gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, kWeightsWidth, height, GL_RGBA, GL_FLOAT, packed.data());
    inverseSize = channels.network()[kSssFrame + 3];

    first = slotTexture(context, asset_.grid, GL_RGBA16F, kSssHidden1 / 4);
    for (int j = 0; j < kSssHidden1 / 4; ++j)
        queueSlot<uint16_t>(queue, context.gl, asset_.grid, first, j, [this, j](size_t g, uint16_t* t) {
            float values[kSssHidden1];
            SssChannels(*asset_.source).firstLayer(g, values);
            for (int c = 0; c < 4; ++c) t[c] = halfFromFloat(std::clamp(values[4 * j + c], -kMaxHalf, kMaxHalf));
        });
}

void copyMaterialSlot(int slot, const SssMaterial& m, float* t)
{
    switch (slot) {
    case kNormalRoughness: std::copy_n(m.normal, 3, t), t[3] = m.roughness; break;
    case kBaseMetalness: std::copy_n(m.base, 3, t), t[3] = m.metalness; break;
    case kSubsurfaceSlot: t[0] = m.subsurface; break;
    default:
        for (int c = 0; c < 3; ++c) t[c] = m.subsurface * m.residual[c];
    }
}

Failure SssAsset::upload(const SplatAsset& source, UploadQueue& queue)
{
    Context& context = asset_.context;
    const SssChannels channels(source);
    for (size_t g = 0; g < asset_.grid.count; ++g) baked.push_back(channels.material(g));
    for (int slot = kNormalRoughness; slot < kSssSlots; ++slot)
        queueSlot<float>(queue, context.gl, asset_.grid, asset_.geometry, slot, [this, slot](size_t g, float* t) { copyMaterialSlot(slot, baked[g], t); });
    if (const Channel* maps = source.find("visibility")) queueVisibility(queue, context, asset_.grid, visibility, *maps);
    if (hasNetwork) uploadNetwork(channels, queue);
    return {};
}

Failure SssAsset::lightProgram(int lanes, bool occluded, const Program** program) const
{
    return light_[occluded][lanes].find(program, [&](const Program** made) { return findLightProgram(lanes, occluded, made); });
}

Failure SssAsset::findLightProgram(int lanes, bool occluded, const Program** program) const
{
    const std::string common = define("LANES", lanes) + define("COMPUTE", int(computes())) + define("GROUP", kWorkgroup) +
                               define("VISIBILITY_SIZE", asset_.visibilitySize) + define("HAS_VISIBILITY", int(hasVisibility)) +
                               define("HAS_OCCLUSION", int(occluded)) + define("HAS_NETWORK", int(hasNetwork)) + define("HAS_SHARE", int(hasShare)) +
                               define("H1", kSssHidden1) + define("H2", kSssHidden2) + define("H3", kSssHidden3) + define("HS", kSssHiddenShare) +
                               define("AT_LIGHT", kAtLight) + define("AT_SECOND", kAtSecond) + define("AT_THIRD", kAtThird) + define("AT_SHARE", kAtShare) +
                               define("AT_OUT", kAtOut) + define("AT_END", kWeightTexels) + define("LEAK", kSssLeak) + shaders::kLightGlsl +
                               shaders::kFetchLightGlsl + shaders::kVisibilityMapGlsl + (hasNetwork ? shaders::kSssNetworkGlsl : "") + shaders::kSssLightGlsl;
    const auto samplers = {"uGeometry", "uLights", "uFirst", "uWeights", "uVisibility", "uOcclusion"};
    if (computes()) return findComputeProgram(asset_.context, "light", common + shaders::kSssLightCompGlsl, samplers, program);
    return findProgram(asset_.context, {"light", shaders::kFullscreenVertGlsl, shaders::kPassGlsl + common + shaders::kSssLightFragGlsl, samplers}, program);
}

Failure SssAsset::sumProgram(const Program** program) const
{
    return sum_.find(program, [&](const Program** made) {
        return findProgram(asset_.context, {"sum", shaders::kFullscreenVertGlsl, std::string(shaders::kPassGlsl) + shaders::kSssSumFragGlsl, {"uGeometry", "uLit"}}, made);
    });
}

Failure SssAsset::surfaceProgram(const Program** program) const
{
    return surface_.find(program, [&](const Program** made) {
        return findProgram(asset_.context, {"surface", shaders::kFullscreenVertGlsl, std::string(shaders::kPassGlsl) + shaders::kSssSurfaceFragGlsl, {"uGeometry"}}, made);
    });
}

Failure SssAsset::incidentProgram(int layers, const Program** program) const
{
    return incident_[layers].find(program, [&](const Program** made) {
        return findProgram(asset_.context, {"incident", shaders::kFullscreenVertGlsl, define("LAYERS", layers) + shaders::kEachLayerGlsl + shaders::kPassGlsl + shaders::kSssIncidentFragGlsl, {"uLit"}},
                       made);
    });
}

Failure SssAsset::compileAhead(int mostLights)
{
    const Program* program = nullptr;
    if (Failure f = sumProgram(&program)) return f;
    if (Failure f = surfaceProgram(&program)) return f;
    const int most = std::min(mostLights, kBatchLights);
    for (int lights = 1; lights <= most; ++lights)
        if (Failure f = lightProgram(lanesOf(lights), false, &program)) return f;
    for (int layers = 1; layers <= std::min((mostLights + 2) / 3, asset_.context.gl.maxLayers()); ++layers)
        if (Failure f = incidentProgram(layers, &program)) return f;
    return {};
}

std::unique_ptr<InstanceModel> SssAsset::makeInstance(Instance& instance) { return std::make_unique<SssInstance>(instance, *this); }

// ---- instance

float SssInstance::mostScatter(const std::vector<SssMaterial>& materials)
{
    float most = 0;
    for (const SssMaterial& m : materials) most = std::max(most, m.subsurface * std::max({m.residual[0], m.residual[1], m.residual[2]}));
    return most;
}

float SssInstance::brightest() const
{
    constexpr float kNetwork = 256; // it answers with numbers around 1
    return model_.hasNetwork ? kNetwork * mostScatter_ : 0.0f;
}

Failure SssInstance::setEdits(std::span<const SplatEdit> edits)
{
    edits_.assign(edits.begin(), edits.end());
    outdated_ = true;
    ++instance_.looksRevision;
    return {};
}

void SssInstance::uploadMaterials(const std::vector<SssMaterial>& materials) const
{
    const Gl& gl = instance_.context.gl;
    const Asset& asset = *instance_.asset;
    uploadSlot<float>(gl, asset.grid, edited_, kMeanOpacity, [&](size_t g, float* t) {
        const glm::vec3& p = asset.positions[g];
        t[0] = p.x, t[1] = p.y, t[2] = p.z, t[3] = materials[g].opacity;
    });
    for (int slot = kNormalRoughness; slot < kSssSlots; ++slot)
        uploadSlot<float>(gl, asset.grid, edited_, slot, [&](size_t g, float* t) { copyMaterialSlot(slot, materials[g], t); });
}

/// Only edits: what lights make of sss depends on the camera.
Failure SssInstance::relight(RelightBudget&, bool* done)
{
    *done = true;
    return updateGeometry();
}

Failure SssInstance::updateGeometry()
{
    if (!outdated_) return {};
    outdated_ = false;
    Context& context = instance_.context;
    const Asset& asset = *instance_.asset;
    if (edits_.empty()) {
        edited_ = {};
        mostScatter_ = mostScatter(model_.baked);
        return {};
    }
    if (!edited_) {
        clearHostErrors(context);
        edited_ = slotTexture(context, asset.grid, GL_RGBA32F, kSssSlots);
        if (takeGlError(context.gl) != GL_NO_ERROR) {
            edited_ = {}, outdated_ = true;
            return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for materials of an instance of its own"};
        }
        copyRows(context, asset.geometry, edited_, asset.grid.rows * kCommonSlots);
    }
    std::vector<SssMaterial> materials = model_.baked;
    for (size_t g = 0; g < materials.size(); ++g) applyEdits(edits_, asset.positions[g], materials[g]);
    mostScatter_ = mostScatter(materials);
    uploadMaterials(materials);
    return {};
}

std::unique_ptr<ViewModel> SssInstance::makeView() { return std::make_unique<SssView>(instance_, model_); }

// ---- view

/// What the group is to be made from; lights: the largest revision.
SssView::Group SssView::wanted(size_t batch, int group, const glm::vec4& camera) const
{
    const Batch& b = batches_[batch];
    Group w{1, 0, model_.hasNetwork ? camera : glm::vec4(0), batch < instance_.occlusion.size()};
    for (int l = 0; l < b.lanes; ++l)
        if (const size_t slot = batch * kBatchLights + size_t(b.lanes * group + l); slot < instance_.slotRevisions.size())
            w.lights = std::max(w.lights, instance_.slotRevisions[slot]);
    return w;
}

bool SssView::outdated(size_t batch, int group, const glm::vec4& camera) const
{
    const Group w = wanted(batch, group, camera), &made = batches_[batch].made[size_t(group)];
    return made.lights != w.lights || made.camera != w.camera || made.occluded != w.occluded || !instance_.context.passes.sure(made.draw);
}

/// Room for the lights there are; a batch whose number of lights has changed is made anew.
Failure SssView::growBatches()
{
    Context& context = instance_.context;
    const SplatGrid& grid = instance_.asset->grid;
    const int lights = instance_.lightCount();
    const size_t batches = size_t((lights + kBatchLights - 1) / kBatchLights);
    if (batches_.size() != batches) batches_.resize(batches), ++litRevision_;
    for (size_t i = 0; i < batches_.size(); ++i) {
        Batch& b = batches_[i];
        const int count = std::min(lights - int(i) * kBatchLights, kBatchLights);
        if (b.lights == count) continue;
        b.lights = count, b.lanes = lanesOf(count);
        b.made.assign(size_t(groupsOf(count)), {});
        ++litRevision_;
        if (b.lit && b.lit.height() >= groupsOf(count) * grid.rows) continue;
        clearHostErrors(context);
        b.lit = {}, b.framebuffer = {};
        b.lit = Texture(context, GL_RGBA32F, grid.width, groupsOf(count) * grid.rows, kMostLanes);
        b.framebuffer = Framebuffer(context);
        for (int l = 0; l < kMostLanes; ++l) b.framebuffer.attach(l, b.lit, l);
        if (allocated(context.gl)) continue;
        batches_.clear();
        return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(lights) + " lights on an instance; use fewer"};
    }
    return {};
}

/// The light pass, its program and textures bound.
void SssView::dispatch(const Program& program, const Texture& lit, int first, int count) const
{
    const Gl& gl = instance_.context.gl;
    const SplatGrid& grid = instance_.asset->grid;
    const ImageUnitGuard hosts(gl, instance_.context.hostState);
    program.set("uFirstGroup", first);
    gl.BindImageTexture(0, lit.name(), 0, GL_TRUE, 0, GL_WRITE_ONLY, GL_RGBA32F);
    gl.MemoryBarrier(GL_SHADER_IMAGE_ACCESS_BARRIER_BIT); // the frame before has read what is overwritten
    gl.DispatchCompute(GLuint(grid.width + kWorkgroup - 1) / kWorkgroup, GLuint(grid.rows), GLuint(count));
    gl.MemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT);
    gl.UseProgram(0); // Mesa holds on to a program that comes right after one of compute, even if it is deleted
}

Failure SssView::runGroups(size_t batch, int first, int count, const glm::vec4& camera)
{
    const Asset& asset = *instance_.asset;
    const Batch& b = batches_[batch];
    const bool occluded = batch < instance_.occlusion.size();
    const Program* program = nullptr;
    if (Failure f = model_.lightProgram(b.lanes, occluded, &program)) return f;
    program->use();
    asset.grid.set(*program);
    instance_.model->geometry().bind(0);
    instance_.lightTexture.bind(1);
    model_.first.bind(2), model_.weights.bind(3);
    model_.visibility.bind(4);
    if (occluded) instance_.occlusion[batch].bind(5);
    program->set("uCamera", camera);
    program->set("uWorldScale2", instance_.worldScale2());
    program->set("uInverseSize", model_.inverseSize);
    program->set("uFirstLight", int(batch) * kBatchLights);
    program->set("uEndLight", int(batch) * kBatchLights + b.lights);
    program->set("uOneLoop", 1);
    if (model_.computes()) return dispatch(*program, b.lit, first, count), Failure{};
    b.framebuffer.bind();
    b.framebuffer.drawTo(b.lanes);
    runPass(instance_.context, asset.grid.width, asset.grid.rows * first, asset.grid.rows * count);
    return {};
}

Failure SssView::relightGroups(const glm::vec4& camera, RelightBudget& budget, bool* done)
{
    bool ran = false;
    for (size_t batch = 0; batch < batches_.size(); ++batch) {
        Batch& b = batches_[batch];
        const int groups = int(b.made.size());
        for (int g = 0, n = 0; g < groups; g += std::max(n, 1)) {
            for (n = 0; g + n < groups && outdated(batch, g + n, camera) && budget.take(uint64_t(instance_.asset->grid.count) * uint64_t(b.lanes));) ++n;
            if (n > 0)
                if (Failure f = runGroups(batch, g, n, camera)) return f;
            for (int k = g; k < g + n; ++k) b.made[size_t(k)] = wanted(batch, k, camera), b.made[size_t(k)].draw = instance_.context.passes.now();
            ran = ran || n > 0;
            *done = *done && (n > 0 || !outdated(batch, g, camera));
        }
    }
    if (ran) ++litRevision_, ++budget.stats->lightPassesRun;
    return {};
}

/// Batches after the first add to what the first has written.
Failure SssView::sum(DrawList& list, const ListRows& rows)
{
    const Gl& gl = instance_.context.gl;
    const Program* program = nullptr;
    if (Failure f = model_.sumProgram(&program)) return f;
    program->use();
    instance_.asset->grid.set(*program);
    list.set(*program, rows);
    program->set("uTint", instance_.tint);
    instance_.model->geometry().bind(0);
    list.beginColor();
    for (size_t i = 0; i == 0 || i < batches_.size(); ++i) {
        const bool any = i < batches_.size();
        if (any) batches_[i].lit.bind(1);
        program->set("uLanes", any ? batches_[i].lanes : 1);
        program->set("uBatchLights", any ? batches_[i].lights : 0);
        if (i > 0) beginAdding(gl);
        runPass(instance_.context, list.width(), rows.first, rows.count);
        if (i > 0) gl.Disable(GL_BLEND);
    }
    return {};
}

Failure SssView::relight(const InstanceFrame& frame, DrawList& list, const ListRows& rows, RelightBudget& budget, bool* done)
{
    const PassLog& passes = instance_.context.passes;
    *done = true;
    if (Failure f = growBatches()) return f;
    if (Failure f = relightGroups(frame.camera, budget, done)) return f;
    const bool summed = summedLit_ == litRevision_ && summedLooks_ == instance_.looksRevision && summedList_ == list.revision() && passes.sure(summedIn_);
    if (!*done || summed) return {};
    if (Failure f = sum(list, rows)) return f;
    summedLit_ = litRevision_, summedLooks_ = instance_.looksRevision, summedList_ = list.revision(), summedIn_ = passes.now();
    ++budget.stats->combinePassesRun;
    return {};
}

Failure SssView::gatherSurface(const InstanceFrame& frame, DrawList& list, const ListRows& rows)
{
    if (gatheredLooks_ == instance_.looksRevision && gatheredList_ == list.attributesRevision() && gatheredPlace_ == frame.worldFromAsset &&
        instance_.context.passes.sure(surfacesIn_))
        return {};
    surfacesIn_ = instance_.context.passes.now();
    const Program* program = nullptr;
    if (Failure f = model_.surfaceProgram(&program)) return f;
    program->use();
    instance_.asset->grid.set(*program);
    list.set(*program, rows);
    program->set("uWorldFromAsset", frame.worldFromAsset);
    program->set("uWorldScale", frame.worldScale);
    program->set("uTint", instance_.tint);
    instance_.model->geometry().bind(0);
    list.beginAttributes(0, 3);
    runPass(instance_.context, list.width(), rows.first, rows.count);
    return {};
}

/// Writes `count` layers, three lights each, from layer `first` on: what batch `b` has of them, and zeros.
Failure SssView::gatherLayers(DrawList& list, const ListRows& rows, std::span<const int> viewLights, size_t b, int first, int count)
{
    const Program* program = nullptr;
    if (Failure f = model_.incidentProgram(count, &program)) return f;
    program->use();
    instance_.asset->grid.set(*program);
    list.set(*program, rows);
    list.beginAttributes(3 + first, count);
    int slots[24];
    for (int i = 0; i < 3 * count; ++i) {
        const size_t t = size_t(3 * first + i);
        const int slot = t < viewLights.size() ? viewLights[t] : -1;
        slots[i] = slot >= 0 && size_t(slot / kBatchLights) == b ? slot % kBatchLights : -1;
    }
    if (b < batches_.size()) batches_[b].lit.bind(0);
    program->set("uLanes", b < batches_.size() ? batches_[b].lanes : 1);
    program->set("uSlots", 3 * count, slots);
    runPass(instance_.context, list.width(), rows.first, rows.count);
    return {};
}

/// Whether any light of the layer is in the batch.
static bool holdsAny(std::span<const int> viewLights, size_t batch, int layer)
{
    const auto lights = viewLights.subspan(size_t(3 * layer), std::min<size_t>(3, viewLights.size() - size_t(3 * layer)));
    return std::any_of(lights.begin(), lights.end(), [&](int slot) { return slot >= 0 && size_t(slot / kBatchLights) == batch; });
}

/// As many layers at once as the GPU draws into; batches after the first add to them, a layer at a time.
Failure SssView::gatherIncident(DrawList& list, const ListRows& rows, std::span<const int> viewLights)
{
    const Gl& gl = instance_.context.gl;
    const int layers = (int(viewLights.size()) + 2) / 3, most = gl.maxLayers();
    for (int first = 0; first < layers; first += most)
        if (Failure f = gatherLayers(list, rows, viewLights, 0, first, std::min(most, layers - first))) return f;
    for (size_t b = 1; b < batches_.size(); ++b)
        for (int layer = 0; layer < layers; ++layer) {
            if (!holdsAny(viewLights, b, layer)) continue;
            beginAdding(gl);
            if (Failure f = gatherLayers(list, rows, viewLights, b, layer, 1)) return f;
            gl.Disable(GL_BLEND);
        }
    return {};
}

Failure SssView::gather(const InstanceFrame& frame, DrawList& list, const ListRows& rows, std::span<const int> viewLights)
{
    if (Failure f = gatherSurface(frame, list, rows)) return f;
    const bool sameLights = std::equal(viewLights.begin(), viewLights.end(), gatheredLights_.begin(), gatheredLights_.end());
    if (gatheredLit_ != litRevision_ || gatheredList_ != list.attributesRevision() || !sameLights || !instance_.context.passes.sure(incidentsIn_)) {
        if (Failure f = gatherIncident(list, rows, viewLights)) return f;
        incidentsIn_ = instance_.context.passes.now();
    }
    gatheredLooks_ = instance_.looksRevision, gatheredList_ = list.attributesRevision(), gatheredPlace_ = frame.worldFromAsset;
    gatheredLit_ = litRevision_, gatheredLights_.assign(viewLights.begin(), viewLights.end());
    return {};
}

} // namespace

std::unique_ptr<AssetModel> sss::makeAssetModel(Asset& asset) { return std::make_unique<SssAsset>(asset); }

} // namespace nacre
