// Simulated captures: what a lens, a sensor and a hand do to pictures, and that the truth beside them is the truth.
#include "dataset_support.h"

#include "base/hash.h"
#include "dataset/dataset_writer.h"
#include "dataset/develop.h"
#include "interchange/image_file.h"
#include "light_stage/capture_camera.h"
#include "light_stage/capture_plan.h"
#include "light_stage/surroundings.h"
#include "light_stage/synth.h"
#include "stage_scenes.h"

#include <numbers>

using namespace nacre;
namespace fs = std::filesystem;

namespace {

constexpr double kDegree = std::numbers::pi / 180;

Image flat(int size, float value, float alpha = 1)
{
    Image image{size, size, {}};
    for (int i = 0; i < size * size; ++i) image.rgba.insert(image.rgba.end(), {value, value, value, alpha});
    return image;
}

Camera pinhole(int size, double focal) { return lookAt({0, -3, 1}, {0, 0, 0}, size, size, focal); }

StageOptions smallStage()
{
    StageOptions options;
    options.cameras = 12, options.lights = 8, options.lightsPerCamera = 3;
    options.width = 24, options.height = 20;
    options.seed = 5;
    return options;
}

/// Its train and test splits, fitted.
OlatDataset planOf(const CaptureOptions& capture)
{
    OlatDataset plan = planStage(smallStage(), {"train", "test"});
    if (capture.kind == CaptureKind::kPhone) plan.splits[0] = planPhone(smallStage(), capture);
    auto fitted = fitToConvention(std::move(plan), "canonical");
    if (!fitted) FAIL(fitted.error().message);
    return *fitted;
}

struct Planned {
    OlatDataset before, stated;
    Capture capture;
    const OlatSplit& was() const { return before.splits[0]; }
    const OlatSplit& said() const { return stated.splits[0]; }
};

Planned plan(const CaptureOptions& options)
{
    Planned p{planOf(options), planOf(options), {}};
    p.capture = planCapture(options, p.stated, glm::dvec3(0.0), 1.0, 5);
    return p;
}

CaptureOptions without(CaptureKind kind)
{
    CaptureOptions o;
    o.kind = kind;
    return o;
}

double angleBetween(const glm::vec3& a, const glm::vec3& b) { return std::acos(std::clamp(glm::dot(glm::normalize(glm::dvec3(a)), glm::normalize(glm::dvec3(b))), -1.0, 1.0)); }

double turnBetween(const glm::dmat4& a, const glm::dmat4& b)
{
    const glm::dmat3 r = glm::transpose(glm::dmat3(a)) * glm::dmat3(b);
    return std::acos(std::clamp((r[0][0] + r[1][1] + r[2][2] - 1) / 2, -1.0, 1.0));
}

/// renderSphere under points, as bright everywhere under the sky as that is.
Result<std::vector<Image>> renderFake(const Camera& camera, std::span<const Light> lights, const RenderSettings& settings, RenderStats* stats)
{
    std::vector<Image> out;
    for (const Light& light : lights) {
        out.push_back(renderSphere(camera, glm::dvec3(light.position), light.type == LightType::kPoint ? double(light.intensity.x) : 0.0));
        if (light.type == LightType::kEnvironment)
            for (size_t i = 0; i < out.back().rgba.size(); ++i)
                if (i % 4 != 3) out.back().rgba[i] = light.intensity.x;
    }
    settings.progress(1.0);
    stats->noise.assign(lights.size(), 0.0f);
    return out;
}

SynthJob jobOf(const Planned& planned, const std::string& folder, int threads)
{
    SynthJob job;
    job.plan = planned.stated;
    job.plan.path = folder;
    for (size_t s = 0; s < job.plan.splits.size(); ++s) {
        RenderSettings settings;
        settings.threads = threads;
        job.splits.push_back({settings, "{}", s == 0 ? std::make_shared<const Capture>(planned.capture) : nullptr, {}});
    }
    return job;
}

void synth(const SynthJob& job)
{
    REQUIRE(claimDatasetFolder(job.plan.path, {{"mesh", "thing"}}));
    const auto report = synthesise(job, renderFake, {}, nullptr);
    if (!report) FAIL(report.error().message);
}

std::map<std::string, uint64_t> hashesOf(const std::string& folder)
{
    std::map<std::string, uint64_t> out;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
        if (!entry.is_regular_file()) continue;
        const auto bytes = readFile(entry.path().string());
        REQUIRE(bytes);
        out[entry.path().lexically_relative(folder).string()] = fnv1a(bytes->data(), bytes->size());
    }
    return out;
}

} // namespace

TEST_CASE("noise of a sensor: its mean is the signal, its variance that of counted electrons and of reading them")
{
    for (const float value : {0.0f, 0.1f, 0.8f}) {
        constexpr double kElectrons = 1000, kRead = 5;
        Image image = flat(128, value);
        addNoise(image, {kElectrons, kRead}, 7);
        double sum = 0, squares = 0, product = 0;
        const double count = 3.0 * 128 * 128;
        for (size_t i = 0; i < image.rgba.size(); i += 4) {
            for (size_t c = 0; c < 3; ++c) sum += double(image.rgba[i + c]) - double(value), squares += std::pow(double(image.rgba[i + c]) - double(value), 2);
            product += (double(image.rgba[i]) - double(value)) * (double(image.rgba[i + 1]) - double(value));
            CHECK(image.rgba[i + 3] == 1.0f);
        }
        const double variance = (double(value) * kElectrons + kRead * kRead) / (kElectrons * kElectrons);
        CHECK(std::fabs(sum / count) < 4 * std::sqrt(variance / count));
        CHECK(squares / count == doctest::Approx(variance).epsilon(0.03));
        CHECK(std::fabs(product / (count / 3)) < 0.04 * variance); // channels are independent
        Image other = flat(128, value);
        addNoise(other, {kElectrons, kRead}, 8);
        CHECK(other.rgba != image.rgba);
    }
    Image quiet = flat(4, 0.3f);
    addNoise(quiet, {0, 5}, 1);
    CHECK(quiet.rgba == flat(4, 0.3f).rgba);
}

TEST_CASE("eight bits and back: every byte comes back as itself, and values are clipped, not wrapped")
{
    Image image{256, 1, {}};
    for (int i = 0; i < 256; ++i) {
        const float v = linearFromSrgb(float(i) / 255);
        image.rgba.insert(image.rgba.end(), {v, v, v, 1});
    }
    const std::vector<uint8_t> bytes = displayRgb(image);
    for (size_t i = 0; i < 256; ++i) CHECK(int(bytes[3 * i]) == int(i));
    Image outside{2, 1, {-0.5f, 1.5f, 0.0f, 1.0f, 1.0f, 100.0f, -0.0f, 1.0f}};
    CHECK(displayRgb(outside) == std::vector<uint8_t>{0, 255, 0, 255, 255, 0});
}

TEST_CASE("what the lens of a capture bends, the dataset's undistortion straightens to a twentieth of a pixel")
{
    const Camera camera = pinhole(96, 110);
    const FileCamera lens = plausibleLens(camera, 1);
    Camera plane;
    plane.fx = plane.fy = 1;
    double farthest = 0;
    for (int y = 0; y <= 96; y += 8)
        for (int x = 0; x <= 96; x += 8) {
            const glm::dvec2 at = lookedAt(lens, x, y), back = positionInFile(lens, plane, at.x, -at.y);
            CHECK(glm::distance(back, glm::dvec2(x, y)) < 1e-6);
            farthest = std::max(farthest, glm::distance(glm::dvec2(x, y), glm::dvec2(camera.cx + at.x * camera.fx, camera.cy - at.y * camera.fy)));
        }
    CHECK(farthest > 1.5); // pixels: a lens that is worth correcting

    FileCamera wide = plausibleLens(pinhole(96, 18), 1.5); // 140 degrees
    for (int x = 0; x < 96; ++x) CHECK(lookedAt(wide, x + 1, 40).x > lookedAt(wide, x, 40).x);

    // A picture of a smooth pattern through the path tracer's rays, straightened, against the pattern.
    const auto pattern = [&](const glm::dvec2& at) { return 0.5 + 0.2 * std::sin(22 * at.x) + 0.2 * std::cos(19 * at.y); };
    const double steepest = 0.2 * (22 + 19) / camera.fx; // change in a pixel, at most
    Image taken{96, 96, {}};
    for (int y = 0; y < 96; ++y)
        for (int x = 0; x < 96; ++x) {
            const float v = float(pattern(lookedAt(lens, x + 0.5, y + 0.5)));
            taken.rgba.insert(taken.rgba.end(), {v, v, v, 1});
        }
    const Image straight = resampled(taken, lens, camera);
    int known = 0;
    for (int y = 0; y < 96; ++y)
        for (int x = 0; x < 96; ++x) {
            if (straight.pixel(x, y)[3] < 0) continue;
            ++known;
            const double expected = pattern({(x + 0.5 - camera.cx) / camera.fx, (camera.cy - y - 0.5) / camera.fy});
            CHECK(std::fabs(double(straight.pixel(x, y)[0]) - expected) < 0.05 * steepest);
        }
    CHECK(known > 96 * 96 * 9 / 10);
}

TEST_CASE("the path tracer looks through the lens: a ball straightened lies where the pinhole camera has it")
{
    const StageScene scene = test::sceneOf({test::sphere(3, 0.25f, {0.45f, 0.0f, 0.4f})}, {test::lambert(glm::vec3(0.5f))});
    Camera camera = pinhole(64, 70);
    StageScene copy = scene;
    const auto tracer = PathTracer::create(std::move(copy));
    REQUIRE(tracer);
    RenderSettings settings;
    settings.samplesPerPixel = 64;
    const std::vector<Light> lights{test::pointLight({0, -3, 1}, 10)};
    const auto centroid = [](const Image& image) {
        glm::dvec3 sum(0.0);
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x)
                if (const double a = image.pixel(x, y)[3]; a > 0) sum += a * glm::dvec3(x, y, 1);
        return glm::dvec2(sum) / sum.z;
    };
    const auto expected = tracer->render(camera, lights, settings);
    settings.optics.lens = plausibleLens(camera, 1);
    const auto taken = tracer->render(camera, lights, settings);
    REQUIRE(expected);
    REQUIRE(taken);
    CHECK(glm::distance(centroid((*taken)[0]), centroid((*expected)[0])) > 0.5);
    CHECK(glm::distance(centroid(resampled((*taken)[0], *settings.optics.lens, camera)), centroid((*expected)[0])) < 0.05);
}

TEST_CASE("the beam of a flash falls as a power of the cosine from the camera's axis, and a sky without a map is the same everywhere")
{
    // A plane seen from above.
    const StageScene scene = test::sceneOf({test::plane(4)}, {test::lambert(glm::vec3(0.5f))});
    StageScene copy = scene;
    const auto tracer = PathTracer::create(std::move(copy));
    REQUIRE(tracer);
    const Camera camera = test::cameraAt({0, 0, 2}, {0, 0, 0}, 17, 1.4);
    RenderSettings settings;
    settings.samplesPerPixel = 256;
    settings.indirectRoughness = 0;
    Light sky;
    sky.type = LightType::kEnvironment;
    sky.intensity = glm::vec3(0.7f);
    const std::vector<Light> lights{test::pointLight({0, 0, 2}, 10), sky};
    const auto even = tracer->render(camera, lights, settings);
    settings.optics.beam = 3;
    const auto beam = tracer->render(camera, lights, settings);
    REQUIRE(even);
    REQUIRE(beam);
    for (const int x : {0, 4, 8, 14}) {
        const glm::dvec3 ray = pixelRay(camera, x + 0.5, 8.5);
        CHECK((*beam)[0].pixel(x, 8)[0] / (*even)[0].pixel(x, 8)[0] == doctest::Approx(std::pow(-ray.z, 3.0)).epsilon(0.02));
        CHECK((*beam)[1].pixel(x, 8)[0] == doctest::Approx(0.35).epsilon(0.03));
    }
}

TEST_CASE("a stage's errors have the stated sizes, the same for all images of a light, and the truth is what was planned")
{
    CaptureOptions options = usualCapture(CaptureKind::kStage);
    const Planned p = plan(options);
    std::map<float, std::pair<double, double>> lights; // by a coordinate of the true place: angle, gain
    glm::dvec3 common(0.0);                            // turn of all lights
    for (size_t i = 0; i < p.said().images.size(); ++i) {
        const Light &was = p.was().images[i].light, &said = p.said().images[i].light, &truth = p.capture.truth.images[i].light;
        CHECK(truth.position == was.position);
        CHECK(truth.intensity == was.intensity);
        CHECK(glm::length(said.position) == doctest::Approx(glm::length(was.position)));
        CHECK(said.intensity.x * float(p.capture.lightGain[i]) == doctest::Approx(was.intensity.x));
        const std::pair<double, double> error{angleBetween(said.position, was.position), p.capture.lightGain[i]};
        const auto [at, isNew] = lights.try_emplace(was.position.x + 3 * was.position.y, error);
        CHECK(at->second.first == doctest::Approx(error.first));
        if (isNew) common += glm::cross(glm::normalize(glm::dvec3(was.position)), glm::normalize(glm::dvec3(said.position))) / 8.0;
        CHECK(at->second.second == error.second);
    }
    REQUIRE(lights.size() == 8);
    double angles = 0, gains = 0, mean = 0;
    for (const auto& [place, error] : lights) angles += error.first * error.first / 8, gains += std::pow(std::log(error.second), 2) / 8, mean += std::log(error.second) / 8;
    CHECK(std::sqrt(angles) == doctest::Approx(1 * kDegree).epsilon(0.01));
    CHECK(std::sqrt(gains) == doctest::Approx(0.03).epsilon(1e-6));
    CHECK(glm::length(common) < 0.01 * kDegree);
    CHECK(std::fabs(mean) < 1e-12); // else nobody could tell the gain from a darker object
    for (size_t c = 0; c < p.said().cameras.size(); ++c) CHECK(p.said().cameras[c].worldFromCamera == p.was().cameras[c].worldFromCamera);
    CHECK(std::count(p.capture.blankMatte.begin(), p.capture.blankMatte.end(), true) == 1); // 2 % of 12, rounded up
    CHECK(p.stated.rig == LightRig::kFixed);

    // One error's size leaves the draws of the others alone.
    options.gain = 0, options.turn = 10;
    const Planned turned = plan(options);
    CHECK(turned.stated.rig == LightRig::kStage);
    for (size_t i = 0; i < p.said().images.size(); ++i) {
        const glm::vec3 a = p.said().images[i].light.position, b = turned.said().images[i].light.position;
        CHECK(b.z == doctest::Approx(a.z));
        CHECK(std::remainder(std::atan2(b.y, b.x) - std::atan2(a.y, a.x), 2 * std::numbers::pi) == doctest::Approx(10 * kDegree).epsilon(1e-4));
    }
}

TEST_CASE("a phone's flash is fixed to the camera, at an offset of the stated size, and stated at the camera whose pose is off by the stated angle")
{
    const Planned p = plan(usualCapture(CaptureKind::kPhone));
    CHECK(p.stated.rig == LightRig::kCamera);
    CHECK(p.stated.backgroundInView);
    CHECK(glm::length(p.capture.flashOffset) == doctest::Approx(0.5)); // 5 cm, where the object's diameter of 2 is 20 cm
    CHECK(glm::length(p.capture.flashOffset) * p.capture.metresPerUnit == doctest::Approx(0.05));
    double turns = 0, exposures = 0, mean = 0;
    const double count = double(p.said().images.size());
    REQUIRE(count == 12);
    for (size_t i = 0; i < p.said().images.size(); ++i) {
        const OlatImage& image = p.said().images[i];
        const Camera &truth = p.capture.truth.cameras[image.camera], &said = p.said().cameras[image.camera];
        const std::vector<Light>& lamps = *p.capture.truth.images[i].light.group;
        REQUIRE(lamps.size() == 2);
        CHECK(glm::distance(lamps[0].position, glm::vec3(truth.worldFromCamera * glm::dvec4(p.capture.flashOffset, 1.0))) < 1e-5f);
        CHECK(lamps[0].intensity == image.light.intensity);
        CHECK(lamps[1].type == LightType::kEnvironment);
        CHECK(glm::distance(glm::dvec3(image.light.position), said.position()) < 1e-6);
        CHECK(truth.position().z > 0.5); // above any table
        turns += std::pow(turnBetween(truth.worldFromCamera, said.worldFromCamera), 2) / count;
        exposures += std::pow(p.capture.exposureEv[i], 2) / count, mean += p.capture.exposureEv[i] / count;
    }
    CHECK(std::sqrt(turns) == doctest::Approx(0.3 * kDegree).epsilon(1e-3));
    CHECK(std::sqrt(exposures) == doctest::Approx(0.15).epsilon(1e-6));
    CHECK(std::fabs(mean) < 1e-9);
    for (size_t s = 1; s < p.stated.splits.size(); ++s)
        for (size_t i = 0; i < p.stated.splits[s].images.size(); ++i) CHECK(p.stated.splits[s].images[i].light.position == p.before.splits[s].images[i].light.position);
}

TEST_CASE("mattes: too wide by the spill, holes inside, and the coverage itself where there is no error")
{
    Image disc{64, 64, {}};
    for (int y = 0; y < 64; ++y)
        for (int x = 0; x < 64; ++x) disc.rgba.insert(disc.rgba.end(), {0, 0, 0, std::hypot(x - 31.5, y - 31.5) < 20 ? 1.0f : 0.0f});
    const auto area = [](const std::vector<uint8_t>& matte) {
        double sum = 0;
        for (const uint8_t m : matte) sum += m / 255.0;
        return sum;
    };
    const double exact = area(imperfectMatte(disc, 0, 0, 1)), wide = area(imperfectMatte(disc, 3, 0, 1)), holed = area(imperfectMatte(disc, 0, 4, 1));
    CHECK(std::sqrt(exact / std::numbers::pi) == doctest::Approx(20).epsilon(0.01));
    CHECK(std::sqrt(wide / std::numbers::pi) == doctest::Approx(23).epsilon(0.02));
    CHECK(holed < exact);
    CHECK(imperfectMatte(disc, 2, 3, 1) != imperfectMatte(disc, 2, 3, 2));
    CHECK(area(imperfectMatte(flat(8, 0, 0), 2, 3, 1)) == 0); // nothing to see, nothing to cut
}

TEST_CASE("the photographs are those of the truth: developed with true lens, exposure and lights they are the render")
{
    TempFolder temp;
    CaptureOptions options = without(CaptureKind::kStage);
    options.gain = 20, options.lightError = 5, options.exposure = 0.5;
    const Planned p = plan(options);
    const SynthJob job = jobOf(p, temp.file("out"), 1);
    synth(job);
    const json frames = json::parse(truthText(p.capture, p.said()))["frames"];
    REQUIRE(frames.size() == p.said().images.size());
    for (size_t i = 0; i < frames.size(); ++i) {
        const OlatImage& image = p.said().images[i];
        CHECK(frames[i]["file_path"] == image.path);
        const auto position = frames[i]["light"]["position"].get<std::vector<double>>();
        const double intensity = frames[i]["light"]["intensity"][0], ev = frames[i]["exposure_ev"];
        const Image expected = renderSphere(p.said().cameras[image.camera], {position[0], position[1], position[2]}, intensity);
        const auto file = readImageFile((fs::path(temp.file("out")) / image.path).string());
        REQUIRE(file);
        for (size_t v = 0; v < expected.rgba.size(); ++v) {
            if (v % 4 == 3) continue;
            const float shown = srgbFromLinear(std::clamp(float(std::exp2(ev)) * expected.rgba[v], 0.0f, 1.0f));
            CHECK(std::fabs(file->rgba[v] - shown) < 0.51f / 255);
        }
    }
}

TEST_CASE("a capture loads as what its description says, and nothing but its training photographs differs from the clean set")
{
    TempFolder temp;
    for (const CaptureKind kind : {CaptureKind::kStage, CaptureKind::kPhone}) {
        const bool phone = kind == CaptureKind::kPhone;
        INFO(phone);
        CaptureOptions options = usualCapture(kind);
        options.lightsOff = phone;
        const Planned p = plan(options);
        const std::string name = phone ? "phone" : "stage";
        synth(jobOf(p, temp.file(name), 1));
        synth(jobOf(p, temp.file(name + "3"), 3));
        const auto one = hashesOf(temp.file(name));
        CHECK(one == hashesOf(temp.file(name + "3")));

        SynthJob clean = jobOf(p, temp.file(name + "_clean"), 1);
        clean.plan = p.before;
        clean.plan.path = temp.file(name + "_clean");
        clean.splits[0].capture = nullptr;
        synth(clean);
        for (const auto& [file, hash] : hashesOf(clean.plan.path))
            if (file.starts_with("test/")) CHECK(one.at(file) == hash);

        const auto loaded = loadDataset(temp.file(name));
        if (!loaded) FAIL(loaded.error().message);
        CHECK(loaded->rig == p.stated.rig);
        CHECK(loaded->backgroundInView == phone);
        CHECK(loaded->whiteLevel == doctest::Approx(p.stated.whiteLevel));
        const OlatSplit& train = *loaded->find("train");
        REQUIRE(train.images.size() == p.said().images.size());
        REQUIRE(train.files.size() == train.cameras.size());
        for (size_t i = 0; i < train.images.size(); ++i) {
            const OlatImage &image = train.images[i], &said = p.said().images[i];
            CHECK(image.maskPath.empty() == phone);
            CHECK(image.ambientPath.empty() == !phone);
            CHECK(fs::path(image.path).extension() == (phone ? ".jpg" : ".png"));
            CHECK(glm::distance(image.light.position, said.light.position) < 1e-5f);
            const FileCamera &file = train.files[image.camera], &lens = *p.capture.optics.lens;
            CHECK(file.k[0] == doctest::Approx(lens.k[0]));
            CHECK(file.p[1] == doctest::Approx(lens.p[1]));
            CHECK(file.cx == doctest::Approx(lens.cx));
        }
        ImageCache cache(*loaded, 1 << 22);
        CHECK(cache.load(train, 0));
        const OlatSplit& test = *loaded->find("test");
        const auto image = cache.load(test, 0);
        REQUIRE(image);
        CHECK((*image)->pixel(0, 0)[3] == 0.0f);
    }
}

TEST_CASE("a phone sees a table and a room wherever it looks, and the table carries the object without touching it")
{
    StageScene scene = test::sceneOf({test::sphere(2, 0.6f, {0.1f, 0, -0.2f})}, {test::lambert(glm::vec3(0.5f))});
    addSurroundings(scene);
    float highest = -10;
    for (const TriangleMesh& mesh : scene.mesh.meshes)
        if (mesh.name == "table")
            for (const glm::vec3& v : mesh.positions) highest = std::max(highest, v.z);
    CHECK(highest < -0.8f);
    CHECK(highest > -0.81f);
    const auto tracer = PathTracer::create(std::move(scene));
    REQUIRE(tracer);
    const Planned p = plan(usualCapture(CaptureKind::kPhone));
    RenderSettings settings;
    settings.samplesPerPixel = 16;
    settings.optics = p.capture.optics;
    for (size_t i = 0; i < p.capture.truth.images.size(); ++i) {
        const OlatImage& image = p.capture.truth.images[i];
        const auto pictures = tracer->render(p.capture.truth.cameras[image.camera], *image.light.group, settings);
        REQUIRE(pictures);
        size_t covered = 0, lit = 0;
        for (size_t v = 0; v < (*pictures)[0].rgba.size(); v += 4) covered += (*pictures)[0].rgba[v + 3] == 1.0f, lit += (*pictures)[0].rgba[v] > 0.01f;
        CHECK(covered == size_t(24 * 20));
        CHECK(lit > size_t(24 * 20 / 2));
    }
}
