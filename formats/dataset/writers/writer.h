// Internal to dataset/: what the writers share. A new convention = one file here, two declarations below, one line in the table of
// dataset_writer.cpp.
#pragma once

#include "dataset/dataset_writer.h"

#include <nlohmann/json.hpp>

namespace nacre {

using Json = nlohmann::ordered_json;

// fit*: names the images of a dataset whose splits the convention has words for. describe*: `top` has the members every file shares.
Status fitCanonical(OlatDataset& dataset);
Status fitPlpos(OlatDataset& dataset);
Status fitSssgs(OlatDataset& dataset);
Status fitBigs(OlatDataset& dataset);
Status fitColmap(OlatDataset& dataset);
Status fitRene(OlatDataset& dataset);
std::vector<DescriptionFile> describeCanonical(const OlatDataset& dataset, const OlatSplit& split, const Json& top);
std::vector<DescriptionFile> describePlpos(const OlatDataset& dataset, const OlatSplit& split, const Json& top);
std::vector<DescriptionFile> describeSssgs(const OlatDataset& dataset, const OlatSplit& split, const Json& top);
std::vector<DescriptionFile> describeBigs(const OlatDataset& dataset, const OlatSplit& split, const Json& top);
std::vector<DescriptionFile> describeColmap(const OlatDataset& dataset, const OlatSplit& split, const Json& top);
std::vector<DescriptionFile> describeRene(const OlatDataset& dataset, const OlatSplit& split, const Json& top);

/// <split>/r_0007<extension>, numbered in file order.
void nameImages(OlatSplit& split, const std::string& extension);

Json rowsOf(const glm::dmat4& m); // row-major
Json toJson(const glm::vec3& v);

/// True if all cameras of the split have the same intrinsics, so that the top level can say them.
bool sharedIntrinsics(const OlatSplit& split);
/// camera_angle_x where that says everything, else fl_x, fl_y, cx, cy.
void addIntrinsics(Json& to, const Camera& camera);

DescriptionFile descriptionFile(const std::string& path, const Json& json);

} // namespace nacre
