// OLAT datasets out: the inverse of the loaders, for every convention that loadDataset reads.
//
// Use: fitToConvention() once, writeDatasetImage() per image, then the files of describeSplit() when all images of the split are there.
#pragma once

#include "dataset/olat_dataset.h"

#include <span>
#include <string>
#include <vector>

namespace nacre {

/// "canonical", "plpos", "sssgs", "bigs", "colmap", "rene".
std::span<const char* const> writableConventions();

/// Makes the dataset what `convention` can say, with one line in `warnings` for each thing left out (splits whose lights it has no words
/// for). Sets the colour space and alpha of the files, turns the world so that the axis the convention expects is up, sorts splits as the
/// loader will, and names the image files: OlatImage::path becomes relative to the dataset's folder.
/// Errors kBadInput: nothing left to write; canonical: two image sizes in a split; bigs: a test light with several cameras;
/// rene: two camera models.
Result<OlatDataset> fitToConvention(OlatDataset dataset, const std::string& convention);

/// One image in the dataset's file format: `image` is linear, premultiplied. Written atomically to `path`.
Status writeDatasetImage(const OlatDataset& dataset, const Image& image, const std::string& path);

/// A text file, path relative to the dataset's folder.
struct DescriptionFile {
    std::string path, text;
};

/// The description files of one split of a fitted dataset. Environment maps lie in the folder `dataset.path`.
/// `topLevel` is the text of a JSON object whose members join the top level of every file.
std::vector<DescriptionFile> describeSplit(const OlatDataset& dataset, const OlatSplit& split, const std::string& topLevel);

} // namespace nacre
