// COLMAP models, the light table beside them, and descriptions of the NeRF kind with a light per frame.
#include "dataset_support.h"

#include "dataset/colmap_model.h"
#include "mesh_jpeg_builder.h"

#include <algorithm>
#include <sstream>
#include <tuple>

#include <glm/gtc/quaternion.hpp>

using namespace nacre;

namespace {

constexpr int kPhotos = 12;

Camera cameraOf(int i)
{
    Camera camera = lookAtOrigin({3 * std::cos(0.5 * i), 3 * std::sin(0.5 * i), 1.0}, 16);
    camera.height = 8, camera.cx = 7.5, camera.cy = 4.25, camera.fy = 23;
    return camera;
}

/// World to camera, OpenCV axes.
void colmapPose(const Camera& camera, double q[4], double t[3])
{
    glm::dmat3 r(camera.worldFromCamera);
    r[1] = -r[1], r[2] = -r[2];
    r = glm::transpose(r);
    const glm::dquat quaternion = glm::quat_cast(r);
    const glm::dvec3 translation = r * -camera.position();
    q[0] = quaternion.w, q[1] = quaternion.x, q[2] = quaternion.y, q[3] = quaternion.z;
    for (int k = 0; k < 3; ++k) t[k] = translation[k];
}

std::string nameOf(int i) { return (i < 6 ? "left/" : "right/") + std::string("IMG ") + char('a' + i) + ".jpg"; }

/// A model of photographs with one camera of `model`; in binary with some points.
struct Model {
    std::string model = "OPENCV", parameters = "22.4 23 7.5 4.25 -0.1 0.02 0.001 -0.002";
    int id = 4;

    std::string camerasText() const { return "# a comment\n7 " + model + " 16 8 " + parameters + "\n"; }
    std::string imagesText() const
    {
        std::string out = "# a comment\n";
        for (int i = 0; i < kPhotos; ++i) {
            double q[4], t[3];
            colmapPose(cameraOf(i), q, t);
            out += std::to_string(i + 1);
            for (double x : {q[0], q[1], q[2], q[3], t[0], t[1], t[2]}) out.append(" ").append(numberText(x));
            out.append(" 7 ").append(nameOf(i)).append(i % 2 ? "\n1.5 2.5 3 4 5 -1\n" : "\n\n");
        }
        return out;
    }
    Bytes camerasBinary() const
    {
        Bytes out;
        appendValue(out, uint64_t(1)), appendValue(out, uint32_t(7)), appendValue(out, int32_t(id)), appendValue(out, uint64_t(16)), appendValue(out, uint64_t(8));
        std::istringstream numbers(parameters);
        for (double x; numbers >> x;) appendValue(out, x);
        return out;
    }
    Bytes imagesBinary() const
    {
        Bytes out;
        appendValue(out, uint64_t(kPhotos));
        for (int i = 0; i < kPhotos; ++i) {
            double q[4], t[3];
            colmapPose(cameraOf(i), q, t);
            appendValue(out, uint32_t(i + 1));
            for (double x : {q[0], q[1], q[2], q[3], t[0], t[1], t[2]}) appendValue(out, x);
            appendValue(out, uint32_t(7));
            const std::string name = nameOf(i);
            append(out, name.c_str(), name.size() + 1);
            appendValue(out, uint64_t(i % 3));
            out.resize(out.size() + size_t(24 * (i % 3)));
        }
        return out;
    }
};

void writeText(const TempFolder& folder, const Model& model, const std::string& where = "sparse/0/")
{
    folder.writeText(where + "cameras.txt", model.camerasText());
    folder.writeText(where + "images.txt", model.imagesText());
}

std::string csv(const std::string& columns = "image,light_x,light_y,light_z,intensity", int from = 0)
{
    std::string out = columns + "\n";
    for (int i = from; i < kPhotos; ++i) out.append("\"").append(nameOf(i)).append("\",").append(std::to_string(i)).append(",2,3.5,").append(std::to_string(10 + i)).append("\n");
    return out;
}

void writePhotos(const TempFolder& folder)
{
    const Bytes jpeg = flatJpeg(128, 100, 90);
    for (int i = 0; i < kPhotos; ++i) folder.writeText("images/" + nameOf(i), std::string(reinterpret_cast<const char*>(jpeg.data()), jpeg.size()));
}

OlatDataset mustLoad(const TempFolder& folder)
{
    Result<OlatDataset> dataset = loadDataset(folder.path.string());
    if (!dataset) FAIL(dataset.error().message);
    return *dataset;
}

bool warns(const OlatDataset& dataset, const char* words)
{
    return std::any_of(dataset.warnings.begin(), dataset.warnings.end(), [&](const std::string& w) { return mentions(w, words); });
}

} // namespace

TEST_CASE("a COLMAP model, text or binary, has its cameras, its lens and the lights of its table")
{
    for (const char* form : {"text", "binary", "in the folder itself"}) {
        CAPTURE(form);
        TempFolder folder;
        writePhotos(folder);
        const Model model;
        if (*form == 'b') {
            const Bytes cameras = model.camerasBinary(), images = model.imagesBinary();
            folder.writeText("sparse/cameras.bin", {reinterpret_cast<const char*>(cameras.data()), cameras.size()});
            folder.writeText("sparse/images.bin", {reinterpret_cast<const char*>(images.data()), images.size()});
        } else writeText(folder, model, *form == 't' ? "sparse/0/" : "");
        folder.writeText("lights.csv", csv());
        const OlatDataset dataset = mustLoad(folder);
        CHECK(dataset.convention == "colmap");
        CHECK(dataset.colorSpace == ColorSpace::kSrgb);
        CHECK(dataset.backgroundInView); // photographs without masks
        const OlatSplit &train = *dataset.find("train"), &test = *dataset.find("test");
        CHECK(train.images.size() == kPhotos - 1);
        CHECK(test.images.size() == 1); // the tenth
        CHECK(warns(dataset, "every tenth"));
        for (const OlatSplit* split : {&train, &test})
            for (size_t k = 0; k < split->images.size(); ++k) {
                const OlatImage& image = split->images[k];
                const int i = split == &test ? 9 : int(k < 9 ? k : k + 1);
                CHECK(image.path == folder.file("images/" + nameOf(i)));
                CHECK(image.light.position == glm::vec3(float(i), 2, 3.5f));
                CHECK(image.light.intensity == glm::vec3(float(10 + i)));
                const Camera &camera = split->cameras[image.camera], expected = cameraOf(i);
                for (int c = 0; c < 4; ++c)
                    for (int r = 0; r < 4; ++r) CHECK(std::fabs(camera.worldFromCamera[c][r] - expected.worldFromCamera[c][r]) < 1e-12);
                const FileCamera& file = split->files[image.camera];
                CHECK(file == FileCamera{16, 8, 22.4, 23, 7.5, 4.25, {-0.1, 0.02}, {0.001, -0.002}});
                CHECK(std::tuple(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == std::tuple(16, 8, 22.4, 23.0, 7.5, 4.25));
            }
        ImageCache cache(dataset, 1 << 20);
        CHECK(cache.load(test, 0));
    }
}

TEST_CASE("a light far from the origin keeps its place to more digits than float32 has")
{
    TempFolder folder;
    writePhotos(folder);
    writeText(folder, Model());
    std::string table = "image,light_x,light_y,light_z,intensity\n";
    for (int i = 0; i < kPhotos; ++i) table.append("\"").append(nameOf(i)).append("\",100000.001,-200000.002,300000.003,10\n");
    folder.writeText("lights.csv", table);
    for (const OlatSplit& split : mustLoad(folder).splits)
        for (const OlatImage& image : split.images)
            for (int k = 0; k < 3; ++k)
                CHECK(double(image.light.position[k]) + double(image.light.positionRest[k]) == doctest::Approx(k == 0 ? 100000.001 : k == 1 ? -200000.002 : 300000.003).epsilon(1e-13));
}

TEST_CASE("every camera model of COLMAP is read or refused for what it is")
{
    struct Case {
        const char *model, *parameters;
        int id;
        double fx, fy, cx, cy;
        FileCamera lens;
    };
    const Case cases[] = {{"SIMPLE_PINHOLE", "20 8 4", 0, 20, 20, 8, 4, {}},
                          {"PINHOLE", "20 21 8 4", 1, 20, 21, 8, 4, {}},
                          {"SIMPLE_RADIAL", "20 8 4 0.1", 2, 20, 20, 8, 4, {16, 8, 20, 20, 8, 4, {0.1}, {}}},
                          {"RADIAL", "20 8 4 0.1 0.2", 3, 20, 20, 8, 4, {16, 8, 20, 20, 8, 4, {0.1, 0.2}, {}}},
                          {"OPENCV", "20 21 8 4 0 0 0 0", 4, 20, 21, 8, 4, {}},
                          {"FULL_OPENCV", "20 21 8 4 1 2 7 8 3 4 5 6", 6, 20, 21, 8, 4, {16, 8, 20, 21, 8, 4, {1, 2, 3, 4, 5, 6}, {7, 8}}},
                          {"OPENCV_FISHEYE", "20 21 8 4 0 0 0 0", 5, 0, 0, 0, 0, {}},
                          {"FOV", "20 21 8 4 0.5", 7, 0, 0, 0, 0, {}},
                          {"THIN_PRISM_FISHEYE", "20 21 8 4 0 0 0 0 0 0 0 0", 10, 0, 0, 0, 0, {}}};
    for (const Case& c : cases)
        for (const bool binary : {false, true}) {
            INFO(c.model << " " << binary);
            TempFolder folder;
            writePhotos(folder);
            const Model model{c.model, c.parameters, c.id};
            if (binary) {
                const Bytes cameras = model.camerasBinary(), images = model.imagesBinary();
                folder.writeText("cameras.bin", {reinterpret_cast<const char*>(cameras.data()), cameras.size()});
                folder.writeText("images.bin", {reinterpret_cast<const char*>(images.data()), images.size()});
            } else writeText(folder, model);
            folder.writeText("lights.csv", csv());
            const Result<OlatDataset> dataset = loadDataset(folder.path.string());
            if (c.fx == 0) {
                REQUIRE(!dataset);
                checkError(dataset.error(), ErrorCode::kUnsupported, {c.model, "undistort", "camera 7"});
                continue;
            }
            if (!dataset) FAIL(dataset.error().message);
            const OlatSplit& train = dataset->splits[0];
            const Camera& camera = train.cameras[0];
            CHECK(std::tuple(camera.fx, camera.fy, camera.cx, camera.cy) == std::tuple(c.fx, c.fy, c.cx, c.cy));
            REQUIRE(train.files.empty() == (c.lens.width == 0));
            if (c.lens.width) CHECK(train.files[0] == c.lens);
        }
}

TEST_CASE("a binary model cut off anywhere, or with a wrong word, is an error that names the file")
{
    const Model model;
    const Bytes cameras = model.camerasBinary(), images = model.imagesBinary();
    REQUIRE(readColmapBinary(cameras, images, "c", "i"));
    for (size_t n = 0; n < cameras.size(); ++n) checkError(readColmapBinary(std::span(cameras).first(n), images, "c.bin", "i.bin").error(), ErrorCode::kBadInput, {"c.bin"});
    for (size_t n = 0; n < images.size(); ++n) {
        const auto cut = readColmapBinary(cameras, std::span(images).first(n), "c.bin", "i.bin");
        REQUIRE(!cut);
        checkError(cut.error(), ErrorCode::kBadInput, {"i.bin"});
    }
    Bytes huge = images;
    for (size_t b = 0; b < 8; ++b) huge[b] = std::byte(0xff);
    checkError(readColmapBinary(cameras, huge, "c", "i.bin").error(), ErrorCode::kBadInput, {"i.bin", "cut off"});
    const auto text = [&](const std::string& c, const std::string& i) {
        return readColmapText(std::as_bytes(std::span(c)), std::as_bytes(std::span(i)), "c.txt", "i.txt");
    };
    const std::string good = model.camerasText(), pose = "1 1 0 0 0 0 0 3 7 a.jpg\n\n";
    CHECK(text(good, pose));
    checkError(text("7 PINHOLE 16 8 20 21 8\n", pose).error(), ErrorCode::kBadInput, {"c.txt: line 1", "PINHOLE", "4"});
    checkError(text("7 PINHOLE 0 8 20 21 8 4\n", pose).error(), ErrorCode::kBadInput, {"c.txt: line 1", "0 x 8"});
    checkError(text(good + "7 PINHOLE 16 8 20 21 8 4\n", pose).error(), ErrorCode::kBadInput, {"c.txt: line 3", "twice"});
    checkError(text(good, "1 1 0 0 0 0 0 3 8 a.jpg\n\n").error(), ErrorCode::kBadInput, {"i.txt", "camera 8"});
    checkError(text(good, "1 1 1 0 0 0 0 3 7 a.jpg\n\n").error(), ErrorCode::kBadInput, {"i.txt: line 1", "quaternion"});
    checkError(text(good, "1 1 0 0 0 0 0 nan 7 a.jpg\n\n").error(), ErrorCode::kBadInput, {"i.txt: line 1"});
    checkError(text(good, "# nothing\n").error(), ErrorCode::kBadInput, {"i.txt", "no images"});
}

TEST_CASE("the light table: names with folders or without, directions, exposure, splits, masks; photographs without a light are left out and counted")
{
    TempFolder folder;
    writePhotos(folder);
    writeText(folder, Model());
    folder.writeText("masks/left/IMG a.jpg.png", "no image; it is there");
    std::string table = "image;direction_x;direction_y;direction_z;intensity_r;intensity_g;intensity_b;exposure_ev;gain;split\r\n";
    for (int i = 0; i < 8; ++i) table += nameOf(i).substr(nameOf(i).find('/') + 1) + ";0;0;2;1;2;3;1;2;" + (i == 3 ? "near" : "train") + "\r\n";
    folder.writeText("lights.csv", "\xef\xbb\xbf" + table);
    const OlatDataset dataset = mustLoad(folder);
    REQUIRE(dataset.splits.size() == 2);
    CHECK(dataset.find("train")->images.size() == 7);
    CHECK(dataset.find("near")->images.size() == 1);
    CHECK(warns(dataset, "4 of 12 photographs left out"));
    const OlatImage& image = dataset.find("train")->images[0];
    CHECK(image.light.type == LightType::kDirectional);
    CHECK(image.light.directionToLight == glm::vec3(0, 0, 1));
    CHECK(image.light.intensity == glm::vec3(1, 2, 3));
    CHECK(image.gain == glm::vec3(0.25f)); // 2 times the radiance by exposure, and again by gain
    CHECK(mentions(image.maskPath, "IMG a.jpg.png"));
    CHECK(!dataset.backgroundInView);
}

TEST_CASE("a table that does not fit says what and where")
{
    TempFolder folder;
    writePhotos(folder);
    writeText(folder, Model());
    const auto fails = [&](const std::string& table, std::initializer_list<const char*> words) {
        folder.writeText("lights.csv", table);
        const Result<OlatDataset> dataset = loadDataset(folder.path.string());
        REQUIRE(!dataset);
        checkError(dataset.error(), ErrorCode::kBadInput, words);
    };
    checkError(loadDataset(folder.path.string()).error(), ErrorCode::kBadInput, {"lights.csv", "light_rig"});
    fails("", {"lights.csv", "no line"});
    fails("name,light_x\n", {"line 1", "'image'"});
    fails("image,light_x,lightness\n", {"line 1", "'lightness'"});
    fails("image,light_x,light_x\n", {"line 1", "twice"});
    fails(csv() + "b.jpg,1,2,3\n", {"line 14", "4 fields, expected 5"});
    fails(csv() + "b.jpg,1,2,x,4\n", {"line 14", "light_z", "'x'"});
    fails(csv() + "b.jpg,1,2,,4\n", {"line 14", "light_x, light_y, light_z"});
    fails(csv() + "b.jpg,1,2,3,-4\n", {"line 14", "negative"});
    fails(csv() + "b.jpg,1,2,1e12,4\n", {"line 14", "1e9"});
    fails(csv() + nameOf(3) + ",1,2,3,4\n", {"line 14", "twice"});
    fails(csv() + ",1,2,3,4\n", {"line 14", "name"});
    fails("image,light_x,light_y,light_z\nother.jpg,1,2,3\n", {"none of the 12", "other.jpg"});
    fails("image,light_x,light_y,light_z,intensity\n" + nameOf(0) + ",1,2,3,4\n" + nameOf(1) + ",1,2,3,\n", {"1 of 2", "intensity"});
    folder.writeText("lights.json", R"({"images": {"a.jpg": {"position": [1, 2, 3]}}})");
    fails(csv(), {"two light tables"});
}

TEST_CASE("a flash on the camera needs no table; its light is where the camera is, of an intensity by convention")
{
    TempFolder folder;
    writePhotos(folder);
    writeText(folder, Model());
    folder.writeText("lights.json", R"({"light_rig": "camera", "black_level": 0.01})");
    const OlatDataset dataset = mustLoad(folder);
    CHECK(dataset.rig == LightRig::kCamera);
    CHECK(dataset.blackLevel == 0.01f);
    CHECK(warns(dataset, "no calibrated light intensity"));
    for (const OlatSplit& split : dataset.splits)
        for (const OlatImage& image : split.images) CHECK(glm::distance(glm::dvec3(image.light.position), split.cameras[image.camera].position()) < 1e-6);
}

TEST_CASE("NeRF descriptions with a light per frame: positions or directions, OpenCV axes, files without extension, or a light table")
{
    for (const char* kind : {"position", "direction", "array", "table"}) {
        CAPTURE(kind);
        TempFolder folder;
        writePhotos(folder);
        json d = {{"fl_x", 22.4}, {"fl_y", 23}, {"cx", 7.5}, {"cy", 4.25}, {"w", 16}, {"h", 8}, {"k1", -0.1}, {"camera_axes", "opencv"}};
        for (int i = 0; i < kPhotos; ++i) {
            glm::dmat4 pose = cameraOf(i).worldFromCamera;
            pose[1] = -pose[1], pose[2] = -pose[2];
            const std::string name = nameOf(i);
            json frame = {{"file_path", "./images/" + name.substr(0, name.size() - 4)}, {"transform_matrix", toJson(pose)}};
            if (*kind == 'p') frame["light_position"] = {i, 2, 3.5}, frame["light_intensity"] = 10 + i;
            if (*kind == 'd') frame["light_direction"] = {0, 0, 4};
            if (*kind == 'a') frame["light"] = {i, 2, 3.5}, frame["light_color"] = {1, 2, 3};
            d["frames"].push_back(frame);
        }
        folder.writeText("transforms.json", d.dump());
        std::string table = "image,light_x,light_y,light_z,intensity,split\n";
        for (int i = 0; i < kPhotos; ++i) {
            const std::string name = nameOf(i);
            table += "images/" + name.substr(0, name.size() - 4) + "," + std::to_string(i) + ",2,3.5,10," + (i < 8 ? "train" : "test") + "\n";
        }
        if (*kind == 't') folder.writeText("lights.csv", table);
        const OlatDataset dataset = mustLoad(folder);
        CHECK(dataset.convention == "nerf");
        const OlatSplit& train = dataset.splits[0];
        REQUIRE(train.images.size() == (*kind == 't' ? 8 : kPhotos));
        for (size_t i = 0; i < train.images.size(); ++i) {
            const OlatImage& image = train.images[i];
            const Camera& camera = train.cameras[image.camera];
            CHECK(image.path == folder.file("images/" + nameOf(int(i))));
            CHECK(glm::distance(camera.position(), cameraOf(int(i)).position()) < 1e-12);
            CHECK(glm::distance(glm::dvec3(camera.worldFromCamera[2]), glm::dvec3(cameraOf(int(i)).worldFromCamera[2])) < 1e-12);
            CHECK(train.files[image.camera].k[0] == -0.1);
            if (*kind == 'd') CHECK(image.light.directionToLight == glm::vec3(0, 0, 1));
            else CHECK(image.light.position == glm::vec3(float(i), 2, 3.5f));
        }
        CHECK(warns(dataset, "no calibrated") == (*kind == 'd'));
    }
}
