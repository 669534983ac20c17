// Cameras and lights of the baker as the runtime's C API takes them.
#pragma once

#include "base/camera.h"
#include "base/light.h"
#include "base/result.h"

#include "nacre/nacre.h"

#include <span>
#include <vector>

namespace nacre {

/// Point and directional lights; others are kUnsupported.
Result<std::vector<NacreLight>> toNacreLights(std::span<const Light> lights);

/// The whole image of the camera, near plane as in training, infinite far plane.
NacreDrawDesc drawDescOf(const Camera& camera);

} // namespace nacre
