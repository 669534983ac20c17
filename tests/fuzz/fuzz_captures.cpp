// Any bytes as the files of captures that are no transforms_*.json (COLMAP and its light table, DiLiGenT-MV, OpenIllumination, ReNe), through every
// loader, without a disk; and as a calibration file alone.
//
// An input is files one behind the other, each "name, newline, size in decimal, newline, bytes"; what does not read so ends the list.
#include "dataset/colmap_model.h"
#include "interchange/matrix_file.h"

#include "dataset_matrix_builders.h"
#include "dataset_promises.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <set>

using namespace nacre;

namespace {

using Files = std::map<std::string, Bytes>;

Files unpack(std::span<const std::byte> bytes)
{
    Files files;
    std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    while (files.size() < 64) {
        const size_t nameEnd = text.find('\n');
        if (nameEnd == std::string_view::npos) break;
        const std::string name = std::filesystem::path(text.substr(0, nameEnd)).lexically_normal().string();
        text.remove_prefix(nameEnd + 1);
        size_t size = 0;
        const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), size);
        if (status != std::errc() || end == text.data() + text.size()) break;
        text.remove_prefix(size_t(end - text.data()) + 1);
        const auto* data = reinterpret_cast<const std::byte*>(text.data());
        size = std::min(size, text.size());
        files[name] = Bytes(data, data + size);
        text.remove_prefix(size);
    }
    return files;
}

void pack(Bytes& out, const std::string& name, const Bytes& bytes)
{
    const std::string head = name + "\n" + std::to_string(bytes.size()) + "\n";
    append(out, head.data(), head.size());
    append(out, bytes.data(), bytes.size());
}

void pack(Bytes& out, const std::string& name, const std::string& text)
{
    Bytes bytes;
    append(bytes, text.data(), text.size());
    pack(out, name, bytes);
}

void load(const Files& files)
{
    DatasetSource source;
    source.path = ".";
    source.fileExists = [&](const std::string& path) { return files.count(path) > 0; };
    source.readImageSize = [](const std::string&) { return Result<Image>(Image{16, 8, {}}); };
    source.readFile = [&](const std::string& path) {
        const auto it = files.find(path);
        return it == files.end() ? Result<Bytes>(Error{ErrorCode::kBadInput, "no such file"}) : Result<Bytes>(it->second);
    };
    source.list = [&](const std::string& folder) {
        const std::string prefix = folder == "." || folder.empty() ? "" : folder + "/";
        std::set<std::string> names;
        for (const auto& [path, bytes] : files)
            if (path.starts_with(prefix) && path.size() > prefix.size()) names.insert(path.substr(prefix.size(), path.find('/', prefix.size()) - prefix.size()));
        return std::vector<std::string>(names.begin(), names.end());
    };
    for (const char* name : {"transforms.json", "lights.json"}) {
        const auto it = files.find(name);
        if (it == files.end()) continue;
        const Result<JsonDocument> json = JsonDocument::parse(it->second, name);
        if (!json) return;
        if (*name == 't') source.descriptions.push_back({"", "train", *json});
        else source.lights = Description{"", "train", *json};
    }
    requirePromises(loadFrom(source));
}

void checkMatrix(const Matrix& m) { require(m.values.size() == m.rows * m.columns); }

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    const auto bytes = std::as_bytes(std::span(data, size));
    const Files files = unpack(bytes);
    load(files);
    for (const auto& [name, content] : files) {
        if (const auto mat = decodeMat(content, "fuzz.mat")) {
            for (const auto& [key, matrix] : *mat) checkMatrix(matrix);
        } else requireLine(mat.error());
        if (const auto npy = decodeNpy(content, "fuzz.npy")) checkMatrix(*npy);
        else requireLine(npy.error());
    }
    return 0;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    const std::string pose = "1 0 0 0.5\n0 1 0 0\n0 0 1 3\n0 0 0 1\n", row = "0 0 1\n0.6 0 0.8\n";
    const std::string poseJson = R"("transform_matrix":[[1,0,0,0.5],[0,1,0,0],[0,0,1,3],[0,0,0,1]])";
    Bytes seed;
    if (i == 0 || i == 1) { // COLMAP as text, and a table of either kind
        pack(seed, "sparse/0/cameras.txt", "1 OPENCV 16 8 20 21 8 4 -0.1 0.02 0.001 0\n2 SIMPLE_RADIAL 16 8 20 8 4 0.1\n");
        pack(seed, "sparse/0/images.txt", "1 1 0 0 0 0 0 3 1 a.jpg\n\n2 0.6 0.8 0 0 1 0 3 2 b/c.png\n1 2 3\n");
        if (i == 0) pack(seed, "lights.csv", "image,light_x,light_y,light_z,intensity,exposure_ev,split\na.jpg,1,2,3,4,1,train\n\"c.png\",3,2,1,4,,test\n");
        else pack(seed, "lights.json", R"({"light_rig":"stage","images":{"a.jpg":{"position":[1,2,3],"gain":2},"b/c.png":{"direction":[0,0,2],"split":"x"}}})");
        pack(seed, "images/a.jpg", ""), pack(seed, "images/b/c.png", ""), pack(seed, "masks/a.jpg.png", "");
    } else if (i == 2) { // COLMAP in binary, a flash on the camera
        Bytes cameras, images;
        appendValue(cameras, uint64_t(1)), appendValue(cameras, uint32_t(1)), appendValue(cameras, int32_t(1));
        appendValue(cameras, uint64_t(16)), appendValue(cameras, uint64_t(8));
        for (double p : {20., 21., 8., 4.}) appendValue(cameras, p);
        appendValue(images, uint64_t(1)), appendValue(images, uint32_t(1));
        for (double x : {1., 0., 0., 0., 0., 0., 3.}) appendValue(images, x);
        appendValue(images, uint32_t(1)), append(images, "a.jpg", 6), appendValue(images, uint64_t(1));
        images.resize(images.size() + 24);
        pack(seed, "cameras.bin", cameras), pack(seed, "images.bin", images), pack(seed, "lights.json", R"({"light_rig":"camera"})"), pack(seed, "a.jpg", "");
    } else if (i == 3 || i == 4) { // DiLiGenT-MV
        MatBuilder mat;
        mat.compressed = i == 4;
        mat.add("KK", 3, 3, {20, 0, 8, 0, 21, 4, 0, 0, 1}), mat.add("Rc_1", 3, 3, {1, 0, 0, 0, 1, 0, 0, 0, 1}), mat.add("Tc_1", 3, 1, {0, 0, 3});
        pack(seed, "view_01/light_directions.txt", row), pack(seed, "view_01/light_intensities.txt", "1 2 3\n4 5 6\n");
        pack(seed, "view_01/001.png", ""), pack(seed, "view_01/002.png", ""), pack(seed, "Calib_Results.mat", mat.bytes);
    } else if (i == 5) { // OpenIllumination
        pack(seed, "light_pos.npy", npyOf("<f8", "(2, 3)", {1, 2, 3, 4, 5, 6}));
        pack(seed, "output/transforms_train.json", R"({"frames":{"A1":{"camera_angle_x":0.7,)" + poseJson + "}}}");
        pack(seed, "Lights/000/raw_undistorted/A1.JPG", ""), pack(seed, "Lights/001/raw_undistorted/A1.JPG", "");
    } else if (i == 6) { // ReNe
        pack(seed, "lset000/camera.yml", "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 20, 0., 8, 0., 21, 4, 0., 0., 1. ]\n"
                                         "dist_coeffs: [ -0.1, 0.02, 0.001, 0, 0 ]\n");
        pack(seed, "lset000/light.txt", pose), pack(seed, "lset000/data/00000_image.png", ""), pack(seed, "lset000/data/00000_pose.txt", pose);
    } else if (i == 7) { // NeRF-style, and one that needs the table
        pack(seed, "transforms.json", R"({"camera_angle_x":0.7,"camera_axes":"opencv","frames":[{"file_path":"a.jpg","k1":0.1,)" + poseJson +
                                          R"(,"light_position":[1,2,3],"light_intensity":4},{"file_path":"b.png",)" + poseJson + R"(,"light_direction":[0,0,1],"light_color":[1,2,3]}]})");
        pack(seed, "a.jpg", ""), pack(seed, "b.png", "");
    } else if (i == 8) {
        pack(seed, "transforms.json", R"({"fl_x":20,"frames":[{"file_path":"a",)" + poseJson + "}]}");
        pack(seed, "lights.csv", "image;direction_x;direction_y;direction_z\na;0;0;1\n"), pack(seed, "a.png", "");
    }
    if (seed.empty() || seed.size() > cap) return 0;
    std::copy_n(reinterpret_cast<const uint8_t*>(seed.data()), seed.size(), out);
    return seed.size();
}
