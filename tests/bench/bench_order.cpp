// The order of a view on one core (runtime/src/order.h): sorting anew, jitter, turns and moves of the camera, many instances, against
// std::sort and the plain radix sort of the same keys, interleaved in one run.
//   bench_order [splats] [runs]
// Prints milliseconds of CPU. The floor is the bytes that any order must move, positions in and order out, at the bandwidth of
// one core that the same run measures.
#include "order.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <memory>
#include <numeric>
#include <random>
#include <string>

using namespace nacre;

/// Seconds that this thread has run: others on the machine only take its caches.
static double now()
{
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

struct Cloud {
    std::vector<glm::vec3> positions;
    std::vector<float> scales;
};

/// A thick shell of radius 1, as surfaces of objects are; neighbours in space are not neighbours in memory.
static Cloud makeCloud(size_t count)
{
    std::mt19937 rng(1);
    std::normal_distribution<float> normal;
    Cloud c;
    for (size_t g = 0; g < count; ++g) {
        const glm::vec3 p = glm::normalize(glm::vec3(normal(rng), normal(rng), normal(rng)));
        c.positions.push_back(p * (1.0f + 0.02f * normal(rng)));
        c.scales.push_back(0.003f);
    }
    return c;
}

struct View {
    glm::dvec3 eye{0.3, 0.5, 3.5}, target{0};
    glm::dvec2 jitter{0}; // ndc
    double focal = 1.4;   // of half the height

    OrderCamera camera() const
    {
        glm::mat4 p(0);
        p[0][0] = float(focal * 9 / 16), p[1][1] = float(focal), p[2][2] = p[2][3] = -1, p[3][2] = -0.02f;
        p[2][0] = float(jitter.x), p[2][1] = float(jitter.y);
        return {p, {1280, 720}, 0.01f, false};
    }
    OrderInstance see(const Cloud& cloud, size_t begin, size_t count, uint32_t first, const glm::dmat4& worldFromAsset) const
    {
        const glm::dmat4 viewFromAsset = glm::lookAt(eye, target, glm::dvec3(0, 1, 0)) * worldFromAsset;
        return {cloud.positions.data() + begin, cloud.scales.data() + begin, uint32_t(count), first, glm::mat3(worldFromAsset),
                glm::vec3(glm::dvec3(worldFromAsset[3]) - eye), glm::mat3(viewFromAsset), glm::vec3(viewFromAsset[3]), 1.0f, 0.1f};
    }
};

static std::vector<uint32_t> keysOf(const OrderInstance& i)
{
    std::vector<uint32_t> keys;
    for (uint32_t g = 0; g < i.count; ++g) {
        const glm::vec3 d = i.worldFromAsset * i.positions[g] + i.fromEye;
        keys.push_back(radixKey(glm::dot(d, d)));
    }
    return keys;
}

/// Seconds to read 12 bytes and write 4 a splat.
static double floorSeconds(size_t count)
{
    std::vector<uint32_t> in(3 * count, 1), out(count);
    double best = 1e9;
    for (int r = 0; r < 5; ++r) {
        const double start = now();
        for (size_t i = 0; i < count; ++i) out[i] = in[3 * i] + in[3 * i + 1] + in[3 * i + 2];
        best = std::min(best, now() - start);
        in[size_t(r)] = out[count - 1];
    }
    return best;
}

int main(int argc, char** argv)
{
    const size_t count = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1'000'000;
    const int runs = argc > 2 ? std::atoi(argv[2]) : 21;
    const Cloud cloud = makeCloud(count);
    const glm::dmat4 identity(1);
    const auto whole = [&](const View& v) { return std::vector<OrderInstance>{v.see(cloud, 0, count, 0, identity)}; };
    const auto hundred = [&](const View& v) { // the same splats in 100 instances, each turned
        std::vector<OrderInstance> list;
        for (size_t i = 0; i < 100; ++i)
            list.push_back(v.see(cloud, i * (count / 100), count / 100, uint32_t(i * (count / 100 + 1024) / 1024 * 1024),
                                 glm::rotate(identity, 0.06 * double(i), glm::dvec3(0, 1, 0))));
        return list;
    };
    using Instances = std::function<std::vector<OrderInstance>(const View&)>;

    struct Case {
        std::string name;
        std::function<bool()> run;   // false: nothing had to be done
        std::vector<double> times{};
        size_t drawn = 0;
    };
    std::vector<Case> cases;
    std::vector<std::unique_ptr<Order>> orders;
    const auto add = [&](const char* name, const View& start, const Instances& instances, std::function<void(View&, int)> change) {
        orders.push_back(std::make_unique<Order>());
        Order* order = orders.back().get();
        order->update(instances(start), start.camera());
        cases.push_back({name, nullptr});
        const size_t at = cases.size() - 1;
        cases.back().run = [=, &cases, n = 0]() mutable {
            View v = start;
            change(v, ++n);
            const auto list = instances(v);
            const OrderCamera camera = v.camera();
            const double begin = now();
            const bool changed = order->update(list, camera);
            cases[at].times.push_back(now() - begin);
            cases[at].drawn = order->farToNear().size();
            return changed;
        };
    };
    const View outside;
    View inside;
    inside.eye = {0.4, 0.1, 0.2}, inside.target = {1, 0.3, -0.5};
    const auto move = [](double by) { return [by](View& v, int n) { v.eye += by * glm::dvec3(n % 2, 0.3 * (n % 3), -0.5 * (n % 2)); }; };
    const auto jitter = [](View& v, int n) { v.jitter = {(n % 3 - 1) / 1280.0, (n % 2 - 0.5) / 720.0}; };
    add("at rest", outside, whole, [](View&, int) {});
    add("jitter", outside, whole, jitter);
    add("turns of 1 degree, to and fro", outside, whole, [](View& v, int n) { v.target.x = 0.06 * (n % 2); });
    add("moves of 1e-4", outside, whole, move(1e-4));
    add("moves of 1e-3", outside, whole, move(1e-3));
    add("moves of 1e-2", outside, whole, move(1e-2));
    add("moves of 1", outside, whole, move(1));
    add("100 instances, moves of 1e-2", outside, hundred, move(1e-2));
    add("inside, jitter", inside, whole, jitter);
    add("inside, turns of 5 degrees", inside, whole, [](View& v, int n) { v.target.x += 0.1 * (n % 2); });
    add("inside, moves of 1e-4", inside, whole, move(1e-4));
    add("inside, moves of 1e-2", inside, whole, move(1e-2));

    const std::vector<uint32_t> keys = keysOf(whole(outside)[0]);
    std::vector<uint32_t> index(count), sortedKeys, sorted(count);
    std::iota(index.begin(), index.end(), 0u);
    RadixScratch<uint32_t> scratch;
    BucketSort buckets;
    std::vector<uint64_t> pairs(count);
    const auto addSort = [&](const char* name, std::function<void()> prepare, std::function<void()> sort) {
        cases.push_back({name, nullptr});
        const size_t at = cases.size() - 1;
        cases.back().run = [=, &cases] {
            prepare();
            const double begin = now();
            sort();
            cases[at].times.push_back(now() - begin);
            return true;
        };
    };
    addSort("keys alone: std::sort of (key, index) in 64 bits", [&] { for (size_t i = 0; i < count; ++i) pairs[i] = uint64_t(keys[i]) << 32 | i; },
            [&] { std::sort(pairs.begin(), pairs.end()); });
    addSort("keys alone: radixSort, three digits of 11 bits", [&] { sortedKeys = keys, sorted = index; },
            [&] { radixSort(std::span(sortedKeys), std::span(sorted), scratch); });
    addSort("keys alone: BucketSort", [] {}, [&] { buckets.descending(keys, index, sorted); });

    for (int r = 0; r < runs; ++r)
        for (Case& c : cases) c.run();
    const double floor = 1e3 * floorSeconds(count);
    std::printf("%zu splats, %d runs; floor (12 bytes in, 4 out a splat): %.2f ms\n\n| case | median ms | least ms | over the floor | listed |\n|---|---|---|---|---|\n",
                count, runs, floor);
    for (Case& c : cases) {
        std::sort(c.times.begin(), c.times.end());
        const double median = 1e3 * c.times[c.times.size() / 2];
        std::printf("| %s | %.3f | %.3f | %.1f | %zu |\n", c.name.c_str(), median, 1e3 * c.times[0], median / floor, c.drawn);
    }
}
