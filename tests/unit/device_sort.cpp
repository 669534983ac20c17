// The stable sort on a device.
#include "device/radix_sort.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 11}};

void checkSort(const std::vector<uint32_t>& keys, uint32_t bits)
{
    const uint32_t mask = bits == 32 ? ~0u : (1u << bits) - 1;
    std::vector<uint32_t> values(keys.size()), order(keys.size());
    for (size_t i = 0; i < keys.size(); ++i) values[i] = uint32_t(3 * i + 1);
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return (keys[a] & mask) < (keys[b] & mask); });
    for (const Emulation& emulation : kOrders) {
        Device device(emulation);
        Buffer<uint32_t> deviceKeys, deviceValues;
        deviceKeys.upload(device, std::span(keys)), deviceValues.upload(device, std::span<const uint32_t>(values));
        RadixSort sort;
        sort.run(device, deviceKeys, deviceValues, bits);
        std::vector<uint32_t> sortedKeys(keys.size()), sortedValues(keys.size());
        deviceKeys.download(device, std::span(sortedKeys)), deviceValues.download(device, std::span(sortedValues));
        size_t wrong = 0;
        for (size_t i = 0; i < keys.size(); ++i) wrong += sortedKeys[i] != keys[order[i]] || sortedValues[i] != values[order[i]];
        CHECK(wrong == 0);
    }
}

} // namespace

TEST_CASE("pairs are sorted by as many bits as asked for, and equal keys keep their order")
{
    std::mt19937 random(5);
    for (const size_t count : {0, 1, 33, 700, 4096, 4097, 9001})
        for (const uint32_t bits : {1u, 12u, 31u, 32u}) {
            if (count > 4096 && bits == 1) continue;
            CAPTURE(count);
            CAPTURE(bits);
            std::vector<uint32_t> keys(count);
            for (uint32_t& key : keys) key = uint32_t(random());
            checkSort(keys, bits);
        }
}

TEST_CASE("a sort by no bits changes nothing, and neither does one of equal or of sorted keys")
{
    std::vector<uint32_t> keys(1000);
    std::iota(keys.rbegin(), keys.rend(), 0u);
    checkSort(keys, 0);
    std::sort(keys.begin(), keys.end());
    checkSort(keys, 10);
    std::fill(keys.begin(), keys.end(), 0xffffffffu);
    checkSort(keys, 32);
}
