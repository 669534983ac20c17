// Packed datasets: pixels come back, descriptions come back, and no damage goes unnoticed.
#include "dataset_support.h"

#include "dataset/packed_images.h"

#include <random>

using namespace nacre;

namespace {

/// Colours of 8-bit sRGB and coverage of 8 bits in the middle of a black frame, one pixel of it unknown.
Image eightBitImage()
{
    Image image{24, 20, std::vector<float>(24 * 20 * 4)};
    std::mt19937 random(1);
    for (int y = 7; y < 13; ++y)
        for (int x = 9; x < 15; ++x) {
            float* p = image.pixel(x, y);
            for (int c = 0; c < 3; ++c) p[c] = float(linearFromSrgb(double(random() % 256) / 255.0));
            p[3] = float(1 + random() % 255) / 255.0f;
        }
    float* p = image.pixel(11, 9);
    p[0] = p[1] = p[2] = 0, p[3] = kUnknownAlpha;
    return image;
}

/// A dataset with lights of every kind and one block, and the text of it.
std::string exampleText(uint64_t* pixelBytes, PackedBlock* block = nullptr)
{
    OlatDataset dataset;
    dataset.convention = "canonical", dataset.path = "somewhere", dataset.up = {0, 1, 0}, dataset.rig = LightRig::kCamera;
    dataset.warnings = {"beware"};
    OlatSplit& split = dataset.splits.emplace_back();
    split.name = "train";
    Camera camera = lookAtOrigin({2, 1, 1}, 24);
    camera.height = 20;
    split.cameras = {camera};
    Light point, far, sky, all;
    point.position = {0.1f, 1e4f, 3}, point.positionRest = {0, 1e-5f, 0}, point.intensity = {1, 2.5f, 0.1f};
    far.type = LightType::kDirectional, far.directionToLight = glm::normalize(glm::vec3(1, 2, 3)), far.radius = 0.01f;
    sky.type = LightType::kEnvironment, sky.environmentPath = "maps/0.exr";
    all.type = LightType::kGroup, all.group = std::make_shared<std::vector<Light>>(std::vector<Light>{point, far});
    PackedImages packed;
    for (const Light& light : {point, far, sky, all}) {
        OlatImage image{0, light, "a.png"};
        image.packedBlock = uint32_t(packed.blocks.size());
        PackedBlock b;
        const auto bytes = encodePixels(eightBitImage(), false, b);
        b.offset = packed.blocks.size() * bytes.size();
        *pixelBytes = b.offset + bytes.size();
        if (block) *block = b;
        packed.blocks.push_back(b);
        split.images.push_back(image);
    }
    packed.skipped = {{"train", "b.png", "b.png: cut off"}}, packed.sourceState = 0xfedcba9876543210ull;
    return encodePackedDescription(dataset, packed);
}

Result<OlatDataset> decode(const std::string& text, uint64_t pixelBytes)
{
    return decodePackedDescription(std::as_bytes(std::span(text)), "folder", pixelBytes);
}

} // namespace

TEST_CASE("8-bit images come back from bytes exactly, unknown pixels included, and only what is not empty is stored")
{
    const Image image = eightBitImage();
    PackedBlock block;
    const auto bytes = encodePixels(image, false, block);
    CHECK(block.columns == 6 + 2 * 4);
    CHECK(block.rows == 6 + 2 * 4);
    const Image back = decodePixels(block, bytes);
    CHECK(back.width == image.width);
    CHECK(back.height == image.height);
    CHECK(back.rgba == image.rgba);
}

TEST_CASE("any image comes back from bytes within half a step of a display, from halves within 2^-11")
{
    Image image{16, 16, std::vector<float>(16 * 16 * 4)};
    std::mt19937 random(2);
    std::uniform_real_distribution<float> uniform(0, 1);
    for (float& v : image.rgba) v = uniform(random) * uniform(random);
    for (const bool halves : {false, true}) {
        PackedBlock block;
        const auto bytes = encodePixels(image, halves, block);
        const Image back = decodePixels(block, bytes);
        double worst = 0;
        for (size_t i = 0; i < image.rgba.size(); ++i) {
            const double a = image.rgba[i], b = back.rgba[i];
            if (halves) worst = std::max(worst, std::abs(a - b) - std::max(a, 6e-5) / 2048);
            else worst = std::max(worst, std::abs(i % 4 == 3 ? a - b : srgbFromLinear(a) - srgbFromLinear(b)) - 0.5001 / 255);
        }
        CHECK(worst <= 0);
    }
}

TEST_CASE("numbers that a format does not hold are cut off, never wrapped")
{
    Image image{3, 1, {1e9f, -5, 2, 1, NAN, INFINITY, 0.5f, 1, 1, 1, 1, 0}};
    PackedBlock block;
    const Image bytes = decodePixels(block, encodePixels(image, false, block));
    CHECK(std::vector<float>(bytes.rgba.begin(), bytes.rgba.begin() + 4) == std::vector<float>{1, 0, 1, 1});
    CHECK(bytes.rgba[4] == 0);
    CHECK(bytes.rgba[11] == 0); // white light without coverage is not taken for an unknown pixel
    const Image halves = decodePixels(block, encodePixels(image, true, block));
    CHECK(std::vector<float>(halves.rgba.begin(), halves.rgba.begin() + 4) == std::vector<float>{65504, -5, 2, 1});
    CHECK(halves.rgba[4] == 0);
    CHECK(halves.rgba[5] == 0);
}

TEST_CASE("an empty image takes no pixels")
{
    PackedBlock block;
    const auto bytes = encodePixels(Image{5, 4, std::vector<float>(80)}, true, block);
    CHECK(bytes.empty());
    CHECK(decodePixels(block, bytes).rgba == std::vector<float>(80));
}

TEST_CASE("the description of a packed dataset comes back")
{
    uint64_t pixelBytes = 0;
    const std::string text = exampleText(&pixelBytes);
    const auto dataset = decode(text, pixelBytes);
    INFO((dataset ? "" : dataset.error().message));
    REQUIRE(dataset);
    const OlatSplit& split = dataset->splits[0];
    CHECK(dataset->convention == "canonical");
    CHECK(dataset->up == glm::vec3(0, 1, 0));
    CHECK(dataset->rig == LightRig::kCamera);
    CHECK(dataset->warnings == std::vector<std::string>{"beware"});
    CHECK(dataset->packed->skipped[0].why == "b.png: cut off");
    CHECK(dataset->packed->sourceState == 0xfedcba9876543210ull);
    for (int k = 0; k < 16; ++k) CHECK(split.cameras[0].worldFromCamera[k / 4][k % 4] == lookAtOrigin({2, 1, 1}, 24).worldFromCamera[k / 4][k % 4]);
    CHECK(split.cameras[0].height == 20);
    CHECK(split.cameras[0].fx == lookAtOrigin({2, 1, 1}, 24).fx);
    CHECK(glm::distance(split.cameras[0].position(), glm::dvec3(2, 1, 1)) < 1e-12);
    REQUIRE(split.images.size() == 4);
    CHECK(split.images[0].light.position == glm::vec3(0.1f, 1e4f, 3));
    CHECK(split.images[0].light.positionRest == glm::vec3(0, 1e-5f, 0));
    CHECK(split.images[0].light.intensity == glm::vec3(1, 2.5f, 0.1f));
    CHECK(split.images[1].light.radius == 0.01f);
    CHECK(split.images[2].light.environmentPath == "folder/maps/0.exr");
    CHECK(split.images[3].light.group->size() == 2);
    CHECK(dataset->packed->blocks[3].hash == dataset->packed->blocks[0].hash);
}

TEST_CASE("a description cut anywhere, or of a file of pixels that is too short, is an error of one line")
{
    uint64_t pixelBytes = 0;
    const std::string text = exampleText(&pixelBytes);
    for (size_t length = 0; length + 2 < text.size(); length += 7) {
        const auto dataset = decode(text.substr(0, length), pixelBytes);
        REQUIRE(!dataset);
        CHECK(!mentions(dataset.error().message, "\n"));
    }
    const auto shorter = decode(text, pixelBytes - 1);
    REQUIRE(!shorter);
    checkError(shorter.error(), ErrorCode::kBadInput, {"pixels.bin", "prepare"});
}

TEST_CASE("a damaged byte of the pixels is an error, a folder without pixels too")
{
    TempFolder folder;
    uint64_t pixelBytes = 0;
    PackedBlock block;
    folder.writeText("packed.json", exampleText(&pixelBytes, &block));
    const auto missing = loadDataset(folder.path.string());
    REQUIRE(!missing);
    checkError(missing.error(), ErrorCode::kBadInput, {"pixels.bin", "prepare"});

    const auto bytes = encodePixels(eightBitImage(), false, block);
    std::string pixels;
    for (int k = 0; k < 4; ++k) pixels.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    pixels[bytes.size() + 5] = char(pixels[bytes.size() + 5] ^ 1);
    folder.writeText("pixels.bin", pixels);
    const auto dataset = loadDataset(folder.path.string());
    REQUIRE(dataset);
    ImageCache images(*dataset, 1 << 20);
    CHECK(images.load(dataset->splits[0], 0));
    const auto damaged = images.load(dataset->splits[0], 1);
    REQUIRE(!damaged);
    checkError(damaged.error(), ErrorCode::kBadInput, {"pixels.bin", "checksum"});
    const OlatDataset half = halved(*dataset);
    ImageCache halves(half, 0);
    const auto small = halves.load(half.splits[0], 0);
    REQUIRE(small);
    CHECK((*small)->width == 12);
    folder.writeText("pixels.bin", pixels.substr(0, 10)); // while it is in use
    CHECK(!halves.load(half.splits[0], 3));
}

TEST_CASE("a damaged byte of the description is an error, digits of poses and lights among them")
{
    TempFolder folder;
    uint64_t pixelBytes = 0;
    const std::string text = exampleText(&pixelBytes);
    folder.writeText("pixels.bin", std::string(pixelBytes, 'x'));
    folder.writeText("packed.json", text);
    REQUIRE(loadDataset(folder.path.string()));
    const size_t body = text.find(",\"checksum\"");
    REQUIRE(body < text.size());
    for (size_t at = 0; at < body; at += 5) {
        std::string changed = text;
        changed[at] = char(changed[at] ^ 1);
        folder.writeText("packed.json", changed);
        CAPTURE(at);
        const auto dataset = loadDataset(folder.path.string());
        REQUIRE(!dataset);
    }
    folder.writeText("packed.json", text.substr(0, body) + "}\n"); // of a version that had none
    CHECK(loadDataset(folder.path.string()));
}
