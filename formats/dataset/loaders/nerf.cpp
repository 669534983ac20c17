// NeRF-style descriptions with a light per frame, as captures write them that follow none of the other conventions.
//
//   transforms.json or transforms_<split>.json: intrinsics as everywhere, "camera_axes": "opengl" (default) | "opencv", frames:
//     file_path (with extension or without), transform_matrix, and one of
//       light_position, light_pos, light_location, or light: [x, y, z]      a point light, in the world of the cameras
//       light_direction, light_dir                                          towards a light infinitely far, of any length
//     light_intensity or light_color: a number or [r, g, b]; in no frame: by convention
//   Frames without a light take it from the light table (light_table.cpp); with "light_rig": "camera" at the top level it is at the camera.
// PNG and JPEG are sRGB, PNG with straight alpha; EXR is linear, premultiplied. color_space and alpha of the top level override that.
#include "dataset/loader.h"

#include <algorithm>

namespace nacre {
namespace {

JsonNode firstOf(const JsonNode& frame, std::initializer_list<const char*> keys)
{
    for (const char* key : keys)
        if (frame[key].exists()) return frame[key];
    return frame[*keys.begin()];
}

JsonNode positionOf(const JsonNode& frame) { return firstOf(frame, {"light_position", "light_pos", "light_location", "light"}); }
JsonNode directionOf(const JsonNode& frame) { return firstOf(frame, {"light_direction", "light_dir"}); }
JsonNode intensityOf(const JsonNode& frame) { return firstOf(frame, {"light_intensity", "light_color"}); }

bool hasLights(const DatasetSource& source)
{
    return std::any_of(source.descriptions.begin(), source.descriptions.end(), [](const Description& d) {
        const JsonNode frame = d.frames().firstItem();
        return positionOf(frame).exists() || directionOf(frame).exists();
    });
}

Light readLight(const JsonNode& frame)
{
    Light light;
    const JsonNode position = positionOf(frame), direction = directionOf(frame);
    if (position.exists() && direction.exists()) direction.fail("a position of the light or a direction", "both");
    if (direction.exists()) {
        const glm::dvec3 d(readVec3(direction));
        const double length = glm::length(d);
        if (!(length > 1e-9)) direction.fail("a direction towards the light", "0, 0, 0");
        else light.type = LightType::kDirectional, light.directionToLight = glm::vec3(d / length);
    } else {
        readLightPosition(position, light);
    }
    return light;
}

} // namespace

bool isNerf(const DatasetSource& source) { return !source.descriptions.empty() && (hasLights(source) || hasLightTable(source)); }

Status loadNerf(const DatasetSource& source, OlatDataset& out)
{
    const bool inFrames = hasLights(source);
    size_t withIntensity = 0, images = 0;
    std::vector<Photo> photos; // which the light table knows
    for (const Description& description : source.descriptions) {
        const JsonNode top = description.json.root();
        SplitBuilder builder(description.split);
        for (const JsonNode& frame : description.frames().items()) {
            Photo photo;
            photo.name = frame["file_path"].string();
            photo.path = findImage(source, "", photo.name, frame["file_path"], frame["file_ext"].isString() ? frame["file_ext"].string() : "");
            if (description.json.failed()) return description.json.error();
            if (readSize(source, frame, top, photo.path, photo.camera)) photo.file = readIntrinsics(frame, top, photo.camera);
            photo.camera.worldFromCamera = readPose(frame, top);
            readPhotograph(source, "", frame, top, photo.image);
            if (inFrames) {
                photo.image.light = readLight(frame);
                if (const JsonNode intensity = intensityOf(frame); intensity.exists()) photo.image.light.intensity = readIntensity(intensity), ++withIntensity;
                photo.image.path = photo.path;
                builder.add(photo.camera, photo.image, photo.file);
            } else {
                // a lone file has no splits: the table may state them
                photo.split = source.descriptions.size() > 1 ? description.split : "";
                if (photo.name.starts_with("./")) photo.name.erase(0, 2);
                photos.push_back(std::move(photo));
            }
            ++images;
            if (description.json.failed()) return description.json.error();
        }
        if (description.json.failed()) return description.json.error();
        if (inFrames) out.splits.push_back(std::move(builder.split));
    }
    out.colorSpace = ColorSpace::kSrgb;
    out.straightPng = true;
    if (!inFrames) return lightPhotos(source, std::move(photos), out);

    out.up = upFromCameras(out.splits);
    if (withIntensity != 0 && withIntensity != images)
        return Error{ErrorCode::kBadInput, source.path + ": " + std::to_string(withIntensity) + " of " + std::to_string(images) +
                                               " frames have light_intensity, expected all or none"};
    if (withIntensity == 0) scaleByConvention(out);
    return ok();
}

} // namespace nacre
