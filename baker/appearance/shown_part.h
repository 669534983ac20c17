// What of an asset a picture shows: all of it, or one of the quantities that it is made of.
#pragma once

#include "base/result.h"
#include "splats/splat_asset.h"

#include <string>
#include <vector>

namespace nacre {

enum class ShownPart {
    kImage,
    kTDir, kTInd, kRho, kS, kVisibility,                                       // bigs
    kDirect, kIndirect, kLobe, kForward,                                       // bigs, radiance: they add up to the image
    kBaseColor, kRoughness, kMetalness, kSubsurfaceness, kResidual, kIncident, // sss
    kSpecular, kDiffuse, kScattered,                                           // sss, radiance: they add up to the image
    kNormal, kDepth, kOverdraw,
};

/// How a quantity becomes a picture for eyes: as light, as a number of [0, 1], from 0 to its largest, about 0, as a unit vector, near to far.
enum class PartRange { kColor, kUnit, kLargest, kSigned, kDirection, kDistance };

struct PartInfo {
    ShownPart part = ShownPart::kImage;
    const char* name = "image";
    PartRange range = PartRange::kColor;
    bool radiance = true; // premultiplied by coverage, as the image; else a mean over what a pixel shows. What depends on the light without being light
                          // (transports, visibility, incident, residual) is its mean over the lights, weighted by their irradiance
};

/// What the asset has, the image and the parts of its light first; parts it leaves out are not there.
std::vector<PartInfo> partsOf(const SplatAsset& asset);

/// One of them; error kBadInput, with the names of those that there are.
Result<PartInfo> findPart(const SplatAsset& asset, const std::string& name);

} // namespace nacre
