// Programs, compiled once a context whatever the number of assets: sizes are uniforms, only channels and features are #defines, so what a
// scene lacks is not in its code.
#pragma once

#include "context.h"

#include <glm/glm.hpp>

#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace nacre {

class Program {
public:
    Program(const Gl& gl, GLuint name) : gl_(gl), name_(name) {}
    ~Program() { gl_.DeleteProgram(name_); }
    Program(const Program&) = delete;
    Program& operator=(const Program&) = delete;

    /// Makes it current; the setters below need that.
    void use() const { gl_.UseProgram(name_); }
    // A uniform that this variant lacks is passed over, as GL does. Names are literals.
    void set(const char* uniform, int v) const { gl_.Uniform1i(at(uniform), v); }
    void set(const char* uniform, float v) const { gl_.Uniform1f(at(uniform), v); }
    void set(const char* uniform, const glm::vec2& v) const { gl_.Uniform2f(at(uniform), v.x, v.y); }
    void set(const char* uniform, const glm::vec3& v) const { gl_.Uniform3f(at(uniform), v.x, v.y, v.z); }
    void set(const char* uniform, const glm::vec4& v) const { gl_.Uniform4f(at(uniform), v.x, v.y, v.z, v.w); }
    void set(const char* uniform, const glm::mat3& m) const { gl_.UniformMatrix3fv(at(uniform), 1, GL_FALSE, &m[0][0]); }
    void set(const char* uniform, const glm::mat4& m) const { gl_.UniformMatrix4fv(at(uniform), 1, GL_FALSE, &m[0][0]); }
    void set(const char* uniform, int count, const int* values) const { gl_.Uniform1iv(at(uniform), count, values); }
    void set(const char* uniform, int count, const glm::mat4* m) const { gl_.UniformMatrix4fv(at(uniform), count, GL_FALSE, &m[0][0][0]); }

private:
    GLint at(const char* uniform) const;

    const Gl& gl_;
    const GLuint name_;
    mutable std::vector<std::pair<const char*, GLint>> locations_;
};

/// One more #define.
std::string define(const char* name, int value);
std::string define(const char* name, float value);

struct ProgramSource {
    const char* what; // for messages
    std::string vertex, fragment;                // without the header and layout.glsl, which all have
    std::initializer_list<const char*> samplers; // samplers[i] reads texture unit i
};
/// Compiles, or finds what was compiled before. Leaves a program that is compiled current.
Failure findProgram(Context& context, const ProgramSource& source, const Program** program);
/// The same of a compute shader; only if gl.hasCompute().
Failure findComputeProgram(Context& context, const char* what, const std::string& source, std::initializer_list<const char*> samplers, const Program** program);

/// A program that is looked up once: making its source again for each draw would cost more than the draw.
class ProgramOnce {
public:
    /// make(const Program**) finds it the first time.
    template <class Make>
    Failure find(const Program** program, Make make)
    {
        if (!known_)
            if (Failure f = make(&known_)) return f;
        *program = known_;
        return {};
    }

private:
    const Program* known_ = nullptr;
};

} // namespace nacre
