#include "base/radix_sort.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

using namespace nacre;

TEST_CASE("radix sort equals a stable comparison sort")
{
    std::mt19937 rng(1);
    RadixScratch<uint32_t> scratch;
    // Key masks make every combination of digits that move or stay put.
    for (const uint32_t mask : {0xffffffffu, 0x7ffu, 0x3ff800u, 0xffc00000u, 0xffc007ffu, 0x7u, 0u})
        for (const size_t count : {0, 1, 2, 1000}) {
            std::vector<uint32_t> keys(count), order(count);
            for (uint32_t& k : keys) k = uint32_t(rng()) & mask;
            std::iota(order.begin(), order.end(), 0u);
            std::vector<uint32_t> expected = order;
            std::stable_sort(expected.begin(), expected.end(), [&](uint32_t a, uint32_t b) { return keys[a] < keys[b]; });
            radixSort(std::span(keys), std::span(order), scratch);
            CHECK(std::is_sorted(keys.begin(), keys.end()));
            CHECK(order == expected);
        }
}

TEST_CASE("radix keys order floats")
{
    const float ascending[] = {-INFINITY, -3e38f, -1.0f, -1e-40f, -0.0f, 0.0f, 1e-40f, 1e-3f, 1.0f, 3e38f, INFINITY};
    for (size_t i = 1; i < std::size(ascending); ++i) CHECK(radixKey(ascending[i - 1]) < radixKey(ascending[i]));
}
