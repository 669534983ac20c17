// Any bytes as a description file through every loader, without a disk: a dataset that keeps the promises of olat_dataset.h, or an
// error of one line; never a crash.
#include "dataset_promises.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <span>
#include <string_view>

using namespace nacre;

static void tryFolder(const JsonDocument& json, const char* folder)
{
    DatasetSource source;
    source.path = "fuzz";
    source.descriptions.push_back({folder, "train", json});
    source.fileExists = [](const std::string& path) { return path.find("missing") == std::string::npos; };
    source.readImageSize = [](const std::string&) { return Result<Image>(Image{16, 8, {}}); };
    source.list = [](const std::string&) { return std::vector<std::string>(); };
    source.readFile = [](const std::string& path) { return Result<std::vector<std::byte>>(Error{ErrorCode::kBadInput, path + ": no such file"}); };
    requirePromises(loadFrom(source));
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    const auto bytes = std::as_bytes(std::span(data, size));
    for (const char* folder : {"", "olat_1"}) { // the second makes it BiGS; parsed anew, for a document remembers its first error
        const Result<JsonDocument> json = JsonDocument::parse(bytes, "fuzz.json");
        if (!json) return 0;
        tryFolder(*json, folder);
    }
    return 0;
}

#define POSE "\"transform_matrix\":[[1,0,0,0.5],[0,1,0,0],[0,0,1,3],[0,0,0,1]]"

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    static constexpr std::string_view kSeeds[] = {
        R"({"camera_angle_x":0.7,"width":16,"height":8,"color_space":"linear","background":"black","frames":[)"
        R"({"file_path":"a.exr",)" POSE R"(,"light":{"type":"point","position":[1,2,3],"intensity":[60,60,60]}},)"
        R"({"file_path":"b.exr",)" POSE R"(,"light":{"type":"directional","direction_to_light":[0,0.6,0.8],"irradiance":[2,2,2]}},)"
        R"({"file_path":"c.exr",)" POSE R"(,"light":{"type":"environment","map":"sky.exr"}}]})",
        R"({"camera_angle_x":0.7,"frames":{"a":{"file_path":"a","file_ext":".exr",)" POSE R"(,"pl_pos":[1,2,3],"pl_intensity":[9,9,9]}}})",
        R"({"camera_intrinsics":[8,4,20,20],"frames":[{"img_path":"a.png","R_opt":[[1,0,0],[0,1,0],[0,0,1]],"T_opt":[0,0,3],"pl_pos":[1,2,3]}]})",
        R"({"camera_angle_x":0.7,"frames":[{)" POSE R"(,"width":16,"height":8,"cx":8,"cy":4,"file_paths":["a","b"],)"
        R"("light_positions":[[1,2,3],[3,2,1]],"light_intensities":[[1,1,1],[2,2,2]]}]})",
        R"({"w":16,"h":8,"fl_x":20,"frames":[{"file_path":"a.exr","k1":0,)" POSE R"(,"light":{"position":[1,2,3],"intensity":2}}]})",
    };
    if (i >= std::size(kSeeds) || kSeeds[i].size() > cap) return 0;
    std::copy(kSeeds[i].begin(), kSeeds[i].end(), out);
    return kSeeds[i].size();
}
