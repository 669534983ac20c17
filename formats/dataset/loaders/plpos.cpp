// The convention of NRHints, GS^3 and RNG: one frame = one image = one point light `pl_pos`.
//
//   transforms_<split>.json: camera_angle_x or camera_intrinsics [cx, cy, fx, fy], at top level or per frame; frames:
//     file_path without extension + file_ext (by default ".png", else what is there), or img_path with extension, which wins
//     transform_matrix (camera-to-world, OpenGL), or R_opt + T_opt (GS^3's refined pose), which win
//     pl_pos, same world frame; pl_intensity optional: the power of a Blender point light in watts, so I = P / (4 pi)
// Image size comes from the files. PNG: display-encoded sRGB with straight alpha. EXR: linear, premultiplied (what Blender writes). The keys
// color_space and alpha of the top level override that.
#include "dataset/loader.h"

#include <numbers>

namespace nacre {
namespace {

/// R_opt is the transpose of the world-to-camera rotation, T_opt its translation, with OpenCV camera axes (y down, z forward).
glm::dmat4 readRefinedPose(const JsonNode& rotation, const JsonNode& translation)
{
    const std::vector<JsonNode> rows = rotation.items();
    if (rows.size() != 3) {
        rotation.fail("3 rows of 3 numbers", std::to_string(rows.size()) + " rows");
        return glm::dmat4(1.0);
    }
    glm::dmat3 worldFromCamera(1.0);
    for (int r = 0; r < 3; r++) {
        const std::vector<double> row = rows[size_t(r)].numbers(3);
        for (int c = 0; c < 3; c++) worldFromCamera[c][r] = row[size_t(c)];
    }
    const std::vector<double> t = translation.numbers(3);
    glm::dmat4 pose(worldFromCamera);
    pose[1] = -pose[1];
    pose[2] = -pose[2];
    pose[3] = glm::dvec4(worldFromCamera * -glm::dvec3(t[0], t[1], t[2]), 1.0);
    return rigidPose(pose, rotation);
}

struct FileName {
    JsonNode node;
    std::string name, extension; // the extension to try first
};

FileName fileName(const JsonNode& frame)
{
    if (frame["img_path"].exists()) return {frame["img_path"], frame["img_path"].string(), ""};
    std::string extension = frame["file_ext"].exists() ? frame["file_ext"].string() : ".png";
    if (!extension.empty() && extension[0] != '.') extension.insert(extension.begin(), '.');
    return {frame["file_path"], frame["file_path"].string(), extension};
}

/// GS^3 ships transforms_valid.json as a camera path for videos, without images.
bool isCameraPath(const DatasetSource& source, const Description& description)
{
    const JsonNode frame = description.frames().firstItem();
    if (description.split != "valid" || !(frame["file_path"].isString() || frame["img_path"].isString())) return false;
    const FileName file = fileName(frame);
    const DatasetSource::Missing before = source.missing;
    findImage(source, "", file.name, file.node, file.extension);
    const bool isMissing = source.missing.count > before.count;
    source.missing = before;
    return isMissing;
}

} // namespace

bool isPlpos(const DatasetSource& source) { return anyFrameHas(source, "pl_pos"); }

Status loadPlpos(const DatasetSource& source, OlatDataset& out)
{
    size_t withIntensity = 0, images = 0;
    for (const Description& description : source.descriptions) {
        if (isCameraPath(source, description)) {
            out.warnings.push_back("split 'valid' skipped: it has no images (a camera path)");
            continue;
        }
        const JsonNode top = description.json.root();
        SplitBuilder builder(description.split);
        for (const JsonNode& frame : description.frames().items()) {
            const FileName file = fileName(frame);
            const std::string path = findImage(source, "", file.name, file.node, file.extension);
            if (description.json.failed()) return description.json.error();

            Camera camera;
            std::optional<FileCamera> lens;
            if (readSize(source, frame, top, path, camera)) lens = readIntrinsics(frame, top, camera);
            camera.worldFromCamera = frame["R_opt"].exists() ? readRefinedPose(frame["R_opt"], frame["T_opt"]) : readPose(frame, top);
            if (frame["light"].exists()) frame["light"].fail("one light for a frame", "light beside pl_pos; leave one of them out");
            Light light;
            readLightPosition(frame["pl_pos"], light);
            images++;
            if (frame["pl_intensity"].exists()) {
                withIntensity++;
                light.intensity = readIntensity(frame["pl_intensity"]) * float(1.0 / (4.0 * std::numbers::pi));
            }
            OlatImage image{0, light, path};
            readPhotograph(source, "", frame, top, image);
            builder.add(camera, std::move(image), lens);
            if (description.json.failed()) return description.json.error();
        }
        if (description.json.failed()) return description.json.error();
        out.splits.push_back(std::move(builder.split));
    }
    out.colorSpace = ColorSpace::kSrgb; // of PNG
    out.straightPng = true;
    out.up = upFromCameras(out.splits);
    if (withIntensity == images) return ok();

    if (withIntensity > 0)
        return Error{ErrorCode::kBadInput, source.path + ": " + std::to_string(withIntensity) + " of " + std::to_string(images) +
                                               " frames have pl_intensity, expected all or none"};
    const float intensity = conventionalIntensity(out.splits);
    for (OlatSplit& split : out.splits)
        for (OlatImage& image : split.images) image.light.intensity = glm::vec3(intensity);
    out.warnings.push_back("no pl_intensity: every light gets intensity " + std::to_string(intensity) +
                           " (pi x mean light distance squared), so the asset's brightness is a convention, not a measurement");
    return ok();
}

} // namespace nacre
