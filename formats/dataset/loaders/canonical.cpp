// Nacre's own convention, written by the light stage.
//
//   transforms_<split>.json: camera_angle_x (or fl_x, ...), width, height, color_space "linear" | "srgb", alpha "premultiplied" | "straight",
//     background "black" | "in_view", what readCapture and readPhotograph (capture_keys.cpp) read, frames:
//     file_path (with extension), transform_matrix (camera-to-world, camera looks along -Z, world +Z up), light:
//       {type: "point", position, intensity}                      irradiance = intensity / r^2
//       {type: "directional", direction_to_light, irradiance}
//       {type: "environment", map}                                equirectangular EXR
//       {type: "all_on"}                                          all of the top level's `lights` (points, directionals) at once
// Colour is premultiplied by alpha (over black) unless `alpha` says straight; srgb encodes the premultiplied value. Without a color_space in
// any split PNG and JPEG are taken as srgb, which is what 8-bit images hold, with a warning, and EXR as linear.
#include "dataset/environment_map.h"
#include "dataset/loader.h"

#include <algorithm>
#include <cmath>

namespace nacre {
namespace {

/// `allOn` are the lights of the top level.
Light readLight(const DatasetSource& source, const JsonNode& node, const std::shared_ptr<const std::vector<Light>>& allOn)
{
    Light light;
    const std::string type = node["type"].string();
    if (type == "point") {
        light.type = LightType::kPoint;
        readLightPosition(node["position"], light);
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
        light.directionToLight = {0, 0, 1}; // the zenith: this convention's up
        if (const Result<Image> size = source.readImageSize(light.environmentPath))
            if (Status s = checkEnvironmentSize(size->width, size->height, inQuotes(light.environmentPath)); !s)
                node["map"].fail("a latitude-longitude map", s.error().message);
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

} // namespace

bool isCanonical(const DatasetSource& source)
{
    return std::any_of(source.descriptions.begin(), source.descriptions.end(), [](const Description& d) {
        const JsonNode light = d.frames().firstItem()["light"];
        return light.exists() && !light.isArray(); // an array is a bare position: loaders/nerf.cpp
    });
}

Status loadCanonical(const DatasetSource& source, OlatDataset& out)
{
    for (const Description& description : source.descriptions) {
        const JsonNode top = description.json.root();
        SplitBuilder builder(description.split);
        const auto allOn = readAllOn(source, top["lights"]);
        for (const JsonNode& frame : description.frames().items()) {
            Camera camera;
            std::optional<FileCamera> file;
            camera.worldFromCamera = readPose(frame, top);
            const std::string path = findImage(source, "", frame["file_path"].string(), frame["file_path"]);
            if (readSize(source, frame, top, path, camera)) file = readIntrinsics(frame, top, camera);
            OlatImage image{0, readLight(source, frame["light"], allOn), path};
            readPhotograph(source, "", frame, top, image);
            builder.add(camera, std::move(image), file);
            if (description.json.failed()) return description.json.error();
        }
        if (description.json.failed()) return description.json.error();
        out.splits.push_back(std::move(builder.split));
    }
    out.colorSpace = ColorSpace::kSrgb; // of PNG
    out.up = {0, 0, 1};
    return ok();
}

} // namespace nacre
