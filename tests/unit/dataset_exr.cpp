#include "dataset_support.h"

#include <limits>

using namespace nacre;

static Image gradient(int width, int height)
{
    Image image{width, height, {}};
    for (int i = 0; i < width * height * 4; i++) image.rgba.push_back(i % 4 == 3 ? 0.5f : float(i) / 64.0f); // exact in half
    return image;
}

TEST_CASE("half-representable pixels survive an EXR round trip exactly")
{
    TempFolder folder;
    const Image image = gradient(7, 40); // more rows than one read band
    REQUIRE(writeExr(image, folder.file("a.exr")));
    Result<Image> back = readExr(folder.file("a.exr"));
    REQUIRE(back);
    CHECK(back->width == 7);
    CHECK(back->height == 40);
    CHECK(back->rgba == image.rgba);
    Result<Image> size = readExrSize(folder.file("a.exr"));
    REQUIRE(size);
    CHECK(size->width == 7);
    CHECK(size->height == 40);
}

TEST_CASE("float EXR keeps float precision and missing alpha reads as 1")
{
    ExrBuilder exr;
    exr.channels = {"B", "G", "R"};
    Result<Image> image = decodeExr(exr.build(1.0000001f, 1, 1), "a.exr");
    REQUIRE(image);
    CHECK(image->width == 4);
    CHECK(image->height == 3);
    CHECK(image->pixel(1, 1)[1] == 1.0000001f);
    CHECK(image->pixel(3, 2)[0] == exr.value(2, 3, 2));
    CHECK(image->pixel(3, 2)[2] == exr.value(0, 3, 2));
    CHECK(image->pixel(0, 0)[3] == 1.0f);
}

TEST_CASE("tiled EXR reads like scanline EXR")
{
    Result<Image> image = decodeExr(tiledExr(), "tiled.exr");
    REQUIRE(image);
    REQUIRE(image->width == 5);
    REQUIRE(image->height == 4);
    for (int y = 0; y < 4; y++)
        for (int x = 0; x < 5; x++) {
            const float v = float(10 * y + x);
            CHECK(image->pixel(x, y)[0] == v);
            CHECK(image->pixel(x, y)[1] == v + 0.5f);
            CHECK(image->pixel(x, y)[2] == -v);
            CHECK(image->pixel(x, y)[3] == 1.0f);
        }
}

TEST_CASE("EXR data window is placed in the display window, black and empty outside")
{
    ExrBuilder exr;
    const int32_t data[4] = {-2, 1, 2, 3}, display[4] = {0, 0, 5, 4};
    std::copy_n(data, 4, exr.dataWindow);
    std::copy_n(display, 4, exr.displayWindow);
    Result<Image> image = decodeExr(exr.build(), "crop.exr");
    REQUIRE(image);
    CHECK(image->width == 6);
    CHECK(image->height == 5);
    for (int y = 0; y < 5; y++)
        for (int x = 0; x < 6; x++) {
            const bool inside = x <= 2 && y >= 1 && y <= 3;
            CHECK(image->pixel(x, y)[0] == (inside ? exr.value(3, x, y) : 0.0f));
            CHECK(image->pixel(x, y)[3] == (inside ? exr.value(0, x, y) : 0.0f));
        }
}

TEST_CASE("EXR with NaN or infinite pixels names the file and the pixel")
{
    const ExrBuilder exr;
    Result<Image> nan = decodeExr(exr.build(std::numeric_limits<float>::quiet_NaN(), 2, 1), "nan.exr");
    REQUIRE(!nan);
    checkError(nan.error(), ErrorCode::kBadInput, {"nan.exr", "NaN", "(2, 1)"});
    Result<Image> infinite = decodeExr(exr.build(-std::numeric_limits<float>::infinity(), 0, 2), "inf.exr");
    REQUIRE(!infinite);
    checkError(infinite.error(), ErrorCode::kBadInput, {"inf.exr", "infinite", "(0, 2)"});
}

TEST_CASE("EXR without R, G, B says which channels it has")
{
    ExrBuilder exr;
    exr.channels = {"Y", "Z"};
    Result<Image> image = decodeExr(exr.build(), "depth.exr");
    REQUIRE(!image);
    checkError(image.error(), ErrorCode::kBadInput, {"depth.exr", "Y, Z", "R, G, B"});
}

TEST_CASE("EXR that is subsampled, multi-part or of another version is refused")
{
    ExrBuilder exr;
    exr.sampling = 2;
    CHECK(!decodeExr(exr.build(), "a.exr"));
    exr = {};
    exr.version = 2 | 0x1000;
    Result<Image> multi = decodeExr(exr.build(), "multi.exr");
    REQUIRE(!multi);
    checkError(multi.error(), ErrorCode::kUnsupported, {"multi-part"});
    exr.version = 3;
    CHECK(!decodeExr(exr.build(), "a.exr"));
}

TEST_CASE("EXR that lies about its size is refused before its pixels are allocated")
{
    for (const auto& [maxX, maxY] : {std::pair{INT32_MAX, INT32_MAX}, {65536, 3}, {65535, 65535}, {-1, 3}, {3, INT32_MIN}}) {
        ExrBuilder exr;
        exr.dataWindow[2] = maxX;
        exr.dataWindow[3] = maxY;
        Result<Image> image = decodeExr(exr.build(), "lie.exr");
        REQUIRE(!image);
        checkError(image.error(), ErrorCode::kBadInput, {"lie.exr", "data window"});
    }
    ExrBuilder exr; // allowed size, missing pixels: must fail at the first block
    exr.dataWindow[2] = exr.displayWindow[2] = exr.dataWindow[3] = exr.displayWindow[3] = 16383;
    CHECK(!decodeExr(exr.build(), "empty.exr"));
    Bytes many = ExrBuilder().build();
    many.resize(60); // inside the channel list
    CHECK(!decodeExr(many, "cut.exr"));
}

TEST_CASE("EXR cut off at any byte is an error")
{
    TempFolder folder;
    REQUIRE(writeExr(gradient(8, 20), folder.file("a.exr")));
    const Bytes zip = *readFile(folder.file("a.exr")), raw = ExrBuilder().build();
    for (const Bytes& bytes : {zip, raw, tiledExr()})
        for (size_t n = 0; n < bytes.size(); n++) {
            Result<Image> image = decodeExr(std::span(bytes).first(n), "cut.exr");
            if (image) FAIL("decoded from " << n << " of " << bytes.size() << " bytes");
        }
}

TEST_CASE("pixels beyond the half range survive an EXR round trip exactly, as floats")
{
    TempFolder folder;
    Image image = gradient(7, 40);
    image.rgba[5] = 65505.0f;
    image.rgba[8] = -3.0e38f;
    image.rgba[9] = 0.1f; // no half
    REQUIRE(writeExr(image, folder.file("a.exr")));
    Result<Image> back = readExr(folder.file("a.exr"));
    REQUIRE(back);
    CHECK(back->rgba == image.rgba);
}

TEST_CASE("writing an EXR refuses NaN and infinite pixels and leaves nothing behind on failure")
{
    TempFolder folder;
    Image image = gradient(2, 2);
    image.rgba[5] = std::numeric_limits<float>::infinity();
    Status infinite = writeExr(image, folder.file("a.exr"));
    REQUIRE(!infinite);
    checkError(infinite.error(), ErrorCode::kBadInput, {"(1, 0)", "infinite"});
    image.rgba[5] = std::numeric_limits<float>::quiet_NaN();
    CHECK(!writeExr(image, folder.file("a.exr")));
    Image lying{3, 3, std::vector<float>(4)};
    CHECK(!writeExr(lying, folder.file("a.exr")));
    CHECK(std::filesystem::is_empty(folder.path));

    Status noFolder = writeExr(gradient(2, 2), folder.file("no/such/folder/a.exr"));
    REQUIRE(!noFolder);
    CHECK(noFolder.error().code == ErrorCode::kIo);
}

TEST_CASE("the picture of an EXR with layers is the only one, or the only one named Combined; else they are listed")
{
    const auto layer = [](const std::string& name) { return std::vector<std::string>{name + ".A", name + ".B", name + ".G", name + ".R"}; };
    const auto join = [](std::vector<std::string> a, const std::vector<std::string>& b) {
        a.insert(a.end(), b.begin(), b.end());
        return a;
    };
    ExrBuilder exr;
    for (const auto& channels : {layer("ViewLayer.Combined"), layer("beauty"), join({"Depth.Z"}, layer("rgba"))}) {
        exr.channels = channels;
        const Result<Image> image = decodeExr(exr.build(), "a.exr");
        REQUIRE_MESSAGE(image, (image ? "" : image.error().message));
        const size_t first = channels.size() - 4; // the file's order is A, B, G, R
        for (size_t c = 0; c < 4; ++c) CHECK(image->pixel(2, 1)[c] == exr.value(first + 3 - c, 2, 1));
    }
    exr.channels = join(layer("Layer.Combined"), layer("Layer.DiffDir")); // Combined among others
    const Result<Image> combined = decodeExr(exr.build(), "a.exr");
    REQUIRE(combined);
    CHECK(combined->pixel(2, 1)[0] == exr.value(3, 2, 1));
    exr.channels = {"a.b", "a.g", "a.r"}; // small letters, no alpha
    const Result<Image> opaque = decodeExr(exr.build(), "a.exr");
    REQUIRE(opaque);
    CHECK(opaque->pixel(2, 1)[0] == exr.value(2, 2, 1));
    CHECK(opaque->pixel(2, 1)[3] == 1.0f);

    for (const auto& two : {join(layer("One.Combined"), layer("Two.Combined")), join(layer("One.Diffuse"), layer("Two.Glossy"))}) {
        exr.channels = two;
        const Result<Image> image = decodeExr(exr.build(), "a.exr");
        REQUIRE(!image);
        checkError(image.error(), ErrorCode::kBadInput, {"a.exr", "2 layers", "One.", "Two."});
    }
}

TEST_CASE("luminance is grey; whole numbers are no colours")
{
    ExrBuilder exr;
    exr.channels = {"A", "Y"};
    const Result<Image> grey = decodeExr(exr.build(), "a.exr");
    REQUIRE(grey);
    for (size_t c = 0; c < 3; ++c) CHECK(grey->pixel(3, 2)[c] == exr.value(1, 3, 2));
    CHECK(grey->pixel(3, 2)[3] == exr.value(0, 3, 2));
    exr.channels = {"BY", "RY", "Y"};
    CHECK(!decodeExr(exr.build(), "a.exr"));
    exr = {};
    exr.type = 0;
    const Result<Image> whole = decodeExr(exr.build(), "a.exr");
    REQUIRE(!whole);
    checkError(whole.error(), ErrorCode::kBadInput, {"a.exr", "whole numbers"});
}

TEST_CASE("chromaticities of an EXR are converted to Rec.709, white to white")
{
    struct Case {
        const char* what;
        std::vector<float> chromaticities;
        glm::dvec3 of, is; // of: R, G, B in the file
    };
    // is: by the matrices of the ACES documents (Bradford) and of BT.2087
    const Case cases[] = {{"ACES AP0", {0.7347f, 0.2653f, 0.0f, 1.0f, 0.0001f, -0.077f, 0.32168f, 0.33767f}, {0.3, 0.5, 0.3}, {0.0732, 0.5745, 0.2694}},
                          {"ACES AP0, white", {0.7347f, 0.2653f, 0.0f, 1.0f, 0.0001f, -0.077f, 0.32168f, 0.33767f}, {1, 1, 1}, {1, 1, 1}},
                          {"Rec.2020", {0.708f, 0.292f, 0.17f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.329f}, {1, 0, 0}, {1.6605, -0.1246, -0.0182}},
                          {"XYZ, as colour space", {1, 0, 0, 1, 0, 0, 0.3127f, 0.329f}, {1, 1, 1}, {1, 1, 1}},
                          {"Rec.709, rounded", {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.313f, 0.329f}, {0.3, 0.5, 0.7}, {0.3, 0.5, 0.7}}};
    for (const Case& c : cases) {
        INFO(c.what);
        ExrBuilder exr;
        exr.chromaticities = c.chromaticities;
        Bytes bytes = exr.build();
        const size_t pixels = bytes.size() - 4 * 4 * 4; // the last line: A, B, G, R, 4 pixels each
        for (size_t channel = 1; channel < 4; ++channel)
            for (size_t x = 0; x < 4; ++x) {
                const float v = float(c.of[int(3 - channel)]);
                std::memcpy(bytes.data() + pixels + (4 * channel + x) * 4, &v, 4);
            }
        const Result<Image> image = decodeExr(bytes, "a.exr");
        REQUIRE_MESSAGE(image, (image ? "" : image.error().message));
        for (int k = 0; k < 3; ++k) CHECK(image->pixel(2, 2)[k] == doctest::Approx(c.is[k]).epsilon(1e-3));
    }
    for (const std::vector<float>& nonsense : {std::vector<float>(8, 0.0f), std::vector<float>(8, 0.3f), std::vector<float>{0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 1, 0},
                                               std::vector<float>{NAN, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f}}) {
        ExrBuilder exr;
        exr.chromaticities = nonsense;
        const Result<Image> image = decodeExr(exr.build(), "a.exr");
        REQUIRE(!image);
        checkError(image.error(), ErrorCode::kBadInput, {"a.exr", "chromaticities"});
    }
}
