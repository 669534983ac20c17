// Images that cannot be used are found, named and left out; all else stays as it was.
#include "train/image_screen.h"

#include "train/preparation.h"
#include "train/schedule.h"
#include "train/training_steps.h"

#include "train_photographs.h"

#include <filesystem>
#include <fstream>

using namespace nacre;
namespace fs = std::filesystem;

namespace {

constexpr int kSize = 16;

/// Twelve images of a grey rectangle on a ring of cameras, the light beside each camera.
struct Folder : PhotographFolder {
    explicit Folder(const char* name) : PhotographFolder(name, kSize, 12, 1) {}
    void write(uint32_t i, int size, uint8_t value) const { PhotographFolder::write(i, size, grey(value)); }
    Result<std::vector<UnusableImage>> look() const { return unusableImages(dataset, dataset.splits[0], {}, nullptr); }
};

} // namespace

TEST_CASE("a cut, an empty, a vanished, an odd-sized and a black image are left out by name, and only these")
{
    Folder f("nacre_test_images");
    const auto none = f.look();
    REQUIRE(bool(none));
    CHECK(none->empty());

    fs::resize_file(f.train().images[1].path, fs::file_size(f.train().images[1].path) / 2);
    fs::remove(f.train().images[4].path);
    f.write(7, kSize + 1, 120);
    f.write(9, kSize, 0);
    const auto found = f.look();
    REQUIRE(bool(found));
    REQUIRE(found->size() == 4);
    size_t k = 0;
    for (const size_t i : {1, 4, 7, 9}) {
        CHECK((*found)[k].path == f.train().images[i].path);
        CHECK((*found)[k++].why.find(f.train().images[i].path) != std::string::npos);
    }
    const OlatDataset rest = without(f.dataset, "train", *found);
    CHECK(rest.splits[0].images.size() == 8);
    CHECK(rest.splits[0].cameras.size() == 12);

    std::ofstream(f.train().images[2].path, std::ios::trunc).close(); // the fifth of twelve
    const auto refused = f.look();
    REQUIRE_FALSE(bool(refused));
    CHECK(refused.error().code == ErrorCode::kBadInput);
    CHECK(refused.error().message.find("5 of 12") != std::string::npos);
}

TEST_CASE("an image that is saturated nearly everywhere says nothing, and is left out")
{
    Folder f("nacre_test_white");
    f.write(3, kSize, 255);
    const auto found = f.look();
    REQUIRE(bool(found));
    REQUIRE(found->size() == 1);
    CHECK((*found)[0].why.find("white") != std::string::npos);
}

TEST_CASE("an image without its object is named as such, wherever its light is")
{
    Folder f("nacre_test_empty");
    f.train().images[3].light.position *= -1.0f; // seen from the dark side, black is right; without coverage it is not
    REQUIRE(bool(writePng(f.train().images[3].path, kSize, kSize, 4, std::vector<uint8_t>(4 * kSize * kSize))));
    const auto found = f.look();
    REQUIRE(bool(found));
    REQUIRE(found->size() == 1);
    CHECK((*found)[0].why.find("alpha is 0 everywhere") != std::string::npos);
}

TEST_CASE("black is no fault where the light is behind the object, or off")
{
    Folder f("nacre_test_black");
    f.write(0, kSize, 0), f.write(1, kSize, 0), f.write(2, kSize, 0);
    f.train().images[0].light.position *= -1.0f;
    f.train().images[1].light.intensity = glm::vec3(0);
    const auto found = f.look();
    REQUIRE(bool(found));
    REQUIRE(found->size() == 1);
    CHECK((*found)[0].path == f.train().images[2].path);
}

TEST_CASE("every model: an image that vanishes while training is left out of its steps; a disk that is gone ends it")
{
    for (const char* model : {"bigs", "sss"}) {
        CAPTURE(model);
        Folder f("nacre_test_vanished");
        TrainingImages images(f.dataset, f.train(), 1); // keeps nothing
        TrainerOptions options;
        options.sceneSize = 1;
        Trainer trainer(options, makeTrainableAppearance(model, {}));
        const OrientedPoint point{{0, 0, 0}, {0, 0, 1}};
        trainer.initialize(std::span(&point, 1), 0.5f, true);
        TrainingSteps steps(f.train(), images, StepOrder(groupByCamera(f.train()), 1), trainer, nullptr);
        fs::remove(f.train().images[3].path);
        int empty = 0;
        for (int step = 1; step <= 12; ++step) {
            const auto stats = steps.take({step, 0.1, 1.0});
            REQUIRE(bool(stats));
            CHECK(std::isfinite(stats->loss));
            empty += stats->count == 0;
        }
        CHECK(empty == 1); // one pass through the cameras
        REQUIRE(steps.lost().size() == 1);
        CHECK(steps.lost()[0].path == f.train().images[3].path);

        fs::remove_all(f.path);
        Status gone = ok();
        for (int step = 13; step <= 24 && gone; ++step)
            if (const auto stats = steps.take({step, 0.1, 1.0}); !stats) gone = stats.error();
        REQUIRE_FALSE(bool(gone));
        CHECK(gone.error().code == ErrorCode::kIo); // the same command can go on when it is back
    }
}

TEST_CASE("images that no step could hold in memory are refused with figures, usual ones are not")
{
    Camera camera;
    camera.width = camera.height = 8192;
    const Status refused = checkMemory(camera, size_t(16) << 30);
    REQUIRE_FALSE(bool(refused));
    CHECK(refused.error().code == ErrorCode::kUnsupported);
    CHECK(refused.error().message.find("16 GiB") != std::string::npos);
    CHECK(bool(checkMemory(camera, size_t(64) << 30)));
    camera.width = camera.height = 2048;
    CHECK(bool(checkMemory(camera, size_t(4) << 30)));
}

TEST_CASE("splats are no more than the images can resolve, unless their number is given")
{
    const auto mostSplats = [](int size, int given) {
        Folder f("nacre_test_resolution");
        for (Camera& c : f.train().cameras) c.width = c.height = size, c.fx = c.fy = 1.25 * size, c.cx = c.cy = 0.5 * size;
        std::vector<uint8_t> rgba(size_t(4 * size * size), 0);
        for (int y = size / 4; y < 3 * size / 4; ++y)
            for (int x = size / 4; x < 3 * size / 4; ++x) std::fill_n(&rgba[size_t(4 * (y * size + x))], 4, uint8_t(255));
        for (const OlatImage& image : f.train().images) REQUIRE(bool(writePng(image.path, size, size, 4, rgba)));
        BakeOptions options;
        options.maxSplats = given;
        const auto full = withDefaults(options, f.dataset);
        REQUIRE(bool(full));
        const auto prepared = prepare(f.dataset, *full, [](const char*) { return ok(); });
        REQUIRE_MESSAGE(prepared, (prepared ? "" : prepared.error().message));
        return double(prepared->trainer.maxSplats);
    };
    const double coarse = mostSplats(64, 0), fine = mostSplats(128, 0);
    CHECK(coarse > 1000);
    CHECK(fine / coarse == doctest::Approx(4).epsilon(0.1));
    CHECK(fine < 24000);
    CHECK(mostSplats(64, 24000) == 24000);
    CHECK(mostSplats(1024, 0) == 24000); // of the quality
}
