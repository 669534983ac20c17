// A bake gives the same asset for any unit of length, any origin and any unit of light.
#include "dataset_support.h"

#include "asset/asset_io.h"
#include "eval/evaluate.h"
#include "train/bake.h"
#include "train/learning_light.h"

using namespace nacre;

namespace {

constexpr int kSize = 24;

/// A sphere lit from above, seen from around, stated in some unit, from some origin.
OlatDataset sphereDataset(const TempFolder& folder, double scale, const glm::dvec3& offset, double intensity)
{
    OlatDataset dataset;
    dataset.splits = {{"train", {}, {}}, {"test", {}, {}}};
    for (int i = 0; i < 15; ++i) {
        OlatSplit& split = dataset.splits[i % 5 == 4];
        const double a = 2.4 * i, b = 1.3 * i;
        Camera camera = lookAtOrigin({2.4 * std::cos(a), 2.4 * std::sin(a), 0.4 + 0.1 * (i % 7)}, kSize);
        const glm::dvec3 at(3 * std::cos(b), 3 * std::sin(b), 2.5);
        const std::string path = folder.file(std::to_string(i) + ".exr");
        REQUIRE(writeExr(renderSphere(camera, at, 25), path));
        camera.worldFromCamera[3] = glm::dvec4(scale * camera.position() + offset, 1);
        Light light;
        light.position = scale * at + offset;
        light.positionRest = scale * at + offset - glm::dvec3(light.position);
        light.intensity = glm::vec3(float(25 * scale * scale * intensity));
        split.images.push_back({uint32_t(split.cameras.size()), light, path});
        split.cameras.push_back(camera);
    }
    return dataset;
}

struct Baked {
    double psnr;
    SplatAsset asset;
};

Baked baked(const std::string& model, double scale, const glm::dvec3& offset, double intensity)
{
    TempFolder folder;
    const OlatDataset dataset = sphereDataset(folder, scale, offset, intensity);
    BakeOptions options;
    options.model = model;
    options.quality = "draft";
    options.iterations = 60;
    options.maxSplats = 200;
    auto result = bake(dataset, options, nullptr, nullptr);
    if (!result) FAIL(result.error().message);
    const auto bytes = encodeAsset(result->asset); // as the command line would: the frame goes through the file
    REQUIRE(bytes);
    const auto asset = decodeAsset(*bytes);
    REQUIRE(asset);
    const auto renderer = makeReferenceRenderer(*asset);
    REQUIRE(renderer);
    ImageCache references(dataset, 1 << 20);
    const auto figures = evaluate(*dataset.find("test"), references, **renderer, {0}, [](const EvalImage&) { return ok(); });
    if (!figures) FAIL(figures.error().message);
    return {figures->mean.psnrMasked, *asset};
}

} // namespace

TEST_CASE("every model: world scale, origin and unit of light do not change what a bake reaches")
{
    for (const char* model : {"bigs", "sss"}) {
        CAPTURE(model);
        const Baked base = baked(model, 1, glm::dvec3(0.0), 1);
        CHECK(base.psnr > 10); // it has learnt something
        CHECK(base.asset.frame == AssetFrame{});
        struct Variant {
            double scale;
            glm::dvec3 offset;
            double intensity;
        };
        for (const Variant& v : {Variant{1000, {0, 0, 0}, 1}, {0.001, {0, 0, 0}, 1}, {1, {500, 500, 500}, 1}, {30, {1e5, -3e4, 20}, 1}}) {
            CAPTURE(v.scale);
            CAPTURE(v.offset.x);
            const Baked found = baked(model, v.scale, v.offset, v.intensity);
            CHECK(std::abs(found.psnr - base.psnr) < 0.05); // rounding of positions, and what the steps make of it
        }
        // what sss learns depends a little on the light it is brought to
        const Baked dim = baked(model, 1, glm::dvec3(0.0), 1e-4), bright = baked(model, 1, glm::dvec3(0.0), 1e4);
        CHECK(std::abs(dim.psnr - bright.psnr) < 0.05);
        CHECK(dim.asset.frame.lightGain / bright.asset.frame.lightGain == doctest::Approx(1e8));
    }
    const double base = baked("bigs", 1, glm::dvec3(0.0), 1).psnr;
    for (const double intensity : {1e-6, 0.3, 4.0, 1e3}) CHECK(std::abs(baked("bigs", 1, glm::dvec3(0.0), intensity).psnr - base) < 0.1);
}

TEST_CASE("bigs for brighter or darker lights is the same radiance to float32")
{
    SplatAsset asset;
    asset.model = "bigs";
    asset.channels = {{"tDir", 2, {1, 2}}, {"tInd", 2, {3, 4}}, {"rho", 3, {1, 2, 3}}, {"lobe", 7, {0, 0, 1, 5, 1, 2, 3}}};
    absorbGain(asset, 4, {2, {1, 2, 3}, 1});
    CHECK(asset.frame == AssetFrame{2, {1, 2, 3}, 1});
    CHECK(asset.find("tDir")->values == std::vector<float>{1, 2}); // how light arrives, not how much is sent back
    CHECK(asset.find("tInd")->values == std::vector<float>{12, 16});
    CHECK(asset.find("rho")->values == std::vector<float>{4, 8, 12});
    CHECK(asset.find("lobe")->values == std::vector<float>{0, 0, 1, 5, 4, 8, 12});
    asset.model = "sss";
    asset.channels[2].values = {0.1f, 0.2f, 0.3f};
    asset.frame.lightGain = 4;
    absorbGain(asset, 4, {});
    CHECK(asset.frame.lightGain == 4); // its base colours end at 1
    CHECK(asset.channels[2].values == std::vector<float>{0.1f, 0.2f, 0.3f});
}
