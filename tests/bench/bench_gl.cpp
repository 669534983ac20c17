// Frame times of the runtime through its public API on a headless context, everything re-evaluated in every frame, for 10 k and 30 k
// splats, bigs (s on 9 and 25 functions, without and with lobe, visibility and shadow: "sharp") and sss (with visibility and share, without),
// 1 and 16 point lights, 256 x 256 and 800 x 800 pixels.
//   bench_gl [frames] [warm-up frames] [most splats] [model]      default 50 10 30000, both models
// Prints medians of relight, sort and raster (glFinish between them), and beside relight what it cannot do without: every texel that a pass
// reads or writes, counted once per pass and splat, the multiply-adds of the network, and the rates that the time means.
#include "appearance/bigs/bigs.h"
#include "appearance/sss/sss_asset.h"
#include "asset/asset_io.h"
#include "base/random.h"
#include "eval/splat_renderer.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <utility>

using namespace nacre;

static std::string cpuName()
{
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);)
        if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
    return "unknown";
}

struct Kind {
    const char* model;
    int functions; // of s, bigs
    bool sharp;
};
constexpr Kind kKinds[] = {{"bigs", 9, false}, {"bigs", 9, true}, {"bigs", 25, false}, {"bigs", 25, true}, {"sss", 0, true}, {"sss", 0, false}};

/// A sphere of radius 0.75 of splats as wide as their spacing, in the order of a spiral, of random appearance.
static SplatAsset sphere(size_t splats, const Kind& kind)
{
    Random random(1);
    SplatAsset a;
    a.model = kind.model;
    a.cloud.count = splats;
    const float spacing = 0.75f * std::sqrt(4 * 3.14159f / float(splats));
    std::vector<float> normals, lobes;
    for (size_t i = 0; i < splats; ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(splats), phi = 2.39996f * float(i), r = std::sqrt(1 - z * z);
        const glm::vec3 n(r * std::cos(phi), r * std::sin(phi), z);
        a.cloud.positions.push_back(0.75f * n);
        a.cloud.rotations.push_back(glm::quat(1, 0, 0, 0));
        a.cloud.scales.push_back(glm::vec3(spacing));
        a.cloud.opacities.push_back(0.8f);
        normals.insert(normals.end(), {n.x, n.y, n.z});
        lobes.insert(lobes.end(), {n.x, n.y, n.z, 200, 0.5f, 0.5f, 0.5f});
    }
    const auto channel = [&](const char* name, int components, float size) {
        std::vector<float> values(splats * size_t(components));
        for (float& v : values) v = size * random.uniform();
        if (components > 0) a.channels.push_back({name, uint32_t(components), std::move(values), {}});
    };
    if (a.model == "sss") {
        channel("baseColor", 3, 1.0f), channel("material", 3, 1.0f);
        a.channels.push_back({"normal", 3, std::move(normals), {}});
        Channel network{"network", uint32_t(kSssNetworkFloats), {}, {}, true};
        for (int i = 0; i < kSssNetworkFloats; ++i) network.values.push_back(0.2f * (random.uniform() - 0.5f));
        if (!kind.sharp) std::fill_n(network.values.begin() + kSssShareOut, kSssHiddenShare + 1, 0.0f);
        a.channels.push_back(std::move(network));
    } else {
        channel("tDir", kBigsTransportFunctions, 0.2f);
        channel("tInd", 3 * kBigsTransportFunctions, 0.05f);
        channel("rho", 3, 1.0f);
        channel("s", 3 * bigsPairCount(kind.functions), 0.05f);
        if (kind.sharp) a.channels.push_back({"lobe", kBigsLobeFloats, std::move(lobes), {}}), channel("shadow", 1, 1.0f);
    }
    if (!kind.sharp) return a;
    Channel visibility{"visibility", kVisibilityTexels, {}, {}};
    for (size_t i = 0; i < splats * kVisibilityTexels; ++i) visibility.bytes.push_back(uint8_t(256 * random.uniform()));
    a.channels.push_back(std::move(visibility));
    return a;
}

static Camera camera(int size)
{
    Camera c;
    c.width = c.height = size;
    c.fx = c.fy = 1.39 * size;
    c.cx = c.cy = 0.5 * size;
    c.worldFromCamera = glm::inverse(glm::lookAt(glm::dvec3(2.2, 1.6, 1.6), glm::dvec3(0), glm::dvec3(0, 0, 1)));
    return c;
}

static std::vector<Light> ring(int count)
{
    std::vector<Light> lights(static_cast<size_t>(count));
    for (int l = 0; l < count; ++l) {
        const double phi = 2 * 3.14159 * l / count;
        lights[size_t(l)].position = {5 * std::cos(phi), 5 * std::sin(phi), 3};
        lights[size_t(l)].intensity = glm::vec3(60.0f / float(count));
    }
    return lights;
}

/// Texels are 16 bytes (float) or 8 (half), those of a map 1, four of them per light; lights and weights are left out, they are few.
static double relightFloorBytes(size_t splats, const Kind& kind, int lights)
{
    const int groups = (lights + 3) / 4, map = std::min(4 * lights, kVisibilityTexels);
    if (kind.model == std::string("sss")) {
        const int light = 16 + 2 * kSssHidden1 + map + 16 * lights; // mean, first layer (halves), map; share and scattered light out
        const int sum = 16 + 16 * lights + 16;                     // material, scattered light; their sum out
        return double(splats) * (light + sum);
    }
    int light = 16 + 8 * kBigsTransportFunctions + 2 * 16 * groups;             // mean, transport; direct and indirect out
    const int view = 16 + 8 * bigsPairCount(kind.functions) + 16 * kind.functions; // mean, s; contracted out
    int combine = 16 + 16 + 2 * 16 * groups + 16 * kind.functions + 16;         // rho, mean, direct, indirect, contracted; colour out
    if (kind.sharp) light += 16 + map + 8 * groups;                             // shadow, map; v out
    if (kind.sharp) combine += 2 * 16 + 8 * groups;                             // normal and sharpness, k, v
    return double(splats) * (light + view + combine);
}

/// Products with coefficients; bases and directions are left out.
static double relightMultiplyAdds(size_t splats, const Kind& kind, int lights)
{
    constexpr int kNetwork = kSssHidden1 * kSssLightInputs + kSssHidden2 * kSssHidden1 + kSssHidden3 * kSssHidden2 + 3 * kSssHidden3,
                  kShare = kSssHiddenShare * kSssHidden3 + kSssHiddenShare;
    if (kind.model == std::string("sss")) return double(splats) * lights * (kNetwork + (kind.sharp ? kShare : 0));
    return double(splats) * (3.0 * kind.functions * kind.functions + lights * (4.0 * kBigsTransportFunctions + 3.0 * kind.functions));
}

int main(int argc, char** argv)
{
    const int frames = argc > 1 ? std::atoi(argv[1]) : 50, warmup = argc > 2 ? std::atoi(argv[2]) : 10;
    const auto fail = [](const Error& error) {
        std::fprintf(stderr, "bench_gl: %s\n", error.message.c_str());
        return error.code == ErrorCode::kBadInput ? 2 : 1;
    };
    const size_t mostSplats = argc > 3 ? size_t(std::atol(argv[3])) : 30000;
    const std::string onlyModel = argc > 4 ? argv[4] : "";
    bool first = true;
    for (const size_t splats : {10000, 30000})
        for (const Kind& kind : kKinds) {
            if (splats > mostSplats || (!onlyModel.empty() && onlyModel != kind.model)) continue;
            const auto bytes = encodeAsset(sphere(splats, kind));
            if (!bytes) return fail(bytes.error());
            const auto renderer = makeGlRenderer(*bytes);
            if (!renderer) return fail(renderer.error());
            if (first) {
                std::printf("renderer: %s\nCPU: %s\nmedians of %d frames after %d, ms\n\n", (*renderer)->description().c_str(),
                            cpuName().c_str(), frames, warmup);
                std::printf("%7s %5s %3s %5s %6s %5s %9s %10s %6s %12s %6s %8s %8s %8s\n", "splats", "model", "s", "sharp", "lights", "size",
                            "relight", "floor MB", "GB/s", "M mul-adds", "G/s", "sort", "raster", "frame");
            }
            first = false;
            for (const int lights : {1, 16})
                for (const int size : {256, 800}) {
                    const auto times = (*renderer)->time(camera(size), ring(lights), warmup, frames);
                    if (!times) return fail(times.error());
                    const double floor = 1e-6 * relightFloorBytes(splats, kind, lights), products = 1e-6 * relightMultiplyAdds(splats, kind, lights);
                    std::printf("%7zu %5s %3d %5s %6d %5d %9.2f %10.2f %6.2f %12.2f %6.2f %8.2f %8.2f %8.2f\n", splats, kind.model, kind.functions,
                                kind.sharp ? "yes" : "no", lights, size, times->relightMs, floor, floor / times->relightMs, products,
                                products / times->relightMs, times->sortMs, times->rasterMs, times->frameMs);
                    std::fflush(stdout);
                }
        }
    return 0;
}
