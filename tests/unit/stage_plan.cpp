// The plan of the stage, and where a mesh stands on it.
#include "light_stage/placement.h"
#include "light_stage/stage_plan.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <tuple>

using namespace nacre;

namespace {

StageOptions defaults()
{
    StageOptions options;
    options.environments = {"a.exr", "b.exr"};
    return options;
}

OlatDataset planOf(const StageOptions& options) { return planStage(options, stageSplits()); }

double elevation(const glm::dvec3& v) { return std::asin(v.z / glm::length(v)) * 180 / std::numbers::pi; }
double angle(const glm::dvec3& a, const glm::dvec3& b)
{
    return std::acos(std::fmin(glm::dot(glm::normalize(a), glm::normalize(b)), 1.0)) * 180 / std::numbers::pi;
}

using LightKey = std::tuple<float, float, float>;
LightKey keyOf(const Light& l) { return {l.position.x, l.position.y, l.position.z}; }

std::map<LightKey, int> usesOfLights(const OlatSplit& split)
{
    std::map<LightKey, int> uses;
    for (const OlatImage& image : split.images) uses[keyOf(image.light)]++;
    return uses;
}

bool samePlan(const OlatSplit& a, const OlatSplit& b)
{
    if (a.cameras.size() != b.cameras.size() || a.images.size() != b.images.size()) return false;
    for (size_t i = 0; i < a.cameras.size(); ++i)
        if (a.cameras[i].worldFromCamera != b.cameras[i].worldFromCamera || a.cameras[i].fx != b.cameras[i].fx) return false;
    for (size_t i = 0; i < a.images.size(); ++i) {
        const Light &l = a.images[i].light, &m = b.images[i].light;
        if (a.images[i].camera != b.images[i].camera || l.position != m.position || l.directionToLight != m.directionToLight ||
            l.intensity != m.intensity || l.environmentPath != m.environmentPath)
            return false;
    }
    return true;
}

} // namespace

TEST_CASE("the default stage has the numbers, distances and exposure of the reference data")
{
    const OlatDataset plan = planOf(defaults());
    const std::map<std::string, std::pair<size_t, size_t>> expected{{"train", {75, 300}}, {"test", {24, 24}}, {"near", {6, 6}},
                                                                    {"directional", {6, 6}}, {"environment", {6, 6}}, {"all_on", {12, 12}}};
    REQUIRE(plan.splits.size() == expected.size());
    for (const OlatSplit& split : plan.splits) {
        INFO(split.name);
        CHECK(split.cameras.size() == expected.at(split.name).first);
        CHECK(split.images.size() == expected.at(split.name).second);
        for (const Camera& camera : split.cameras) {
            CHECK(glm::length(camera.position()) == doctest::Approx(3.2));
            CHECK(glm::dot(glm::dvec3(camera.worldFromCamera[2]), glm::normalize(camera.position())) == doctest::Approx(1.0)); // looks at the origin
            CHECK(glm::dvec3(camera.worldFromCamera[1]).z > 0.0);
            CHECK(glm::dvec3(camera.worldFromCamera[0]).z == doctest::Approx(0.0)); // upright
            CHECK(glm::determinant(glm::dmat3(camera.worldFromCamera)) == doctest::Approx(1.0));
            CHECK(2 * std::atan(0.5 * 256 / camera.fx) == doctest::Approx(0.6911).epsilon(1e-3));
        }
    }
    for (const char* name : {"train", "test"})
        for (const OlatImage& image : plan.find(name)->images) {
            CHECK(glm::length(image.light.position) == doctest::Approx(5.0));
            CHECK(image.light.intensity.x == doctest::Approx(60.0));
        }
    double nearest = 9, farthest = 0;
    for (const OlatImage& image : plan.find("near")->images) {
        const double r = glm::length(image.light.position);
        nearest = std::min(nearest, r), farthest = std::max(farthest, r);
        CHECK(image.light.intensity.y == doctest::Approx(3.6 * r * r));
    }
    CHECK(nearest == doctest::Approx(1.6));
    CHECK(farthest == doctest::Approx(4.0));
    for (const OlatImage& image : plan.find("directional")->images) {
        CHECK(glm::length(image.light.directionToLight) == doctest::Approx(1.0));
        CHECK(image.light.intensity.z == doctest::Approx(2.4));
    }
    const std::vector<OlatImage>& environment = plan.find("environment")->images;
    for (size_t i = 0; i < environment.size(); ++i) CHECK(environment[i].light.environmentPath == (i % 2 ? "b.exr" : "a.exr"));
}

TEST_CASE("every train light is used equally often, to within one, and never twice by a camera")
{
    for (const auto& [cameras, lights, perCamera] : {std::tuple{75, 112, 4}, {10, 7, 5}, {3, 4, 0}, {1, 1, 1}, {40, 9, 9}}) {
        INFO(cameras << " cameras, " << lights << " lights, " << perCamera << " per camera");
        StageOptions options = defaults();
        options.cameras = cameras, options.lights = lights, options.lightsPerCamera = perCamera;
        REQUIRE(checkStage(options));
        const OlatSplit train = *planOf(options).find("train");
        const int each = perCamera ? perCamera : lights;
        CHECK(train.images.size() == size_t(cameras * each));
        std::vector<std::set<LightKey>> ofCamera(train.cameras.size());
        for (const OlatImage& image : train.images) CHECK(ofCamera[image.camera].insert(keyOf(image.light)).second);
        int least = cameras * each, most = 0;
        const auto uses = usesOfLights(train);
        if (cameras * each >= lights) CHECK(uses.size() == size_t(lights));
        for (const auto& [light, count] : uses) least = std::min(least, count), most = std::max(most, count);
        CHECK(most - least <= 1);
    }
}

TEST_CASE("held-out cameras and lights are new: none within a degree of one of train")
{
    for (uint64_t seed = 1; seed <= 5; ++seed) {
        StageOptions options = defaults();
        options.seed = seed;
        const OlatDataset plan = planOf(options);
        const OlatSplit& train = *plan.find("train");
        for (const char* name : {"test", "near", "directional", "environment"})
            for (const OlatImage& image : plan.find(name)->images) {
                const OlatSplit& split = *plan.find(name);
                for (const Camera& camera : train.cameras) CHECK(angle(camera.position(), split.cameras[image.camera].position()) > 1.0);
                if (!image.light.isPunctual()) continue;
                const glm::dvec3 towards(image.light.type == LightType::kPoint ? image.light.position : image.light.directionToLight);
                for (const OlatImage& other : train.images) CHECK(angle(towards, glm::dvec3(other.light.position)) > 1.0);
            }
    }
}

TEST_CASE("a seed gives one plan; another seed moves every split; splits do not depend on which others are made")
{
    const StageOptions options = defaults();
    StageOptions other = options;
    other.seed = 2;
    const OlatDataset a = planOf(options), b = planOf(options), c = planOf(other);
    for (size_t s = 0; s < a.splits.size(); ++s) {
        INFO(a.splits[s].name);
        CHECK(samePlan(a.splits[s], b.splits[s]));
        CHECK_FALSE(samePlan(a.splits[s], c.splits[s]));
        const OlatDataset alone = planStage(options, {a.splits[s].name});
        REQUIRE(alone.splits.size() == 1);
        CHECK(samePlan(alone.splits[0], a.splits[s]));
    }
}

TEST_CASE("upper: lights above the horizon, cameras to just below it; full: the same share below as above")
{
    StageOptions options = defaults();
    options.lightsPerCamera = 0;
    for (const OlatSplit& split : planOf(options).splits)
        for (const OlatImage& image : split.images) {
            CHECK(elevation(split.cameras[image.camera].position()) > -9.01);
            if (image.light.type == LightType::kPoint) CHECK(elevation(glm::dvec3(image.light.position)) > 4.99);
            if (image.light.type == LightType::kDirectional) CHECK(elevation(glm::dvec3(image.light.directionToLight)) > 4.99);
        }
    options.fullSphere = true;
    for (const StageLayout layout : {StageLayout::kRings, StageLayout::kFibonacci, StageLayout::kGrid}) {
        options.layout = layout;
        const OlatDataset plan = planOf(options);
        const OlatSplit& train = *plan.find("train");
        int below = 0;
        for (const auto& [light, uses] : usesOfLights(train)) below += std::get<2>(light) < -1e-4f;
        CHECK(below >= 45);
        CHECK(below <= 60);
        below = 0;
        for (const Camera& camera : train.cameras) below += camera.position().z < 0;
        CHECK(below >= 35);
        CHECK(below <= 40);
    }
}

TEST_CASE("every layout has the asked number of distinct lights and leaves no large gap")
{
    for (const StageLayout layout : {StageLayout::kRings, StageLayout::kFibonacci, StageLayout::kGrid})
        for (const int lights : {1, 2, 13, 112, 400}) {
            INFO("layout " << int(layout) << ", " << lights << " lights");
            StageOptions options = defaults();
            options.layout = layout, options.lights = lights, options.lightsPerCamera = 0, options.cameras = 1;
            const auto uses = usesOfLights(*planOf(options).find("train"));
            CHECK(uses.size() == size_t(lights));
            if (lights < 112) continue;
            // a hemisphere shared out evenly gives each light a cap of this radius; twice that is a gap
            const double cap = std::acos(1.0 - 1.0 / lights) * 180 / std::numbers::pi;
            double widest = 0;
            for (int i = 0; i < 500; ++i) {
                const double z = std::sin(6 * std::numbers::pi / 180) + 0.85 * (i + 0.5) / 500, r = std::sqrt(1 - z * z), phi = 2.4 * i;
                const glm::dvec3 d(r * std::cos(phi), r * std::sin(phi), z);
                double nearest = 180;
                for (const auto& [key, count] : uses) nearest = std::min(nearest, angle(d, glm::dvec3(std::get<0>(key), std::get<1>(key), std::get<2>(key))));
                widest = std::max(widest, nearest);
            }
            CHECK(widest < 2.3 * cap);
        }
}

TEST_CASE("the default stage is 7 rings of 16 lights")
{
    StageOptions options = defaults();
    options.lightsPerCamera = 0;
    std::map<long, int> rings;
    for (const auto& [key, count] : usesOfLights(*planOf(options).find("train")))
        rings[std::lround(10 * elevation({std::get<0>(key), std::get<1>(key), std::get<2>(key)}))]++;
    const std::map<long, int> expected{{50, 16}, {185, 16}, {320, 16}, {455, 16}, {590, 16}, {725, 16}, {860, 16}};
    CHECK(rings == expected);
}

TEST_CASE("all_on: train cameras, every light of the stage, together about as bright as two lights")
{
    const OlatDataset plan = planOf(defaults());
    const OlatSplit& train = *plan.find("train");
    for (const OlatImage& image : plan.find("all_on")->images) {
        const glm::dmat4& pose = plan.find("all_on")->cameras[image.camera].worldFromCamera;
        CHECK(std::count_if(train.cameras.begin(), train.cameras.end(), [&](const Camera& c) { return c.worldFromCamera == pose; }) == 1);
        REQUIRE(image.light.type == LightType::kGroup);
        CHECK(image.light.group->size() == 112);
        double sum = 0;
        for (const Light& light : *image.light.group) {
            CHECK(usesOfLights(train).count(keyOf(light)) == 1);
            sum += double(light.intensity.x);
        }
        CHECK(sum == doctest::Approx(120.0));
        break; // all share one group
    }
}

TEST_CASE("distances and intensities grow with the object, and the plan moves with its centre")
{
    StageOptions unit = defaults(), large = defaults();
    large.objectRadius = 3.0;
    large.center = {1, -2, 0.5};
    const OlatDataset a = planOf(unit), b = planOf(large);
    for (size_t s = 0; s < a.splits.size(); ++s)
        for (size_t i = 0; i < a.splits[s].images.size(); ++i) {
            const OlatImage &x = a.splits[s].images[i], &y = b.splits[s].images[i];
            const glm::dvec3 c = a.splits[s].cameras[x.camera].position(), moved = b.splits[s].cameras[y.camera].position();
            CHECK(glm::distance(moved, large.center + 3.0 * c) < 1e-12);
            if (x.light.type != LightType::kPoint) continue;
            CHECK(glm::distance(y.light.position, glm::vec3(large.center) + 3.0f * x.light.position) < 1e-5f);
            CHECK(y.light.intensity.x == doctest::Approx(9.0 * double(x.light.intensity.x)));
        }
}

TEST_CASE("the default field of view holds the bounding sphere, whatever the distance and shape of the image")
{
    for (const double distance : {1.2, 3.2, 50.0})
        for (const auto& [width, height] : {std::pair{256, 256}, {300, 100}, {64, 512}}) {
            StageOptions options = defaults();
            options.cameraDistance = distance, options.width = width, options.height = height;
            const Camera camera = planOf(options).find("train")->cameras[0];
            const double radius = camera.fx / std::sqrt(distance * distance - 1), shorter = 0.5 * std::min(width, height);
            CHECK(radius < shorter);
            CHECK(radius > 0.9 * shorter);
        }
    StageOptions options = defaults();
    options.fovDegrees = 90, options.width = 200, options.height = 100;
    CHECK(planOf(options).find("train")->cameras[0].fx == doctest::Approx(100));
}

TEST_CASE("a stage that cannot be is refused with the option to change")
{
    const auto refused = [](auto change, const char* word) {
        StageOptions options = defaults();
        change(options);
        const Status status = checkStage(options);
        REQUIRE_FALSE(status);
        CHECK(status.error().message.find(word) != std::string::npos);
    };
    refused([](StageOptions& o) { o.lights = 3, o.lightsPerCamera = 4; }, "--lights-per-camera");
    refused([](StageOptions& o) { o.lightRadius = 1.5; }, "--radius");
    refused([](StageOptions& o) { o.lightRadius = NAN; }, "--radius");
    refused([](StageOptions& o) { o.cameraDistance = 1.0; }, "--camera-distance");
    refused([](StageOptions& o) { o.cameras = 0; }, "camera");
}

TEST_CASE("built-in environment maps are finite, positive and equally bright, the sunset warm low and blue above")
{
    for (const Image& map : {sunsetMap(), studioMap()}) {
        REQUIRE(map.width == 128);
        REQUIRE(map.height == 64);
        double sum = 0, area = 0;
        for (int y = 0; y < map.height; ++y)
            for (int x = 0; x < map.width; ++x) {
                const float* p = map.pixel(x, y);
                for (int c = 0; c < 3; ++c) CHECK_MESSAGE((p[c] > 0 && p[c] < 60000.0f), "texel ", x, " ", y); // fits a half
                const double weight = std::sin(std::numbers::pi * (y + 0.5) / map.height);
                sum += weight * (0.2126 * double(p[0]) + 0.7152 * double(p[1]) + 0.0722 * double(p[2]));
                area += weight;
            }
        CHECK(sum / area == doctest::Approx(0.5).epsilon(1e-4));
    }
    const Image sunset = sunsetMap();
    CHECK(sunset.pixel(100, 31)[0] > sunset.pixel(100, 31)[2]);
    CHECK(sunset.pixel(100, 0)[2] > sunset.pixel(100, 0)[0]);
}

TEST_CASE("a mesh is put upright on the stage, its bounding sphere onto the unit sphere")
{
    std::mt19937 random(3);
    std::normal_distribution<float> normal;
    MeshScene scene;
    scene.meshes.resize(2);
    for (int i = 0; i < 400; ++i) {
        const glm::vec3 d = glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
        TriangleMesh& mesh = scene.meshes[size_t(i % 2)];
        mesh.positions.push_back(glm::vec3(10, 4, -7) + 2.5f * d);
        mesh.normals.push_back(d);
        mesh.tangents.push_back(glm::vec4(d.z, d.x, d.y, -1));
    }
    scene.meshes[0].triangles.push_back({0, 1, 2});
    for (const glm::vec3 up : {glm::vec3(0, 1, 0), glm::vec3(0, 0, 1)}) {
        const Placement placement = placeMesh(scene, {}, up, true);
        CHECK(placement.unitsPerMetre == doctest::Approx(1 / 2.5).epsilon(0.02)); // 400 points do not quite span their sphere
        CHECK(placement.radius == 1.0);
        CHECK(glm::distance(glm::vec3(glm::normalize(glm::dvec3(placement.worldFromMesh * glm::dvec4(0, 1, 0, 0)))), up) < 1e-6f);
        MeshScene moved = scene;
        transformMesh(moved, placement);
        float farthest = 0;
        for (size_t m = 0; m < 2; ++m)
            for (size_t i = 0; i < moved.meshes[m].positions.size(); ++i) {
                farthest = std::max(farthest, glm::length(moved.meshes[m].positions[i]));
                CHECK(glm::length(moved.meshes[m].normals[i]) == doctest::Approx(1.0f));
                // points, normals and tangents turn alike
                const glm::vec3 n = scene.meshes[m].normals[i], turned = up.z > 0 ? glm::vec3(n.x, -n.z, n.y) : n;
                CHECK(glm::distance(moved.meshes[m].normals[i], turned) < 1e-5f);
                const glm::vec4 t = scene.meshes[m].tangents[i];
                CHECK(glm::distance(moved.meshes[m].tangents[i], up.z > 0 ? glm::vec4(t.x, -t.z, t.y, t.w) : t) < 1e-5f);
            }
        CHECK(farthest == doctest::Approx(1.0f).epsilon(1e-5));
    }
    const Placement kept = placeMesh(scene, {}, {0, 0, 1}, false);
    CHECK(glm::length(glm::dvec3(kept.worldFromMesh[0])) == 1.0);
    CHECK(kept.radius == doctest::Approx(2.5).epsilon(0.02));
    CHECK(glm::distance(kept.center, glm::dvec3(10, 7, 4)) < 0.1);
    HairStrands hair;
    hair.controlPoints = {{10, 6.5, -7, 0.1}, {10, 7, -7, 0.1}, {10, 8, -7, 0.1}, {10, 8.9, -7, 0.1}}; // 4.9 above the centre
    const Placement furry = placeMesh(scene, hair, {0, 0, 1}, true);
    CHECK(furry.unitsPerMetre == doctest::Approx(1 / 5.0).epsilon(0.02));
    transformHair(hair, furry);
    CHECK(hair.controlPoints[3].z + hair.controlPoints[3].w == doctest::Approx(1.0f).epsilon(1e-5));
    CHECK(hair.controlPoints[0].w == doctest::Approx(0.1f / 5).epsilon(0.02));
}

TEST_CASE("the bounding sphere is the smallest to within a per cent: a flat disc and a stick beside the box's own sphere")
{
    MeshScene scene;
    scene.meshes.resize(1);
    for (int i = 0; i < 360; ++i) {
        const float a = float(i) * 0.0174533f;
        scene.meshes[0].positions.push_back({std::cos(a), std::sin(a) * 0.8f, 0.6f * std::sin(a)}); // unit circle, tilted
    }
    scene.meshes[0].triangles.push_back({0, 1, 2});
    const double disc = placeMesh(scene, {}, {0, 1, 0}, false).radius;
    CHECK(disc >= 0.9999);
    CHECK(disc < 1.01);
    scene.meshes[0].positions = {{0, 0, 0}, {3, 4, 0}, {1, 1, 0}};
    CHECK(placeMesh(scene, {}, {0, 1, 0}, false).radius == doctest::Approx(2.5).epsilon(0.01));
}
