// Points on the surfaces that several images show: where splats start when no silhouettes say where the object is.
#pragma once

#include "base/camera.h"

#include <glm/glm.hpp>

#include <functional>
#include <span>
#include <vector>

namespace nacre {

/// A small image for matching: brightness as displayed, negative where nothing is known.
struct StereoView {
    Camera camera;            // of these pixels
    std::vector<float> luma;  // [height][width]
};

/// Of each view, pixels whose surroundings look alike in views beside it at one depth, and at no other as much; and that points of other views confirm.
/// Brightness and contrast may differ (a flash moves with the camera), colour does not count. Depths searched are those of the ball, and some way behind it.
/// Deterministic for any number of threads. Empty once `goOn` says no.
std::vector<glm::vec3> stereoPoints(std::span<const StereoView> views, const glm::vec3& center, float radius, const std::function<bool()>& goOn = {});

} // namespace nacre
