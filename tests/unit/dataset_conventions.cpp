// The checks must be silent on good data and name the mistake on data that was flipped on purpose.
#include "dataset_support.h"

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
        REQUIRE(warnings.size() == 1);
        INFO(warnings[0]);
        CHECK(mentions(warnings[0], "shading disagrees"));
        CHECK(mentions(warnings[0], flip.named));
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
