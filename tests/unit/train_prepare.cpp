// nacre prepare as a library: the packed dataset is the dataset, without what cannot be used.
#include "train/dataset_packer.h"

#include "base/color.h"
#include "base/file.h"
#include "interchange/exr.h"
#include "train/checkpoint.h"
#include "train/display_code.h"
#include "train/held_out.h"
#include "train/packed_reference.h"
#include "train/training_images.h"

#include "train_photographs.h"

#include <bit>
#include <filesystem>
#include <fstream>

using namespace nacre;
namespace fs = std::filesystem;

namespace {

constexpr int kSize = 20;

/// Four cameras, three lights each; a test image as EXR under an environment.
struct Photographs : PhotographFolder {
    explicit Photographs(const char* name) : PhotographFolder(name, kSize, 4, 3)
    {
        for (uint32_t i = 0; i < 12; ++i) write(i, kSize, {uint8_t(80 + 8 * i), uint8_t(40 + 5 * i), uint8_t(10 * i)});
        OlatSplit& test = dataset.splits.emplace_back();
        test.name = "test", test.cameras = {dataset.splits[0].cameras[0]};
        Light sky;
        sky.type = LightType::kEnvironment, sky.environmentPath = file("sky.exr");
        test.images.push_back({0, sky, file("test.exr")});
        Image bright{kSize, kSize, std::vector<float>(kSize * kSize * 4, 0.25f)};
        for (int c = 0; c < 3; ++c) bright.pixel(3, 4)[c] = 7.5f;
        REQUIRE(bool(writeExr(bright, file("test.exr"))));
        REQUIRE(bool(writeExr(Image{4, 2, std::vector<float>(32, 1.0f)}, file("sky.exr"))));
    }
    Result<PackerReport> pack(PackerOptions options = {}, const std::atomic<bool>* cancel = nullptr, const std::function<void(size_t, size_t, double)>& progress = {}) const
    {
        options.output = file("packed");
        return packDataset(dataset, options, progress, cancel);
    }
};

std::string textOf(const fs::path& path)
{
    const auto bytes = readFile(path.string());
    REQUIRE(bool(bytes));
    return {reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

} // namespace

TEST_CASE("a packed dataset gives the images of the files, and needs them no more")
{
    Photographs p("nacre_test_prepare");
    std::vector<std::vector<float>> before;
    ImageCache files(p.dataset, 0);
    for (const OlatSplit& split : p.dataset.splits)
        for (size_t i = 0; i < split.images.size(); ++i) before.push_back((*files.load(split, i))->rgba);
    const auto report = p.pack();
    REQUIRE(bool(report));
    CHECK(report->images == 13);
    CHECK(report->halves == 1);
    CHECK(report->skipped.empty());
    for (const fs::directory_entry& e : fs::directory_iterator(p.path))
        if (!e.is_directory()) fs::remove(e.path());

    const auto packed = loadDataset(p.file("packed"));
    REQUIRE(bool(packed));
    REQUIRE(packed->splits.size() == 2);
    ImageCache images(*packed, 0);
    size_t k = 0;
    for (const OlatSplit& split : packed->splits)
        for (size_t i = 0; i < split.images.size(); ++i) CHECK((*images.load(split, i))->rgba == before[k++]);
    CHECK(readExr(packed->splits[1].images[0].light.environmentPath));
    CHECK(packed->splits[0].images[5].light.position == p.dataset.splits[0].images[5].light.position);
    CHECK(packed->splits[0].cameras[2].cx == p.dataset.splits[0].cameras[2].cx);

    const auto again = p.pack();
    REQUIRE(!again);
    CHECK(again.error().code == ErrorCode::kBadInput);
    CHECK(again.error().message.find("is there already") != std::string::npos);
}

TEST_CASE("a bake of files can be resumed from what was packed of them, and not after the files are developed otherwise")
{
    Photographs p("nacre_test_prepare_identity");
    OlatSplit& train = p.train();
    for (const Camera& c : train.cameras) train.files.push_back({c.width, c.height, c.fx, c.fy, c.cx, c.cy, {0.02}});
    train.images[5].gain = {0.5f, 0.6f, 0.7f};
    train.images[2].maskPath = train.images[2].path;
    p.dataset.blackLevel = 0.01f;
    p.write(8, kSize + 1, p.grey(100)); // one that is left out
    REQUIRE(bool(p.pack()));
    const auto packed = loadDataset(p.file("packed"));
    REQUIRE(bool(packed));
    const OlatDataset files = without(p.dataset, "train", {{train.images[8].path, ""}});
    const auto identity = [](const OlatDataset& dataset) { return bakeIdentity(dataset, dataset.splits[0], {}); };
    CHECK(identity(*packed) == identity(files));
    const OlatDataset heldOutOfPack = holdOut(*packed, 4), heldOut = holdOut(files, 4);
    CHECK(identity(heldOutOfPack) == identity(heldOut));
    CHECK(identity(heldOut) != identity(files));
    const OlatSplit &learnt = *heldOut.find("train"), &judges = *heldOut.find("test");
    CHECK(learnt.images.size() + judges.images.size() == files.splits[0].images.size());
    CHECK(judges.images.size() == 3); // of one camera of four, which does not train
    for (const OlatImage& image : judges.images) CHECK(image.camera == 3);
    for (const OlatImage& image : learnt.images) CHECK(image.camera != 3);
    std::vector<OlatDataset> others(5, files);
    others[0].blackLevel = 0.02f;
    others[1].splits[0].images[0].gain.g = 2;
    others[2].splits[0].images[2].maskPath.clear();
    others[3].splits[0].files[1].k[0] = 0.03;
    others[4].splits[0].images[1].light.intensity.r = 11;
    for (const OlatDataset& other : others) CHECK(identity(other) != identity(files));
}

TEST_CASE("what the loss reads of packed pixels is what it would read of the files, to the last bit")
{
    Image image{37, 29, std::vector<float>(37 * 29 * 4)};
    for (int y = 8; y < 20; ++y)
        for (int x = 5; x < 30; ++x) {
            float* p = image.pixel(x, y);
            for (int c = 0; c < 3; ++c) p[c] = float((7 * x + 13 * y + 5 * c) % 101) / 95.0f - 0.01f; // some below 0 and above 1
            p[3] = float((x * y) % 17) / 16.0f;
            if ((x + y) % 19 == 0) p[0] = p[1] = p[2] = 0, p[3] = kUnknownAlpha;
        }
    for (const bool halves : {false, true}) {
        PackedBlock block;
        const auto bytes = encodePixels(image, halves, block);
        const PreparedImage a = preparePacked(block, bytes), b = prepareImage(decodePixels(block, bytes));
        CHECK(a.planes == b.planes);
        CHECK(a.linear == b.linear);
        CHECK(a.known == b.known);
        CHECK(a.unknown == b.unknown);
        CHECK(a.unknown > 0);
    }
}

TEST_CASE("gamma codes from tables are those of the formula")
{
    const DisplayCodes& codes = DisplayCodes::table();
    CHECK(codes(-0.0f) == 0);
    for (uint32_t bits = 0; bits <= std::bit_cast<uint32_t>(1.0f); bits += 9973) {
        const float x = std::bit_cast<float>(bits);
        REQUIRE(codes(x) == uint16_t(std::lround(65535.0f * srgbFromLinear(x))));
    }
}

TEST_CASE("images that are loaded ahead are the same, within the budget, and an error comes when its image is got")
{
    Photographs p("nacre_test_prepare_ahead");
    const OlatSplit& train = p.dataset.splits[0];
    fs::remove(train.images[7].path);
    TrainingImages alone(p.dataset, train, 1 << 20);
    const size_t one = (*alone.get(0))->bytes();
    TrainingImages ahead(p.dataset, train, 4 * one);
    const std::vector<uint32_t> order = {3, 7, 1, 0, 11, 5, 3, 2, 7, 8, 4, 0, 10};
    for (size_t k = 0; k < order.size(); ++k) {
        ahead.expect(std::span(order).subspan(k + 1));
        const auto image = ahead.get(order[k]), reference = alone.get(order[k]);
        REQUIRE(bool(image) == bool(reference));
        CHECK(bool(image) == (order[k] != 7));
        if (image) CHECK((*image)->planes == (*reference)->planes);
        CHECK(ahead.residentBytes() <= 4 * one);
    }
}

TEST_CASE("broken, black and odd-sized files are left out of the pack by name; --strict refuses them")
{
    Photographs p("nacre_test_prepare_broken");
    const auto& images = p.dataset.splits[0].images;
    fs::resize_file(images[1].path, fs::file_size(images[1].path) / 2);
    p.write(4, kSize, p.grey(0));
    p.write(6, kSize + 1, p.grey(100));
    PackerOptions strict;
    strict.strict = true;
    const auto refused = p.pack(strict);
    REQUIRE(!refused);
    CHECK(refused.error().code == ErrorCode::kBadInput);
    CHECK(refused.error().message.find("3 images") != std::string::npos);
    CHECK(!fs::exists(p.file("packed")));
    CHECK(!loadDataset(p.file("packed.part")));

    const auto report = p.pack(); // goes on with what the refused run has read
    REQUIRE(bool(report));
    CHECK(report->reused == 13);
    REQUIRE(report->skipped.size() == 3);
    size_t k = 0;
    for (const size_t i : {1, 4, 6}) {
        CHECK(report->skipped[k].path == images[i].path);
        CHECK(textOf(p.path / "packed" / "skipped.txt").find(report->skipped[k++].why) != std::string::npos);
    }
    const auto packed = loadDataset(p.file("packed"));
    REQUIRE(bool(packed));
    CHECK(packed->splits[0].images.size() == 9);
    CHECK(packed->packed->skipped.size() == 3);
}

TEST_CASE("an interrupted run is completed; files that have changed since and pixels that were damaged are read again")
{
    Photographs p("nacre_test_prepare_resume");
    const auto whole = p.pack();
    REQUIRE(bool(whole));
    const std::string pixels = textOf(p.path / "packed" / "pixels.bin");
    fs::remove_all(p.file("packed"));

    std::atomic<bool> stop{false};
    PackerOptions small;
    small.memoryBytes = 1; // one image at a time
    const auto stopped = p.pack(small, &stop, [&](size_t done, size_t, double) { stop = done >= 6; });
    REQUIRE(!stopped);
    CHECK(stopped.error().code == ErrorCode::kCancelled);
    CHECK(!fs::exists(p.file("packed")));
    { // a record that was cut off while it was written, as a crash would leave it
        std::ofstream journal(p.path / "packed.part" / "journal.bin", std::ios::binary | std::ios::app);
        journal << "\x40\0\0\0";
    }
    {
        std::fstream file(p.path / "packed.part" / "pixels.bin", std::ios::binary | std::ios::in | std::ios::out);
        file.seekp(0);
        file << "damage";
    }
    const auto completed = p.pack(small);
    REQUIRE(bool(completed));
    CHECK(completed->reused >= 4);
    CHECK(completed->reused < 13);
    const auto packed = loadDataset(p.file("packed"));
    REQUIRE(bool(packed));
    ImageCache images(*packed, 0), files(p.dataset, 0);
    for (size_t i = 0; i < 12; ++i) CHECK((*images.load(packed->splits[0], i))->rgba == (*files.load(p.dataset.splits[0], i))->rgba);
    fs::remove_all(p.file("packed"));

    stop = false;
    REQUIRE(!p.pack(small, &stop, [&](size_t done, size_t, double) { stop = done >= 6; }));
    p.write(2, kSize, p.grey(33)); // mended in the meantime
    const auto mended = p.pack(small);
    REQUIRE(bool(mended));
    const auto then = loadDataset(p.file("packed"));
    REQUIRE(bool(then));
    ImageCache now(*then, 0);
    CHECK((*now.load(then->splits[0], 2))->rgba == (*files.load(p.dataset.splits[0], 2))->rgba);
}

TEST_CASE("a disk that does not suffice for halves gets bytes, one that does not suffice for bytes is refused with the need")
{
    Photographs p("nacre_test_prepare_disk");
    PackerOptions options;
    options.diskBytes = 13 * 4 * kSize * kSize * 2 / 3; // of whole frames: less than the test image as halves and all the squares
    for (OlatImage& image : p.dataset.splits[0].images) image.path = p.file("test.exr");
    const auto report = p.pack(options);
    REQUIRE(!report);
    CHECK(report.error().code == ErrorCode::kBadInput);
    CHECK(report.error().message.find("needs about") != std::string::npos);
    CHECK(!fs::exists(p.file("packed.part")));
    options.diskBytes = 13 * 4 * kSize * kSize * 3 / 2;
    const auto bytes = p.pack(options);
    REQUIRE(bool(bytes));
    CHECK(bytes->halves == 0);
    CHECK(bytes->notes.size() == 1);
    fs::remove_all(p.file("packed"));
    options.pixels = PackerOptions::Pixels::kHalves;
    CHECK(!p.pack(options));
}
