// Under how much light a model learns best.
#pragma once

#include "dataset/olat_dataset.h"
#include "splats/splat_asset.h"

namespace nacre {

/// The factor on all lights under which `model` learns the dataset best; 1 for most datasets and sss, whose base colours then are those of the
/// object. Errors: those of loading an image.
Result<double> learningGain(const OlatDataset& dataset, const std::string& model);

/// `dataset` under lights that many times as bright; its frame says so.
OlatDataset underGain(OlatDataset dataset, double gain);

/// An asset that learnt under lights `gain` times as bright becomes one for the lights as stated, if its model is linear in light: then its
/// channels take the factor. Else its frame keeps it. `stated` is the frame of the dataset without the gain.
void absorbGain(SplatAsset& asset, double gain, const AssetFrame& stated);

} // namespace nacre
