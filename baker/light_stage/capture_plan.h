// What goes wrong between a stage and its photographs: the errors of a simulated capture, drawn once, and the truth beside what is stated.
#pragma once

#include "dataset/olat_dataset.h"
#include "light_stage/path_tracer.h"
#include "light_stage/stage_plan.h"

#include <cstdint>
#include <string>
#include <vector>

namespace nacre {

enum class CaptureKind : uint8_t {
    kStage, // many calibrated cameras and lights around the object, mattes
    kPhone, // one camera in the hand, its flash the only lamp that moves, a table and a room in view
};

/// Sizes of the errors, in the units of the option --capture. Random errors have exactly the stated root mean square over the
/// capture; what all lights have in common is not among their errors, but one of its own (`turn`), or none: who could tell brighter lamps from a brighter
/// object?
struct CaptureOptions {
    CaptureKind kind = CaptureKind::kStage;
    bool clean = false;        // the same cameras and lights without any of what follows
    double lightError = 0;     // degrees, of each light as seen from the object
    double turn = 0;           // degrees, of all lights together about the vertical
    double gain = 0;           // %, power of each light
    double pose = 0;           // degrees, rotation of each camera
    double place = 0;          // mm, position of each camera
    double exposure = 0;       // EV, each image
    double lens = 0;           // %, of plausibleLens
    double electrons = 0;      // of a saturated pixel: shot noise; 0: no noise
    double read = 0;           // electrons: noise of reading
    double jpeg = 0;           // quality; 0: PNG
    double spill = 0;          // pixels that mattes are too wide
    double holes = 0;          // in each matte
    double blank = 0;          // % of the cameras, whose matte is empty
    double backdrop = 0;       // %, radiance of what is behind the object of a stage, of a white surface under the lights
    double flash = 0;          // cm from the camera to its flash
    double beam = 0;           // intensity of the flash falls as cos^beam from the camera's axis
    double ambient = 0;        // %, of the flash: light from above and all around
    bool lightsOff = false;    // each view once more without the flash
    double size = 20;          // cm, diameter of the object
};

/// The sizes that a capture of the kind has if nothing else is said.
CaptureOptions usualCapture(CaptureKind kind);

/// The phone's training split, in truth: options.cameras views, each under the flash.
OlatSplit planPhone(const StageOptions& stage, const CaptureOptions& capture);

/// What was really there. Cameras and images are those of the stated split, in its order.
struct Capture {
    CaptureOptions options;
    OlatSplit truth;                   // the light of an image: all that shines, a group where there is ambient light
    StageOptics optics;
    std::vector<double> exposureEv;    // of each image: file values are 2^ev times the radiance
    std::vector<double> lightGain;     // of each image: true over stated power of its light
    std::vector<bool> blankMatte;      // of each camera
    glm::dvec3 flashOffset{0.0};       // in the camera's frame (right, up, back), in the unit of the dataset
    double metresPerUnit = 1.0;        // of the dataset
    uint64_t seed = 0;
};

/// Draws the errors. `dataset` is fitted to the canonical convention and states its train split truly; on return it states what
/// a user would know. `center` and `radius` are those of the object.
Capture planCapture(const CaptureOptions& options, OlatDataset& dataset, const glm::dvec3& center, double radius, uint64_t seed);

/// The truth as the text of a JSON file: poses, lights, gains, exposures, lens, offset of the flash; frames in the order of the description.
std::string truthText(const Capture& capture, const OlatSplit& stated);

/// The files of one image: the photograph, and the one without the flash if the capture takes it (`ambient`: what shines without it).
Status writePhotograph(const Capture& capture, const OlatSplit& stated, size_t image, Image radiance, const Image* ambient, const std::string& folder);
/// The matte of a camera, if the split has mattes, from any image of it.
Status writeMatte(const Capture& capture, const OlatSplit& stated, size_t image, const Image& radiance, const std::string& folder);

} // namespace nacre
