// Assets, instances and views that come and go: whether GL objects, GPU bytes, heap and resident memory stay flat, and what a cycle costs.
//   bench_lifetimes [cycles]      default 10000
// A cycle makes an asset of 500 splats (bigs and sss in turns), two instances and a view, sets a light that has moved, draws at 64 x 64 and
// destroys all of it; every hundredth uses a context of its own. Prints a line at 1 %, 2 %, 5 %, 10 % ... of the cycles. Exit code 1: objects
// or GPU bytes have changed between 20 % and the end, or heap or resident memory have grown by more than the driver's own ups and downs.
#include "counting_gl.h"

#include "appearance/bigs/bigs.h"
#include "appearance/sss/sss_asset.h"
#include "asset/asset_io.h"
#include "base/random.h"

#include "nacre/nacre.h"

#include <malloc.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <vector>

using namespace nacre;
using namespace nacre::test;

static SplatAsset makeAsset(const char* model)
{
    Random random(1);
    SplatAsset a;
    a.model = model;
    a.cloud.count = 500;
    std::vector<float> normals;
    for (size_t i = 0; i < a.cloud.count; ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(a.cloud.count), phi = 2.39996f * float(i), r = std::sqrt(1 - z * z);
        const glm::vec3 n(r * std::cos(phi), r * std::sin(phi), z);
        a.cloud.positions.push_back(0.5f * n);
        a.cloud.rotations.push_back(glm::quat(1, 0, 0, 0));
        a.cloud.scales.push_back(glm::vec3(0.05f));
        a.cloud.opacities.push_back(0.8f);
        normals.insert(normals.end(), {n.x, n.y, n.z});
    }
    const auto channel = [&](const char* name, size_t components, float size, bool perAsset = false) {
        std::vector<float> values(components * (perAsset ? 1 : a.cloud.count));
        for (float& v : values) v = size * (random.uniform() - 0.2f * float(perAsset));
        a.channels.push_back({name, uint32_t(components), std::move(values), {}, perAsset});
    };
    if (a.model == "sss") {
        channel("baseColor", 3, 1), channel("material", 3, 1);
        a.channels.push_back({"normal", 3, normals, {}});
        channel("network", size_t(kSssNetworkFloats), 0.2f, true);
    } else {
        channel("tDir", kBigsTransportFunctions, 0.2f), channel("tInd", 3 * kBigsTransportFunctions, 0.05f);
        channel("rho", 3, 1), channel("s", size_t(3 * bigsPairCount(9)), 0.05f);
    }
    return a;
}

static void require(bool good, const char* what)
{
    if (good) return;
    std::fprintf(stderr, "bench_lifetimes: %s failed\n", what);
    std::exit(1);
}

static NacreContext makeContext()
{
    NacreContextDesc desc{};
    desc.structSize = sizeof desc, desc.getProcAddress = countingGl;
    desc.message = [](NacreSeverity, const char* text, void*) { std::fprintf(stderr, "nacre: %s\n", text); };
    NacreContext context{};
    require(nacreContextCreate(&desc, &context) == NACRE_OK, "nacreContextCreate");
    return context;
}

static void cycle(NacreContext context, const std::vector<std::byte>& bytes, int i)
{
    NacreInstanceDesc place{};
    place.structSize = sizeof place;
    require(nacreAssetCreate(context, bytes.data(), bytes.size(), &place.asset) == NACRE_OK, "nacreAssetCreate");
    NacreInstance instances[2]{};
    NacreView view{};
    for (int k = 0; k < 4; ++k) place.worldFromAsset[5 * k] = 1;
    for (NacreInstance& instance : instances) {
        place.worldFromAsset[12] += 0.2f;
        require(nacreInstanceCreate(&place, &instance) == NACRE_OK, "nacreInstanceCreate");
    }
    require(nacreViewCreate(context, nullptr, &view) == NACRE_OK, "nacreViewCreate");
    NacreLight light{};
    light.structSize = sizeof light;
    light.position[0] = std::cos(float(i)), light.position[2] = 3, light.intensity[0] = 5;
    require(nacreContextSetLights(context, &light, 1) == NACRE_OK, "nacreContextSetLights");
    NacreDrawDesc draw{};
    draw.structSize = sizeof draw, draw.viewportWidth = draw.viewportHeight = 64;
    for (int k = 0; k < 4; ++k) draw.viewFromWorld[5 * k] = 1;
    draw.viewFromWorld[14] = -2;
    draw.clipFromView[0] = draw.clipFromView[5] = 2;
    draw.clipFromView[10] = draw.clipFromView[11] = -1, draw.clipFromView[14] = -0.02f;
    require(nacreViewDraw(view, &draw) == NACRE_OK, "nacreViewDraw");
    if (i % 2) nacreViewDestroy(view); // in one order and in another
    nacreAssetDestroy(place.asset);
    for (const NacreInstance instance : instances) nacreInstanceDestroy(instance);
    nacreViewDestroy(view);
}

struct Memory {
    int64_t objects;
    uint64_t gpuBytes;
    size_t heap, resident;
};
static Memory measure(NacreContext context)
{
    NacreContextInfo info{};
    info.structSize = sizeof info;
    require(nacreContextGetInfo(context, &info) == NACRE_OK, "nacreContextGetInfo");
    size_t total = 0, resident = 0;
    std::ifstream("/proc/self/statm") >> total >> resident;
    return {liveObjects, info.gpuBytes, mallinfo2().uordblks, resident * size_t(sysconf(_SC_PAGESIZE))};
}

int main(int argc, char** argv)
{
    const int cycles = argc > 1 ? std::max(std::atoi(argv[1]), 100) : 10000;
    const auto gl = HeadlessGl::create();
    if (!gl) return std::fprintf(stderr, "bench_lifetimes: %s\n", gl.error().message.c_str()), 2;
    const std::vector<std::byte> files[] = {*encodeAsset(makeAsset("bigs")), *encodeAsset(makeAsset("sss"))};
    require(bool((*gl)->beginFrame(64, 64)), "a frame");
    const NacreContext context = makeContext();
    std::printf("renderer: %s\n%8s %8s %10s %12s %12s %10s\n", (*gl)->description().c_str(), "cycles", "objects", "GPU bytes", "heap bytes", "resident MB", "ms a cycle");
    Memory early{}, last{};
    auto start = std::chrono::steady_clock::now();
    int since = 0;
    for (int i = 1; i <= cycles; ++i) {
        if (i % 100 == 0) {
            const NacreContext own = makeContext();
            cycle(own, files[0], i), cycle(own, files[1], i);
            nacreContextDestroy(own);
        }
        cycle(context, files[i % 2], i);
        const int percent = int(100ll * i / cycles);
        if (100ll * i % cycles != 0 || !(percent == 1 || percent == 2 || percent == 5 || percent % 10 == 0)) continue;
        (*gl)->readFrame(); // all is drawn
        last = measure(context);
        if (percent == 20) early = last;
        const auto now = std::chrono::steady_clock::now();
        std::printf("%8d %8lld %10llu %12zu %12.1f %10.2f\n", i, static_cast<long long>(last.objects), static_cast<unsigned long long>(last.gpuBytes), last.heap,
                    double(last.resident) / 1048576, 1e3 * std::chrono::duration<double>(now - start).count() / (i - since));
        std::fflush(stdout);
        start = now, since = i;
    }
    nacreContextDestroy(context);
    std::printf("after the context: %lld objects\n", static_cast<long long>(liveObjects));
    constexpr double kDriver = 1 << 20;
    const double heap = double(last.heap) - double(early.heap), resident = double(last.resident) - double(early.resident);
    const bool flat = liveObjects == 0 && last.objects == early.objects && last.gpuBytes == early.gpuBytes && heap < kDriver && resident < kDriver;
    std::printf("from 20 %% to the end: heap %+.1f kB, resident %+.1f kB; %s\n", heap / 1024, resident / 1024, flat ? "flat" : "GROWS");
    return flat ? 0 : 1;
}
