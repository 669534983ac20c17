// A getProcAddress for NacreContextDesc in front of the headless one, which counts the objects that live.
#pragma once

#include "eval/headless_gl.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include <algorithm>
#include <cstdint>
#include <string>

namespace nacre::test {

/// Objects that were made and not deleted, of all kinds.
inline int64_t liveObjects = 0;
inline void* countingGl(const char* name, void* user)
{
    const std::string wanted = name;
#define COUNTED(Kind) \
    if (wanted == "glGen" #Kind) { \
        static constexpr auto kGen = [](GLsizei n, GLuint* names) { liveObjects += n, glGen##Kind(n, names); }; \
        return reinterpret_cast<void*>(+kGen); \
    } \
    if (wanted == "glDelete" #Kind) { \
        static constexpr auto kDelete = [](GLsizei n, const GLuint* names) { \
            liveObjects -= std::count_if(names, names + n, [](GLuint x) { return x != 0; }); \
            glDelete##Kind(n, names); \
        }; \
        return reinterpret_cast<void*>(+kDelete); \
    }
    COUNTED(Textures) COUNTED(Framebuffers) COUNTED(Buffers) COUNTED(VertexArrays) COUNTED(Queries) COUNTED(Renderbuffers) COUNTED(Samplers)
    COUNTED(TransformFeedbacks)
#undef COUNTED
    static constexpr auto kCreateShader = [](GLenum stage) { return ++liveObjects, glCreateShader(stage); };
    static constexpr auto kDeleteShader = [](GLuint name) { liveObjects -= name != 0, glDeleteShader(name); };
    static constexpr auto kCreateProgram = [] { return ++liveObjects, glCreateProgram(); };
    static constexpr auto kDeleteProgram = [](GLuint name) { liveObjects -= name != 0, glDeleteProgram(name); };
    static constexpr auto kFence = [](GLenum condition, GLbitfield flags) { return ++liveObjects, glFenceSync(condition, flags); };
    static constexpr auto kDeleteSync = [](GLsync sync) { liveObjects -= sync != nullptr, glDeleteSync(sync); };
    if (wanted == "glCreateShader") return reinterpret_cast<void*>(+kCreateShader);
    if (wanted == "glDeleteShader") return reinterpret_cast<void*>(+kDeleteShader);
    if (wanted == "glCreateProgram") return reinterpret_cast<void*>(+kCreateProgram);
    if (wanted == "glDeleteProgram") return reinterpret_cast<void*>(+kDeleteProgram);
    if (wanted == "glFenceSync") return reinterpret_cast<void*>(+kFence);
    if (wanted == "glDeleteSync") return reinterpret_cast<void*>(+kDeleteSync);
    return HeadlessGl::getProcAddress(name, user);
}

} // namespace nacre::test
