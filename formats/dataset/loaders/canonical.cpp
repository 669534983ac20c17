// Nacre's own convention, written by the light stage.
//
//   transforms_<split>.json: camera_angle_x (or fl_x, ...), width, height, color_space "linear" | "srgb", background "black", frames:
//     file_path (with extension), transform_matrix (camera-to-world, camera looks along -Z, world +Z up), light:
//       {type: "point", position, intensity}                      irradiance = intensity / r^2
//       {type: "directional", direction_to_light, irradiance}
//       {type: "environment", map}                                equirectangular EXR
//       {type: "all_on"}                                          all of the top level's `lights` (points, directionals) at once
// Colour is premultiplied by alpha (over black); srgb encodes the premultiplied value. Without a color_space in any split PNG is taken
// as srgb, which is what 8-bit images hold, with a warning, and EXR as linear.
#include "dataset/loader.h"

#include <cmath>
#include <optional>

namespace nacre {
namespace {

/// `allOn` are the lights of the top level.
Light readLight(const DatasetSource& source, const JsonNode& node, const std::shared_ptr<const std::vector<Light>>& allOn)
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
    } else if (type == "all_on") {
        light.type = LightType::kGroup;
        light.group = allOn;
        if (allOn->empty()) node["type"].fail("the lights that are on, in `lights` of the top level", "none");
    } else {
        node["type"].fail("\"point\", \"directional\", \"environment\" or \"all_on\"", inQuotes(type));
    }
    return light;
}

std::shared_ptr<const std::vector<Light>> readAllOn(const DatasetSource& source, const JsonNode& node)
{
    auto lights = std::make_shared<std::vector<Light>>();
    if (!node.exists()) return lights;
    const auto none = std::make_shared<const std::vector<Light>>();
    for (const JsonNode& item : node.items()) {
        lights->push_back(readLight(source, item, none));
        if (!lights->back().isPunctual()) item["type"].fail("\"point\" or \"directional\"", inQuotes(item["type"].string()));
    }
    return lights;
}

/// What the split says, if it does. Splits must not disagree.
void readColorSpace(const JsonNode& node, std::optional<ColorSpace>& colorSpace)
{
    if (!node.exists()) return;
    const std::string name = node.string();
    if (name != "linear" && name != "srgb") node.fail("\"linear\" or \"srgb\"", inQuotes(name));
    const ColorSpace here = name == "srgb" ? ColorSpace::kSrgb : ColorSpace::kLinear;
    if (colorSpace.value_or(here) != here) node.fail("the same color_space in every split", "another one");
    colorSpace = here;
}

} // namespace

bool isCanonical(const DatasetSource& source) { return anyFrameHas(source, "light"); }

Status loadCanonical(const DatasetSource& source, OlatDataset& out)
{
    std::optional<ColorSpace> colorSpace;
    for (const Description& description : source.descriptions) {
        const JsonNode top = description.json.root();
        readColorSpace(top["color_space"], colorSpace);
        if (top["background"].exists() && top["background"].string() != "black")
            top["background"].fail("\"black\"", inQuotes(top["background"].string()));

        Camera camera;
        camera.width = top["width"].integer(1, 65536);
        camera.height = top["height"].integer(1, 65536);
        SplitBuilder builder(description.split);
        const auto allOn = readAllOn(source, top["lights"]);
        for (const JsonNode& frame : description.frames().items()) {
            camera.worldFromCamera = readPose(frame["transform_matrix"]);
            readIntrinsics(frame, top, camera);
            const Light light = readLight(source, frame["light"], allOn);
            builder.add(camera, light, findImage(source, "", frame["file_path"].string(), frame["file_path"]));
            if (description.json.failed()) break;
        }
        if (description.json.failed()) return description.json.error();
        out.splits.push_back(std::move(builder.split));
    }
    if (!colorSpace && !out.splits.empty() && !out.splits[0].images.empty() && extensionOf(out.splits[0].images[0].path) == ".png") {
        colorSpace = ColorSpace::kSrgb;
        out.warnings.push_back("no color_space: PNG images are taken as sRGB; write \"color_space\": \"srgb\" or \"linear\" into " +
                               source.descriptions[0].json.name());
    }
    out.colorSpace = colorSpace.value_or(ColorSpace::kLinear);
    out.up = {0, 0, 1};
    return ok();
}

} // namespace nacre
