// Whole bakes on the emulated device, against the CPU's engine.
#include "device/engine.h"
#include "train/trainer.h"

#include <doctest/doctest.h>

#include <glm/gtc/matrix_transform.hpp>

#include <cmath>

using namespace nacre;

namespace {

constexpr int kSide = 28, kCameras = 6, kLights = 2;
constexpr double kPi = 3.14159265358979;

using emulated::DeviceEngine;
using emulated::Emulation;
using emulated::ThreadOrder;

/// `made`: where the engine is.
MakeStepEngine onDevice(const Emulation& emulation, DeviceEngine** made = nullptr)
{
    return [=](SplatState& state, const StepOptions& options) -> std::unique_ptr<StepEngine> {
        auto engine = std::make_unique<DeviceEngine>(std::make_unique<emulated::Device>(emulation), state, options);
        state.appearance->setVisibilityDrawer({}); // by the CPU: a thousand views take the emulator seconds
        if (made) *made = engine.get();
        return engine;
    };
}

/// A sphere that is lit from two sides, as images show it.
struct Capture {
    std::vector<Camera> cameras;
    std::vector<Light> lights;
    std::vector<std::vector<PreparedImage>> images; // [camera][light]
};

Camera cameraAt(double angle)
{
    Camera c;
    c.width = kSide, c.height = kSide - 5, c.fx = c.fy = 1.3 * kSide, c.cx = 0.5 * c.width, c.cy = 0.5 * c.height;
    c.worldFromCamera = glm::inverse(glm::lookAt(3.0 * glm::dvec3(std::cos(angle), std::sin(angle), 0.3), glm::dvec3(0), glm::dvec3(0, 0, 1)));
    return c;
}

Image sphereImage(const Camera& c, const Light& light)
{
    Image image{c.width, c.height, std::vector<float>(size_t(4 * c.width * c.height))};
    for (size_t i = 0; i < image.rgba.size(); i += 8) image.rgba[i] = -0.0f; // some files have it
    const glm::dvec3 eye = c.position();
    for (int y = 0; y < c.height; ++y)
        for (int x = 0; x < c.width; ++x) {
            const glm::dvec3 d = glm::normalize(glm::dmat3(c.worldFromCamera) * glm::dvec3((x + 0.5 - c.cx) / c.fx, -(y + 0.5 - c.cy) / c.fy, -1));
            const double b = glm::dot(eye, d), inside = 0.49 - (glm::dot(eye, eye) - b * b); // radius 0.7
            if (inside < 0) continue;
            const glm::dvec3 p = eye + (-b - std::sqrt(inside)) * d, l = glm::dvec3(light.position) - p;
            const double lit = std::max(0.0, glm::dot(p, l)) / 0.7 / std::pow(glm::length(l), 3) * light.intensity.x / kPi;
            const double base[3] = {0.7, 0.5 + 0.2 * std::sin(6 * p.x), 0.3};
            for (int k = 0; k < 3; ++k) image.pixel(x, y)[k] = float(base[k] * lit);
            image.pixel(x, y)[3] = 1;
        }
    return image;
}

Capture sphereCapture()
{
    Capture capture;
    for (int l = 0; l < kLights; ++l) {
        Light light;
        light.position = {3.0f * float(1 - 2 * l), 2, 3}, light.intensity = glm::vec3(40);
        capture.lights.push_back(light);
    }
    for (int k = 0; k < kCameras; ++k) {
        capture.cameras.push_back(cameraAt(2 * kPi * k / kCameras));
        capture.images.emplace_back();
        for (const Light& light : capture.lights) capture.images.back().push_back(prepareImage(sphereImage(capture.cameras.back(), light)));
    }
    return capture;
}

struct Start {
    std::string model = "sss";
    size_t splats = 150;
    bool ambient = false;
};

Trainer sphereTrainer(const Start& start, const MakeStepEngine& makeEngine)
{
    std::vector<OrientedPoint> points(start.splats);
    for (size_t i = 0; i < points.size(); ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(points.size()), phi = 2.39996f * float(i), r = std::sqrt(1 - z * z);
        points[i] = {{0.7f * r * std::cos(phi), 0.7f * r * std::sin(phi), 0.7f * z}, {r * std::cos(phi), r * std::sin(phi), z}};
    }
    TrainerOptions options;
    options.maxSplats = 2 * start.splats, options.ambient = start.ambient;
    Trainer trainer(options, makeTrainableAppearance(start.model, {4}), makeEngine);
    trainer.initialize(points, float(std::sqrt(4 * kPi * 0.49 / double(start.splats))), true);
    return trainer;
}

LossStats step(Trainer& trainer, const Capture& capture, int step, double progress, double* splatErrors = nullptr)
{
    const size_t k = size_t(step) % capture.cameras.size();
    const PreparedImage* references[kLights] = {&capture.images[k][0], &capture.images[k][1]};
    return trainer.step(capture.cameras[k], capture.lights, references, {step, progress}, splatErrors);
}

/// All that a checkpoint holds.
std::vector<std::byte> stateOf(const Trainer& trainer)
{
    ByteWriter out;
    trainer.save(out);
    return out.bytes;
}

SplatAsset assetOf(const Trainer& trainer)
{
    SplatAsset asset;
    trainer.exportTo(asset);
    return asset;
}

/// Root mean square of the differences of a channel, over that of the channel.
double differenceOf(const std::vector<float>& a, const std::vector<float>& b)
{
    REQUIRE(a.size() == b.size());
    double difference = 0, size = 1e-30;
    for (size_t i = 0; i < a.size(); ++i) difference += (a[i] - b[i]) * double(a[i] - b[i]), size += a[i] * double(a[i]);
    return std::sqrt(difference / size);
}

std::vector<float> positionsOf(const SplatAsset& asset)
{
    std::vector<float> out;
    for (const glm::vec3& p : asset.cloud.positions)
        for (int k = 0; k < 3; ++k) out.push_back(p[k]);
    return out;
}

double heldOutPsnr(Trainer& trainer, const Capture& capture)
{
    const Camera camera = cameraAt(0.5);
    std::vector<float> planes, dPlanes;
    trainer.render(camera, std::span(capture.lights).first(1), planes);
    dPlanes.resize(planes.size());
    const PreparedImage reference = prepareImage(sphereImage(camera, capture.lights[0]));
    const PreparedImage* r = &reference;
    ImageLoss loss;
    const LossStats stats = loss.evaluate(planes.data(), &r, 1, {}, dPlanes.data());
    return psnrFrom(stats.squaredErrorMasked, stats.countMasked);
}

} // namespace

TEST_CASE("the first ten steps of a bake on a device are those of the CPU")
{
    // Sums in another order and exponentials of another library: 1e-7 of a number a step, of which Adam makes up to some 1e-6 in ten.
    constexpr double kBound = 1e-5;
    const Capture capture = sphereCapture();
    for (const Start& start : {Start{"sss"}, Start{"bigs"}, Start{"bigs", 150, true}}) {
        CAPTURE(start.model);
        Trainer cpu = sphereTrainer(start, makeCpuEngine), device = sphereTrainer(start, onDevice({ThreadOrder::kRandom, 7}));
        for (int k = 1; k <= 10; ++k) {
            const double progress = 0.02 * k; // normals, lobes and bands come in on the way
            const LossStats a = step(cpu, capture, k, progress), b = step(device, capture, k, progress);
            CHECK(b.loss == doctest::Approx(a.loss).epsilon(kBound));
            CHECK(b.squaredErrorMasked == doctest::Approx(a.squaredErrorMasked).epsilon(kBound));
            CHECK(b.count == a.count);
            CHECK(b.countMasked == a.countMasked);
        }
        const SplatAsset a = assetOf(cpu), b = assetOf(device);
        CHECK(differenceOf(positionsOf(a), positionsOf(b)) < kBound);
        REQUIRE(a.channels.size() == b.channels.size());
        for (size_t k = 0; k < a.channels.size(); ++k) {
            CAPTURE(a.channels[k].name);
            double steps = 0; // of maps, whose centres lie a ten millionth elsewhere
            for (size_t i = 0; i < a.channels[k].bytes.size(); ++i) steps += std::abs(a.channels[k].bytes[i] - b.channels[k].bytes[i]);
            CHECK(steps <= 0.01 * double(a.channels[k].bytes.size()));
            CHECK(differenceOf(a.channels[k].values, b.channels[k].values) < kBound);
        }
    }
}

TEST_CASE("a short bake on a device, splats split and dropped on the way, is as good as the CPU's, and the same in every order of threads")
{
    const Capture capture = sphereCapture();
    for (const char* model : {"sss", "bigs"}) {
        CAPTURE(model);
        const auto bake = [&](const MakeStepEngine& makeEngine) {
            Trainer trainer = sphereTrainer({model}, makeEngine);
            for (int k = 1; k <= 48; ++k) {
                step(trainer, capture, k, k / 60.0);
                if (k % 20 == 0) trainer.densify(40);
            }
            trainer.prune();
            return trainer;
        };
        Trainer cpu = bake(makeCpuEngine), device = bake(onDevice({ThreadOrder::kForward})), reverse = bake(onDevice({ThreadOrder::kReverse}));
        CHECK(cpu.count() > 150);
        CHECK(device.count() == doctest::Approx(cpu.count()).epsilon(0.02));
        CHECK(std::abs(heldOutPsnr(device, capture) - heldOutPsnr(cpu, capture)) < 0.1);
        CHECK(heldOutPsnr(cpu, capture) > 20);
        CHECK(stateOf(device) == stateOf(reverse));
    }
}

TEST_CASE("a state that was kept is gone on with, on the device that made it and on the CPU")
{
    const Capture capture = sphereCapture();
    Trainer device = sphereTrainer({"bigs"}, onDevice({})), cpu = sphereTrainer({"bigs"}, makeCpuEngine);
    for (int k = 1; k <= 18; ++k) step(device, capture, k, 0.2);
    const std::vector<std::byte> before = stateOf(device);
    const auto goOn = [&](Trainer& trainer) {
        ByteReader in(before);
        REQUIRE(trainer.load(in));
        CHECK(stateOf(trainer) == before);
        for (int k = 19; k <= 34; ++k) step(trainer, capture, k, 0.2); // at 32 neighbours share
        return stateOf(trainer);
    };
    const std::vector<std::byte> once = goOn(device);
    CHECK(goOn(device) == once);
    CHECK(once != before);
    goOn(cpu);
    CHECK(std::abs(heldOutPsnr(device, capture) - heldOutPsnr(cpu, capture)) < 0.01);
    device.leaveOut("s", {});
    CHECK(assetOf(device).find("s") == nullptr);
    CHECK(std::isfinite(step(device, capture, 35, 0.2).loss));
}

TEST_CASE("what splats answer for, and what images show of them, is on a device what it is on the CPU")
{
    constexpr double kBound = 1e-4; // of ratios of such sums
    const Capture capture = sphereCapture();
    for (const char* model : {"sss", "bigs"}) {
        Trainer cpu = sphereTrainer({model}, makeCpuEngine), device = sphereTrainer({model}, onDevice({ThreadOrder::kRandom, 3}));
        std::vector<double> errors[2] = {std::vector<double>(cpu.count()), std::vector<double>(cpu.count())};
        for (int k = 1; k <= 4; ++k) step(cpu, capture, k, 0.1, errors[0].data()), step(device, capture, k, 0.1, errors[1].data());
        double sum = 0;
        for (double e : errors[0]) sum += e;
        CHECK(sum > 0);
        for (size_t i = 0; i < cpu.count(); ++i) CHECK(std::abs(errors[0][i] - errors[1][i]) < kBound * sum / double(cpu.count()));

        const PreparedImage* references[kLights] = {&capture.images[1][0], &capture.images[1][1]};
        const ViewEvidence a = cpu.evidence(capture.cameras[1], capture.lights, references), b = device.evidence(capture.cameras[1], capture.lights, references);
        REQUIRE(a.splats.size() == b.splats.size());
        REQUIRE(a.splats.size() > 20);
        CHECK(a.lit.lightCount == b.lit.lightCount);
        for (size_t i = 0; i < a.splats.size(); ++i) {
            const SplatEvidence &x = a.splats[i], &y = b.splats[i];
            CHECK(x.splat == y.splat);
            CHECK(y.weight == doctest::Approx(x.weight).epsilon(kBound));
            for (int l = 0; l < kLights; ++l) {
                CHECK(y.residual[l] == doctest::Approx(x.residual[l]).epsilon(kBound));
                CHECK(y.slope[l] == doctest::Approx(x.slope[l]).epsilon(kBound));
                CHECK(y.saturated[l] == doctest::Approx(x.saturated[l]).epsilon(kBound));
            }
        }
    }
}

TEST_CASE("a card that is too small for all images keeps those used last; one that is too small for a step says so")
{
    const Capture capture = sphereCapture();
    const auto bake = [&](size_t memoryBytes, DeviceEngine*& engine) {
        Trainer trainer = sphereTrainer({"sss"}, onDevice({.memoryBytes = memoryBytes}, &engine));
        for (int k = 1; k <= 2 * kCameras; ++k) {
            const size_t at = size_t(k) % capture.cameras.size();
            const PreparedImage* references[kLights] = {&capture.images[at][0], &capture.images[at][1]};
            trainer.evidence(capture.cameras[at], capture.lights, references);
            step(trainer, capture, k, 0.1);
        }
        return trainer;
    };
    DeviceEngine *roomy = nullptr, *tight = nullptr, *none = nullptr;
    Trainer all = bake(size_t(1) << 30, roomy);
    CHECK(roomy->residentImages() == kCameras * kLights);
    Trainer some = bake(roomy->deviceBytes() - 4 * capture.images[0][0].bytes(), tight);
    CHECK(tight->residentImages() < kCameras * kLights);
    CHECK(tight->residentImages() >= kLights);
    CHECK(stateOf(all) == stateOf(some));
    CHECK_THROWS_WITH_AS(bake(100000, none), doctest::Contains("memory is full"), DeviceError);
}
