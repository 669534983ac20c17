// The plan of the stage.
//
// Cameras of train: a spherical Fibonacci lattice with each point moved at random within its own band of height, equal areas, so that any
// number of them covers the region evenly. Their lights are dealt from shuffled decks of the whole stage: every light is used equally often
// (to within one) and no camera gets a light twice.
// Held-out cameras and lights: the best of kCandidates random directions, the one farthest from those of train and from the held-out ones
// before it. None can then coincide with one of train, and a few of them cover the region.
#include "light_stage/stage_plan.h"

#include "base/hash.h"
#include "base/random.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace nacre {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kCandidates = 16;

/// Sines of the elevations between which directions lie.
struct Band {
    double low, high;
};

double sine(double degrees) { return std::sin(degrees * kPi / 180.0); }

// Never straight up or down: a camera there has no upright picture, and rings need some circumference.
Band trainCameraBand(const StageOptions& o) { return {sine(o.fullSphere ? -75 : -9), sine(75)}; }
Band testCameraBand(const StageOptions& o) { return {sine(o.fullSphere ? -65 : 0), sine(60)}; }
constexpr double kLowestLight = 5, kHighestLight = 86; // degrees
Band lightBand(const StageOptions& o) { return {sine(o.fullSphere ? -kHighestLight : kLowestLight), sine(kHighestLight)}; }

glm::dvec3 direction(double z, double azimuth)
{
    const double r = std::sqrt(std::max(0.0, 1.0 - z * z));
    return {r * std::cos(azimuth), r * std::sin(azimuth), z};
}

double uniform(Random& random) { return double(random.next() >> 11) * 0x1p-53; }

/// One stream per split and purpose, so that no split changes when another does.
Random randomFor(const StageOptions& options, const std::string& purpose)
{
    return Random(options.seed, fnv1a(purpose.data(), purpose.size()));
}

std::vector<glm::dvec3> trainCameraDirections(const StageOptions& options)
{
    Random random = randomFor(options, "train cameras");
    const Band band = trainCameraBand(options);
    const double turn = uniform(random);
    std::vector<glm::dvec3> out;
    for (int i = 0; i < options.cameras; ++i) {
        const double z = band.high - (band.high - band.low) * (i + uniform(random)) / options.cameras;
        out.push_back(direction(z, 2.0 * kPi * std::fmod(turn + i * (std::numbers::phi - 1.0), 1.0)));
    }
    return out;
}

/// Rows at the given sines of elevation, `count` lights shared out evenly among them, the lowest rows first served.
std::vector<glm::dvec3> inRows(const std::vector<double>& rows, int count, bool stagger)
{
    std::vector<glm::dvec3> out;
    const int n = int(rows.size());
    for (int r = 0; r < n; ++r) {
        const int inRow = count / n + (r < count % n);
        const double offset = stagger && r % 2 == 0 ? 0.5 : 0.0;
        for (int i = 0; i < inRow; ++i) out.push_back(direction(rows[size_t(r)], 2.0 * kPi * (i + offset) / inRow));
    }
    return out;
}

std::vector<glm::dvec3> stageLightDirections(const StageOptions& options)
{
    const int n = options.lights;
    const Band band = lightBand(options);
    if (options.layout == StageLayout::kFibonacci) {
        std::vector<glm::dvec3> out;
        for (int i = 0; i < n; ++i)
            out.push_back(direction(band.high - (band.high - band.low) * (i + 0.5) / n, 2.0 * kPi * std::fmod(i * (std::numbers::phi - 1.0), 1.0)));
        return out;
    }
    // 112 lights on the upper half: 7 rings of 16; a full sphere has twice the height, so its rings are more and shorter.
    const double rowShare = (options.fullSphere ? 2.0 : 1.0) * 7.0 / 16.0;
    const int rows = std::clamp(int(std::lround(std::sqrt(n * rowShare))), 1, n);
    std::vector<double> sines;
    for (int r = 0; r < rows; ++r) {
        const double low = options.fullSphere ? -kHighestLight : kLowestLight, middle = 0.5 * (low + kHighestLight);
        if (options.layout == StageLayout::kRings) sines.push_back(sine(rows > 1 ? low + (kHighestLight - low) * r / (rows - 1) : middle));
        else sines.push_back(band.low + (band.high - band.low) * (r + 0.5) / rows);
    }
    return inRows(sines, n, options.layout == StageLayout::kRings);
}

/// `count` directions away from `known` and from each other.
std::vector<glm::dvec3> heldOutDirections(Random random, Band band, int count, std::vector<glm::dvec3> known)
{
    std::vector<glm::dvec3> out;
    for (int i = 0; i < count; ++i) {
        glm::dvec3 best(0.0);
        double bestDistance = -1.0;
        for (int c = 0; c < kCandidates; ++c) {
            const double z = band.low + (band.high - band.low) * uniform(random);
            const glm::dvec3 d = direction(z, 2.0 * kPi * uniform(random));
            double nearest = 4.0;
            for (const glm::dvec3& k : known) nearest = std::min(nearest, glm::dot(k - d, k - d));
            if (nearest > bestDistance) best = d, bestDistance = nearest;
        }
        out.push_back(best);
        known.push_back(best);
    }
    return out;
}

/// For each camera the lights that shine on it, ascending.
std::vector<std::vector<int>> dealLights(const StageOptions& options)
{
    Random random = randomFor(options, "train lights");
    const int perCamera = options.lightsPerCamera > 0 ? options.lightsPerCamera : options.lights;
    std::vector<std::vector<int>> out(size_t(options.cameras));
    std::vector<int> deck; // the next card is the last
    for (std::vector<int>& hand : out) {
        std::vector<int> putBack; // cards of a new deck that the hand already has
        while (int(hand.size()) < perCamera) {
            if (deck.empty()) {
                deck.resize(size_t(options.lights));
                std::iota(deck.begin(), deck.end(), 0);
                for (size_t i = deck.size(); i > 1; --i) std::swap(deck[i - 1], deck[random.below(uint32_t(i))]);
            }
            const int card = deck.back();
            deck.pop_back();
            const bool has = std::find(hand.begin(), hand.end(), card) != hand.end();
            (has ? putBack : hand).push_back(card);
        }
        deck.insert(deck.end(), putBack.begin(), putBack.end());
        std::sort(hand.begin(), hand.end());
    }
    return out;
}

struct Stage {
    const StageOptions& options;
    double focalPixels;
    std::vector<glm::dvec3> trainCameras, lights; // directions

    Camera camera(const glm::dvec3& d) const
    {
        const double distance = options.cameraDistance * options.objectRadius;
        return lookAt(options.center + distance * d, options.center, options.width, options.height, focalPixels);
    }
    /// `radius` in multiples of the object's; the light gives `irradiance` at the object's centre.
    Light point(const glm::dvec3& d, double radius, double irradiance) const
    {
        const double r = radius * options.objectRadius;
        Light light;
        light.position = glm::vec3(options.center + r * d);
        light.intensity = glm::vec3(float(irradiance * r * r));
        return light;
    }
    std::vector<glm::dvec3> newCameras(const std::string& split, int count) const
    {
        return heldOutDirections(randomFor(options, split + " cameras"), testCameraBand(options), count, trainCameras);
    }
    std::vector<glm::dvec3> newLights(const std::string& split, int count) const
    {
        return heldOutDirections(randomFor(options, split + " lights"), lightBand(options), count, lights);
    }
};

OlatSplit planTrain(const Stage& stage)
{
    OlatSplit split;
    const auto hands = dealLights(stage.options);
    for (size_t c = 0; c < stage.trainCameras.size(); ++c) {
        split.cameras.push_back(stage.camera(stage.trainCameras[c]));
        for (const int l : hands[c])
            split.images.push_back({uint32_t(c), stage.point(stage.lights[size_t(l)], stage.options.lightRadius, kIrradiance), ""});
    }
    return split;
}

OlatSplit planAllOn(const Stage& stage)
{
    OlatSplit split;
    Light all;
    all.type = LightType::kGroup;
    std::vector<Light> group;
    for (const glm::dvec3& d : stage.lights)
        group.push_back(stage.point(d, stage.options.lightRadius, kIrradiance * kAllOnGain / double(stage.lights.size())));
    all.group = std::make_shared<const std::vector<Light>>(std::move(group));
    const size_t train = stage.trainCameras.size(), count = std::min<size_t>(kAllOnCameras, train);
    for (size_t i = 0; i < count; ++i) {
        split.cameras.push_back(stage.camera(stage.trainCameras[(2 * i + 1) * train / (2 * count)]));
        split.images.push_back({uint32_t(i), all, ""});
    }
    return split;
}

/// One image per camera, under a light that `lightOf(direction, index)` makes.
template <class LightOf>
OlatSplit planPairs(const Stage& stage, const std::string& name, int count, LightOf lightOf)
{
    OlatSplit split;
    const auto cameras = stage.newCameras(name, count), lights = stage.newLights(name, count);
    for (size_t i = 0; i < cameras.size(); ++i) {
        split.cameras.push_back(stage.camera(cameras[i]));
        split.images.push_back({uint32_t(i), lightOf(lights[i], int(i)), ""});
    }
    return split;
}

OlatSplit planSplit(const Stage& stage, const std::string& name)
{
    const StageOptions& o = stage.options;
    if (name == "train") return planTrain(stage);
    if (name == "all_on") return planAllOn(stage);
    if (name == "test")
        return planPairs(stage, name, kTestImages, [&](const glm::dvec3& d, int) { return stage.point(d, o.lightRadius, kIrradiance); });
    if (name == "near")
        return planPairs(stage, name, kNearImages, [&](const glm::dvec3& d, int i) {
            const double farthest = std::max(kNearestLight, kFarthestNear * o.lightRadius);
            return stage.point(d, kNearestLight + (farthest - kNearestLight) * i / (kNearImages - 1), kNearIrradiance);
        });
    if (name == "directional")
        return planPairs(stage, name, kDirectionalImages, [&](const glm::dvec3& d, int) {
            Light light;
            light.type = LightType::kDirectional;
            light.directionToLight = glm::vec3(d);
            light.intensity = glm::vec3(float(kIrradiance));
            return light;
        });
    assert(name == "environment" && !o.environments.empty());
    return planPairs(stage, name, kEnvironmentImages, [&](const glm::dvec3&, int i) {
        Light light;
        light.type = LightType::kEnvironment;
        light.environmentPath = o.environments[size_t(i) % o.environments.size()];
        return light;
    });
}

} // namespace

double stageFocalPixels(const StageOptions& o)
{
    if (o.fovDegrees > 0) return 0.5 * o.width / std::tan(0.5 * o.fovDegrees * kPi / 180.0);
    const double d = o.cameraDistance, tanOfSphere = 1.0 / std::sqrt(d * d - 1.0);
    return 0.5 * std::min(o.width, o.height) * kFill / tanOfSphere;
}

const std::vector<std::string>& stageSplits()
{
    static const std::vector<std::string> kSplits{"train", "test", "near", "directional", "environment", "all_on"};
    return kSplits;
}

Status checkStage(const StageOptions& o)
{
    const auto bad = [](const std::string& what) { return Error{ErrorCode::kBadInput, what}; };
    if (o.cameras < 1 || o.lights < 1) return bad("a stage needs at least one camera and one light");
    if (o.lightsPerCamera > o.lights)
        return bad("--lights-per-camera " + std::to_string(o.lightsPerCamera) + ": the stage has only " + std::to_string(o.lights) +
                   " lights; use fewer, or 'all'");
    if (!(o.lightRadius >= kNearestLight / kFarthestNear)) return bad("--radius: expected 2 or more object radii, so that lights stay outside the object");
    if (!(o.cameraDistance > 1.0)) return bad("--camera-distance: expected more than 1 object radius, so that cameras stay outside the object");
    return ok();
}

OlatDataset planStage(const StageOptions& options, const std::vector<std::string>& splits)
{
    assert(checkStage(options));
    const Stage stage{options, stageFocalPixels(options), trainCameraDirections(options), stageLightDirections(options)};
    OlatDataset dataset;
    dataset.up = {0, 0, 1};
    for (const std::string& name : stageSplits()) {
        if (std::find(splits.begin(), splits.end(), name) == splits.end()) continue;
        dataset.splits.push_back(planSplit(stage, name));
        dataset.splits.back().name = name;
    }
    return dataset;
}

Camera lookAt(const glm::dvec3& position, const glm::dvec3& target, int width, int height, double focal)
{
    Camera camera;
    camera.width = width, camera.height = height;
    camera.fx = camera.fy = focal;
    camera.cx = 0.5 * width, camera.cy = 0.5 * height;
    const glm::dvec3 z = glm::normalize(position - target), x = glm::normalize(glm::cross(glm::dvec3(0, 0, 1), z)), y = glm::cross(z, x);
    camera.worldFromCamera = glm::dmat4(glm::dvec4(x, 0), glm::dvec4(y, 0), glm::dvec4(z, 0), glm::dvec4(position, 1));
    return camera;
}

} // namespace nacre
