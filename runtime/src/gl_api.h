// The OpenGL functions the runtime calls, loaded through the host's getProcAddress into a table per context: nothing global, no
// loader library, no clash with the host's own loader. What both GL 3.3 and GL ES 3.0 have, plus what only one of them or a later version
// has, for saving state and for compute shaders: null where the context is older. What a version lacks is not called in it, even where
// drivers forgive it.
#pragma once

#include <GL/glcorearb.h>

#include "nacre/nacre.h"

#include <string>

// 0: back end kGl43 was left out of this build
#ifndef NACRE_WITH_GL43
#define NACRE_WITH_GL43 1
#endif

namespace nacre {

// In every context.
#define NACRE_GL_FUNCTIONS(X)                                                                                                    \
    X(ACTIVETEXTURE, ActiveTexture) X(ATTACHSHADER, AttachShader) X(BEGINQUERY, BeginQuery) X(BINDBUFFER, BindBuffer)            \
    X(BINDFRAMEBUFFER, BindFramebuffer) X(BINDSAMPLER, BindSampler) X(BINDTEXTURE, BindTexture)                                  \
    X(BINDVERTEXARRAY, BindVertexArray) X(BLITFRAMEBUFFER, BlitFramebuffer) X(CLEARBUFFERFV, ClearBufferfv)                      \
    X(BLENDEQUATIONSEPARATE, BlendEquationSeparate) X(BLENDFUNCSEPARATE, BlendFuncSeparate) X(BUFFERDATA, BufferData)            \
    X(CHECKFRAMEBUFFERSTATUS, CheckFramebufferStatus) X(COLORMASK, ColorMask) X(COMPILESHADER, CompileShader)                    \
    X(COPYTEXSUBIMAGE2D, CopyTexSubImage2D) X(CREATEPROGRAM, CreateProgram) X(CREATESHADER, CreateShader)                        \
    X(DELETEBUFFERS, DeleteBuffers) X(DELETEFRAMEBUFFERS, DeleteFramebuffers) X(DELETEPROGRAM, DeleteProgram)                    \
    X(DELETEQUERIES, DeleteQueries) X(DELETESAMPLERS, DeleteSamplers) X(DELETESHADER, DeleteShader) X(DELETETEXTURES, DeleteTextures)                              \
    X(DELETEVERTEXARRAYS, DeleteVertexArrays) X(DEPTHFUNC, DepthFunc) X(DEPTHMASK, DepthMask) X(DISABLE, Disable) X(DRAWARRAYS, DrawArrays)              \
    X(DRAWBUFFERS, DrawBuffers) X(DRAWELEMENTS, DrawElements) X(ENABLE, Enable) X(ENDQUERY, EndQuery) X(FINISH, Finish)          \
    X(FRAMEBUFFERRENDERBUFFER, FramebufferRenderbuffer) X(FRAMEBUFFERTEXTURE2D, FramebufferTexture2D)                            \
    X(FRAMEBUFFERTEXTURELAYER, FramebufferTextureLayer) X(GENBUFFERS, GenBuffers) X(GENFRAMEBUFFERS, GenFramebuffers)            \
    X(GENQUERIES, GenQueries) X(GENSAMPLERS, GenSamplers) X(GENTEXTURES, GenTextures) X(GENVERTEXARRAYS, GenVertexArrays) X(GETBOOLEANV, GetBooleanv)        \
    X(GETERROR, GetError) X(GETFLOATV, GetFloatv)                                                                                \
    X(GETFRAMEBUFFERATTACHMENTPARAMETERIV, GetFramebufferAttachmentParameteriv) X(GETINTEGERV, GetIntegerv)                      \
    X(GETPROGRAMINFOLOG, GetProgramInfoLog) X(GETPROGRAMIV, GetProgramiv) X(GETQUERYIV, GetQueryiv)                              \
    X(GETQUERYOBJECTUIV, GetQueryObjectuiv) X(GETSHADERINFOLOG, GetShaderInfoLog) X(GETSHADERIV, GetShaderiv)                    \
    X(GETSTRING, GetString) X(GETSTRINGI, GetStringi) X(GETUNIFORMLOCATION, GetUniformLocation)                                  \
    X(GETVERTEXATTRIBIV, GetVertexAttribiv) X(ISENABLED, IsEnabled) X(ISTEXTURE, IsTexture) X(ISVERTEXARRAY, IsVertexArray) X(LINKPROGRAM, LinkProgram)  \
    X(PIXELSTOREI, PixelStorei) X(SAMPLERPARAMETERI, SamplerParameteri) X(SHADERSOURCE, ShaderSource) X(TEXIMAGE2D, TexImage2D) X(TEXIMAGE3D, TexImage3D)                \
    X(TEXPARAMETERI, TexParameteri) X(TEXSUBIMAGE2D, TexSubImage2D) X(TEXSUBIMAGE3D, TexSubImage3D) X(UNIFORM1F, Uniform1f)      \
    X(UNIFORM1I, Uniform1i) X(UNIFORM1IV, Uniform1iv) X(UNIFORM2F, Uniform2f) X(UNIFORM3F, Uniform3f) X(UNIFORM4F, Uniform4f)    \
    X(UNIFORMMATRIX3FV, UniformMatrix3fv) X(UNIFORMMATRIX4FV, UniformMatrix4fv) X(USEPROGRAM, UseProgram)                        \
    X(VERTEXATTRIBDIVISOR, VertexAttribDivisor) X(VIEWPORT, Viewport)

// GL.
#define NACRE_GL_DESKTOP_FUNCTIONS(X) X(CLAMPCOLOR, ClampColor) X(POLYGONMODE, PolygonMode)
// GL and ES 3.2: draw buffers have states of their own, and framebuffers layers.
#define NACRE_GL_INDEXED_FUNCTIONS(X)                                                                                            \
    X(COLORMASKI, ColorMaski) X(DISABLEI, Disablei) X(ENABLEI, Enablei) X(FRAMEBUFFERTEXTURE, FramebufferTexture)                \
    X(GETBOOLEANI_V, GetBooleani_v) X(ISENABLEDI, IsEnabledi)
// GL 4.0 and ES 3.2: so has blending, whose plain calls would overwrite it for all.
#define NACRE_GL_INDEXED_BLENDING_FUNCTIONS(X)                                                                                   \
    X(BLENDEQUATIONSEPARATEI, BlendEquationSeparatei) X(BLENDFUNCSEPARATEI, BlendFuncSeparatei) X(GETINTEGERI_V, GetIntegeri_v)
// GL 4.0 and ES.
#define NACRE_GL_FEEDBACK_FUNCTIONS(X)                                                                                           \
    X(PAUSETRANSFORMFEEDBACK, PauseTransformFeedback) X(RESUMETRANSFORMFEEDBACK, ResumeTransformFeedback)
// GL 4.1: and viewports, with their scissors.
#define NACRE_GL_INDEXED_VIEWPORT_FUNCTIONS(X) X(VIEWPORTINDEXEDF, ViewportIndexedf)
// Back end kGl43.
#define NACRE_GL_43_FUNCTIONS(X)                                                                                                 \
    X(BINDIMAGETEXTURE, BindImageTexture) X(DISPATCHCOMPUTE, DispatchCompute) X(MEMORYBARRIER, MemoryBarrier)

#define NACRE_GL_OPTIONAL_FUNCTIONS(X)                                                                                           \
    NACRE_GL_DESKTOP_FUNCTIONS(X) NACRE_GL_INDEXED_FUNCTIONS(X) NACRE_GL_INDEXED_BLENDING_FUNCTIONS(X)                           \
    NACRE_GL_FEEDBACK_FUNCTIONS(X) NACRE_GL_INDEXED_VIEWPORT_FUNCTIONS(X) NACRE_GL_43_FUNCTIONS(X)

/// How the runtime draws; the values of NacreBackEnd. The state of the host is saved by the version of the context whatever the back end.
enum class BackEnd { kAuto, kGl33, kGles3, kGl43 };

struct Gl {
#define X(TYPE, name) PFNGL##TYPE##PROC name = nullptr;
    NACRE_GL_FUNCTIONS(X)
    NACRE_GL_OPTIONAL_FUNCTIONS(X)
#undef X
    BackEnd backEnd = BackEnd::kAuto; // never kAuto once loaded
    bool es = false;                  // OpenGL ES or WebGL
    int version = 0;                  // of the context, major * 10 + minor: 33 and more, in ES 30 and more
    bool compatibility = false;       // the profile that keeps what 3.0 deprecated
    bool clipControl = false;         // 4.5, ARB_clip_control or EXT_clip_control
    bool clipDistances = false;       // always in GL, in ES by EXT_clip_cull_distance
    bool floatBlend = true;           // RGBA32F can be blended into; in ES by EXT_float_blend
    GLint maxTextureSize = 0;
    GLint maxArrayLayers = 0;
    GLint maxDrawBuffers = 0;         // at least 8, in ES 4

    bool software = false;            // draws on the CPU, as llvmpipe does
    bool computePictures = false;     // where GL has compute shaders and is no software, or they were asked for by name

    bool hasCompute() const { return NACRE_WITH_GL43 && backEnd == BackEnd::kGl43; }
    /// Sorts and draws in compute shaders.
    bool computesPictures() const { return hasCompute() && computePictures; }
    /// Layers that one pass draws into.
    int maxLayers() const { return maxDrawBuffers < 8 ? maxDrawBuffers : 8; }
};

/// Empty on success, else one line that says what is missing.
std::string loadGl(NacreGetProcAddress getProcAddress, void* user, BackEnd wanted, Gl* gl);

/// What every shader starts with: #version and, in ES, the precision of what has none by default.
std::string glslHeader(const Gl& gl, bool compute = false);

/// The first pending error, all cleared; GL_NO_ERROR if none.
GLenum takeGlError(const Gl& gl);

} // namespace nacre
