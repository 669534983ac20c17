// An asset under lights that stay as they are, for viewers that cannot relight.
#pragma once

#include "base/light.h"
#include "base/result.h"
#include "splats/plain_splats.h"

#include <atomic>
#include <functional>
#include <span>

namespace nacre {

struct SnapshotOptions {
    bool srgb = true;    // colours as most viewers blend them: encoded; what is brighter than white is cut there. Else linear radiance
    double exposure = 1; // scales all lights
};

/// Fits 16 spherical harmonics per splat to what it sends out under `lights` (point and directional, in axes and units of the dataset), most
/// closely in the directions from which the other splats do not hide it. Splats stay in the asset's frame.
/// Models that shade pixels, not splats (sss), are evaluated once per splat: highlights between its splats' normals get blurred.
/// `goOn`, if given, is asked now and then with the share that is done; false ends with kCancelled. Same result for any number of threads.
Result<PlainSplats> litSnapshot(const SplatAsset& asset, std::span<const Light> lights, const SnapshotOptions& options,
                                const std::function<bool(double)>& goOn = {});

/// A look that is blended in the other colour space: fitted again to its own colours, converted.
void changeColorSpace(bool srgb, PlainSplats& splats);

} // namespace nacre
