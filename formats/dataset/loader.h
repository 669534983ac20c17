// Internal to dataset/: what a loader gets, what it gives, and the helpers all loaders share.
// A new convention = one file in loaders/, two declarations below, one line in the table of olat_dataset.cpp.
#pragma once

#include "dataset/olat_dataset.h"
#include "interchange/json.h"

#include <array>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace nacre {

/// One transforms_<split>.json.
struct Description {
    std::string folder; // its folder relative to the dataset: "" or "olat_12"
    std::string split;
    JsonDocument json;
    JsonNode frames() const { return json.root()["frames"]; }
};

/// Everything a loader sees of the outside world, so that a fuzzer can run loaders without a disk.
struct DatasetSource {
    std::string path;
    std::vector<Description> descriptions;                          // train first, then test, then by name; olat_* by number
    std::string excludeList;                                        // text of exclude_list.txt, empty if there is none
    std::function<bool(const std::string&)> fileExists;
    std::function<Result<Image>(const std::string&)> readImageSize; // `rgba` stays empty
};

/// Picks the loader, runs it, checks the result. loadDataset = read the disk + this.
Result<OlatDataset> loadFrom(const DatasetSource& source);

bool isCanonical(const DatasetSource& source);
bool isPlpos(const DatasetSource& source);
bool isSssgs(const DatasetSource& source);
bool isBigs(const DatasetSource& source);
Status loadCanonical(const DatasetSource& source, OlatDataset& out);
Status loadPlpos(const DatasetSource& source, OlatDataset& out);
Status loadSssgs(const DatasetSource& source, OlatDataset& out);
Status loadBigs(const DatasetSource& source, OlatDataset& out);

/// True if the first frame of any description has `key`.
bool anyFrameHas(const DatasetSource& source, const char* key);

/// ".exr", in lower case.
std::string extensionOf(const std::string& path);

// ---- Readers: a mismatch is recorded in the node's document, a harmless value comes back. ----

/// 4x4 row-major camera-to-world, OpenGL camera axes.
glm::dmat4 readPose(const JsonNode& matrix);

/// Accepts a pose that is rigid to 1e-3 and removes what is left of scale and shear; otherwise records a mismatch at `node`.
glm::dmat4 rigidPose(const glm::dmat4& pose, const JsonNode& node);

/// Focal lengths and principal point, from the frame or else from the top level. In each: `camera_intrinsics` [cx, cy, fx, fy],
/// else `fl_x` (and `fl_y`), else `camera_angle_x` (radians, horizontal, square pixels); `cx`, `cy` default to the centre.
void readIntrinsics(const JsonNode& frame, const JsonNode& top, Camera& camera);

glm::vec3 readVec3(const JsonNode& node);
glm::vec3 readIntensity(const JsonNode& node); // a scalar or [r, g, b], not negative

/// `file` relative to `folder` of the dataset; a mismatch at `node` if it does not exist.
std::string findImage(const DatasetSource& source, const std::string& folder, const std::string& file, const JsonNode& node);

/// Size of the images of a split whose description does not say: that of the first one. The rest is checked when loaded.
class SizeFromFirstImage {
public:
    explicit SizeFromFirstImage(const DatasetSource& source) : source_(source) {}
    Status apply(const std::string& imagePath, Camera& camera);

private:
    const DatasetSource& source_;
    int width_ = 0, height_ = 0;
};

/// Collects images; cameras with equal pose and intrinsics share one entry.
class SplitBuilder {
public:
    explicit SplitBuilder(std::string name) { split.name = std::move(name); }
    void add(const Camera& camera, const Light& light, std::string path);
    OlatSplit split;

private:
    std::map<std::array<double, 22>, uint32_t> indexOfCamera_;
};

/// The intensity for data that has none: a white diffuse surface facing the light from the origin gets radiance 1 at the
/// mean distance of the lights of the first split, so I = pi * mean(r)^2. One value for the whole dataset.
float conventionalIntensity(const std::vector<OlatSplit>& splits);

/// The world axis that the cameras' own up vectors agree on (object captures keep the camera upright).
glm::vec3 upFromCameras(const std::vector<OlatSplit>& splits);

} // namespace nacre
