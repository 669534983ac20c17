// Internal to dataset/: the parts of examineDataset, each of which looks at the same few images.
#pragma once

#include "dataset/normalise.h"
#include "dataset/olat_dataset.h"

#include <memory>
#include <string>
#include <vector>

namespace nacre {

/// One image that the checks look at.
struct CheckedView {
    const OlatSplit* split;
    size_t index; // of the image in its split
    const Camera* camera;
    const OlatImage* image;
    std::shared_ptr<const Image> pixels;
};

constexpr float kInside = 0.5f; // alpha of the silhouette

/// The world position that a description states for a point light.
inline glm::dvec3 statedPosition(const Light& light) { return glm::dvec3(light.position) + glm::dvec3(light.positionRest); }

/// shading_check.cpp: whether images get brighter towards their lights. Fills SplitFigures::agreement.
void checkShading(const OlatDataset& dataset, const std::vector<CheckedView>& views, const Framing& framing, DatasetExamination& out);

/// hull_check.cpp: whether the silhouettes of all cameras are those of one object. Fills SplitFigures::uncovered.
void checkHull(const std::vector<CheckedView>& views, const Framing& framing, DatasetExamination& out);

/// units_check.cpp: lengths, intensities and intrinsics that only a wrong unit explains. Fills DatasetExamination::reflectance.
Status checkUnits(const OlatDataset& dataset, const Framing& framing, ImageCache& images, DatasetExamination& out);

std::string briefly(double x);            // "%.3g"
std::string briefly(const glm::vec3& v);  // "(x, y, z)"

} // namespace nacre
