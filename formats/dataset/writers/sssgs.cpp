// The convention of the SSS-GS dataset (loaders/sssgs.cpp has the layout): one frame = one camera under many lights, 8-bit sRGB PNG.
// The format has multipliers of an unknown intensity; 1 is what the loader gives uncalibrated data, so that a dataset written here loads
// with the intensities it was rendered with. Radiance above 1 is clipped.
#include "writer.h"

#include "dataset/loader.h"

namespace nacre {

Status fitSssgs(OlatDataset& dataset)
{
    for (OlatSplit& split : dataset.splits) nameImages(split, ".png");
    return ok();
}

std::vector<DescriptionFile> describeSssgs(const OlatDataset& dataset, const OlatSplit& split, const Json& top)
{
    Json json;
    const bool shared = sharedIntrinsics(split);
    if (shared) addIntrinsics(json, split.cameras[0]);
    json.update(top);
    const double unit = conventionalIntensity(dataset.splits);
    std::vector<Json> frames(split.cameras.size());
    for (const OlatImage& image : split.images) {
        const Camera& camera = split.cameras[image.camera];
        Json& frame = frames[image.camera];
        if (frame.is_null()) {
            frame = {{"transform_matrix", rowsOf(camera.worldFromCamera)}, {"width", camera.width}, {"height", camera.height}};
            if (!shared) addIntrinsics(frame, camera);
        }
        frame["file_paths"].push_back(image.path.substr(0, image.path.size() - 4));
        frame["light_positions"].push_back(toJson(image.light.position));
        Json gains = Json::array();
        for (int c = 0; c < 3; ++c) gains.push_back(double(image.light.intensity[c]) / unit);
        frame["light_intensities"].push_back(std::move(gains));
    }
    for (Json& frame : frames)
        if (!frame.is_null()) json["frames"].push_back(std::move(frame));
    return {descriptionFile("transforms_" + split.name + ".json", json)};
}

} // namespace nacre
