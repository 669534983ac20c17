// The driver with an analytic renderer: what ends up in the folder does not depend on how the work was divided, stopped or resumed.
#include "dataset_support.h"

#include "base/hash.h"
#include "dataset/dataset_writer.h"
#include "light_stage/stage_plan.h"
#include "light_stage/synth.h"

#include <atomic>
#include <map>

using namespace nacre;
namespace fs = std::filesystem;

namespace {

/// renderSphere per light, with "noise" that depends on what a path tracer's noise depends on.
struct FakeTracer {
    std::atomic<int> calls{0}, images{0};
    size_t mostLights = 0;
    int stopAfter = -1;
    std::atomic<bool> stop{false};

    StageRender function()
    {
        return [this](const Camera& camera, std::span<const Light> lights, const RenderSettings& settings, RenderStats* stats) -> Result<std::vector<Image>> {
            if (stop) return Error{ErrorCode::kCancelled, "stopped"};
            std::vector<Image> out;
            for (const Light& light : lights) {
                REQUIRE(light.type != LightType::kGroup);
                const bool point = light.type == LightType::kPoint;
                const double brightness = point ? double(light.intensity.x) : 25.0 * double(light.intensity.x);
                out.push_back(renderSphere(camera, point ? glm::dvec3(light.position) : 5.0 * glm::dvec3(light.directionToLight), brightness));
                const uint64_t noise = fnv1a(&camera.worldFromCamera, sizeof camera.worldFromCamera, settings.seed + uint64_t(settings.samplesPerPixel));
                out.back().rgba[0] = 0.01f * float(noise % 97);
            }
            calls++, images += int(lights.size());
            mostLights = std::max(mostLights, lights.size());
            if (stopAfter >= 0 && calls >= stopAfter) stop = true;
            settings.progress(1.0);
            stats->noise.assign(lights.size(), 0.25f);
            stats->samplesPerPixel = settings.samplesPerPixel;
            stats->seconds = 0.5;
            stats->pathRays = 100;
            return out;
        };
    }
};

const SynthSettings kSettings{{"mesh", "thing 1234"}, {"--spp", "64"}, {"--sss", ""}};

StageOptions smallStage(const std::string& folder)
{
    StageOptions options;
    options.cameras = 5, options.lights = 6, options.lightsPerCamera = 3;
    options.width = 20, options.height = 16;
    options.environments = {(fs::path(folder) / "sky.exr").string()};
    return options;
}

SynthJob makeJob(const std::string& folder, const std::string& convention, std::vector<std::string> splits = stageSplits())
{
    SynthJob job;
    auto plan = planStage(smallStage(folder), splits);
    plan.path = folder;
    auto fitted = fitToConvention(plan, convention);
    if (!fitted) FAIL(fitted.error().message);
    job.plan = *fitted;
    for (const OlatSplit& split : job.plan.splits) {
        RenderSettings settings;
        settings.samplesPerPixel = split.name == "train" ? 16 : 64;
        job.splits.push_back({settings, R"({"object": "thing"})"});
    }
    return job;
}

Result<SynthReport> synth(const SynthJob& job, FakeTracer& tracer)
{
    if (Status s = claimDatasetFolder(job.plan.path, kSettings); !s) return s.error();
    if (job.plan.convention == "canonical") REQUIRE(writeExr(Image{2, 1, std::vector<float>(8, 1.0f)}, (fs::path(job.plan.path) / "sky.exr").string()));
    return synthesise(job, tracer.function(), {}, &tracer.stop);
}

SynthReport mustSynth(const SynthJob& job)
{
    FakeTracer tracer;
    const auto report = synth(job, tracer);
    if (!report) FAIL(report.error().message);
    return *report;
}

/// Relative path -> bytes.
std::map<std::string, std::string> filesOf(const std::string& folder)
{
    std::map<std::string, std::string> out;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
        if (!entry.is_regular_file()) continue;
        std::ifstream file(entry.path(), std::ios::binary);
        out[entry.path().lexically_relative(folder).string()] = std::string(std::istreambuf_iterator<char>(file), {});
    }
    return out;
}

bool hasDescription(const std::string& folder)
{
    for (const auto& [name, bytes] : filesOf(folder))
        if (mentions(name, "transforms_")) return true;
    return false;
}

} // namespace

TEST_CASE("a synthesised dataset loads with the planned cameras and lights, and nothing in it looks misread")
{
    for (const char* convention : writableConventions()) {
        INFO(convention);
        TempFolder temp;
        const std::string folder = temp.file("out");
        const SynthJob job = makeJob(folder, convention);
        const SynthReport report = mustSynth(job);
        const auto dataset = loadDataset(folder);
        if (!dataset) FAIL(dataset.error().message);
        CHECK(dataset->convention == convention);
        CHECK(dataset->up == job.plan.up);
        REQUIRE(report.splits.size() == job.plan.splits.size());
        for (size_t s = 0; s < job.plan.splits.size(); ++s) {
            const OlatSplit& planned = job.plan.splits[s];
            CHECK(report.splits[s].written == planned.images.size());
            CHECK(report.splits[s].missing == 0);
            CHECK(report.splits[s].noise == doctest::Approx(0.25));
            CHECK(report.splits[s].cameras == planned.cameras.size());
            CHECK(report.splits[s].samplesPerPixel == (planned.name == "train" ? 16 : 64));
            const OlatSplit* loaded = dataset->find(planned.name);
            if (!loaded) continue; // bigs: olat_all_on
            CHECK(loaded->images.size() == planned.images.size());
            CHECK(loaded->cameras.size() == planned.cameras.size());
        }
        ImageCache cache(*dataset, 1 << 22);
        const auto suspicions = checkConventions(*dataset, cache);
        REQUIRE(suspicions);
        if (job.plan.find("test")->images.size() < 10) continue; // rene: three images may be darker than others by chance
        for (const std::string& line : *suspicions) CHECK_MESSAGE(false, line);
    }
}

TEST_CASE("all images of a camera are rendered in one call; an all_on image is the sum over its lights")
{
    TempFolder temp;
    const SynthJob job = makeJob(temp.file("out"), "canonical");
    FakeTracer tracer;
    REQUIRE(synth(job, tracer));
    const OlatSplit& allOn = *job.plan.find("all_on");
    CHECK(tracer.calls == 5 + 24 + 6 + 6 + 6 + 5);
    CHECK(tracer.images == 15 + 24 + 6 + 6 + 6 + 5 * 6);
    const auto dataset = loadDataset(temp.file("out"));
    REQUIRE(dataset);
    ImageCache cache(*dataset, 1 << 22);
    const auto image = cache.load(*dataset->find("all_on"), 2);
    REQUIRE(image);
    Image sum;
    for (const Light& light : *allOn.images[2].light.group) {
        const Image one = renderSphere(allOn.cameras[2], glm::dvec3(light.position), double(light.intensity.x));
        if (sum.rgba.empty()) sum = one;
        else
            for (size_t i = 0; i < sum.rgba.size(); ++i)
                if (i % 4 != 3) sum.rgba[i] += one.rgba[i];
    }
    for (size_t i = 4; i < sum.rgba.size(); ++i) CHECK((*image)->rgba[i] == doctest::Approx(sum.rgba[i]).epsilon(1e-3)); // half floats; pixel 0 has the noise
}

TEST_CASE("shards in any order, or stopped and resumed, give the folder that one run gives, byte by byte")
{
    for (const char* convention : writableConventions()) {
        INFO(convention);
        TempFolder temp;
        const std::vector<std::string> splits{"train", "near", "all_on"}; // few images: each is synced to the disk
        mustSynth(makeJob(temp.file("whole"), convention, splits));
        const auto whole = filesOf(temp.file("whole"));

        for (const int shard : {2, 3, 1}) {
            SynthJob job = makeJob(temp.file("shards"), convention, splits);
            job.shard = shard, job.shards = 3;
            const SynthReport report = mustSynth(job);
            size_t missing = 0;
            for (const SynthReport::Split& s : report.splits) missing += s.missing;
            CHECK((missing == 0) == (shard == 1)); // the last to run
        }
        CHECK(filesOf(temp.file("shards")) == whole);

        FakeTracer interrupted;
        interrupted.stopAfter = 3;
        const auto stopped = synth(makeJob(temp.file("resumed"), convention, splits), interrupted);
        REQUIRE_FALSE(stopped);
        CHECK(stopped.error().code == ErrorCode::kCancelled);
        CHECK_FALSE(hasDescription(temp.file("resumed")));
        FakeTracer rest;
        const auto resumed = synth(makeJob(temp.file("resumed"), convention, splits), rest);
        REQUIRE(resumed);
        CHECK(filesOf(temp.file("resumed")) == whole);
        FakeTracer all;
        REQUIRE(synth(makeJob(temp.file("again"), convention, splits), all));
        CHECK(interrupted.calls + rest.calls == all.calls); // nothing twice

        FakeTracer idle;
        REQUIRE(synth(makeJob(temp.file("whole"), convention, splits), idle));
        CHECK(idle.calls == 0);
        CHECK(filesOf(temp.file("whole")) == whole);
    }
}

TEST_CASE("images that are missing, damaged or of another size are rendered again, and only their cameras")
{
    TempFolder temp;
    const std::string folder = temp.file("out");
    mustSynth(makeJob(folder, "canonical"));
    const auto whole = filesOf(folder);
    fs::remove(temp.file("out/train/r_0001.exr"));
    fs::resize_file(temp.file("out/train/r_0007.exr"), 300);
    REQUIRE(writeExr(Image{3, 3, std::vector<float>(36)}, temp.file("out/test/r_0005.exr")));
    FakeTracer tracer;
    const auto report = synth(makeJob(folder, "canonical"), tracer);
    REQUIRE(report);
    CHECK(tracer.calls == 3);
    CHECK(filesOf(folder) == whole);
}

TEST_CASE("splits can be added to a dataset later")
{
    TempFolder temp;
    mustSynth(makeJob(temp.file("whole"), "canonical"));
    mustSynth(makeJob(temp.file("parts"), "canonical", {"test"}));
    CHECK(fs::exists(temp.file("parts/transforms_test.json")));
    CHECK_FALSE(fs::exists(temp.file("parts/transforms_train.json")));
    mustSynth(makeJob(temp.file("parts"), "canonical", {"train", "all_on"}));
    mustSynth(makeJob(temp.file("parts"), "canonical", {"near", "directional", "environment"}));
    CHECK(filesOf(temp.file("parts")) == filesOf(temp.file("whole")));
}

TEST_CASE("other settings in a folder that was begun are refused, naming the option; so is a folder of something else")
{
    TempFolder temp;
    const std::string folder = temp.file("out");
    REQUIRE(checkDatasetFolder(folder, kSettings));
    CHECK_FALSE(fs::exists(folder)); // checking makes nothing
    REQUIRE(claimDatasetFolder(folder, kSettings));
    REQUIRE(claimDatasetFolder(folder, kSettings));
    SynthSettings other = kSettings;
    other[1].second = "32";
    for (const auto& check : {checkDatasetFolder, claimDatasetFolder})
        checkError(check(folder, other).error(), ErrorCode::kBadInput, {"out", "--spp 64", "--spp 32", "another folder"});
    other = kSettings;
    other[2].second = "Wax:\xff\n";
    checkError(checkDatasetFolder(folder, other).error(), ErrorCode::kBadInput, {"without --sss", "--sss Wax"});
    REQUIRE(claimDatasetFolder(temp.file("odd"), other));
    REQUIRE(checkDatasetFolder(temp.file("odd"), other)); // also where the text is not UTF-8
    other = kSettings;
    other.push_back({"--later-option", "x"});
    checkError(checkDatasetFolder(folder, other).error(), ErrorCode::kBadInput, {"without --later-option"});

    temp.writeText("photos/cat.txt", "cat");
    checkError(claimDatasetFolder(temp.file("photos"), kSettings).error(), ErrorCode::kBadInput, {"photos", "cat.txt", "new or empty"});
    checkError(claimDatasetFolder(temp.file("photos/cat.txt"), kSettings).error(), ErrorCode::kBadInput, {"is a file"});
    fs::create_directory(temp.file("empty"));
    CHECK(claimDatasetFolder(temp.file("empty"), kSettings));
    temp.writeText("broken/synth.json", "{\"settings\": ");
    checkError(claimDatasetFolder(temp.file("broken"), kSettings).error(), ErrorCode::kBadInput, {"synth.json"});
    temp.writeText("numbers/synth.json", "{\"settings\": {\"mesh\": 5}}");
    checkError(claimDatasetFolder(temp.file("numbers"), kSettings).error(), ErrorCode::kBadInput, {"synth.json", "mesh"});
}

TEST_CASE("many lights on a large image are rendered in chunks of bounded size, with the same sum")
{
    TempFolder temp;
    SynthJob job;
    StageOptions options = smallStage(temp.file("out"));
    options.cameras = 1, options.lights = 9, options.lightsPerCamera = 0;
    options.width = options.height = 1536; // 81 MiB of film per light: 6 fit
    job.plan = planStage(options, {"all_on"});
    job.plan.path = temp.file("out");
    job.plan = *fitToConvention(job.plan, "canonical");
    job.splits.push_back({RenderSettings{}, "{}"});
    size_t most = 0, calls = 0;
    const StageRender render = [&](const Camera& camera, std::span<const Light> lights, const RenderSettings&, RenderStats* stats) -> Result<std::vector<Image>> {
        most = std::max(most, lights.size());
        calls++;
        stats->noise.assign(lights.size(), 0.1f);
        const size_t n = size_t(camera.width) * size_t(camera.height) * 4;
        std::vector<Image> images;
        for (size_t l = 0; l < lights.size(); ++l) images.push_back({camera.width, camera.height, std::vector<float>(n, 1.0f)});
        return images;
    };
    REQUIRE(claimDatasetFolder(temp.file("out"), kSettings));
    const auto report = synthesise(job, render, {}, nullptr);
    REQUIRE(report);
    CHECK(calls == 2);
    CHECK(most * 1536 * 1536 * kFilmBytesPerPixel <= kChunkBytes);
    CHECK(report->splits[0].written == 1);
    const auto image = readExr(temp.file("out/all_on/r_0000.exr"));
    REQUIRE(image);
    CHECK(image->rgba[0] == 9.0f);
    CHECK(image->rgba[3] == 1.0f);
}

TEST_CASE("a failing renderer and a folder that cannot be written are errors; progress counts up to all images")
{
    TempFolder temp;
    SynthJob job = makeJob(temp.file("out"), "canonical", {"test"});
    const StageRender failing = [](const Camera&, std::span<const Light>, const RenderSettings&, RenderStats*) -> Result<std::vector<Image>> {
        return Error{ErrorCode::kBadInput, "no map"};
    };
    REQUIRE(claimDatasetFolder(temp.file("out"), kSettings));
    CHECK(synthesise(job, failing, {}, nullptr).error().message == "no map");
    temp.writeText("out/test", "a file where a folder should be");
    FakeTracer tracer;
    const auto blocked = synthesise(job, tracer.function(), {}, nullptr);
    REQUIRE_FALSE(blocked);
    CHECK(blocked.error().code == ErrorCode::kIo);
    fs::remove(temp.file("out/test"));
    size_t last = 0;
    const auto report = synthesise(job, tracer.function(), [&](const SynthProgress& p) {
        CHECK(p.imageCount == 24);
        CHECK(p.imagesDone >= last);
        CHECK(p.split == "test");
        last = p.imagesDone;
    }, nullptr);
    REQUIRE(report);
    CHECK(last == 24);
}

TEST_CASE("the same run on one thread and on four gives the same bytes")
{
    TempFolder temp;
    for (const int threads : {1, 4}) {
        SynthJob job = makeJob(temp.file("out" + std::to_string(threads)), "plpos", {"train"});
        for (SynthJob::Split& split : job.splits) split.render.threads = threads;
        mustSynth(job);
    }
    CHECK(filesOf(temp.file("out1")) == filesOf(temp.file("out4")));
}
