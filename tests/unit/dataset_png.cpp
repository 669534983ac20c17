#include "dataset_support.h"

using namespace nacre;

TEST_CASE("8-bit PNG round trip returns k/255 exactly, alpha 1 if absent")
{
    TempFolder folder;
    for (int channels : {3, 4}) {
        std::vector<uint8_t> pixels;
        for (int i = 0; i < 9 * 5 * channels; i++) pixels.push_back(uint8_t(i * 37));
        REQUIRE(writePng(folder.file("a.png"), 9, 5, channels, pixels));
        Result<Image> image = readPng(folder.file("a.png"));
        REQUIRE(image);
        REQUIRE(image->width == 9);
        REQUIRE(image->height == 5);
        for (size_t p = 0; p < 45; p++)
            for (size_t c = 0; c < 4; c++)
                CHECK(image->rgba[4 * p + c] == (c < size_t(channels) ? float(pixels[p * size_t(channels) + c]) / 255.0f : 1.0f));
        Result<Image> size = readPngSize(folder.file("a.png"));
        REQUIRE(size);
        CHECK(size->width == 9);
        CHECK(size->height == 5);
    }
}

TEST_CASE("16-bit grey PNG keeps its 16 bits")
{
    PngBuilder png;
    png.bitDepth = 16;
    png.colorType = 0;
    png.rows = {0, 0x12, 0x34, 0xff, 0xff, 0, 0x00, 0x01, 0x80, 0x00};
    Result<Image> image = decodePng(png.build(), "grey.png");
    REQUIRE(image);
    for (int c = 0; c < 3; c++) {
        CHECK(image->pixel(0, 0)[c] == 4660.0f / 65535.0f);
        CHECK(image->pixel(1, 0)[c] == 1.0f);
        CHECK(image->pixel(0, 1)[c] == 1.0f / 65535.0f);
    }
    CHECK(image->pixel(1, 1)[3] == 1.0f);
}

TEST_CASE("PNG cut off at any byte or with any bit flipped is an error")
{
    PngBuilder png;
    png.rows = {0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 9, 10, 11, 12, 13, 14, 15, 16};
    const Bytes good = png.build();
    REQUIRE(decodePng(good, "good.png"));
    for (size_t n = 0; n < good.size(); n++) CHECK(!decodePng(std::span(good).first(n), "cut.png"));
    for (size_t bit = 0; bit < good.size() * 8; bit++) {
        Bytes damaged = good;
        damaged[bit / 8] ^= std::byte(1 << (bit % 8));
        INFO("bit " << bit);
        CHECK(!decodePng(damaged, "damaged.png"));
    }
}

TEST_CASE("PNG with a chunk of an unknown critical type is an error of one line")
{
    PngBuilder png;
    png.rows.assign(18, 7);
    Bytes bytes = png.build();
    for (const char* type : {"\nATx", "ABCD", "CgBI"}) {
        std::memcpy(bytes.data() + 37, type, 4);
        repairPngChecksums(bytes);
        Result<Image> image = decodePng(bytes, "odd.png");
        REQUIRE(!image);
        checkError(image.error(), ErrorCode::kBadInput, {"odd.png", "byte 33"});
    }
}

TEST_CASE("PNG that lies about its size is refused before its pixels are allocated")
{
    for (const auto& [w, h] : {std::pair{0u, 2u}, {0xffffffffu, 1u}, {65536u, 65536u}, {16384u, 16384u}}) {
        PngBuilder png;
        png.width = w;
        png.height = h;
        png.rows.assign(18, 0);
        Result<Image> image = decodePng(png.build(), "lie.png");
        REQUIRE(!image);
        checkError(image.error(), ErrorCode::kBadInput, {"lie.png"});
    }
    PngBuilder shorter; // passes the plausibility check, but the rows are missing
    shorter.width = shorter.height = 16;
    shorter.rows.assign(18, 0);
    CHECK(!decodePng(shorter.build(), "short.png"));
}

TEST_CASE("writing a PNG checks its arguments and fails cleanly")
{
    TempFolder folder;
    const std::vector<uint8_t> pixels(12);
    for (const auto& [w, h, c] : {std::array{2, 2, 2}, {2, 3, 3}, {0, 2, 3}, {-2, -2, 3}}) {
        Status s = writePng(folder.file("a.png"), w, h, c, pixels);
        REQUIRE(!s);
        CHECK(s.error().code == ErrorCode::kBadInput);
    }
    CHECK(std::filesystem::is_empty(folder.path));
    Status s = writePng(folder.file("missing/a.png"), 2, 2, 3, pixels);
    REQUIRE(!s);
    CHECK(s.error().code == ErrorCode::kIo);
}

TEST_CASE("a palette index without a colour is damage, not a hole; those with one are as the palette says")
{
    PngBuilder png;
    png.colorType = 3;
    png.chunks = {{"PLTE", {255, 0, 0, 0, 255, 0, 0, 0, 255}}, {"tRNS", {255, 128}}};
    png.rows = {0, 0, 1, 0, 2, 1};
    const Result<Image> good = decodePng(png.build(), "p.png");
    REQUIRE_MESSAGE(good, (good ? "" : good.error().message));
    CHECK(good->pixel(0, 1)[2] == 1.0f);
    CHECK(good->pixel(1, 0)[1] == 1.0f);
    CHECK(good->pixel(1, 0)[3] == doctest::Approx(128 / 255.0));
    for (const uint8_t index : {3, 63, 255}) {
        png.rows = {0, 0, 1, 0, 2, index};
        const Result<Image> bad = decodePng(png.build(), "p.png");
        REQUIRE(!bad);
        checkError(bad.error(), ErrorCode::kBadInput, {"p.png", ("palette index " + std::to_string(index) + " of 3 colours").c_str(), "(1, 1)"});
        CHECK(!decodePng8(png.build(), "p.png"));
    }
    png.bitDepth = 2; // four indices a byte: 0 3
    png.rows = {0, 0b00110000, 0, 0};
    const Result<Image> small = decodePng(png.build(), "p.png");
    REQUIRE(!small);
    checkError(small.error(), ErrorCode::kBadInput, {"palette index 3 of 3 colours", "(1, 0)"});
    png.rows = {0, 0b00100000, 0, 0};
    CHECK(decodePng(png.build(), "p.png"));
    png.chunks = {};
    CHECK(!decodePng(png.build(), "p.png"));
}
