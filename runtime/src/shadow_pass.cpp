#include "shadow_pass.h"

#include "instance.h"
#include "shader_sources.h"
#include "splat_shadows.h"

#include <algorithm>

namespace nacre {

constexpr int kMostCascades = 8;
constexpr float kMostFootprint = 12; // texels that the radius of a splat counts for: beyond, sixteen taps are too few

/// A sampler of ours: whatever the host compares, filters or repeats.
static void bindPlainSampler(Context& context, GLuint unit)
{
    const Gl& gl = context.gl;
    if (!context.plainSampler) {
        gl.GenSamplers(1, &context.plainSampler);
        gl.SamplerParameteri(context.plainSampler, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
        gl.SamplerParameteri(context.plainSampler, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
        gl.SamplerParameteri(context.plainSampler, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
        gl.SamplerParameteri(context.plainSampler, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    }
    gl.BindSampler(unit, context.plainSampler);
}

/// Whether the texture holds depth: what it gives a framebuffer as such tells. Leaves the framebuffer as it was.
static bool holdsDepth(Context& context, const ShadowMap& map)
{
    const Gl& gl = context.gl;
    GLint ours = 0, bits = 0;
    gl.GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &ours);
    const Framebuffer probe(context);
    if (map.kind == NACRE_SHADOW_MAP_ARRAY) gl.FramebufferTextureLayer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, map.texture, 0, 0);
    else gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, map.kind == NACRE_SHADOW_MAP_CUBE ? GL_TEXTURE_CUBE_MAP_POSITIVE_X : GL_TEXTURE_2D, map.texture, 0);
    gl.GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_FRAMEBUFFER_ATTACHMENT_DEPTH_SIZE, &bits);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(ours));
    return takeGlError(gl) == GL_NO_ERROR && bits > 0;
}

/// The host's texture on kCubeMapUnit, where maps of any kind go.
static Failure bindMap(Context& context, const ShadowMap& map, uint32_t light)
{
    struct Kind {
        GLenum target, binding;
        const char* name;
    };
    static constexpr Kind kKinds[] = {{GL_TEXTURE_2D, GL_TEXTURE_BINDING_2D, "2D texture"},
                                      {GL_TEXTURE_2D_ARRAY, GL_TEXTURE_BINDING_2D_ARRAY, "2D array texture"},
                                      {GL_TEXTURE_CUBE_MAP, GL_TEXTURE_BINDING_CUBE_MAP, "cube map"}};
    const Gl& gl = context.gl;
    const Kind& kind = kKinds[map.kind];
    const std::string which = "the shadow map of light " + std::to_string(light) + ", texture " + std::to_string(map.texture) + ", ";
    if (!gl.IsTexture(map.texture)) return invalid(which + "does not exist in this GL context; set the lights without it before you delete it");
    clearHostErrors(context);
    bindTexture(gl, kCubeMapUnit, kind.target, map.texture);
    GLint bound = 0;
    gl.GetIntegerv(kind.binding, &bound);
    if (takeGlError(gl) != GL_NO_ERROR || GLuint(bound) != map.texture) return invalid(which + "is no " + kind.name + "; set NacreShadowMap.kind to what it is");
    if (!map.distances && !holdsDepth(context, map)) return invalid(which + "holds no depth; use a texture of a GL_DEPTH_COMPONENT or GL_DEPTH_STENCIL format");
    bindPlainSampler(context, kCubeMapUnit);
    return {};
}

/// Textures with room for the lights there are; what is there stays. White: all light arrives.
Failure ShadowPass::grow(Instance& instance)
{
    Context& context = instance.context;
    const SplatGrid& grid = instance.asset->grid;
    for (size_t b = 0; int(b) * kBatchLights < instance.lightCount(); ++b) {
        const size_t first = b * size_t(kBatchLights), end = std::min(first + size_t(kBatchLights), size_t(instance.lightCount()));
        const int rows = int(end - first + kLightsPerGroup - 1) / kLightsPerGroup * grid.rows;
        if (b < instance.occlusion.size() && instance.occlusion[b].height() >= rows) continue;
        clearHostErrors(context);
        if (b == instance.occlusion.size()) instance.occlusion.emplace_back(), framebuffers_.emplace_back();
        instance.occlusion[b] = {};
        instance.occlusion[b] = Texture(context, GL_RGBA8, grid.width, rows);
        framebuffers_[b] = Framebuffer(context);
        framebuffers_[b].attach(0, instance.occlusion[b]);
        if (!allocated(context.gl)) {
            instance.occlusion.resize(b), framebuffers_.resize(b);
            return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for the shadows of " + std::to_string(instance.lightCount()) + " lights on an instance"};
        }
        constexpr float kWhite[4] = {1, 1, 1, 1};
        context.passes.pass();
        context.gl.ClearBufferfv(GL_COLOR, 0, kWhite);
        for (size_t slot = first; slot < end; ++slot) slots_[slot] = {nullptr, 0, context.passes.now()}, instance.touch(slot);
    }
    return {};
}

/// One lane of a slot of four, the program of a kind of map in use.
static void runLane(Context& context, const SplatGrid& grid, size_t slot)
{
    const Gl& gl = context.gl;
    const size_t lane = slot % kLightsPerGroup, group = slot % kBatchLights / kLightsPerGroup;
    gl.ColorMask(lane == 0, lane == 1, lane == 2, lane == 3);
    runPass(context, grid.width, int(group) * grid.rows, grid.rows);
    gl.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

Failure ShadowPass::drawMap(Instance& instance, const ShadowMap& map, size_t slot, size_t light)
{
    Context& context = instance.context;
    const Placement& place = instance.placement;
    const Program* program = nullptr;
    const std::string defines = define("MAP_2D", int(NACRE_SHADOW_MAP_2D)) + define("MAP_CUBE", int(NACRE_SHADOW_MAP_CUBE)) + define("MAP", map.kind) +
                                define("MOST_LAYERS", kMostCascades) + define("MOST_FOOTPRINT", kMostFootprint);
    if (Failure f = findProgram(context, {"shadow", shaders::kFullscreenVertGlsl, defines + shaders::kPassGlsl + shaders::kShadowMapFragGlsl, {"uGeometry", "uMap"}}, &program))
        return f;
    static_assert(kCubeMapUnit == 1, "uMap");
    program->use();
    instance.asset->grid.set(*program);
    instance.model->geometry().bind(0);
    if (Failure f = bindMap(context, map, uint32_t(light))) return f;
    program->set("uWorldScale", float(place.scale));
    program->set("uReversed", int(map.reversed));
    program->set("uBias", map.bias);
    program->set("uSoftness", map.softness);
    if (map.kind == NACRE_SHADOW_MAP_CUBE) {
        program->set("uWorldFromAsset", glm::mat3(place.worldFromAsset));
        program->set("uFromLight", glm::vec3(glm::dvec3(place.worldFromAsset[3]) - map.centre));
        program->set("uNear", map.nearPlane);
        program->set("uFar", map.farPlane);
        program->set("uDistances", int(map.distances));
    } else {
        glm::mat4 clipFromAsset[kMostCascades];
        const int layers = int(map.clipFromWorld.size());
        for (int k = 0; k < layers; ++k) clipFromAsset[k] = glm::mat4(map.clipFromWorld[size_t(k)] * place.worldFromAsset);
        program->set("uClipFromAsset", layers, clipFromAsset);
        program->set("uLayers", layers);
        program->set("uZeroToOne", int(map.zeroToOne));
    }
    runLane(context, instance.asset->grid, slot);
    context.gl.BindSampler(kCubeMapUnit, 0);
    return {};
}

Failure ShadowPass::drawSplats(Instance& instance, const SplatShadow& map, size_t slot)
{
    Context& context = instance.context;
    const Placement& place = instance.placement;
    const ViewFrame& light = map.lamp.frame;
    const Program* program = nullptr;
    if (Failure f = findProgram(context, {"shadow", shaders::kFullscreenVertGlsl, std::string(shaders::kPassGlsl) + shaders::kSplatShadowLookupFragGlsl, {"uGeometry", "uMap"}}, &program))
        return f;
    program->use();
    instance.asset->grid.set(*program);
    instance.model->geometry().bind(0);
    map.transmittance.bind(1);
    program->set("uClipFromAsset", glm::mat4(glm::dmat4(light.clipFromView) * light.viewFromWorld * place.worldFromAsset));
    program->set("uWorldFromAsset", glm::mat3(place.worldFromAsset));
    program->set("uFromLight", glm::vec3(glm::dvec3(place.worldFromAsset[3]) - light.eye));
    program->set("uTowardsLight", glm::vec4(light.towardsEye, light.orthographic ? 1 : 0));
    program->set("uFirstPlane", map.lamp.firstPlane);
    program->set("uPlaneStep", map.lamp.planeStep);
    runLane(context, instance.asset->grid, slot);
    return {};
}

Failure ShadowPass::write(Instance& instance, size_t slot, const Slot& from)
{
    Context& context = instance.context;
    const uint32_t light = context.lights.points()[instance.lights.point[slot]].source;
    framebuffers_[slot / kBatchLights].bind();
    if (from.map)
        if (Failure f = drawMap(instance, *from.map, slot, light)) return f;
    if (from.splats > 0) {
        if (from.map) beginMultiplying(context.gl, GL_SRC_COLOR, GL_SRC_ALPHA);
        if (Failure f = drawSplats(instance, *context.splatShadows->find(instance, light), slot)) return f;
        context.gl.Disable(GL_BLEND);
    }
    if (!from.shades()) {
        const Program* program = nullptr;
        if (Failure f = findProgram(context, {"white", shaders::kFullscreenVertGlsl, shaders::kWhiteFragGlsl, {}}, &program)) return f;
        program->use();
        runLane(context, instance.asset->grid, slot);
    }
    slots_[slot] = from, slots_[slot].draw = context.passes.now();
    instance.touch(slot);
    return {};
}

Failure ShadowPass::run(Instance& instance, NacreDrawStats& stats)
{
    const Context& context = instance.context;
    std::vector<Slot> wanted;
    bool mayShade = false, shades = false;
    for (const uint32_t p : instance.lights.point) {
        const LightPoint& point = context.lights.points()[p];
        const SplatShadow* splats = point.flags & NACRE_LIGHT_SPLAT_SHADOWS ? context.splatShadows->find(instance, point.source) : nullptr;
        wanted.push_back({point.shadowMap, splats ? splats->revision : 0, 0});
        mayShade = mayShade || point.shadowed, shades = shades || wanted.back().shades();
    }
    if (!shades && !(mayShade && !instance.occlusion.empty())) { // it comes with the first shadow and goes with the last light that casts any
        stats.shadowsSkipped += uint32_t(wanted.size());
        if (!slots_.empty()) *this = {}, instance.occlusion.clear();
        return {};
    }
    slots_.resize(wanted.size());
    if (Failure f = grow(instance)) return f;
    const bool moved = instance.placement.worldFromAsset != worldFromAsset_;
    for (size_t s = 0; s < wanted.size(); ++s) {
        if (slots_[s].isMadeFrom(wanted[s]) && !(moved && wanted[s].shades()) && context.passes.sure(slots_[s].draw)) {
            ++stats.shadowsSkipped;
            continue;
        }
        if (Failure f = write(instance, s, wanted[s])) return f;
        ++stats.shadowPassesRun;
    }
    worldFromAsset_ = instance.placement.worldFromAsset;
    return {};
}

} // namespace nacre
