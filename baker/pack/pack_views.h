// What a packed asset is compared under, and how far it is from the original there.
#pragma once

#include "base/camera.h"
#include "base/light.h"
#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "splats/splat_asset.h"

#include <span>
#include <vector>

namespace nacre {

/// A picture under one light, in the asset's own frame.
struct PackView {
    Camera camera;
    Light light;
};

/// Cameras and lights all around, for assets without a dataset: in turns a point light three radii away and a directional one, so bright
/// that bright parts of the object are near white. Deterministic. Error: nothing of the asset shows.
Result<std::vector<PackView>> viewsAround(const SplatAsset& asset, size_t count);

/// Evenly picked from a split (of the dataset the asset was baked from).
std::vector<PackView> viewsOf(const OlatSplit& split, const AssetFrame& frame, size_t count);

/// Of a split if one is given and has any, else all around.
Result<std::vector<PackView>> viewsFor(const SplatAsset& asset, const OlatSplit* seen, size_t count);

/// At most so many of them, evenly picked.
std::vector<PackView> someOf(std::span<const PackView> views, size_t count);

/// Mean over the views of the sum of squared blending weights of each splat: the squared error of images, in linear radiance, that a unit of
/// noise in the splat's colour makes. 0 for what is never seen.
std::vector<float> splatImportance(const SplatAsset& asset, std::span<const PackView> views);

/// Renders of an asset (expanded), to compare others with. Display space: sRGB transfer of clamped radiance; over pixels of the object.
class PackReference {
public:
    static Result<PackReference> render(const SplatAsset& asset, std::vector<PackView> views);
    /// Mean squared error; over red, green and blue.
    Result<double> error(const SplatAsset& other) const;
    /// The same over all pixels, still for each of the object: what shows around it counts as well.
    Result<double> errorEverywhere(const SplatAsset& other) const;
    std::span<const PackView> views() const { return views_; }

private:
    Result<double> errorOver(const SplatAsset& other, bool everywhere) const;

    std::vector<PackView> views_;
    std::vector<std::vector<float>> images_; // display rgb and alpha
};

} // namespace nacre
