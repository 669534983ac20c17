// Decoding of compact assets on one core, into what goes to the GPU (channels with a basis stay codes): splats a second of CPU, and the peak of
// memory over the result's own. And how long a large asset of random integers takes to encode.
//   bench_compact ASSET.glb...
#include "asset/compact.h"
#include "base/file.h"
#include "formats_fixtures.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <malloc.h>
#include <new>

using namespace nacre;

static size_t live = 0, most = 0; // bytes; one thread

void* operator new(size_t size)
{
    void* const p = std::malloc(std::max<size_t>(size, 1));
    if (!p) throw std::bad_alloc();
    live += malloc_usable_size(p), most = std::max(most, live);
    return p;
}
void operator delete(void* p) noexcept
{
    if (p) live -= malloc_usable_size(p);
    std::free(p);
}
void operator delete(void* p, size_t) noexcept { operator delete(p); }

/// Seconds that this thread has run.
static double now()
{
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

static bool report(const char* name, std::span<const std::byte> bytes)
{
    double best = 1e9;
    size_t splats = 0, output = 0, peak = 0;
    for (int i = 0; i < 15; ++i) {
        const size_t before = live;
        most = live;
        const double start = now();
        const Result<SplatAsset> asset = decodeAsset(bytes);
        best = std::min(best, now() - start);
        if (!asset) {
            std::fprintf(stderr, "%s: %s\n", name, asset.error().message.c_str());
            return false;
        }
        splats = asset->cloud.count, output = live - before, peak = most - before;
    }
    std::printf("%-32s %8zu splats %6.1f bytes/splat %8.2f ms %6.2f million splats/s  result %6.1f MB, peak %.2f times that\n", name, splats,
                double(bytes.size()) / double(splats), 1e3 * best, 1e-6 * double(splats) / best, 1e-6 * double(output), double(peak) / double(output));
    return true;
}

int main(int argc, char** argv)
{
    bool good = true;
    for (int i = 1; i < argc; ++i) {
        const auto bytes = readFile(argv[i]);
        if (!bytes) return std::fprintf(stderr, "%s: %s\n", argv[i], bytes.error().message.c_str()), 2;
        const std::string path = argv[i];
        good &= report(path.substr(path.rfind('/') + 1).c_str(), *bytes);
    }
    for (const bool sss : {false, true}) {
        const QuantisedAsset quantised = test::makeQuantised(120000, sss);
        const double start = now();
        const auto bytes = encodeCompact(quantised);
        if (!bytes) return std::fprintf(stderr, "%s\n", bytes.error().message.c_str()), 2;
        std::printf("random %s: encoded in %.2f s\n", sss ? "sss" : "bigs", now() - start);
        good &= report(sss ? "random sss" : "random bigs", *bytes);
    }
    return good ? 0 : 2;
}
