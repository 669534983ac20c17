#include "light_stage/capture_plan.h"

#include "base/hash.h"
#include "base/random.h"
#include "base/text.h"
#include "interchange/jpeg.h"
#include "interchange/png.h"
#include "light_stage/capture_camera.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <numbers>
#include <tuple>

namespace nacre {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kPi = std::numbers::pi, kDegree = kPi / 180.0;
constexpr double kFlashIrradiance = 1.6;  // at the object's centre from the usual distance: its front is nearer, and twice as bright
constexpr double kNearestPhone = 1.0, kFarthestPhone = 1.3;   // of the camera's distance
constexpr double kLowestPhone = 10, kHighestPhone = 75;       // degrees above the table
constexpr float kJpegWhite = 0.985f;       // compression leaves ripples where it was clipped
constexpr double kAimless = 0.06, kRoll = 4;                  // radii that the view misses the object's centre by; degrees; rms

/// Independent streams: no error changes when another one does.
Random streamFor(uint64_t seed, const std::string& purpose) { return Random(seed, fnv1a(purpose.data(), purpose.size())); }

double uniform(Random& random) { return double(random.next() >> 11) * 0x1p-53; }

double normal(Random& random)
{
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform(random)));
    return radius * std::cos(2.0 * kPi * uniform(random));
}

/// `count` random vectors whose lengths have this root mean square, mean 0 as far as their number allows.
template <int N>
std::vector<glm::vec<N, double>> errors(Random random, size_t count, double rms)
{
    using V = glm::vec<N, double>;
    std::vector<V> out(count);
    V mean(0.0);
    for (V& v : out) {
        for (int c = 0; c < N; ++c) v[c] = normal(random);
        mean += v / double(count);
    }
    double squares = 0;
    for (V& v : out) {
        if (count > 1) v -= mean;
        squares += glm::dot(v, v) / double(count);
    }
    for (V& v : out) v *= squares > 0 ? rms / std::sqrt(squares) : 0.0;
    return out;
}

/// By the angle |v| about v.
glm::dmat3 rotation(const glm::dvec3& v)
{
    const double angle = glm::length(v);
    if (!(angle > 0)) return glm::dmat3(1.0);
    const glm::dvec3 a = v / angle;
    const glm::dmat3 cross(0, a.z, -a.y, -a.z, 0, a.x, a.y, -a.x, 0);
    return glm::dmat3(1.0) + std::sin(angle) * cross + (1.0 - std::cos(angle)) * cross * cross;
}

double unitsPerCentimetre(const CaptureOptions& o, double radius) { return 2.0 * radius / o.size; }

/// In the plane of the picture, wherever the maker put it.
glm::dvec3 flashOffset(const CaptureOptions& o, double radius, uint64_t seed)
{
    Random random = streamFor(seed, "flash");
    const double angle = 2.0 * kPi * uniform(random);
    return o.flash * unitsPerCentimetre(o, radius) * glm::dvec3(std::cos(angle), std::sin(angle), 0.0);
}

std::string mattePath(uint32_t camera)
{
    char name[48];
    std::snprintf(name, sizeof name, "train/masks/c_%04u.png", camera);
    return name;
}

/// The same file name with something before its extension.
std::string beside(const fs::path& path, const char* mark)
{
    return (path.parent_path() / (path.stem().string() + mark + path.extension().string())).string();
}

void renameImages(OlatSplit& split, const char* extension)
{
    for (OlatImage& image : split.images) image.path = fs::path(image.path).replace_extension(extension).string();
}

/// Turns of directions about axes across them, whose angles have this root mean square; no turn of all directions together is in them.
std::vector<glm::dvec3> turnsOf(const std::vector<glm::dvec3>& directions, Random random, double rms)
{
    std::vector<glm::dvec3> turns;
    glm::dmat3 across(0.0); // of all: what a common turn w does to the direction d is that of w without its part along d
    glm::dvec3 sum(0.0);
    for (const glm::dvec3& d : directions) {
        const glm::dmat3 acrossOne = glm::dmat3(1.0) - glm::outerProduct(d, d);
        turns.push_back(acrossOne * glm::dvec3(normal(random), normal(random), normal(random)));
        across += acrossOne, sum += turns.back();
    }
    const glm::dvec3 common = directions.size() > 2 && glm::determinant(across) > 1e-3 ? glm::inverse(across) * sum : glm::dvec3(0.0);
    double squares = 0;
    for (size_t i = 0; i < turns.size(); ++i) {
        turns[i] -= common - directions[i] * glm::dot(directions[i], common);
        squares += glm::dot(turns[i], turns[i]) / double(turns.size());
    }
    for (glm::dvec3& t : turns) t *= squares > 0 ? rms / std::sqrt(squares) : 0.0;
    return turns;
}

void misstateLights(const CaptureOptions& o, const glm::dvec3& center, uint64_t seed, OlatSplit& stated, std::vector<double>& gains)
{
    std::map<std::tuple<float, float, float>, size_t> lights;
    std::vector<size_t> lightOf;
    std::vector<glm::dvec3> directions; // of each light
    for (const OlatImage& image : stated.images) {
        const bool point = image.light.type == LightType::kPoint;
        const glm::vec3& p = point ? image.light.position : image.light.directionToLight;
        lightOf.push_back(lights.try_emplace({p.x, p.y, p.z}, lights.size()).first->second);
        if (lightOf.back() == directions.size()) directions.push_back(glm::normalize(glm::dvec3(p) - (point ? center : glm::dvec3(0.0))));
    }
    const auto turns = turnsOf(directions, streamFor(seed, "light directions"), o.lightError * kDegree);
    const auto powers = errors<1>(streamFor(seed, "light gains"), lights.size(), o.gain / 100.0);
    const glm::dmat3 turn = rotation({0, 0, o.turn * kDegree});
    for (size_t i = 0; i < stated.images.size(); ++i) {
        Light& light = stated.images[i].light;
        const bool point = light.type == LightType::kPoint;
        const glm::dvec3 to = point ? glm::dvec3(light.position) - center : glm::dvec3(light.directionToLight);
        const glm::dvec3 seen = turn * (rotation(turns[lightOf[i]]) * to);
        if (point) light.position = glm::vec3(center + seen);
        else light.directionToLight = glm::vec3(seen);
        gains[i] = std::exp(powers[lightOf[i]].x);
        light.intensity /= float(gains[i]);
    }
}

void misstateCameras(const CaptureOptions& o, double radius, uint64_t seed, OlatSplit& stated)
{
    const auto turns = errors<3>(streamFor(seed, "poses"), stated.cameras.size(), o.pose * kDegree);
    const auto moves = errors<3>(streamFor(seed, "places"), stated.cameras.size(), 0.1 * o.place * unitsPerCentimetre(o, radius));
    for (size_t c = 0; c < stated.cameras.size(); ++c) {
        glm::dmat4& pose = stated.cameras[c].worldFromCamera;
        const glm::dmat3 turned = glm::dmat3(pose) * rotation(turns[c]);
        for (int k = 0; k < 3; ++k) pose[k] = glm::dvec4(turned[k], 0.0);
        pose[3] += glm::dvec4(moves[c], 0.0);
    }
}

Status writeRgb(const std::string& path, const Image& image, double jpeg)
{
    std::error_code error;
    fs::create_directories(fs::path(path).parent_path(), error);
    if (error) return Error{ErrorCode::kIo, "cannot create a folder for " + inQuotes(path) + ": " + error.message()};
    const std::vector<uint8_t> rgb = displayRgb(image);
    return jpeg > 0 ? writeJpeg(path, image.width, image.height, rgb, int(jpeg)) : writePng(path, image.width, image.height, 3, rgb);
}

/// A number for the noise of one file.
uint64_t noiseSeed(uint64_t seed, const std::string& path) { return fnv1a(path.data(), path.size(), seed ^ kFnvOffset); }

Json toJson(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

Json lightJson(const Light& light)
{
    const bool point = light.type == LightType::kPoint;
    return {{"type", point ? "point" : "directional"},
            {point ? "position" : "direction_to_light", toJson(glm::dvec3(point ? light.position : light.directionToLight))},
            {point ? "intensity" : "irradiance", toJson(glm::dvec3(light.intensity))}};
}

const Light& lampOf(const Light& light) { return light.group ? light.group->front() : light; }

} // namespace

CaptureOptions usualCapture(CaptureKind kind)
{
    CaptureOptions o;
    o.kind = kind;
    o.lens = 100;
    if (kind == CaptureKind::kStage) {
        o.lightError = 1, o.gain = 3;
        o.electrons = 20000, o.read = 6;
        o.spill = 2, o.holes = 1, o.blank = 2;
        o.backdrop = 2;
    } else {
        o.pose = 0.3, o.exposure = 0.15;
        o.electrons = 5000, o.read = 6;
        o.jpeg = 92;
        o.flash = 5, o.beam = 2, o.ambient = 5;
    }
    return o;
}

OlatSplit planPhone(const StageOptions& stage, const CaptureOptions& capture)
{
    OlatSplit split;
    split.name = "train";
    Random random = streamFor(stage.seed, "phone");
    const double low = std::sin(kLowestPhone * kDegree), high = std::sin(kHighestPhone * kDegree), turn = uniform(random);
    const double focal = stageFocalPixels(stage);
    const glm::dvec3 offset = flashOffset(capture, stage.objectRadius, stage.seed);
    for (int i = 0; i < stage.cameras; ++i) {
        const double z = low + (high - low) * (i + uniform(random)) / stage.cameras, r = std::sqrt(1.0 - z * z);
        const double azimuth = 2.0 * kPi * (turn + i * (std::numbers::phi - 1.0));
        const double distance = stage.cameraDistance * (kNearestPhone + (kFarthestPhone - kNearestPhone) * uniform(random));
        const glm::dvec3 eye = stage.center + stage.objectRadius * distance * glm::dvec3(r * std::cos(azimuth), r * std::sin(azimuth), z);
        const glm::dvec3 miss(normal(random), normal(random), normal(random));
        Camera camera = lookAt(eye, stage.center + stage.objectRadius * kAimless * miss, stage.width, stage.height, focal);
        camera.worldFromCamera = camera.worldFromCamera * glm::dmat4(rotation({0, 0, kRoll * kDegree * normal(random)}));
        Light flash;
        flash.position = glm::vec3(camera.worldFromCamera * glm::dvec4(offset, 1.0));
        const double reach = stage.cameraDistance * stage.objectRadius;
        flash.intensity = glm::vec3(float(kFlashIrradiance * reach * reach));
        split.cameras.push_back(camera);
        split.images.push_back({uint32_t(i), flash, ""});
    }
    return split;
}

Capture planCapture(const CaptureOptions& o, OlatDataset& dataset, const glm::dvec3& center, double radius, uint64_t seed)
{
    OlatSplit& stated = *std::find_if(dataset.splits.begin(), dataset.splits.end(), [](const OlatSplit& s) { return s.name == "train"; });
    Capture capture;
    capture.options = o, capture.seed = seed;
    capture.metresPerUnit = 0.01 / unitsPerCentimetre(o, radius);
    const auto exposures = errors<1>(streamFor(seed, "exposures"), stated.images.size(), o.exposure);
    for (const auto& ev : exposures) capture.exposureEv.push_back(ev.x);
    capture.lightGain.assign(stated.images.size(), 1.0);
    capture.blankMatte.assign(stated.cameras.size(), false);
    dataset.colorSpace = ColorSpace::kSrgb;
    if (o.jpeg > 0) dataset.whiteLevel = kJpegWhite;
    renameImages(stated, o.jpeg > 0 ? ".jpg" : ".png");

    const Camera& first = stated.cameras.at(0); // one camera, or many of a kind
    capture.optics.lens = plausibleLens(first, o.lens / 100.0);
    capture.truth = stated;
    if (o.lens > 0) stated.files.assign(stated.cameras.size(), *capture.optics.lens);
    if (o.kind == CaptureKind::kPhone) {
        capture.flashOffset = flashOffset(o, radius, seed);
        capture.optics.beam = float(o.beam);
        Light sky;
        sky.type = LightType::kEnvironment; // without a map: the same radiance from everywhere
        sky.intensity = glm::vec3(float(o.ambient / 100.0 * kFlashIrradiance / kPi));
        if (o.ambient > 0)
            for (OlatImage& image : capture.truth.images) {
                image.light.group = std::make_shared<const std::vector<Light>>(std::vector<Light>{image.light, sky});
                image.light.type = LightType::kGroup;
            }
    }
    misstateCameras(o, radius, seed, stated);
    if (o.kind == CaptureKind::kPhone) {
        dataset.rig = LightRig::kCamera;
        dataset.backgroundInView = true;
        for (OlatImage& image : stated.images) image.light.position = glm::vec3(stated.cameras[image.camera].position());
        if (o.lightsOff && o.ambient > 0)
            for (OlatImage& image : stated.images) image.ambientPath = beside(image.path, "_off");
    } else {
        if (o.turn != 0) dataset.rig = LightRig::kStage;
        misstateLights(o, center, seed, stated, capture.lightGain);
        for (OlatImage& image : stated.images) image.maskPath = mattePath(image.camera);
        Random random = streamFor(seed, "blank mattes");
        const size_t blank = std::min(stated.cameras.size(), size_t(std::ceil(o.blank / 100.0 * double(stated.cameras.size()) - 1e-9)));
        for (size_t done = 0; done < blank;) {
            const size_t c = random.below(uint32_t(stated.cameras.size()));
            if (!capture.blankMatte[c]) capture.blankMatte[c] = true, ++done;
        }
    }
    return capture;
}

std::string truthText(const Capture& capture, const OlatSplit& stated)
{
    const FileCamera& lens = *capture.optics.lens;
    Json json{{"about", "What was really there when nacre synth took the photographs of this capture; transforms_train.json has what its user knows."},
              {"split", stated.name},
              {"metres_per_unit", capture.metresPerUnit},
              {"fl_x", lens.fx}, {"fl_y", lens.fy}, {"cx", lens.cx}, {"cy", lens.cy}};
    for (int i = 0; i < 6; ++i) json["k" + std::to_string(i + 1)] = lens.k[i];
    for (int i = 0; i < 2; ++i) json["p" + std::to_string(i + 1)] = lens.p[i];
    if (capture.options.kind == CaptureKind::kPhone) {
        json["flash_offset"] = toJson(capture.flashOffset);
        json["beam"] = capture.optics.beam;
    }
    json["frames"] = Json::array();
    for (size_t i = 0; i < stated.images.size(); ++i) {
        const OlatImage& image = capture.truth.images[i];
        const glm::dmat4& m = capture.truth.cameras[image.camera].worldFromCamera;
        Json rows = Json::array();
        for (int r = 0; r < 4; ++r) rows.push_back({m[0][r], m[1][r], m[2][r], m[3][r]});
        Json frame{{"file_path", stated.images[i].path}, {"transform_matrix", rows}, {"light", lightJson(lampOf(image.light))}};
        if (image.light.group) frame["ambient_radiance"] = image.light.group->back().intensity.x;
        frame["light_gain"] = capture.lightGain[i];
        frame["exposure_ev"] = capture.exposureEv[i];
        if (capture.blankMatte[image.camera]) frame["mask"] = "blank";
        json["frames"].push_back(std::move(frame));
    }
    return json.dump(1) + "\n";
}

Status writePhotograph(const Capture& capture, const OlatSplit& stated, size_t i, Image radiance, const Image* ambient, const std::string& folder)
{
    const CaptureOptions& o = capture.options;
    const OlatImage& image = stated.images[i];
    const auto take = [&](Image picture, const std::string& file) {
        const float exposure = float(std::exp2(capture.exposureEv[i])), backdrop = float(0.01 * o.backdrop);
        for (size_t p = 0; p < picture.rgba.size(); p += 4)
            for (size_t c = 0; c < 3; ++c) picture.rgba[p + c] = exposure * (picture.rgba[p + c] + (1.0f - picture.rgba[p + 3]) * backdrop);
        addNoise(picture, {o.electrons, o.read}, noiseSeed(capture.seed, file));
        return writeRgb((fs::path(folder) / file).string(), picture, o.jpeg);
    };
    if (!image.ambientPath.empty())
        if (Status s = take(*ambient, image.ambientPath); !s) return s;
    return take(std::move(radiance), image.path);
}

Status writeMatte(const Capture& capture, const OlatSplit& stated, size_t i, const Image& radiance, const std::string& folder)
{
    const OlatImage& image = stated.images[i];
    if (image.maskPath.empty()) return ok();
    const std::string path = (fs::path(folder) / image.maskPath).string();
    std::error_code error;
    fs::create_directories(fs::path(path).parent_path(), error);
    if (error) return Error{ErrorCode::kIo, "cannot create a folder for " + inQuotes(path) + ": " + error.message()};
    std::vector<uint8_t> matte = imperfectMatte(radiance, capture.options.spill, int(capture.options.holes), noiseSeed(capture.seed, image.maskPath));
    if (capture.blankMatte[image.camera]) std::fill(matte.begin(), matte.end(), uint8_t(0));
    std::vector<uint8_t> rgb;
    for (const uint8_t m : matte) rgb.insert(rgb.end(), 3, m);
    return writePng(path, radiance.width, radiance.height, 3, rgb);
}

} // namespace nacre
