#include "program.h"

#include "appearance/visibility_map.h"
#include "base/text.h"
#include "shader_sources.h"
#include "splats/blend.h"

#include <utility>

namespace nacre {

std::string define(const char* name, int value) { return std::string("#define ") + name + ' ' + std::to_string(value) + '\n'; }

std::string define(const char* name, float value)
{
    std::string text = numberText(value);
    if (text.find_first_of(".e") == std::string::npos) text += ".0"; // 4 must not become an int
    return std::string("#define ") + name + ' ' + text + '\n';
}

std::string commonDefines(const NacreAssetImpl& asset, int glslVersion)
{
    return "#version " + std::to_string(glslVersion) + " core\n" + define("WIDTH", asset.width) + define("ROWS", asset.rows) +
           define("ROW_SHIFT", asset.rowShift) + define("VISIBILITY_SIZE", asset.visibilitySize) + define("VISIBILITY_SLOPE", kVisibilitySlope) +
           define("MIN_ALPHA", kMinAlpha) + define("MAX_ALPHA", kMaxAlpha) + shaders::kLayoutGlsl;
}

static std::string firstLine(const std::string& log) { return log.substr(0, log.find('\n')); }

static GLuint compileStage(const Gl& gl, GLenum stage, const std::string& source, std::string* log)
{
    const GLuint shader = gl.CreateShader(stage);
    const char* text = source.c_str();
    gl.ShaderSource(shader, 1, &text, nullptr);
    gl.CompileShader(shader);
    GLint good = 0;
    gl.GetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (good) return shader;
    char buffer[512] = "";
    gl.GetShaderInfoLog(shader, sizeof buffer, nullptr, buffer);
    *log = buffer;
    gl.DeleteShader(shader);
    return 0;
}

namespace {
struct Stage {
    GLenum kind;
    const std::string& source;
};
} // namespace

static Failure link(const Gl& gl, const char* what, std::initializer_list<Stage> stages, std::initializer_list<const char*> samplers, Program* p)
{
    std::string log;
    GLint good = 1;
    p->name = gl.CreateProgram();
    for (const Stage& stage : stages) {
        const GLuint shader = good ? compileStage(gl, stage.kind, stage.source, &log) : 0;
        good = shader != 0;
        if (good) gl.AttachShader(p->name, shader);
        gl.DeleteShader(shader); // goes with the program
    }
    if (good) {
        gl.LinkProgram(p->name);
        gl.GetProgramiv(p->name, GL_LINK_STATUS, &good);
        char buffer[512] = "";
        if (!good) gl.GetProgramInfoLog(p->name, sizeof buffer, nullptr, buffer), log = buffer;
    }
    if (!good) {
        gl.DeleteProgram(std::exchange(p->name, 0));
        return {NACRE_ERROR_GL, std::string("the ") + what + " program failed to compile: " + firstLine(log)};
    }

    const auto at = [&](const char* uniform) { return gl.GetUniformLocation(p->name, uniform); };
    p->lightCount = at("uLightCount");
    p->worldScale2 = at("uWorldScale2");
    p->cameraAsset = at("uCameraAsset");
    p->viewFromAsset = at("uViewFromAsset");
    p->viewTranslation = at("uViewTranslation");
    p->clipFromView = at("uClipFromView");
    p->viewport = at("uViewport");
    p->jacobianLimit = at("uJacobianLimit");
    p->nearW = at("uNear");
    p->nearPlane = at("uNearPlane");
    p->lowPass = at("uLowPass");
    p->maxColor = at("uMaxColor");
    p->firstLight = at("uFirstLight");
    p->lanes = at("uLanes");
    p->oneLoop = at("uOneLoop");
    p->depthOrigin = at("uDepthOrigin");
    p->depthUnit = at("uDepthUnit");
    p->layerMax = at("uLayerMax");
    p->eye = at("uEye");
    p->rayOrigin = at("uRayOrigin");
    p->rayRight = at("uRayRight");
    p->rayUp = at("uRayUp");
    p->inverseSize = at("uInverseSize");
    gl.UseProgram(p->name);
    int unit = 0;
    for (const char* sampler : samplers) gl.Uniform1i(at(sampler), unit++);
    return {};
}

Failure compile(const Gl& gl, const char* what, const std::string& vertexSource, const std::string& fragmentSource,
                std::initializer_list<const char*> samplers, Program* program)
{
    return link(gl, what, {{GL_VERTEX_SHADER, vertexSource}, {GL_FRAGMENT_SHADER, fragmentSource}}, samplers, program);
}

Failure compileCompute(const Gl& gl, const char* what, const std::string& source, std::initializer_list<const char*> samplers, Program* program)
{
    return link(gl, what, {{GL_COMPUTE_SHADER, source}}, samplers, program);
}

void setSplatUniforms(const NacreAssetImpl& asset, const Program& p, const DrawFrame& frame)
{
    const Gl& gl = asset.context->gl;
    gl.UniformMatrix3fv(p.viewFromAsset, 1, GL_FALSE, &frame.viewFromAsset[0][0]);
    gl.Uniform3f(p.viewTranslation, frame.viewTranslation.x, frame.viewTranslation.y, frame.viewTranslation.z);
    gl.UniformMatrix4fv(p.clipFromView, 1, GL_FALSE, &frame.clipFromView[0][0]);
    gl.Uniform2f(p.viewport, frame.viewport.x, frame.viewport.y);
    gl.Uniform1f(p.jacobianLimit, 1.0f + kJacobianMargin);
    gl.Uniform1f(p.nearW, frame.nearW);
    gl.Uniform4f(p.nearPlane, frame.nearPlane.x, frame.nearPlane.y, frame.nearPlane.z, frame.nearPlane.w);
    gl.Uniform1f(p.lowPass, asset.lowPassVariance);
}

} // namespace nacre
