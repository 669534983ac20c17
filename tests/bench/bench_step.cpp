// One training step (one camera, 4 lights, 256 x 256, 10 k splats, full s) against its floor of bytes and flops, stage by stage.
//   bench_step [splats] [image size] [functions of s] [steps] [model]
// Prints medians. The floor counts what the algorithm must move and compute, at the bandwidth and the multiply-add rate measured
// in the same run; see the comments at each stage. Splats are opaque (0.9), so about half of them are hidden, as in a bake.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "bench/bench_step.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
// Ten independent chains of multiply-adds; returns how many scalar ones were done.
double multiplyAdds(size_t rounds, float* out)
{
    namespace hn = hwy::HWY_NAMESPACE;
    const hn::ScalableTag<float> d;
    const auto a = hn::Set(d, 0.999f), b = hn::Set(d, 0.001f);
    auto x0 = a, x1 = a, x2 = a, x3 = a, x4 = a, x5 = a, x6 = a, x7 = a, x8 = a, x9 = a;
    for (size_t i = 0; i < rounds; ++i) {
        x0 = hn::MulAdd(x0, a, b), x1 = hn::MulAdd(x1, a, b), x2 = hn::MulAdd(x2, a, b), x3 = hn::MulAdd(x3, a, b),
        x4 = hn::MulAdd(x4, a, b);
        x5 = hn::MulAdd(x5, a, b), x6 = hn::MulAdd(x6, a, b), x7 = hn::MulAdd(x7, a, b), x8 = hn::MulAdd(x8, a, b),
        x9 = hn::MulAdd(x9, a, b);
    }
    const auto sum =
        hn::Add(hn::Add(hn::Add(x0, x1), hn::Add(x2, x3)), hn::Add(hn::Add(hn::Add(x4, x5), hn::Add(x6, x7)), hn::Add(x8, x9)));
    *out = hn::GetLane(sum);
    return 10.0 * double(rounds) * double(hn::Lanes(d));
}
} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include "appearance/bigs/bigs.h"
#include "appearance/bigs/bigs_training.h"
#include "appearance/sss/sss.h"
#include "appearance/sss/sss_network.h"
#include "base/random.h"
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

// Multiply-adds per second, all threads, widest SIMD.
namespace nacre {
HWY_EXPORT(multiplyAdds);
static double measureMultiplyAdds()
{
    double best = 0;
    const auto run = HWY_DYNAMIC_DISPATCH(multiplyAdds);
    for (int repeat = 0; repeat < 5; ++repeat) {
        std::vector<double> done(64);
        std::vector<float> sink(64);
        const double start = now();
        tbb::parallel_for(size_t(0), done.size(), [&](size_t k) { done[k] = run(100000, &sink[k]); });
        double sum = 0;
        for (double n : done) sum += n;
        best = std::max(best, sum / (now() - start));
    }
    return best;
}
} // namespace nacre

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
    std::vector<OrientedPoint> points(splats);
    for (size_t i = 0; i < splats; ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(splats), phi = 2.39996f * float(i), r = std::sqrt(1 - z * z);
        points[i] = {{0.75f * r * std::cos(phi), 0.75f * r * std::sin(phi), 0.75f * z},
                     {r * std::cos(phi), r * std::sin(phi), z}};
    }
    TrainerOptions options;
    options.maxSplats = splats;
    const bool sss = argc > 5 && std::string(argv[5]) == "sss";
    Trainer trainer(options, makeTrainableAppearance(sss ? "sss" : "bigs", {functions}));
    trainer.initialize(points, float(std::sqrt(4 * 3.14159 * 0.75 * 0.75 / double(splats))), true, 0.9f);
    trainer.densify(0); // Morton order

    Light lights[4];
    for (int l = 0; l < 4; ++l)
        lights[l].position = 5.0f * glm::normalize(glm::vec3(l - 1.5f, 1.0f - l % 2, 2)), lights[l].intensity = glm::vec3(60);
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
    double visible = 0, active = 0, entries = 0, blocks = 0;
    for (int k = 0; k < steps + 10; ++k) {
        trainer.engine().resetFigures();
        const double start = now();
        trainer.step(camera(k, size), lights, references, {k + 1, 0.5});
        if (k < 10) continue;
        total.push_back(1e3 * (now() - start));
        const StepFigures figures = trainer.engine().figures();
        for (int s = 0; s < kStageCount; ++s) stage[s].push_back(1e3 * figures.stageSeconds[s]);
        visible += double(figures.visible) / steps, active += double(figures.active) / steps, entries += double(figures.entries) / steps,
            blocks += double(figures.blocks) / steps;
    }
    const auto median = [](std::vector<double> v) {
        std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
        return v[v.size() / 2];
    };

    const double bandwidth = measureBandwidth(), rate = measureMultiplyAdds();
    const double pixels = double(size) * size, covered = pixels * 3.14159 * 0.33 * 0.33;
    const double blended = sss ? kSssSurfaceChannels + 4 * kSssLightChannels : 12,
                 row = blended < 16 ? 64 : 128;                                       // channels, bytes of a splat's
    const double coefficients = 103 + 3.0 * bigsPairCount(functions), directions = 5; // four lights and the regularisers' one
    // The network: the part of its first layer that no light changes, then all that one light needs. Backwards twice as much, for
    // weights and inputs.
    const double fixedLayer = kSssHidden1 * kSssFixedInputs;
    const double network = kSssHidden1 * kSssLightInputs + kSssHidden2 * kSssHidden1 + kSssHidden3 * kSssHidden2 +
                           3 * kSssHidden3 + kSssHiddenShare * kSssHidden3 + kSssHiddenShare;
    // Bytes that must be read or written at least once if nothing stays in cache between stages.
    const double floorBytes[kStageCount] = {
        double(splats) * 44 + visible * 36 * 2, // read the geometry, write and reorder the projected
        visible * 36 + entries * (12 + 8),      // read the projected, write lists and their inverse
        sss ? visible * (44 + 36 + 4 * 4 + row) // read geometry, material and a map's texels, write the channels
            : visible * (4 * coefficients + row + 4 * 7 * directions),    // read the coefficients, write 12 colours and the terms
        visible * (row + 36) + entries * 12 + pixels * (blended + 1) * 4, // read splats and lists, write the planes
        sss ? pixels * 4 * (2 * (blended + 1) + 13 + 12 + blended + 1)
            : 0, // both ways: read planes, write 13; read planes and 12, write their gradient. bigs shades no pixels
        pixels * (13 * 4 * 2 + 4 * 8), // read planes and references, write gradients
        visible * (row + 36) + entries * (12 + 96 * 2) +
            pixels * (blended + 1) * 8,  // read planes and gradients, write and read a row per (splat, tile)
        active * (11 * 4 * 6 + 36),      // read and write raw, momentum, second moment
        sss ? active * (row + 9 * 4 * 6) // the material likewise
            : active * (4 * coefficients * 4 + 64 +
                        4 * 7 * directions)}; // read and write value and momentum; the gradient is never stored
    // Multiply-adds (or what costs as much) of the same. Blending: 16 pixels of each touched 4x4 block.
    const double blockPixels = blocks * 16;
    const double floorMacs[kStageCount] = {
        double(splats) * 100,
        visible * 60,
        sss ? visible * (fixedLayer + 4 * network)
            : visible * (3.0 * functions * functions +
                         directions * (100 + 3.0 * functions + 60)), // contraction, terms, SH of the directions
        blockPixels * (20 + blended),                                // alpha with its exponential, the channels
        sss ? covered * 4 * (60 + 60 + 120) : 0,                     // a GGX term per light: forward, again and backward
        pixels * 12 * 35,                                            // two transfer functions and the slope
        blockPixels * (20 + blended + 8 + 2 * blended),              // alpha, channels, gradient, row sums
        active * (300 + 11 * 8),                                     // through the projection, Adam
        sss ? active * (fixedLayer + 4 * 2 * network)
            : active * (directions * (100 + 3.0 * functions + 60) + 3.0 * functions * functions +
                        4 * coefficients)}; // gradient, outer product, Adam
    std::printf("%zu splats (%.0f visible, %.0f active, %.0f (splat, tile) pairs, %.0f (splat, 4x4 block) pairs)\n", splats,
                visible, active, entries, blocks);
    std::printf("%s, %dx%d, 4 lights, s on %d functions, %d threads; measured in this run: %.1f GB/s read + write, %.1f G "
                "multiply-adds/s\n\n",
                sss ? "sss" : "bigs", size, size, functions, tbb::info::default_concurrency(), bandwidth * 1e-9, rate * 1e-9);
    std::printf("%-18s %8s %10s %10s %12s %10s %8s\n", "stage", "ms", "MB", "ms floor", "M mul-adds", "ms floor", "ratio");
    double floorSum = 0;
    for (int s = 0; s < kStageCount; ++s) {
        const double ms = median(stage[s]), memory = 1e3 * floorBytes[s] / bandwidth, compute = 1e3 * floorMacs[s] / rate;
        floorSum += std::max(memory, compute);
        std::printf("%-18s %8.2f %10.2f %10.2f %12.2f %10.2f %8.1f\n", stageName(Stage(s)), ms, floorBytes[s] * 1e-6, memory,
                    floorMacs[s] * 1e-6, compute, std::max(memory, compute) > 0 ? ms / std::max(memory, compute) : 0.0);
    }
    std::printf("%-18s %8.2f %54.2f %8.1f\n", "step", median(total), floorSum, median(total) / floorSum);
    std::printf("Adam is fused into the two back stages. ratio = measured over the larger floor.\n");
    return 0;
}
#endif
