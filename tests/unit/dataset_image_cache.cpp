#include "dataset_support.h"

#include <limits>
#include <thread>

using namespace nacre;

namespace {

constexpr int kSize = 8;
constexpr size_t kImageBytes = kSize * kSize * 16;

/// `count` images, all red channels equal to the image's index.
OlatDataset numberedImages(const TempFolder& folder, size_t count)
{
    OlatDataset dataset;
    dataset.splits.push_back({"train", {lookAtOrigin({2, 0, 1}, kSize)}, {}});
    for (size_t i = 0; i < count; i++) {
        Image image{kSize, kSize, std::vector<float>(kSize * kSize * 4, 1.0f)};
        for (size_t p = 0; p < image.rgba.size(); p += 4) image.rgba[p] = float(i);
        const std::string path = folder.file(std::to_string(i) + ".exr");
        REQUIRE(writeExr(image, path));
        dataset.splits[0].images.push_back({0, Light(), path});
    }
    return dataset;
}

} // namespace

TEST_CASE("cache stays within its budget and keeps the most recently used images")
{
    TempFolder folder;
    const OlatDataset dataset = numberedImages(folder, 6);
    ImageCache cache(dataset, 3 * kImageBytes + 100);
    std::vector<const Image*> first;
    for (size_t i = 0; i < 6; i++) {
        Result<std::shared_ptr<const Image>> image = cache.load(dataset.splits[0], i);
        REQUIRE(image);
        CHECK((*image)->rgba[0] == float(i));
        CHECK(cache.residentBytes() <= 3 * kImageBytes + 100);
    }
    CHECK(cache.residentBytes() == 3 * kImageBytes);
    for (size_t i = 0; i < 6; i++) std::filesystem::remove(folder.file(std::to_string(i) + ".exr"));
    CHECK(!cache.load(dataset.splits[0], 2)); // evicted
    for (size_t i = 3; i < 6; i++) CHECK(cache.load(dataset.splits[0], i));

    REQUIRE(writeExr(Image{kSize, kSize, std::vector<float>(kSize * kSize * 4)}, dataset.splits[0].images[0].path));
    CHECK(cache.load(dataset.splits[0], 3)); // the oldest is used again, so 4 has to go for 0
    CHECK(cache.load(dataset.splits[0], 0));
    CHECK(cache.load(dataset.splits[0], 3));
    CHECK(!cache.load(dataset.splits[0], 4));
}

TEST_CASE("an image above the whole budget is handed out but not kept")
{
    TempFolder folder;
    const OlatDataset dataset = numberedImages(folder, 1);
    ImageCache cache(dataset, kImageBytes - 1);
    CHECK(cache.load(dataset.splits[0], 0));
    CHECK(cache.residentBytes() == 0);
}

TEST_CASE("threads that share a small cache all get the right pixels")
{
    TempFolder folder;
    const OlatDataset dataset = numberedImages(folder, 5);
    ImageCache cache(dataset, 2 * kImageBytes);
    std::vector<std::thread> threads;
    std::vector<int> wrong(4, 0); // doctest's checks stay on this thread
    for (size_t t = 0; t < wrong.size(); t++)
        threads.emplace_back([&, t] {
            for (size_t k = 0; k < 100; k++) {
                const size_t i = (k * (t + 1) + t) % 5;
                Result<std::shared_ptr<const Image>> image = cache.load(dataset.splits[0], i);
                if (!image || (*image)->rgba[0] != float(i) || cache.residentBytes() > 2 * kImageBytes) wrong[t]++;
            }
        });
    for (std::thread& t : threads) t.join();
    for (int w : wrong) CHECK(w == 0);
}

TEST_CASE("an image that does not fit its camera, has NaN or impossible alpha is an error that names it")
{
    TempFolder folder;
    OlatDataset dataset = numberedImages(folder, 1);
    const std::string path = dataset.splits[0].images[0].path;
    dataset.splits[0].cameras[0].height = kSize + 1;
    Result<std::shared_ptr<const Image>> wrongSize = ImageCache(dataset, 1 << 20).load(dataset.splits[0], 0);
    REQUIRE(!wrongSize);
    checkError(wrongSize.error(), ErrorCode::kBadInput, {path.c_str(), "8 x 8", "8 x 9"});
    dataset.splits[0].cameras[0].height = kSize;

    Image image{kSize, kSize, std::vector<float>(kSize * kSize * 4, 1.0f)};
    for (const float alpha : {1.5f, -0.25f}) {
        image.rgba[4 * 9 + 3] = alpha;
        REQUIRE(writeExr(image, path));
        Result<std::shared_ptr<const Image>> wrongAlpha = ImageCache(dataset, 1 << 20).load(dataset.splits[0], 0);
        REQUIRE(!wrongAlpha);
        checkError(wrongAlpha.error(), ErrorCode::kBadInput, {path.c_str(), "alpha", "(1, 1)"});
    }
    const Bytes nan = ExrBuilder().build(std::numeric_limits<float>::quiet_NaN(), 1, 1);
    REQUIRE(writeFileAtomically(path, nan));
    Result<std::shared_ptr<const Image>> notFinite = ImageCache(dataset, 1 << 20).load(dataset.splits[0], 0);
    REQUIRE(!notFinite);
    checkError(notFinite.error(), ErrorCode::kBadInput, {path.c_str(), "NaN"});
    std::filesystem::remove(path);
    CHECK(!ImageCache(dataset, 1 << 20).load(dataset.splits[0], 0));
}

TEST_CASE("a halved dataset: means of four pixels, the same rays, an odd last row and column unseen")
{
    TempFolder folder;
    OlatDataset dataset;
    Camera camera = lookAtOrigin({2, 0, 1}, 7);
    camera.height = 5, camera.cx = 3.2, camera.cy = 2.6, camera.fy *= 1.1;
    Image image{7, 5, std::vector<float>(7 * 5 * 4, 1.0f)};
    for (int y = 0; y < 5; ++y)
        for (int x = 0; x < 7; ++x) image.pixel(x, y)[0] = float(x + 10 * y), image.pixel(x, y)[3] = x < 2 ? 0.5f : 1.0f;
    REQUIRE(writeExr(image, folder.file("0.exr")));
    dataset.splits.push_back({"train", {camera}, {{0, Light(), folder.file("0.exr")}}});

    const OlatDataset small = halved(dataset);
    const Camera& half = small.splits[0].cameras[0];
    CHECK(half.width == 3);
    CHECK(half.height == 2);
    CHECK(glm::distance(pixelRay(half, 1.5, 0.5), pixelRay(camera, 3.0, 1.0)) < 1e-12);
    const Result<std::shared_ptr<const Image>> loaded = ImageCache(small, 1 << 20).load(small.splits[0], 0);
    REQUIRE(loaded);
    REQUIRE((*loaded)->rgba.size() == 3 * 2 * 4);
    for (int y = 0; y < 2; ++y)
        for (int x = 0; x < 3; ++x) {
            CHECK((*loaded)->pixel(x, y)[0] == doctest::Approx(2 * x + 0.5 + 10 * (2 * y + 0.5)));
            CHECK((*loaded)->pixel(x, y)[3] == (x == 0 ? 0.5f : 1.0f));
        }
    CHECK(!ImageCache(dataset, 1 << 20).load(small.splits[0], 0)); // these cameras are not of the whole images
}

TEST_CASE("alpha that a filter left a little outside 0 to 1 is clamped, with a note that counts the files")
{
    TempFolder folder;
    const OlatDataset dataset = numberedImages(folder, 3);
    Image image{kSize, kSize, std::vector<float>(kSize * kSize * 4, 0.5f)};
    image.rgba[3] = -0.0156f, image.rgba[7] = 1.09f;
    for (const int i : {0, 2}) REQUIRE(writeExr(image, dataset.splits[0].images[size_t(i)].path));
    ImageCache cache(dataset, 1);
    for (int again = 0; again < 2; ++again)
        for (size_t i = 0; i < 3; ++i) {
            const auto loaded = cache.load(dataset.splits[0], i);
            REQUIRE_MESSAGE(loaded, (loaded ? "" : loaded.error().message));
            if (i != 1) CHECK((*loaded)->rgba[3] == 0.0f);
            if (i != 1) CHECK((*loaded)->rgba[7] == 1.0f);
        }
    REQUIRE(cache.notes().size() == 1);
    CHECK(mentions(cache.notes()[0], "2 of the images"));
    CHECK(mentions(cache.notes()[0], "0.exr"));
    CHECK(mentions(cache.notes()[0], "Lanczos"));
    image.rgba[3] = 255.0f;
    REQUIRE(writeExr(image, dataset.splits[0].images[0].path));
    const auto far = cache.load(dataset.splits[0], 0);
    REQUIRE(!far);
    checkError(far.error(), ErrorCode::kBadInput, {"0.exr", "alpha 255", "0 to 255"});
}

TEST_CASE("what a PNG says of its colours holds where the description says nothing, and is noted where it is not applied")
{
    const auto big = [](std::initializer_list<uint32_t> values) {
        std::vector<uint8_t> out;
        for (uint32_t v : values)
            for (int shift = 24; shift >= 0; shift -= 8) out.push_back(uint8_t(v >> shift));
        return out;
    };
    const std::vector<uint8_t> p3 = {'D', 'i', 's', 'p', 'l', 'a', 'y', ' ', 'P', '3', 0, 0};
    const std::vector<uint8_t> srgb = {'s', 'R', 'G', 'B', ' ', 'I', 'E', 'C', 0, 0};
    struct Case {
        const char* what;
        std::vector<std::pair<std::string, std::vector<uint8_t>>> chunks;
        bool guess, isLinear;
        const char* note; // a word of it; empty: none
    };
    const Case cases[] = {{"nothing", {}, true, false, ""},
                          {"display", {{"gAMA", big({45455})}}, true, false, ""},
                          {"sRGB", {{"sRGB", {0}}, {"gAMA", big({100000})}}, true, false, ""},
                          {"linear", {{"gAMA", big({100000})}}, true, true, ""},
                          {"linear, the description says srgb", {{"gAMA", big({100000})}}, false, false, "linear"},
                          {"1.8", {{"gAMA", big({55556})}}, true, false, "0.556"},
                          {"profile", {{"iCCP", p3}}, true, false, "Display P3"},
                          {"profile of sRGB", {{"iCCP", srgb}}, true, false, ""},
                          {"primaries of sRGB", {{"cHRM", big({31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000})}}, true, false, ""},
                          {"primaries of P3", {{"cHRM", big({31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000})}}, true, false, "cHRM"}};
    for (const Case& c : cases) {
        INFO(c.what);
        TempFolder folder;
        PngBuilder png;
        png.rows = {0, 128, 128, 128, 255, 0, 0, 0, 255, 0, 0, 0, 0, 255, 0, 0, 0, 255};
        png.chunks = c.chunks;
        REQUIRE(writeFileAtomically(folder.file("a.png"), png.build()));
        OlatDataset dataset;
        dataset.colorSpace = ColorSpace::kSrgb;
        dataset.colorSpaceIsGuess = c.guess;
        dataset.splits.push_back({"train", {lookAtOrigin({2, 0, 1}, 2)}, {{0, Light(), folder.file("a.png")}}});
        ImageCache cache(dataset, 1 << 20);
        const auto image = cache.load(dataset.splits[0], 0);
        REQUIRE_MESSAGE(image, (image ? "" : image.error().message));
        const float stored = 128 / 255.0f;
        CHECK((*image)->rgba[0] == doctest::Approx(c.isLinear ? stored : linearFromSrgb(stored)));
        CHECK(cache.notes().size() == (*c.note ? 1 : 0));
        if (*c.note && !cache.notes().empty()) CHECK(mentions(cache.notes()[0], c.note));
    }
}
