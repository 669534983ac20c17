// Frame times of the runtime through its public API on a headless context, everything re-evaluated in every frame, for 10 k and 30 k
// splats, s on 9 and 25 functions, without and with lobe, visibility and shadow ("sharp"), 1 and 16 point lights, 256 x 256 and
// 800 x 800 pixels.
//   bench_gl [frames] [warm-up frames] [most splats]      default 50 10 30000
// Prints medians of relight, sort and raster (glFinish between them), and beside relight its floor: every texel that a relighting pass
// reads or writes, counted once per pass and splat, and the bandwidth the time means.
#include "appearance/bigs/bigs.h"
#include "asset/asset_io.h"
#include "eval/splat_renderer.h"
#include "splat/random.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <utility>

using namespace nacre;

static std::string cpuName()
{
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);)
        if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
    return "unknown";
}

/// A sphere of radius 0.75 of splats as wide as their spacing, in the order of a spiral, with small random transport.
static SplatAsset sphere(size_t splats, int functions, bool sharp)
{
    Random random(1);
    SplatAsset a;
    a.model = "bigs";
    a.cloud.count = splats;
    const float spacing = 0.75f * std::sqrt(4 * 3.14159f / float(splats));
    for (size_t i = 0; i < splats; ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(splats), phi = 2.39996f * float(i), r = std::sqrt(1 - z * z);
        a.cloud.positions.push_back(0.75f * glm::vec3(r * std::cos(phi), r * std::sin(phi), z));
        a.cloud.rotations.push_back(glm::quat(1, 0, 0, 0));
        a.cloud.scales.push_back(glm::vec3(spacing));
        a.cloud.opacities.push_back(0.8f);
    }
    const auto channel = [&](const char* name, int components, float size) {
        std::vector<float> values(splats * size_t(components));
        for (float& v : values) v = size * random.uniform();
        if (components > 0) a.channels.push_back({name, uint32_t(components), std::move(values), {}});
    };
    channel("tDir", kBigsTransportFunctions, 0.2f);
    channel("tInd", 3 * kBigsTransportFunctions, 0.05f);
    channel("rho", 3, 1.0f);
    channel("s", 3 * bigsPairCount(functions), 0.05f);
    if (!sharp) return a;
    Channel lobe{"lobe", kBigsLobeFloats, {}, {}}, visibility{"visibility", kVisibilityTexels, {}, {}};
    for (const glm::vec3& p : a.cloud.positions) {
        const glm::vec3 n = glm::normalize(p);
        lobe.values.insert(lobe.values.end(), {n.x, n.y, n.z, 200, 0.5f, 0.5f, 0.5f});
        for (int i = 0; i < kVisibilityTexels; ++i) visibility.bytes.push_back(uint8_t(256 * random.uniform()));
    }
    a.channels.push_back(std::move(lobe));
    a.channels.push_back(std::move(visibility));
    channel("shadow", 1, 1.0f);
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

/// Texels are 16 bytes (float) or 8 (half), those of a map 1, four of them per light; lights are left out, they are few.
static double relightFloorBytes(size_t splats, int functions, bool sharp, int lights)
{
    const int groups = (lights + 3) / 4;
    int light = 16 + 8 * kBigsTransportFunctions + 2 * 16 * groups;            // mean, transport; direct and indirect out
    const int view = 16 + 8 * bigsPairCount(functions) + 16 * functions;       // mean, s; contracted out
    int combine = 16 + 16 + 2 * 16 * groups + 16 * functions + 16;             // rho, mean, direct, indirect, contracted; colour out
    if (sharp) light += 16 + std::min(4 * lights, kVisibilityTexels) + 8 * groups; // shadow, map; v out
    if (sharp) combine += 2 * 16 + 8 * groups;                                         // normal and sharpness, k, v
    return double(splats) * (light + view + combine);
}

int main(int argc, char** argv)
{
    const int frames = argc > 1 ? std::atoi(argv[1]) : 50, warmup = argc > 2 ? std::atoi(argv[2]) : 10;
    const auto fail = [](const Error& error) {
        std::fprintf(stderr, "bench_gl: %s\n", error.message.c_str());
        return error.code == ErrorCode::kBadInput ? 2 : 1;
    };
    const size_t mostSplats = argc > 3 ? size_t(std::atol(argv[3])) : 30000;
    bool first = true;
    for (const size_t splats : {10000, 30000})
        for (const auto& [functions, sharp] : {std::pair{9, false}, {9, true}, {25, false}, {25, true}}) {
            if (splats > mostSplats) continue;
            const auto bytes = encodeAsset(sphere(splats, functions, sharp));
            if (!bytes) return fail(bytes.error());
            const auto renderer = makeGlRenderer(*bytes);
            if (!renderer) return fail(renderer.error());
            if (first) {
                std::printf("renderer: %s\nCPU: %s\nmedians of %d frames after %d, ms\n\n", (*renderer)->description().c_str(),
                            cpuName().c_str(), frames, warmup);
                std::printf("%7s %4s %5s %6s %5s %9s %10s %6s %8s %8s %8s\n", "splats", "s", "sharp", "lights", "size", "relight",
                            "floor MB", "GB/s", "sort", "raster", "frame");
            }
            first = false;
            for (const int lights : {1, 16})
                for (const int size : {256, 800}) {
                    const auto times = (*renderer)->time(camera(size), ring(lights), warmup, frames);
                    if (!times) return fail(times.error());
                    const double floor = relightFloorBytes(splats, functions, sharp, lights);
                    std::printf("%7zu %4d %5s %6d %5d %9.2f %10.2f %6.2f %8.2f %8.2f %8.2f\n", splats, functions, sharp ? "yes" : "no",
                                lights, size, times->relightMs, 1e-6 * floor, 1e-6 * floor / times->relightMs, times->sortMs, times->rasterMs,
                                times->frameMs);
                    std::fflush(stdout);
                }
        }
    return 0;
}
