// What each way of storing visibility costs and how far it is from the transmittance that Embree traces through the asset's
// splats: error at random splats towards random directions, root mean square. "bilinear": values as stored. "sharp": as the
// models read maps (mapVisibility), which takes the half shade of splats for the edge of a hard shadow; against the traced
// transmittance as it is, and against the same sharpened alike. "lit": weighted by max(0, n.w), with n the splat's normal.
// Seconds are processor time on one thread for all splats; what is traced is timed on the sample and scaled up.
//   visibility_error ASSET.glb... [--splats N] [--directions N]
#include "appearance/visibility_map.h"
#include "asset/asset_io.h"
#include "base/fibonacci_sphere.h"
#include "base/random.h"
#include "render/visibility_embree.h"
#include "splat/light_visibility.h"
#include "splat/splat_normals.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

using namespace nacre;

namespace {

constexpr int kFitDirections = 512;

struct Sample {
    std::vector<uint32_t> splats;
    std::vector<glm::vec3> normals;    // of these
    std::vector<glm::vec3> directions; // [splat][perSplat], as the next
    std::vector<float> truth;
    int perSplat = 0;
};

std::vector<GaussianGeometry<float>> geometryOf(const SplatCloud& c)
{
    std::vector<GaussianGeometry<float>> splats;
    for (size_t i = 0; i < c.count; ++i)
        splats.push_back({{c.positions[i].x, c.positions[i].y, c.positions[i].z},
                          {c.scales[i].x, c.scales[i].y, c.scales[i].z},
                          {c.rotations[i].w, c.rotations[i].x, c.rotations[i].y, c.rotations[i].z},
                          c.opacities[i]});
    return splats;
}

/// The splats' short axes, turned to where most light arrives.
std::vector<glm::vec3> normalsFromMaps(std::span<const GaussianGeometry<float>> splats, const std::vector<uint8_t>& maps,
                                       int size)
{
    std::vector<glm::vec3> open(splats.size(), glm::vec3(0));
    for (size_t k = 0; k < maps.size(); ++k) {
        const int t = int(k % size_t(size * size));
        open[k / size_t(size * size)] += float(maps[k]) * octahedralDirection(float(2 * (t % size) + 1) / float(size) - 1,
                                                                              float(2 * (t / size) + 1) / float(size) - 1);
    }
    return splatNormals(splats, open);
}

double secondsOf(const std::function<void()>& work)
{
    const std::clock_t start = std::clock();
    work();
    return double(std::clock() - start) / CLOCKS_PER_SEC;
}

/// Visibility of sample i towards a direction.
using Reader = std::function<float(size_t, const glm::vec3&)>;

struct Error {
    double all, lit;
};

float sharpened(float t) { return std::clamp(0.5f + kVisibilitySlope * (t - 0.5f), 0.0f, 1.0f); }

/// Root mean square of what is read and sharpened or not, against the truth sharpened or not.
Error errorOf(const Sample& sample, const Reader& read, bool sharpen, bool sharpenTruth)
{
    double squared = 0, lit = 0, weights = 0;
    for (size_t k = 0; k < sample.truth.size(); ++k) {
        const size_t i = k / size_t(sample.perSplat);
        const float value = read(i, sample.directions[k]), truth = sample.truth[k];
        const double off = (sharpen ? sharpened(value) : value) - (sharpenTruth ? sharpened(truth) : truth);
        const double weight = std::max(0.0f, glm::dot(sample.normals[i], sample.directions[k]));
        squared += off * off, lit += weight * off * off, weights += weight;
    }
    return {std::sqrt(squared / double(sample.truth.size())), std::sqrt(lit / weights)};
}

void printRow(const char* name, int bytes, double seconds, const Sample& sample, const Reader& read)
{
    const Error bilinear = errorOf(sample, read, false, false), sharp = errorOf(sample, read, true, false),
                alike = errorOf(sample, read, true, true);
    std::printf("| %s | %d | %.1f | %.3f | %.3f | %.3f | %.3f | %.3f | %.3f |\n", name, bytes, seconds, bilinear.all,
                bilinear.lit, sharp.all, sharp.lit, alike.all, alike.lit);
    std::fflush(stdout);
}

int measure(const char* path, int splatCount, int perSplat)
{
    const auto asset = readAsset(path);
    if (!asset) {
        std::fprintf(stderr, "error: %s\n", asset.error().message.c_str());
        return 2;
    }
    const std::vector<GaussianGeometry<float>> splats = geometryOf(asset->cloud);
    if (splats.empty()) return 0;
    std::unique_ptr<GaussianRayScene> scene;
    const double built = secondsOf([&] { scene = std::make_unique<GaussianRayScene>(splats); });
    std::vector<uint8_t> drawn;
    double drawnSeconds = secondsOf([&] { drawn = lightVisibility(splats, 32, 1); });

    Random random(1);
    Sample sample;
    sample.perSplat = perSplat;
    const std::vector<glm::vec3> normals = normalsFromMaps(splats, drawn, 32);
    for (int i = 0; i < splatCount; ++i) {
        sample.splats.push_back(random.below(uint32_t(splats.size())));
        sample.normals.push_back(normals[sample.splats.back()]);
        for (int k = 0; k < perSplat; ++k) {
            const float z = 2 * random.uniform() - 1, r = std::sqrt(1 - z * z),
                        phi = 2 * std::numbers::pi_v<float> * random.uniform();
            sample.directions.emplace_back(r * std::cos(phi), r * std::sin(phi), z);
        }
    }
    sample.truth.resize(sample.directions.size());
    const double traced = secondsOf([&] {
        for (size_t k = 0; k < sample.truth.size(); ++k)
            sample.truth[k] = scene->transmittanceFrom(sample.splats[k / size_t(perSplat)], sample.directions[k]);
    });
    const double scale = double(splats.size()) / double(sample.splats.size());

    std::printf("\n%s: %zu splats, %d of them towards %d directions each, %.2f us a ray, tree %.2f s\n\n",
                path + std::string(path).rfind('/') + 1, splats.size(), splatCount, perSplat,
                1e6 * traced / double(sample.truth.size()), built);
    std::printf("| visibility | bytes a splat | s | bilinear | lit | sharp | lit | sharp, both | lit "
                "|\n|---|---|---|---|---|---|---|---|---|\n");
    printRow("none: everything arrives", 0, 0, sample, [](size_t, const glm::vec3&) { return 1.0f; });
    const auto printMaps = [&](const char* name, int size, double seconds, const std::vector<uint8_t>& maps, bool ofSample) {
        printRow(name, size * size, seconds, sample, [&](size_t i, const glm::vec3& w) {
            return mapBilinear(VisibilityMap{&maps[(ofSample ? i : sample.splats[i]) * size_t(size * size)], size}, &w.x);
        });
    };
    printMaps("drawn, 32 x 32", 32, drawnSeconds, drawn, false);
    drawnSeconds = secondsOf([&] { drawn = lightVisibility(splats, 16, 1); });
    printMaps("drawn, 16 x 16", 16, drawnSeconds, drawn, false);
    drawnSeconds = secondsOf([&] { drawn = lightVisibility(splats, 16, 2); });
    printMaps("drawn, 16 x 16, means of 4 directions", 16, drawnSeconds, drawn, false);
    for (const int size : {32, 16}) {
        std::vector<uint8_t> maps;
        const double seconds = secondsOf([&] { maps = embreeVisibility(*scene, sample.splats, size, 1); });
        printMaps(size == 32 ? "traced, 32 x 32" : "traced, 16 x 16", size, built + scale * seconds, maps, true);
    }
    std::vector<glm::vec3> directions;
    for (int i = 0; i < kFitDirections; ++i) directions.emplace_back(fibonacciDirection(i, kFitDirections));
    VisibilityShFit fit;
    const double fitted =
        secondsOf([&] { fit = fitVisibilitySh3(directions, traceVisibility(*scene, sample.splats, directions)); });
    printRow("spherical harmonics of degree 3, traced", kVisibilityShFunctions * int(sizeof(float)), built + scale * fitted,
             sample, [&](size_t i, const glm::vec3& w) { return evaluateVisibilitySh3(fit.coefficients[i], w); });
    double reported = 0;
    for (const float e : fit.rmsError) reported += double(e) * double(e) / double(fit.rmsError.size());
    std::printf("\nThe fit's own account of its error (rms over its %d directions): %.4f\n", kFitDirections, std::sqrt(reported));
    return 0;
}

} // namespace

int main(int argc, char** argv)
{
    int splats = 2000, directions = 256;
    std::vector<const char*> assets;
    for (int a = 1; a < argc; ++a) {
        if (a + 1 < argc && !std::strcmp(argv[a], "--splats"))
            splats = std::max(1, std::atoi(argv[++a]));
        else if (a + 1 < argc && !std::strcmp(argv[a], "--directions"))
            directions = std::max(1, std::atoi(argv[++a]));
        else
            assets.push_back(argv[a]);
    }
    if (assets.empty()) {
        std::fprintf(stderr, "usage: visibility_error ASSET.glb... [--splats N] [--directions N]\n");
        return 2;
    }
    tbb::global_control oneThread(tbb::global_control::max_allowed_parallelism, 1);
    for (const char* path : assets)
        if (const int failed = measure(path, splats, directions)) return failed;
    return 0;
}
