// What a context of the C API owns, and how work inside the runtime fails.
#pragma once

#include "failure.h"
#include "gl_api.h"
#include "gl_state.h"
#include "handles.h"
#include "light_set.h"
#include "pass_log.h"

#include <memory>
#include <string>
#include <unordered_map>

namespace nacre {

struct Asset;
struct Instance;
class View;
class Program;
class SplatShadows;

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

struct Context {
    Handle handle;
    Gl gl;
    NacreMessageCallback message = nullptr;
    void* messageUser = nullptr;
    bool profiling = false;
    HostState hostState = HostState::kPutBack;

    PassLog passes{gl};
    LightSet lights;
    std::unordered_map<std::string, std::unique_ptr<Program>> programs; // by source
    std::unique_ptr<SplatShadows> splatShadows;
    uint64_t gpuBytes = 0;      // of all textures

    GLuint vertexArray = 0;     // holds the index buffer and the mark of the GL context; no attributes
    GLuint indexBuffer = 0;     // two triangles per splat: 4n + {0, 1, 2, 2, 1, 3}
    size_t indexedSplats = 0;   // capacity of indexBuffer
    DepthCopy depthCopy;
    GLuint plainSampler = 0;    // nearest texel, no comparison: for textures of the host

    HandleTable<Asset> assets{HandleKind::kAsset};
    HandleTable<Instance> instances{HandleKind::kInstance};
    HandleTable<View> views{HandleKind::kView};

    Context();
    ~Context();
    /// Everything of GL. Its context is current, or forgotten.
    void destroyObjects();
    void report(NacreSeverity severity, const std::string& text) const
    {
        if (message) message(severity, text.c_str(), messageUser);
    }
    NacreResult fail(const Failure& f) const
    {
        report(NACRE_ERROR, f.text);
        return f.code;
    }
};

/// Takes the GL context that is current for that of `context`.
void markGlContext(Context& context);
/// Fails if another one, or none, is current. A few gets, no waiting.
Failure checkGlContext(const Context& context);

/// The quads of so many splats as triangles, shared by all views.
Failure growIndexBuffer(Context& context, size_t splats);

/// While it lives, GL objects of `context` are forgotten instead of deleted: in another GL context their names are other objects'.
class ForgottenObjects {
public:
    explicit ForgottenObjects(Context& context);
    ~ForgottenObjects() { gl_ = functions_; }
    ForgottenObjects(const ForgottenObjects&) = delete;
    ForgottenObjects& operator=(const ForgottenObjects&) = delete;

private:
    Gl& gl_;
    const Gl functions_;
};

} // namespace nacre
