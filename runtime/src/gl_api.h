// The OpenGL functions the runtime calls, loaded through the host's getProcAddress into a table per context: nothing global, no
// loader library, no clash with the host's own loader. GL 3.3 core, plus a few later entry points for saving state and for compute
// shaders. What a version lacks is not called in it, even where drivers forgive it.
#pragma once

#include <GL/glcorearb.h>

#include "nacre/nacre.h"

#include <string>

namespace nacre {

#define NACRE_GL_FUNCTIONS(X)                                                                                                    \
    X(ACTIVETEXTURE, ActiveTexture) X(ATTACHSHADER, AttachShader) X(BEGINQUERY, BeginQuery) X(BINDBUFFER, BindBuffer)            \
    X(BINDFRAMEBUFFER, BindFramebuffer) X(BINDSAMPLER, BindSampler) X(BINDTEXTURE, BindTexture)                                  \
    X(BINDVERTEXARRAY, BindVertexArray) X(BLITFRAMEBUFFER, BlitFramebuffer) X(CLEARBUFFERFV, ClearBufferfv)                      \
    X(BLENDEQUATIONSEPARATE, BlendEquationSeparate)                                          \
    X(BLENDFUNCSEPARATE, BlendFuncSeparate) X(BUFFERDATA, BufferData)                                                            \
    X(CHECKFRAMEBUFFERSTATUS, CheckFramebufferStatus) X(CLAMPCOLOR, ClampColor) X(COLORMASKI, ColorMaski)                        \
    X(COMPILESHADER, CompileShader) X(COPYTEXSUBIMAGE2D, CopyTexSubImage2D) X(CREATEPROGRAM, CreateProgram)                      \
    X(CREATESHADER, CreateShader)                                                                                                \
    X(DELETEBUFFERS, DeleteBuffers) X(DELETEFRAMEBUFFERS, DeleteFramebuffers) X(DELETEPROGRAM, DeleteProgram)                    \
    X(DELETEQUERIES, DeleteQueries)                                                                                              \
    X(DELETESHADER, DeleteShader) X(DELETETEXTURES, DeleteTextures) X(DELETEVERTEXARRAYS, DeleteVertexArrays)                    \
    X(DEPTHMASK, DepthMask) X(DISABLE, Disable) X(DISABLEI, Disablei) X(DRAWARRAYS, DrawArrays) X(DRAWBUFFERS, DrawBuffers)      \
    X(DRAWELEMENTS, DrawElements) X(ENABLE, Enable) X(ENABLEI, Enablei) X(ENDQUERY, EndQuery) X(FINISH, Finish)                  \
    X(FRAMEBUFFERRENDERBUFFER, FramebufferRenderbuffer) X(FRAMEBUFFERTEXTURE, FramebufferTexture)                                \
    X(FRAMEBUFFERTEXTURELAYER, FramebufferTextureLayer) X(FRAMEBUFFERTEXTURE2D, FramebufferTexture2D) X(GENBUFFERS, GenBuffers) X(GENFRAMEBUFFERS, GenFramebuffers)                  \
    X(GENQUERIES, GenQueries)                                                                                                    \
    X(GENTEXTURES, GenTextures) X(GENVERTEXARRAYS, GenVertexArrays) X(GETBOOLEANI_V, GetBooleani_v) X(GETERROR, GetError)        \
    X(GETFLOATV, GetFloatv) X(GETFRAMEBUFFERATTACHMENTPARAMETERIV, GetFramebufferAttachmentParameteriv)                          \
    X(GETINTEGERI_V, GetIntegeri_v) X(GETINTEGERV, GetIntegerv) X(GETPROGRAMINFOLOG, GetProgramInfoLog)                          \
    X(GETPROGRAMIV, GetProgramiv) X(GETQUERYIV, GetQueryiv) X(GETQUERYOBJECTUIV, GetQueryObjectuiv)                              \
    X(GETSHADERINFOLOG, GetShaderInfoLog) X(GETSHADERIV, GetShaderiv) X(GETSTRING, GetString) X(GETSTRINGI, GetStringi)          \
    X(GETUNIFORMLOCATION, GetUniformLocation) X(GETVERTEXATTRIBIV, GetVertexAttribiv) X(ISENABLED, IsEnabled)                    \
    X(ISENABLEDI, IsEnabledi) X(ISVERTEXARRAY, IsVertexArray) X(LINKPROGRAM, LinkProgram)                                        \
    X(PIXELSTOREI, PixelStorei) X(POLYGONMODE, PolygonMode) X(SHADERSOURCE, ShaderSource) X(TEXIMAGE2D, TexImage2D)              \
    X(TEXIMAGE3D, TexImage3D) X(TEXPARAMETERI, TexParameteri) X(TEXSUBIMAGE2D, TexSubImage2D)                                    \
    X(TEXSUBIMAGE3D, TexSubImage3D) X(UNIFORM1F, Uniform1f) X(UNIFORM1I, Uniform1i) X(UNIFORM2F, Uniform2f)                      \
    X(UNIFORM3F, Uniform3f) X(UNIFORM4F, Uniform4f) X(UNIFORMMATRIX3FV, UniformMatrix3fv)                                        \
    X(UNIFORMMATRIX4FV, UniformMatrix4fv) X(USEPROGRAM, UseProgram) X(VERTEXATTRIBDIVISOR, VertexAttribDivisor)                  \
    X(VIEWPORT, Viewport)

// Null where the context is older. Blending and (4.1) viewports have an index, which plain calls would overwrite for all.
#define NACRE_GL_40_FUNCTIONS(X)                                                                                                 \
    X(BLENDEQUATIONSEPARATEI, BlendEquationSeparatei) X(BLENDFUNCSEPARATEI, BlendFuncSeparatei)                                  \
    X(PAUSETRANSFORMFEEDBACK, PauseTransformFeedback) X(RESUMETRANSFORMFEEDBACK, ResumeTransformFeedback)
#define NACRE_GL_41_FUNCTIONS(X) X(VIEWPORTINDEXEDF, ViewportIndexedf)
#define NACRE_GL_43_FUNCTIONS(X)                                                                                                 \
    X(BINDIMAGETEXTURE, BindImageTexture) X(DISPATCHCOMPUTE, DispatchCompute) X(MEMORYBARRIER, MemoryBarrier)

struct Gl {
#define X(TYPE, name) PFNGL##TYPE##PROC name = nullptr;
    NACRE_GL_FUNCTIONS(X)
    NACRE_GL_40_FUNCTIONS(X)
    NACRE_GL_41_FUNCTIONS(X)
    NACRE_GL_43_FUNCTIONS(X)
#undef X
    int version = 0;              // major * 10 + minor
    bool compatibility = false;   // the profile that keeps what 3.0 deprecated
    bool clipControl = false;     // 4.5 or ARB_clip_control
    GLint maxTextureSize = 0;
    GLint maxArrayLayers = 0;
    GLint maxDrawBuffers = 0;

    bool hasCompute() const { return BindImageTexture && DispatchCompute && MemoryBarrier; }
};

/// Empty on success, else one line that says what is missing.
std::string loadGl(NacreGetProcAddress getProcAddress, void* user, Gl* gl);

/// The first pending error, all cleared; GL_NO_ERROR if none.
GLenum takeGlError(const Gl& gl);

} // namespace nacre
