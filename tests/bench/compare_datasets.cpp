// Whether two datasets describe the same capture, e.g. one scene exported in two conventions.
//   compare_datasets A B
// For every split that both have, image by image: cameras and lights must agree to 1e-5, pixels exactly where both name the same
// file and otherwise to one step of 8 bits in display encoding. The ratio of light intensities is reported apart: a convention
// without units fixes it freely. Exit code: 0 the same, 1 different, 2 a dataset does not load.
#include "base/color.h"
#include "dataset/olat_dataset.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

using namespace nacre;

namespace {

constexpr double kSame = 1e-5;        // float32 and the digits of a JSON text
constexpr double kStep = 1.0 / 255.0; // two roundings to 8 bits

struct Differences {
    double pose = 0, intrinsics = 0, light = 0;      // poses and lights in scene units, intrinsics relative to the focal length
    double gainLow = INFINITY, gainHigh = -INFINITY; // intensity in B / intensity in A
    double display = 0, alpha = 0;                   // of images in different files
    size_t sameFiles = 0, sameFilesDiffer = 0, sizesDiffer = 0, lightTypesDiffer = 0;
    bool small() const
    {
        return pose < kSame && intrinsics < kSame && light < kSame && display < kStep && alpha < kStep && sameFilesDiffer + sizesDiffer + lightTypesDiffer == 0;
    }
};

void compareCameras(const Camera& a, const Camera& b, Differences& d)
{
    d.sizesDiffer += a.width != b.width || a.height != b.height;
    for (int c = 0; c < 4; ++c)
        for (int r = 0; r < 4; ++r) d.pose = std::max(d.pose, std::fabs(a.worldFromCamera[c][r] - b.worldFromCamera[c][r]));
    for (const double x : {a.fx - b.fx, a.fy - b.fy, a.cx - b.cx, a.cy - b.cy}) d.intrinsics = std::max(d.intrinsics, std::fabs(x) / a.fx);
}

void compareLights(const Light& a, const Light& b, Differences& d)
{
    d.lightTypesDiffer += a.type != b.type;
    if (a.type == LightType::kGroup && b.type == LightType::kGroup && a.group->size() == b.group->size()) {
        for (size_t i = 0; i < a.group->size(); ++i) compareLights((*a.group)[i], (*b.group)[i], d);
        return;
    }
    if (a.type == LightType::kPoint) d.light = std::max(d.light, double(glm::distance(a.position, b.position)));
    if (a.type == LightType::kDirectional) d.light = std::max(d.light, double(glm::distance(a.directionToLight, b.directionToLight)));
    for (int c = 0; c < 3; ++c)
        if (a.intensity[c] > 0) {
            const double gain = double(b.intensity[c]) / double(a.intensity[c]);
            d.gainLow = std::min(d.gainLow, gain), d.gainHigh = std::max(d.gainHigh, gain);
        }
}

void comparePixels(const Image& a, const Image& b, bool sameFile, Differences& d)
{
    if (a.rgba.size() != b.rgba.size()) return; // already counted with the cameras
    d.sameFiles += sameFile;
    if (sameFile) {
        d.sameFilesDiffer += a.rgba != b.rgba;
        return;
    }
    const auto display = [](float x) { return srgbFromLinear(std::clamp(double(x), 0.0, 1.0)); };
    for (size_t i = 0; i < a.rgba.size(); ++i)
        if (i % 4 == 3)
            d.alpha = std::max(d.alpha, std::fabs(double(a.rgba[i]) - double(b.rgba[i])));
        else
            d.display = std::max(d.display, std::fabs(display(a.rgba[i]) - display(b.rgba[i])));
}

/// Prints one line; false if the splits differ.
Result<bool> compareSplits(const OlatSplit& a, const OlatSplit& b, ImageCache& cacheA, ImageCache& cacheB)
{
    if (a.images.size() != b.images.size()) {
        std::printf("DIFFERS %-12s %zu images against %zu\n", a.name.c_str(), a.images.size(), b.images.size());
        return false;
    }
    Differences d;
    for (size_t i = 0; i < a.images.size(); ++i) {
        const OlatImage &imageA = a.images[i], &imageB = b.images[i];
        compareCameras(a.cameras[imageA.camera], b.cameras[imageB.camera], d);
        compareLights(imageA.light, imageB.light, d);
        const auto pixelsA = cacheA.load(a, i), pixelsB = cacheB.load(b, i);
        if (!pixelsA) return pixelsA.error();
        if (!pixelsB) return pixelsB.error();
        std::error_code ignored;
        comparePixels(**pixelsA, **pixelsB, std::filesystem::equivalent(imageA.path, imageB.path, ignored), d);
    }
    std::printf("%s %-12s %zu images, %zu and %zu cameras: pose %.1e, intrinsics %.1e, light %.1e; light gain %.6g to %.6g\n",
                d.small() ? "same   " : "DIFFERS", a.name.c_str(), a.images.size(), a.cameras.size(), b.cameras.size(), d.pose, d.intrinsics,
                d.light, d.gainLow, d.gainHigh);
    std::printf("        %-12s pixels: %zu images are the same file (%zu of them read differently), %zu are not: display %.2f/255, alpha %.2f/255\n",
                "", d.sameFiles, d.sameFilesDiffer, a.images.size() - d.sameFiles, 255 * d.display, 255 * d.alpha);
    if (d.sizesDiffer + d.lightTypesDiffer)
        std::printf("        %-12s %zu images differ in size, %zu in the type of their light\n", "", d.sizesDiffer, d.lightTypesDiffer);
    return d.small();
}

int fail(const std::string& message)
{
    std::fprintf(stderr, "compare_datasets: %s\n", message.c_str());
    return 2;
}

} // namespace

int main(int argc, char** argv)
{
    if (argc != 3) return fail("usage: compare_datasets A B");
    const auto a = loadDataset(argv[1]), b = loadDataset(argv[2]);
    if (!a || !b) return fail((a ? b : a).error().message);
    ImageCache cacheA(*a, size_t(16) << 20), cacheB(*b, size_t(16) << 20); // each image is looked at once
    std::printf("%s (%s) against %s (%s)\n", argv[1], a->convention.c_str(), argv[2], b->convention.c_str());
    size_t shared = 0;
    bool same = true;
    for (const OlatSplit& splitA : a->splits)
        if (const OlatSplit* splitB = b->find(splitA.name)) {
            ++shared;
            const auto result = compareSplits(splitA, *splitB, cacheA, cacheB);
            if (!result) return fail(result.error().message);
            same = same && *result;
        }
    if (shared == 0) return fail("the datasets share no split");
    return same ? 0 : 1;
}
