// A COLMAP model as text and lights.json (loaders/colmap.cpp has the layout), with EXR images. Files are for the whole dataset: those of a split hold
// the splits before it, too, so that the last one to be written has all.
#include "writer.h"

#include "base/text.h"

#include <glm/gtc/quaternion.hpp>

#include <array>
#include <map>

namespace nacre {

Status fitColmap(OlatDataset& dataset)
{
    for (OlatSplit& split : dataset.splits) {
        nameImages(split, ".exr");
        for (OlatImage& image : split.images) image.path = "images/" + image.path;
    }
    return ok();
}

std::vector<DescriptionFile> describeColmap(const OlatDataset& dataset, const OlatSplit& last, const Json& top)
{
    std::string cameras = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n", images = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points\n";
    Json lights = top;
    lights["color_space"] = "linear", lights["alpha"] = "premultiplied", lights["images"] = Json::object();
    std::map<std::array<double, 6>, size_t> numberOfCamera;
    size_t count = 0;
    const auto addWord = [](std::string& line, const std::string& word) { line.append(" ").append(word); };
    for (const OlatSplit& split : dataset.splits) {
        for (const OlatImage& image : split.images) {
            const Camera& c = split.cameras[image.camera];
            const size_t next = numberOfCamera.size() + 1;
            const auto [camera, isNew] = numberOfCamera.try_emplace({double(c.width), double(c.height), c.fx, c.fy, c.cx, c.cy}, next);
            if (isNew) {
                cameras += std::to_string(next);
                for (const std::string& word : {std::string("PINHOLE"), std::to_string(c.width), std::to_string(c.height)}) addWord(cameras, word);
                for (const double p : {c.fx, c.fy, c.cx, c.cy}) addWord(cameras, numberText(p));
                cameras += '\n';
            }
            glm::dmat3 worldFromCamera(c.worldFromCamera);
            worldFromCamera[1] = -worldFromCamera[1], worldFromCamera[2] = -worldFromCamera[2]; // to OpenCV's axes
            const glm::dmat3 rotation = glm::transpose(worldFromCamera);
            const glm::dquat q = glm::quat_cast(rotation);
            const glm::dvec3 t = rotation * -c.position();
            images += std::to_string(++count);
            for (const double x : {q.w, q.x, q.y, q.z, t.x, t.y, t.z}) addWord(images, numberText(x));
            const std::string name = image.path.substr(std::string("images/").size());
            addWord(images, std::to_string(camera->second));
            addWord(images, name);
            images += "\n\n";

            const bool isPoint = image.light.type == LightType::kPoint;
            lights["images"][name] = {{isPoint ? "position" : "direction", toJson(isPoint ? image.light.position : image.light.directionToLight)},
                                      {"intensity", toJson(image.light.intensity)}, {"split", split.name}};
        }
        if (&split == &last) break;
    }
    return {{"sparse/0/cameras.txt", cameras}, {"sparse/0/images.txt", images}, {"sparse/0/points3D.txt", "# none\n"}, descriptionFile("lights.json", lights)};
}

} // namespace nacre
