// How fast a machine draws splats: a few slopes, by which what was measured on one machine says something of another.
#pragma once

#include "base/result.h"
#include "report/fronts.h"

#include <string>

namespace nacre::report {

/// Of one appearance model, on a ball of splats that all machines draw alike.
struct DeviceSlopes {
    double relightNs = 0; // per splat and light
    double sortNs = 0;    // per splat
    double rasterNs = 0;  // per pixel that a splat covers: of splats 0.01 wide of a ball that is 300 pixels wide
};

struct DeviceProfile {
    std::string machine, renderer;
    DeviceSlopes bigs, sss;
};

/// Seconds. Error kGpu: no OpenGL.
Result<DeviceProfile> measureDevice(const Says& says);

std::string profileJson(const DeviceProfile& profile);
/// Errors kBadInput: not what profileJson writes.
Result<DeviceProfile> readProfile(const std::string& path);

/// What a frame that took `here` on one machine takes on another: each part by the ratio of its slopes.
VariantTime onDevice(const VariantTime& time, const std::string& model, const DeviceProfile& here, const DeviceProfile& there);

} // namespace nacre::report
