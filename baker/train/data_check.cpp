#include "train/data_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

namespace nacre {
namespace {

constexpr size_t kMaxImages = 24;         // as many pixels as are needed, not more than a moment's decoding
constexpr size_t kMaxSamplesPerSide = 64; // of an image, for the median
constexpr float kInside = 0.5f;           // alpha of the silhouette
constexpr float kBlack = 1.5e-4f;         // below half a step of an 8-bit display
constexpr double kExtreme = 3e3;          // times the median of what is lit: polished metal under a small lamp reaches 500, fireflies and lamps in view more
constexpr double kManyClipped = 0.02;     // of the object's pixels above 1: more than highlights cover
constexpr double kSame = 1e-5;            // relative: digits that positions have as text
constexpr float kTouches = 0.05f;         // of the object's half-size: nearer than this, splats see the light from all sides
constexpr float kDeep = 0.15f;            // the silhouettes of few cameras leave about this much around the object

std::string number(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", x);
    return text;
}

std::string vec(const glm::vec3& v)
{
    char text[96];
    std::snprintf(text, sizeof text, "(%.3g, %.3g, %.3g)", double(v.x), double(v.y), double(v.z));
    return text;
}

bool same(const glm::dvec3& a, const glm::dvec3& b) { return glm::distance(a, b) <= kSame * glm::length(a); }

bool sameLight(const Light& a, const Light& b)
{
    if (a.type != b.type) return false;
    return a.type == LightType::kPoint ? same(a.position, b.position) : same(a.directionToLight, b.directionToLight);
}

/// The images that train.
std::vector<uint32_t> punctualImages(const OlatSplit& split)
{
    std::vector<uint32_t> images;
    for (uint32_t i = 0; i < split.images.size(); ++i)
        if (split.images[i].light.isPunctual()) images.push_back(i);
    return images;
}

bool oneViewpoint(const OlatSplit& split, const std::vector<uint32_t>& images)
{
    const auto eye = [&](uint32_t i) { return split.cameras[split.images[i].camera].position(); };
    return std::all_of(images.begin(), images.end(), [&](uint32_t i) { return same(eye(images[0]), eye(i)); });
}

void checkVariety(const AssetFrame& frame, const OlatSplit& split, const std::vector<uint32_t>& images, std::vector<std::string>& out)
{
    const std::string all = "all " + std::to_string(images.size()) + " training images ";
    if (oneViewpoint(split, images))
        out.push_back(all + "are taken from one place: depth is not determined, and other views will look wrong; add cameras around the object");
    const Light& light = split.images[images[0]].light;
    if (std::all_of(images.begin(), images.end(), [&](uint32_t i) { return sameLight(light, split.images[i].light); }))
        out.push_back(all + "have the same light (" + (light.type == LightType::kPoint ? "at " + vec(frame.positionInDataset(light.position)) : "from " + vec(light.directionToLight)) +
                      "): relighting cannot be learnt; add images under lights from other directions");
}

/// Brightness (the largest colour channel) of the object's pixels.
struct Exposure {
    size_t images = 0, pixels = 0, clipped = 0; // clipped: above 1
    float brightest = 0;
    std::vector<float> lit;                     // some pixels that are not black
    void add(const Image& image);
    double median();
};

void Exposure::add(const Image& image)
{
    const int step = 1 + (std::max(image.width, image.height) - 1) / int(kMaxSamplesPerSide);
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
            const float* p = image.pixel(x, y);
            if (!(p[3] > kInside)) continue;
            const float brightness = std::max({p[0], p[1], p[2]});
            ++pixels;
            clipped += brightness > 1;
            brightest = std::max(brightest, brightness);
            if (x % step == step / 2 && y % step == step / 2 && brightness > kBlack) lit.push_back(brightness);
        }
    ++images;
}

double Exposure::median()
{
    if (lit.empty()) return 0;
    const auto middle = lit.begin() + ptrdiff_t(lit.size() / 2);
    std::nth_element(lit.begin(), middle, lit.end());
    return *middle;
}

// Training compares images as a display shows them, clipped at 1 (loss.h).
void checkExposure(Exposure exposure, size_t imageCount, std::vector<std::string>& out)
{
    const std::string looked = exposure.images == imageCount ? "all " + std::to_string(imageCount) + " training images"
                                                             : std::to_string(exposure.images) + " of " + std::to_string(imageCount) + " training images";
    if (exposure.brightest <= kBlack) {
        out.push_back(looked + " were looked at and are black (brightest value " + number(exposure.brightest) +
                      "): there is nothing to learn; check exposure and how the files are encoded");
        return;
    }
    const double median = exposure.median(), ratio = exposure.brightest / std::max(median, double(kBlack));
    const double share = double(exposure.clipped) / double(std::max<size_t>(exposure.pixels, 1));
    if (exposure.clipped == 0 || !(share > kManyClipped || ratio > kExtreme || median > 1)) return;
    out.push_back(number(100.0 * share) + " % of the object's pixels in " + looked +
                  " are above 1 and train as white; the brightest is " + number(exposure.brightest) + ", " + number(ratio) +
                  " times the median of the lit ones: check exposure (scale images and intensities of lights down alike) and remove fireflies");
}

/// Signed distance to the nearest boundary voxel, negative inside.
float distanceToHull(const VisualHull& hull, const glm::vec3& p)
{
    float nearest2 = std::numeric_limits<float>::max();
    for (const OrientedPoint& s : hull.surface) {
        const glm::vec3 d = p - glm::vec3(s.position[0], s.position[1], s.position[2]);
        nearest2 = std::min(nearest2, glm::dot(d, d));
    }
    const size_t n = size_t(hull.resolution);
    size_t voxel = 0;
    bool inGrid = true;
    for (int k = 2; k >= 0; --k) {
        const float u = (p[k] - hull.center[k] + hull.halfSize) / (2 * hull.halfSize) * float(n);
        inGrid = inGrid && u >= 0 && u < float(n);
        voxel = voxel * n + (inGrid ? size_t(u) : 0);
    }
    return inGrid && hull.inside[voxel] ? -std::sqrt(nearest2) : std::sqrt(nearest2);
}

} // namespace

Result<std::vector<std::string>> checkTrainingData(const OlatDataset& dataset, const OlatSplit& split, Silhouettes silhouettes)
{
    std::vector<std::string> out;
    const std::vector<uint32_t> images = punctualImages(split);
    if (images.empty()) return out;
    checkVariety(dataset.frame, split, images, out);
    if (silhouettes == Silhouettes::kEmpty) { // colours without coverage say nothing about exposure
        out.push_back("the alpha of the training images is nowhere above 0.5: no silhouettes, starting from random points and learning without them; "
                      "check the alpha channel or leave it out");
        return out;
    }
    if (silhouettes == Silhouettes::kOpaque)
        out.push_back("the images have no alpha: starting from random points and learning the background too; masks would help");

    Exposure exposure;
    ImageCache files(dataset, 0); // each is needed once
    const size_t count = std::min(images.size(), kMaxImages);
    for (size_t k = 0; k < count; ++k) {
        const double spread = std::fmod(double(k) * std::numbers::phi, 1.0); // in step with no rig's order of cameras and lights
        auto image = files.load(split, images[count == images.size() ? k : size_t(spread * double(images.size()))]);
        if (!image) continue; // training says so
        exposure.add(**image);
    }
    checkExposure(std::move(exposure), images.size(), out);
    return out;
}

Status checkLights(const AssetFrame& frame, const OlatSplit& split, const VisualHull& hull, std::vector<std::string>& warnings)
{
    const std::vector<uint32_t> images = punctualImages(split);
    if (hull.surface.empty() || oneViewpoint(split, images)) return ok(); // the cone behind one silhouette is not the object
    glm::vec3 lo(std::numeric_limits<float>::max()), hi(-lo);
    for (const OrientedPoint& s : hull.surface)
        for (int k = 0; k < 3; ++k) lo[k] = std::min(lo[k], s.position[k]), hi[k] = std::max(hi[k], s.position[k]);
    const glm::vec3 half = 0.5f * (hi - lo);
    const float size = std::max({half.x, half.y, half.z});
    const bool enclosed = !touchesBorder(hull); // else the hull is more than the object, and only what lies inside it is worth a word
    const float touches = enclosed ? kTouches * size : 0;

    size_t touching = 0;
    const OlatImage* first = nullptr;
    for (uint32_t i : images) {
        const OlatImage& image = split.images[i];
        const glm::vec3& position = image.light.position;
        if (image.light.type != LightType::kPoint || glm::any(glm::lessThan(position, lo - touches)) || glm::any(glm::greaterThan(position, hi + touches)))
            continue;
        const float distance = distanceToHull(hull, position);
        if (enclosed && distance < -kDeep * size)
            return Error{ErrorCode::kBadInput, image.path + ": its light at " + vec(frame.positionInDataset(position)) +
                                                   " lies inside the object's silhouettes; check units and axes of the light positions"};
        if (distance < touches && touching++ == 0) first = &image;
    }
    if (!touching) return ok();
    const std::string what = std::to_string(touching) + " of " + std::to_string(images.size()) + " training images have a light ";
    const std::string where = ", the first is " + first->path + " at " + vec(frame.positionInDataset(first->light.position));
    warnings.push_back(enclosed ? what + "at the object's surface" + where + ": a small spot outshines the rest there; move such lights away or leave them out, "
                                         "or check units and axes of the light positions"
                                : what + "inside the object's silhouettes" + where + ": check units and axes of the light positions "
                                         "(or it is hidden behind the object from all cameras)");
    return ok();
}

} // namespace nacre
