// Initialisation and density: visual hull, sampling, Morton order, splitting, pruning, checkpoints.
#include "appearance/model_table.h"
#include "appearance/sss/sss_network.h"
#include "base/random.h"
#include "splats/morton.h"
#include "splat/visual_hull.h"
#include "train/checkpoint.h"
#include "train/cluster_choice.h"
#include "train/trainer.h"

#include <doctest/doctest.h>

#include <glm/gtc/matrix_transform.hpp>
#include <set>

using namespace nacre;

namespace {

Camera lookAtOrigin(glm::dvec3 eye, int size)
{
    Camera c;
    c.width = c.height = size;
    c.fx = c.fy = 1.4 * size;
    c.cx = c.cy = 0.5 * size;
    c.worldFromCamera = glm::inverse(glm::lookAt(eye, glm::dvec3(0), glm::dvec3(0, 0, 1)));
    return c;
}

struct Views {
    std::vector<Camera> cameras;
    std::vector<std::vector<uint8_t>> masks;
};

// Silhouettes of a sphere of radius 0.5 at the origin, seen from all around.
Views sphereViews(int size, int count = 24)
{
    constexpr double kRadius = 0.5;
    Views views;
    for (int k = 0; k < count; ++k) {
        const double z = -0.9 + 1.8 * (k + 0.5) / count, phi = 2.4 * k;
        const Camera c = lookAtOrigin(3.0 * glm::dvec3(std::sqrt(1 - z * z) * std::cos(phi), std::sqrt(1 - z * z) * std::sin(phi), z), size);
        std::vector<uint8_t> alpha(size_t(size) * size);
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) {
                const glm::dvec3 d = glm::normalize(glm::dmat3(c.worldFromCamera) * glm::dvec3((x + 0.5 - c.cx) / c.fx, -(y + 0.5 - c.cy) / c.fy, -1));
                const double b = glm::dot(c.position(), d);
                alpha[size_t(y) * size + x] = glm::dot(c.position(), c.position()) - b * b < kRadius * kRadius;
            }
        views.cameras.push_back(c);
        views.masks.push_back(alpha);
    }
    return views;
}

Light lamp()
{
    Light light;
    light.position = {0, 2, 4}, light.intensity = glm::vec3(20);
    return light;
}

PreparedImage disc(const Camera& camera, const std::vector<uint8_t>& alpha)
{
    Image image{camera.width, camera.height, {}};
    for (uint8_t in : alpha) {
        const float a = in;
        image.rgba.insert(image.rgba.end(), {0.5f * a, 0.4f * a, 0.3f * a, a});
    }
    return prepareImage(image);
}

Trainer sphereTrainer(size_t count, size_t cap, const std::string& model = "bigs", const AppearanceOptions& appearance = {4})
{
    const Views views = sphereViews(64);
    const VisualHull hull = carveVisualHull(views.cameras, views.masks, 32);
    TrainerOptions options;
    options.maxSplats = cap;
    Trainer trainer(options, makeTrainableAppearance(model, appearance));
    trainer.initialize(sampleHull(hull, count, 1), float(std::sqrt(hull.surfaceArea / double(count))), true);
    return trainer;
}

void train(Trainer& trainer, int first, int last)
{
    const Views views = sphereViews(64);
    Light light = lamp();
    for (int step = first; step <= last; ++step) {
        const size_t k = size_t(step) % views.cameras.size();
        const PreparedImage image = disc(views.cameras[k], views.masks[k]);
        const PreparedImage* reference = &image;
        trainer.step(views.cameras[k], std::span(&light, 1), &reference, {step, step / 100.0});
    }
}

std::vector<float> pictureOf(Trainer& trainer)
{
    const Light light = lamp();
    std::vector<float> planes;
    trainer.render(sphereViews(64).cameras[0], std::span(&light, 1), planes);
    return planes;
}

std::vector<std::byte> state(const Trainer& trainer)
{
    ByteWriter out;
    trainer.save(out);
    return out.bytes;
}

} // namespace

TEST_CASE("the visual hull of a sphere's silhouettes is the sphere")
{
    const Views views = sphereViews(96);
    const VisualHull hull = carveVisualHull(views.cameras, views.masks, 48);
    const float voxel = 2 * hull.halfSize / 48;
    CHECK(std::abs(hull.center[0]) + std::abs(hull.center[1]) + std::abs(hull.center[2]) < 1e-4);
    REQUIRE(hull.surface.size() > 300);
    for (const OrientedPoint& p : hull.surface) {
        const float r = std::sqrt(detail::dot3(p.position, p.position));
        CHECK(r > 0.5f - 1.5f * voxel);
        CHECK(r < 0.5f + 2.5f * voxel); // a hull from few views bulges
        CHECK(detail::dot3(p.position, p.normal) / r > 0.8f);
    }
}

TEST_CASE("the hull survives one mask that is blank, inverted or cut, and holes in many; what is unknown takes nothing away")
{
    const Views clean = sphereViews(96, 72);
    const VisualHull right = carveVisualHull(clean.cameras, clean.masks, 48);
    const auto differs = [&](const Views& views) { // share of the object's voxels
        const VisualHull hull = carveVisualHull(views.cameras, views.masks, 48);
        size_t inside = 0, different = 0;
        for (size_t i = 0; i < right.inside.size(); ++i) inside += right.inside[i], different += right.inside[i] != hull.inside[i];
        return double(different) / double(inside);
    };
    Views views = clean;
    SUBCASE("blank") { std::fill(views.masks[5].begin(), views.masks[5].end(), uint8_t(kMaskBackground)); }
    SUBCASE("inverted")
    {
        for (uint8_t& m : views.masks[5]) m = m == kMaskObject ? kMaskBackground : kMaskObject;
    }
    SUBCASE("cut") { std::fill(views.masks[5].begin(), views.masks[5].begin() + 96 * 48, uint8_t(kMaskBackground)); }
    SUBCASE("holes")
    {
        for (size_t k = 0; k < views.masks.size(); k += 3)
            for (size_t y = 0; y < 10; ++y) std::fill_n(views.masks[k].begin() + ptrdiff_t((30 + 4 * (k % 7) + y) * 96 + 30 + 4 * (k % 8)), 10, uint8_t(kMaskBackground));
    }
    SUBCASE("unknown")
    {
        for (std::vector<uint8_t>& mask : views.masks)
            for (size_t i = 0; i < mask.size(); i += 4) mask[i] = kMaskUnknown;
    }
    CHECK(differs(views) < 0.15); // believed one by one, the masks with holes would leave half
}

TEST_CASE("no silhouette gives no hull, and points fall back to the framed cube")
{
    Views views = sphereViews(32);
    for (auto& a : views.masks) std::fill(a.begin(), a.end(), uint8_t(0));
    const VisualHull hull = carveVisualHull(views.cameras, views.masks, 24);
    CHECK(hull.surface.empty());
    for (const OrientedPoint& p : sampleHull(hull, 100, 1))
        for (int k = 0; k < 3; ++k) CHECK(std::abs(p.position[k] - hull.center[k]) <= hull.halfSize);
}

TEST_CASE("one camera frames the space in front of it")
{
    const Camera c = lookAtOrigin({0, -3, 0.5}, 32);
    float center[3], half;
    frameCube(std::span(&c, 1), center, &half);
    const glm::dvec3 forward = -glm::dvec3(c.worldFromCamera[2]);
    CHECK(glm::dot(glm::dvec3(center[0], center[1], center[2]) - c.position(), forward) > 0.5);
    CHECK(half > 0);
}

TEST_CASE("Morton order is a permutation that keeps neighbours together")
{
    Random random(3);
    std::vector<std::array<float, 3>> points(2000);
    for (auto& p : points) p = {random.uniform(), random.uniform(), random.uniform()};
    const auto order = mortonOrder(points.size(), [&](size_t i) { return points[i].data(); });
    CHECK(std::set<uint32_t>(order.begin(), order.end()).size() == points.size());
    const auto hop = [&](auto index) {
        double sum = 0;
        for (size_t i = 1; i < points.size(); ++i)
            for (int k = 0; k < 3; ++k) sum += std::abs(points[index(i)][k] - points[index(i - 1)][k]);
        return sum;
    };
    CHECK(hop([&](size_t i) { return order[i]; }) < 0.2 * hop([](size_t i) { return i; }));
}

TEST_CASE("every model: training lowers the loss, densify respects the cap and keeps everything finite")
{
    for (const AppearanceModel& model : appearanceModels()) {
        CAPTURE(model.name);
        Trainer trainer = sphereTrainer(200, 300, model.name);
        const Views views = sphereViews(64);
        Light light = lamp();
        const auto error = [&] {
            const PreparedImage image = disc(views.cameras[3], views.masks[3]);
            const PreparedImage* reference = &image;
            std::vector<float> planes, gradient;
            trainer.render(views.cameras[3], std::span(&light, 1), planes);
            gradient.resize(planes.size());
            return ImageLoss().evaluate(planes.data(), &reference, 1, {}, gradient.data()).loss;
        };
        const double before = error();
        train(trainer, 1, 30);
        trainer.densify(60);
        CHECK(trainer.count() == 260);
        train(trainer, 31, 40);
        trainer.densify(500);
        CHECK(trainer.count() == 300);
        train(trainer, 41, 90);
        CHECK(error() < 0.5 * before);
        SplatAsset asset;
        trainer.exportTo(asset);
        for (const Channel& c : asset.channels)
            for (float v : c.values) REQUIRE(std::isfinite(v));
        trainer.resetStatistics();
        CHECK(trainer.prune() == 300); // nothing has been seen since the reset
    }
}

TEST_CASE("sss learns what nearness of a light means from lights at several distances only; else it means nothing")
{
    for (const bool vary : {false, true}) {
        AppearanceOptions options;
        options.lightDistancesVary = vary;
        Trainer trainer = sphereTrainer(200, 200, "sss", options);
        train(trainer, 1, 10);
        SplatAsset asset;
        trainer.exportTo(asset);
        const std::vector<float>& network = asset.find("network")->values;
        bool used = false;
        for (int j = 0; j < kSssHidden1; ++j) used = used || network[size_t(kSssFirstLight + kSssLightInputs * j + kSssNearnessInput)] != 0;
        CHECK(used == vary);
    }
}

TEST_CASE("every model: a split keeps the picture: no pixel changes much")
{
    for (const AppearanceModel& model : appearanceModels()) {
        CAPTURE(model.name);
        Trainer trainer = sphereTrainer(400, 800, model.name);
        train(trainer, 1, 48);
        const Views views = sphereViews(64);
        Light light = lamp();
        std::vector<float> before, after;
        trainer.render(views.cameras[0], std::span(&light, 1), before);
        trainer.densify(200);
        REQUIRE(trainer.count() == 600);
        trainer.render(views.cameras[0], std::span(&light, 1), after);
        double sum = 0, scale = 0;
        for (size_t i = 0; i < before.size(); ++i) sum += std::abs(before[i] - after[i]), scale += std::abs(before[i]);
        CHECK(sum < 0.1 * scale); // half of the splats were split
    }
}

TEST_CASE("a hull that cameras enclose keeps off the border; one seen from the front only reaches it")
{
    const Views views = sphereViews(48);
    CHECK_FALSE(touchesBorder(carveVisualHull(views.cameras, views.masks, 32)));
    CHECK(touchesBorder(carveVisualHull(std::span(views.cameras).first(1), std::span(views.masks).first(1), 32)));
}

TEST_CASE("every model: splats answer for the whole error of the pixels that they cover, and for nothing else")
{
    for (const AppearanceModel& model : appearanceModels()) {
        CAPTURE(model.name);
        Trainer trainer = sphereTrainer(300, 300, model.name);
        train(trainer, 1, 20);
        const Views views = sphereViews(64);
        Light lights[2] = {lamp(), {}};
        lights[1].position = {3, 0, 1}, lights[1].intensity = glm::vec3(9);
        const PreparedImage image = disc(views.cameras[0], views.masks[0]);
        const PreparedImage* references[] = {&image, &image};
        std::vector<float> planes, errors(64 * 64);
        trainer.render(views.cameras[0], lights, planes); // what the step sees
        objectErrors(planes.data(), references, 2, errors.data());
        double expected = 0, all = 0;
        for (size_t i = 0; i < errors.size(); ++i) expected += double(errors[i]) * planes[6 * errors.size() + i], all += errors[i];
        std::vector<double> ofSplats(trainer.count());
        const LossStats stats = trainer.step(views.cameras[0], lights, references, {21, 0.21}, ofSplats.data());
        CHECK(all == doctest::Approx(stats.squaredErrorMasked).epsilon(1e-4)); // exp2 against pow
        CHECK(expected > 0.5 * all);
        double sum = 0;
        for (const double e : ofSplats) {
            CHECK(e >= 0);
            sum += e;
        }
        CHECK(sum == doctest::Approx(expected).epsilon(1e-3));
    }
}

TEST_CASE("a part stays where it saves error, and nowhere for a few splats")
{
    std::vector<double> with(3200, 1.0), without(3200, 1.0);
    const auto kept = [&](double leastWorth) {
        const std::vector<uint8_t> k = chooseClusters(with, without, leastWorth);
        return std::vector<uint8_t>{k[0], k[1599], k[1600], k[3199]};
    };
    CHECK(kept(0.5) == std::vector<uint8_t>{0, 0, 0, 0});
    std::fill_n(without.begin(), 1600, 1.2); // 0.8 dB in the first half
    CHECK(kept(0.5) == std::vector<uint8_t>{1, 1, 0, 0});
    CHECK(kept(1.0) == std::vector<uint8_t>{0, 0, 0, 0});
    std::fill_n(with.begin() + 1600, 1600, 9.0), std::fill_n(without.begin() + 1600, 1600, 9.4); // more error, 0.2 dB of it
    CHECK(kept(0.5) == std::vector<uint8_t>{0, 0, 0, 0}); // 0.2 of 1 are no longer much, nor 0.4 of 9
    std::fill_n(without.begin() + 1600, 1600, 12.0);
    CHECK(kept(0.5) == std::vector<uint8_t>{0, 0, 1, 1});
    with.assign(3200, 1.0), without.assign(3200, 1.0);
    std::fill_n(without.begin(), 600, 2.0);
    CHECK(kept(0.5) == std::vector<uint8_t>{0, 0, 0, 0}); // 19 % of the splats
    for (const size_t few : {size_t(0), size_t(1), size_t(5)})
        CHECK(chooseClusters(std::vector<double>(few, 1.0), std::vector<double>(few, 2.0), 0.5) == std::vector<uint8_t>(few, 1));
    CHECK(chooseClusters(std::vector<double>(50, 0.0), std::vector<double>(50, 0.0), 0.5) == std::vector<uint8_t>(50, 0)); // no error, no need
    CHECK(decibelBetween(10, 1) == doctest::Approx(10));
}

TEST_CASE("every model: a checkpoint continues to the same bytes; damaged at any place or foreign, it is refused")
{
    for (const AppearanceModel& model : appearanceModels()) {
        CAPTURE(model.name);
        Trainer trainer = sphereTrainer(60, 120, model.name);
        train(trainer, 1, 20);
        trainer.densify(30);
        BakeState before;
        before.gain = 2.5, before.step = 20, before.stepsSinceReset = 3, before.seconds = 1.5, before.masksTried = true;
        before.history.push_back({1.0, 10, 60, 20.0, 15.0});
        const std::vector<std::byte> bytes = encodeCheckpoint("--seed 77\n", {{"a.png", "a.png: cut off"}}, before, trainer);
        const std::vector<float> picture = pictureOf(trainer);
        train(trainer, 21, 40);

        Trainer resumed = sphereTrainer(100, 120, model.name);
        auto after = decodeCheckpoint(bytes, "--seed 77\n", 0, resumed);
        REQUIRE(bool(after));
        CHECK(after->step == 20);
        CHECK(after->gain == 2.5);
        CHECK(after->stepsSinceReset == 3);
        CHECK(after->masksTried);
        CHECK_FALSE(after->masks);
        CHECK(after->history.size() == 1);
        CHECK(pictureOf(resumed) == picture); // lights may be refined, or held-out views evaluated, before the first step
        train(resumed, 21, 40);
        CHECK(state(resumed) == state(trainer));

        const auto other = decodeCheckpoint(bytes, "--seed 78\n", 0, resumed);
        REQUIRE_FALSE(bool(other));
        CHECK(other.error().message.find("it has --seed 77, this one --seed 78") != std::string::npos);
        CHECK(*learningGainOf(bytes) == 2.5);
        const auto skipped = skippedImages(bytes);
        REQUIRE(bool(skipped));
        REQUIRE(skipped->size() == 1);
        CHECK((*skipped)[0].path == "a.png");
        const std::span<const std::byte> whole(bytes);
        for (size_t cut = 0; cut < bytes.size(); cut += cut < 200 ? 1 : 997) CHECK_FALSE(bool(decodeCheckpoint(whole.first(cut), "--seed 77\n", 0, resumed)));
        for (size_t at = 0; at < bytes.size(); at += 1009) {
            std::vector<std::byte> damaged = bytes;
            damaged[at] ^= std::byte(1);
            CHECK_FALSE(bool(decodeCheckpoint(damaged, "--seed 77\n", 0, resumed)));
        }
    }
}

static void numericsThatBite(const std::string& model)
{
    const Views views = sphereViews(48);
    std::vector<OrientedPoint> points(64);
    Random random(9);
    for (OrientedPoint& p : points)
        for (int k = 0; k < 3; ++k) p.position[k] = 0.5f * (2 * random.uniform() - 1), p.normal[k] = k == 2;
    float spacing = 0.1f;
    Light light = lamp();
    Camera camera = views.cameras[2];
    SUBCASE("light on a Gaussian") { light.position = {points[5].position[0], points[5].position[1], points[5].position[2]}; }
    SUBCASE("light at 1e6 with intensity 1e12") { light.position *= 1e6f, light.intensity = glm::vec3(1e12f); }
    SUBCASE("intensity 0") { light.intensity = glm::vec3(0); }
    SUBCASE("HDR intensity 1e4 times the usual") { light.intensity = glm::vec3(2e5f); }
    SUBCASE("splats far below a pixel") { spacing = 1e-4f; }
    SUBCASE("splats far wider than the image") { spacing = 15.0f; }
    SUBCASE("camera inside the cloud, splats at and behind the near plane")
    {
        camera.worldFromCamera[3] = glm::dvec4(points[0].position[0], points[0].position[1], points[0].position[2], 1);
    }
    SUBCASE("all splats at one place") { for (OrientedPoint& p : points) p = points[0]; }

    TrainerOptions options;
    options.maxSplats = 96;
    Trainer trainer(options, makeTrainableAppearance(model, {9}));
    trainer.initialize(points, spacing, true);
    const PreparedImage image = disc(camera, views.masks[2]);
    const PreparedImage* reference = &image;
    for (int step = 1; step <= 30; ++step) {
        CHECK(std::isfinite(trainer.step(camera, std::span(&light, 1), &reference, {step, 0.3}).loss));
        if (step == 15) trainer.densify(16);
    }
    SplatAsset asset;
    asset.model = model;
    trainer.exportTo(asset);
    CHECK(bool(validate(asset))); // finite, unit quaternions, positive scales, opacities in [0, 1]
}

TEST_CASE("numerics that bite: a training step leaves every parameter finite and in bounds, bigs") { numericsThatBite("bigs"); }
TEST_CASE("numerics that bite: a training step leaves every parameter finite and in bounds, sss") { numericsThatBite("sss"); }

TEST_CASE("geometry with condition 1e8, near-zero quaternion, saturated opacity and infinite gradient survives a step")
{
    SplatGeometry geometry;
    geometry.resize(4);
    const GeometryRow normal = {0, 0, 0, -2, -2, -2, 1, 0, 0, 0, 0.5f};
    for (GeometryRow& r : geometry.raw) r = normal;
    geometry.raw[0][3] = 1.0f, geometry.raw[0][4] = geometry.raw[0][5] = 1.0f - std::log(1e4f); // Sigma condition 1e8
    for (int k = 6; k < 10; ++k) geometry.raw[1][k] = 1e-12f;
    geometry.raw[2][10] = 100.0f;
    for (size_t i = 0; i < 4; ++i) geometry.activate(i);
    const View<float> view = makeView<float>(lookAtOrigin({0, -3, 0}, 64), 0.1);
    const uint32_t splats[4] = {0, 1, 2, 3};
    const uint8_t active[4] = {1, 1, 1, 1};
    ScreenGradient<float> d[4];
    for (auto& g : d) g = {{1, -2}, {3, 1, -1}, 2, 1};
    d[3] = {{INFINITY, NAN}, {1e30f, 1e30f, 1e30f}, -INFINITY, 1};
    for (int step = 1; step < 20; ++step) stepGeometry(geometry, view, splats, d, nullptr, active, {0.01f, 0.01f, 0.01f, 0.01f}, step, 0);
    for (size_t i = 0; i < 4; ++i) {
        for (float r : geometry.raw[i]) CHECK(std::isfinite(r));
        CHECK(geometry.activated[i].opacity > 0);
        CHECK(geometry.activated[i].opacity < 1);
        float unit[4];
        CHECK(detail::normalizeQuaternion(&geometry.raw[i][6], unit) > 0);
    }
}

TEST_CASE("a render that is not a number shows in the loss")
{
    const PreparedImage image = prepareImage({4, 4, std::vector<float>(64, 0.5f)});
    const PreparedImage* reference = &image;
    std::vector<float> planes(64, 0.2f), gradient(64);
    planes[3] = NAN;
    CHECK(std::isnan(ImageLoss().evaluate(planes.data(), &reference, 1, {}, gradient.data()).loss));
}
