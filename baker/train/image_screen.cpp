#include "train/image_screen.h"

#include "splat/visual_hull.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>
#include <set>

namespace nacre {

constexpr float kBlack = 1.5e-4f;      // below half a step of an 8-bit display
constexpr float kWhite = 0.9999f;
constexpr double kWhiteShare = 0.9;    // of the object
constexpr double kLitSide = 0.2;       // cosine at the object between camera and light: from there some lit surface is always seen
constexpr size_t kAtOnceBytes = size_t(1) << 30, kMostAtOnce = 64; // what is decoded between two looks at the clock

static bool isUnknown(const Image& image)
{
    for (size_t i = 3; i < image.rgba.size(); i += 4)
        if (!(image.rgba[i] < 0)) return false;
    return true;
}

static bool isBlack(const Image& image)
{
    for (size_t i = 0; i < image.rgba.size(); i += 4)
        if (std::max({image.rgba[i], image.rgba[i + 1], image.rgba[i + 2]}) > kBlack) return false;
    return true;
}

static bool isEmpty(const Image& image)
{
    for (size_t i = 3; i < image.rgba.size(); i += 4)
        if (image.rgba[i] != 0) return false;
    return true;
}

/// Nearly all of the object is saturated in every channel.
static bool isWhite(const Image& image)
{
    size_t object = 0, white = 0;
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        const float* p = &image.rgba[i];
        if (p[3] >= 0 && p[3] <= 0.5f) continue;
        ++object;
        white += p[3] < 0 || std::min({p[0], p[1], p[2]}) >= kWhite;
    }
    return object > 0 && double(white) >= kWhiteShare * double(object);
}

ImageFaults::ImageFaults(const OlatSplit& split) : split_(split)
{
    float centre[3] = {}, halfSize = 0;
    if (!split.cameras.empty()) frameCube(split.cameras, centre, &halfSize);
    centre_ = {centre[0], centre[1], centre[2]};
}

std::string ImageFaults::of(const OlatImage& entry, const Image& image) const
{
    if (isUnknown(image)) return entry.path + ": no pixel can be used, all are saturated or outside of what the lens saw";
    if (split_.name == "train" && entry.light.isPunctual() && isWhite(image))
        return entry.path + ": the image is white, saturated on nearly all of the object; expose less";
    if (!isBlack(image)) return {};
    if (isEmpty(image)) return entry.path + ": nothing of the object is in the image; its " + (entry.maskPath.empty() ? "alpha" : "mask " + entry.maskPath) + " is 0 everywhere";
    const Light& light = entry.light;
    if (light.isPunctual()) {
        const glm::dvec3 toEye = split_.cameras[entry.camera].position() - centre_;
        const glm::dvec3 toLight = light.type == LightType::kPoint ? glm::dvec3(light.position) - centre_ : glm::dvec3(light.directionToLight);
        if (light.intensity == glm::vec3(0.0f) || !(glm::dot(toEye, toLight) > kLitSide * glm::length(toEye) * glm::length(toLight))) return {};
    }
    return entry.path + ": the image is black, although its light is on the camera's side of the object";
}

Status fewUnusable(const std::vector<UnusableImage>& unusable, size_t count, const std::string& split)
{
    if (3 * unusable.size() <= count) return ok();
    return Error{ErrorCode::kBadInput, std::to_string(unusable.size()) + " of " + std::to_string(count) + " images of split '" + split +
                                           "' cannot be used, more than a third; the first: " + unusable[0].why};
}

Result<std::vector<UnusableImage>> unusableImages(const OlatDataset& dataset, const OlatSplit& split,
                                                  const std::function<void(size_t, size_t)>& progress, const std::atomic<bool>* cancel)
{
    std::vector<size_t> used;
    for (size_t i = 0; i < split.images.size(); ++i)
        if (split.images[i].light.isPunctual()) used.push_back(i);
    size_t largest = 1; // bytes of one image, twice: decoders work beside what they return
    for (const Camera& camera : split.cameras)
        largest = std::max(largest, size_t(std::max(camera.width, 1)) * size_t(std::max(camera.height, 1)) * 8 * sizeof(float) * size_t(dataset.shrink * dataset.shrink));
    const size_t atOnce = std::clamp<size_t>(kAtOnceBytes / largest, 1, kMostAtOnce);

    ImageCache files(dataset, 0); // each is looked at once
    const ImageFaults faults(split);
    std::vector<std::string> fault(used.size());
    for (size_t first = 0; first < used.size(); first += atOnce) {
        if (cancel && cancel->load()) return Error{ErrorCode::kCancelled, "cancelled before training started"};
        if (progress) progress(first, used.size());
        tbb::parallel_for(first, std::min(first + atOnce, used.size()), [&](size_t k) {
            const OlatImage& entry = split.images[used[k]];
            const auto image = files.load(split, used[k]);
            fault[k] = image ? faults.of(entry, **image) : image.error().message;
        });
    }
    std::vector<UnusableImage> out;
    for (size_t k = 0; k < used.size(); ++k)
        if (!fault[k].empty()) out.push_back({split.images[used[k]].path, fault[k]});
    if (Status s = fewUnusable(out, used.size(), split.name); !s) return s.error();
    return out;
}

OlatDataset without(OlatDataset dataset, const std::string& split, const std::vector<UnusableImage>& unusable)
{
    if (unusable.empty()) return dataset;
    std::set<std::string> paths;
    for (const UnusableImage& u : unusable) paths.insert(u.path);
    for (OlatSplit& s : dataset.splits)
        if (s.name == split) std::erase_if(s.images, [&](const OlatImage& image) { return paths.count(image.path) > 0; });
    return dataset;
}

} // namespace nacre
