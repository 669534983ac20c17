// Photographs: JPEG files in datasets, from the size in their header to what they say and do not get.
#include "dataset_support.h"

#include "interchange/image_file.h"
#include "mesh_jpeg_builder.h"

using namespace nacre;

namespace {

void writeBytes(const TempFolder& folder, const std::string& name, const Bytes& bytes)
{
    std::filesystem::create_directories((folder.path / name).parent_path());
    REQUIRE(writeFileAtomically(folder.file(name), bytes));
}

/// A canonical dataset of 16 x 8 images whose description states no size.
std::string writeDescription(const TempFolder& folder, const std::vector<std::string>& files, const json& top = json::object())
{
    json d = top;
    d["camera_angle_x"] = 0.7;
    for (const std::string& file : files)
        d["frames"].push_back({{"file_path", file}, {"transform_matrix", toJson(lookAtOrigin({2, 0, 1}, 8).worldFromCamera)},
                               {"light", {{"type", "point"}, {"position", {1, 2, 3}}, {"intensity", 5}}}});
    folder.writeText("transforms_train.json", d.dump());
    return folder.path.string();
}

} // namespace

TEST_CASE("JPEG photographs load with the size of their header, as sRGB unless the description says linear, whatever the extension's capitals")
{
    TempFolder folder;
    for (const char* name : {"a.jpg", "b.JPG", "c.jpeg"}) writeBytes(folder, name, flatJpeg(128, 64, 255));
    for (const bool linear : {false, true}) {
        const auto dataset = loadDataset(writeDescription(folder, {"a.jpg", "b", "c.jpeg"}, linear ? json{{"color_space", "linear"}} : json::object()));
        if (!dataset) FAIL(dataset.error().message);
        const OlatSplit& train = dataset->splits[0];
        REQUIRE(train.images.size() == 3);
        CHECK(train.cameras[0].width == 16);
        CHECK(train.cameras[0].height == 8);
        ImageCache cache(*dataset, 1 << 20);
        for (size_t i = 0; i < 3; ++i) {
            const auto image = cache.load(train, i);
            if (!image) FAIL(image.error().message);
            const float* p = (*image)->pixel(5, 5);
            const auto expected = [&](int v) { return linear ? v / 255.0 : linearFromSrgb(v / 255.0); };
            CHECK(p[0] == doctest::Approx(expected(128)).epsilon(0.03)); // a JPEG's steps
            CHECK(p[1] == doctest::Approx(expected(64)).epsilon(0.06));
            CHECK(p[3] == 1.0f);
        }
        CHECK(cache.notes().empty());
    }
}

TEST_CASE("a photograph that asks to be turned, or has another profile than sRGB, is named")
{
    TempFolder folder;
    writeBytes(folder, "turned.jpg", withSegments(flatJpeg(90, 90, 90), 6, "Display P3"));
    writeBytes(folder, "upright.jpg", withSegments(flatJpeg(90, 90, 90), 1, "sRGB IEC61966-2.1"));
    const auto dataset = loadDataset(writeDescription(folder, {"turned.jpg", "upright.jpg"}));
    if (!dataset) FAIL(dataset.error().message);
    CHECK(dataset->splits[0].cameras[0].width == 16);
    ImageCache cache(*dataset, 1 << 20);
    CHECK(cache.load(dataset->splits[0], 1));
    CHECK(cache.notes().empty());
    CHECK(cache.load(dataset->splits[0], 0));
    std::string notes;
    for (const std::string& note : cache.notes()) notes += note + "\n";
    INFO(notes);
    CHECK(cache.notes().size() == 2);
    CHECK(mentions(notes, "orientation"));
    CHECK(mentions(notes, "'Display P3'"));
    CHECK(mentions(notes, "turned.jpg"));
}

TEST_CASE("a JPEG cut off anywhere is an error, and so is its header before the size")
{
    const Bytes whole = withSegments(flatJpeg(10, 200, 30), 3, "AdobeRGB");
    const Result<JpegHeader> header = readJpegHeader(whole, "whole.jpg");
    REQUIRE(header);
    CHECK(header->width == 16);
    CHECK(header->height == 8);
    CHECK(header->orientation == 3);
    CHECK(header->profile == "AdobeRGB");
    bool known = false; // from some byte on the size is there, for good
    for (size_t n = 0; n <= whole.size(); ++n) {
        const auto part = std::span(whole).first(n);
        CHECK(bool(decodeJpeg(part, "cut.jpg")) == (n == whole.size()));
        const Result<JpegHeader> found = readJpegHeader(part, "cut.jpg");
        CHECK((found || !known));
        known = bool(found);
        if (!found) checkError(found.error(), ErrorCode::kBadInput, {"cut.jpg", "JPEG"});
    }
    CHECK(known);
}

TEST_CASE("the size is found behind previews longer than the first look at the file")
{
    TempFolder folder;
    Bytes jpeg = flatJpeg(10, 20, 30);
    Bytes preview;
    for (size_t b : {0xff, 0xed, 0xff, 0xff}) preview.push_back(std::byte(b));
    preview.resize(2 + 65535);
    for (int i = 0; i < 3; ++i) jpeg.insert(jpeg.begin() + 2, preview.begin(), preview.end());
    writeBytes(folder, "long.jpg", jpeg);
    const Result<Image> size = readImageFileSize(folder.file("long.jpg"));
    if (!size) FAIL(size.error().message);
    CHECK(size->width == 16);
    CHECK(size->height == 8);
    checkError(readImageFileSize(folder.file("long.tif")).error(), ErrorCode::kUnsupported, {"long.tif", ".jpg"});
}
