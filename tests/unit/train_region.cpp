// Images without masks: where the object is, what it stands on, where splats start, and what is cut off in the end.
#include "dataset_support.h"

#include "base/color.h"
#include "base/random.h"
#include "splat/stereo.h"
#include "train/bake.h"
#include "train/object_region.h"

#include <atomic>

using namespace nacre;

namespace {

constexpr double kTable = -0.4; // height of the table that a ball of radius 0.4 stands on

/// Something that no two places share.
double texture(const glm::dvec3& p) { return 0.35 + 0.1 * std::sin(17 * p.x + 5 * p.z) + 0.1 * std::sin(13 * p.y - 7 * p.z + 3 * p.x) + 0.1 * std::sin(23 * p.z + 11 * p.x * p.y); }

/// The ball on its table under a lamp at the eye; no alpha.
Image photograph(const Camera& camera)
{
    Image image{camera.width, camera.height, {}};
    const glm::dvec3 eye = camera.position();
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            const glm::dvec3 d = pixelRay(camera, x + 0.5, y + 0.5);
            const double b = glm::dot(eye, d), c = glm::dot(eye, eye) - 0.16, disc = b * b - c, table = d.z < 0 ? (kTable - eye.z) / d.z : 1e9;
            const double ball = disc > 0 ? -b - std::sqrt(disc) : 1e9;
            const bool isBall = ball < table;
            const glm::dvec3 p = eye + std::min(ball, table) * d;
            const glm::dvec3 n = isBall ? p / 0.4 : glm::dvec3(0, 0, 1);
            const double far = std::min(ball, table), light = far < 50 ? texture(p) * glm::dot(n, -d) * 6 / (far * far) : 0;
            image.rgba.insert(image.rgba.end(), {float(light), float(isBall ? 0.5 * light : light), float(0.7 * light), 1.0f});
        }
    return image;
}

Camera viewer(int i, int size)
{
    const double a = 0.55 * i, e = 0.45 + 0.12 * (i % 4);
    Camera camera = lookAtOrigin(2.4 * glm::dvec3(std::cos(a) * std::cos(e), std::sin(a) * std::cos(e), std::sin(e)), size);
    camera.fx = camera.fy = 1.6 * size;
    return camera;
}

std::vector<Camera> viewers(int count, int size)
{
    std::vector<Camera> cameras;
    for (int i = 0; i < count; ++i) cameras.push_back(viewer(i, size));
    return cameras;
}

/// Points of the ball that a camera may see, and of the table around it.
std::vector<glm::vec3> surface(bool withTable)
{
    std::vector<glm::vec3> points;
    Random random(7);
    for (int i = 0; i < 4000; ++i) {
        const float z = 1.8f * random.uniform() - 0.8f, a = 6.2831853f * random.uniform(), r = std::sqrt(1 - z * z);
        points.push_back(0.4f * glm::vec3(r * std::cos(a), r * std::sin(a), z));
        if (withTable) points.push_back({3 * random.uniform() - 1.5f, 3 * random.uniform() - 1.5f, float(kTable) + 0.004f * (random.uniform() - 0.5f)});
    }
    return points;
}

} // namespace

TEST_CASE("points that stereo finds lie on the surfaces that the images show")
{
    std::vector<StereoView> views;
    for (const Camera& camera : viewers(14, 64)) {
        const Image image = photograph(camera);
        StereoView view{camera, {}};
        for (size_t i = 0; i < image.rgba.size(); i += 4) view.luma.push_back(srgbFromLinear(std::min(1.0f, 0.5f * (image.rgba[i] + image.rgba[i + 1]))));
        views.push_back(std::move(view));
    }
    const std::vector<glm::vec3> points = stereoPoints(views, glm::vec3(0), 0.75f);
    REQUIRE(points.size() > 300);
    size_t right = 0;
    for (const glm::vec3& p : points) right += std::min(std::abs(double(glm::length(p)) - 0.4), std::abs(double(p.z) - kTable)) < 0.05;
    CHECK(double(right) > 0.75 * double(points.size())); // the far table is seen at a flat angle
    CHECK(stereoPoints(views, glm::vec3(0), 0.75f, [] { return false; }).empty());
}

TEST_CASE("the plane that the object stands on is found; an object that floats has none")
{
    const std::vector<Camera> cameras = viewers(12, 32);
    const ObjectRegion region{glm::vec3(0), 0.75f, {}};
    const auto plane = supportingPlane(surface(true), region, cameras);
    REQUIRE(plane);
    CHECK(plane->z > 0.999);
    CHECK(plane->w == doctest::Approx(kTable).epsilon(0.01));
    CHECK_FALSE(supportingPlane(surface(false), region, cameras));
    CHECK_FALSE(supportingPlane({}, region, cameras));
}

TEST_CASE("the cut leaves no splat outside of the bounds, on the plane or below it, nor far from the object; and leaves the object")
{
    SplatCloud cloud;
    const auto add = [&](const glm::vec3& p) {
        cloud.positions.push_back(p), cloud.scales.push_back(glm::vec3(0.02f)), cloud.rotations.push_back(glm::quat(1, 0, 0, 0)), cloud.opacities.push_back(0.9f);
    };
    for (const glm::vec3& p : surface(true)) add(p);
    const size_t scene = cloud.positions.size();
    add({0.1f, 0.1f, 0.7f}); // a floater
    add({0, 0, -0.6f});
    add({5, 0, 3});
    cloud.count = cloud.positions.size();
    const ObjectCut cut = findObject(cloud, {glm::vec3(0), 0.75f, {}}, viewers(12, 32));
    REQUIRE(cut.plane);
    size_t object = 0, kept = 0;
    for (size_t i = 0; i < scene; ++i) {
        const bool isObject = i % 2 == 0 && cloud.positions[i].z > -0.37f;
        object += isObject, kept += isObject && cut.kept[i];
        if (i % 2 == 1) CHECK_FALSE(cut.kept[i]);
    }
    CHECK(kept == object);
    for (size_t i = scene; i < cloud.count; ++i) CHECK_FALSE(cut.kept[i]);
    CHECK(cut.loose == 1);
}

TEST_CASE("every model: a small bake without masks has its splats at the object, above its table; told so, it keeps everything")
{
    for (const char* model : {"bigs", "sss"}) {
        CAPTURE(model);
        TempFolder folder;
        OlatDataset dataset;
        dataset.backgroundInView = true;
        dataset.splits = {{"train", {}, {}}};
        OlatSplit& split = dataset.splits[0];
        for (const Camera& camera : viewers(14, 64)) {
            const std::string path = folder.file(std::to_string(split.images.size()) + ".exr");
            REQUIRE(writeExr(photograph(camera), path));
            Light light;
            light.position = glm::vec3(camera.position());
            light.intensity = glm::vec3(6.0f);
            split.images.push_back({uint32_t(split.cameras.size()), light, path});
            split.cameras.push_back(camera);
        }
        BakeOptions options;
        options.model = model;
        options.quality = "draft";
        options.iterations = 120;
        options.maxSplats = 1200;
        const auto result = bake(dataset, options, nullptr, nullptr);
        if (!result) FAIL(result.error().message);
        CHECK(result->cut.find("by masks that these cover") != std::string::npos);
        REQUIRE(result->asset.cloud.count > 100);
        size_t near = 0;
        for (const glm::vec3& p : result->asset.cloud.positions) {
            CHECK(glm::length(p) < 0.8);
            CHECK(p.z > kTable);
            near += glm::length(p) < 0.5;
        }
        CHECK(double(near) > 0.7 * double(result->asset.cloud.count));
        // Stopped after its masks were learnt, and resumed: the same.
        options.checkpointPath = folder.file("a.ckpt");
        std::atomic<bool> stop = false;
        CHECK_FALSE(bake(dataset, options, [&](const BakeProgress& p) { stop = stop || p.stage == "masks"; }, &stop)); // gives up, and learns them once more
        stop = false;
        options.resume = true;
        bool masked = false;
        CHECK_FALSE(bake(dataset, options, [&](const BakeProgress& p) { masked = masked || p.stage == "masks", stop = masked && p.stage == "training"; }, &stop));
        BakeOptions other = options; // would never have cut anything
        other.keepBackground = true;
        CHECK_FALSE(bake(dataset, other, nullptr, nullptr));
        const auto rest = bake(dataset, options, nullptr, nullptr);
        REQUIRE_MESSAGE(rest, (rest ? "" : rest.error().message));
        CHECK(rest->asset.cloud.positions == result->asset.cloud.positions);
        options.checkpointPath.clear(), options.resume = false;
        options.keepBackground = true;
        const auto all = bake(dataset, options, nullptr, nullptr);
        BakeOptions held = options; // scores of surroundings and object, then of the object alone
        held.keepBackground = false, held.heldOutJudges = true;
        CHECK_FALSE(bake(dataset, held, nullptr, nullptr));
        REQUIRE(all);
        CHECK(all->cut.empty());
        CHECK(all->asset.cloud.count > result->asset.cloud.count);
        options.bounds = glm::dvec4(0, 0, 0, 0.3);
        options.keepBackground = false;
        const auto tight = bake(dataset, options, nullptr, nullptr);
        REQUIRE(tight);
        for (const glm::vec3& p : tight->asset.cloud.positions) CHECK(glm::length(p) <= 0.301);
    }
}
