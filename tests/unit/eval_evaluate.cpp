#include "eval/components.h"
#include "eval/evaluate.h"

#include <doctest/doctest.h>

#include <limits>

using namespace nacre;

namespace {

/// Draws the reference plus an offset per call: 0, 0.1, 0.2, ...
class OffsetRenderer : public SplatRenderer {
public:
    OffsetRenderer(const OlatSplit& split, ImageCache& cache) : split_(split), cache_(cache) {}
    Result<Image> render(const Camera&, std::span<const Light>) override
    {
        Image image = **cache_.load(split_, calls % split_.images.size());
        for (float& v : image.rgba) v = edited ? 0.25f * v : v + (spoil ? std::numeric_limits<float>::quiet_NaN() : 0.1f * float(calls));
        ++calls;
        return image;
    }
    Result<RenderTimes> time(const Camera&, std::span<const Light>, int warmup, int frames) override
    {
        timedFrames += frames;
        warmupFrames += warmup;
        return RenderTimes{1, 2, 3, 6};
    }
    Status setEdits(std::span<const SplatEdit> edits) override { return edited = !edits.empty(), ok(); }
    std::string description() const override { return "offset"; }

    size_t calls = 0;
    int timedFrames = 0, warmupFrames = 0;
    bool spoil = false, edited = false;

private:
    const OlatSplit& split_;
    ImageCache& cache_;
};

struct Fixture {
    OlatDataset dataset = *loadDataset(NACRE_SOURCE_DIR "/samples/data/bunny_wax_tiny");
    const OlatSplit& split = *dataset.find("test");
    ImageCache cache{dataset, size_t(1) << 24};
    OffsetRenderer renderer{split, cache};
};

} // namespace

TEST_CASE("evaluation takes means of per-image figures and times only the first image")
{
    Fixture f;
    std::vector<double> psnr;
    const auto result = evaluate(f.split, f.cache, f.renderer, {50}, [&](const EvalImage& image) {
        CHECK(image.index == psnr.size());
        CHECK(image.count == 8);
        CHECK(&image.source == &f.split.images[image.index]);
        psnr.push_back(image.metrics.psnr);
        return ok();
    });
    REQUIRE(result);
    REQUIRE(psnr.size() == 8);
    CHECK(psnr[0] == kMaxPsnr); // the renderer's first image is the reference
    for (size_t i = 1; i < 8; ++i) CHECK(psnr[i] < psnr[i - 1]);
    double sum = 0;
    for (double p : psnr) sum += p;
    CHECK(result->mean.psnr == doctest::Approx(sum / 8));
    CHECK(result->psnrMin == psnr[7]);
    CHECK(f.renderer.timedFrames == 50);
    CHECK(f.renderer.warmupFrames == kEvalWarmupFrames);
    CHECK(result->times.frameMs == 6);
}

TEST_CASE("an error of the callback ends the evaluation with that error")
{
    Fixture f;
    const auto result = evaluate(f.split, f.cache, f.renderer, {0}, [&](const EvalImage& image) -> Status {
        if (image.index == 2) return Error{ErrorCode::kIo, "disk full"};
        return ok();
    });
    REQUIRE_FALSE(result);
    CHECK(result.error().message == "disk full");
    CHECK(f.renderer.calls == 3);
}

TEST_CASE("NaN pixels of a renderer are an error, not a NaN mean")
{
    Fixture f;
    f.renderer.spoil = true;
    const auto result = evaluate(f.split, f.cache, f.renderer, {0}, [](const EvalImage&) { return ok(); });
    REQUIRE_FALSE(result);
    CHECK(result.error().code == ErrorCode::kGpu);
    CHECK(result.error().message.find("NaN") != std::string::npos);
}

TEST_CASE("images that cannot be read are named, and the figures are of the rest; more than a third are too many")
{
    Fixture f;
    const auto whole = evaluate(f.split, f.cache, f.renderer, {1}, [](const EvalImage&) { return ok(); });
    REQUIRE(whole);
    CHECK(whole->skipped.empty());

    OlatSplit broken = f.split;
    broken.images[0].path = "nosuch.exr", broken.images[5].path = NACRE_SOURCE_DIR "/README.md";
    f.renderer.calls = 1; // draws the second image first
    const auto rest = evaluate(broken, f.cache, f.renderer, {1}, [](const EvalImage&) { return ok(); });
    REQUIRE(rest);
    REQUIRE(rest->skipped.size() == 2);
    CHECK(rest->skipped[0].path == "nosuch.exr");
    CHECK(rest->skipped[0].why.find("nosuch.exr") != std::string::npos);
    CHECK(rest->indices == std::vector<size_t>{1, 2, 3, 4, 6, 7});
    double sum = 0;
    for (const ImageMetrics& m : rest->images) sum += m.psnr;
    CHECK(rest->mean.psnr == doctest::Approx(sum / 6));
    CHECK(rest->times.frameMs == 6); // of the first image that there is

    broken.images[7].path = "nosuch.exr";
    const auto refused = evaluate(broken, f.cache, f.renderer, {0}, [](const EvalImage&) { return ok(); });
    REQUIRE_FALSE(refused);
    CHECK(refused.error().code == ErrorCode::kBadInput);
}

TEST_CASE("the share of scattered light takes the renders of the evaluation, and draws only the rest of it once more")
{
    Fixture f;
    const auto result = evaluate(f.split, f.cache, f.renderer, {0}, [](const EvalImage&) { return ok(); });
    REQUIRE(result);
    CHECK(f.renderer.calls == 8);
    double references = 0, renders = 0;
    for (size_t i = 0; i < 8; ++i) references += totalLuminance(**f.cache.load(f.split, i)), renders += result->luminance[i];
    const auto share = scatteredShare(f.split, *result, f.renderer);
    REQUIRE(share);
    REQUIRE(share->has_value());
    CHECK(**share == doctest::Approx(1 - 0.25 * references / renders));
    CHECK(f.renderer.calls == 16);
    CHECK_FALSE(f.renderer.edited);
}

TEST_CASE("an empty split cannot be evaluated")
{
    Fixture f;
    OlatSplit empty;
    empty.name = "near";
    const auto result = evaluate(empty, f.cache, f.renderer, {0}, [](const EvalImage&) { return ok(); });
    REQUIRE_FALSE(result);
    CHECK(result.error().code == ErrorCode::kBadInput);
}
