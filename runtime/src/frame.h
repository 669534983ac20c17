// The host's matrices, checked and combined: of a view once a draw, of every instance in it.
#pragma once

#include "context.h"
#include "gl_state.h"

#include <glm/glm.hpp>

namespace nacre {

/// Where an instance stands.
struct Placement {
    glm::dmat4 worldFromAsset{1}, assetFromWorld{1};
    double scale = 1;                // world length of one asset unit
    bool operator==(const Placement&) const = default;
};
/// Rotation, mirrored or not, translation and one uniform scale; anything else fails. All zero: identity.
Failure makePlacement(const float worldFromAsset[16], Placement* placement);

struct ViewFrame {
    glm::dmat4 viewFromWorld{1};
    glm::mat4 clipFromView{1};
    double viewScale = 1;            // another than 1 where the camera hangs on something scaled
    ClipControl clip;                // of the host
    bool orthographic = false;
    glm::dvec3 eye{0};               // world; where all rays meet, or, orthographic, a point that distances are counted from
    glm::dvec3 towardsEye{0};        // world, unit; orthographic only
    glm::vec4 nearPlane{0};          // dot(nearPlane, (p, 1)) > 0 for what is beyond it, view space; tilted in mirrors and water
    float nearW = 0;                 // smallest clip w of the near plane within the frustum
    glm::vec2 viewport{0};           // pixels
    bool operator==(const ViewFrame&) const = default;
};
Failure makeViewFrame(const NacreDrawDesc& desc, const ClipControl& clip, ViewFrame* frame);

struct InstanceFrame {
    glm::mat3 viewFromAsset, worldFromAsset;   // rotation and scale
    glm::vec3 viewTranslation, fromEye;        // of the asset's origin: in view space; in the world, from the eye
    glm::vec4 camera;                          // asset space: the eye and 1, or, orthographic, the direction towards it and 0
    float worldScale, viewScale;               // lengths of one asset unit in the world and in view space
    bool operator==(const InstanceFrame&) const = default;
};
InstanceFrame makeInstanceFrame(const ViewFrame& view, const Placement& placement);

/// Pixel (x, y) of the window looks from origin + x originRight + y originUp along ray + x rayRight + y rayUp (any length), in the world,
/// relative to the eye. `viewport` as in GL.
struct WindowRays {
    glm::vec3 origin, originRight, originUp, ray, rayRight, rayUp;
};
WindowRays windowRays(const ViewFrame& frame, const float viewport[4]);

} // namespace nacre
