// Quantities that are possible but that no capture has: then a unit, an order or another image size was mistaken.
#include "dataset/checks.h"

#include <algorithm>
#include <cmath>

namespace nacre {
namespace {

constexpr double kFarLights = 100, kNearLights = 0.03; // of the cameras' distance; a light stage has 0.3 to 5
constexpr double kOffCentre = 0.25;                    // of the image size: crops move the principal point less
constexpr double kOtherBrightness = 2.5;               // between splits; other views and lights of one object stay below,
constexpr double kOtherDistance = 1.2, kNearBrightness = 5; // unless lights are so much nearer or farther
constexpr double kSquare = 1.5;                        // pixels are not longer than this than wide, anamorphic lenses apart

double median(std::vector<double> values)
{
    if (values.empty()) return 0;
    const auto middle = values.begin() + ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

/// Median over the point lights; 0 without any.
double lightDistance(const OlatSplit& split, const Framing& framing)
{
    std::vector<double> distances;
    for (const OlatImage& image : split.images)
        if (image.light.type == LightType::kPoint) distances.push_back(glm::distance(statedPosition(image.light), framing.centre));
    return median(std::move(distances));
}

void checkLightDistance(const OlatSplit& split, const Framing& framing, std::vector<std::string>& out)
{
    std::vector<double> cameras;
    for (const Camera& camera : split.cameras) cameras.push_back(glm::distance(camera.position(), framing.centre));
    const double lights = lightDistance(split, framing);
    if (!(lights > 0) || cameras.empty()) return;
    const double ratio = lights / median(cameras);
    if (!(ratio > kFarLights || ratio < kNearLights)) return;
    out.push_back("split '" + split.name + "': the lights are " + briefly(ratio) + " times as far from the object as the cameras (0.3 to 5 is usual): "
                  "light positions are probably in another unit than the poses (millimetres against metres?); bring both to one unit");
}

void checkIntrinsics(const OlatSplit& split, std::vector<std::string>& out)
{
    for (const Camera& c : split.cameras) {
        const double dx = c.cx / c.width - 0.5, dy = c.cy / c.height - 0.5;
        if (std::max(std::abs(dx), std::abs(dy)) > kOffCentre) {
            out.push_back("split '" + split.name + "': principal point (" + briefly(c.cx) + ", " + briefly(c.cy) + ") of images of " + std::to_string(c.width) +
                          "x" + std::to_string(c.height) + " pixels, expected near the centre: intrinsics of another image size, or in another order; "
                          "scale them with the images (camera_intrinsics is cx, cy, fx, fy)");
            return;
        }
        if (std::max(c.fx, c.fy) > kSquare * std::min(c.fx, c.fy)) {
            out.push_back("split '" + split.name + "': focal lengths " + briefly(c.fx) + " and " + briefly(c.fy) +
                          " pixels, expected about the same: intrinsics in another order, or an angle of the other side");
            return;
        }
    }
}

std::string likelyUnit(double reflectance)
{
    const double factor = reflectance / kUsualReflectance;
    const std::string times = factor > 1 ? briefly(factor) + " times too small" : briefly(1 / factor) + " times too large";
    return times + " (watts for candela: 12.6; millimetres for metres: 1e6; 1 for unknown; another exposure?)";
}

} // namespace

Status checkUnits(const OlatDataset& dataset, const Framing& framing, ImageCache& images, DatasetExamination& out)
{
    for (const OlatSplit& split : dataset.splits) {
        const size_t before = out.warnings.size();
        checkIntrinsics(split, out.warnings);
        checkLightDistance(split, framing, out.warnings);
        if (out.warnings.size() > before) break; // the other splits are the same story
    }
    const OlatSplit* train = dataset.find("train");
    if (!train) return ok();
    const auto reflectance = apparentReflectance(dataset, *train, framing, images);
    if (!reflectance) return reflectance.error();
    out.reflectance = *reflectance;
    const size_t warned = out.warnings.size();
    if (out.reflectance && !(*out.reflectance >= kLeastReflectance && *out.reflectance <= kMostReflectance))
        out.warnings.push_back("apparent reflectance " + briefly(*out.reflectance) + " (radiance of the object over irradiance / pi; " + briefly(kLeastReflectance) +
                               " to " + briefly(kMostReflectance) + " is plausible): light intensities are about " + likelyUnit(*out.reflectance) +
                               "; a bake multiplies them by " + briefly(*out.reflectance / kUsualReflectance) + ", so only absolute brightness is uncertain");
    if (!out.reflectance || out.warnings.size() > warned) return ok(); // first things first
    for (const OlatSplit& split : dataset.splits) {
        if (&split == train) continue;
        const auto other = apparentReflectance(dataset, split, framing, images);
        if (!other) return other.error();
        const double ratio = *other ? **other / *out.reflectance : 1, nearer = lightDistance(split, framing) / lightDistance(*train, framing);
        // nearer lights are brighter at the surface than at the centre, where irradiance is taken
        const double most = nearer < 1 / kOtherDistance ? kNearBrightness : kOtherBrightness, least = nearer > kOtherDistance ? 1 / kNearBrightness : 1 / kOtherBrightness;
        if (ratio > most || ratio < least)
            out.warnings.push_back("split '" + split.name + "': apparent reflectance " + briefly(**other) + ", that of train is " + briefly(*out.reflectance) +
                                   ": intensities or distances of lights, or the exposure, differ between the two");
    }
    return ok();
}

} // namespace nacre
