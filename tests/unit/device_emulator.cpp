// The emulator of CUDA kernels: barriers, shuffles and shared memory mean what they mean on a card, and faulty kernels do not pass.
#include "device/device.h"

#include <doctest/doctest.h>

#include <cmath>
#include <numeric>
#include <vector>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 1}, {ThreadOrder::kRandom, 2}};

/// Turns each block's numbers round. Without its barrier it is wrong.
template <bool Barrier>
struct Turn {
    static constexpr uint32_t kThreads = 64;
    struct Shared { uint32_t value[kThreads]; };
    uint32_t* data;
    void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        s.value[t.thread()] = data[t.index()];
        if (Barrier) t.sync();
        data[t.index()] = s.value[kThreads - 1 - t.thread()];
    }
};

template <class Kernel>
std::vector<uint32_t> turned(const Emulation& emulation)
{
    Device device(emulation);
    std::vector<uint32_t> values(64 * 5);
    std::iota(values.begin(), values.end(), 0u);
    Buffer<uint32_t> data;
    data.upload(device, std::span<const uint32_t>(values));
    launch(device, 5, Kernel{data.data()});
    data.download(device, std::span(values));
    return values;
}

struct Barriers { // the threads whose bit is set in `who` come to the barrier
    static constexpr uint32_t kThreads = 64;
    uint32_t from;
    void operator()(const Thread& t) const
    {
        if (t.thread() >= from) t.sync();
    }
};

struct TwoBarriers {
    static constexpr uint32_t kThreads = 32;
    void operator()(const Thread& t) const
    {
        if (t.thread() % 2) t.sync();
        else
            t.sync();
    }
};

/// A sum over the warp by shuffles, a prefix by shuffleUp, and votes of the even lanes alone.
struct WarpSums {
    static constexpr uint32_t kThreads = 64;
    double* sums;
    uint32_t* prefixes;
    uint32_t* votes;
    void operator()(const Thread& t) const
    {
        double sum = double(t.thread() + 1);
        for (uint32_t bit = 16; bit > 0; bit /= 2) sum += t.shuffleXor(kFullWarp, sum, bit);
        uint32_t prefix = t.lane();
        for (uint32_t d = 1; d < 32; d *= 2) {
            const uint32_t other = t.shuffleUp(kFullWarp, prefix, d);
            if (t.lane() >= d) prefix += other;
        }
        sums[t.thread()] = sum, prefixes[t.thread()] = prefix;
        if (t.lane() % 2) return; // the odd lanes are gone: the mask leaves them out
        votes[t.thread()] = t.ballot(0x55555555u, t.lane() % 4 == 0);
    }
};

struct LostLane { // lane 3 has ended, and the mask says it has not
    static constexpr uint32_t kThreads = 32;
    void operator()(const Thread& t) const
    {
        if (t.lane() != 3) t.ballot(kFullWarp, true);
    }
};

struct Count {
    static constexpr uint32_t kThreads = 128;
    uint32_t* sum;
    int* largest;
    void operator()(const Thread& t) const { deviceAdd(sum, t.block() + 1), deviceMax(largest, int(t.index())), deviceOr(sum + 1, 1u << t.block()); }
};

struct Unset {
    static constexpr uint32_t kThreads = 32;
    struct Shared { float value[32]; };
    float* out;
    void operator()(const Thread& t) const { out[t.thread()] = t.shared<Shared>().value[t.thread()]; }
};

} // namespace

TEST_CASE("a barrier orders shared memory in every order of threads, and its lack shows in one of them")
{
    const std::vector<uint32_t> right = turned<Turn<true>>(kOrders[0]);
    for (uint32_t i = 0; i < right.size(); ++i) CHECK(right[i] == i / 64 * 64 + 63 - i % 64);
    size_t wrong = 0;
    for (const Emulation& order : kOrders) {
        CHECK(turned<Turn<true>>(order) == right);
        wrong += turned<Turn<false>>(order) != right;
    }
    CHECK(wrong > 0);
}

TEST_CASE("barriers that not all threads reach are faults, and the device goes on")
{
    for (const Emulation& order : kOrders) {
        Device device(order);
        CHECK_THROWS_AS(launch(device, 3, Barriers{1}), KernelFault);
        CHECK_THROWS_AS(launch(device, 1, TwoBarriers{}), KernelFault);
        CHECK_THROWS_AS(launch(device, 1, LostLane{}), KernelFault);
        CHECK_NOTHROW(launch(device, 3, Barriers{0}));
    }
}

TEST_CASE("warp operations meet among the lanes of their mask")
{
    for (const Emulation& order : kOrders) {
        Device device(order);
        Buffer<double> sums;
        Buffer<uint32_t> prefixes, votes;
        sums.reserve(device, 64), prefixes.reserve(device, 64), votes.reserve(device, 64);
        votes.zero(device);
        launch(device, 1, WarpSums{sums.data(), prefixes.data(), votes.data()});
        for (uint32_t i = 0; i < 64; ++i) {
            CHECK(sums.data()[i] == (i < 32 ? 528 : 1552));
            CHECK(prefixes.data()[i] == (i % 32) * (i % 32 + 1) / 2);
            CHECK(votes.data()[i] == (i % 2 ? 0u : 0x11111111u));
        }
    }
}

TEST_CASE("atomics of many blocks add up")
{
    for (const Emulation& order : kOrders) {
        Device device(order);
        Buffer<uint32_t> sum;
        Buffer<int> largest;
        sum.reserve(device, 2), largest.reserve(device, 1);
        sum.zero(device), largest.zero(device);
        launch(device, 20, Count{sum.data(), largest.data()});
        CHECK(sum.data()[0] == 128 * 210);
        CHECK(sum.data()[1] == (1u << 20) - 1);
        CHECK(largest.data()[0] == 20 * 128 - 1);
    }
}

TEST_CASE("memory nobody wrote to is not a number, and memory ends")
{
    Device device({.memoryBytes = 1 << 20});
    Buffer<float> out;
    out.reserve(device, 32);
    CHECK(std::isnan(out.data()[0]));
    launch(device, 1, Unset{out.data()});
    for (uint32_t i = 0; i < 32; ++i) CHECK(std::isnan(out.data()[i]));
    const size_t before = device.bytes();
    Buffer<double> large;
    CHECK_THROWS_AS(large.reserve(device, 1 << 20), DeviceError);
    CHECK(device.bytes() == before);
    large.reserve(device, 1 << 10), large.data()[5] = 2;
    large.resize(device, 1 << 12);
    CHECK(large.data()[5] == 2);
    { Buffer<double> moved(std::move(large)); }
    CHECK(device.bytes() == before);
}
