// Looks for a misread convention: from geometry alone, then from a few images of each split.
//
// Cameras.  The point x nearest to all optical axes solves sum_i (1 - d_i d_i^T) (x - p_i) = 0. It does not depend on the sign of the
//           axes, so cameras whose forward vector points away from it have a flipped axis. Of poses that are world-to-camera by
//           mistake the axes do not meet, or only in the cameras, which then all stand in one place; those of their inverses do meet.
// Lights.   A point light that projects into the silhouette of every sampled view lies in the visual hull: inside the object.
#include "dataset/checks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <set>

namespace nacre {
namespace {

constexpr size_t kMaxImages = 24, kMaxOtherImages = 10; // of the train split and of each other one: keeps `nacre info` fast
constexpr double kMeetingMiss = 0.1;                    // of the distance; a rig aimed at an object misses its middle by less than the object is wide

/// The point nearest to all optical axes, if the axes differ enough to have one.
std::optional<glm::dvec3> commonPoint(const std::vector<glm::dmat4>& poses)
{
    glm::dmat3 a(0.0);
    glm::dvec3 b(0.0);
    for (const glm::dmat4& pose : poses) {
        const glm::dvec3 d(pose[2]);
        const glm::dmat3 m = glm::dmat3(1.0) - glm::outerProduct(d, d);
        a += m;
        b += m * glm::dvec3(pose[3]);
    }
    if (poses.size() < 2 || !(glm::determinant(a) > 1e-6 * std::pow(double(poses.size()), 3))) return std::nullopt;
    return glm::inverse(a) * b;
}

/// Whether the axes pass close to one point that is not where the cameras themselves stand.
bool axesMeet(const std::vector<glm::dmat4>& poses)
{
    const std::optional<glm::dvec3> point = commonPoint(poses);
    if (!point) return false;
    double miss2 = 0, distance2 = 0, origin2 = 0;
    for (const glm::dmat4& pose : poses) {
        const glm::dvec3 position(pose[3]), toPoint = *point - position;
        const double along = glm::dot(toPoint, glm::dvec3(pose[2]));
        miss2 += std::max(0.0, glm::dot(toPoint, toPoint) - along * along);
        distance2 += glm::dot(toPoint, toPoint);
        origin2 += glm::dot(position, position);
    }
    return miss2 < kMeetingMiss * kMeetingMiss * distance2 && distance2 > 1e-10 * origin2; // 1e-5: digits that poses have as text
}

/// True if the poses cannot be used for the other checks.
bool checkCameras(const std::vector<glm::dmat4>& poses, const std::optional<glm::dvec3>& centre, std::vector<std::string>& out)
{
    if (!centre) return false;
    std::vector<glm::dmat4> inverses;
    for (const glm::dmat4& pose : poses) inverses.push_back(glm::inverse(pose));
    if (!axesMeet(poses) && axesMeet(inverses)) {
        out.push_back("the axes of the " + std::to_string(poses.size()) +
                      " cameras meet only after inverting the poses: they are probably world-to-camera, invert them");
        return true;
    }
    size_t away = 0;
    for (const glm::dmat4& pose : poses)
        if (glm::dot(-glm::dvec3(pose[2]), *centre - glm::dvec3(pose[3])) < 0) away++;
    const std::string of = std::to_string(away) + " of " + std::to_string(poses.size());
    if (2 * away > poses.size()) {
        out.push_back(of + " cameras look away from the object: their axes are probably OpenCV's, flip y and z of the poses (columns 1 and 2)");
        return true;
    }
    if (10 * away > poses.size()) out.push_back(of + " cameras look away from the point that most of them look at: check their poses");
    return false;
}

/// Alpha at the pixel that sees `world`; 0 outside the frame and behind the camera, negative where nothing is known.
float alphaAt(const CheckedView& view, const glm::dvec3& world)
{
    const glm::dvec3 p(glm::inverse(view.camera->worldFromCamera) * glm::dvec4(world, 1.0));
    if (!(p.z < 0)) return 0.0f;
    const double x = view.camera->cx + view.camera->fx * p.x / -p.z, y = view.camera->cy - view.camera->fy * p.y / -p.z;
    if (!(x >= 0 && y >= 0 && x < view.pixels->width && y < view.pixels->height)) return 0.0f;
    return view.pixels->pixel(int(x), int(y))[3];
}

void checkLightsOutside(const OlatDataset& dataset, const std::vector<CheckedView>& views, std::vector<std::string>& out)
{
    size_t inside = 0;
    const OlatImage* first = nullptr;
    for (const OlatSplit& split : dataset.splits)
        for (const OlatImage& image : split.images) {
            if (image.light.type != LightType::kPoint) continue;
            const glm::dvec3 position = statedPosition(image.light);
            if (!std::all_of(views.begin(), views.end(), [&](const CheckedView& v) { return alphaAt(v, position) > kInside; })) continue;
            if (inside++ == 0) first = &image;
        }
    if (inside > 0)
        out.push_back("light inside the object: " + std::to_string(inside) + " of the point lights, the first at " + briefly(first->light.position) + " for " +
                      first->path + ": check the light frame and scale");
}

} // namespace

std::string briefly(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", x);
    return text;
}

std::string briefly(const glm::vec3& v) { return std::string("(").append(briefly(double(v.x))) + ", " + briefly(double(v.y)) + ", " + briefly(double(v.z)) + ")"; }

/// Images of other splits that a bake learns from: the same file, or the same camera under the same light.
static void checkHeldOut(const OlatDataset& dataset, std::vector<std::string>& out)
{
    const OlatSplit* train = dataset.find("train");
    if (!train) return;
    using Key = std::array<double, 22>;
    const auto key = [](const OlatSplit& split, const OlatImage& image) {
        const Light& light = image.light;
        const glm::vec3 at = light.type == LightType::kPoint ? light.position : light.directionToLight;
        Key k{double(light.type), at.x, at.y, at.z, double(light.radius)};
        std::copy_n(&split.cameras[image.camera].worldFromCamera[0][0], 16, k.begin() + 5);
        k[21] = split.cameras[image.camera].fx;
        return k;
    };
    std::set<std::string> files;
    std::set<Key> shots;
    for (const OlatImage& image : train->images) {
        files.insert(image.path);
        if (image.light.isPunctual()) shots.insert(key(*train, image));
    }
    for (const OlatSplit& split : dataset.splits) {
        if (&split == train) continue;
        const auto seen = [&](const OlatImage& image) { return files.count(image.path) || (image.light.isPunctual() && shots.count(key(split, image))); };
        const auto count = std::count_if(split.images.begin(), split.images.end(), seen);
        if (count > 0)
            out.push_back(std::to_string(count) + " of " + std::to_string(split.images.size()) + " images of split '" + split.name +
                          "' are in train, too (same file, or same camera and light): its figures are not of held-out images; keep cameras and lights apart");
    }
}

Result<DatasetExamination> examineDataset(const OlatDataset& dataset, ImageCache& images)
{
    DatasetExamination out;
    out.warnings = checkAlpha(dataset, images);
    checkHeldOut(dataset, out.warnings);
    std::vector<glm::dmat4> poses;
    for (const OlatSplit& split : dataset.splits)
        for (const Camera& camera : split.cameras) poses.push_back(camera.worldFromCamera);
    if (checkCameras(poses, commonPoint(poses), out.warnings)) return out;

    const Framing framing = frameCameras(dataset.splits);
    std::vector<CheckedView> views;
    std::vector<std::string> unreadable;
    size_t looked = 0;
    bool hasBackground = false;
    for (const OlatSplit& split : dataset.splits) {
        std::vector<size_t> candidates;
        for (size_t i = 0; i < split.images.size(); i++)
            if (split.images[i].light.isPunctual()) candidates.push_back(i);
        const size_t count = std::min(candidates.size(), split.name == "train" ? kMaxImages : kMaxOtherImages);
        for (size_t k = 0; k < count; k++) {
            const size_t index = candidates[k * candidates.size() / count];
            Result<std::shared_ptr<const Image>> image = images.load(split, index);
            looked++;
            if (!image) { // says who needs it; here others will do
                unreadable.push_back(image.error().message);
                continue;
            }
            const OlatImage& entry = split.images[index];
            views.push_back({&split, index, &split.cameras[entry.camera], &entry, *image});
            for (size_t i = 3; i < (*image)->rgba.size(); i += 4) hasBackground |= (*image)->rgba[i] >= 0 && !((*image)->rgba[i] > kInside);
        }
        out.splits.push_back({split.name, {}, {}});
    }
    if (views.empty() && !unreadable.empty()) return Error{ErrorCode::kBadInput, unreadable[0] + " (and none of " + std::to_string(looked) + " images looked at can be used)"};
    if (!unreadable.empty())
        out.warnings.push_back(std::to_string(unreadable.size()) + " of " + std::to_string(looked) + " images looked at cannot be used; the first: " + unreadable[0]);
    if (Status s = checkUnits(dataset, framing, images, out); !s) return s.error();
    if (views.empty()) return out;
    if (!hasBackground) {
        out.warnings.push_back("lights and shading not checked: the images have no alpha that tells the object from the background");
        return out;
    }
    checkHull(views, framing, out);
    if (views.size() >= 3) checkLightsOutside(dataset, views, out.warnings);
    checkShading(dataset, views, framing, out);
    return out;
}

Result<std::vector<std::string>> checkConventions(const OlatDataset& dataset, ImageCache& images)
{
    Result<DatasetExamination> found = examineDataset(dataset, images);
    if (!found) return found.error();
    return std::move(found->warnings);
}

} // namespace nacre
