// The look of an asset in viewers that cannot relight: KHR_gaussian_splatting spherical harmonics under fixed lights.
#pragma once

#include "base/light.h"
#include "base/result.h"
#include "splats/splat_asset.h"

#include <span>
#include <vector>

namespace nacre {

/// Fits 16 SH functions per splat to its radiance under the sum of `lights` (typically the lights of the train split; at most 64,
/// evenly picked, are used; environments are skipped). The exposure is such that a white Lambertian surface at the middle of the
/// asset that faces the mean light direction has radiance 1. Same result for any number of threads.
/// Errors kBadInput: invalid asset, no point or directional light, all of them dark.
Result<NeutralLook> fitNeutralLook(const SplatAsset& asset, std::span<const Light> lights);

/// For an asset whose lights nobody knows any more: white directional lights of equal intensity from everywhere (Fibonacci directions), as
/// many as fitNeutralLook uses for this asset (64 for bigs, fewer for sss).
std::vector<Light> neutralLights(const SplatAsset& asset);

} // namespace nacre
