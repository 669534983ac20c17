#include "gbuffer.h"

#include "appearance/sss/sss.h"
#include "base/half.h"
#include "host_depth.h"
#include "shader_sources.h"
#include "target.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre {

constexpr int kSurfaceLayers = 5;
constexpr int kFurtherLights = 3 * kMostLayers;

static int lightsBesideDepth(bool mixed) { return mixed ? 1 : 2; }
static int mostFirstLights(bool mixed) { return lightsBesideDepth(mixed) + 3 * (kMostLayers - kSurfaceLayers); }
static int layersFor(int lights, bool mixed) { return kSurfaceLayers + (std::max(lights - lightsBesideDepth(mixed), 0) + 2) / 3; }
static int furtherLayersFor(int lights) { return (lights + 2) / 3; }

Failure Gbuffer::splatProgram(const Pass& pass, const Program** program)
{
    return splat_[pass.extra][pass.mixed][pass.firstLayer][pass.layers].find(program, [&](const Program** made) { return findSplatProgram(pass, made); });
}

Failure Gbuffer::findSplatProgram(const Pass& pass, const Program** program)
{
    const std::string defines = define("LAYERS", pass.layers) + define("FIRST_LAYER", pass.firstLayer) + define("EXTRA", int(pass.extra)) + define("MIXED", int(pass.mixed));
    return findProgram(context_, {"G-buffer", defines + shaders::kListGlsl + shaders::kSssGbufferVertGlsl, defines + shaders::kEachLayerGlsl + shaders::kSssGbufferFragGlsl,
                                  {"uProjected0", "uProjected1", "uOrder", "uColor", "uAttributes"}}, program);
}

Failure Gbuffer::resolveProgram(bool extra, bool mixed, int layers, const Program** program)
{
    return resolve_[extra][mixed][layers].find(program, [&](const Program** made) { return findResolveProgram(extra, mixed, layers, made); });
}

/// By the most lights of its layers, not by those that are there: few programs.
Failure Gbuffer::findResolveProgram(bool extra, bool mixed, int layers, const Program** program)
{
    const int lights = extra ? 3 * layers : lightsBesideDepth(mixed) + 3 * (layers - kSurfaceLayers);
    const std::string defines = define("EXTRA", int(extra)) + define("MIXED", int(mixed)) + define("LIGHTS", lights) + define("MIN_ROUGHNESS", kSssMinRoughness) +
                                define("DIELECTRIC_F0", kSssDielectricF0) + define("MIN_PIXEL_ALPHA", kSssMinAlpha) + define("MIN_NORMAL", kSssMinLength);
    return findProgram(context_, {"resolve", shaders::kFullscreenVertGlsl,
                                  defines + shaders::kLightGlsl + shaders::kFetchLightGlsl + shaders::kSssGlsl + shaders::kSssResolveFragGlsl,
                                  {"uLayers", "uDepthLayer", "uFurther", "uLights"}}, program);
}

Failure Gbuffer::composeProgram(const Program** program)
{
    return findProgram(context_, {"compose", shaders::kFullscreenVertGlsl, shaders::kSssComposeFragGlsl, {"uSum"}}, program);
}

Failure Gbuffer::compileAhead(int mostLights, bool mixed)
{
    const Program* program = nullptr;
    const int most = context_.gl.maxLayers();
    const auto compile = [&](bool extra, int layers) -> Failure {
        for (int first = 0; first < layers; first += most)
            if (Failure f = splatProgram({extra, mixed, first, std::min(most, layers - first)}, &program)) return f;
        return resolveProgram(extra, mixed, layers, &program);
    };
    for (int layers = kSurfaceLayers; layers <= layersFor(std::min(mostLights, mostFirstLights(mixed)), mixed); ++layers)
        if (Failure f = compile(false, layers)) return f;
    for (int layers = 1; layers <= furtherLayersFor(std::min(mostLights - mostFirstLights(mixed), kFurtherLights)); ++layers)
        if (Failure f = compile(true, layers)) return f;
    return mostLights > mostFirstLights(mixed) ? composeProgram(&program) : Failure{};
}

/// Exactly this size, as a host's window keeps its own; more layers than asked for stay, and so do finer ones. No depth: format 0.
Failure Gbuffer::grow(Target& t, GLenum format, GLenum depthFormat, int width, int height, int layers)
{
    const auto holds = [&](const Texture& texture, GLenum wanted) {
        return texture && texture.width() == width && texture.height() == height && (texture.format() == wanted || texture.format() == GL_RGBA32F);
    };
    if (holds(t.layers, format) && t.layers.layers() >= layers && (!depthFormat || holds(t.depth, depthFormat))) return {};
    clearHostErrors(context_);
    t = {};
    t.layers = Texture(context_, format, width, height, layers);
    if (depthFormat) t.depth = Texture(context_, depthFormat, width, height);
    t.framebuffer = Framebuffer(context_);
    t.framebuffer.attach(0, t.layers);
    const bool good = allocated(context_.gl);
    if (depthFormat) t.framebuffer.attach(0, t.depth);
    if (good && allocated(context_.gl)) return {};
    t = {};
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(layers) + " layers of " + std::to_string(width) + " x " +
                                           std::to_string(height) + " pixels; draw into a smaller viewport"};
}

/// Binds layers first, first + 1, ... for drawing. Layer 4 of a surface is the depth texture, and the array goes on behind it.
void Gbuffer::attach(const Target& t, int first, int count, bool extra) const
{
    t.framebuffer.bind();
    for (int k = 0; k < context_.gl.maxLayers(); ++k) {
        const int layer = first + k;
        if (k >= count) context_.gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0 + GLenum(k), GL_TEXTURE_2D, 0, 0);
        else if (!extra && layer == kSurfaceLayers - 1) t.framebuffer.attach(k, t.depth);
        else t.framebuffer.attach(k, t.layers, !extra && layer >= kSurfaceLayers ? layer - 1 : layer);
    }
    t.framebuffer.drawTo(count);
}

static void clear(const Gl& gl, int layers)
{
    const float nothing[4] = {0, 0, 0, 0};
    for (int k = 0; k < layers; ++k) gl.ClearBufferfv(GL_COLOR, k, nothing);
}

Failure Gbuffer::blend(const GbufferInput& in, Target& target, bool extra, int layers, int firstLight, GlStateGuard& state)
{
    const Gl& gl = context_.gl;
    for (int first = 0; first < layers; first += gl.maxLayers()) {
        const int count = std::min(gl.maxLayers(), layers - first);
        const Program* program = nullptr;
        if (Failure f = splatProgram({extra, in.mixed, first, count}, &program)) return f;
        state.beginOffscreen(in.depthTest);
        attach(target, first, count, extra);
        clear(gl, count);
        if (in.depthTest)
            if (Failure f = attachHostDepth(context_, state.hostFramebuffer(), target.framebuffer.name(), state.viewport())) return f;
        program->use();
        in.list.projected0.bind(0), in.list.projected1.bind(1), in.list.order.bind(2), in.list.color.bind(3), in.list.attributes.bind(4);
        program->set("uListWidth", in.list.width());
        program->set("uViewport", in.frame.viewport);
        program->set("uDepthOrigin", depthOrigin_);
        program->set("uDepthUnit", depthUnit_);
        program->set("uLayerMax", target.layers.format() == GL_RGBA32F ? std::numeric_limits<float>::max() : kMaxHalf);
        program->set("uFirstLight", firstLight);
        program->set("uLightCount", int(in.lights.points.size()));
        gl.DrawElements(GL_TRIANGLES, GLsizei(6 * in.splats), GL_UNSIGNED_INT, nullptr);
        if (in.depthTest) detachHostDepth(gl);
    }
    return {};
}

Failure Gbuffer::resolve(const GbufferInput& in, bool extra, int layers, int firstLight, const float viewport[4], float maxColor)
{
    const Gl& gl = context_.gl;
    const Program* program = nullptr;
    if (Failure f = resolveProgram(extra, in.mixed, layers, &program)) return f;
    program->use();
    first_.layers.bind(0), first_.depth.bind(1), further_.layers.bind(2), lights_.bind(3);
    const WindowRays rays = windowRays(in.frame, viewport);
    program->set("uOrigin", rays.origin), program->set("uOriginRight", rays.originRight), program->set("uOriginUp", rays.originUp);
    program->set("uRay", rays.ray), program->set("uRayRight", rays.rayRight), program->set("uRayUp", rays.rayUp);
    program->set("uDepthOrigin", depthOrigin_);
    program->set("uDepthUnit", depthUnit_);
    program->set("uMaxColor", maxColor);
    program->set("uFirstLight", firstLight);
    program->set("uLightCount", int(in.lights.points.size()));
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
    return {};
}

/// Depth is stored relative to the middle of what is shaded, in about its size: half floats are finest around zero, and err by 2^-12 of
/// it. Where that is much beside the smallest object, a light near it would see it in steps, and the depth is float.
static bool isDeep(const GbufferInput& in)
{
    constexpr float kDeep = 8;
    const glm::vec3 size = in.high - in.low;
    return std::max({size.x, size.y, size.z}) > kDeep * in.smallest;
}

Failure Gbuffer::draw(const GbufferInput& in, GlStateGuard& state)
{
    const Gl& gl = context_.gl;
    const float* viewport = state.viewport(); // the layers lie under the host's pixels, so that its depth buffer fits
    const int width = int(std::max(viewport[0], 0.0f) + viewport[2]), height = int(std::max(viewport[1], 0.0f) + viewport[3]);
    const glm::vec3 size = in.high - in.low, middle = 0.5f * (in.low + in.high);
    depthOrigin_ = in.frame.orthographic ? -glm::dot(glm::vec3(in.frame.towardsEye), middle) : glm::length(middle);
    const float exponent = std::round(std::log2(std::max({size.x, size.y, size.z, std::numeric_limits<float>::min()})));
    depthUnit_ = std::exp2(std::clamp(exponent, -100.0f, 100.0f)); // a power of two: dividing rounds nothing
    const int lights = int(in.lights.points.size()), mostFirst = mostFirstLights(in.mixed);
    const bool sums = lights > mostFirst;
    const size_t columns = in.lights.packed.size();
    if (columns > size_t(lights_.width())) lights_ = Texture(context_, GL_RGBA32F, int((columns + 15) / 16 * 16), kLightRows);
    uploadLights(gl, lights_, in.lights.packed, 0, columns);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, state.hostFramebuffer());
    const float maxColor = largestColor(gl);
    const bool fine = gl.floatBlend; // else half floats are all there is
    const bool precise = in.bright || in.mixed; // colours of bigs are blended as precisely as they would be in the host's target
    const GLenum format = fine && maxColor > kMaxHalf && precise ? GL_RGBA32F : GL_RGBA16F, depthFormat = fine && isDeep(in) ? GL_RGBA32F : GL_RGBA16F;
    if (sums) {
        if (Failure f = grow(summed_, fine ? GL_RGBA32F : GL_RGBA16F, 0, width, height, 1)) return f;
        attach(summed_, 0, 1, true);
        state.beginOffscreen(false);
        clear(gl, 1);
    }
    for (int first = 0; first == 0 || first < lights;) {
        const bool extra = first > 0;
        const int now = std::min(lights - first, extra ? kFurtherLights : mostFirst), layers = extra ? furtherLayersFor(now) : layersFor(now, in.mixed);
        Target& target = extra ? further_ : first_;
        if (Failure f = extra ? grow(target, GL_RGBA16F, 0, width, height, layers) : grow(target, format, depthFormat, width, height, layers - 1)) return f;
        if (Failure f = blend(in, target, extra, layers, first, state)) return f;
        if (sums) {
            state.beginOffscreen(false);
            attach(summed_, 0, 1, true);
            if (Failure f = resolve(in, extra, layers, first, viewport, fine ? std::numeric_limits<float>::max() : kMaxHalf)) return f;
        } else {
            state.beginDraw(false);
            if (Failure f = resolve(in, extra, layers, first, viewport, maxColor)) return f;
        }
        first += std::max(now, 1);
    }
    if (!sums) return {};
    const Program* compose = nullptr;
    if (Failure f = composeProgram(&compose)) return f;
    state.beginDraw(false);
    compose->use();
    summed_.layers.bind(0);
    compose->set("uMaxColor", maxColor);
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
    return {};
}

} // namespace nacre
