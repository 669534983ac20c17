// What a host's NacreContext points to, and how work inside the runtime fails.
#pragma once

#include "gl_api.h"

#include <string>

namespace nacre {

/// See host_depth.cpp.
struct DepthSource {
    GLint type = 0, name = 0, depthBits = 0, stencilBits = 0, samples = 0;
    bool real = false;
    bool operator==(const DepthSource&) const = default;
};
struct DepthFormat;
struct DepthCopy {
    GLuint texture = 0;
    GLenum format = 0;
    int width = 0, height = 0;
    DepthSource source;                  // the last that was blitted from
    const DepthFormat* blits = nullptr;  // the format that can be, null if none
    GLuint knownTexture = 0, knownArray = 0; // the last shared one, and the last that was an array; where GL does not tell
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

    GLuint vertexArray = 0;     // holds the index buffer and the mark of the GL context; no attributes
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

namespace nacre {

/// Takes the GL context that is current for that of `context`.
void markGlContext(NacreContextImpl& context);
/// Fails if another one, or none, is current. A few gets, no waiting.
Failure checkGlContext(const NacreContextImpl& context);

/// While it lives, GL objects of `context` are forgotten instead of deleted: in another GL context their names are other objects'.
class ForgottenObjects {
public:
    explicit ForgottenObjects(NacreContextImpl& context);
    ~ForgottenObjects() { gl_ = functions_; }
    ForgottenObjects(const ForgottenObjects&) = delete;
    ForgottenObjects& operator=(const ForgottenObjects&) = delete;

private:
    Gl& gl_;
    const Gl functions_;
};

} // namespace nacre
