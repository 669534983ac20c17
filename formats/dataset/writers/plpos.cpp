// The convention of NRHints, GS^3 and RNG (loaders/plpos.cpp has the layout): one frame = one image = one point light, in EXR. Readers of
// the family append file_ext to file_path, and take [cx, cy, fx, fy] where one angle does not say the intrinsics.
#include "writer.h"

#include <numbers>

namespace nacre {

static void addPlposIntrinsics(Json& to, const Camera& camera)
{
    addIntrinsics(to, camera);
    if (to.contains("camera_angle_x")) return;
    for (const char* key : {"fl_x", "fl_y", "cx", "cy"}) to.erase(key);
    to["camera_intrinsics"] = {camera.cx, camera.cy, camera.fx, camera.fy};
}

Status fitPlpos(OlatDataset& dataset)
{
    for (OlatSplit& split : dataset.splits) nameImages(split, ".exr");
    return ok();
}

std::vector<DescriptionFile> describePlpos(const OlatDataset&, const OlatSplit& split, const Json& top)
{
    Json json;
    const bool shared = sharedIntrinsics(split);
    if (shared) addPlposIntrinsics(json, split.cameras[0]);
    json.update(top);
    for (const OlatImage& image : split.images) {
        Json frame{{"file_path", "./" + image.path.substr(0, image.path.size() - 4)}, {"file_ext", ".exr"}};
        frame["transform_matrix"] = rowsOf(split.cameras[image.camera].worldFromCamera);
        if (!shared) addPlposIntrinsics(frame, split.cameras[image.camera]);
        frame["pl_pos"] = toJson(image.light.position);
        // the power in watts of a Blender point light of this radiant intensity
        frame["pl_intensity"] = Json::array();
        for (int c = 0; c < 3; ++c) frame["pl_intensity"].push_back(4.0 * std::numbers::pi * double(image.light.intensity[c]));
        json["frames"].push_back(std::move(frame));
    }
    return {descriptionFile("transforms_" + split.name + ".json", json)};
}

} // namespace nacre
