// The host's depth buffer under a framebuffer of ours, so that splats drawn there are hidden by the host's scene.
#pragma once

#include "context.h"

namespace nacre {

/// Attaches the depth of the framebuffer `host` to `ours`, bound as draw framebuffer, or, where GL cannot share it (window, multisampled), a
/// copy of the pixels of `viewport`. A host without a depth buffer: nothing, and every test passes.
Failure attachHostDepth(Context& context, GLuint host, GLuint ours, const float viewport[4]);
void detachHostDepth(const Gl& gl);
void freeDepthCopy(Context& context);

} // namespace nacre
