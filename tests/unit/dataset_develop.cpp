// Photographs become what a pinhole camera would have seen: lenses, masks, ambient light, exposure, levels; and what is not known stays unknown.
#include "dataset_support.h"

#include "dataset/develop.h"

using namespace nacre;

namespace {

/// A smooth pattern at (x, y), pixels from the corner.
float pattern(double x, double y) { return float(0.5 + 0.3 * std::sin(0.35 * x) * std::cos(0.27 * y)); }

Image patternImage(int width, int height, auto&& at)
{
    Image image{width, height, {}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const float v = at(x + 0.5, y + 0.5);
            image.rgba.insert(image.rgba.end(), {v, v, v, 1.0f});
        }
    return image;
}

Camera plainCamera(int width, int height)
{
    Camera c = lookAtOrigin({2, 0, 1}, width);
    c.height = height, c.cy = 0.5 * height;
    return c;
}

FileCamera asFile(const Camera& c) { return {c.width, c.height, c.fx, c.fy, c.cx, c.cy}; }

/// A dataset of one EXR file of `image`.
OlatDataset oneImage(const TempFolder& folder, const Image& image)
{
    OlatDataset dataset;
    dataset.splits.push_back({"train", {plainCamera(image.width, image.height)}, {}});
    REQUIRE(writeExr(image, folder.file("a.exr")));
    dataset.splits[0].images.push_back({0, Light(), folder.file("a.exr")});
    return dataset;
}

Image loadFirst(const OlatDataset& dataset)
{
    ImageCache cache(dataset, 0);
    const auto image = cache.load(dataset.splits[0], 0);
    REQUIRE_MESSAGE(image, image.error().message);
    return **image;
}

Image flat(float rgb, float alpha = 1) { return Image{4, 4, [&] { std::vector<float> p; for (int i = 0; i < 16; ++i) p.insert(p.end(), {rgb, rgb, rgb, alpha}); return p; }()}; }

} // namespace

TEST_CASE("an image taken through a lens is undistorted to the picture of the pinhole camera")
{
    const Camera camera = plainCamera(60, 40);
    FileCamera file = asFile(camera);
    file.width = 64, file.height = 44, file.cx = 31, file.cy = 23;
    const double k[6] = {-0.2, 0.05, 0.01, 0.02, -0.01, 0.003};
    std::copy_n(k, 6, file.k);
    file.p[0] = 0.004, file.p[1] = -0.003;
    // The inverse of the lens by fixed-point iteration, so that the file shows the pattern of the pinhole image.
    const Image photograph = patternImage(file.width, file.height, [&](double u, double v) {
        double x = 30, y = 20;
        for (int i = 0; i < 100; ++i) {
            const glm::dvec2 at = positionInFile(file, camera, x, y);
            x += u - at.x, y += v - at.y;
        }
        return pattern(x, y);
    });
    const Image image = resampled(photograph, file, camera);
    double worst = 0;
    for (int y = 2; y < 38; ++y)
        for (int x = 2; x < 58; ++x) {
            REQUIRE(image.pixel(x, y)[3] > 0.9999f);
            worst = std::max(worst, double(std::fabs(image.pixel(x, y)[0] - pattern(x + 0.5, y + 0.5))));
        }
    CHECK(worst < 2e-3);
}

TEST_CASE("the lens model is that of OpenCV")
{
    // Figures by hand from the formulas of calib3d for the normalised position (0.5, -0.25), y down.
    Camera camera;
    camera.fx = camera.fy = 100, camera.cx = camera.cy = 0;
    FileCamera file{10, 10, 100, 100, 0, 0};
    file.k[0] = 0.1, file.k[1] = 0.2, file.k[3] = 0.3, file.p[0] = 0.01, file.p[1] = 0.02;
    const double r2 = 0.3125, radial = (1 + 0.1 * r2 + 0.2 * r2 * r2) / (1 + 0.3 * r2);
    const glm::dvec2 at = positionInFile(file, camera, 50, -25);
    CHECK(at.x == doctest::Approx(100 * (0.5 * radial + 2 * 0.01 * 0.5 * -0.25 + 0.02 * (r2 + 2 * 0.25))));
    CHECK(at.y == doctest::Approx(100 * (-0.25 * radial + 0.01 * (r2 + 2 * 0.0625) + 2 * 0.02 * 0.5 * -0.25)));
    file.k[0] = -2; // bends back within the image
    CHECK(std::isnan(positionInFile(file, camera, 100, 100).x));
}

TEST_CASE("a part of a file is copied exactly, and what lies beyond it is unknown")
{
    const Image whole = patternImage(20, 10, pattern);
    Camera camera = plainCamera(8, 6);
    FileCamera file = asFile(camera);
    file.width = 20, file.height = 10, file.cx = camera.cx + 15, file.cy = camera.cy + 3;
    const Image part = resampled(whole, file, camera);
    for (int y = 0; y < 6; ++y)
        for (int x = 0; x < 8; ++x) {
            if (x + 15 < 20) CHECK(std::equal(part.pixel(x, y), part.pixel(x, y) + 4, whole.pixel(x + 15, y + 3)));
            else CHECK(part.pixel(x, y)[3] == kUnknownAlpha);
        }
}

TEST_CASE("exposure, black level, ambient light and masks are undone while loading")
{
    TempFolder folder;
    OlatDataset dataset = oneImage(folder, flat(0.55f));
    CHECK(loadFirst(dataset).rgba[0] == doctest::Approx(0.55f).epsilon(1e-3));
    dataset.blackLevel = 0.1f;
    CHECK(loadFirst(dataset).rgba[0] == doctest::Approx(0.5f).epsilon(2e-3));
    dataset.splits[0].images[0].gain = {1, 2, 4};
    const Image gained = loadFirst(dataset);
    CHECK(gained.rgba[0] == doctest::Approx(0.5f).epsilon(2e-3));
    CHECK(gained.rgba[1] == doctest::Approx(1.0f).epsilon(2e-3));
    CHECK(gained.rgba[2] == doctest::Approx(2.0f).epsilon(2e-3));

    REQUIRE(writeExr(flat(0.28f), folder.file("off.exr")));
    dataset.splits[0].images[0].ambientPath = folder.file("off.exr");
    const Image lit = loadFirst(dataset);
    for (int c = 0; c < 3; ++c) CHECK(lit.rgba[size_t(c)] == doctest::Approx(0.3f * float(1 << c)).epsilon(2e-3));

    std::vector<uint8_t> mask(16 * 3, 0);
    for (int i = 0; i < 3; ++i) mask[size_t(i)] = 255, mask[size_t(3 + i)] = 51;
    for (const int most : {255, 1}) { // masks of zeros and ones, too
        CAPTURE(most);
        std::vector<uint8_t> scaled = mask;
        if (most == 1)
            for (uint8_t& m : scaled) m = m == 255;
        REQUIRE(writePng(folder.file("mask.png"), 4, 4, 3, scaled));
        dataset.splits[0].images[0].maskPath = folder.file("mask.png");
        const Image cut = loadFirst(dataset);
        CHECK(cut.rgba[3] == 1.0f);
        CHECK(cut.rgba[0] == doctest::Approx(0.3f).epsilon(2e-3));
        if (most == 255) CHECK(cut.rgba[7] == doctest::Approx(0.2f));
        if (most == 255) CHECK(cut.rgba[4] == doctest::Approx(0.06f).epsilon(2e-3));
        CHECK(cut.rgba[4 * 5 + 3] == 0.0f);
    }
    REQUIRE(writePng(folder.file("mask.png"), 2, 2, 3, std::vector<uint8_t>(12)));
    ImageCache cache(dataset, 0);
    const auto wrong = cache.load(dataset.splits[0], 0);
    REQUIRE(!wrong);
    CHECK(wrong.error().message.find("a.exr: its mask cannot be used: ") != std::string::npos);
    CHECK(wrong.error().message.find("mask.png") != std::string::npos);
}

TEST_CASE("frames that share files and are developed differently each get their own: exposure of shared ambient light, mask, part of the file")
{
    TempFolder folder;
    OlatDataset dataset = oneImage(folder, flat(0.5f));
    REQUIRE(writeExr(flat(0.25f), folder.file("off.exr")));
    REQUIRE(writeExr(flat(0.75f), folder.file("lit.exr")));
    std::vector<uint8_t> mask(16 * 3, 255);
    mask[0] = mask[1] = mask[2] = 0;
    REQUIRE(writePng(folder.file("mask.png"), 4, 4, 3, mask));
    OlatSplit& split = dataset.splits[0];
    split.images[0].ambientPath = folder.file("off.exr");
    OlatImage brighter = split.images[0], other = split.images[0], masked = split.images[0];
    brighter.path = folder.file("lit.exr"), brighter.gain = glm::vec3(0.5f); // the ambient light of both is the same file,
    other.gain = glm::vec3(4.0f), masked.maskPath = folder.file("mask.png");  // and of these the image, too
    split.images = {split.images[0], brighter, other, masked};
    for (const size_t budget : {size_t(0), size_t(1) << 20}) {
        ImageCache cache(dataset, budget);
        for (int pass = 0; pass < 2; ++pass) {
            const float expected[] = {0.25f, 0.25f, 1.0f, 0.0f};
            for (size_t i = 0; i < 4; ++i) {
                CAPTURE(i);
                const auto image = cache.load(split, i);
                REQUIRE(image);
                CHECK((*image)->rgba[0] == doctest::Approx(expected[i]).epsilon(2e-3));
                CHECK((*image)->rgba[3] == (i == 3 ? 0.0f : 1.0f));
            }
        }
    }
    FileCamera whole{4, 4, split.cameras[0].fx, split.cameras[0].fy, split.cameras[0].cx, split.cameras[0].cy};
    split.images = {split.images[0], split.images[0]};
    split.images[1].camera = 1;
    split.cameras.push_back(split.cameras[0]);
    split.cameras[1].width = 2;
    split.files = {whole, whole};
    ImageCache cache(dataset, size_t(1) << 20);
    for (size_t i = 0; i < 2; ++i) {
        const auto image = cache.load(split, i);
        REQUIRE_MESSAGE(image, image.error().message);
        CHECK((*image)->width == (i ? 2 : 4));
    }
}

TEST_CASE("levels are those of photographs: of EXR files only where there are no others")
{
    TempFolder folder;
    OlatDataset dataset = oneImage(folder, flat(0.5f));
    dataset.blackLevel = 0.25f, dataset.whiteLevel = 0.4f;
    dataset.splits[0].images[0].gain = glm::vec3(0.5f);
    CHECK(loadFirst(dataset).rgba[3] == kUnknownAlpha);
    REQUIRE(writePng(folder.file("photo.png"), 4, 4, 3, std::vector<uint8_t>(48, 160)));
    dataset.splits.push_back(dataset.splits[0]);
    dataset.splits[1].images[0].path = folder.file("photo.png");
    CHECK(loadFirst(dataset).rgba[0] == doctest::Approx(0.25f).epsilon(1e-3));
    CHECK((*ImageCache(dataset, 0).load(dataset.splits[1], 0))->rgba[3] == kUnknownAlpha);
}

TEST_CASE("a saturated pixel is white at least, or unknown where the gain makes less of it")
{
    TempFolder folder;
    OlatDataset dataset = oneImage(folder, flat(0.96f));
    dataset.whiteLevel = 0.95f;
    dataset.splits[0].images[0].gain = glm::vec3(0.5f);
    Image image = loadFirst(dataset);
    CHECK(image.rgba[3] == kUnknownAlpha);
    CHECK(image.rgba[0] == 0.0f);
    dataset.splits[0].images[0].gain = glm::vec3(3.0f);
    image = loadFirst(dataset);
    CHECK(image.rgba[3] == 1.0f);
    CHECK(image.rgba[0] == doctest::Approx(2.88f).epsilon(1e-3));
    CHECK(loadFirst(halved(dataset)).width == 2);
    dataset.splits[0].images[0].gain = glm::vec3(0.5f);
    CHECK(loadFirst(halved(dataset)).rgba[3] == kUnknownAlpha);
}

TEST_CASE("descriptions say how photographs were taken, and nonsense is refused with its key")
{
    TempFolder folder;
    REQUIRE(writeExr(flat(0.5f), folder.file("a.exr")));
    REQUIRE(writePng(folder.file("m.png"), 4, 4, 3, std::vector<uint8_t>(48, 255)));
    const auto description = [&](const json& top, const json& frame) {
        json f{{"file_path", "a.exr"}, {"transform_matrix", {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 3}, {0, 0, 0, 1}}},
               {"light", {{"type", "point"}, {"position", {0, 1, 3}}, {"intensity", 4}}}};
        f.update(frame);
        json t{{"camera_angle_x", 0.6}, {"width", 4}, {"height", 4}, {"frames", {f}}};
        t.update(top);
        folder.writeText("transforms_train.json", t.dump());
        return loadDataset(folder.path.string());
    };
    const auto good = description({{"exposure_ev", 1}, {"black_level", 0.1}, {"white_level", 0.9}, {"background", "in_view"}, {"light_rig", "camera"}},
                                  {{"gain", {1, 2, 1}}, {"mask_path", "m.png"}, {"ambient_path", "a.exr"}});
    REQUIRE_MESSAGE(good, good.error().message);
    const OlatImage& image = good->splits[0].images[0];
    CHECK(image.gain == glm::vec3(0.5f, 0.25f, 0.5f));
    CHECK(image.maskPath == folder.file("m.png"));
    CHECK(image.ambientPath == folder.file("a.exr"));
    CHECK(good->blackLevel == 0.1f);
    CHECK(good->whiteLevel == 0.9f);
    CHECK(good->backgroundInView);
    CHECK(good->rig == LightRig::kCamera);
    const std::pair<json, const char*> bad[] = {
        {{{"exposure_ev", 1e9}}, "exposure_ev"}, {{{"gain", 0}}, "gain"},           {{{"black_level", 16}}, "black_level"},
        {{{"white_level", 255}}, "white_level"}, {{{"background", "blue"}}, "background"}, {{{"light_rig", "drone"}}, "light_rig"},
        {{{"black_level", 0.5}, {"white_level", 0.4}}, "white_level"},
    };
    for (const auto& [top, key] : bad) {
        CAPTURE(key);
        const auto refused = description(top, json::object());
        REQUIRE(!refused);
        CHECK(refused.error().message.find(key) != std::string::npos);
    }
    for (const json& frame : {json{{"black_level", 0.1}}, json{{"background", "in_view"}}, json{{"light_rig", "camera"}}}) { // which only the top level says
        const auto refused = description(json::object(), frame);
        REQUIRE(!refused);
        CHECK(refused.error().message.find("frames[0]." + frame.begin().key()) != std::string::npos);
        CHECK(refused.error().message.find("top level") != std::string::npos);
    }
    CHECK(!description({{"background", {1, 1, 1}}}, json::object()));
}

TEST_CASE("some images with masks and some without are a warning that counts them")
{
    TempFolder folder;
    REQUIRE(writeExr(flat(0.5f), folder.file("a.exr")));
    REQUIRE(writePng(folder.file("m.png"), 4, 4, 3, std::vector<uint8_t>(48, 255)));
    for (const int masked : {0, 1, 3}) {
        json frames;
        for (int i = 0; i < 3; ++i) {
            frames.push_back({{"file_path", "a.exr"}, {"transform_matrix", {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 3}, {0, 0, 0, 1}}},
                              {"light", {{"type", "point"}, {"position", {0, 1, 3}}, {"intensity", 4}}}});
            if (i < masked) frames.back()["mask_path"] = "m.png";
        }
        folder.writeText("transforms_train.json", json{{"camera_angle_x", 0.6}, {"width", 4}, {"height", 4}, {"frames", frames}}.dump());
        const auto dataset = loadDataset(folder.path.string());
        REQUIRE_MESSAGE(dataset, dataset.error().message);
        CHECK(dataset->warnings.size() == (masked == 1));
        if (masked == 1) CHECK(dataset->warnings[0].find("2 of 3 images of split 'train' have no mask") != std::string::npos);
    }
}

TEST_CASE("a lens that bends most of the picture back is a warning, one that a photograph can have is none")
{
    TempFolder folder;
    const auto warnings = [&](const json& lens) {
        REQUIRE(writeExr(flat(0.5f), folder.file("a.exr")));
        json t{{"camera_angle_x", 0.6}, {"width", 4}, {"height", 4},
               {"frames", {{{"file_path", "a.exr"}, {"transform_matrix", {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 3}, {0, 0, 0, 1}}},
                            {"light", {{"type", "point"}, {"position", {0, 1, 3}}, {"intensity", 4}}}}}}};
        t.update(lens);
        folder.writeText("transforms_train.json", t.dump());
        const auto dataset = loadDataset(folder.path.string());
        REQUIRE_MESSAGE(dataset, dataset.error().message);
        return dataset->warnings;
    };
    CHECK(warnings({{"k1", -0.3}, {"k2", 0.1}}).empty());
    CHECK(warnings({{"k1", 0.2}}).empty());
    for (const double k : {-20.0, 20.0}) {
        const auto found = warnings({{"k1", k}});
        REQUIRE(found.size() == 1);
        CHECK(found[0].find("a lens that does not show") != std::string::npos);
    }
}
