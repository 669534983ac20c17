// One-light-at-a-time (OLAT) data: the one struct every loader fills and the rest of Nacre reads.
#pragma once

#include "base/asset_frame.h"
#include "base/camera.h"
#include "base/image.h"
#include "base/light.h"
#include "base/result.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nacre {

enum class ColorSpace : uint8_t { kLinear, kSrgb };

/// How the pixels of a file were taken, where that is not the pinhole camera that the dataset gives for it: a lens (the rational model of OpenCV,
/// calib3d: radial k1..k6, tangential p1, p2), or a larger image that the camera is a part of.
struct FileCamera {
    int width = 0, height = 0;
    double fx = 0, fy = 0, cx = 0, cy = 0; // pixels of the file
    double k[6] = {}, p[2] = {};
    bool operator==(const FileCamera&) const = default;
};

struct OlatImage {
    uint32_t camera = 0;   // index into OlatSplit::cameras
    Light light;           // in the cameras' world frame; intensity includes any per-image gain
    std::string path;      // absolute or relative to the process
    std::string maskPath{};    // coverage of the object; empty: the file's own alpha
    std::string ambientPath{}; // the same view and exposure with its light off, which is subtracted; empty: there is none
    glm::vec3 gain{1.0f};      // what the file's linear values are multiplied by to be in the unit of the lights: 1 / exposure
    uint32_t packedBlock = 0;  // where OlatDataset::packed has its pixels
};

/// What the lights of a dataset are fixed to: nothing, one flash to the camera (the stated places are nominal), or all of them to a stage that may be
/// turned as one.
enum class LightRig : uint8_t { kFixed, kCamera, kStage };

class PackedImages; // packed_images.h

struct OlatSplit {
    std::string name;               // "train", "test", "near", "directional", "environment", ...
    std::vector<Camera> cameras;    // distinct cameras: frames that share pose and intrinsics share one entry
    std::vector<OlatImage> images;  // in file order
    std::vector<FileCamera> files{}; // of each camera; empty: all files are as their cameras are
};

struct OlatDataset {
    std::string path;
    std::string convention;         // "canonical", "plpos", "sssgs", "bigs"
    ColorSpace colorSpace = ColorSpace::kLinear; // of PNG and JPEG files (EXR is linear); loaded images are always linear
    bool colorSpaceIsGuess = false; // nothing but the kind of file says so: a PNG that says otherwise (gAMA) is believed
    bool premultiplied = true;      // of the files; loaded images always are
    bool straightPng = false;       // PNG files beside EXR ones: straight, whatever `premultiplied` says
    glm::vec3 up{0, 0, 1};          // which world axis is up
    AssetFrame frame;               // of the cameras and lights below in what the files state (normalise.h)
    float blackLevel = 0;           // file value, 0 to 1, that is black; this and the next of PNG and JPEG files, of EXR ones if there are no others
    float whiteLevel = 0;           // file value from which a channel is saturated; 0: the largest of an 8- or 16-bit file, none of an EXR
    bool backgroundInView = false;  // files show the surroundings and have no masks: the alpha of all pixels is 1 and means nothing
    LightRig rig = LightRig::kFixed;
    int shrink = 1;                 // loaded images are means over so many pixels of the file in each direction; cameras are of these
    std::vector<OlatSplit> splits;
    std::shared_ptr<const PackedImages> packed; // of a prepared dataset: its images, instead of the files, which need not be there any more
    std::vector<std::string> warnings; // one line each; never printed by the library

    const OlatSplit* find(const std::string& name) const
    {
        for (const OlatSplit& s : splits)
            if (s.name == name) return &s;
        return nullptr;
    }
};

/// Recognises the convention and reads the description files; images stay on disk. A folder of `nacre prepare` is a dataset, too.
/// Errors kBadInput: nothing recognised, broken JSON, missing key, non-finite or non-rigid pose, missing image file, empty split.
Result<OlatDataset> loadDataset(const std::string& path);

/// The same with images of half the width and height: a quarter of the work to look at. An odd last row or column is not seen.
OlatDataset halved(OlatDataset dataset);

/// Loads images on demand and keeps the most recent within `budgetBytes`. Safe to call from several threads.
class ImageCache {
public:
    ImageCache(const OlatDataset& dataset, size_t budgetBytes);
    ~ImageCache();
    /// Linear, premultiplied, developed (develop.h), size checked against the camera, finite, alpha in [0, 1] (1 if the file has none) or
    /// kUnknownAlpha. Alpha that a filter left a little outside is clamped, and a PNG's own word on its colours (gAMA) holds where the dataset has none.
    Result<std::shared_ptr<const Image>> load(const OlatSplit& split, size_t imageIndex);
    /// What was found in the files loaded so far that may not be meant: one line a kind, with their number and the first.
    std::vector<std::string> notes() const;
    size_t residentBytes() const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Looks at some images for alpha that is straight where it should be premultiplied (or the other way round), inverted, faint or empty, and
/// passes on what the cache noted. One line per suspicion; images that cannot be loaded are left out.
std::vector<std::string> checkAlpha(const OlatDataset& dataset, ImageCache& images);

/// How well the parts of one split fit together.
struct SplitFigures {
    std::string split;
    std::optional<double> agreement; // mean cosine between the directions that images look lit from and their lights: 0.8 to 0.95 is right
    std::optional<double> uncovered; // share of the silhouettes that the training silhouettes exclude: 0.00 is right
};

/// What is probably wrong with a dataset, and the figures that say so.
struct DatasetExamination {
    std::vector<std::string> warnings;  // one line each: what was found, what is right, the probable cause, what to try
    std::vector<SplitFigures> splits;
    std::optional<double> reflectance;  // apparentReflectance of the train split
};

/// Looks at checkAlpha, at geometry and at some pixels for a convention that was misread: cameras look at the object, silhouettes are of one object, lights
/// lie outside it, shading agrees with the lights, lengths and intensities are in one unit.
Result<DatasetExamination> examineDataset(const OlatDataset& dataset, ImageCache& images);

/// Its warnings alone.
Result<std::vector<std::string>> checkConventions(const OlatDataset& dataset, ImageCache& images);

} // namespace nacre
