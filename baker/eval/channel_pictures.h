// What an image is made of, as pictures: every part of an asset (appearance/shown_part.h) from one camera under some lights.
#pragma once

#include "appearance/sss/sss_edit.h"
#include "base/camera.h"
#include "base/image.h"
#include "base/light.h"
#include "base/result.h"
#include "eval/contact_sheet.h"
#include "splats/splat_asset.h"

#include <span>
#include <string>
#include <vector>

namespace nacre {

struct ChannelPicture {
    std::string name;  // of PartInfo
    std::string scale; // what the picture shows of the values, such as "black 0, white 0.79"; always there
    Picture picture;   // for a screen
    Image values;      // as makePartRenderer draws them
};

/// One part by its name. Camera, lights and regions of edits are in axes and units of the dataset; lights are points and directional
/// (rendererLights expands others). On the CPU by the scalar reference, in the threads of the caller; the asset must have its maps drawn (openAsset).
/// Error kBadInput, on one line with the names that the asset has, if it has no such part.
Result<ChannelPicture> channelPicture(const SplatAsset& asset, const std::string& name, const Camera& camera, std::span<const Light> lights,
                                      std::span<const SplatEdit> edits = {});

/// All that the asset has, in the order of partsOf. Each picture of numbers has its own scale.
Result<std::vector<ChannelPicture>> channelPictures(const SplatAsset& asset, const Camera& camera, std::span<const Light> lights,
                                                    std::span<const SplatEdit> edits = {});

/// Four a row, each beneath its name and scale.
Picture channelSheet(std::span<const ChannelPicture> channels);

} // namespace nacre
