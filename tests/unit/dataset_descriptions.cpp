// Descriptions as other programs write them: names, sizes, intrinsics, lens distortion, colour keys. The right dataset, or one clear line.
#include "dataset_support.h"

#include <array>
#include <functional>
#include <tuple>

using namespace nacre;

namespace {

constexpr int kWidth = 40, kHeight = 30;

/// One frame of each convention, image and all. `frame` and `top` are written as they are when loading.
struct Sample {
    TempFolder folder;
    std::string convention;
    json top = {{"camera_angle_x", 0.7}}, frame;

    explicit Sample(const std::string& name) : convention(name)
    {
        frame["transform_matrix"] = toJson(lookAtOrigin({2, 0, 1}, kWidth).worldFromCamera);
        frame["file_path"] = "a.exr";
        if (convention == "canonical") frame["light"] = {{"type", "point"}, {"position", {0, 0, 4}}, {"intensity", {1, 1, 1}}};
        if (convention == "bigs") frame["light"] = {{"position", {0, 0, 4}}, {"intensity", 1}};
        if (convention == "plpos") frame["pl_pos"] = {0, 0, 4}, frame["pl_intensity"] = {1, 1, 1};
        if (convention == "sssgs") frame["file_paths"] = {"a.exr"}, frame["light_positions"] = {{0, 0, 4}}, frame.erase("file_path");
        writeImage("a.exr", kWidth, kHeight);
    }

    std::string root() const { return convention == "bigs" ? "olat_1/" : ""; }
    void writeImage(const std::string& name, int width, int height) const
    {
        std::filesystem::create_directories(std::filesystem::path(folder.file(root() + name)).parent_path());
        if (name.ends_with("png") || name.ends_with("PNG"))
            REQUIRE(writePng(folder.file(root() + name), width, height, 4, std::vector<uint8_t>(size_t(width) * size_t(height) * 4, 128)));
        else
            REQUIRE(writeExr(Image{width, height, std::vector<float>(size_t(width) * size_t(height) * 4, 0.5f)}, folder.file(root() + name)));
    }
    void setFile(const json& name) { convention == "sssgs" ? frame["file_paths"][0] = name : frame["file_path"] = name; }
    Result<OlatDataset> load(const std::string& description = "transforms_train.json") const
    {
        json all = top;
        if (!all.contains("frames")) all["frames"] = {frame};
        folder.writeText(root() + description, all.dump());
        return loadDataset(folder.path.string());
    }
    OlatDataset mustLoad(const std::string& description = "transforms_train.json") const
    {
        Result<OlatDataset> dataset = load(description);
        INFO(convention);
        REQUIRE_MESSAGE(dataset, (dataset ? "" : dataset.error().message));
        CHECK(dataset->convention == convention);
        return *dataset;
    }
    Camera camera() const { return mustLoad().splits[0].cameras[0]; }
};

constexpr const char* kConventions[] = {"canonical", "plpos", "sssgs", "bigs"};

bool warns(const OlatDataset& dataset, const char* word)
{
    return std::any_of(dataset.warnings.begin(), dataset.warnings.end(), [&](const std::string& w) { return mentions(w, word); });
}

} // namespace

TEST_CASE("lens distortion is read in every convention, at top level and in a frame, by name and from the usual lists; zero is a pinhole")
{
    struct Case {
        json keys;
        std::array<double, 8> lens; // k1..k6, p1, p2
    };
    const Case cases[] = {
        {{{"k1", 0.3}}, {0.3}},
        {{{"k1", 1}, {"k2", 2}, {"k3", 3}, {"k4", 4}, {"k5", 5}, {"k6", 6}, {"p1", 7}, {"p2", 8}}, {1, 2, 3, 4, 5, 6, 7, 8}},
        {{{"p1", 1e-3}, {"camera_model", "OPENCV"}}, {0, 0, 0, 0, 0, 0, 1e-3}},
        {{{"distortion_params", {1, 2, 7, 8}}}, {1, 2, 0, 0, 0, 0, 7, 8}},
        {{{"distortion_params", {1, 2, 3, 0, 7, 8}}}, {1, 2, 3, 0, 0, 0, 7, 8}},
        {{{"dist_coeffs", {1, 2, 7, 8, 3}}}, {1, 2, 3, 0, 0, 0, 7, 8}},
        {{{"distortion_coefficients", {1, 2, 7, 8, 3, 4, 5, 6, 0, 0, 0, 0}}}, {1, 2, 3, 4, 5, 6, 7, 8}},
        {{{"distortion", {{"k1", 0.2}}}}, {0.2}},
        {{{"camera", {{"k1", -0.2}}}}, {-0.2}},
        {{{"radial_distortion", {1, 2, 3}}, {"tangential_distortion", {7, 8}}}, {1, 2, 3, 0, 0, 0, 7, 8}},
        {{{"camera_model", "SIMPLE_RADIAL"}, {"camera_params", {50, 20, 15, 0.5}}}, {0.5}},
        {{{"camera_model", "radial"}, {"camera_params", {50, 20, 15, 1, 2}}}, {1, 2}},
        {{{"camera_model", "OPENCV"}, {"camera_params", {50, 50, 20, 15, 1, 2, 7, 8}}}, {1, 2, 0, 0, 0, 0, 7, 8}},
        {{{"camera_model", "FULL_OPENCV"}, {"camera_params", {50, 50, 20, 15, 1, 2, 7, 8, 3, 4, 5, 6}}}, {1, 2, 3, 4, 5, 6, 7, 8}},
        {{{"k1", 0}, {"k2", 0.0}, {"p1", 0}, {"p2", 0}, {"camera_model", "OPENCV"}}, {}},
        {{{"camera_model", "PINHOLE"}}, {}},
        {{{"is_fisheye", false}}, {}},
        {{{"distortion_params", {0, 0, 0, 0}}}, {}},
        {{{"k1", 1e-12}}, {}},
        {{{"camera_params", {50, 50, 20, 15, 0, 0}}}, {}},
    };
    for (const char* convention : kConventions)
        for (const Case& c : cases)
            for (const bool inFrame : {false, true}) {
                Sample sample(convention);
                (inFrame ? sample.frame : sample.top).update(c.keys);
                INFO(convention << " " << c.keys.dump());
                const OlatDataset dataset = sample.mustLoad();
                const OlatSplit& split = dataset.splits[0];
                if (c.lens == std::array<double, 8>{}) {
                    CHECK(split.files.empty());
                    continue;
                }
                REQUIRE(split.files.size() == split.cameras.size());
                const FileCamera& file = split.files[0];
                const Camera& camera = split.cameras[0];
                for (size_t i = 0; i < 8; ++i) CHECK((i < 6 ? file.k[i] : file.p[i - 6]) == c.lens[i]);
                CHECK(std::tuple(file.width, file.height, file.fx, file.fy, file.cx, file.cy) ==
                      std::tuple(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy));
            }
    Sample sample("canonical");
    sample.top["k1"] = 0.3, sample.top["k2"] = 0.1, sample.frame["k1"] = 0.2; // a frame's key is over that of the top level
    CHECK(sample.mustLoad().splits[0].files[0].k[0] == 0.2);
    CHECK(sample.mustLoad().splits[0].files[0].k[1] == 0.1);
}

TEST_CASE("what is no pinhole with OpenCV's lens, or may mean two lenses, is refused by name")
{
    const json refused[] = {{{"is_fisheye", true}}, {{"camera_model", "OPENCV_FISHEYE"}}, {{"camera_model", "opencv_fisheye"}}, {{"camera_model", "EQUIRECTANGULAR"}},
                            {{"camera_type", "THIN_PRISM_FISHEYE"}}, {{"s1", 0.1}}, {{"p3", 1e-3}}, {{"k4", 0.1}}, {{"kdist", {0.1}}},
                            {{"camera_params", {50, 50, 20, 15, 0.2, 0, 0, 0}}}, {{"distortion_params", {0, 0, 0, 0.1, 0, 0}}},
                            {{"dist_coeffs", {0, 0, 0, 0, 0, 0, 0, 0, 0.1}}}, {{"radial_distortion", {0, 0, 0, 0.1}}}};
    for (const char* convention : kConventions)
        for (const json& keys : refused)
            for (const bool inFrame : {false, true}) {
                Sample sample(convention);
                (inFrame ? sample.frame : sample.top).update(keys);
                const Result<OlatDataset> dataset = sample.load();
                INFO(convention << " " << keys.dump());
                REQUIRE(!dataset);
                checkError(dataset.error(), ErrorCode::kUnsupported, {inFrame ? "frames[0]" : "transforms_train.json"});
            }
    Sample both("canonical");
    both.top["camera_model"] = "PINHOLE", both.top["k1"] = 0.1;
    checkError(both.load().error(), ErrorCode::kBadInput, {"PINHOLE", "distortion"});
}

TEST_CASE("focal lengths come from any of the usual keys; two that disagree, the wrong order and the wrong unit are refused by name")
{
    const double f = 0.5 * kWidth / std::tan(0.35);
    const auto has = [](const Camera& c, double fx, double fy) {
        CHECK(c.fx == doctest::Approx(fx).epsilon(1e-9));
        CHECK(c.fy == doctest::Approx(fy).epsilon(1e-9));
    };
    for (const char* convention : kConventions) {
        CAPTURE(convention);
        Sample sample(convention);
        has(sample.camera(), f, f);
        sample.top["camera_angle_y"] = 0.6;
        has(sample.camera(), f, 0.5 * kHeight / std::tan(0.3));
        sample.top.erase("camera_angle_x");
        has(sample.camera(), 0.5 * kHeight / std::tan(0.3), 0.5 * kHeight / std::tan(0.3));
        sample.top = {{"fl_x", f}, {"fl_y", 0.9 * f}, {"camera_angle_x", 0.7}, {"cx", 19}, {"cy", 16}};
        has(sample.camera(), f, 0.9 * f);
        CHECK(sample.mustLoad().warnings.size() == Sample(convention).mustLoad().warnings.size());
        sample.top["w"] = kWidth, sample.top["h"] = kHeight;
        has(sample.camera(), f, 0.9 * f);
        sample.frame["fl_x"] = 1.1 * f; // a frame's own keys win over the top level
        has(sample.camera(), 1.1 * f, 1.1 * f);

        const struct {
            json top;
            std::initializer_list<const char*> words;
        } wrong[] = {
            {{{"fl_x", 1.5 * f}, {"camera_angle_x", 0.7}}, {"fl_x", "camera_angle_x"}},
            {{{"fl_x", f}, {"fl_y", f}, {"camera_angle_y", 1.2}}, {"fl_y", "camera_angle_y"}},
            {{{"camera_intrinsics", {1.4 * kWidth, 1.4 * kWidth, 0.5 * kWidth, 0.5 * kHeight}}}, {"camera_intrinsics", "[cx, cy, fx, fy]", "[fx, fy, cx, cy]"}},
            {{{"camera_intrinsics", {300, 310, 0.51 * kWidth, 0.49 * kHeight}}}, {"[fx, fy, cx, cy]"}},
            {{{"fl_x", 1.4}, {"cx", 0.5}, {"cy", 0.5}}, {"fl_x", "normalised", "40 x 30"}},
            {{{"fl_x", f}, {"cx", 0.5}, {"cy", 0.5}}, {"principal point", "normalised"}},
            {{{"camera_angle_x", 40}}, {"camera_angle_x", "degrees"}},
            {{{"camera_angle_x", 0.7}, {"width", kWidth}, {"w", 2 * kWidth}}, {"w: expected 40", "80"}},
        };
        for (const auto& c : wrong) {
            CAPTURE(c.top.dump());
            Sample bad(convention);
            bad.top = c.top;
            const Result<OlatDataset> dataset = bad.load();
            REQUIRE(!dataset);
            checkError(dataset.error(), ErrorCode::kBadInput, c.words);
        }
    }
}

TEST_CASE("intrinsics of another image size: an error where the description gives the size, a warning where only the principal point tells")
{
    for (const char* convention : kConventions) {
        CAPTURE(convention);
        for (const char* key : {"w", "width"}) {
            Sample sample(convention);
            sample.top[key] = 2 * kWidth, sample.top[*key == 'w' && key[1] ? "height" : "h"] = 2 * kHeight;
            const Result<OlatDataset> dataset = sample.load();
            REQUIRE(!dataset);
            checkError(dataset.error(), ErrorCode::kBadInput, {"a.exr", "40 x 30", "80 x 60"});
        }
        for (const double factor : {1.5, 2.0, 4.0, 0.5}) {
            Sample sample(convention);
            sample.top = {{"fl_x", 1.4 * kWidth * factor}, {"cx", 0.5 * kWidth * factor}, {"cy", 0.5 * kHeight * factor}};
            const std::string size = std::to_string(int(kWidth * factor)) + " x " + std::to_string(int(kHeight * factor));
            CHECK(warns(sample.mustLoad(), size.c_str()));
        }
        Sample outside(convention);
        outside.top["cx"] = 60;
        CHECK(warns(outside.mustLoad(), "outside"));
        Sample oblong(convention);
        oblong.top["camera_angle_y"] = 1.2;
        CHECK(warns(oblong.mustLoad(), "not square"));
    }
}

TEST_CASE("images of several sizes in one split each keep their own; a file that cannot be read does not end the loading")
{
    Sample sample("plpos");
    sample.writeImage("b.exr", 20, 20);
    sample.folder.writeText("c.exr", "no image");
    json frames = json::array();
    for (const char* name : {"a.exr", "b.exr", "c.exr"}) {
        frames.push_back(sample.frame);
        frames.back()["file_path"] = name;
    }
    sample.top["frames"] = frames;
    const OlatDataset dataset = sample.mustLoad();
    const OlatSplit& split = dataset.splits[0];
    const auto sizeOf = [&](size_t i) { return split.cameras[split.images[i].camera].width; };
    CHECK(sizeOf(0) == kWidth);
    CHECK(sizeOf(1) == 20);
    CHECK(split.cameras[split.images[1].camera].fx == doctest::Approx(10 / std::tan(0.35)));
    CHECK(sizeOf(2) == 20);
    ImageCache cache(dataset, 1 << 20);
    CHECK(cache.load(split, 0));
    CHECK(cache.load(split, 1));
    CHECK(!cache.load(split, 2));
}

TEST_CASE("names of images: capitals in the extension, no extension, one that is there already")
{
    for (const char* convention : kConventions)
        for (const char* onDisk : {"b.exr", "b.EXR", "sub/b.Exr", "my.scene.b.exr", "b.png", "b.PNG"})
            for (const bool inFull : {true, false}) {
                if (std::string(convention) == "bigs" && std::string(onDisk).find("exr") == std::string::npos && std::string(onDisk).find("EXR") == std::string::npos) continue;
                CAPTURE(convention);
                CAPTURE(onDisk);
                Sample sample(convention);
                sample.writeImage(std::string(onDisk) == "sub/b.Exr" ? "sub/b.exr" : onDisk, kWidth, kHeight);
                std::string name(onDisk);
                if (!inFull) name = name.substr(0, name.size() - 4);
                if (std::string(onDisk) == "sub/b.Exr" && inFull) name = "./sub/b.Exr"; // written otherwise than it is called
                sample.setFile(name);
                const OlatDataset dataset = sample.mustLoad();
                CHECK(ImageCache(dataset, 1 << 20).load(dataset.splits[0], 0));
            }
    Sample sample("plpos");
    sample.writeImage("d.EXR", kWidth, kHeight);
    sample.frame["file_path"] = "d";
    for (const char* extension : {".EXR", ".exr", "exr", ""}) {
        sample.frame["file_ext"] = extension;
        CHECK(mentions(sample.mustLoad().splits[0].images[0].path, "d.EXR"));
    }
}

TEST_CASE("missing images are counted and the first is named")
{
    for (const char* convention : {"canonical", "plpos", "bigs"}) {
        Sample sample(convention);
        json frames = json::array();
        for (const char* name : {"no1.exr", "a.exr", "no2.exr", "no3.exr"}) {
            frames.push_back(sample.frame);
            frames.back()["file_path"] = name;
        }
        sample.top["frames"] = frames;
        const Result<OlatDataset> dataset = sample.load();
        REQUIRE(!dataset);
        checkError(dataset.error(), ErrorCode::kBadInput, {"frames[0].file_path", "no1.exr", "3 of 4"});

        frames[2]["file_path"] = frames[3]["file_path"] = "a.exr"; // one of four: whoever loads images can do without
        sample.top["frames"] = frames;
        CHECK(warns(sample.mustLoad(), "1 of 4"));
    }
}

TEST_CASE("a lone transforms.json is a train set; beside transforms_train.json it is nothing")
{
    Sample sample("canonical");
    CHECK(sample.mustLoad("transforms.json").splits[0].name == "train");
    Result<OlatDataset> file = loadDataset(sample.folder.file("transforms.json"));
    REQUIRE(file);
    CHECK(file->splits[0].name == "train");
    sample.mustLoad("transforms_val.json");
    sample.mustLoad("transforms_test.json");
    const OlatDataset all = *loadDataset(sample.folder.path.string());
    REQUIRE(all.splits.size() == 3);
    CHECK(all.splits[0].name == "train");
    CHECK(all.splits[1].name == "test");
    CHECK(all.splits[2].name == "val");
    CHECK(sample.mustLoad("transforms_train.json").splits.size() == 3);

    TempFolder other;
    other.writeText("cameras.json", "{}");
    const Result<OlatDataset> none = loadDataset(other.path.string());
    REQUIRE(!none);
    checkError(none.error(), ErrorCode::kBadInput, {"transforms_", "cameras.json"});
}

TEST_CASE("alpha and color_space are keys of every convention; a mix of EXR and PNG is read file by file")
{
    for (const char* convention : {"canonical", "plpos", "sssgs"})
        for (const char* file : {"a.exr", "b.png"}) {
            CAPTURE(convention);
            CAPTURE(file);
            Sample sample(convention);
            sample.writeImage("b.png", kWidth, kHeight);
            sample.setFile(file);
            const bool isPng = *file == 'b';
            const float stored = isPng ? 128 / 255.0f : 0.5f;
            for (const char* space : {"", "linear", "srgb"})
                for (const char* alpha : {"", "straight", "premultiplied"}) {
                    if (!isPng && *space == 's') continue;
                    sample.top.erase("color_space"), sample.top.erase("alpha");
                    if (*space) sample.top["color_space"] = space;
                    if (*alpha) sample.top["alpha"] = alpha;
                    const OlatDataset dataset = sample.mustLoad();
                    const auto image = ImageCache(dataset, 1 << 20).load(dataset.splits[0], 0);
                    REQUIRE(image);
                    const bool straight = *alpha ? *alpha == 's' : isPng && std::string(convention) == "plpos";
                    const float linear = isPng && *space != 'l' ? linearFromSrgb(stored) : stored;
                    CHECK((*image)->rgba[0] == doctest::Approx(straight ? linear * stored : linear));
                }
            sample.top["alpha"] = "associated";
            Result<OlatDataset> unknown = sample.load();
            REQUIRE(!unknown);
            checkError(unknown.error(), ErrorCode::kBadInput, {"alpha", "straight", "associated"});
        }

    Sample mixed("plpos");
    mixed.writeImage("b.png", kWidth, kHeight);
    json frames = {mixed.frame, mixed.frame};
    frames[1]["file_path"] = "b.png";
    mixed.top["frames"] = frames;
    const OlatDataset dataset = mixed.mustLoad();
    CHECK(warns(dataset, "1 PNG images are read as sRGB, 1 EXR images as linear"));
    ImageCache cache(dataset, 1 << 20);
    CHECK((*cache.load(dataset.splits[0], 0))->rgba[0] == 0.5f); // premultiplied
    const float half = 128 / 255.0f;
    CHECK((*cache.load(dataset.splits[0], 1))->rgba[0] == doctest::Approx(linearFromSrgb(half) * half));
}

TEST_CASE("poses: last rows that are off by rounding load, and what is wrong with the others is named")
{
    Sample sample("canonical");
    const glm::dmat4 good = lookAtOrigin({2, 0, 1}, kWidth).worldFromCamera;
    glm::dmat4 rounded = good * (1 + 2e-5);
    rounded[1][3] = 3e-6;
    sample.frame["transform_matrix"] = toJson(rounded);
    CHECK(glm::distance(sample.camera().position(), glm::dvec3(2, 0, 1)) < 1e-4);
    glm::dmat4 scaled = good;
    for (int c = 0; c < 3; ++c) scaled[c] *= 0.33;
    const struct {
        glm::dmat4 pose;
        std::initializer_list<const char*> words;
    } cases[] = {{scaled, {"rigid", "scaled by 0.33"}}, {glm::transpose(good), {"last row", "transposed"}}};
    for (const auto& c : cases) {
        sample.frame["transform_matrix"] = toJson(c.pose);
        const Result<OlatDataset> dataset = sample.load();
        REQUIRE(!dataset);
        checkError(dataset.error(), ErrorCode::kBadInput, c.words);
    }
}

TEST_CASE("a frame with lights of two conventions is refused")
{
    Sample sample("plpos");
    sample.frame["light"] = {{"type", "point"}, {"position", {0, 0, 4}}, {"intensity", {1, 1, 1}}};
    const Result<OlatDataset> dataset = sample.load();
    REQUIRE(!dataset);
    checkError(dataset.error(), ErrorCode::kBadInput, {"light beside pl_pos"});
}
