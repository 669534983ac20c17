#include "program.h"

#include "appearance/visibility_map.h"
#include "base/text.h"
#include "shader_sources.h"
#include "splats/blend.h"

#include <cstring>

namespace nacre {

std::string define(const char* name, int value) { return std::string("#define ") + name + ' ' + std::to_string(value) + '\n'; }

std::string define(const char* name, float value)
{
    std::string text = numberText(value);
    if (text.find_first_of(".e") == std::string::npos) text += ".0"; // 4 must not become an int
    return std::string("#define ") + name + ' ' + text + '\n';
}

GLint Program::at(const char* uniform) const
{
    for (const auto& [name, location] : locations_)
        if (name == uniform || std::strcmp(name, uniform) == 0) return location;
    locations_.emplace_back(uniform, gl_.GetUniformLocation(name_, uniform));
    return locations_.back().second;
}

/// What every shader knows: where splats sit, how they blend.
static std::string commonHead(const Gl& gl, bool compute)
{
    return glslHeader(gl, compute) + define("VISIBILITY_SLOPE", kVisibilitySlope) + define("MIN_ALPHA", kMinAlpha) + define("MAX_ALPHA", kMaxAlpha) +
           shaders::kLayoutGlsl;
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
    std::string source;
};
} // namespace

static Failure link(const Gl& gl, const char* what, std::initializer_list<Stage> stages, std::initializer_list<const char*> samplers, GLuint* program)
{
    std::string log;
    GLint good = 1;
    const GLuint name = gl.CreateProgram();
    for (const Stage& stage : stages) {
        const GLuint shader = good ? compileStage(gl, stage.kind, stage.source, &log) : 0;
        good = shader != 0;
        if (good) gl.AttachShader(name, shader);
        gl.DeleteShader(shader); // goes with the program
    }
    if (good) {
        gl.LinkProgram(name);
        gl.GetProgramiv(name, GL_LINK_STATUS, &good);
        char buffer[512] = "";
        if (!good) gl.GetProgramInfoLog(name, sizeof buffer, nullptr, buffer), log = buffer;
    }
    if (!good) {
        gl.DeleteProgram(name);
        return {NACRE_ERROR_GL, std::string("the ") + what + " program failed to compile: " + firstLine(log)};
    }
    gl.UseProgram(name);
    int unit = 0;
    for (const char* sampler : samplers) gl.Uniform1i(gl.GetUniformLocation(name, sampler), unit++);
    *program = name;
    return {};
}

static Failure find(Context& context, const char* what, std::initializer_list<Stage> stages, std::initializer_list<const char*> samplers, const Program** program)
{
    std::string key;
    for (const Stage& stage : stages) key += stage.source;
    std::unique_ptr<Program>& known = context.programs[key];
    if (!known) {
        GLuint name = 0;
        if (Failure f = link(context.gl, what, stages, samplers, &name)) return f;
        known = std::make_unique<Program>(context.gl, name);
    }
    *program = known.get();
    return {};
}

Failure findProgram(Context& context, const ProgramSource& source, const Program** program)
{
    const std::string head = commonHead(context.gl, false);
    return find(context, source.what, {{GL_VERTEX_SHADER, head + source.vertex}, {GL_FRAGMENT_SHADER, head + source.fragment}}, source.samplers, program);
}

Failure findComputeProgram(Context& context, const char* what, const std::string& source, std::initializer_list<const char*> samplers, const Program** program)
{
    return find(context, what, {{GL_COMPUTE_SHADER, commonHead(context.gl, true) + source}}, samplers, program);
}

} // namespace nacre
