// bigs on the GPU. Radiance of every splat towards the camera, in three passes over small float textures (bigs.h has the equation):
//   light    direct_t = falloff v_t max(T_dir, 0), v_t and sum_t I falloff max(T_ind, 0)                   depends on lights
//   view     a_i = sum_j c_ij y_j(w_o)                                                                     depends on the camera position
//   combine  indirect + sum_t I_t (direct_t max(rho + sum_i a_i y_i(w_t), 0) + falloff v_t k lobe_t(w_o))  depends on both
// All of it in asset space. Without s there is no view pass; without s and lobe nothing depends on the camera. Each pass runs only when
// its inputs differ in any bit from those of its last run.
//
// Textures beyond those of every model:
//   geometry    slots: rho+shadow; with a lobe also normal+sharpness, k
//   transport   RGBA16F  25 slots: T_ind rgb, T_dir
//   scatter     RGBA16F  array, texel g * pairs + pair(i, j): c_ij rgb (all of a splat together: the view pass reads it 25 times)
//   visibility  R8       array, texel (g * n + j) * n + i of the octahedral maps of n x n
//   direct, indirect     RGBA32F  light pass: one slot per four lights
//   visible     RGBA16F  light pass: v of four lights per slot, for the lobe (v comes from bytes: half floats lose nothing of it)
//   contracted  RGBA32F  view pass: every grid row of splats with s becomes one row per function of s
//   color       RGBA32F  combine pass: radiance towards the camera
// scatter and contracted exist only with s, visibility only with that channel, visible only with lobe and visibility.
// Coefficients of SH are stored as half floats (relative error at most 2^-11), the lobe as float (half a normal would shift a sharp
// highlight by a percent of its width), visibility as the bytes of the file.
#include "appearance/bigs/bigs.h"
#include "base/half.h"
#include "gl_state.h"
#include "program.h"
#include "shader_sources.h"
#include "textures.h"

namespace nacre {

namespace {

enum BigsPass { kLightPass, kViewPass, kCombinePass };
enum BigsSlot { kRhoShadow = kCommonSlots, kNormalSharpness, kLobeColor, kBigsSlots };

class GpuBigs final : public GpuModel {
public:
    using GpuModel::GpuModel;
    ~GpuBigs() override;
    Failure checkLayout(const SplatAsset& source) override;
    int mostSlots() const override { return kBigsTransportFunctions; } // as many as s has functions at most
    int geometrySlots() const override { return (hasLobe_ ? int(kBigsSlots) : int(kNormalSharpness)) - int(kCommonSlots); }
    Failure upload(const SplatAsset& source) override;
    Failure compilePrograms() override;
    Failure compileAhead(int) override { return {}; } // one set for any lights
    Failure setEdits(std::span<const SplatEdit> edits) override;
    Failure relight(const DrawFrame& frame, bool lightsChanged) override;
    Failure raster(const DrawFrame& frame, bool depthTest, GlStateGuard& state) override;

private:
    const Gl& gl() const { return asset_.context->gl; }
    void uploadGeometry(const Channel& rho, const Channel* shadow, const Channel* lobe) const;
    void uploadTransport(const Channel& tDir, const Channel& tInd);
    void uploadScatter(const Channel& s);
    int contractedRows() const { return sFunctions_ * int((scattering_ + size_t(asset_.width) - 1) / size_t(asset_.width)); }
    Failure createTargets();
    void freeLightTargets();
    Failure growLightTargets(int groups);
    void runLightPass() const;
    void runViewPass(const glm::vec3& camera) const;
    void runCombinePass(const glm::vec3& camera) const;

    int sFunctions_ = 0;
    size_t scattering_ = 0;     // so many splats, the first, have s
    bool hasLobe_ = false, hasVisibility_ = false;
    GLuint transport_ = 0, scatter_ = 0, visibility_ = 0, contracted_ = 0, direct_ = 0, indirect_ = 0, visible_ = 0, color_ = 0;
    GLuint lightFramebuffer_ = 0, viewFramebuffer_ = 0, combineFramebuffer_ = 0;
    Program lightPass_, viewPass_, combinePass_, splatProgram_;
    glm::vec3 seenFrom_{0};     // camera of the last view and combine pass
    int groupCapacity_ = 0;     // slots of direct, indirect and visible
    bool seen_ = false;
};

GpuBigs::~GpuBigs()
{
    const GLuint textures[] = {transport_, scatter_, visibility_, contracted_, direct_, indirect_, visible_, color_}; // GL ignores 0
    const GLuint framebuffers[] = {lightFramebuffer_, viewFramebuffer_, combineFramebuffer_};
    gl().DeleteFramebuffers(GLsizei(std::size(framebuffers)), framebuffers);
    gl().DeleteTextures(GLsizei(std::size(textures)), textures);
    for (const Program* p : {&lightPass_, &viewPass_, &combinePass_, &splatProgram_}) gl().DeleteProgram(p->name);
}

Failure GpuBigs::checkLayout(const SplatAsset& source)
{
    const Channel* s = source.find("s");
    sFunctions_ = s ? bigsScatterFunctions(s->components) : 0;
    scattering_ = s ? s->rows(asset_.count) : 0;
    hasLobe_ = source.find("lobe") != nullptr;
    hasVisibility_ = source.find("visibility") != nullptr;
    for (const char* name : {"tDir", "tInd", "s"})
        if (const Channel* channel = source.find(name))
            if (Failure f = checkHalfRange(*channel)) return f;
    if (Failure f = fitLongRow(asset_, "s", scattering_, bigsPairCount(sFunctions_))) return f;
    return fitLongRow(asset_, "visibility", asset_.count, asset_.visibilitySize * asset_.visibilitySize);
}

void GpuBigs::uploadGeometry(const Channel& rho, const Channel* shadow, const Channel* lobe) const
{
    std::vector<float> staging;
    uploadSlot(asset_, staging, kRhoShadow, [&](size_t g, float* t) {
        for (int c = 0; c < 3; ++c) t[c] = rho.values[3 * g + size_t(c)];
        t[3] = shadow ? shadow->values[g] : 1.0f;
    });
    if (!lobe) return;
    uploadSlot(asset_, staging, kNormalSharpness, [&](size_t g, float* t) { std::copy_n(&lobe->values[kBigsLobeFloats * g], 4, t); });
    uploadSlot(asset_, staging, kLobeColor, [&](size_t g, float* t) { std::copy_n(&lobe->values[kBigsLobeFloats * g + 4], 3, t); });
}

void GpuBigs::uploadTransport(const Channel& tDir, const Channel& tInd)
{
    std::vector<uint16_t> staging;
    transport_ = createSlotTexture(asset_, GL_RGBA16F, kBigsTransportFunctions);
    for (int i = 0; i < kBigsTransportFunctions; ++i)
        uploadSlot(asset_, staging, i, [&](size_t g, uint16_t* t) {
            const size_t k = g * kBigsTransportFunctions + size_t(i);
            for (size_t c = 0; c < 3; ++c) t[c] = halfFromFloat(tInd.values[3 * k + c]);
            t[3] = halfFromFloat(tDir.values[k]);
        });
}

void GpuBigs::uploadScatter(const Channel& s)
{
    const TexelFormat<uint16_t> halves{GL_RGBA16F, GL_RGBA, GL_HALF_FLOAT, 4};
    uploadLongRow(asset_, scatter_, halves, s.values.size() / 3, [&](size_t t, uint16_t* out) {
        for (size_t c = 0; c < 3; ++c) out[c] = halfFromFloat(s.values[3 * t + c]);
    });
}

Failure GpuBigs::createTargets()
{
    color_ = createSlotTexture(asset_, GL_RGBA32F, 1);
    combineFramebuffer_ = createTarget(gl(), color_);
    bool complete = gl().CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    if (sFunctions_ > 0) {
        contracted_ = createRowTexture(asset_, GL_RGBA32F, contractedRows());
        viewFramebuffer_ = createTarget(gl(), contracted_);
        complete = complete && gl().CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    }
    if (!complete) return {NACRE_ERROR_GL, "this GPU cannot render into RGBA32F textures, which relighting needs"};
    gl().GenFramebuffers(1, &lightFramebuffer_); // its textures are made when the number of lights is known
    return {};
}

Failure GpuBigs::upload(const SplatAsset& source)
{
    const Channel *s = source.find("s"), *visibility = source.find("visibility");
    uploadGeometry(*source.find("rho"), source.find("shadow"), source.find("lobe"));
    uploadTransport(*source.find("tDir"), *source.find("tInd"));
    if (s) uploadScatter(*s);
    if (visibility) uploadVisibility(asset_, visibility_, *visibility);
    return createTargets();
}

Failure GpuBigs::compilePrograms()
{
    const std::string common = commonDefines(asset_) + define("S_FUNCTIONS", sFunctions_) + define("S_SPLATS", int(scattering_)) + define("HAS_LOBE", int(hasLobe_)) +
                               define("HAS_VISIBILITY", int(hasVisibility_)) + define("LOBE_FACING", kBigsLobeFacing);
    const std::string fullscreen = common + shaders::kFullscreenVertGlsl;
    const std::string pass = common + shaders::kPassGlsl + shaders::kLightGlsl + shaders::kVisibilityMapGlsl + shaders::kBigsGlsl;
    if (Failure f = compile(gl(), "light", fullscreen, pass + shaders::kBigsLightFragGlsl, {"uGeometry", "uTransport", "uLights", "uVisibility"}, &lightPass_))
        return f;
    if (sFunctions_ > 0)
        if (Failure f = compile(gl(), "view", fullscreen, pass + shaders::kBigsViewFragGlsl, {"uGeometry", "uScatter"}, &viewPass_)) return f;
    if (Failure f = compile(gl(), "combine", fullscreen, pass + shaders::kBigsCombineFragGlsl,
                            {"uGeometry", "uDirect", "uIndirect", "uContracted", "uLights", "uVisible"}, &combinePass_))
        return f;
    return compile(gl(), "splat", common + shaders::kProjectGlsl + shaders::kSplatVertGlsl, common + shaders::kSplatFragGlsl, {"uGeometry", "uColor", "uOrder"},
                   &splatProgram_);
}

void GpuBigs::freeLightTargets()
{
    const GLuint old[] = {direct_, indirect_, visible_};
    gl().DeleteTextures(3, old);
    const uint64_t texelBytes = 2 * 16 + (visible_ ? 8 : 0);
    asset_.gpuBytes -= texelBytes * uint64_t(groupCapacity_) * uint64_t(asset_.width) * uint64_t(asset_.rows);
    direct_ = indirect_ = visible_ = 0;
    groupCapacity_ = 0;
}

/// Room for `groups` groups of four lights.
Failure GpuBigs::growLightTargets(int groups)
{
    if (groups <= groupCapacity_) return {};
    clearHostErrors(*asset_.context);
    gl().BindFramebuffer(GL_DRAW_FRAMEBUFFER, lightFramebuffer_); // deletion detaches, and so frees, only while bound
    freeLightTargets();
    groupCapacity_ = groups;
    direct_ = createSlotTexture(asset_, GL_RGBA32F, groups);
    indirect_ = createSlotTexture(asset_, GL_RGBA32F, groups);
    if (hasLobe_ && hasVisibility_) visible_ = createSlotTexture(asset_, GL_RGBA16F, groups);
    const GLuint targets[] = {direct_, indirect_, visible_};
    const GLenum attachments[] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1, GL_COLOR_ATTACHMENT2};
    const int count = visible_ ? 3 : 2;
    for (int i = 0; i < count; ++i) gl().FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, attachments[i], GL_TEXTURE_2D, targets[i], 0);
    gl().DrawBuffers(count, attachments);
    if (allocated(gl())) return {};
    freeLightTargets();
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(4 * groups) + " lights; use fewer"};
}

void GpuBigs::runLightPass() const
{
    if (asset_.packed.count == 0) return;
    gl().UseProgram(lightPass_.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    bindTexture(gl(), 1, GL_TEXTURE_2D, transport_);
    bindTexture(gl(), 2, GL_TEXTURE_2D, asset_.lights);
    if (hasVisibility_) bindTexture(gl(), 3, GL_TEXTURE_2D_ARRAY, visibility_);
    gl().Uniform1i(lightPass_.lightCount, asset_.packed.count);
    gl().Uniform1f(lightPass_.worldScale2, asset_.packed.worldScale2);
    runPass(asset_, lightFramebuffer_, asset_.rows * ((asset_.packed.count + 3) / 4));
}

void GpuBigs::runViewPass(const glm::vec3& camera) const
{
    gl().UseProgram(viewPass_.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    bindTexture(gl(), 1, GL_TEXTURE_2D_ARRAY, scatter_);
    gl().Uniform3f(viewPass_.cameraAsset, camera.x, camera.y, camera.z);
    runPass(asset_, viewFramebuffer_, contractedRows());
}

void GpuBigs::runCombinePass(const glm::vec3& camera) const
{
    gl().UseProgram(combinePass_.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    bindTexture(gl(), 1, GL_TEXTURE_2D, direct_);
    bindTexture(gl(), 2, GL_TEXTURE_2D, indirect_);
    bindTexture(gl(), 3, GL_TEXTURE_2D, contracted_);
    bindTexture(gl(), 4, GL_TEXTURE_2D, asset_.lights);
    if (visible_) bindTexture(gl(), 5, GL_TEXTURE_2D, visible_);
    gl().Uniform1i(combinePass_.lightCount, asset_.packed.count);
    gl().Uniform1f(combinePass_.worldScale2, asset_.packed.worldScale2);
    gl().Uniform3f(combinePass_.cameraAsset, camera.x, camera.y, camera.z);
    runPass(asset_, combineFramebuffer_, asset_.rows);
}

Failure GpuBigs::setEdits(std::span<const SplatEdit> edits)
{
    if (edits.empty()) return {};
    return {NACRE_ERROR_UNSUPPORTED, "an asset of the model 'bigs' has no materials to edit; bake with --model sss"};
}

Failure GpuBigs::relight(const DrawFrame& frame, bool lightsChanged)
{
    const bool viewChanged = (sFunctions_ > 0 || hasLobe_) && (!seen_ || seenFrom_ != frame.cameraAsset);
    if (lightsChanged)
        if (Failure f = growLightTargets((asset_.packed.count + 3) / 4)) return f;
    kept_.update();
    if (lightsChanged) kept_.outdate(kLightPass);
    if (viewChanged) kept_.outdate(kViewPass);
    if (lightsChanged || viewChanged) kept_.outdate(kCombinePass);
    seenFrom_ = frame.cameraAsset;
    seen_ = true;
    const bool light = !kept_.has(kLightPass), view = sFunctions_ > 0 && !kept_.has(kViewPass), combine = light || view || !kept_.has(kCombinePass);
    if (combine) {
        kept_.begin();
        if (light) runLightPass();
        if (view) runViewPass(frame.cameraAsset);
        runCombinePass(frame.cameraAsset);
        kept_.end(1u << kCombinePass | unsigned(light) << kLightPass | unsigned(view) << kViewPass);
    }
    asset_.stats.lightPassesRun = light;
    asset_.stats.viewPassesRun = view;
    asset_.stats.combinePassesRun = combine;
    return {};
}

Failure GpuBigs::raster(const DrawFrame& frame, bool depthTest, GlStateGuard& state)
{
    state.beginDraw(depthTest);
    gl().UseProgram(splatProgram_.name);
    bindTexture(gl(), 0, GL_TEXTURE_2D, asset_.geometry);
    bindTexture(gl(), 1, GL_TEXTURE_2D, color_);
    bindTexture(gl(), 2, GL_TEXTURE_2D, asset_.order);
    setSplatUniforms(asset_, splatProgram_, frame);
    gl().Uniform1f(splatProgram_.maxColor, largestColor(gl()));
    drawQuads(asset_);
    return {};
}

} // namespace

std::unique_ptr<GpuModel> bigs::makeGpuModel(NacreAssetImpl& asset) { return std::make_unique<GpuBigs>(asset); }

} // namespace nacre
