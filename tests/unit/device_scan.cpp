// Sums of all that comes before, on a device.
#include "device/scan.h"

#include <doctest/doctest.h>

#include <random>
#include <vector>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 7}};

std::vector<uint32_t> scanned(const Emulation& order, const std::vector<uint32_t>& in, bool inPlace)
{
    Device device(order);
    Buffer<uint32_t> from, to;
    from.upload(device, std::span(in));
    from.resize(device, in.size() + 1), to.reserve(device, in.size() + 1);
    Scan scan;
    uint32_t* const out = inPlace ? from.data() : to.data();
    scan.run(device, from.data(), out, uint32_t(in.size()));
    std::vector<uint32_t> result(in.size() + 1);
    device.copyOut(result.data(), out, result.size() * sizeof(uint32_t));
    return result;
}

} // namespace

TEST_CASE("a scan is the sum of what comes before, for any count, in place or not")
{
    std::mt19937 random(3);
    for (const size_t count : {0, 1, 31, 255, 2047, 2048, 2049, 4096, 4097, 30001}) {
        CAPTURE(count);
        std::vector<uint32_t> in(count), expected(1, 0);
        for (uint32_t& x : in) x = random() % 100, expected.push_back(expected.back() + x);
        for (const Emulation& order : kOrders)
            for (const bool inPlace : {false, true}) CHECK(scanned(order, in, inPlace) == expected);
    }
}

TEST_CASE("sums without room in 32 bits stay the largest number instead of beginning anew")
{
    for (const size_t count : {3, 5000}) {
        std::vector<uint32_t> in(count, 0);
        in[0] = 5, in[1] = ~0u - 2, in[count - 1] = 7;
        std::vector<uint32_t> out = scanned(kOrders[2], in, false);
        CHECK(out[1] == 5);
        CHECK(out[2] == ~0u);
        CHECK(out[count] == ~0u);
    }
}
