// The constants of splat blending, the same in every backend (CPU scalar, CPU SIMD, CUDA, GLSL).
#pragma once

namespace nacre {

constexpr float kNearPlane = 0.01f;         // asset units; splat centres nearer than this are culled
constexpr float kMinAlpha = 1.0f / 255.0f;  // a splat below this is skipped at a pixel
constexpr float kMaxAlpha = 0.995f;         // a splat never blocks everything: keeps 1/(1 - alpha) bounded in the backward pass
constexpr float kMinTransmittance = 1e-4f;  // a pixel whose transmittance has fallen below this is finished (front to back only)
constexpr float kJacobianMargin = 0.3f;     // the affine approximation is frozen this fraction of the half-frame outside the image

} // namespace nacre
