// The convention of the SSS-GS dataset: one frame = one camera under many lights.
//
//   transforms_<split>.json: camera_angle_x at top level (or fl_x, fl_y per frame); frames:
//     transform_matrix (camera-to-world, OpenGL), width, height, optional cx, cy
//     file_paths (".png" is appended where it lacks) and light_positions, index-aligned, in the world frame of the poses (real captures turn the
//     object, so the lights differ per frame); optional light_intensities: [r, g, b] multipliers
//   exclude_list.txt: one image stem per line (with or without .png) that must not be used.
// Images: 8-bit sRGB PNG, premultiplied on black (see image_cache.cpp for the order). There is no calibrated intensity.
#include "dataset/loader.h"

#include "interchange/image_file.h"

#include <filesystem>
#include <set>
#include <sstream>

namespace nacre {
namespace {

/// The file's name without the extension of an image; other dots belong to the name.
std::string stemOf(const std::string& file)
{
    const std::filesystem::path name = std::filesystem::path(file).filename();
    return (imageKind(file) == ImageKind::kNone ? name : name.stem()).string();
}

std::set<std::string> excludedStems(const std::string& text)
{
    std::set<std::string> stems;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
        const size_t end = line.find_last_not_of(" \t\r");
        if (end == std::string::npos) continue;
        line.resize(end + 1);
        stems.insert(stemOf(line));
    }
    return stems;
}

} // namespace

bool isSssgs(const DatasetSource& source) { return anyFrameHas(source, "file_paths"); }

Status loadSssgs(const DatasetSource& source, OlatDataset& out)
{
    const std::set<std::string> excluded = excludedStems(source.excludeList);
    size_t excludedCount = 0, allOnCount = 0;
    for (const Description& description : source.descriptions) {
        const JsonNode top = description.json.root();
        SplitBuilder builder(description.split);
        for (const JsonNode& frame : description.frames().items()) {
            Camera camera;
            std::optional<FileCamera> lens;
            camera.worldFromCamera = readPose(frame, top);
            const std::vector<JsonNode> files = frame["file_paths"].items(), positions = frame["light_positions"].items();
            const std::vector<JsonNode> gains = frame["light_intensities"].exists() ? frame["light_intensities"].items() : std::vector<JsonNode>();
            if (positions.size() != files.size())
                frame["light_positions"].fail(std::to_string(files.size()) + " positions like file_paths", std::to_string(positions.size()));
            if (!gains.empty() && gains.size() != files.size())
                frame["light_intensities"].fail(std::to_string(files.size()) + " entries like file_paths", std::to_string(gains.size()));
            if (description.json.failed()) return description.json.error();

            for (size_t i = 0; i < files.size(); i++) {
                const std::string file = files[i].string();
                const std::string stem = stemOf(file);
                if (excluded.count(stem)) {
                    excludedCount++;
                    continue;
                }
                if (stem.ends_with("_all_on")) { // every light at once: not one light at a time
                    allOnCount++;
                    continue;
                }
                Light light;
                readLightPosition(positions[i], light);
                light.intensity = gains.empty() ? glm::vec3(1.0f) : readIntensity(gains[i]);
                const std::string path = findImage(source, "", file, files[i], ".png");
                if (camera.width == 0) { // once for all lights of the frame
                    if (readSize(source, frame, top, path, camera)) lens = readIntrinsics(frame, top, camera);
                }
                builder.add(camera, {0, light, path}, lens);
                if (description.json.failed()) return description.json.error();
            }
        }
        if (description.json.failed()) return description.json.error();
        out.splits.push_back(std::move(builder.split));
    }
    out.colorSpace = ColorSpace::kSrgb; // of PNG
    out.up = upFromCameras(out.splits);

    const float intensity = conventionalIntensity(out.splits);
    for (OlatSplit& split : out.splits)
        for (OlatImage& image : split.images) image.light.intensity *= intensity;
    out.warnings.push_back("no calibrated light intensity: a multiplier of 1 means intensity " + std::to_string(intensity) +
                           " (pi x mean light distance squared), so the asset's brightness is a convention, not a measurement");
    if (excludedCount) out.warnings.push_back(std::to_string(excludedCount) + " images left out by exclude_list.txt");
    if (allOnCount) out.warnings.push_back(std::to_string(allOnCount) + " images with all lights on left out");
    return ok();
}

} // namespace nacre
