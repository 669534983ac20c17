// What a host's NacreContext points to, and how work inside the runtime fails.
#pragma once

#include "gl_api.h"

#include <string>

namespace nacre {

/// See host_depth.h.
struct DepthCopy {
    GLuint texture = 0;
    GLenum format = 0;
    int width = 0, height = 0;
};

/// Empty text: success.
struct Failure {
    NacreResult code = NACRE_OK;
    std::string text;
    explicit operator bool() const { return code != NACRE_OK; }
};

} // namespace nacre

struct NacreContextImpl {
    nacre::Gl gl;
    NacreMessageCallback message = nullptr;
    void* messageUser = nullptr;
    bool profiling = false;

    GLuint vertexArray = 0;     // holds the index buffer; no attributes
    GLuint indexBuffer = 0;     // two triangles per splat: 4n + {0, 1, 2, 2, 1, 3}
    size_t indexedSplats = 0;   // capacity of indexBuffer
    nacre::DepthCopy depthCopy;

    void report(NacreSeverity severity, const std::string& text) const
    {
        if (message) message(severity, text.c_str(), messageUser);
    }
    NacreResult fail(const nacre::Failure& f) const
    {
        report(NACRE_ERROR, f.text);
        return f.code;
    }
};
