// The convention of ReNe (loaders/rene.cpp has the layout): a folder per light, one camera model, 8-bit sRGB PNG, world +Z up. What tells the splits
// apart are numbers: train gets those of lights and views that the loader trains with, test the benchmark's three lights and every tenth view. The
// convention has no intensities.
#include "writer.h"

#include "base/text.h"

#include <algorithm>
#include <array>
#include <map>

namespace nacre {
namespace {

using LightKey = std::array<float, 3>;

LightKey keyOf(const Light& light) { return {light.position.x, light.position.y, light.position.z}; }

bool isTestLight(size_t n) { return n == 2 || n == 21 || n == 34; }
bool isTestView(size_t n) { return n % 10 == 9; }
bool isBenchmarkView(size_t n) { return n == 4 || n == 8 || n == 15; }

/// The first number from `n` that the split may use.
size_t nextLight(size_t n, bool isTest)
{
    while (isTestLight(n) != isTest) ++n;
    return n;
}

size_t nextView(size_t n, bool isTest)
{
    while (isBenchmarkView(n) || isTestView(n) != isTest) ++n;
    return n;
}

/// Leaves out cameras without an image.
void keepUsedCameras(OlatSplit& split)
{
    constexpr uint32_t kUnused = ~0u;
    std::vector<uint32_t> numbers(split.cameras.size(), kUnused);
    std::vector<Camera> used;
    for (OlatImage& image : split.images) {
        uint32_t& number = numbers[image.camera];
        if (number == kUnused) number = uint32_t(used.size()), used.push_back(split.cameras[image.camera]);
        image.camera = number;
    }
    split.cameras = std::move(used);
}

} // namespace

Status fitRene(OlatDataset& dataset)
{
    constexpr size_t kTestLights = 3;
    std::erase_if(dataset.splits, [&](const OlatSplit& split) {
        const bool keep = split.name == "train" || split.name == "test";
        if (!keep) dataset.warnings.push_back("split '" + split.name + "' left out: the rene convention has train and test only");
        return !keep;
    });
    const Camera* first = nullptr;
    bool sameIntensity = true;
    glm::vec3 intensity(0.0f);
    for (OlatSplit& split : dataset.splits) {
        const bool isTest = split.name == "test";
        std::map<LightKey, size_t> numberOfLight;
        std::vector<size_t> numberOfView;
        size_t light = 0, view = 0;
        for (const Camera& c : split.cameras) {
            if (!first) first = &c;
            if (c.width != first->width || c.height != first->height || c.fx != first->fx || c.fy != first->fy || c.cx != first->cx || c.cy != first->cy)
                return Error{ErrorCode::kBadInput, "split '" + split.name + "': the rene convention has one camera model for all images, found two"};
            numberOfView.push_back(view = nextView(view, isTest));
            ++view;
        }
        std::map<LightKey, size_t> known;
        const size_t removed = std::erase_if(split.images, [&](const OlatImage& image) {
            known.try_emplace(keyOf(image.light), known.size());
            return isTest && known.at(keyOf(image.light)) >= kTestLights;
        });
        if (removed) dataset.warnings.push_back(std::to_string(removed) + " test images left out: the rene convention has three lights for test");
        for (OlatImage& image : split.images) {
            if (!numberOfLight.count(keyOf(image.light))) numberOfLight[keyOf(image.light)] = light = nextLight(light, isTest), ++light;
            char name[64];
            std::snprintf(name, sizeof name, "lset%03zu/data/%05zu_image.png", numberOfLight[keyOf(image.light)], numberOfView[image.camera]);
            image.path = name;
            if (intensity == glm::vec3(0.0f)) intensity = image.light.intensity;
            sameIntensity = sameIntensity && image.light.intensity == intensity;
        }
    }
    std::erase_if(dataset.splits, [](const OlatSplit& split) { return split.images.empty(); });
    for (OlatSplit& split : dataset.splits) keepUsedCameras(split); // files are named
    if (!sameIntensity) dataset.warnings.push_back("the rene convention has no intensities: those of these lights differ, and read back as equal");
    return ok();
}

std::vector<DescriptionFile> describeRene(const OlatDataset&, const OlatSplit& split, const Json&)
{
    const Camera& c = split.cameras.front();
    std::string camera = "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ ";
    const double matrix[] = {c.fx, 0, c.cx - 0.5, 0, c.fy, c.cy - 0.5, 0, 0, 1}; // OpenCV's first pixel has its middle at 0, 0
    for (size_t i = 0; i < 9; ++i) camera.append(numberText(matrix[i])).append(i < 8 ? ", " : " ]\n");
    camera += "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0., 0., 0., 0., 0. ]\n";
    const auto rows = [](const glm::dmat4& m) {
        std::string text;
        for (int r = 0; r < 4; ++r)
            for (int k = 0; k < 4; ++k) text.append(numberText(m[k][r])).append(k < 3 ? " " : "\n");
        return text;
    };
    std::map<std::string, std::string> files;
    for (const OlatImage& image : split.images) {
        const std::string folder = image.path.substr(0, image.path.find('/'));
        glm::dmat4 light(1.0), pose = split.cameras[image.camera].worldFromCamera;
        light[3] = glm::dvec4(image.light.position, 1.0);
        pose[1] = -pose[1], pose[2] = -pose[2];
        files[folder + "/camera.yml"] = camera;
        files[folder + "/light.txt"] = rows(light);
        files[image.path.substr(0, image.path.size() - std::string("_image.png").size()) + "_pose.txt"] = rows(pose);
    }
    std::vector<DescriptionFile> out;
    for (auto& [path, text] : files) out.push_back({path, std::move(text)});
    return out;
}

} // namespace nacre
