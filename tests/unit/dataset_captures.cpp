// Published captures with layouts of their own: DiLiGenT-MV, OpenIllumination, ReNe; and the files that their calibrations come in.
#include "dataset_support.h"

#include "base/text.h"
#include "dataset_matrix_builders.h"
#include "interchange/matrix_file.h"

#include <algorithm>

using namespace nacre;

namespace {

constexpr int kWidth = 16, kHeight = 8;

std::string textOf(const Bytes& bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

Camera cameraOf(int i)
{
    Camera camera = lookAtOrigin({3 * std::cos(0.5 * i), 3 * std::sin(0.5 * i), 1.0}, kWidth);
    camera.height = kHeight, camera.cx = 7.5, camera.cy = 4.25, camera.fy = 23;
    return camera;
}

/// Camera to world for OpenCV's axes.
glm::dmat4 openCvPose(const Camera& camera)
{
    glm::dmat4 pose = camera.worldFromCamera;
    pose[1] = -pose[1], pose[2] = -pose[2];
    return pose;
}

std::string rowsOf(const glm::dmat4& m)
{
    std::string out;
    for (int r = 0; r < 4; ++r)
        for (int c = 0; c < 4; ++c) out.append(numberText(m[c][r])).append(c < 3 ? " " : "\n");
    return out;
}

void checkSameCamera(const Camera& a, const Camera& b)
{
    CHECK(a.width == b.width);
    CHECK(a.height == b.height);
    for (double Camera::*k : {&Camera::fx, &Camera::fy, &Camera::cx, &Camera::cy}) CHECK(b.*k == doctest::Approx(a.*k).epsilon(1e-12));
    for (int c = 0; c < 4; ++c)
        for (int r = 0; r < 4; ++r) CHECK(std::fabs(a.worldFromCamera[c][r] - b.worldFromCamera[c][r]) < 1e-9);
}

OlatDataset mustLoad(const TempFolder& folder, const std::string& name = "")
{
    Result<OlatDataset> dataset = loadDataset((folder.path / name).string());
    if (!dataset) FAIL(dataset.error().message);
    return *dataset;
}

bool warns(const OlatDataset& dataset, const char* words)
{
    return std::any_of(dataset.warnings.begin(), dataset.warnings.end(), [&](const std::string& w) { return mentions(w, words); });
}

Bytes wide16() // 16-bit grey PNG
{
    PngBuilder png;
    png.width = kWidth, png.height = kHeight, png.bitDepth = 16, png.colorType = 0;
    png.rows.clear();
    for (int y = 0; y < kHeight; ++y) {
        png.rows.push_back(0);
        for (int x = 0; x < kWidth; ++x) png.rows.push_back(0x40), png.rows.push_back(0x01);
    }
    return png.build();
}

} // namespace

TEST_CASE("MAT files: compressed or not, narrow or wide values; cut off or changed anywhere they are an error or hold what they held")
{
    for (const bool compressed : {false, true}) {
        MatBuilder mat;
        mat.compressed = compressed;
        mat.add("KK", 2, 3, {1.5, 2, 3, 4, 5, 6});
        mat.singleBytes = true;
        mat.add("a_longer_name", 1, 3, {7, 8, 250});
        const auto all = decodeMat(mat.bytes, "a.mat");
        if (!all) FAIL(all.error().message);
        REQUIRE(all->size() == 2);
        const Matrix& kk = all->at("KK");
        CHECK(std::pair(kk.rows, kk.columns) == std::pair(size_t(2), size_t(3)));
        CHECK(kk.values == std::vector<double>{1.5, 2, 3, 4, 5, 6});
        CHECK(kk.at(1, 0) == 4);
        CHECK(all->at("a_longer_name").values == std::vector<double>{7, 8, 250});
        for (size_t n = 0; n < mat.bytes.size(); ++n) {
            const auto cut = decodeMat(std::span(mat.bytes).first(n), "cut.mat");
            if (cut) CHECK(cut->size() < 2); // between two variables
            else checkError(cut.error(), ErrorCode::kBadInput, {"cut.mat", "MAT"});
        }
        if (compressed)
            for (size_t n = 136; n < mat.bytes.size(); ++n) { // the checksum sees what the syntax does not
                Bytes damaged = mat.bytes;
                damaged[n] ^= std::byte(4);
                const auto read = decodeMat(damaged, "damaged.mat");
                if (!read) continue;
                for (const auto& [name, matrix] : *read) CHECK(matrix.values == all->at(name).values);
            }
    }
    MatBuilder hdf;
    hdf.bytes[125] = std::byte(2);
    checkError(decodeMat(hdf.bytes, "a.mat").error(), ErrorCode::kUnsupported, {"7.3", "-v7"});
    MatBuilder large;
    large.compressed = true;
    large.add("big", 200, 200, std::vector<double>(40000, 1.0));
    large.add("small", 1, 1, {3});
    const auto some = decodeMat(large.bytes, "a.mat");
    if (!some) FAIL(some.error().message);
    CHECK(some->size() == 1); // what is too large for a calibration is passed over
}

TEST_CASE("NumPy files: types, orders and shapes; cut off anywhere they are an error")
{
    const Bytes whole = npyOf("<f8", "(2, 3)", {1, 2, 3, 4, 5, 6});
    const auto m = decodeNpy(whole, "a.npy");
    if (!m) FAIL(m.error().message);
    CHECK(std::pair(m->rows, m->columns) == std::pair(size_t(2), size_t(3)));
    CHECK(m->at(1, 0) == 4);
    for (size_t n = 0; n < whole.size(); ++n) CHECK(!decodeNpy(std::span(whole).first(n), "cut.npy"));
    CHECK(decodeNpy(npyOf("<f4", "(3, 2)", {1, 2, 3, 4, 5, 6}, true), "a.npy")->at(1, 0) == 2);
    CHECK(decodeNpy(npyOf("<f8", "(3,)", {1, 2, 3}), "a.npy")->rows == 3);
    checkError(decodeNpy(npyOf("<U4", "(3,)", {1, 2, 3}), "a.npy").error(), ErrorCode::kUnsupported, {"a.npy", "<U4"});
    checkError(decodeNpy(npyOf("<f8", "(2, 3, 4)", {1}), "a.npy").error(), ErrorCode::kUnsupported, {"dimensions"});
    for (const char* shape : {"(1000000000, 1000000000)", "(-1, 3)", "(0.5, 2)", "(0, 1e300)"}) {
        const auto wrong = decodeNpy(npyOf("<f8", shape, {1, 2, 3}), "a.npy");
        REQUIRE(!wrong);
        checkError(wrong.error(), ErrorCode::kBadInput, {"a.npy"});
    }
}

TEST_CASE("numbers of OpenCV's YAML and of plain text")
{
    const std::string yaml = "%YAML:1.0\n---\nimage_size: [ 16, 8 ] # pixels\ncamera_matrix: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   data: [ 1., -2e3,\n"
                             "       3., 4. ]\ndist:\n  - - -0.5\n    - 0.25\n\"quoted\": 7\nname: abc 5\n";
    const auto numbers = decodeYamlNumbers(std::as_bytes(std::span(yaml)), "a.yml");
    REQUIRE(numbers);
    CHECK(numbers->at("camera_matrix") == std::vector<double>{1, -2000, 3, 4});
    CHECK(numbers->at("image_size") == std::vector<double>{16, 8});
    CHECK(numbers->at("dist") == std::vector<double>{-0.5, 0.25});
    CHECK(numbers->at("quoted") == std::vector<double>{7});
    const auto text = [](const std::string& t) { return decodeTextMatrix(std::as_bytes(std::span(t)), "a.txt"); };
    CHECK(text("# head\n1 2\r\n\n3,+4e0")->values == std::vector<double>{1, 2, 3, 4});
    checkError(text("1 2\n3\n").error(), ErrorCode::kBadInput, {"a.txt: line 2", "expected 2"});
    checkError(text("1 x\n").error(), ErrorCode::kBadInput, {"a.txt: line 1", "'1 x'"});
    checkError(text("1 inf\n").error(), ErrorCode::kBadInput, {"a.txt: line 1"});
    checkError(text("\n").error(), ErrorCode::kBadInput, {"a.txt", "no numbers"});
}

TEST_CASE("DiLiGenT-MV: views of Calib_Results.mat, directional lights in the camera's frame, linear 16-bit images, masks; the tenth view is held out")
{
    TempFolder folder;
    MatBuilder mat;
    mat.compressed = true;
    mat.add("KK", 3, 3, {22.4, 0, 7, 0, 23, 3.75, 0, 0, 1});
    for (int view = 1; view <= 10; ++view) {
        const glm::dmat4 pose = openCvPose(cameraOf(view));
        const glm::dmat3 r = glm::transpose(glm::dmat3(pose));
        const glm::dvec3 t = r * -glm::dvec3(pose[3]);
        mat.add("Rc_" + std::to_string(view), 3, 3, {r[0][0], r[1][0], r[2][0], r[0][1], r[1][1], r[2][1], r[0][2], r[1][2], r[2][2]});
        mat.add("Tc_" + std::to_string(view), 3, 1, {t.x, t.y, t.z});
        const std::string name = std::string(view < 10 ? "view_0" : "view_") + std::to_string(view) + "/";
        for (const char* file : {"001.png", "002.png", "mask.png"}) folder.writeText(name + file, textOf(wide16()));
        folder.writeText(name + "Normal_gt.png", "not an image of a light");
        folder.writeText(name + "light_directions.txt", "0 0 1\n0.6 0 0.8\n");
        folder.writeText(name + "light_intensities.txt", "1 2 3\n4 5 6\n");
    }
    folder.writeText("Calib_Results.mat", textOf(mat.bytes));
    const OlatDataset dataset = mustLoad(folder);
    CHECK(dataset.convention == "diligent-mv");
    CHECK(dataset.colorSpace == ColorSpace::kLinear);
    CHECK(!dataset.colorSpaceIsGuess);
    const OlatSplit &train = *dataset.find("train"), &test = *dataset.find("test");
    CHECK(train.cameras.size() == 9);
    CHECK(train.images.size() == 18);
    CHECK(test.images.size() == 2);
    for (int view = 1; view <= 9; ++view) {
        const OlatImage& image = train.images[size_t(2 * view - 1)]; // under the second light
        const Camera expected = cameraOf(view);
        checkSameCamera(expected, train.cameras[image.camera]);
        const glm::dvec3 world = glm::dmat3(expected.worldFromCamera) * glm::dvec3(0.6, 0, 0.8);
        CHECK(image.light.type == LightType::kDirectional);
        CHECK(glm::distance(glm::dvec3(image.light.directionToLight), world) < 1e-6);
        CHECK(image.light.intensity == glm::vec3(4, 5, 6));
        CHECK(mentions(image.maskPath, "mask.png"));
    }
    ImageCache cache(dataset, 1 << 20);
    const auto pixels = cache.load(train, 0);
    if (!pixels) FAIL(pixels.error().message);
    const float value = float(0x4001) / 65535;
    CHECK((*pixels)->rgba[0] == doctest::Approx(value * value).epsilon(1e-4)); // linear, times the coverage that the mask has
    folder.writeText("view_03/light_intensities.txt", "1 2 3\n");
    checkError(loadDataset(folder.path.string()).error(), ErrorCode::kBadInput, {"light_intensities.txt", "1 lines, expected 2"});
    folder.writeText("view_03/light_intensities.txt", "1 2 3\n4 0 6\n");
    checkError(loadDataset(folder.path.string()).error(), ErrorCode::kBadInput, {"light_intensities.txt", "light 2"});
    MatBuilder without;
    without.add("KK", 3, 3, {22.4, 0, 7, 0, 23, 3.75, 0, 0, 1});
    folder.writeText("Calib_Results.mat", textOf(without.bytes));
    checkError(loadDataset(folder.path.string()).error(), ErrorCode::kBadInput, {"Calib_Results.mat", "Rc_1"});
}

TEST_CASE("OpenIllumination: cameras by name in OpenCV axes, every light of light_pos.npy from the root, object masks")
{
    TempFolder folder;
    folder.writeText("light_pos.npy", textOf(npyOf("<f8", "(3, 3)", {1, 2, 3, 4, 5, 6, 7, 8, 9})));
    const std::string object = "OLAT/obj_01_car/";
    for (const char* split : {"train", "test"}) {
        json d;
        for (int i = 0; i < 3; ++i) {
            const std::string id = std::string(*split == 't' && split[1] == 'r' ? "A" : "B") + std::to_string(i);
            d["frames"][id] = {{"file_path", "./images/" + id}, {"rotation", 0}, {"camera_angle_x", 0.7}, {"calib_imgw", 2656}, {"light_idx", 0},
                               {"transform_matrix", toJson(openCvPose(cameraOf(i)))}};
            for (const char* light : {"000", "001", "002"}) folder.writeText(object + "Lights/" + light + "/raw_undistorted/" + id + ".JPG", textOf(flatJpeg(90, 80, 70)));
            folder.writeText(object + "output/obj_masks/" + id + ".png", textOf(wide16()));
        }
        folder.writeText(object + "output/transforms_" + std::string(split) + ".json", d.dump());
    }
    const OlatDataset dataset = mustLoad(folder, "OLAT/obj_01_car");
    CHECK(dataset.convention == "openillumination");
    CHECK(dataset.colorSpace == ColorSpace::kSrgb);
    CHECK(!dataset.backgroundInView);
    CHECK(warns(dataset, "no calibrated light intensity"));
    for (const char* split : {"train", "test"}) {
        const OlatSplit& s = *dataset.find(split);
        REQUIRE(s.images.size() == 9);
        CHECK(s.cameras.size() == 3);
        for (size_t k = 0; k < 9; ++k) {
            Camera expected = cameraOf(int(k / 3));
            expected.fx = expected.fy = 0.5 * kWidth / std::tan(0.35), expected.cx = 8, expected.cy = 4;
            checkSameCamera(expected, s.cameras[s.images[k].camera]);
            const float first = float(1 + 3 * (k % 3));
            CHECK(s.images[k].light.position == glm::vec3(first, first + 1, first + 2));
            CHECK(mentions(s.images[k].maskPath, "obj_masks"));
        }
    }
    ImageCache cache(dataset, 1 << 20);
    CHECK(cache.load(dataset.splits[0], 0));
    std::filesystem::remove(folder.file("light_pos.npy"));
    checkError(loadDataset(folder.file("OLAT/obj_01_car")).error(), ErrorCode::kBadInput, {"light_pos.npy"});
}

TEST_CASE("ReNe: lights and views by folder, OpenCV's camera with its lens; benchmark views are left out, test has views and lights of its own")
{
    TempFolder folder;
    for (const int light : {0, 1, 2}) {
        const std::string set = "lset00" + std::to_string(light) + "/";
        folder.writeText(set + "camera.yml", "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 22.4, 0., 7., 0., 23.,\n"
                                             "       3.75, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
                                             "   data: [ -0.1, 0.02, 0.001, -0.002, 0.003 ]\n");
        folder.writeText(set + "light.txt", "1 0 0 " + std::to_string(light) + "\n0 1 0 2\n0 0 1 3.5\n0 0 0 1\n");
        for (int view = 0; view < 11; ++view) {
            const std::string name = set + (view < 10 ? "data/0000" : "data/000") + std::to_string(view);
            folder.writeText(name + "_image.jpg", textOf(flatJpeg(90, 80, 70)));
            folder.writeText(name + "_pose.txt", rowsOf(openCvPose(cameraOf(view))));
        }
    }
    const OlatDataset dataset = mustLoad(folder);
    CHECK(dataset.convention == "rene");
    CHECK(dataset.backgroundInView);
    const OlatSplit &train = *dataset.find("train"), &test = *dataset.find("test");
    CHECK(train.images.size() == 2 * 8); // lights 0 and 1, views 0 to 10 without 4, 8, 9
    REQUIRE(test.images.size() == 1);    // light 2, view 9
    CHECK(test.images[0].light.position == glm::vec3(2, 2, 3.5f));
    checkSameCamera(cameraOf(9), test.cameras[0]);
    checkSameCamera(cameraOf(0), train.cameras[0]);
    REQUIRE(!train.files.empty());
    CHECK(train.files[0].k[2] == 0.003);
    CHECK(train.files[0].p[1] == -0.002);
    std::filesystem::remove_all(folder.path / "lset002");
    CHECK(mustLoad(folder).find("test")->images.size() == 2); // without the benchmark's lights: view 9 under the others
    folder.writeText("lset001/data/00003_pose.txt", "1 0 0\n0 1 0\n");
    checkError(loadDataset(folder.path.string()).error(), ErrorCode::kBadInput, {"00003_pose.txt", "4 x 4"});
}
