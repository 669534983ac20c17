// The host's depth buffer under a framebuffer of ours, so that splats drawn there are hidden by the host's scene.
#pragma once

#include "context.h"

namespace nacre {

/// Attaches the depth of the framebuffer `host` to `ours`, bound as draw framebuffer, or, where GL cannot share it (window, multisampled), a
/// copy of the pixels of `viewport`. A host without a depth buffer: nothing, and every test passes.
Failure attachHostDepth(Context& context, GLuint host, GLuint ours, const float viewport[4]);
/// For shaders of GL 4.3: copies the depth of the framebuffer `host`, pixels of `viewport`, into context.depthCopy.texture, texel (x, y) for
/// pixel (x, y) of the window, and leaves it bound to texture unit 0. kNone: there is no depth buffer, every test passes. kCannot: it is
/// multisampled.
enum class HostDepth { kNone, kCopied, kCannot };
HostDepth copyHostDepth(Context& context, GLuint host, const float viewport[4]);
void detachHostDepth(const Gl& gl);
void freeDepthCopy(Context& context);

} // namespace nacre
