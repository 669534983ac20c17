// One small scene written in all four conventions must come back as the same cameras, lights and pixels.
#include "dataset_support.h"

#include <numbers>

using namespace nacre;

namespace {

constexpr int kSize = 16;
constexpr double kIntensity = 40.0;
constexpr float kSamePose = 1e-5f;

struct Shot {
    Camera camera;
    glm::dvec3 light;
};

/// Train: 3 cameras x 2 lights, camera by camera. Test: 2 new lights, one camera each. Lights at distance 4, like the SSS-GS rig.
std::vector<Shot> shots(const std::string& split)
{
    const glm::dvec3 trainLights[] = {4.0 * glm::normalize(glm::dvec3(1, 0.5, 1)), 4.0 * glm::normalize(glm::dvec3(-0.5, 1, 2))};
    if (split == "test")
        return {{lookAtOrigin({1, 2, 1}, kSize), 4.0 * glm::normalize(glm::dvec3(0.2, -1, 1))},
                {lookAtOrigin({-2, 1, 0.5}, kSize), 4.0 * glm::normalize(glm::dvec3(-1, -1, 0.3))}};
    std::vector<Shot> out;
    for (const glm::dvec3& position : {glm::dvec3(2, 0, 1), {-1, 2, 1}, {0.3, -2, 1.5}})
        for (const glm::dvec3& light : trainLights) out.push_back({lookAtOrigin(position, kSize), light});
    return out;
}

Image render(const Shot& shot) { return renderSphere(shot.camera, shot.light, kIntensity); }

json topLevel() { return {{"camera_angle_x", 2 * std::atan(0.5 / 1.4)}, {"frames", json::array()}}; }

void writeCanonical(const TempFolder& folder)
{
    for (const std::string split : {"train", "test"}) {
        json top = topLevel();
        top["width"] = top["height"] = kSize;
        top["color_space"] = "linear";
        for (const Shot& shot : shots(split)) {
            const std::string name = split + "_" + std::to_string(top["frames"].size()) + ".exr";
            REQUIRE(writeExr(render(shot), folder.file(name)));
            top["frames"].push_back({{"file_path", name}, {"transform_matrix", toJson(shot.camera.worldFromCamera)},
                {"light", {{"type", "point"}, {"position", toJson(shot.light)}, {"intensity", {kIntensity, kIntensity, kIntensity}}}}});
        }
        folder.writeText("transforms_" + split + ".json", top.dump(1));
    }
}

void writePlpos(const TempFolder& folder, bool refinedPoses)
{
    for (const std::string split : {"train", "test"}) {
        json top = topLevel();
        for (const Shot& shot : shots(split)) {
            const std::string stem = split + "_" + std::to_string(top["frames"].size());
            REQUIRE(writeExr(render(shot), folder.file(stem + ".exr")));
            json frame = {{"file_path", "./" + stem}, {"file_ext", ".exr"}, {"transform_matrix", toJson(shot.camera.worldFromCamera)},
                          {"pl_pos", toJson(shot.light)}};
            for (int c = 0; c < 3; c++) frame["pl_intensity"].push_back(4 * std::numbers::pi * kIntensity);
            if (refinedPoses) { // GS^3: OpenCV axes, transposed rotation, and a wrong transform_matrix that must lose
                glm::dmat4 cv = shot.camera.worldFromCamera;
                cv[1] = -cv[1], cv[2] = -cv[2];
                const glm::dmat4 w2c = glm::inverse(cv);
                frame["R_opt"] = json::array();
                for (int r = 0; r < 3; r++) frame["R_opt"].push_back({cv[0][r], cv[1][r], cv[2][r]});
                frame["T_opt"] = {w2c[3][0], w2c[3][1], w2c[3][2]};
                frame["transform_matrix"] = toJson(glm::dmat4(1.0));
                frame["img_path"] = stem + ".exr";
                frame["file_path"] = "not/there";
                frame["camera_intrinsics"] = {0.5 * kSize, 0.5 * kSize, 1.4 * kSize, 1.4 * kSize};
            }
            top["frames"].push_back(frame);
        }
        folder.writeText("transforms_" + split + ".json", top.dump(1));
    }
}

/// What SSS-GS stores: sRGB-encoded premultiplied colour, linear alpha, 8 bits.
void writePng8(const Image& image, const std::string& path)
{
    std::vector<uint8_t> bytes;
    for (size_t i = 0; i < image.rgba.size(); i++) {
        const float v = std::min(std::max(image.rgba[i], 0.0f), 1.0f);
        bytes.push_back(uint8_t(std::lround(255.0f * (i % 4 == 3 ? v : srgbFromLinear(v)))));
    }
    REQUIRE(writePng(path, image.width, image.height, 4, bytes));
}

void writeSssgs(const TempFolder& folder)
{
    for (const std::string split : {"train", "test"}) {
        json top = topLevel();
        int index = 0;
        for (const Shot& shot : shots(split)) {
            const std::string stem = split + "_" + std::to_string(index++);
            writePng8(render(shot), folder.file(stem + ".png"));
            const json pose = toJson(shot.camera.worldFromCamera);
            if (top["frames"].empty() || top["frames"].back()["transform_matrix"] != pose)
                top["frames"].push_back({{"transform_matrix", pose}, {"width", kSize}, {"height", kSize}, {"file_paths", json::array()},
                                         {"light_positions", json::array()}});
            top["frames"].back()["file_paths"].push_back(stem);
            top["frames"].back()["light_positions"].push_back(toJson(shot.light));
        }
        folder.writeText("transforms_" + split + ".json", top.dump(1));
    }
}

void writeBigs(const TempFolder& folder)
{
    std::map<std::array<double, 3>, std::vector<Shot>> byLight; // folder order is by light, unlike the other conventions
    std::vector<std::array<double, 3>> order;
    for (const std::string split : {"train", "test"})
        for (const Shot& shot : shots(split)) {
            const std::array<double, 3> key{shot.light.x, shot.light.y, shot.light.z};
            if (!byLight.count(key)) order.push_back(key);
            byLight[key].push_back(shot);
        }
    for (size_t i = 0; i < order.size(); i++) {
        const std::string name = "olat_" + std::to_string(i + 8) + "/"; // 8, 9, 10, 11: numbers, not names, give the order
        std::filesystem::create_directories(folder.path / name / "img");
        json top = {{"w", kSize}, {"h", kSize}, {"fl_x", 1.4 * kSize}, {"frames", json::array()}};
        for (const Shot& shot : byLight[order[i]]) {
            Image straight = render(shot);
            for (size_t p = 0; p < straight.rgba.size(); p += 4)
                for (size_t c = 0; c < 3; c++) straight.rgba[p + c] /= std::max(straight.rgba[p + 3], 0.25f); // alpha is 0 or >= 1/4
            const std::string file = "img/" + std::to_string(top["frames"].size()) + ".exr";
            REQUIRE(writeExr(straight, folder.file(name + file)));
            top["frames"].push_back({{"file_path", file}, {"transform_matrix", toJson(shot.camera.worldFromCamera)}, {"k1", 0.0},
                {"light", {{"position", {-shot.light.x, shot.light.y, -shot.light.z}}, {"intensity", kIntensity}}}});
        }
        folder.writeText(name + "transforms_train.json", top.dump(1));
    }
    std::filesystem::create_directories(folder.path / "olat_all_on");
}

/// Every shot of the scene occurs once, with its camera, light and pixels. `inOrder` if the files keep the order of shots().
void checkSameScene(const TempFolder& folder, const char* convention, bool inOrder, float pixelTolerance, double intensity)
{
    Result<OlatDataset> dataset = loadDataset(folder.path.string());
    if (!dataset) FAIL(dataset.error().message);
    CHECK(dataset->convention == convention);
    ImageCache cache(*dataset, 1 << 20);
    for (const std::string name : {"train", "test"}) {
        INFO(convention << " " << name);
        const OlatSplit* split = dataset->find(name);
        REQUIRE(split != nullptr);
        const std::vector<Shot> expected = shots(name);
        REQUIRE(split->images.size() == expected.size());
        CHECK(split->cameras.size() == (name == "train" ? 3 : 2)); // images of one camera share its entry
        for (size_t e = 0; e < expected.size(); e++) {
            size_t found = inOrder ? e : split->images.size();
            for (size_t i = 0; !inOrder && i < split->images.size(); i++)
                if (glm::distance(split->cameras[split->images[i].camera].position(), expected[e].camera.position()) < 1e-3 &&
                    glm::distance(glm::dvec3(split->images[i].light.position), expected[e].light) < 1e-3)
                    found = i;
            REQUIRE(found < split->images.size());
            const OlatImage& image = split->images[found];
            const Camera& camera = split->cameras[image.camera];
            CHECK(camera.width == kSize);
            CHECK(camera.height == kSize);
            CHECK(camera.fx == doctest::Approx(1.4 * kSize).epsilon(1e-5));
            CHECK(camera.fy == doctest::Approx(1.4 * kSize).epsilon(1e-5));
            CHECK(camera.cx == 0.5 * kSize);
            CHECK(camera.cy == 0.5 * kSize);
            for (int c = 0; c < 4; c++)
                for (int r = 0; r < 4; r++)
                    CHECK(std::fabs(camera.worldFromCamera[c][r] - expected[e].camera.worldFromCamera[c][r]) < kSamePose);
            CHECK(image.light.type == LightType::kPoint);
            CHECK(glm::distance(image.light.position, glm::vec3(expected[e].light)) < kSamePose);
            CHECK(image.light.intensity.y == doctest::Approx(intensity).epsilon(1e-5));

            const Image reference = render(expected[e]);
            Result<std::shared_ptr<const Image>> pixels = cache.load(*split, found);
            REQUIRE(pixels);
            REQUIRE((*pixels)->rgba.size() == reference.rgba.size());
            float worst = 0;
            for (size_t i = 0; i < reference.rgba.size(); i++) worst = std::max(worst, std::fabs((*pixels)->rgba[i] - reference.rgba[i]));
            CHECK(worst < pixelTolerance);
        }
    }
}

} // namespace

TEST_CASE("every convention describes the same scene")
{
    constexpr float kHalf = 1.0f / 1024;      // half rounding of values below 2, with one division in between
    constexpr float k8Bit = 2.3f * 0.5f / 255; // half a step of 8 bits times the steepest slope of the sRGB curve
    SUBCASE("canonical")
    {
        TempFolder folder;
        writeCanonical(folder);
        checkSameScene(folder, "canonical", true, kHalf, kIntensity);
    }
    SUBCASE("pl_pos")
    {
        TempFolder folder;
        writePlpos(folder, false);
        checkSameScene(folder, "plpos", true, kHalf, kIntensity);
    }
    SUBCASE("pl_pos with GS3's refined poses")
    {
        TempFolder folder;
        writePlpos(folder, true);
        checkSameScene(folder, "plpos", true, kHalf, kIntensity);
    }
    SUBCASE("SSS-GS, intensity by convention pi r^2")
    {
        TempFolder folder;
        writeSssgs(folder);
        checkSameScene(folder, "sssgs", true, k8Bit, 16 * std::numbers::pi);
    }
    SUBCASE("BiGS")
    {
        TempFolder folder;
        writeBigs(folder);
        checkSameScene(folder, "bigs", false, kHalf, kIntensity);
    }
}

TEST_CASE("pl_pos PNG is display-encoded with straight alpha; a missing pl_intensity is a convention with a warning")
{
    TempFolder folder;
    const uint8_t pixels[] = {255, 188, 0, 128};
    REQUIRE(writePng(folder.file("a.png"), 1, 1, 4, pixels));
    json top = topLevel();
    top["frames"].push_back({{"file_path", "a"}, {"transform_matrix", toJson(lookAtOrigin({2, 0, 1}, 1).worldFromCamera)}, {"pl_pos", {0, 3, 4}}});
    folder.writeText("transforms_train.json", top.dump());
    Result<OlatDataset> dataset = loadDataset(folder.path.string());
    if (!dataset) FAIL(dataset.error().message);
    CHECK(dataset->colorSpace == ColorSpace::kSrgb);
    CHECK(!dataset->premultiplied);
    REQUIRE(dataset->warnings.size() == 1);
    CHECK(mentions(dataset->warnings[0], "pl_intensity"));
    CHECK(dataset->splits[0].images[0].light.intensity.x == doctest::Approx(25 * std::numbers::pi));
    ImageCache cache(*dataset, 1 << 20);
    Result<std::shared_ptr<const Image>> image = cache.load(dataset->splits[0], 0);
    REQUIRE(image);
    const float a = 128 / 255.0f;
    CHECK((*image)->rgba[0] == doctest::Approx(a));
    CHECK((*image)->rgba[1] == doctest::Approx(a * linearFromSrgb(188 / 255.0f)));
    CHECK((*image)->rgba[2] == 0.0f);
    CHECK((*image)->rgba[3] == a);
}

TEST_CASE("a dict of frames, directional lights and environment maps load")
{
    TempFolder folder;
    const Image black{2, 2, std::vector<float>(16)};
    REQUIRE(writeExr(black, folder.file("a.exr")));
    REQUIRE(writeExr(Image{4, 2, std::vector<float>(32)}, folder.file("sky.exr")));
    const json pose = toJson(lookAtOrigin({2, 0, 1}, 2).worldFromCamera);
    json top = topLevel();
    top["width"] = top["height"] = 2;
    top["frames"] = {{"b", {{"file_path", "a.exr"}, {"transform_matrix", pose}, {"light", {{"type", "environment"}, {"map", "sky.exr"}}}}},
                     {"a", {{"file_path", "a.exr"}, {"transform_matrix", pose},
                            {"light", {{"type", "directional"}, {"direction_to_light", {0, 0.6, 0.8}}, {"irradiance", {1, 2, 3}}}}}}};
    folder.writeText("transforms_any name.json", top.dump());
    Result<OlatDataset> dataset = loadDataset(folder.path.string());
    if (!dataset) FAIL(dataset.error().message);
    const OlatSplit& split = dataset->splits[0];
    CHECK(split.name == "any name");
    Result<OlatDataset> oneFile = loadDataset(folder.file("transforms_any name.json"));
    REQUIRE(oneFile);
    REQUIRE(oneFile->splits.size() == 1);
    CHECK(oneFile->splits[0].images[0].path == split.images[0].path);
    REQUIRE(split.images.size() == 2);
    CHECK(split.images[0].light.type == LightType::kDirectional);
    CHECK(split.images[0].light.directionToLight == glm::vec3(0, 0.6f, 0.8f));
    CHECK(split.images[0].light.intensity == glm::vec3(1, 2, 3));
    CHECK(split.images[1].light.type == LightType::kEnvironment);
    CHECK(split.images[1].light.environmentPath == folder.file("sky.exr"));
    top["frames"]["b"]["light"]["map"] = "a.exr";
    folder.writeText("transforms_any name.json", top.dump());
    const Result<OlatDataset> square = loadDataset(folder.path.string());
    REQUIRE(!square);
    checkError(square.error(), ErrorCode::kBadInput, {"frames['b'].light.map", "2 x 2", "twice as wide as high"});
}

TEST_CASE("canonical PNG without a color_space is sRGB with one warning; what any split says holds, and EXR is linear")
{
    TempFolder folder;
    const uint8_t pixels[] = {188, 188, 0, 255};
    REQUIRE(writePng(folder.file("a.png"), 1, 1, 4, pixels));
    REQUIRE(writeExr(Image{1, 1, {0.5f, 0.5f, 0.0f, 1.0f}}, folder.file("a.exr")));
    const auto load = [&](const char* file, const char* trainSays, const char* testFile = nullptr) {
        for (const std::string split : {"train", "test"}) {
            if (split == "test" && testFile) file = testFile;
            json top = topLevel();
            top["width"] = top["height"] = 1;
            if (*trainSays && split == "train") top["color_space"] = trainSays;
            top["frames"].push_back({{"file_path", file}, {"transform_matrix", toJson(lookAtOrigin({2, 0, 1}, 1).worldFromCamera)},
                                     {"light", {{"type", "point"}, {"position", {0, 3, 4}}, {"intensity", {1, 1, 1}}}}});
            folder.writeText("transforms_" + split + ".json", top.dump());
        }
        Result<OlatDataset> dataset = loadDataset(folder.path.string());
        if (!dataset) FAIL(dataset.error().message);
        return *dataset;
    };
    const OlatDataset unsaid = load("a.png", "");
    CHECK(unsaid.colorSpace == ColorSpace::kSrgb);
    REQUIRE(unsaid.warnings.size() == 1);
    CHECK(mentions(unsaid.warnings[0], "no color_space: PNG"));
    CHECK(mentions(unsaid.warnings[0], "transforms_train.json"));
    ImageCache cache(unsaid, 1 << 20);
    Result<std::shared_ptr<const Image>> image = cache.load(unsaid.splits[0], 0);
    REQUIRE(image);
    CHECK((*image)->rgba[0] == doctest::Approx(linearFromSrgb(188 / 255.0f)));

    for (const char* said : {"linear", "srgb"}) {
        const OlatDataset dataset = load("a.png", said);
        CHECK(dataset.colorSpace == (*said == 'l' ? ColorSpace::kLinear : ColorSpace::kSrgb));
        CHECK(dataset.warnings.empty());
    }
    CHECK(load("a.png", "srgb", "a.exr").warnings.empty()); // photographs to train, renders to measure
    CHECK(load("a.png", "", "a.exr").warnings.size() == 2);  // sRGB is a guess, and what it is measured with is linear
    const OlatDataset exr = load("a.exr", "");
    CHECK(exr.colorSpace == ColorSpace::kLinear);
    CHECK(exr.warnings.empty());
}

TEST_CASE("SSS-GS leaves out excluded and all-on images")
{
    TempFolder folder;
    for (const char* stem : {"a", "b", "c_all_on"}) writePng8(Image{2, 2, std::vector<float>(16)}, folder.file(std::string(stem) + ".png"));
    json top = topLevel();
    top["frames"].push_back({{"transform_matrix", toJson(lookAtOrigin({2, 0, 1}, 2).worldFromCamera)}, {"width", 2}, {"height", 2},
                             {"cx", 0.75}, {"file_paths", {"a", "b", "c_all_on"}},
                             {"light_positions", {{0, 0, 4}, {0, 4, 0}, {4, 0, 0}}}, {"light_intensities", {{1, 1, 1}, {1, 2, 3}, {1, 1, 1}}}});
    folder.writeText("transforms_train.json", top.dump());
    folder.writeText("exclude_list.txt", "a.png\r\nunknown\n");
    Result<OlatDataset> dataset = loadDataset(folder.path.string());
    if (!dataset) FAIL(dataset.error().message);
    REQUIRE(dataset->splits[0].images.size() == 1);
    CHECK(mentions(dataset->splits[0].images[0].path, "b.png"));
    CHECK(dataset->splits[0].images[0].light.intensity.z == doctest::Approx(3 * 16 * std::numbers::pi));
    CHECK(dataset->splits[0].cameras[0].cx == 0.75);
    CHECK(dataset->warnings.size() == 3);

    folder.writeText("exclude_list.txt", "a\nb\n");
    Result<OlatDataset> empty = loadDataset(folder.path.string());
    REQUIRE(!empty);
    checkError(empty.error(), ErrorCode::kBadInput, {"train", "empty"});
}
