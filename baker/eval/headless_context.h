// What a headless OpenGL context is to headless_gl.cpp, whichever library makes it (one file each).
#pragma once

#include "base/result.h"

#include <memory>
#include <string>

namespace nacre {

class HeadlessContext {
public:
    virtual ~HeadlessContext() = default;
    virtual bool makeCurrent() = 0;
    /// No context of this library is current on this thread any more.
    virtual void release() = 0;
    virtual void* getProcAddress(const char* name) = 0;

    bool software = false;
};

/// Core profile of OpenGL 3.3 or newer, or OpenGL ES 3.0 or newer, current on this thread.
Result<std::unique_ptr<HeadlessContext>> makeEglContext(bool es);
/// Core profile of OpenGL 3.3 or newer, not current yet.
Result<std::unique_ptr<HeadlessContext>> makeOsMesaContext();

/// By the name of a renderer.
bool isSoftwareRenderer(const char* name);

} // namespace nacre
