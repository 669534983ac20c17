// Nacre's own convention, written by the light stage.
//
//   transforms_<split>.json: camera_angle_x (or fl_x, ...), width, height, color_space "linear" | "srgb", background "black", frames:
//     file_path (with extension), transform_matrix (camera-to-world, camera looks along -Z, world +Z up), light:
//       {type: "point", position, intensity}                      irradiance = intensity / r^2
//       {type: "directional", direction_to_light, irradiance}
//       {type: "environment", map}                                equirectangular EXR
// Colour is premultiplied by alpha (over black); srgb encodes the premultiplied value.
#include "dataset/loader.h"

#include <cmath>

namespace nacre {
namespace {

Light readLight(const DatasetSource& source, const JsonNode& node)
{
    Light light;
    const std::string type = node["type"].string();
    if (type == "point") {
        light.type = LightType::kPoint;
        light.position = readVec3(node["position"]);
        light.intensity = readIntensity(node["intensity"]);
    } else if (type == "directional") {
        light.type = LightType::kDirectional;
        const glm::dvec3 d(readVec3(node["direction_to_light"]));
        const double length = glm::length(d);
        if (!(std::fabs(length - 1.0) < 1e-2)) node["direction_to_light"].fail("a unit vector", "length " + std::to_string(length));
        light.directionToLight = glm::vec3(length > 0 ? d / length : glm::dvec3(0, 0, 1));
        light.intensity = readIntensity(node["irradiance"]);
    } else if (type == "environment") {
        light.type = LightType::kEnvironment;
        light.environmentPath = findImage(source, "", node["map"].string(), node["map"]);
    } else {
        node["type"].fail("\"point\", \"directional\" or \"environment\"", inQuotes(type));
    }
    return light;
}

ColorSpace readColorSpace(const JsonNode& node)
{
    const std::string name = node.exists() ? node.string() : "linear";
    if (name != "linear" && name != "srgb") node.fail("\"linear\" or \"srgb\"", inQuotes(name));
    return name == "srgb" ? ColorSpace::kSrgb : ColorSpace::kLinear;
}

} // namespace

bool isCanonical(const DatasetSource& source) { return anyFrameHas(source, "light"); }

Status loadCanonical(const DatasetSource& source, OlatDataset& out)
{
    for (const Description& description : source.descriptions) {
        const JsonNode top = description.json.root();
        const ColorSpace colorSpace = readColorSpace(top["color_space"]);
        if (&description != &source.descriptions.front() && colorSpace != out.colorSpace)
            top["color_space"].fail("the same color_space in every split", "another one");
        out.colorSpace = colorSpace;
        if (top["background"].exists() && top["background"].string() != "black")
            top["background"].fail("\"black\"", inQuotes(top["background"].string()));

        Camera camera;
        camera.width = top["width"].integer(1, 65536);
        camera.height = top["height"].integer(1, 65536);
        SplitBuilder builder(description.split);
        for (const JsonNode& frame : description.frames().items()) {
            camera.worldFromCamera = readPose(frame["transform_matrix"]);
            readIntrinsics(frame, top, camera);
            const Light light = readLight(source, frame["light"]);
            builder.add(camera, light, findImage(source, "", frame["file_path"].string(), frame["file_path"]));
            if (description.json.failed()) break;
        }
        if (description.json.failed()) return description.json.error();
        out.splits.push_back(std::move(builder.split));
    }
    out.up = {0, 0, 1};
    return ok();
}

} // namespace nacre
