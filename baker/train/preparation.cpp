// Silhouettes -> visual hull -> points for the first splats; and what the models want to know about the whole dataset.
#include "train/preparation.h"

#include "base/color.h"
#include "splat/stereo.h"
#include "train/data_check.h"
#include "train/memory.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <tuple>

namespace nacre {

size_t stepBytes(const Camera& camera)
{
    // Of four images at once: what is blended, what is shown, the gradients of both (sss: 26 and 12 planes of floats, and coverage),
    // the references (14 bytes a pixel each), and one file while it is read (32 bytes).
    constexpr size_t kBytesPerPixel = 2 * (27 + 13) * sizeof(float) + 4 * 14 + 32;
    return size_t(camera.width) * size_t(camera.height) * kBytesPerPixel;
}

Status checkMemory(const Camera& camera, size_t machineBytes)
{
    const size_t needed = stepBytes(camera);
    if (needed <= machineBytes) return ok();
    const auto gigabytes = [](size_t bytes) { return std::to_string((bytes + (size_t(1) << 29)) >> 30); };
    return Error{ErrorCode::kUnsupported, "train images of " + std::to_string(camera.width) + "x" + std::to_string(camera.height) +
                                              " pixels take " + gigabytes(needed) + " GiB of memory to train, this machine has " +
                                              gigabytes(machineBytes) + " GiB; scale them down"};
}

namespace {

constexpr int kMostPixelsPerSide = 8192;
constexpr size_t kHullCameras = 200; // more silhouettes hardly change the hull,
constexpr size_t kMaskBytes = size_t(1) << 30, kLeastHullCameras = 16; // and of large images as many as fit
constexpr int kHullResolution = 128;
constexpr double kInitialShare = 0.5;    // of the cap
constexpr uint16_t kObjectAlpha = 32768; // of 65535: from here on a pixel shows the object

// Every stride-th of `count` items makes about `wanted`.
size_t strideFor(size_t count, size_t wanted) { return (count + wanted - 1) / wanted; }

Status checkSplit(const OlatDataset& dataset, const OlatSplit& split, const std::vector<CameraImages>& views)
{
    if (views.empty())
        return Error{ErrorCode::kBadInput, dataset.path + ": the train split has no image with a point or directional light"};
    if (std::all_of(split.images.begin(), split.images.end(),
                    [](const OlatImage& i) { return i.light.intensity == glm::vec3(0.0f); }))
        return Error{ErrorCode::kBadInput,
                     dataset.path + ": every light of the train split has intensity 0; nothing can be learned"};
    for (const CameraImages& view : views) {
        const Camera& c = split.cameras[view.camera];
        if (c.width > kMostPixelsPerSide || c.height > kMostPixelsPerSide)
            return Error{ErrorCode::kUnsupported, dataset.path + ": train images of " + std::to_string(c.width) + "x" +
                                                      std::to_string(c.height) + " pixels; at most " +
                                                      std::to_string(kMostPixelsPerSide) + " per side, scale them down"};
        if (Status s = checkMemory(c, machineMemory()); !s) return Error{s.error().code, dataset.path + ": " + s.error().message};
    }
    return ok();
}

/// Where cameras see the object.
struct Masks {
    std::vector<Camera> cameras;
    std::vector<std::vector<uint8_t>> masks; // of each camera
    std::vector<uint32_t> images;            // whose masks these are
    Silhouettes silhouettes = Silhouettes::kGood;
    size_t empty = 0;       // images without any object: their masks would carve everything away
    std::string firstEmpty;
};

constexpr double kBackgroundShare = 1e-3; // of an image: a dead pixel is no background

Result<Masks> loadMasks(const Preparation& p, const Tick& tick)
{
    Masks found;
    size_t withObject = 0, withBackground = 0;
    std::vector<Camera> emptyCameras;
    size_t pixelsOfOne = 1;
    for (const CameraImages& view : p.views)
        pixelsOfOne = std::max(pixelsOfOne, size_t(p.split->cameras[view.camera].width) * size_t(p.split->cameras[view.camera].height));
    const size_t wanted = std::clamp(kMaskBytes / pixelsOfOne, kLeastHullCameras, kHullCameras);
    std::vector<uint32_t> expected;
    for (size_t k = 0; k < p.views.size(); k += strideFor(p.views.size(), wanted)) expected.push_back(p.views[k].images[0]);
    p.images->expect(expected);
    for (size_t k = 0; k < p.views.size(); k += strideFor(p.views.size(), wanted)) {
        if (Status s = tick("loading"); !s) return s.error();
        auto image = p.images->get(p.views[k].images[0]);
        if (!image) continue; // training says so
        const size_t pixels = size_t((*image)->width) * (*image)->height;
        std::vector<uint8_t> mask(pixels);
        size_t object = 0, background = 0;
        for (size_t i = 0; i < pixels; ++i) {
            mask[i] = !(*image)->isKnown(i) ? kMaskUnknown : (*image)->planes[3 * pixels + i] >= kObjectAlpha ? kMaskObject : kMaskBackground;
            object += mask[i] == kMaskObject, background += mask[i] == kMaskBackground;
        }
        if (object == 0) {
            if (found.empty++ == 0) found.firstEmpty = p.split->images[p.views[k].images[0]].path;
            emptyCameras.push_back(p.split->cameras[p.views[k].camera]);
            continue;
        }
        ++withObject;
        withBackground += double(background) > kBackgroundShare * double(pixels);
        found.masks.push_back(std::move(mask));
        found.images.push_back(p.views[k].images[0]);
        found.cameras.push_back(p.split->cameras[p.views[k].camera]);
    }
    // A few masks among images without alpha say too little; a view so near that the object fills it is no reason against the others.
    found.silhouettes = withObject == 0 ? Silhouettes::kEmpty : 4 * withBackground < withObject ? Silhouettes::kOpaque : Silhouettes::kGood;
    if (withObject == 0) found.cameras = std::move(emptyCameras); // they still frame the object
    return found;
}

// Without silhouettes the hull is the cube that all cameras see.
Result<VisualHull> findHull(const AssetFrame& frame, const Masks& masks, const OlatSplit& split, std::vector<std::string>& warnings)
{
    VisualHull hull;
    if (masks.silhouettes != Silhouettes::kGood) {
        frameCube(masks.cameras, hull.center, &hull.halfSize);
        return hull;
    }
    std::vector<size_t> wrong;
    hull = carveVisualHull(masks.cameras, masks.masks, kHullResolution, &wrong);
    if (!wrong.empty())
        warnings.push_back(std::to_string(wrong.size()) + " of " + std::to_string(masks.masks.size()) + " masks contradict the others, the first is that of " +
                           split.images[masks.images[wrong[0]]].path + ": they are not used to find the shape; mend their alpha, check their poses or leave them out");
    if (hull.surface.empty())
        warnings.push_back("the alphas leave no visual hull: starting from random points in the common view of the cameras");
    if (Status s = checkLights(frame, split, hull, warnings); !s) return s.error();
    return hull;
}

// Half the longest side of the object's box.
float objectSize(const VisualHull& hull)
{
    float extent = 0;
    for (const OrientedPoint& p : hull.surface)
        for (int k = 0; k < 3; ++k) extent = std::max(extent, std::abs(p.position[k] - hull.center[k]));
    return extent > 0 ? extent : hull.halfSize;
}

// More splats than pixels of the surface, seen from the nearest camera, only learn noise, which neighbours that answer an unseen light differently show
// as blotches. (monkey_fur, 128 x 128, 4136 pixels of the object in an image, masked test, highlights invented, 5000 steps: 24000 splats 20.64 dB
// and 0.058 % after 9721 steps; 8000, 4500 and 2500 splats 21.32, 21.49 and 21.54 dB, 0.040, 0.020 and 0.001 %. Smooth surfaces want more: bunny_wax,
// 14061 pixels, 3000 steps, 24000 and 16000 splats 30.24 and 30.15 dB; monkey_relief 24000 and 12000 splats 26.72 and 26.39 dB; relief_coat_a,
// 10126 pixels, 1500 steps, 24000 and 14000 splats 26.74 and 26.49 dB. So this only keeps the worst away.)
size_t splatsForPixels(const VisualHull& hull, const std::vector<Camera>& cameras)
{
    constexpr double kSplatsPerPixel = 0.8; // of the whole surface, of which a view sees a quarter if it is convex
    constexpr size_t kLeast = 1000;
    double pixel = std::numeric_limits<double>::infinity();
    for (const Camera& c : cameras)
        pixel = std::min(pixel, glm::distance(glm::dvec3(c.worldFromCamera[3]), glm::dvec3(hull.center[0], hull.center[1], hull.center[2])) / c.fx);
    return std::max(kLeast, size_t(std::min(kSplatsPerPixel * hull.surfaceArea / (pixel * pixel), 1e9)));
}

size_t firstSplats(const Preparation& p) { return std::max<size_t>(1, size_t(kInitialShare * double(p.trainer.maxSplats))); }

/// Brightness of a prepared image, in means over squares of pixels.
StereoView stereoView(const Camera& camera, const PreparedImage& image, int side)
{
    const int by = std::max(1, std::max(image.width, image.height) / side);
    StereoView view{camera, {}};
    Camera& c = view.camera;
    c.width = image.width / by, c.height = image.height / by;
    for (double* length : {&c.fx, &c.fy, &c.cx, &c.cy}) *length /= by;
    const size_t pixels = size_t(image.width) * size_t(image.height);
    for (int y = 0; y < c.height; ++y)
        for (int x = 0; x < c.width; ++x) {
            float sum = 0;
            bool known = true;
            for (int k = 0; k < by * by; ++k) {
                const size_t i = size_t(y * by + k / by) * size_t(image.width) + size_t(x * by + k % by);
                known = known && image.isKnown(i);
                sum += 0.2126f * float(image.planes[i]) + 0.7152f * float(image.planes[pixels + i]) + 0.0722f * float(image.planes[2 * pixels + i]);
            }
            view.luma.push_back(known ? sum / (65535.0f * float(by * by)) : -1.0f);
        }
    return view;
}

ObjectRegion boundsInAsset(const AssetFrame& frame, const glm::dvec4& bounds)
{
    return {glm::vec3(frame.positionInAsset(glm::dvec3(bounds))), float(bounds.w / frame.scale)};
}

/// What stereo finds in views without masks.
Result<std::vector<glm::vec3>> surfacePoints(Preparation& p, const Tick& tick)
{
    constexpr size_t kViews = 60; // more find hardly more
    constexpr int kSide = 192;    // pixels that they are shrunk to, about
    std::vector<StereoView> views;
    for (size_t k = 0; k < p.views.size(); k += strideFor(p.views.size(), kViews)) {
        if (Status s = tick("hull"); !s) return s.error();
        auto image = p.images->get(p.views[k].images[0]);
        if (image) views.push_back(stereoView(p.split->cameras[p.views[k].camera], **image, kSide));
    }
    Status goesOn = ok();
    const auto goOn = [&] {
        goesOn = tick("hull");
        return bool(goesOn);
    };
    std::vector<glm::vec3> points = stereoPoints(views, p.region->center, p.region->radius, goOn);
    if (!goesOn) return goesOn.error();
    return points;
}

void placeSplats(Preparation& p, const VisualHull& hull)
{
    const size_t count = firstSplats(p);
    p.flat = !hull.surface.empty();
    p.spacing = float(p.flat ? std::sqrt(hull.surfaceArea / double(count)) : 2.0 * hull.halfSize / std::cbrt(double(count)));
    p.points = sampleHull(hull, count, p.trainer.seed);
}

// What the object sends back of the light that falls on it: mean radiance against that of a white Lambertian surface at its
// centre whose cosine and visibility are kMeanFacing in the mean.
double brightness(const Preparation& p)
{
    constexpr size_t kImages = 50;
    constexpr double kMeanFacing = 0.35;
    double found = 0, white = 0;
    const std::vector<OlatImage>& images = p.split->images;
    for (size_t i = 0; i < images.size(); i += strideFor(images.size(), kImages)) {
        const Light& light = images[i].light;
        if (!light.isPunctual()) continue;
        auto image = p.images->get(uint32_t(i));
        if (!image) continue;
        const double irradiance =
            double(sampleLight(light, &p.center.x).falloff) * (light.intensity.r + light.intensity.g + light.intensity.b);
        const std::vector<uint16_t>& planes = (*image)->planes;
        const size_t pixels = size_t((*image)->width) * (*image)->height;
        for (size_t k = 0; k < pixels; ++k) {
            if (planes[3 * pixels + k] < kObjectAlpha) continue;
            for (size_t c = 0; c < 3; ++c) found += linearFromSrgb(float(planes[c * pixels + k]) / 65535.0f);
            white += kMeanFacing * irradiance / std::numbers::pi;
        }
    }
    return white > 0 ? found / white : 1.0;
}

// From lights at one distance the sss network can learn nothing about distance that direction and position do not tell it, and
// errs at others. (4000 steps, masked, near and directional: bunny_wax 26.72 and 26.87 dB with the input, 26.77 and 27.02
// without; knob_marble 27.17 and 27.96, 27.27 and 28.02.)
bool lightDistancesVary(const OlatSplit& split, const glm::dvec3& center)
{
    constexpr double kVarying = 1.5;
    double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
    for (const OlatImage& image : split.images) {
        if (!image.light.isPunctual()) continue;
        const bool point = image.light.type == LightType::kPoint;
        const double distance =
            point ? glm::distance(glm::dvec3(image.light.position), center) : std::numeric_limits<double>::infinity();
        nearest = std::min(nearest, distance), farthest = std::max(farthest, distance);
    }
    return farthest > kVarying * nearest;
}

std::vector<glm::vec3> placesOfLights(const OlatSplit& split)
{
    std::vector<glm::vec3> places;
    for (const OlatImage& image : split.images)
        if (image.light.type == LightType::kPoint) places.push_back(image.light.position);
    const auto byCoordinates = [](const glm::vec3& a, const glm::vec3& b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); };
    std::sort(places.begin(), places.end(), byCoordinates);
    places.erase(std::unique(places.begin(), places.end()), places.end());
    return places;
}

} // namespace

Result<Preparation> prepare(const OlatDataset& dataset, const BakeOptions& options, const Tick& tick)
{
    Preparation p;
    p.split = dataset.find("train");
    if (!p.split) return Error{ErrorCode::kBadInput, dataset.path + ": no 'train' split (expected transforms_train.json)"};
    p.views = groupByCamera(*p.split);
    if (Status s = checkSplit(dataset, *p.split, p.views); !s) return s.error();

    p.images = std::make_unique<TrainingImages>(dataset, *p.split, options.imageBudgetBytes);
    auto masks = loadMasks(p, tick);
    if (!masks) return masks.error();
    auto warnings = checkTrainingData(dataset, *p.split, masks->silhouettes);
    if (!warnings) return warnings.error();
    p.warnings = std::move(*warnings);
    if (masks->empty > 0 && masks->silhouettes != Silhouettes::kEmpty)
        p.warnings.push_back(std::to_string(masks->empty) + " training views have no alpha above 0.5, the first is " + masks->firstEmpty +
                             ": their masks are empty or faint and say nothing about the shape; leave these images out or mend their alpha");

    if (Status s = tick("hull"); !s) return s.error();
    auto hull = findHull(dataset.frame, *masks, *p.split, p.warnings);
    if (!hull) return hull.error();
    if (masks->silhouettes == Silhouettes::kOpaque) {
        p.region = options.bounds ? boundsInAsset(dataset.frame, *options.bounds) : regionOf(dataset.splits);
        for (int k = 0; k < 3; ++k) hull->center[k] = p.region->center[k];
        hull->halfSize = p.region->radius;
    } else if (options.bounds) {
        p.warnings.push_back("--bounds: not used, the masks of the images say where the object is");
    }
    p.center = {hull->center[0], hull->center[1], hull->center[2]};
    p.trainer.maxSplats = size_t(options.maxSplats);
    p.trainer.seed = options.seed;
    if (options.splatsByPixels && !hull->surface.empty()) p.trainer.maxSplats = std::min(p.trainer.maxSplats, splatsForPixels(*hull, masks->cameras));
    if (p.region) {
        auto points = surfacePoints(p, tick);
        if (!points) return points.error();
        p.region->plane = supportingPlane(*points, *p.region, p.split->cameras);
        p.init = splatsForRegion(*p.region, *points, firstSplats(p), p.trainer.seed);
    }
    else placeSplats(p, *hull);
    p.trainer.region = p.region;
    p.trainer.ambient = p.region.has_value();
    p.trainer.sceneSize = objectSize(*hull);
    if (options.init) {
        auto init = placedFor(dataset.frame, p.center, p.trainer.sceneSize, p.trainer.maxSplats, *options.init);
        if (!init) return init.error();
        p.init = std::move(*init);
        if (p.init.cloud.count < options.init->cloud.count)
            p.warnings.push_back("--init: starting from " + std::to_string(p.init.cloud.count) + " of " + std::to_string(options.init->cloud.count) +
                                 " splats, those that cover most (--max-splats)");
    }
    p.trainer.loss.dssim = float(options.dssim);
    if (masks->silhouettes != Silhouettes::kGood) p.trainer.loss.alphaWeight = 0;

    p.appearance = {options.sFunctions, options.without, float(brightness(p)), lightDistancesVary(*p.split, glm::dvec3(p.center))};
    p.appearance.pointLights = placesOfLights(*p.split);
    if (p.region) p.appearance.region = glm::vec4(p.region->center, p.region->radius);
    return p;
}

} // namespace nacre
