// Initialisation and density: visual hull, sampling, Morton order, splitting, pruning, checkpoints.
#include "splat/morton.h"
#include "splat/random.h"
#include "splat/visual_hull.h"
#include "train/checkpoint.h"
#include "train/trainer.h"

#include <doctest/doctest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
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

// Silhouettes of a sphere of radius `r` at the origin, seen from all around.
void sphereViews(double r, int size, std::vector<Camera>& cameras, std::vector<std::vector<float>>& alphas)
{
    for (int k = 0; k < 24; ++k) {
        const double z = -0.9 + 1.8 * (k + 0.5) / 24, phi = 2.4 * k;
        const Camera c = lookAtOrigin(3.0 * glm::dvec3(std::sqrt(1 - z * z) * std::cos(phi), std::sqrt(1 - z * z) * std::sin(phi), z), size);
        std::vector<float> alpha(size_t(size) * size);
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) {
                const glm::dvec3 d = glm::normalize(glm::dmat3(c.worldFromCamera) * glm::dvec3((x + 0.5 - c.cx) / c.fx, -(y + 0.5 - c.cy) / c.fy, -1));
                const double b = glm::dot(c.position(), d);
                alpha[size_t(y) * size + x] = glm::dot(c.position(), c.position()) - b * b < r * r ? 1.0f : 0.0f;
            }
        cameras.push_back(c);
        alphas.push_back(alpha);
    }
}

PreparedImage disc(const Camera& camera, const std::vector<float>& alpha)
{
    Image image{camera.width, camera.height, {}};
    for (float a : alpha) image.rgba.insert(image.rgba.end(), {0.5f * a, 0.4f * a, 0.3f * a, a});
    return prepareImage(image);
}

Trainer sphereTrainer(size_t count, size_t cap)
{
    std::vector<Camera> cameras;
    std::vector<std::vector<float>> alphas;
    sphereViews(0.5, 64, cameras, alphas);
    const VisualHull hull = carveVisualHull(cameras, alphas, 32);
    TrainerOptions options;
    options.maxSplats = cap;
    Trainer trainer(options, makeTrainableAppearance("bigs", {4}));
    trainer.initialize(sampleHull(hull, count, 1), hull.surfaceArea, true);
    return trainer;
}

void train(Trainer& trainer, int first, int last)
{
    std::vector<Camera> cameras;
    std::vector<std::vector<float>> alphas;
    sphereViews(0.5, 64, cameras, alphas);
    Light light;
    light.position = {0, 2, 4}, light.intensity = glm::vec3(20);
    for (int step = first; step <= last; ++step) {
        const size_t k = size_t(step) % cameras.size();
        const PreparedImage image = disc(cameras[k], alphas[k]);
        const PreparedImage* reference = &image;
        trainer.step(cameras[k], std::span(&light, 1), &reference, step / 100.0, step);
    }
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
    std::vector<Camera> cameras;
    std::vector<std::vector<float>> alphas;
    sphereViews(0.5, 96, cameras, alphas);
    const VisualHull hull = carveVisualHull(cameras, alphas, 48);
    const float voxel = 2 * hull.halfSize / 48;
    CHECK(std::abs(hull.center[0]) + std::abs(hull.center[1]) + std::abs(hull.center[2]) < 1e-4);
    REQUIRE(hull.surface.size() > 300);
    for (const SurfacePoint& p : hull.surface) {
        const float r = std::sqrt(detail::dot3(p.position, p.position));
        CHECK(r > 0.5f - 1.5f * voxel);
        CHECK(r < 0.5f + 2.5f * voxel); // a hull from few views bulges
        CHECK(detail::dot3(p.position, p.normal) / r > 0.8f);
    }
}

TEST_CASE("no silhouette gives no hull, and points fall back to the framed cube")
{
    std::vector<Camera> cameras;
    std::vector<std::vector<float>> alphas;
    sphereViews(0.5, 32, cameras, alphas);
    for (auto& a : alphas) std::fill(a.begin(), a.end(), 0.0f);
    const VisualHull hull = carveVisualHull(cameras, alphas, 24);
    CHECK(hull.surface.empty());
    for (const SurfacePoint& p : sampleHull(hull, 100, 1))
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

TEST_CASE("training lowers the loss, densify respects the cap and keeps everything finite")
{
    Trainer trainer = sphereTrainer(200, 300);
    std::vector<Camera> cameras;
    std::vector<std::vector<float>> alphas;
    sphereViews(0.5, 64, cameras, alphas);
    Light light;
    light.position = {0, 2, 4}, light.intensity = glm::vec3(20);
    const auto error = [&] {
        const PreparedImage image = disc(cameras[3], alphas[3]);
        const PreparedImage* reference = &image;
        std::vector<float> planes, gradient;
        trainer.render(cameras[3], std::span(&light, 1), planes);
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

TEST_CASE("a split keeps the picture: no pixel changes much")
{
    Trainer trainer = sphereTrainer(400, 800);
    train(trainer, 1, 48);
    std::vector<Camera> cameras;
    std::vector<std::vector<float>> alphas;
    sphereViews(0.5, 64, cameras, alphas);
    Light light;
    light.position = {0, 2, 4}, light.intensity = glm::vec3(20);
    std::vector<float> before, after;
    trainer.render(cameras[0], std::span(&light, 1), before);
    trainer.densify(200);
    REQUIRE(trainer.count() == 600);
    trainer.render(cameras[0], std::span(&light, 1), after);
    double sum = 0, scale = 0;
    for (size_t i = 0; i < before.size(); ++i) sum += std::abs(before[i] - after[i]), scale += std::abs(before[i]);
    CHECK(sum < 0.1 * scale); // half of the splats were split
}

TEST_CASE("a checkpoint continues to the same bytes, and a damaged or foreign one is refused")
{
    const std::string path = (std::filesystem::temp_directory_path() / "nacre_test_checkpoint").string();
    Trainer trainer = sphereTrainer(150, 300);
    train(trainer, 1, 20);
    trainer.densify(30);
    REQUIRE(bool(writeCheckpoint(path, {77, 20, 1.5}, trainer)));
    train(trainer, 21, 40);

    Trainer resumed = sphereTrainer(100, 300);
    auto header = readCheckpoint(path, 77, resumed);
    REQUIRE(bool(header));
    CHECK(header->step == 20);
    train(resumed, 21, 40);
    CHECK(state(resumed) == state(trainer));

    CHECK_FALSE(bool(readCheckpoint(path, 78, resumed)));
    std::vector<char> bytes(std::filesystem::file_size(path));
    std::ifstream(path, std::ios::binary).read(bytes.data(), std::streamsize(bytes.size()));
    for (size_t cut : {size_t(0), size_t(10), bytes.size() / 2, bytes.size() - 1}) {
        std::ofstream(path, std::ios::binary).write(bytes.data(), std::streamsize(cut));
        CHECK_FALSE(bool(readCheckpoint(path, 77, resumed)));
    }
    bytes[bytes.size() / 2] ^= 1;
    std::ofstream(path, std::ios::binary).write(bytes.data(), std::streamsize(bytes.size()));
    CHECK_FALSE(bool(readCheckpoint(path, 77, resumed)));
    std::filesystem::remove(path);
}
