// One training step (one camera, 4 lights, 256 x 256, 10 k splats, full s) against its floor of bytes and flops, stage by stage.
//   bench_step [splats] [image size] [functions of s] [steps]
// Prints medians. The floor counts what the algorithm must move and compute, at the bandwidth and the multiply-add rate measured in the
// same run; see the comments at each stage.
#include "appearance/bigs/bigs.h"
#include "appearance/bigs/bigs_training.h"
#include "splat/random.h"
#include "train/trainer.h"

#include <tbb/info.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <glm/gtc/matrix_transform.hpp>

using namespace nacre;

static double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

// Bytes per second of read + write of arrays far larger than the caches, all threads.
static double measureBandwidth()
{
    std::vector<float> a(size_t(32) << 20, 1.0f);
    double best = 1e9;
    for (int run = 0; run < 5; ++run) {
        const double start = now();
        tbb::parallel_for(size_t(0), size_t(64), [&](size_t k) {
            float* p = a.data() + k * (a.size() / 64);
            for (size_t i = 0; i < a.size() / 64; ++i) p[i] = p[i] * 0.5f + 1.0f;
        });
        best = std::min(best, now() - start);
    }
    return 2.0 * double(a.size() * sizeof(float)) / best;
}

static Camera camera(int k, int size)
{
    const double z = 0.2 + 0.6 * ((k * 7) % 10) / 10.0, phi = 2.4 * k;
    const glm::dvec3 eye = 3.2 * glm::dvec3(std::sqrt(1 - z * z) * std::cos(phi), std::sqrt(1 - z * z) * std::sin(phi), z);
    Camera c;
    c.width = c.height = size;
    c.fx = c.fy = 1.39 * size;
    c.cx = c.cy = 0.5 * size;
    c.worldFromCamera = glm::inverse(glm::lookAt(eye, glm::dvec3(0), glm::dvec3(0, 0, 1)));
    return c;
}

int main(int argc, char** argv)
{
    const auto argument = [&](int i, int fallback) { return argc > i ? std::atoi(argv[i]) : fallback; };
    const size_t splats = size_t(argument(1, 10000));
    const int size = argument(2, 256), functions = argument(3, 25), steps = argument(4, 60);

    // A unit-sized sphere of flat splats: about a quarter of the pixels covered, as in the OLAT sets.
    std::vector<SurfacePoint> points(splats);
    for (size_t i = 0; i < splats; ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(splats), phi = 2.39996f * float(i), r = std::sqrt(1 - z * z);
        points[i] = {{0.75f * r * std::cos(phi), 0.75f * r * std::sin(phi), 0.75f * z}, {r * std::cos(phi), r * std::sin(phi), z}};
    }
    TrainerOptions options;
    options.maxSplats = splats;
    Trainer trainer(options, makeTrainableAppearance("bigs", {functions}));
    trainer.initialize(points, 4 * 3.14159 * 0.75 * 0.75, true);
    trainer.densify(0); // Morton order

    Light lights[4];
    for (int l = 0; l < 4; ++l) lights[l].position = 5.0f * glm::normalize(glm::vec3(l - 1.5f, 1.0f - l % 2, 2)), lights[l].intensity = glm::vec3(60);
    std::vector<PreparedImage> images;
    Random random(1);
    for (int l = 0; l < 4; ++l) {
        Image image{size, size, std::vector<float>(size_t(4) * size * size)};
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) {
                const bool in = std::hypot(x - size / 2, y - size / 2) < 0.33 * size;
                for (int c = 0; c < 4; ++c) image.pixel(x, y)[c] = in ? (c == 3 ? 1.0f : 0.3f + 0.2f * random.uniform()) : 0.0f;
            }
        images.push_back(prepareImage(image));
    }
    const PreparedImage* references[4] = {&images[0], &images[1], &images[2], &images[3]};

    std::vector<double> total, stage[kStageCount];
    double visible = 0, active = 0, entries = 0;
    for (int k = 0; k < steps + 10; ++k) {
        trainer.stageSeconds = {};
        const double start = now();
        trainer.step(camera(k, size), lights, references, 0.5, k + 1);
        if (k < 10) continue;
        total.push_back(1e3 * (now() - start));
        for (int s = 0; s < kStageCount; ++s) stage[s].push_back(1e3 * trainer.stageSeconds[s]);
        visible += double(trainer.lastVisible) / steps, active += double(trainer.lastActive) / steps, entries += double(trainer.lastEntries) / steps;
    }
    const auto median = [](std::vector<double> v) {
        std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
        return v[v.size() / 2];
    };

    const double bandwidth = measureBandwidth();
    const double pixels = double(size) * size, coefficients = 103 + 3.0 * bigsPairCount(functions), inUse = coefficients;
    // Floors in bytes: what must be read or written at least once if nothing stays in cache between stages.
    const double floorBytes[kStageCount] = {
        double(splats) * 44 + visible * 36 * 2,                 // read the geometry, write and sort the projected
        visible * (4 * inUse + 64),                             // read the coefficients, write 12 colours
        visible * 100 + entries * 12 + pixels * 13 * 4,         // read splats and lists, write 13 planes
        pixels * (13 * 4 * 2 + 4 * 8),                          // read planes and references, write gradients
        visible * 100 + entries * (12 + 96 * 2) + pixels * 26 * 4, // read planes and gradients, write and read a row per (splat, tile)
        active * (11 * 4 * 6 + 36),                             // read and write raw, momentum, second moment
        active * (4 * inUse * 4 + 64 + 112)};                   // read and write value and momentum; gradient never stored
    std::printf("%zu splats (%.0f visible, %.0f active, %.0f (splat, tile) pairs), %dx%d, 4 lights, s on %d functions, %d threads\n", splats,
                visible, active, entries, size, size, functions, tbb::info::default_concurrency());
    std::printf("bandwidth of this run: %.1f GB/s (read + write, all threads)\n\n", bandwidth * 1e-9);
    std::printf("%-18s %8s %10s %10s %8s\n", "stage", "ms", "MB floor", "ms floor", "ratio");
    double floorSum = 0;
    for (int s = 0; s < kStageCount; ++s) {
        const double ms = median(stage[s]), floor = 1e3 * floorBytes[s] / bandwidth;
        floorSum += floor;
        std::printf("%-18s %8.2f %10.2f %10.2f %8.1f\n", stageName(Stage(s)), ms, floorBytes[s] * 1e-6, floor, ms / floor);
    }
    // Multiply-adds of shading forward + backward per active splat: contraction 2 x 3 n^2, lights 4 x 175, the same again backward, Adam 3 a coefficient.
    const double shadeMacs = visible * (3.0 * functions * functions + 4 * 175) + active * (6.0 * functions * functions + 4 * 175 + 3 * inUse);
    std::printf("%-18s %8.2f %10s %10.2f %8.1f\n", "step", median(total), "", floorSum, median(total) / floorSum);
    std::printf("shading multiply-adds: %.1f M a step\n", shadeMacs * 1e-6);
}
