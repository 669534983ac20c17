// Compiles the shaders of one asset. Sizes and channels are #defines, so an asset without s, lobe or visibility compiles without the
// code for it and every loop over coefficients has a constant bound.
#include "asset.h"

#include "appearance/bigs/bigs.h"
#include "shader_sources.h"
#include "splats/blend.h"

#include <cstdio>

namespace nacre {

static std::string defines(const NacreAssetImpl& asset)
{
    std::string text = "#version 330 core\n";
    char line[64];
    const auto whole = [&](const char* name, int value) {
        std::snprintf(line, sizeof line, "#define %s %d\n", name, value);
        text += line;
    };
    const auto real = [&](const char* name, float value) {
        std::snprintf(line, sizeof line, "#define %s %#.9g\n", name, double(value)); // #: 4 must not become an int
        text += line;
    };
    whole("WIDTH", asset.width);
    whole("ROWS", asset.rows);
    whole("ROW_SHIFT", asset.rowShift);
    whole("S_FUNCTIONS", asset.sFunctions);
    whole("HAS_LOBE", asset.hasLobe);
    whole("HAS_VISIBILITY", asset.visibilitySize > 0);
    whole("VISIBILITY_SIZE", asset.visibilitySize);
    real("VISIBILITY_SLOPE", kBigsVisibilitySlope);
    real("LOBE_FACING", kBigsLobeFacing);
    real("MIN_ALPHA", kMinAlpha);
    real("MAX_ALPHA", kMaxAlpha);
    return text;
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

static Failure compile(const Gl& gl, const char* what, const std::string& vertexSource, const std::string& fragmentSource, Program* p)
{
    std::string log;
    const GLuint vertex = compileStage(gl, GL_VERTEX_SHADER, vertexSource, &log);
    const GLuint fragment = vertex ? compileStage(gl, GL_FRAGMENT_SHADER, fragmentSource, &log) : 0;
    GLint good = 0;
    if (vertex && fragment) {
        p->name = gl.CreateProgram();
        gl.AttachShader(p->name, vertex);
        gl.AttachShader(p->name, fragment);
        gl.LinkProgram(p->name);
        gl.GetProgramiv(p->name, GL_LINK_STATUS, &good);
        if (!good) {
            char buffer[512] = "";
            gl.GetProgramInfoLog(p->name, sizeof buffer, nullptr, buffer);
            log = buffer;
        }
    }
    gl.DeleteShader(vertex);
    gl.DeleteShader(fragment);
    if (!good) return {NACRE_ERROR_GL, std::string("the ") + what + " program failed to compile: " + firstLine(log)};

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
    p->lowPass = at("uLowPass");
    p->maxColor = at("uMaxColor");
    return {};
}

/// Sampler `names[i]` reads texture unit i.
static void setSamplers(const Gl& gl, const Program& p, std::initializer_list<const char*> names)
{
    gl.UseProgram(p.name);
    int unit = 0;
    for (const char* name : names) gl.Uniform1i(gl.GetUniformLocation(p.name, name), unit++);
}

Failure compilePrograms(NacreAssetImpl& asset)
{
    const Gl& gl = asset.context->gl;
    const std::string common = defines(asset) + shaders::kLayoutGlsl;
    const std::string fullscreen = common + shaders::kFullscreenVertGlsl;
    const std::string pass = common + shaders::kPassGlsl + shaders::kBigsGlsl;
    if (Failure f = compile(gl, "light", fullscreen, pass + shaders::kLightPassFragGlsl, &asset.lightPass)) return f;
    if (asset.sFunctions > 0)
        if (Failure f = compile(gl, "view", fullscreen, pass + shaders::kViewPassFragGlsl, &asset.viewPass)) return f;
    if (Failure f = compile(gl, "combine", fullscreen, pass + shaders::kCombinePassFragGlsl, &asset.combinePass)) return f;
    if (Failure f = compile(gl, "splat", common + shaders::kSplatVertGlsl, common + shaders::kSplatFragGlsl, &asset.splatProgram))
        return f;
    setSamplers(gl, asset.lightPass, {"uGeometry", "uTransport", "uLights", "uVisibility"});
    if (asset.sFunctions > 0) setSamplers(gl, asset.viewPass, {"uGeometry", "uScatter"});
    setSamplers(gl, asset.combinePass, {"uGeometry", "uDirect", "uIndirect", "uContracted", "uLights", "uVisible"});
    setSamplers(gl, asset.splatProgram, {"uGeometry", "uColor", "uOrder"});
    return {};
}

} // namespace nacre
