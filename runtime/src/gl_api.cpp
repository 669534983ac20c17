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

std::string loadGl(NacreGetProcAddress getProcAddress, void* user, Gl* gl)
{
#define X(TYPE, name)                                                                                                            \
    gl->name = reinterpret_cast<PFNGL##TYPE##PROC>(getProcAddress("gl" #name, user));                                            \
    if (!gl->name) return "getProcAddress found no gl" #name ", needed is OpenGL 3.3 core; make the context current first";
    NACRE_GL_FUNCTIONS(X)
#undef X

    const GLubyte* text = gl->GetString(GL_VERSION);
    if (!text) return "no OpenGL context is current on this thread; make it current before nacreContextCreate";
    const std::string version = reinterpret_cast<const char*>(text);
    if (version.rfind("OpenGL ES", 0) == 0) return "found '" + version + "', needed is desktop OpenGL 3.3 core or newer";
    GLint major = 0, minor = 0;
    gl->GetIntegerv(GL_MAJOR_VERSION, &major);
    gl->GetIntegerv(GL_MINOR_VERSION, &minor);
    gl->version = 10 * major + minor;
    if (gl->version < 33) return "found OpenGL '" + version + "', needed is 3.3 core or newer";

    // a driver may return stubs for newer functions: go by version, not by pointer
#define X(TYPE, name) gl->name = reinterpret_cast<PFNGL##TYPE##PROC>(getProcAddress("gl" #name, user));
    if (gl->version >= 40) { NACRE_GL_40_FUNCTIONS(X) }
    if (gl->version >= 41) { NACRE_GL_41_FUNCTIONS(X) }
    if (gl->version >= 43) { NACRE_GL_43_FUNCTIONS(X) }
#undef X
    GLint profile = 0;
    gl->GetIntegerv(GL_CONTEXT_PROFILE_MASK, &profile);
    gl->compatibility = (profile & GL_CONTEXT_COMPATIBILITY_PROFILE_BIT) != 0;
    gl->clipControl = gl->version >= 45 || hasExtension(*gl, "GL_ARB_clip_control");
    gl->GetIntegerv(GL_MAX_TEXTURE_SIZE, &gl->maxTextureSize);
    gl->GetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &gl->maxArrayLayers);
    gl->GetIntegerv(GL_MAX_DRAW_BUFFERS, &gl->maxDrawBuffers);
    return {};
}

GLenum takeGlError(const Gl& gl)
{
    const GLenum first = gl.GetError();
    for (int i = 0; i < 16 && gl.GetError() != GL_NO_ERROR; ++i) {} // bounded: a lost context reports forever
    return first;
}

} // namespace nacre
