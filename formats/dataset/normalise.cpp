#include "dataset/normalise.h"

#include "base/exact_position.h"
#include "base/text.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nacre {
namespace {

// An object of this half-size, no further from the origin than that, is baked where it is: assets of metric captures stay metric.
constexpr double kLeastHalfSize = 0.25, kMostHalfSize = 4;
constexpr size_t kReflectanceImages = 24; // a median of so many is within a few per cent of that of all
constexpr float kInside = 0.5f;           // alpha of the object
constexpr double kLitShare = 0.05;        // without alpha: what is brighter than this share of the bright pixels is the object

double luminance(const float* rgb) { return 0.2126 * double(rgb[0]) + 0.7152 * double(rgb[1]) + 0.0722 * double(rgb[2]); }
double luminance(const glm::vec3& c) { return luminance(&c.x); }

double median(std::vector<double> values)
{
    const auto middle = values.begin() + ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

const std::vector<OlatSplit> trainOrAll(const std::vector<OlatSplit>& splits)
{
    for (const OlatSplit& split : splits)
        if (split.name == "train") return {split};
    return splits;
}

/// The point nearest to all optical axes, by the sum of distances: cameras that look elsewhere pull no harder for being further off.
std::optional<glm::dvec3> commonPoint(const std::vector<Camera>& cameras, const glm::dvec3& middle)
{
    std::vector<double> weights(cameras.size(), 1.0);
    glm::dvec3 point(0.0);
    for (int round = 0; round < 10; ++round) {
        glm::dmat3 a(0.0);
        glm::dvec3 b(0.0);
        double sum = 0;
        for (size_t i = 0; i < cameras.size(); ++i) {
            const glm::dvec3 d(cameras[i].worldFromCamera[2]);
            const glm::dmat3 m = weights[i] * (glm::dmat3(1.0) - glm::outerProduct(d, d));
            a += m, b += m * (cameras[i].position() - middle), sum += weights[i];
        }
        if (!(glm::determinant(a / sum) > 1e-6)) return std::nullopt; // parallel axes
        point = middle + glm::inverse(a) * b;
        std::vector<double> misses, distances;
        for (const Camera& camera : cameras) {
            const glm::dvec3 v = point - camera.position();
            distances.push_back(glm::length(v));
            misses.push_back(glm::length(v - glm::dot(v, glm::dvec3(camera.worldFromCamera[2])) * glm::dvec3(camera.worldFromCamera[2])));
        }
        const double least = 0.01 * median(distances) + 1e-300; // a rig that aims this well is one that is aimed
        for (size_t i = 0; i < cameras.size(); ++i) weights[i] = least / std::max(misses[i], least);
    }
    return point;
}

/// How far the lights are from the cameras, in the middle; 1 if there are no point lights.
double lightDistance(const std::vector<OlatSplit>& splits, const glm::dvec3& from)
{
    std::vector<double> distances;
    for (const OlatSplit& split : splits)
        for (const OlatImage& image : split.images)
            if (image.light.type == LightType::kPoint) distances.push_back(glm::distance(exactPosition(image.light), from));
    return distances.empty() ? 1.0 : std::max(median(distances), 1e-30);
}

/// Mean luminance of the object's pixels; nothing if there are none.
std::optional<double> objectLuminance(const Image& image)
{
    const size_t pixels = image.rgba.size() / 4;
    bool hasBackground = false;
    std::vector<double> inside;
    for (size_t p = 0; p < pixels; ++p) {
        const float* rgba = &image.rgba[4 * p];
        if (rgba[3] > kInside) inside.push_back(std::max(0.0, luminance(rgba)));
        else if (!(rgba[3] < 0)) hasBackground = true;
    }
    if (inside.empty()) return std::nullopt;
    if (!hasBackground) {
        const auto bright = inside.begin() + ptrdiff_t(inside.size() * 99 / 100);
        std::nth_element(inside.begin(), bright, inside.end());
        const double least = kLitShare * *bright;
        std::erase_if(inside, [&](double x) { return !(x > least); });
        if (inside.empty()) return std::nullopt;
    }
    double sum = 0;
    for (double x : inside) sum += x;
    return sum / double(inside.size());
}

} // namespace

Framing frameCameras(const std::vector<OlatSplit>& all)
{
    const std::vector<OlatSplit> splits = trainOrAll(all);
    std::vector<Camera> cameras;
    for (const OlatSplit& split : splits) cameras.insert(cameras.end(), split.cameras.begin(), split.cameras.end());
    if (cameras.empty()) return {};
    glm::dvec3 middle(0.0), forward(0.0);
    for (const Camera& c : cameras) middle += c.position() / double(cameras.size()), forward -= glm::dvec3(c.worldFromCamera[2]);
    double spread = 0;
    for (const Camera& c : cameras) spread = std::max(spread, glm::distance(c.position(), middle));

    const double lights = lightDistance(splits, middle);
    const bool onePlace = spread < 1e-5 * lights; // there all axes meet, whatever they look at
    std::optional<glm::dvec3> centre;
    if (!onePlace) centre = commonPoint(cameras, middle);
    const bool met = centre.has_value();
    if (!met) centre = middle + lights * (glm::length(forward) > 1e-6 ? glm::normalize(forward) : -glm::dvec3(cameras[0].worldFromCamera[2]));
    std::vector<double> sizes;
    for (const Camera& c : cameras) sizes.push_back(glm::distance(c.position(), *centre) * 0.5 * std::max(c.width / c.fx, c.height / c.fy));
    return {*centre, median(sizes), met};
}

Result<std::optional<double>> apparentReflectance(const OlatDataset&, const OlatSplit& split, const Framing& framing, ImageCache& images)
{
    std::vector<size_t> lit;
    for (size_t i = 0; i < split.images.size(); ++i)
        if (split.images[i].light.isPunctual() && luminance(split.images[i].light.intensity) > 0) lit.push_back(i);
    std::vector<double> found;
    const size_t count = std::min(lit.size(), kReflectanceImages);
    for (size_t k = 0; k < count; ++k) {
        const size_t index = lit[k * lit.size() / count];
        const Light& light = split.images[index].light;
        const auto image = images.load(split, index);
        if (!image) continue; // others will do
        const std::optional<double> radiance = objectLuminance(**image);
        if (!radiance) continue;
        double irradiance = luminance(light.intensity);
        if (light.type == LightType::kPoint) {
            const double r = std::max(glm::distance(exactPosition(light), framing.centre), 0.1 * framing.halfSize);
            irradiance /= r * r;
        }
        found.push_back(std::numbers::pi * *radiance / irradiance);
    }
    if (found.empty()) return std::optional<double>();
    const double middle = median(found);
    return middle > 0 && std::isfinite(middle) ? std::optional(middle) : std::nullopt;
}

Result<OlatDataset> normalised(const OlatDataset& dataset)
{
    const Framing framing = frameCameras(dataset.splits);
    AssetFrame step;
    if (framing.halfSize > 0 && std::isfinite(framing.halfSize) &&
        !(framing.halfSize >= kLeastHalfSize && framing.halfSize <= kMostHalfSize && glm::length(framing.centre) <= framing.halfSize))
        step.scale = framing.halfSize, step.translation = framing.centre;

    if (const OlatSplit* train = dataset.find("train")) {
        ImageCache images(dataset, 0); // each is needed once
        const auto reflectance = apparentReflectance(dataset, *train, framing, images);
        if (!reflectance) return reflectance.error();
        if (*reflectance && !(**reflectance >= kLeastReflectance && **reflectance <= kMostReflectance))
            step.lightGain = **reflectance / kUsualReflectance;
    }
    const auto sane = [](double x) { return x >= 1.0 / kFarthestUnit && x <= kFarthestUnit; };
    if (!sane(dataset.frame.lightGain * step.lightGain))
        return Error{ErrorCode::kBadInput, "dataset '" + dataset.path + "': the object is " + numberText(float(step.lightGain)) +
                                               " times as bright as its lights usually make one; check the exposure of the images and the unit of the lights"};
    if (!sane(dataset.frame.scale * step.scale))
        return Error{ErrorCode::kBadInput, "dataset '" + dataset.path + "': the object is " + numberText(float(step.scale)) + " units large; check the unit of the cameras"};
    OlatDataset out = dataset;
    if (step == AssetFrame{}) return out;
    out.frame = {dataset.frame.scale * step.scale, dataset.frame.positionInDataset(step.translation), dataset.frame.lightGain * step.lightGain};
    for (OlatSplit& split : out.splits) {
        for (Camera& camera : split.cameras) camera = cameraInAsset(step, camera);
        for (OlatImage& image : split.images) image.light = lightInAsset(step, image.light);
    }
    return out;
}

} // namespace nacre
