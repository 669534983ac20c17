// A counter-based random stream (splitmix64): the stream of (seed, step) does not depend on what was drawn before, so a resumed bake
// draws what an uninterrupted one would have.
#pragma once

#include <cstdint>

namespace nacre {

class Random {
public:
    explicit Random(uint64_t seed, uint64_t stream = 0) : state_(mix(seed) ^ mix(stream * 0x9e3779b97f4a7c15ull + 1)) {}
    uint64_t next() { return mix(state_ += 0x9e3779b97f4a7c15ull); }
    float uniform() { return float(next() >> 40) * 0x1p-24f; }              // [0, 1)
    uint32_t below(uint32_t n) { return uint32_t((next() >> 32) * n >> 32); } // [0, n)

private:
    static uint64_t mix(uint64_t z)
    {
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        return z ^ (z >> 31);
    }
    uint64_t state_;
};

} // namespace nacre
