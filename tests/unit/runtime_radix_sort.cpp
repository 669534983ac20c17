#include "base/bucket_sort.h"
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

TEST_CASE("bucket sort equals a stable comparison sort turned over")
{
    std::mt19937 rng(2);
    BucketSort sort;
    // Masks make buckets of one key and of all, and every number of digits.
    for (const uint32_t mask : {0xffffffffu, 0x7fffffffu, 0xfffffu, 0x3ffu, 0xffc00000u, 0x80000001u, 0x7u, 0u})
        for (const size_t count : {0, 1, 2, 33, 1000, 2048, 100000}) {
            CAPTURE(mask);
            CAPTURE(count);
            std::vector<uint32_t> keys(count), payloads(count), index(count), expected(count), sorted(count);
            for (uint32_t& k : keys) k = uint32_t(rng()) & mask;
            if (count > 40)
                for (size_t i = 0; i < count; i += 40) keys[i] = uint32_t(rng()); // and a few far from the others
            for (size_t i = 0; i < count; ++i) payloads[i] = uint32_t(7 * i + 3), index[i] = uint32_t(i);
            std::stable_sort(index.begin(), index.end(), [&](uint32_t a, uint32_t b) { return keys[a] < keys[b]; });
            for (size_t i = 0; i < count; ++i) expected[i] = payloads[index[count - 1 - i]];
            sort.descending(keys, payloads, sorted);
            CHECK(sorted == expected);
        }
}

TEST_CASE("radix keys order floats")
{
    const float ascending[] = {-INFINITY, -3e38f, -1.0f, -1e-40f, -0.0f, 0.0f, 1e-40f, 1e-3f, 1.0f, 3e38f, INFINITY};
    for (size_t i = 1; i < std::size(ascending); ++i) CHECK(radixKey(ascending[i - 1]) < radixKey(ascending[i]));
}
