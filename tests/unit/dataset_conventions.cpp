// The checks must be silent on good data and name the mistake on data that was flipped on purpose.
#include "dataset_support.h"

#include <algorithm>
#include <functional>
#include <random>

using namespace nacre;

namespace {

/// 24 random views of a diffuse sphere, each under its own light from the upper hemisphere.
OlatDataset sphereDataset(const TempFolder& folder)
{
    OlatDataset dataset;
    dataset.splits.push_back({"train", {}, {}});
    std::mt19937 random(7);
    const auto unit = [&] { return double(random()) / 4294967296.0; };
    const auto upper = [&](double radius) {
        const double phi = 6.28318530718 * unit(), z = 0.1 + 0.8 * unit(), r = std::sqrt(1 - z * z);
        return radius * glm::dvec3(r * std::cos(phi), r * std::sin(phi), z);
    };
    for (uint32_t i = 0; i < 24; i++) {
        const Camera camera = lookAtOrigin(upper(2.5), 32);
        Light light;
        light.position = glm::vec3(upper(4.0));
        light.intensity = glm::vec3(40.0f);
        const std::string path = folder.file(std::to_string(i) + ".exr");
        REQUIRE(writeExr(renderSphere(camera, light.position, 40), path));
        dataset.splits[0].cameras.push_back(camera);
        dataset.splits[0].images.push_back({i, light, path});
    }
    return dataset;
}

std::vector<std::string> check(const OlatDataset& dataset)
{
    ImageCache cache(dataset, 64 << 20);
    Result<std::vector<std::string>> out = checkConventions(dataset, cache);
    REQUIRE(out);
    Result<std::vector<std::string>> again = checkConventions(dataset, cache);
    REQUIRE(again);
    CHECK(*again == *out); // deterministic
    return *out;
}

OlatDataset withLights(OlatDataset dataset, const glm::mat3& frame)
{
    for (OlatSplit& split : dataset.splits)
        for (OlatImage& image : split.images) {
            image.light.position = frame * image.light.position;
            image.light.directionToLight = frame * image.light.directionToLight;
        }
    return dataset;
}

void checkFiresOnFlips(const OlatDataset& good)
{
    struct Flip {
        glm::mat3 frame; // columns
        const char* named;
    };
    const Flip flips[] = {
        {glm::mat3(-1, 0, 0, 0, 1, 0, 0, 0, -1), "(-x, y, -z)"}, // Mitsuba, what BiGS stores
        {glm::mat3(1, 0, 0, 0, -1, 0, 0, 0, -1), "(x, -y, -z)"}, // OpenCV
        {glm::mat3(-1, 0, 0, 0, 1, 0, 0, 0, 1), "(-x, y, z)"},   // mirrored
        {glm::mat3(-1, 0, 0, 0, -1, 0, 0, 0, -1), "(-x, -y, -z)"}, // propagation instead of towards the light
        {glm::mat3(1, 0, 0, 0, 0, -1, 0, 1, 0), "(x, -z, y)"},   // z up stored as y up
    };
    for (const Flip& flip : flips) {
        const std::vector<std::string> warnings = check(withLights(good, flip.frame));
        INFO(flip.named);
        REQUIRE(warnings.size() == good.splits.size());
        for (const std::string& warning : warnings) { // each split says so
            INFO(warning);
            CHECK(mentions(warning, "shading disagrees"));
            CHECK(mentions(warning, flip.named));
        }
    }
}

void checkFiresOnPoses(const OlatDataset& good)
{
    OlatDataset openCv = good, inverted = good;
    for (Camera& c : openCv.splits[0].cameras) c.worldFromCamera[1] = -c.worldFromCamera[1], c.worldFromCamera[2] = -c.worldFromCamera[2];
    std::vector<std::string> warnings = check(openCv);
    REQUIRE(warnings.size() == 1);
    CHECK(mentions(warnings[0], "look away"));
    CHECK(mentions(warnings[0], "OpenCV"));
    for (OlatSplit& split : inverted.splits)
        for (Camera& c : split.cameras) c.worldFromCamera = glm::inverse(c.worldFromCamera);
    warnings = check(inverted);
    REQUIRE(warnings.size() == 1);
    CHECK(mentions(warnings[0], "world-to-camera"));
}

} // namespace

TEST_CASE("good data passes the convention checks in silence, flipped data is named")
{
    TempFolder folder;
    const OlatDataset good = sphereDataset(folder);
    CHECK(check(good).empty());
    checkFiresOnFlips(good);
    checkFiresOnPoses(good);
}

TEST_CASE("the embedded sample, a translucent bunny, passes and its flipped copies do not")
{
    Result<OlatDataset> sample = loadDataset(std::string(NACRE_SOURCE_DIR) + "/samples/data/bunny_wax_tiny");
    if (!sample) FAIL(sample.error().message);
    CHECK(sample->find("train")->images.size() == 100);
    CHECK(sample->find("train")->cameras.size() == 25);
    CHECK(sample->find("test")->images.size() == 8);
    CHECK(check(*sample).empty());
    checkFiresOnFlips(*sample);
}

TEST_CASE("a rig that stands far from the origin is no mistake, and its other checks still run")
{
    TempFolder folder;
    OlatDataset far = sphereDataset(folder);
    const glm::dvec3 offset(300, -500, 200);
    for (Camera& camera : far.splits[0].cameras) camera.worldFromCamera[3] += glm::dvec4(offset, 0);
    for (OlatImage& image : far.splits[0].images) image.light.position += glm::vec3(offset);
    CHECK(check(far).empty());
    far.splits[0].images[5].light.position = glm::vec3(offset + glm::dvec3(0.2, 0.1, -0.3));
    const std::vector<std::string> warnings = check(far);
    REQUIRE(warnings.size() == 1);
    CHECK(mentions(warnings[0], "light inside the object: 1 "));
}

TEST_CASE("world-to-camera poses are noticed for a rig that does not aim at the origin, and in OpenCV axes")
{
    TempFolder folder;
    OlatDataset dataset = sphereDataset(folder);
    bool openCv = false;
    SUBCASE("OpenGL axes") {}
    SUBCASE("OpenCV axes") { openCv = true; }
    for (Camera& camera : dataset.splits[0].cameras) {
        camera.worldFromCamera[3] += glm::dvec4(0.4, 0.3, 0.2, 0);
        if (openCv) camera.worldFromCamera[1] = -camera.worldFromCamera[1], camera.worldFromCamera[2] = -camera.worldFromCamera[2];
        camera.worldFromCamera = glm::inverse(camera.worldFromCamera);
    }
    const std::vector<std::string> warnings = check(dataset);
    REQUIRE(warnings.size() == 1);
    CHECK(mentions(warnings[0], "world-to-camera"));
}

TEST_CASE("a light inside the object is reported")
{
    TempFolder folder;
    OlatDataset dataset = sphereDataset(folder);
    dataset.splits[0].images[5].light.position = {0.2f, 0.1f, -0.3f};
    const std::vector<std::string> warnings = check(dataset);
    REQUIRE(warnings.size() == 1);
    CHECK(mentions(warnings[0], "light inside the object: 1 "));
    CHECK(mentions(warnings[0], "5.exr"));
}

TEST_CASE("images without alpha are not judged by shading, and the check says so")
{
    TempFolder folder;
    OlatDataset dataset = sphereDataset(folder);
    for (OlatImage& image : dataset.splits[0].images) {
        Result<Image> pixels = readExr(image.path);
        REQUIRE(pixels);
        for (size_t i = 3; i < pixels->rgba.size(); i += 4) pixels->rgba[i] = 1.0f;
        REQUIRE(writeExr(*pixels, image.path));
    }
    const std::vector<std::string> warnings = check(dataset);
    REQUIRE(warnings.size() == 1);
    CHECK(mentions(warnings[0], "not checked"));
}

TEST_CASE("images of which none can be read are an error, not a warning")
{
    TempFolder folder;
    const OlatDataset dataset = sphereDataset(folder);
    for (const OlatImage& image : dataset.splits[0].images) folder.writeText(std::filesystem::path(image.path).filename().string(), "no image");
    ImageCache cache(dataset, 64 << 20);
    const auto found = checkConventions(dataset, cache);
    REQUIRE(!found);
    checkError(found.error(), ErrorCode::kBadInput, {"0.exr", "none of 24"});
}

namespace {

/// The sphere of above with a test split of its own: the last third of the images.
OlatDataset withTestSplit(OlatDataset dataset)
{
    OlatSplit test{"test", {}, {}}, &train = dataset.splits[0];
    for (uint32_t i = 16; i < 24; ++i) {
        test.cameras.push_back(train.cameras[i]);
        test.images.push_back(train.images[i]);
        test.images.back().camera = i - 16;
    }
    train.cameras.resize(16), train.images.resize(16);
    dataset.splits.push_back(test);
    return dataset;
}

using Move = std::function<void(OlatImage& image, const Camera& camera, size_t index)>;

OlatDataset changed(OlatDataset dataset, const char* split, const Move& move)
{
    for (OlatSplit& s : dataset.splits)
        for (size_t i = 0; i < s.images.size(); ++i)
            if (s.name == split || std::string(split) == "all") move(s.images[i], s.cameras[s.images[i].camera], i);
    return dataset;
}

/// Every warning has the words, and there are so many.
void warns(const OlatDataset& dataset, size_t count, std::initializer_list<const char*> words)
{
    const std::vector<std::string> warnings = check(dataset);
    std::string all;
    for (const std::string& w : warnings) all += w + "\n";
    INFO(all);
    CHECK(warnings.size() == count);
    for (const std::string& w : warnings) {
        CHECK(w.size() < 500);
        for (const char* word : words) CHECK(mentions(w, word));
    }
}

void inCameraFrame(OlatImage& image, const Camera& camera, bool openCv)
{
    glm::dmat4 pose = camera.worldFromCamera;
    if (openCv) pose[1] = -pose[1], pose[2] = -pose[2];
    image.light.position = glm::dvec3(glm::inverse(pose) * glm::dvec4(glm::dvec3(image.light.position), 1));
}

} // namespace

TEST_CASE("lights that belong to another frame are named for what they are, in the split that has them")
{
    TempFolder folder;
    const OlatDataset good = withTestSplit(sphereDataset(folder));
    CHECK(check(good).empty());
    for (const char* split : {"train", "test"}) {
        CAPTURE(split);
        warns(changed(good, split, [](OlatImage& i, const Camera& c, size_t) { inCameraFrame(i, c, false); }), 1, {split, "in the cameras' frame"});
        warns(changed(good, split, [](OlatImage& i, const Camera& c, size_t) { inCameraFrame(i, c, true); }), 1, {split, "in the cameras' frame", "OpenCV"});
        const OlatSplit* stated = good.find(split);
        const size_t n = stated->images.size();
        warns(changed(good, split, [&](OlatImage& i, const Camera&, size_t at) { i.light = stated->images[(at + 1) % n].light; }), 1, {split, "previous", "off by one"});
        warns(changed(good, split, [&](OlatImage& i, const Camera&, size_t at) { i.light = stated->images[(at + n - 1) % n].light; }), 1, {split, "next", "off by one"});
    }
    warns(changed(good, "all", [](OlatImage& i, const Camera& c, size_t) { inCameraFrame(i, c, true); }), 2, {"in the cameras' frame"});
}

TEST_CASE("lights of the room around a turntable are named, whatever angle the table began at")
{
    TempFolder folder;
    const OlatDataset good = withTestSplit(sphereDataset(folder));
    for (const double start : {0.0, 1.0, -2.5}) {
        CAPTURE(start);
        const auto intoRoom = [&](OlatImage& i, const Camera& c, size_t) {
            const double angle = start - std::atan2(c.position().y, c.position().x);
            const glm::dmat3 turn(std::cos(angle), std::sin(angle), 0, -std::sin(angle), std::cos(angle), 0, 0, 0, 1);
            i.light.position = turn * glm::dvec3(i.light.position);
        };
        warns(changed(good, "all", intoRoom), 2, {"room", "turned"});
    }
}

TEST_CASE("directions in which light travels are told from directions towards it")
{
    TempFolder folder;
    const OlatDataset good = sphereDataset(folder);
    const auto directional = [](OlatImage& i, double sign) {
        i.light.type = LightType::kDirectional;
        i.light.directionToLight = glm::vec3(sign * glm::normalize(glm::dvec3(i.light.position)));
        i.light.intensity = glm::vec3(2.5f);
    };
    CHECK(check(changed(good, "train", [&](OlatImage& i, const Camera&, size_t) { directional(i, 1); })).empty());
    warns(changed(good, "train", [&](OlatImage& i, const Camera&, size_t) { directional(i, -1); }), 1, {"in which light travels", "negate"});
}

TEST_CASE("lights of other images are noticed, all of them or a few")
{
    TempFolder folder;
    const OlatDataset good = sphereDataset(folder);
    const std::vector<OlatImage> images = good.splits[0].images;
    warns(changed(good, "train", [&](OlatImage& i, const Camera&, size_t at) { i.light = images[(7 * at + 11) % 24].light; }), 1, {"shading disagrees", "other images"});
    warns(changed(good, "train", [&](OlatImage& i, const Camera&, size_t at) { if (at % 3 == 0) i.light.position = -i.light.position; }), 1, {"shading disagrees", "other images"});
    warns(changed(good, "train", [&](OlatImage& i, const Camera&, size_t at) { if (at % 8 == 0) i.light.position = -i.light.position; }), 1, {"images looked at", "darker towards their light"});
}

TEST_CASE("silhouettes that exclude each other are reported for wrong intrinsics, poses and masks, in the split that has them")
{
    Result<OlatDataset> sample = loadDataset(std::string(NACRE_SOURCE_DIR) + "/samples/data/bunny_wax_tiny");
    REQUIRE(sample);
    OlatDataset wide = *sample, swapped = *sample, test = *sample;
    for (OlatSplit& split : wide.splits)
        for (Camera& c : split.cameras) c.fx *= 2, c.fy *= 2, c.cx *= 1.4;
    warns(wide, 1, {"excluded by those of other cameras"});
    std::rotate(swapped.splits[0].cameras.begin(), swapped.splits[0].cameras.begin() + 9, swapped.splits[0].cameras.end());
    bool found = false;
    for (const std::string& w : check(swapped)) found |= mentions(w, "excluded by those of other cameras") && mentions(w, "'train'");
    CHECK(found);
    for (OlatSplit& split : test.splits)
        if (split.name == "test") std::rotate(split.cameras.begin(), split.cameras.begin() + 3, split.cameras.end());
    found = false;
    for (const std::string& w : check(test)) {
        found |= mentions(w, "do not fit those of 'train'");
        CHECK(mentions(w, "'test'"));
    }
    CHECK(found);
}

TEST_CASE("a camera whose mask is blank is named as such, and blames no intrinsics")
{
    TempFolder folder;
    const OlatDataset good = sphereDataset(folder);
    REQUIRE(writeExr(Image{32, 32, std::vector<float>(32 * 32 * 4)}, folder.file("blank.exr")));
    const OlatDataset blank = changed(good, "train", [&](OlatImage& i, const Camera&, size_t at) { if (at % 5 == 0) i.path = folder.file("blank.exr"); });
    warns(blank, 1, {"5 of 24", "no alpha above 0.5"});
}

TEST_CASE("lengths, intensities and intrinsics in another unit are reported with the figure that shows it")
{
    TempFolder folder;
    const OlatDataset good = sphereDataset(folder);
    const auto scaled = [&](float length, float intensity) {
        return changed(good, "train", [=](OlatImage& i, const Camera&, size_t) { i.light.position *= length, i.light.intensity *= intensity; });
    };
    warns(scaled(1000, 1e6f), 1, {"1.6e+03 times as far", "another unit"});
    warns(scaled(0.004f, 1), 3, {}); // too near, too bright, and inside the object
    warns(scaled(1, 0.01f), 1, {"apparent reflectance", "times too small"});
    warns(scaled(1, 1000), 1, {"apparent reflectance", "times too large"});
    OlatDataset brighter = good;
    brighter.splits.push_back(good.splits[0]);
    brighter.splits.back().name = "near";
    for (OlatImage& image : brighter.splits.back().images) image.light.intensity *= 3;
    CHECK(mentions(check(brighter).back(), "split 'near': apparent reflectance"));
    OlatDataset shifted = good, narrow = good;
    for (Camera& c : shifted.splits[0].cameras) std::swap(c.fx, c.cx), std::swap(c.fy, c.cy);
    CHECK(mentions(check(shifted).at(0), "principal point (44.8, 44.8) of images of 32x32"));
    for (Camera& c : narrow.splits[0].cameras) c.fy *= 3;
    CHECK(mentions(check(narrow).at(0), "focal lengths"));
}

TEST_CASE("held-out images that are in train, too, are counted: the same file, or the same camera under the same light")
{
    TempFolder folder;
    OlatDataset dataset = sphereDataset(folder);
    OlatSplit copied = dataset.splits[0];
    copied.name = "near";
    dataset.splits.push_back(copied);
    const std::string all = std::to_string(copied.images.size());
    warns(dataset, 1, {(all + " of " + all + " images of split 'near' are in train").c_str()});
    for (OlatImage& image : dataset.splits.back().images) image.light.position *= 1.1f; // other lights, the same files
    CHECK(mentions(check(dataset).at(0), "are in train"));
}
