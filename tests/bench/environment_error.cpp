// What an environment costs in directional lights: PSNR of the split `environment` of a dataset, drawn by the runtime with 8 to 512 of them,
// chosen as nacreContextSetEnvironment does (environmentDirections) and spread evenly; how far each is from 512 of the former; and
// milliseconds of relighting from nothing, the least of three rounds in which all numbers take turns.
//   environment_error ASSET.glb DATASET
#include "appearance/environment_directions.h"
#include "base/fibonacci_sphere.h"
#include "base/file.h"
#include "dataset/environment_map.h"
#include "dataset/olat_dataset.h"
#include "eval/evaluate.h"
#include "eval/metrics.h"
#include "eval/splat_renderer.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <vector>

using namespace nacre;

namespace {

constexpr int kCounts[] = {512, 256, 128, 64, 32, 16, 8};

double luminance(const glm::dvec3& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; }

/// Cells of about equal solid angle around Fibonacci directions.
std::vector<EnvironmentDirection> spreadEvenly(const std::vector<EnvironmentCell>& cells, int count)
{
    std::vector<EnvironmentCell> sums(static_cast<size_t>(count));
    for (const EnvironmentCell& c : cells) {
        int best = 0;
        for (int i = 1; i < count; ++i)
            if (glm::dot(fibonacciDirection(i, count), c.moment) > glm::dot(fibonacciDirection(best, count), c.moment)) best = i;
        sums[size_t(best)].power += c.power, sums[size_t(best)].moment += c.moment;
    }
    std::vector<EnvironmentDirection> out;
    for (const EnvironmentCell& s : sums)
        if (const double length = glm::length(s.moment); length > 0)
            out.push_back({s.moment / length, s.power, std::acos(std::clamp(2 * length / luminance(s.power) - 1, -1.0, 1.0))});
    return out;
}

std::vector<Light> toLights(const std::vector<EnvironmentDirection>& directions, const Light& environment)
{
    const glm::dmat3 worldFromMap = worldFromEnvironment(glm::normalize(glm::dvec3(environment.directionToLight)));
    std::vector<Light> lights;
    for (const EnvironmentDirection& d : directions) {
        Light light;
        light.type = LightType::kDirectional;
        light.directionToLight = worldFromMap * d.direction;
        light.intensity = d.irradiance * glm::dvec3(environment.intensity);
        light.radius = float(d.angularRadius);
        lights.push_back(light);
    }
    return lights;
}

template <class T>
T orExit(Result<T> r)
{
    if (!r) std::fprintf(stderr, "environment_error: %s\n", r.error().message.c_str()), std::exit(1);
    return std::move(*r);
}

} // namespace

int main(int argc, char** argv)
{
    if (argc != 3) return std::fputs("usage: environment_error ASSET.glb DATASET\n", stderr), 2;
    const std::vector<std::byte> bytes = orExit(readFile(argv[1]));
    const OlatDataset dataset = orExit(loadDataset(argv[2]));
    const OlatSplit* split = dataset.find("environment");
    if (!split) return std::fputs("no split 'environment'\n", stderr), 1;
    const auto renderer = orExit(makeGlRenderer(bytes));
    ImageCache references(dataset, size_t(64) << 20);
    std::vector<Image> exact;
    std::printf("drawn by %s\n%10s %8s %8s %12s | %12s %8s\n", renderer->description().c_str(), "directions", "PSNR", "masked", "against 512", "evenly: PSNR",
                "masked");
    for (const int count : kCounts) {
        ImageMetrics mean[2]{};
        double against = 0;
        for (size_t i = 0; i < split->images.size(); ++i) {
            const OlatImage& source = split->images[i];
            const Image map = orExit(readEnvironmentMap(source.light.environmentPath));
            const auto cells = environmentCells(map.rgba.data(), map.width, map.height, 4, count);
            const auto reference = orExit(references.load(*split, i));
            for (const int even : {0, 1}) {
                const auto lights = toLights(even ? spreadEvenly(cells, count) : environmentDirections(cells, count), source.light);
                const Image image = orExit(renderer->render(split->cameras[source.camera], lights));
                const ImageMetrics m = compareImages(image, *reference);
                mean[even].psnr += m.psnr, mean[even].psnrMasked += m.psnrMasked;
                if (even) continue;
                if (count == 512) exact.push_back(image);
                else against += compareImages(image, exact[i]).psnr;
            }
        }
        const double n = double(split->images.size());
        std::printf("%10d %8.3f %8.3f %12.2f | %12.3f %8.3f\n", count, mean[0].psnr / n, mean[0].psnrMasked / n, against / n, mean[1].psnr / n, mean[1].psnrMasked / n);
        std::fflush(stdout);
    }

    const OlatImage& source = split->images[0];
    const Image map = orExit(readEnvironmentMap(source.light.environmentPath));
    double least[std::size(kCounts)];
    std::fill(std::begin(least), std::end(least), 1e300);
    for (int round = 0; round < 3; ++round)
        for (size_t k = 0; k < std::size(kCounts); ++k) {
            const auto cells = environmentCells(map.rgba.data(), map.width, map.height, 4, kCounts[k]);
            const auto lights = toLights(environmentDirections(cells, kCounts[k]), source.light);
            least[k] = std::min(least[k], orExit(renderer->time(split->cameras[source.camera], lights, 0, 1)).relightMs);
        }
    std::printf("%10s %11s\n", "directions", "relight ms");
    for (size_t k = 0; k < std::size(kCounts); ++k) std::printf("%10d %11.1f\n", kCounts[k], least[k]);
    return 0;
}
