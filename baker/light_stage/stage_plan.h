// Who looks and what shines: the cameras, lights and splits of a light stage, before anything is rendered.
#pragma once

#include "base/image.h"
#include "dataset/olat_dataset.h"

#include <cstdint>
#include <string>
#include <vector>

namespace nacre {

enum class StageLayout : uint8_t {
    kRings,     // equal steps in elevation, as many lights on each ring, every other ring turned by half a step (SSS-GS's stage)
    kFibonacci, // equal areas on a spiral
    kGrid,      // equal steps in azimuth and in the sine of the elevation: equal areas in rows and columns
};

/// Lengths are in multiples of the object's bounding radius.
struct StageOptions {
    int cameras = 75;              // of train
    int lights = 112;              // of the stage
    int lightsPerCamera = 4;       // 0: all
    StageLayout layout = StageLayout::kRings;
    bool fullSphere = false;       // cameras and lights all around; else the upper half (cameras down to a little below the horizon)
    double lightRadius = 5.0;
    double cameraDistance = 3.2;
    double fovDegrees = 0.0;       // horizontal; 0: the bounding sphere spans kFill of the shorter side of the image
    int width = 256, height = 256;
    uint64_t seed = 1;
    std::vector<std::string> environments; // maps of the split `environment`, in turn
    glm::dvec3 center{0.0};        // of the object, in the world
    double objectRadius = 1.0;
};

// What the numbers of images are, beside train. All lights and cameras of these splits, all_on's cameras excepted, are new.
constexpr int kTestImages = 24, kNearImages = 6, kDirectionalImages = 6, kEnvironmentImages = 6, kAllOnCameras = 12;
constexpr double kFill = 0.9138;        // the sphere of radius 1 at distance 3.2 in a field of view of 39.6 degrees (a 50 mm lens)
// Exposure. Irradiance facing the light: 60 / 5^2, so that a white diffuse surface shows 0.76; a little more for near lights.
constexpr double kIrradiance = 2.4, kNearIrradiance = 3.6;
constexpr double kAllOnGain = 2.0;      // all_on: each of n lights at kAllOnGain / n of its power, so that the sum is not overexposed
constexpr double kNearestLight = 1.6, kFarthestNear = 0.8; // radii of near lights: from 1.6 to 0.8 lightRadius

/// "train", "test", "near", "directional", "environment", "all_on".
const std::vector<std::string>& stageSplits();

/// The plan in a world with +Z up: image paths are empty. Splits come in the order of stageSplits; each depends on the options and its
/// own name only, so that splits can be made one by one. `options` are checked by checkStage.
OlatDataset planStage(const StageOptions& options, const std::vector<std::string>& splits);

/// Error kBadInput: a number out of range, more lights per camera than lights, an unknown layout of sizes.
Status checkStage(const StageOptions& options);

/// The focal length of the stage's cameras.
double stageFocalPixels(const StageOptions& options);

/// A camera at `position` that looks at `target`, with +Z up in the picture.
Camera lookAt(const glm::dvec3& position, const glm::dvec3& target, int width, int height, double focalPixels);

/// Procedural radiance maps for the split environment, 128 x 64, +Z up: a low sun in a clear evening sky; a dark room with soft boxes.
Image sunsetMap();
Image studioMap();

} // namespace nacre
