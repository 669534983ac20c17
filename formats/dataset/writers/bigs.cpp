// The convention of the BiGS dataset (loaders/bigs.cpp has the layout): one folder per light, half-float EXR with straight alpha, world +Y
// up, lights in Mitsuba's frame. Folders are numbered from 1: train lights first, each with several cameras, then test lights, each with
// one; that number of cameras is what tells the splits apart. What would read as test is left out: other splits of point lights, and train
// lights with one camera.
// The split all_on becomes olat_all_on, whose frames name no light.
#include "writer.h"

#include <array>
#include <filesystem>
#include <map>
#include <set>

namespace nacre {

static std::string folderOf(const OlatImage& image) { return std::filesystem::path(image.path).begin()->string(); }

using LightKey = std::array<float, 6>;

static LightKey keyOf(const Light& l) { return {l.position.x, l.position.y, l.position.z, l.intensity.x, l.intensity.y, l.intensity.z}; }

static void leaveOutLonelyLights(OlatSplit& train, std::vector<std::string>& warnings)
{
    std::map<LightKey, std::set<uint32_t>> cameras;
    for (const OlatImage& image : train.images) cameras[keyOf(image.light)].insert(image.camera);
    const size_t lonely = std::erase_if(train.images, [&](const OlatImage& image) { return cameras[keyOf(image.light)].size() == 1; });
    if (lonely > 0)
        warnings.push_back(std::to_string(lonely) + " train images left out: their lights have one camera, which the bigs convention would read as test");
}

/// Names each image olat_<light>/img/r_<camera>.exr; `light` counts on.
static Status nameByLight(OlatSplit& split, int& light)
{
    struct Folder {
        int number = 0;
        std::set<uint32_t> cameras;
        size_t images = 0;
    };
    std::map<LightKey, Folder> folders;
    char name[64];
    for (OlatImage& image : split.images) {
        Folder& folder = folders[keyOf(image.light)];
        if (folder.number == 0) folder.number = ++light;
        folder.cameras.insert(image.camera);
        folder.images++;
        std::snprintf(name, sizeof name, "olat_%d/img/r_%04u.exr", folder.number, unsigned(image.camera));
        image.path = name;
    }
    const bool train = split.name == "train";
    for (const auto& [key, folder] : folders) {
        const size_t cameras = folder.cameras.size();
        if (cameras != folder.images || (cameras > 1) != train)
            return Error{ErrorCode::kBadInput, "split '" + split.name + "': the bigs convention needs " +
                                                   (train ? "two cameras or more for every train light" : "one camera for every test light") +
                                                   ", once each, found a light with " + std::to_string(folder.images) + " images from " +
                                                   std::to_string(cameras) + " cameras"};
    }
    return ok();
}

Status fitBigs(OlatDataset& dataset)
{
    std::erase_if(dataset.splits, [&](const OlatSplit& split) {
        const bool keep = split.name == "train" || split.name == "test" || split.name == "all_on";
        if (!keep) dataset.warnings.push_back("split '" + split.name + "' left out: the bigs convention would read it as test");
        return !keep;
    });
    for (OlatSplit& split : dataset.splits)
        if (split.name == "train") leaveOutLonelyLights(split, dataset.warnings);
    std::erase_if(dataset.splits, [](const OlatSplit& split) { return split.images.empty(); });
    int light = 0;
    char name[64];
    for (OlatSplit& split : dataset.splits) {
        if (split.name != "all_on") {
            if (Status s = nameByLight(split, light); !s) return s;
            continue;
        }
        for (size_t i = 0; i < split.images.size(); ++i) {
            std::snprintf(name, sizeof name, "olat_all_on/img/r_%04zu.exr", i);
            split.images[i].path = name;
        }
    }
    return ok();
}

std::vector<DescriptionFile> describeBigs(const OlatDataset&, const OlatSplit& split, const Json& top)
{
    std::map<std::string, Json> folders;
    const bool shared = sharedIntrinsics(split);
    const auto size = [](Json& to, const Camera& camera) { to["w"] = camera.width, to["h"] = camera.height; };
    for (const OlatImage& image : split.images) {
        const Camera& camera = split.cameras[image.camera];
        const std::string folder = folderOf(image);
        Json& json = folders[folder];
        if (json.is_null()) {
            if (shared) addIntrinsics(json, camera), size(json, camera);
            json.update(top);
            json["frames"] = Json::array();
        }
        Json frame{{"file_path", image.path.substr(folder.size() + 1)}, {"transform_matrix", rowsOf(camera.worldFromCamera)}};
        if (!shared) addIntrinsics(frame, camera), size(frame, camera);
        if (image.light.type == LightType::kPoint)
            frame["light"] = {{"position", toJson(image.light.position * glm::vec3(-1, 1, -1))}, {"intensity", toJson(image.light.intensity)}};
        json["frames"].push_back(std::move(frame));
    }
    std::vector<DescriptionFile> out;
    for (const auto& [folder, json] : folders) out.push_back(descriptionFile(folder + "/transforms_train.json", json));
    return out;
}

} // namespace nacre
