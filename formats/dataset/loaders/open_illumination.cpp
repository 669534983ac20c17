// OpenIllumination, its one-light-at-a-time part: OLAT/<object>.
//
//   Lights/<light>/raw_undistorted/<camera>.JPG     sRGB photographs, undistorted
//   output/transforms_{train,test}.json             frames by camera: transform_matrix (camera-to-world, OpenCV axes), camera_angle_x; principal point: centre
//   output/obj_masks/<camera>.png                   the object
//   light_pos.npy                                   a position for each light, here or one or two folders above
// Every camera sees every light. The splits are the convention's: other cameras, the same lights. There are no intensities: by convention.
#include "dataset/loader.h"

#include "interchange/matrix_file.h"
#include "interchange/text_lines.h"

#include <cmath>

namespace nacre {
namespace {

constexpr const char* kTrain = "output/transforms_train.json";

Result<Matrix> readLightPositions(const DatasetSource& source)
{
    for (const char* name : {"light_pos.npy", "../light_pos.npy", "../../light_pos.npy"}) {
        const std::string path = source.pathOf(name);
        if (!source.fileExists(path)) continue;
        const auto bytes = source.readFile(path);
        if (!bytes) return bytes.error();
        Result<Matrix> positions = decodeNpy(*bytes, path);
        if (positions && positions->columns != 3)
            return Error{ErrorCode::kBadInput, path + ": " + std::to_string(positions->columns) + " columns, expected x, y, z"};
        if (positions)
            for (const double x : positions->values)
                if (!(std::fabs(x) < 1e9)) return Error{ErrorCode::kBadInput, path + ": expected coordinates below 1e9, found " + numberText(x)};
        return positions;
    }
    return Error{ErrorCode::kBadInput, source.path + ": no light_pos.npy here or in the two folders above; it is at the root of OpenIllumination"};
}

/// The images of one camera under all lights.
void addCamera(const DatasetSource& source, const std::string& id, Camera camera, const Matrix& positions, double angle, SplitBuilder& split, bool& hasMasks)
{
    const JsonNode nowhere(nullptr, nullptr, "");
    std::string mask = source.pathOf("output/obj_masks/" + id + ".png");
    if (!source.fileExists(mask)) mask.clear();
    hasMasks = hasMasks && !mask.empty();
    for (const std::string& name : source.list(source.pathOf("Lights"))) {
        const auto light = integerOf<size_t>(name);
        if (!light || *light >= positions.rows) continue;
        OlatImage image{0, {}, findImage(source, "Lights/" + name + "/raw_undistorted", id, nowhere, ".JPG")};
        if (camera.width == 0) {
            const Result<Image> size = source.readImageSize(image.path);
            if (size) source.lastSize = {size->width, size->height};
            if (source.lastSize[0] == 0) continue;
            camera.width = source.lastSize[0], camera.height = source.lastSize[1];
            camera.fx = camera.fy = 0.5 * camera.width / std::tan(0.5 * angle);
            camera.cx = 0.5 * camera.width, camera.cy = 0.5 * camera.height;
        }
        const glm::dvec3 position(positions.at(*light, 0), positions.at(*light, 1), positions.at(*light, 2));
        image.light.position = glm::vec3(position), image.light.positionRest = glm::vec3(position - glm::dvec3(image.light.position));
        image.maskPath = mask;
        split.add(camera, std::move(image), std::nullopt);
    }
}

} // namespace

bool isOpenIllumination(const DatasetSource& source) { return source.fileExists(source.pathOf(kTrain)) && !source.list(source.pathOf("Lights")).empty(); }

Status loadOpenIllumination(const DatasetSource& source, OlatDataset& out)
{
    const Result<Matrix> positions = readLightPositions(source);
    if (!positions) return positions.error();
    bool hasMasks = true;
    for (const char* splitName : {"train", "test"}) {
        const std::string path = source.pathOf(std::string("output/transforms_") + splitName + ".json");
        if (!source.fileExists(path)) continue;
        const auto bytes = source.readFile(path);
        if (!bytes) return bytes.error();
        const Result<JsonDocument> json = JsonDocument::parse(*bytes, path);
        if (!json) return json.error();
        const JsonNode top = json->root(), frames = top["frames"];
        const std::vector<std::string> ids = frames.isObject() ? frames.keys() : std::vector<std::string>();
        const std::vector<JsonNode> items = frames.items();
        if (ids.empty()) frames.fail("cameras by name", "none");
        SplitBuilder split(splitName);
        for (size_t i = 0; i < ids.size(); ++i) {
            Camera camera;
            camera.worldFromCamera = fromOpenCv(readPose(items[i], top));
            const JsonNode angle = items[i]["camera_angle_x"].exists() ? items[i]["camera_angle_x"] : top["camera_angle_x"];
            const double a = angle.number();
            if (!(a > 0.01 && a < 2.5)) angle.fail("a field of view between 0.01 and 2.5 radians", numberText(a));
            if (json->failed()) return json->error();
            addCamera(source, ids[i], camera, *positions, a, split, hasMasks);
        }
        if (json->failed()) return json->error();
        if (!split.split.images.empty()) out.splits.push_back(std::move(split.split));
    }
    if (out.splits.empty()) return Error{ErrorCode::kBadInput, source.path + ": no images Lights/<light>/raw_undistorted/<camera>.JPG of the " + std::to_string(positions->rows) + " lights"};
    out.colorSpace = ColorSpace::kSrgb;
    out.backgroundInView = !hasMasks;
    out.up = upFromCameras(out.splits);
    scaleByConvention(out);
    out.warnings.push_back("the splits have different cameras and the same lights, as the convention has it");
    return ok();
}

} // namespace nacre
