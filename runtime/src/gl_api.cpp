#include "gl_api.h"

#include <cstring>

namespace nacre {

static_assert(sizeof(void*) == sizeof(void (*)()), "getProcAddress hands functions over as void*");

static bool hasExtension(const Gl& gl, const char* wanted)
{
    GLint count = 0;
    gl.GetIntegerv(GL_NUM_EXTENSIONS, &count);
    for (GLint i = 0; i < count; ++i) {
        const GLubyte* name = gl.GetStringi(GL_EXTENSIONS, GLuint(i));
        if (name && std::strcmp(reinterpret_cast<const char*>(name), wanted) == 0) return true;
    }
    return false;
}

/// Version and API of the current context.
static std::string readVersion(Gl& gl)
{
    const GLubyte* text = gl.GetString(GL_VERSION);
    if (!text) return "no OpenGL context is current on this thread; make it current before nacreContextCreate";
    const std::string version = reinterpret_cast<const char*>(text);
    gl.es = version.rfind("OpenGL ES", 0) == 0;
    GLint major = 0, minor = 0; // what ES 2 does not know stays 0
    gl.GetIntegerv(GL_MAJOR_VERSION, &major);
    gl.GetIntegerv(GL_MINOR_VERSION, &minor);
    gl.version = 10 * major + minor;
    if (gl.version < (gl.es ? 30 : 33)) return "found '" + version + "', needed is OpenGL 3.3 core, OpenGL ES 3.0, WebGL 2, or newer";
    return {};
}

/// Whether a rasteriser on the CPU draws.
static bool isSoftware(const Gl& gl)
{
    const GLubyte* text = gl.GetString(GL_RENDERER);
    const std::string renderer = text ? reinterpret_cast<const char*>(text) : "";
    for (const char* name : {"llvmpipe", "softpipe", "swrast", "SWR", "Software Rasterizer", "SwiftShader"})
        if (renderer.find(name) != std::string::npos) return true;
    return false;
}

/// What draws: the one wanted, or the fastest.
static std::string chooseBackEnd(BackEnd wanted, Gl& gl)
{
    const BackEnd best = gl.es ? BackEnd::kGles3 : NACRE_WITH_GL43 && gl.version >= 43 ? BackEnd::kGl43 : BackEnd::kGl33;
    const std::string found = std::string(", found ") + (gl.es ? "OpenGL ES " : "OpenGL ") + std::to_string(gl.version / 10) + "." + std::to_string(gl.version % 10) +
                              "; use NACRE_BACK_END_AUTO";
    if (wanted == BackEnd::kGl33 && gl.es) return "NACRE_BACK_END_GL33 needs OpenGL 3.3" + found;
    if (wanted == BackEnd::kGles3 && !gl.es) return "NACRE_BACK_END_GLES3 needs OpenGL ES 3.0 or WebGL 2" + found;
    if (wanted == BackEnd::kGl43 && !NACRE_WITH_GL43) return "NACRE_BACK_END_GL43 was left out of this build of Nacre (CMake option NACRE_WITH_GL43); use NACRE_BACK_END_AUTO";
    if (wanted == BackEnd::kGl43 && best != wanted) return "NACRE_BACK_END_GL43 needs OpenGL 4.3" + found;
    gl.backEnd = wanted == BackEnd::kAuto ? best : wanted;
    return {};
}

std::string loadGl(NacreGetProcAddress getProcAddress, void* user, BackEnd wanted, Gl* gl)
{
#define X(TYPE, name)                                                                                                            \
    gl->name = reinterpret_cast<PFNGL##TYPE##PROC>(getProcAddress("gl" #name, user));                                            \
    if (!gl->name) return "getProcAddress found no gl" #name ", needed is OpenGL 3.3 core or OpenGL ES 3.0; make the context current first";
    NACRE_GL_FUNCTIONS(X)
    if (std::string fault = readVersion(*gl); !fault.empty()) return fault;
    if (std::string fault = chooseBackEnd(wanted, *gl); !fault.empty()) return fault;

    // a driver may return stubs for newer functions: go by version, not by pointer
    if (!gl->es) { NACRE_GL_DESKTOP_FUNCTIONS(X) }
    if (!gl->es || gl->version >= 32) { NACRE_GL_INDEXED_FUNCTIONS(X) }
    if (gl->version >= (gl->es ? 32 : 40)) { NACRE_GL_INDEXED_BLENDING_FUNCTIONS(X) }
    if (gl->es || gl->version >= 40) { NACRE_GL_FEEDBACK_FUNCTIONS(X) }
    if (!gl->es && gl->version >= 41) { NACRE_GL_INDEXED_VIEWPORT_FUNCTIONS(X) }
#undef X
    if (gl->hasCompute()) {
        bool found = true;
#define X(TYPE, name) gl->name = reinterpret_cast<PFNGL##TYPE##PROC>(getProcAddress("gl" #name, user)), found = found && gl->name;
        NACRE_GL_43_FUNCTIONS(X)
#undef X
        if (!found && wanted == BackEnd::kGl43) return "getProcAddress does not find all functions of OpenGL 4.3; use NACRE_BACK_END_AUTO";
        if (!found) gl->backEnd = BackEnd::kGl33;
    }
    gl->software = isSoftware(*gl);
    gl->computePictures = wanted == BackEnd::kGl43 || !gl->software;

    if (gl->es) {
        if (gl->version < 32 && !hasExtension(*gl, "GL_EXT_color_buffer_float"))
            return "this OpenGL ES or WebGL lacks EXT_color_buffer_float (float textures to draw into), which relighting needs; in WebGL enable the extension first";
        gl->clipControl = hasExtension(*gl, "GL_EXT_clip_control");
        gl->clipDistances = hasExtension(*gl, "GL_EXT_clip_cull_distance");
        gl->floatBlend = hasExtension(*gl, "GL_EXT_float_blend");
    } else {
        GLint profile = 0;
        gl->GetIntegerv(GL_CONTEXT_PROFILE_MASK, &profile);
        gl->compatibility = (profile & GL_CONTEXT_COMPATIBILITY_PROFILE_BIT) != 0;
        gl->clipControl = gl->version >= 45 || hasExtension(*gl, "GL_ARB_clip_control");
        gl->clipDistances = true;
    }
    gl->GetIntegerv(GL_MAX_TEXTURE_SIZE, &gl->maxTextureSize);
    gl->GetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &gl->maxArrayLayers);
    gl->GetIntegerv(GL_MAX_DRAW_BUFFERS, &gl->maxDrawBuffers);
    return {};
}

std::string glslHeader(const Gl& gl, bool compute)
{
    if (compute) return "#version 430 core\n";
    if (!gl.es) return "#version 330 core\n";
    std::string header = "#version 300 es\n";
    for (const char* type : {"float", "int", "sampler2D", "sampler2DArray", "samplerCube", "usampler2D", "usampler2DArray", "sampler2DShadow", "sampler2DArrayShadow",
                             "samplerCubeShadow"})
        header += std::string("precision highp ") + type + ";\n";
    return header;
}

GLenum takeGlError(const Gl& gl)
{
    const GLenum first = gl.GetError();
    for (int i = 0; i < 16 && gl.GetError() != GL_NO_ERROR; ++i) {} // bounded: a lost context reports forever
    return first;
}

} // namespace nacre
