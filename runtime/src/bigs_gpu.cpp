// bigs on the GPU. Radiance of every splat towards the camera, in three passes over small float textures (bigs.h has the equation):
//   light    direct_t = falloff v_t max(T_dir, 0), v_t and sum_t I falloff max(T_ind, 0)                   of an instance, depends on lights
//   view     a_i = sum_j c_ij y_j(w_o)                                                                     of a view, depends on its place
//   combine  indirect + sum_t I_t (direct_t max(rho + sum_i a_i y_i(w_t), 0) + falloff v_t (k lobe_t(w_o) + f forward_t(w_o)))  of a view, depends on both
// All of it in asset space. Without s there is no view pass; without s, lobe and forward nothing depends on the camera. Each pass runs only when
// its inputs differ in any bit from those of its last run, the light pass for those groups of four lights whose inputs do.
//
// Textures beyond those of every model:
//   asset      geometry    slots: rho+shadow; with a lobe also normal+sharpness, k; with forward also f+sharpness
//              transport   RGBA16F  a slot for each function that any splat uses, up to 25: T_ind rgb, T_dir; of assets that hold codes RGBA8, one
//                                   slot more (see PackedTransport)
//              scale       RGBA32F  only with RGBA8: unit of each function's T_ind rgb, T_dir, one row
//              scatter     RGBA16F  array, texel g * pairs + pair(i, j): c_ij rgb (all of a splat together: the view pass reads it 25 times)
//              visibility  R8       array, texel (g * n + j) * n + i of the octahedral maps of n x n
//   instance   direct, indirect     RGBA32F  light pass: one slot per four lights
//              visible     RGBA16F  light pass: v of four lights per slot, for lobe and forward (v comes from bytes: half floats lose nothing of it)
//   view       contracted  RGBA32F  view pass: every grid row of splats with s becomes one row per function of s
// scatter and contracted exist only with s, visibility only with that channel, visible only with a lobe or forward and something that hides lights.
// Coefficients of SH are stored as half floats (relative error at most 2^-11) or, where the file has rounded them more than that already, as
// bytes: an asset of profile compact has 99 to 194 codes a splat, more bytes than these 104, and each would cost 25 products. The lobe as float (half a normal would shift a sharp
// highlight by a percent of its width), visibility as the bytes of the file.
#include "appearance/bigs/bigs.h"
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

enum BigsSlot { kRhoShadow = kCommonSlots, kNormalSharpness, kLobeColor }; // forward has the next one that is free

/// Transport in a byte a number: x = unit[function] * size * (byte - 128) / 127, the units shared by all splats, the size a splat's own and
/// 2^(-b / 8) for the byte b in the last slot. All this for each of T_ind rgb, T_dir. Of the channels, which must outlive this.
class PackedTransport {
public:
    PackedTransport(const Channel& tDir, const Channel& tInd, int functions) : tDir_(tDir), tInd_(tInd), functions_(functions), sizes_(tDir.values.size() / kBigsTransportFunctions)
    {
        std::array<glm::dvec4, kBigsTransportFunctions> squares{};
        for (size_t g = 0; g < sizes_.size(); ++g)
            for (int i = 0; i < kBigsTransportFunctions; ++i) {
                const glm::dvec4 x = at(g, i);
                squares[size_t(i)] += x * x;
            }
        for (size_t i = 0; i < kBigsTransportFunctions; ++i) units_[i] = glm::sqrt(squares[i] / double(sizes_.size()));
        glm::vec4 most(0);
        for (size_t g = 0; g < sizes_.size(); ++g) most = glm::max(most, largestRatio(g));
        for (glm::vec4& unit : units_) unit *= most; // so that no size is beyond 1
        for (size_t g = 0; g < sizes_.size(); ++g) {
            const glm::vec4 largest = largestRatio(g);
            for (int c = 0; c < 4; ++c) sizes_[g][size_t(c)] = largest[c] > 0 ? uint8_t(std::clamp(std::floor(-8 * std::log2(largest[c])), 0.0f, 255.0f)) : 255;
        }
    }

    const std::array<glm::vec4, kBigsTransportFunctions>& units() const { return units_; }

    void texel(size_t g, int slot, uint8_t* out) const
    {
        for (int c = 0; c < 4; ++c) {
            const uint8_t b = sizes_[g][size_t(c)];
            if (slot == functions_) out[c] = b;
            else out[c] = uint8_t(128 + std::lround(127 * std::clamp(ratio(g, slot, c) * std::exp2(float(b) / 8), -1.0f, 1.0f)));
        }
    }

private:
    glm::vec4 at(size_t g, int i) const
    {
        const size_t k = g * kBigsTransportFunctions + size_t(i);
        return {tInd_.values[3 * k], tInd_.values[3 * k + 1], tInd_.values[3 * k + 2], tDir_.values[k]};
    }
    float ratio(size_t g, int i, int c) const
    {
        const float unit = units_[size_t(i)][c];
        return unit > 0 ? at(g, i)[c] / unit : 0.0f;
    }
    glm::vec4 largestRatio(size_t g) const
    {
        glm::vec4 most(0);
        for (int i = 0; i < kBigsTransportFunctions; ++i)
            for (int c = 0; c < 4; ++c) most[c] = std::max(most[c], std::abs(ratio(g, i, c)));
        return most;
    }

    const Channel &tDir_, &tInd_;
    int functions_;
    std::vector<std::array<uint8_t, 4>> sizes_; // by splat
    std::array<glm::vec4, kBigsTransportFunctions> units_;
};

class BigsAsset final : public AssetModel {
public:
    explicit BigsAsset(Asset& asset) : asset_(asset) {}
    Failure checkLayout(const SplatAsset& source) override;
    int mostSlots() const override { return functions + int(asset_.coded); }
    int geometrySlots() const override { return forwardSlot() + int(hasForward) - int(kCommonSlots); }
    Failure upload(const SplatAsset& source, UploadQueue& queue) override;
    bool shadesPixels() const override { return false; }
    std::unique_ptr<InstanceModel> makeInstance(Instance& instance) override;
    Failure compileAhead(int mostLights) override;

    int forwardSlot() const { return hasLobe ? kLobeColor + 1 : int(kNormalSharpness); }
    bool isSharp() const { return hasLobe || hasForward; }
    bool hidesLights(bool occluded) const { return isSharp() && (hasVisibility || occluded); }
    int contractedRows() const { return sFunctions * int((scattering + size_t(asset_.grid.width) - 1) / size_t(asset_.grid.width)); }
    Failure lightProgram(bool occluded, const Program** program) const;
    Failure viewProgram(const Program** program) const;
    Failure combineProgram(bool occluded, const Program** program) const;

    int functions = kBigsTransportFunctions; // of T_dir and T_ind that are not zero of all splats
    int sFunctions = 0;
    size_t scattering = 0;     // so many splats, the first, have s
    bool hasLobe = false, hasForward = false, hasVisibility = false;
    float brightest = 0;
    Texture transport, transportScale, scatter, visibility;

private:
    void queuePackedTransport(UploadQueue& queue);
    void queueGeometry(const SplatAsset& source, UploadQueue& queue);
    std::string defines(bool occluded) const;

    Asset& asset_;
    std::shared_ptr<const PackedTransport> packed_; // from decoding to upload
    mutable ProgramOnce light_[2], combine_[2], view_; // [occluded]
};

/// Results of the light pass for kBatchLights lights.
struct LightBatch {
    Texture direct, indirect, visible;
    Framebuffer framebuffer;
};

class BigsInstance final : public InstanceModel {
public:
    BigsInstance(Instance& instance, const BigsAsset& model) : instance_(instance), model_(model) {}
    Failure setEdits(std::span<const SplatEdit> edits) override;
    const Texture& geometry() const override { return instance_.asset->geometry; }
    Failure relight(RelightBudget& budget, bool* done) override;
    float brightest() const override { return model_.brightest; }
    std::unique_ptr<ViewModel> makeView() override;

    const std::vector<LightBatch>& batches() const { return batches_; }
    uint64_t revision() const { return revision_; } // of what the light pass has made

private:
    struct Group {
        uint64_t made = 0;     // revision of the lights it was made from
        uint64_t draw = 0;     // in which draw
    };
    static constexpr int kBatchGroups = kBatchLights / kLightsPerGroup;
    Failure growBatches(bool visible);
    Failure runGroups(int first, int count);
    bool isMade(int group) const { return groups_[size_t(group)].made == instance_.groupRevision(group); }
    std::vector<int> outdatedGroups() const;

    Instance& instance_;
    const BigsAsset& model_;
    std::vector<LightBatch> batches_;
    std::vector<Group> groups_;
    bool occluded_ = false;
    int lights_ = 0;
    uint64_t revision_ = 1;
};

class BigsView final : public ViewModel {
public:
    BigsView(Instance& instance, const BigsAsset& model, const BigsInstance& lit) : instance_(instance), model_(model), lit_(lit) {}
    Failure relight(const InstanceFrame& frame, DrawList& list, const ListRows& rows, RelightBudget& budget, bool* done) override;
    Failure gather(const InstanceFrame& frame, DrawList& list, const ListRows& rows, std::span<const int> viewLights) override;

private:
    /// Of the combine pass.
    struct Inputs {
        glm::vec4 camera{0};
        uint64_t lights = 0, looks = 0, list = 0; // revisions
        bool sameAs(const Inputs& o, bool seesCamera) const { return lights == o.lights && looks == o.looks && list == o.list && (!seesCamera || camera == o.camera); }
    };
    Failure contract(const glm::vec4& camera);
    Failure combine(const glm::vec4& camera, DrawList& list, const ListRows& rows);

    Instance& instance_;
    const BigsAsset& model_;
    const BigsInstance& lit_;
    Texture contracted_;
    Framebuffer contractedTarget_;
    glm::vec4 contractedFrom_{0};
    Inputs combined_;
    uint64_t contractedIn_ = 0, combinedIn_ = 0, clearedIn_ = 0; // draws
    uint64_t clearedList_ = 0;
};

// ---- asset

/// The largest radiance of any splat per unit of irradiance, from sums of absolute values (|y| < 1.8 for degree 4).
float brightestOf(const SplatAsset& source)
{
    const auto most = [&](const char* name) {
        float m = 0;
        if (const Channel* c = source.find(name))
            for (const float v : c->values) m = std::max(m, std::abs(v));
        return m;
    };
    constexpr float kLargestY = 1.8f, kFunctions = kBigsTransportFunctions;
    const float direct = kFunctions * kLargestY * most("tDir"), indirect = kFunctions * kLargestY * most("tInd");
    return direct * (1 + most("s") * kFunctions * kLargestY) + indirect + most("lobe") + most("forward");
}

/// 1, 4, 9, 16 or 25: the others are zero.
int transportFunctionsOf(const SplatAsset& source)
{
    size_t used = 1;
    for (const auto& [name, each] : {std::pair("tDir", size_t(1)), std::pair("tInd", size_t(3))}) {
        const Channel& c = *source.find(name);
        for (size_t k = 0; k < c.values.size(); ++k)
            if (c.values[k] != 0) used = std::max(used, k % c.components / each + 1);
    }
    int degrees = 1;
    while (size_t(degrees * degrees) < used) ++degrees;
    return degrees * degrees;
}

Failure BigsAsset::checkLayout(const SplatAsset& source)
{
    functions = transportFunctionsOf(source);
    const Channel* s = source.find("s");
    sFunctions = s ? bigsScatterFunctions(s->components) : 0;
    scattering = s ? s->rows(asset_.grid.count) : 0;
    hasLobe = source.find("lobe") != nullptr;
    hasForward = source.find("forward") != nullptr;
    hasVisibility = source.find("visibility") != nullptr;
    brightest = brightestOf(source);
    for (const char* name : {"tDir", "tInd", "s"})
        if (const Channel* channel = source.find(name))
            if (Failure f = checkHalfRange(*channel)) return f;
    if (asset_.coded) packed_ = std::make_shared<PackedTransport>(*source.find("tDir"), *source.find("tInd"), functions);
    const Gl& gl = asset_.context.gl;
    if (Failure f = fitLongRow(gl, asset_.grid, "s", scattering, bigsPairCount(sFunctions))) return f;
    return fitLongRow(gl, asset_.grid, "visibility", asset_.grid.count, asset_.visibilitySize * asset_.visibilitySize);
}

void BigsAsset::queueGeometry(const SplatAsset& source, UploadQueue& queue)
{
    const Channel &rho = *source.find("rho"), *shadow = source.find("shadow"), *lobe = source.find("lobe"), *forward = source.find("forward");
    const Gl& gl = asset_.context.gl;
    queueSlot<float>(queue, gl, asset_.grid, asset_.geometry, kRhoShadow, [&rho, shadow](size_t g, float* t) {
        for (int c = 0; c < 3; ++c) t[c] = rho.values[3 * g + size_t(c)];
        t[3] = shadow ? shadow->values[g] : 1.0f;
    });
    if (forward)
        queueSlot<float>(queue, gl, asset_.grid, asset_.geometry, forwardSlot(), [forward](size_t g, float* t) {
            const float* row = &forward->values[kBigsForwardFloats * g];
            std::copy_n(row + 1, 3, t), t[3] = row[0];
        });
    if (!lobe) return;
    queueSlot<float>(queue, gl, asset_.grid, asset_.geometry, kNormalSharpness,
                     [lobe](size_t g, float* t) { std::copy_n(&lobe->values[kBigsLobeFloats * g], 4, t); });
    queueSlot<float>(queue, gl, asset_.grid, asset_.geometry, kLobeColor,
                     [lobe](size_t g, float* t) { std::copy_n(&lobe->values[kBigsLobeFloats * g + 4], 3, t); });
}

void BigsAsset::queuePackedTransport(UploadQueue& queue)
{
    Context& context = asset_.context;
    const std::shared_ptr<const PackedTransport> packed = std::move(packed_);
    transportScale = Texture(context, GL_RGBA32F, functions, 1);
    context.gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, functions, 1, GL_RGBA, GL_FLOAT, packed->units().data());
    for (int i = 0; i < mostSlots(); ++i)
        queueSlot<uint8_t>(queue, context.gl, asset_.grid, transport, i, [packed, i](size_t g, uint8_t* t) { packed->texel(g, i, t); });
}

Failure BigsAsset::upload(const SplatAsset& source, UploadQueue& queue)
{
    Context& context = asset_.context;
    queueGeometry(source, queue);
    const Channel &tDir = *source.find("tDir"), &tInd = *source.find("tInd");
    transport = slotTexture(context, asset_.grid, asset_.coded ? GL_RGBA8 : GL_RGBA16F, mostSlots());
    if (asset_.coded) queuePackedTransport(queue);
    for (int i = 0; i < functions && !asset_.coded; ++i)
        queueSlot<uint16_t>(queue, context.gl, asset_.grid, transport, i, [&tDir, &tInd, i](size_t g, uint16_t* t) {
            const size_t k = g * kBigsTransportFunctions + size_t(i);
            for (size_t c = 0; c < 3; ++c) t[c] = halfFromFloat(tInd.values[3 * k + c]);
            t[3] = halfFromFloat(tDir.values[k]);
        });
    if (const Channel* s = source.find("s"))
        queueLongRow<uint16_t>(queue, context, asset_.grid, scatter, GL_RGBA16F, 4, s->values.size() / 3, [s](size_t t, uint16_t* out) {
            for (size_t c = 0; c < 3; ++c) out[c] = halfFromFloat(s->values[3 * t + c]);
        });
    if (const Channel* maps = source.find("visibility")) queueVisibility(queue, context, asset_.grid, visibility, *maps);
    return {};
}

std::string BigsAsset::defines(bool occluded) const
{
    return define("VISIBILITY_SIZE", asset_.visibilitySize) + define("S_FUNCTIONS", sFunctions) + define("HAS_LOBE", int(hasLobe)) +
           define("TRANSPORT_FUNCTIONS", functions) + define("HAS_FORWARD", int(hasForward)) + define("TRANSPORT_BYTES", int(asset_.coded)) + define("FORWARD_SLOT", forwardSlot()) +
           define("HAS_VISIBILITY", int(hasVisibility)) + define("HAS_OCCLUSION", int(occluded)) + define("HAS_VISIBLE", int(hidesLights(occluded))) +
           define("LOBE_FACING", kBigsLobeFacing) + shaders::kPassGlsl + shaders::kLightGlsl + shaders::kFetchLightGlsl + shaders::kVisibilityMapGlsl +
           shaders::kBigsGlsl;
}

Failure BigsAsset::lightProgram(bool occluded, const Program** program) const
{
    return light_[occluded].find(program, [&](const Program** made) {
        return findProgram(asset_.context, {"light", shaders::kFullscreenVertGlsl, defines(occluded) + shaders::kBigsLightFragGlsl,
                                        {"uGeometry", "uTransport", "uLights", "uVisibility", "uOcclusion", "uTransportScale"}}, made);
    });
}

Failure BigsAsset::viewProgram(const Program** program) const
{
    return view_.find(program, [&](const Program** made) {
        return findProgram(asset_.context, {"view", shaders::kFullscreenVertGlsl, defines(false) + shaders::kBigsViewFragGlsl, {"uGeometry", "uScatter"}}, made);
    });
}

Failure BigsAsset::combineProgram(bool occluded, const Program** program) const
{
    return combine_[occluded].find(program, [&](const Program** made) {
        return findProgram(asset_.context, {"combine", shaders::kFullscreenVertGlsl, defines(occluded) + shaders::kBigsCombineFragGlsl,
                                        {"uGeometry", "uDirect", "uIndirect", "uContracted", "uLights", "uVisible"}}, made);
    });
}

Failure BigsAsset::compileAhead(int)
{
    const Program* program = nullptr;
    if (Failure f = lightProgram(false, &program)) return f;
    if (sFunctions > 0)
        if (Failure f = viewProgram(&program)) return f;
    return combineProgram(false, &program);
}

std::unique_ptr<InstanceModel> BigsAsset::makeInstance(Instance& instance) { return std::make_unique<BigsInstance>(instance, *this); }

// ---- instance

Failure BigsInstance::setEdits(std::span<const SplatEdit> edits)
{
    if (edits.empty()) return {};
    return {NACRE_ERROR_UNSUPPORTED, "an asset of the model 'bigs' has no materials to edit; bake with --model sss"};
}

/// Room for the lights there are; what is there stays.
Failure BigsInstance::growBatches(bool visible)
{
    Context& context = instance_.context;
    const SplatGrid& grid = instance_.asset->grid;
    for (size_t b = 0; int(b) * kBatchLights < instance_.lightCount(); ++b) {
        const int lights = std::min(instance_.lightCount() - int(b) * kBatchLights, kBatchLights), groups = (lights + kLightsPerGroup - 1) / kLightsPerGroup;
        if (b < batches_.size() && batches_[b].direct.height() >= groups * grid.rows && bool(batches_[b].visible) == visible) continue;
        clearHostErrors(context);
        if (b == batches_.size()) batches_.emplace_back();
        LightBatch& batch = batches_[b];
        batch = {};
        for (size_t g = b * kBatchGroups; g < std::min(groups_.size(), (b + 1) * kBatchGroups); ++g) groups_[g] = {};
        batch.direct = slotTexture(context, grid, GL_RGBA32F, groups);
        batch.indirect = slotTexture(context, grid, GL_RGBA32F, groups);
        if (visible) batch.visible = slotTexture(context, grid, GL_RGBA16F, groups);
        batch.framebuffer = Framebuffer(context);
        batch.framebuffer.attach(0, batch.direct), batch.framebuffer.attach(1, batch.indirect);
        if (visible) batch.framebuffer.attach(2, batch.visible);
        batch.framebuffer.drawTo(visible ? 3 : 2);
        if (allocated(context.gl)) continue;
        batches_.resize(b);
        return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(instance_.lightCount()) + " lights on an instance; use fewer"};
    }
    return {};
}

/// `count` groups from `first` on, of one batch.
Failure BigsInstance::runGroups(int first, int count)
{
    const Asset& asset = *instance_.asset;
    const size_t b = size_t(first / kBatchGroups);
    const bool occluded = b < instance_.occlusion.size();
    const Program* program = nullptr;
    if (Failure f = model_.lightProgram(occluded, &program)) return f;
    program->use();
    asset.grid.set(*program);
    asset.geometry.bind(0);
    model_.transport.bind(1);
    instance_.lightTexture.bind(2);
    model_.visibility.bind(3);
    if (occluded) instance_.occlusion[b].bind(4);
    model_.transportScale.bind(5);
    program->set("uFirstLight", int(b) * kBatchLights);
    program->set("uLightCount", instance_.lightCount());
    program->set("uWorldScale2", instance_.worldScale2());
    batches_[b].framebuffer.bind();
    runPass(instance_.context, asset.grid.width, asset.grid.rows * (first % kBatchGroups), asset.grid.rows * count);
    return {};
}

/// Groups whose lights have changed, then those that may not have been drawn.
std::vector<int> BigsInstance::outdatedGroups() const
{
    std::vector<int> groups;
    for (const bool made : {false, true})
        for (int g = 0; g < int(groups_.size()); ++g)
            if (const Group& group = groups_[size_t(g)]; isMade(g) == made && !(made && instance_.context.passes.sure(group.draw))) groups.push_back(g);
    return groups;
}

Failure BigsInstance::relight(RelightBudget& budget, bool* done)
{
    *done = true;
    if (const bool occluded = !instance_.occlusion.empty(); occluded != occluded_) occluded_ = occluded, groups_.clear();
    if (Failure f = growBatches(model_.hidesLights(occluded_))) return f;
    groups_.resize(size_t(instance_.groupCount()));
    if (lights_ != instance_.lightCount()) lights_ = instance_.lightCount(), ++revision_;
    const std::vector<int> outdated = outdatedGroups();
    if (outdated.empty()) return {};

    size_t i = 0;
    for (size_t n = 0; i < outdated.size(); i += n) {
        const int first = outdated[i];
        const auto continues = [&](size_t k) { return i + k < outdated.size() && outdated[i + k] == first + int(k) && (first + int(k)) % kBatchGroups != 0; };
        for (n = 0; (n == 0 || continues(n)) && budget.take(instance_.asset->grid.count);) ++n;
        if (n == 0) break;
        if (Failure f = runGroups(first, int(n))) return f;
        for (int g = first; g < first + int(n); ++g) groups_[size_t(g)] = {instance_.groupRevision(g), instance_.context.passes.now()};
    }
    *done = i == outdated.size() || std::all_of(outdated.begin() + ptrdiff_t(i), outdated.end(), [&](int g) { return isMade(g); });
    ++revision_, ++budget.stats->lightPassesRun;
    return {};
}

std::unique_ptr<ViewModel> BigsInstance::makeView() { return std::make_unique<BigsView>(instance_, model_, *this); }

// ---- view

Failure BigsView::contract(const glm::vec4& camera)
{
    Context& context = instance_.context;
    const SplatGrid& grid = instance_.asset->grid;
    if (!contracted_) {
        clearHostErrors(context);
        contracted_ = Texture(context, GL_RGBA32F, grid.width, model_.contractedRows());
        contractedTarget_ = Framebuffer(context);
        contractedTarget_.attach(0, contracted_);
        if (!allocated(context.gl)) {
            contracted_ = {};
            return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for an instance in one more view"};
        }
    }
    const Program* program = nullptr;
    if (Failure f = model_.viewProgram(&program)) return f;
    program->use();
    grid.set(*program);
    program->set("uCamera", camera);
    program->set("uScattering", int(model_.scattering));
    instance_.asset->geometry.bind(0);
    model_.scatter.bind(1);
    contractedTarget_.bind();
    runPass(context, grid.width, 0, model_.contractedRows());
    contractedFrom_ = camera, contractedIn_ = context.passes.now();
    return {};
}

/// Batches after the first add to what the first has written.
Failure BigsView::combine(const glm::vec4& camera, DrawList& list, const ListRows& rows)
{
    Context& context = instance_.context;
    const Gl& gl = context.gl;
    const Asset& asset = *instance_.asset;
    const std::vector<LightBatch>& batches = lit_.batches();
    const int lights = instance_.lightCount();
    for (int first = 0; first == 0 || first < lights; first += kBatchLights) {
        const size_t b = size_t(first / kBatchLights);
        const bool occluded = b < instance_.occlusion.size();
        const Program* program = nullptr;
        if (Failure f = model_.combineProgram(occluded, &program)) return f;
        program->use();
        asset.grid.set(*program);
        list.set(*program, rows);
        program->set("uCamera", camera);
        program->set("uTint", instance_.tint);
        program->set("uFirstLight", first);
        program->set("uEndLight", std::min(first + kBatchLights, lights));
        program->set("uScattering", int(model_.scattering));
        program->set("uWorldScale2", instance_.worldScale2());
        asset.geometry.bind(0);
        if (b < batches.size()) {
            batches[b].direct.bind(1), batches[b].indirect.bind(2);
            batches[b].visible.bind(5);
        }
        contracted_.bind(3);
        instance_.lightTexture.bind(4);
        list.beginColor();
        if (first > 0) beginAdding(gl);
        runPass(instance_.context, list.width(), rows.first, rows.count);
        if (first > 0) gl.Disable(GL_BLEND);
    }
    return {};
}

Failure BigsView::relight(const InstanceFrame& frame, DrawList& list, const ListRows& rows, RelightBudget& budget, bool* done)
{
    const PassLog& passes = instance_.context.passes;
    const Inputs inputs{frame.camera, lit_.revision(), instance_.looksRevision, list.revision()};
    const bool view = model_.sFunctions > 0 && (contractedFrom_ != frame.camera || !passes.sure(contractedIn_));
    const bool same = inputs.sameAs(combined_, model_.sFunctions > 0 || model_.isSharp()) && passes.sure(combinedIn_);
    *done = same && !view;
    if (*done || !budget.take((1 + uint64_t(view)) * instance_.asset->grid.count)) return {};
    if (view)
        if (Failure f = contract(frame.camera)) return f;
    if (Failure f = combine(frame.camera, list, rows)) return f;
    combined_ = inputs, combinedIn_ = passes.now();
    budget.stats->viewPassesRun += view;
    ++budget.stats->combinePassesRun;
    *done = true;
    return {};
}

/// In a view that shades pixels: no surface.
Failure BigsView::gather(const InstanceFrame&, DrawList& list, const ListRows& rows, std::span<const int>)
{
    Context& context = instance_.context;
    if (clearedList_ == list.attributesRevision() && context.passes.sure(clearedIn_)) return {};
    const Program* program = nullptr;
    if (Failure f = findProgram(context, {"clear", shaders::kFullscreenVertGlsl, shaders::kNothingFragGlsl, {}}, &program)) return f;
    program->use();
    list.beginAttributes(0, 3);
    runPass(context, list.width(), rows.first, rows.count);
    clearedList_ = list.attributesRevision(), clearedIn_ = context.passes.now();
    return {};
}

} // namespace

std::unique_ptr<AssetModel> bigs::makeAssetModel(Asset& asset) { return std::make_unique<BigsAsset>(asset); }

} // namespace nacre
