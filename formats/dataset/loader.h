// Internal to dataset/: what a loader gets, what it gives, and the helpers all loaders share.
// A new convention = one file in loaders/, two declarations below, one line in the table of olat_dataset.cpp.
#pragma once

#include "base/text.h"
#include "dataset/olat_dataset.h"
#include "interchange/json.h"

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <span>
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
    std::vector<Description> descriptions;                          // train first, then test, then by name; olat_* by number; none for some conventions
    std::optional<Description> lights;                              // lights.json: a light table, and keys of top levels
    std::string excludeList;                                        // text of exclude_list.txt, empty if there is none
    std::function<bool(const std::string&)> fileExists;
    std::function<Result<Image>(const std::string&)> readImageSize; // from the file's header; `rgba` stays empty
    std::function<std::vector<std::string>(const std::string&)> list; // the names in a folder, sorted; none if it is none
    std::function<Result<std::vector<std::byte>>(const std::string&)> readFile;

    // What loaders leave here as they go.
    struct Missing {
        size_t count = 0;
        JsonNode first{nullptr, nullptr, ""}; // the key that named it
        std::string path;
    };
    mutable Missing missing;                 // images and maps that are not there: one error tells their number
    mutable std::array<int, 2> lastSize{};   // of the last image whose header was read

    std::string pathOf(const std::string& relative) const;
    std::vector<const Description*> topLevels() const; // descriptions and lights.json
    Status firstMismatch() const;
};

/// Picks the loader, runs it, checks the result. loadDataset = read the disk + this.
Result<OlatDataset> loadFrom(const DatasetSource& source);

bool isCanonical(const DatasetSource& source);
bool isPlpos(const DatasetSource& source);
bool isSssgs(const DatasetSource& source);
bool isBigs(const DatasetSource& source);
bool isNerf(const DatasetSource& source);
bool isOpenIllumination(const DatasetSource& source);
bool isDiligent(const DatasetSource& source);
bool isRene(const DatasetSource& source);
bool isColmap(const DatasetSource& source);
Status loadCanonical(const DatasetSource& source, OlatDataset& out);
Status loadPlpos(const DatasetSource& source, OlatDataset& out);
Status loadSssgs(const DatasetSource& source, OlatDataset& out);
Status loadBigs(const DatasetSource& source, OlatDataset& out);
Status loadNerf(const DatasetSource& source, OlatDataset& out);
Status loadOpenIllumination(const DatasetSource& source, OlatDataset& out);
Status loadDiligent(const DatasetSource& source, OlatDataset& out);
Status loadRene(const DatasetSource& source, OlatDataset& out);
Status loadColmap(const DatasetSource& source, OlatDataset& out);

/// True if the first frame of any description has `key`.
bool anyFrameHas(const DatasetSource& source, const char* key);

/// ".exr", in lower case.
std::string extensionOf(const std::string& path);

// ---- Readers: a mismatch is recorded in the node's document, a harmless value comes back. ----

/// `transform_matrix` of a frame: 4x4 row-major camera-to-world. Camera axes are OpenGL's (y up, z backwards), or OpenCV's if the frame or the top
/// level says "camera_axes": "opencv".
glm::dmat4 readPose(const JsonNode& frame, const JsonNode& top);

/// Accepts a pose that is rigid to 1e-3 and removes what is left of scale and shear; otherwise records a mismatch at `node`, which names
/// a transposed matrix and one scale for all axes.
glm::dmat4 rigidPose(const glm::dmat4& pose, const JsonNode& node);
/// The same for files that are not JSON: nothing after success.
struct Mismatch {
    std::string expected, found;
};
std::optional<Mismatch> makeRigid(glm::dmat4& pose);

/// Pose and position from a 4x4 matrix of a file.
struct Matrix;
Result<glm::dmat4> poseOf(const Matrix& worldFromCamera, const std::string& name);

/// The pose for OpenGL camera axes of one for OpenCV's (x right, y down, z forward).
glm::dmat4 fromOpenCv(glm::dmat4 worldFromCamera);

/// What of size, focal lengths and principal point cannot be meant.
std::optional<Mismatch> cameraFault(const Camera& camera);

/// Size of the image: `width` (or `w`), `height` (or `h`), from the frame or else from the top level, else from the file's header.
/// A file that cannot be read (it may only be damaged) counts as large as the one before. False if that leaves the size unknown; then an error
/// is recorded, or the missing file is.
bool readSize(const DatasetSource& source, const JsonNode& frame, const JsonNode& top, const std::string& imagePath, Camera& camera);

/// Focal lengths and principal point, from the frame or else from the top level. In each: `camera_intrinsics` [cx, cy, fx, fy],
/// else `fl_x` or `camera_angle_x` and `fl_y` or `camera_angle_y` (radians), of which one is enough for square pixels; two for the same must
/// agree. `cx`, `cy` default to the centre. The lens: `k1`..`k6`, `p1`, `p2` as OpenCV means them, or one of the usual lists of them; if it bends
/// anything, how the file was taken comes back, and `camera` is a pinhole with the same size and focal lengths. Fisheyes, and whatever has other
/// terms than these, are mismatches of code kUnsupported.
std::optional<FileCamera> readIntrinsics(const JsonNode& frame, const JsonNode& top, Camera& camera);

/// The models of COLMAP that are a pinhole and OpenCV's lens: parameters are f or fx, fy, then cx, cy, then k1, k2, p1, p2, k3..k6 as far as they go.
struct CameraModel {
    const char* name;
    int id;        // in binary models
    size_t count;  // of parameters
    size_t lensAt; // the first of the lens
};
std::span<const CameraModel> cameraModels();
const CameraModel* findCameraModel(const std::string& name); // in capitals; null if it is none of them
void setLens(const CameraModel& model, std::span<const double> parameters, double k[6], double p[2]);

/// The file of a camera that looks through such a lens; nothing if the lens bends nothing.
std::optional<FileCamera> fileCamera(const Camera& camera, const double k[6], const double p[2]);

/// Error if the headers of most files give another size than the description.
Status checkSizes(const DatasetSource& source, const OlatDataset& dataset);

/// Warns of intrinsics that are possible and yet are hardly meant: principal point far off, very short focal lengths, oblong pixels.
void checkIntrinsics(OlatDataset& dataset);

/// What the top levels say of how colours are stored: `color_space` "linear" | "srgb", `alpha` "straight" | "premultiplied". Splits that
/// disagree are mismatches.
struct FileColors {
    std::optional<ColorSpace> colorSpace;
    std::optional<bool> premultiplied;
};
FileColors readFileColors(const DatasetSource& source);

glm::vec3 readVec3(const JsonNode& node);
/// The position of a point light, to more digits than float32 has (Light::positionRest).
void readLightPosition(const JsonNode& node, Light& light);
glm::vec3 readIntensity(const JsonNode& node); // a scalar or [r, g, b], not negative

/// `file` relative to `folder` of the dataset: with the extension `assumed`, as it is, or with one of the usual ones; capitals of the extension
/// do not matter. What does not exist is counted in source.missing.
std::string findImage(const DatasetSource& source, const std::string& folder, const std::string& file, const JsonNode& node,
                      const std::string& assumed = "");

/// Collects images; cameras with equal pose and intrinsics share one entry.
class SplitBuilder {
public:
    explicit SplitBuilder(std::string name) { split.name = std::move(name); }
    void add(const Camera& camera, const Light& light, std::string path);
    /// `image.camera` is set here. `file`: how its pixels were taken, if not as the camera says.
    void add(const Camera& camera, OlatImage image, const std::optional<FileCamera>& file);
    OlatSplit split;

private:
    std::map<std::array<double, 36>, uint32_t> indexOfCamera_;
};

/// What a frame, or else the top level, says of its photograph: `mask_path` (or `obj_mask_path`), `ambient_path`, `exposure_ev` (file values are
/// 2^ev times the radiance) and `gain` (a number or [r, g, b]: so many times). Paths are relative to `folder` of the dataset.
void readPhotograph(const DatasetSource& source, const std::string& folder, const JsonNode& frame, const JsonNode& top, OlatImage& image);

/// What the top levels say of the whole capture: `black_level`, `white_level` (file values, 0 to 1), `background` "black" | "in_view", `light_rig`
/// "fixed" | "camera" | "stage". Splits that disagree on levels or rig are mismatches; the background is that of the train split.
void readCapture(const DatasetSource& source, OlatDataset& out);

/// The intensity for data that has none: a white diffuse surface facing the light from where the cameras look gets radiance 1 at the
/// mean distance of the lights of the first split, so I = pi * mean(r)^2. One value for the whole dataset.
float conventionalIntensity(const std::vector<OlatSplit>& splits);

/// Multiplies intensities of a dataset that has none: points get conventionalIntensity, directional lights pi, for the same radiance.
void scaleByConvention(OlatDataset& dataset);

/// One photograph before it has a light.
struct Photo {
    std::string name; // as its description has it, relative to the folder of images
    std::string path;
    std::string split; // empty: whatever the table says
    Camera camera;
    std::optional<FileCamera> file;
    OlatImage image{}; // masks and exposure, as far as known
};

/// True if the dataset has a light table (light_table.cpp), or says that its light is fixed to the camera.
bool hasLightTable(const DatasetSource& source);

/// Puts photographs and the light table together, into splits. `out.colorSpace` and the like are the caller's.
Status lightPhotos(const DatasetSource& source, std::vector<Photo> photos, OlatDataset& out);

/// The world axis that the cameras' own up vectors agree on (object captures keep the camera upright).
glm::vec3 upFromCameras(const std::vector<OlatSplit>& splits);

} // namespace nacre
