// Data that is hard to train on or carries nothing to learn: the bake ends in a valid asset all the same and says what is wrong.
#include "dataset_support.h"

#include "appearance/model_table.h"
#include "base/fibonacci_sphere.h"
#include "eval/splat_renderer.h"
#include "pack/neutral_look.h"
#include "train/bake.h"
#include "train/trainer.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <functional>

using namespace nacre;

namespace {

constexpr int kSize = 32;
constexpr float kRadius = 0.7f; // of renderSphere

/// A train split of renderSphere, every camera under every light, as files in a folder of its own.
struct SphereData {
    std::vector<glm::dvec3> eyes, lights;
    double intensity = 12;
    std::function<void(Image&)> edit = [](Image&) {};
    std::function<void(Camera&, size_t)> turn = [](Camera&, size_t) {}; // after the image is made
    TempFolder folder;
    OlatDataset dataset;

    SphereData()
    {
        for (int k = 0; k < 8; ++k) eyes.push_back(3.2 * fibonacciDirection(k, 8));
        for (int k = 0; k < 4; ++k) lights.push_back(glm::dvec3(3.0) * fibonacciDirection(k, 4));
    }
    void write()
    {
        dataset.path = folder.path.string(), dataset.convention = "canonical";
        OlatSplit split{"train", {}, {}};
        for (const glm::dvec3& eye : eyes) {
            for (const glm::dvec3& position : lights) {
                Image image = renderSphere(lookAtOrigin(eye, kSize), position, intensity);
                edit(image);
                OlatImage entry{uint32_t(split.cameras.size()), {}, folder.file("r_" + std::to_string(split.images.size()) + ".exr")};
                entry.light.position = position, entry.light.intensity = glm::vec3(float(intensity));
                REQUIRE(writeExr(image, entry.path));
                split.images.push_back(entry);
            }
            split.cameras.push_back(lookAtOrigin(eye, kSize));
            turn(split.cameras.back(), split.cameras.size() - 1);
        }
        dataset.splits = {split};
    }
};

Result<BakeResult> bakeBriefly(const OlatDataset& dataset, int maxSplats = 120, int iterations = 150)
{
    BakeOptions options;
    options.iterations = iterations, options.maxSplats = maxSplats, options.sFunctions = 4;
    return bake(dataset, options, {}, nullptr);
}

/// The asset as `nacre bake` would write it.
void checkUsable(BakeResult& result, const OlatDataset& dataset)
{
    CHECK(std::isfinite(result.psnrTrain));
    std::vector<Light> lights;
    for (const OlatImage& image : dataset.splits[0].images) lights.push_back(image.light);
    auto neutral = fitNeutralLook(result.asset, lights);
    REQUIRE(neutral);
    result.asset.neutral = std::move(*neutral);
    const Status valid = validate(result.asset); // at least one splat, every value finite and in bounds
    INFO((valid ? "" : valid.error().message));
    CHECK(valid);
}

/// Writes and bakes; the one warning must hold these words.
void checkWarns(SphereData& data, std::initializer_list<const char*> words)
{
    data.write();
    auto result = bakeBriefly(data.dataset);
    REQUIRE_MESSAGE(result, result.error().message);
    checkUsable(*result, data.dataset);
    std::string all;
    for (const std::string& line : result->warnings) all += line + "\n";
    INFO(all);
    REQUIRE(result->warnings.size() == 1);
    for (const char* word : words) {
        INFO(word);
        CHECK(mentions(result->warnings[0], word));
    }
    CHECK(!mentions(result->warnings[0], "\n"));
}

} // namespace

TEST_CASE("sound data gives no warning and trains with any number of splats")
{
    SphereData data;
    data.write();
    for (int splats : {1, 2, 17, 120}) { // 1, 2: the initial share rounds to one; 17: one more than the widest SIMD register
        auto result = bakeBriefly(data.dataset, splats);
        REQUIRE_MESSAGE(result, result.error().message);
        checkUsable(*result, data.dataset);
        CHECK(result->asset.cloud.count <= size_t(splats));
        CHECK(result->warnings.empty());
        if (splats == 120) CHECK(result->psnrTrain > 18);
    }
}

TEST_CASE("one viewpoint: depth is not determined")
{
    SphereData data;
    data.eyes.resize(1);
    SUBCASE("one camera") {}
    SUBCASE("one that turns on the spot")
    {
        data.eyes.resize(3, data.eyes[0]);
        data.turn = [](Camera& camera, size_t k) { camera.worldFromCamera = glm::rotate(camera.worldFromCamera, 0.1 * double(k), glm::dvec3(0, 1, 0)); };
    }
    checkWarns(data, {"one place", "depth", "add cameras"});
}

TEST_CASE("one light: relighting cannot be learnt")
{
    SphereData data;
    data.lights.resize(1);
    checkWarns(data, {"same light", "relighting cannot be learnt", "other directions"});
}

TEST_CASE("black images: nothing to learn")
{
    SphereData data;
    data.edit = [](Image& image) {
        for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] *= i % 4 == 3 ? 1.0f : 1e-6f;
    };
    checkWarns(data, {"24 of 32", "black", "exposure"});
}

TEST_CASE("every model: a dark object stays opaque, although fading would darken it too")
{
    SphereData data;
    data.edit = [](Image& image) {
        for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] *= i % 4 == 3 ? 1.0f : 0.04f;
    };
    data.write();
    for (const AppearanceModel& model : appearanceModels()) {
        CAPTURE(model.name);
        BakeOptions options;
        options.model = model.name, options.iterations = 300, options.maxSplats = 200, options.sFunctions = 0;
        auto result = bake(data.dataset, options, {}, nullptr);
        REQUIRE_MESSAGE(result, result.error().message);
        checkUsable(*result, data.dataset);
        const auto renderer = makeReferenceRenderer(result->asset);
        REQUIRE(renderer);
        double covered = 0, object = 0;
        for (const OlatImage& image : data.dataset.splits[0].images) {
            const auto reference = readExr(image.path);
            const auto render = (*renderer)->render(data.dataset.splits[0].cameras[image.camera], std::span(&image.light, 1));
            REQUIRE(reference);
            REQUIRE(render);
            for (size_t i = 3; i < reference->rgba.size(); i += 4)
                if (reference->rgba[i] > 0.99f) covered += render->rgba[i], object += 1;
        }
        INFO("mean alpha " << covered / object);
        CHECK(covered > 0.8 * object); // from the usual start: 0.31 (bigs), 0.73 (sss)
    }
}

TEST_CASE("alpha zero everywhere: no silhouettes, with and without colours")
{
    SphereData data;
    float colour = 1;
    SUBCASE("colours") {}
    SUBCASE("black") { colour = 0; }
    data.edit = [=](Image& image) {
        for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] *= i % 4 == 3 ? 0.0f : colour;
    };
    checkWarns(data, {"alpha", "nowhere above 0.5", "no silhouettes", "check the alpha channel"});
}

TEST_CASE("highlights of 1e4 in a few pixels: how much is clipped, and what to try")
{
    SphereData data;
    data.edit = [](Image& image) {
        for (int x = 15; x < 17; ++x)
            for (int c = 0; c < 3; ++c) image.pixel(x, 16)[c] = 1e4f;
    };
    checkWarns(data, {" % of the object's pixels", "above 1", "brightest is 1e+04", "times the median", "check exposure"});
}

TEST_CASE("an overexposed capture is told from a bright highlight")
{
    SphereData data;
    SUBCASE("half of the object is white")
    {
        data.intensity = 120;
        checkWarns(data, {"above 1", "check exposure"});
    }
    SUBCASE("a twentieth of it is, and looks white in training")
    {
        data.edit = [](Image& image) {
            for (int y = 0; y < image.height; y += 4)
                for (int x = 0; x < image.width; x += 4)
                    if (image.pixel(x, y)[3] > 0.5f) image.pixel(x, y)[1] = 1.5f;
        };
        checkWarns(data, {" % of the object's pixels", "above 1", "check exposure"});
    }
    SUBCASE("a highlight of 20 is what highlights are")
    {
        data.edit = [](Image& image) { image.pixel(16, 16)[0] = 20.0f; };
        data.write();
        auto result = bakeBriefly(data.dataset);
        REQUIRE_MESSAGE(result, result.error().message);
        CHECK(result->warnings.empty());
    }
}

TEST_CASE("a light at the object's surface is a warning, one deep inside an error")
{
    SphereData data;
    data.eyes.clear();
    for (int k = 0; k < 20; ++k) data.eyes.push_back(3.2 * fibonacciDirection(k, 20)); // enough to enclose it: no way out of the hull
    data.intensity = 0.05;
    SUBCASE("just outside") { data.lights[1] = (kRadius + 0.02) * glm::normalize(data.lights[1]); }
    SUBCASE("on it") { data.lights[1] = double(kRadius) * glm::normalize(data.lights[1]); }
    SUBCASE("inside")
    {
        data.lights[1] *= 0.1;
        data.write();
        auto result = bakeBriefly(data.dataset);
        REQUIRE_FALSE(result);
        checkError(result.error(), ErrorCode::kBadInput, {"r_1.exr", "inside the object", "units and axes"});
        return;
    }
    data.edit = [](Image& image) { // no second warning about the bright spot
        for (float& v : image.rgba) v = std::min(v, 1.0f);
    };
    checkWarns(data, {"20 of 80", "at the object's surface", "r_1.exr", "move such lights away"});
}

static void oneLargeSplat(const std::string& model)
{
    SphereData data;
    data.write();
    const OlatSplit& split = data.dataset.splits[0];
    std::vector<OrientedPoint> points;
    for (int k = 0; k < 50; ++k) {
        const glm::vec3 n(fibonacciDirection(k, 50)), p = kRadius * n;
        points.push_back({{p.x, p.y, p.z}, {n.x, n.y, n.z}});
    }
    TrainerOptions options;
    options.maxSplats = 64;
    Trainer trainer(options, makeTrainableAppearance(model, {4}));
    trainer.initialize(points, 0.2f, true);

    // The trainer has no setter for one splat: it goes in through the state that checkpoints hold, which begins with the raw geometry.
    ByteWriter out;
    trainer.save(out);
    std::byte* row = out.bytes.data() + sizeof(uint64_t) + 20 * sizeof(GeometryRow);
    GeometryRow large;
    std::memcpy(&large, row, sizeof large);
    REQUIRE(large[3] == doctest::Approx(std::log(0.6f * 0.2f)));
    for (int k = 3; k < 6; ++k) large[k] += std::log(100.0f);
    std::memcpy(row, &large, sizeof large);
    ByteReader in(out.bytes);
    REQUIRE(trainer.load(in));

    ImageCache files(data.dataset, 0);
    for (int step = 1; step <= 60; ++step) {
        const size_t first = size_t(step) % 8 * 4; // the four lights of one camera
        PreparedImage images[4];
        const PreparedImage* references[4];
        Light lights[4];
        for (size_t i = 0; i < 4; ++i) {
            auto image = files.load(split, first + i);
            REQUIRE(image);
            images[i] = prepareImage(**image), references[i] = &images[i], lights[i] = split.images[first + i].light;
        }
        CHECK(std::isfinite(trainer.step(split.cameras[first / 4], lights, references, {step, step / 60.0}).loss));
        if (step == 30) trainer.densify(8);
    }
    SplatAsset asset;
    asset.model = model;
    trainer.exportTo(asset);
    CHECK(validate(asset));
}

TEST_CASE("one splat 100 times larger than the rest leaves everything finite, bigs") { oneLargeSplat("bigs"); }
TEST_CASE("one splat 100 times larger than the rest leaves everything finite, sss") { oneLargeSplat("sss"); }
