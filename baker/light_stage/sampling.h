// Random numbers and warps of the path tracer.
//
// Every number is a pure function of (seed, pixel, pass, sample, dimension), so images do not depend on threads or on which lights
// share a pass. The 16 samples of one pass of one pixel form an Owen-scrambled (0,2)-net in every pair of dimensions ("padding":
// each pair has its own scramble and shuffle); passes are independent, which gives an unbiased estimate of the error.
// Scrambling by hashing: Laine and Karras 2011, with the permutation of Burley 2020, "Practical Hash-based Owen Scrambling".
#pragma once

#include <glm/glm.hpp>

#include <cmath>
#include <cstdint>
#include <numbers>

namespace nacre::stage {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kInvPi = std::numbers::inv_pi_v<float>;
constexpr float kOneMinusEpsilon = 0x1.fffffep-1f;

inline uint32_t hashBits(uint32_t x) // "lowbias32": every input bit changes every output bit with probability near 1/2
{
    x ^= x >> 16;
    x *= 0x21f0aaadu;
    x ^= x >> 15;
    x *= 0xd35a2d97u;
    return x ^ (x >> 15);
}
inline uint32_t hashCombine(uint32_t seed, uint32_t v) { return hashBits(seed ^ (v * 0x9e3779b9u + (seed << 6) + (seed >> 2))); }

inline uint32_t reverseBits(uint32_t x)
{
    x = __builtin_bswap32(x);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
    x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
    return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

/// Nested uniform (Owen) scramble of a number given with its bits reversed: each bit is flipped as a function of the lower ones.
inline uint32_t owenReversed(uint32_t x, uint32_t seed)
{
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

inline float toUnitFloat(uint32_t bits) { return float(bits >> 8) * 0x1p-24f; } // [0, 1)

/// The quasi-random source of one sample of one pixel.
struct PixelSampler {
    uint32_t seed = 0;  // of pixel and pass
    uint32_t index = 0; // 0..15 within the pass

    glm::vec2 get2(uint32_t dimension) const
    {
        const uint32_t s = hashCombine(seed, dimension);
        const uint32_t shuffled = reverseBits(owenReversed(reverseBits(index), s)) & 15u;
        // The first two Sobol dimensions: the radical inverse, and the Pascal matrix applied to it.
        uint32_t second = 0;
        for (uint32_t i = shuffled, column = 1u << 31; i != 0; i >>= 1, column ^= column >> 1)
            if (i & 1u) second ^= column;
        const uint32_t x = reverseBits(owenReversed(shuffled, hashBits(s ^ 0x68bc21ebu))); // reverse of the radical inverse is the index
        const uint32_t y = reverseBits(owenReversed(reverseBits(second), hashBits(s ^ 0x02e5be93u)));
        return {toUnitFloat(x), toUnitFloat(y)};
    }
};

/// Plain random numbers for random walks, whose dimension is too high to gain from anything better. PCG-XSH-RR (O'Neill 2014).
struct Rng {
    uint64_t state = 0x853c49e6748fea9bull;
    explicit Rng(uint64_t seed = 0) : state(seed * 6364136223846793005ull + 1442695040888963407ull) { nextBits(); }
    uint32_t nextBits()
    {
        const uint64_t old = state;
        state = old * 6364136223846793005ull + 1442695040888963407ull;
        const uint32_t x = uint32_t(((old >> 18) ^ old) >> 27), r = uint32_t(old >> 59);
        return (x >> r) | (x << ((32 - r) & 31));
    }
    float next() { return toUnitFloat(nextBits()); }
    glm::vec2 next2()
    {
        const float a = next();
        return {a, next()};
    }
};

/// Right-handed orthonormal frame around a unit normal (Duff et al. 2017).
struct Frame {
    glm::vec3 t{1, 0, 0}, b{0, 1, 0}, n{0, 0, 1};
    static Frame around(const glm::vec3& n)
    {
        const float sign = std::copysign(1.0f, n.z), a = -1.0f / (sign + n.z), c = n.x * n.y * a;
        return {{1.0f + sign * n.x * n.x * a, sign * c, -sign * n.x}, {c, sign + n.y * n.y * a, -n.y}, n};
    }
    glm::vec3 toLocal(const glm::vec3& v) const { return {glm::dot(v, t), glm::dot(v, b), glm::dot(v, n)}; }
    glm::vec3 toWorld(const glm::vec3& v) const { return v.x * t + v.y * b + v.z * n; }
};

/// Cosine-weighted direction on the upper hemisphere; density cos/pi.
inline glm::vec3 sampleCosine(const glm::vec2& u)
{
    const float r = std::sqrt(u.x), phi = 2.0f * kPi * u.y;
    return {r * std::cos(phi), r * std::sin(phi), std::sqrt(std::max(0.0f, 1.0f - u.x))};
}

inline float luminance(const glm::vec3& c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }
inline float maxOf(const glm::vec3& c) { return std::max(c.x, std::max(c.y, c.z)); }
inline float sqr(float x) { return x * x; }

} // namespace nacre::stage
