// Nacre's own convention (loaders/canonical.cpp has the layout). Every split says all its lights; nothing is left out.
#include "writer.h"

#include "base/text.h"

#include <filesystem>

namespace nacre {

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
    const bool shared = sharedIntrinsics(split);
    if (shared) addIntrinsics(json, split.cameras[0]);
    json["width"] = split.cameras[0].width;
    json["height"] = split.cameras[0].height;
    json["color_space"] = "linear";
    json["background"] = "black";
    json.update(top);
    for (const OlatImage& image : split.images) {
        if (image.light.type != LightType::kGroup) continue;
        for (const Light& light : *image.light.group) json["lights"].push_back(lightJson(dataset, light));
        break; // one group per split
    }
    for (const OlatImage& image : split.images) {
        Json frame{{"file_path", image.path}, {"transform_matrix", rowsOf(split.cameras[image.camera].worldFromCamera)}};
        if (!shared) addIntrinsics(frame, split.cameras[image.camera]);
        frame["light"] = lightJson(dataset, image.light);
        json["frames"].push_back(std::move(frame));
    }
    return {descriptionFile("transforms_" + split.name + ".json", json)};
}

} // namespace nacre
