// What the host has bound to draw into.
#pragma once

#include "context.h"

namespace nacre {

/// Fails if it is incomplete or, where colours are drawn, holds integers.
Failure checkTarget(const Gl& gl, bool colors = true);

/// Largest value that it holds; splat colours stop there.
float largestColor(const Gl& gl);

} // namespace nacre
