// The convention of the BiGS dataset (rendered with Mitsuba): one folder per light.
//
//   olat_<i>/transforms_train.json: camera_angle_x, fl_x, fl_y, cx, cy, w, h at top level, each may be overridden per frame; frames:
//     file_path (with extension, relative to the folder), transform_matrix (camera-to-world, OpenGL),
//     light {position, intensity: scalar or [r, g, b]}, irradiance = intensity / r^2
// Light positions are in Mitsuba's frame: half a turn about +Y away from the cameras', so they are multiplied by (-1, +1, -1).
// Images: linear EXR, straight alpha. World +Y up.
// Splits: the published sets light every training camera with each training light and give each test light one camera of its own;
// so a light folder with more than one camera belongs to "train", with one camera to "test". olat_all_on (all lights at once, for
// the authors' geometry stage) is not used. Coverage is the alpha of the EXR, within obj_mask_path (above 0: the object) where that file is there.
#include "dataset/loader.h"

#include <filesystem>

namespace nacre {
namespace {

const glm::vec3 kWorldFromLightFrame(-1.0f, 1.0f, -1.0f);

std::string maskOf(const DatasetSource& source, const std::string& folder, const JsonNode& node)
{
    if (!node.isString()) return "";
    const std::string path = (std::filesystem::path(source.path) / folder / node.string()).lexically_normal().string();
    return source.fileExists(path) ? path : ""; // what alpha says is enough
}

} // namespace

bool isBigs(const DatasetSource& source)
{
    return !source.descriptions.empty() && source.descriptions.front().folder.starts_with("olat_");
}

Status loadBigs(const DatasetSource& source, OlatDataset& out)
{
    SplitBuilder train("train"), test("test");
    for (const Description& description : source.descriptions) {
        const JsonNode top = description.json.root();
        SplitBuilder folder(""); // counts this light's cameras
        for (const JsonNode& frame : description.frames().items()) {
            const std::string path = findImage(source, description.folder, frame["file_path"].string(), frame["file_path"]);
            if (description.json.failed()) return description.json.error();
            if (extensionOf(path) != ".exr")
                return Error{ErrorCode::kUnsupported, description.json.name() + ": " + frame["file_path"].where() +
                                                          ": expected a linear .exr, found " + inQuotes(path)};
            Camera camera;
            std::optional<FileCamera> file;
            if (readSize(source, frame, top, path, camera)) file = readIntrinsics(frame, top, camera);
            camera.worldFromCamera = readPose(frame, top);
            Light light;
            readLightPosition(frame["light"]["position"], light);
            light.position *= kWorldFromLightFrame, light.positionRest *= kWorldFromLightFrame;
            light.intensity = readIntensity(frame["light"]["intensity"]);
            if (description.json.failed()) return description.json.error();
            folder.add(camera, {0, light, path, maskOf(source, description.folder, frame["obj_mask_path"])}, file);
        }
        if (description.json.failed()) return description.json.error();
        if (folder.split.images.empty())
            return Error{ErrorCode::kBadInput, description.json.name() + ": no frames, expected at least one image of this light"};
        SplitBuilder& target = folder.split.cameras.size() > 1 ? train : test;
        for (const OlatImage& image : folder.split.images)
            target.add(folder.split.cameras[image.camera], image,
                       folder.split.files.empty() ? std::nullopt : std::optional(folder.split.files[image.camera]));
    }
    for (SplitBuilder* builder : {&train, &test})
        if (!builder->split.images.empty()) out.splits.push_back(std::move(builder->split));
    out.colorSpace = ColorSpace::kLinear;
    out.premultiplied = false;
    out.up = {0, 1, 0};
    return ok();
}

} // namespace nacre
