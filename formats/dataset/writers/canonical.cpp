// Nacre's own convention (loaders/canonical.cpp has the layout). Every split says all its lights; nothing is left out.
#include "writer.h"

#include "base/text.h"

#include <algorithm>
#include <filesystem>

namespace nacre {

static const char* nameOf(LightRig rig) { return rig == LightRig::kCamera ? "camera" : rig == LightRig::kStage ? "stage" : "fixed"; }

static void addLens(Json& to, const FileCamera& file)
{
    static constexpr const char* kNames[] = {"k1", "k2", "k3", "k4", "k5", "k6"};
    to["fl_x"] = file.fx, to["fl_y"] = file.fy;
    to["cx"] = file.cx, to["cy"] = file.cy;
    for (int i = 0; i < 6; ++i)
        if (file.k[i] != 0) to[kNames[i]] = file.k[i];
    if (file.p[0] != 0) to["p1"] = file.p[0];
    if (file.p[1] != 0) to["p2"] = file.p[1];
}

/// Of an image of a photograph what is not the rule.
static void addPhotograph(Json& frame, const OlatImage& image)
{
    if (!image.maskPath.empty()) frame["mask_path"] = image.maskPath;
    if (!image.ambientPath.empty()) frame["ambient_path"] = image.ambientPath;
    if (image.gain != glm::vec3(1.0f)) frame["gain"] = toJson(1.0f / image.gain);
}

static Json lightJson(const OlatDataset& dataset, const Light& light)
{
    switch (light.type) {
    case LightType::kPoint: return {{"type", "point"}, {"position", toJson(light.position)}, {"intensity", toJson(light.intensity)}};
    case LightType::kDirectional:
        return {{"type", "directional"}, {"direction_to_light", toJson(light.directionToLight)}, {"irradiance", toJson(light.intensity)}};
    case LightType::kEnvironment:
        return {{"type", "environment"}, {"map", std::filesystem::path(light.environmentPath).lexically_relative(dataset.path).string()}};
    case LightType::kGroup: break;
    }
    return {{"type", "all_on"}};
}

Status fitCanonical(OlatDataset& dataset)
{
    for (OlatSplit& split : dataset.splits) {
        const std::vector<Light>* group = nullptr;
        for (const Camera& camera : split.cameras)
            if (camera.width != split.cameras[0].width || camera.height != split.cameras[0].height)
                return Error{ErrorCode::kBadInput, "split " + inQuotes(split.name) + ": the canonical convention has one image size per split, found " +
                                                       std::to_string(split.cameras[0].width) + "x" + std::to_string(split.cameras[0].height) + " and " +
                                                       std::to_string(camera.width) + "x" + std::to_string(camera.height)};
        for (const OlatImage& image : split.images) {
            if (image.light.type != LightType::kGroup) continue;
            if (group && group != image.light.group.get())
                return Error{ErrorCode::kBadInput, "split " + inQuotes(split.name) + ": the canonical convention has one list of all lights per split"};
            group = image.light.group.get();
        }
        nameImages(split, ".exr");
    }
    return ok();
}

std::vector<DescriptionFile> describeCanonical(const OlatDataset& dataset, const OlatSplit& split, const Json& top)
{
    Json json;
    const bool hasFiles = !split.files.empty();
    const bool shared = hasFiles ? std::all_of(split.files.begin(), split.files.end(), [&](const FileCamera& f) { return f == split.files[0]; }) : sharedIntrinsics(split);
    const auto addTaken = [&](Json& to, size_t camera) { hasFiles ? addLens(to, split.files[camera]) : addIntrinsics(to, split.cameras[camera]); };
    if (shared) addTaken(json, 0);
    json["width"] = split.cameras[0].width;
    json["height"] = split.cameras[0].height;
    json["color_space"] = dataset.colorSpace == ColorSpace::kSrgb ? "srgb" : "linear";
    const bool isTrain = split.name == "train"; // the others are there to measure against
    json["background"] = dataset.backgroundInView && isTrain ? "in_view" : "black";
    if (dataset.rig != LightRig::kFixed && isTrain) json["light_rig"] = nameOf(dataset.rig);
    if (dataset.whiteLevel > 0 && isTrain) json["white_level"] = dataset.whiteLevel;
    json.update(top);
    for (const OlatImage& image : split.images) {
        if (image.light.type != LightType::kGroup) continue;
        for (const Light& light : *image.light.group) json["lights"].push_back(lightJson(dataset, light));
        break; // one group per split
    }
    for (const OlatImage& image : split.images) {
        Json frame{{"file_path", image.path}, {"transform_matrix", rowsOf(split.cameras[image.camera].worldFromCamera)}};
        if (!shared) addTaken(frame, image.camera);
        addPhotograph(frame, image);
        frame["light"] = lightJson(dataset, image.light);
        json["frames"].push_back(std::move(frame));
    }
    return {descriptionFile("transforms_" + split.name + ".json", json)};
}

} // namespace nacre
