// Four floats that behave like one: templates written with select (base/select.h) run on four pixels at once. Vectors of the compiler (GCC,
// Clang), which every CPU of 64 bits has registers for: no dispatch.
#pragma once

#include "base/select.h"

#include <cmath>
#include <cstdint>
#include <cstring>

namespace nacre {

struct Lanes {
    typedef float Vector __attribute__((vector_size(16)));
    static constexpr int kCount = 4;

    Vector v;

    Lanes() = default;
    Lanes(Vector vector) : v(vector) {}
    explicit Lanes(float all) : v{all, all, all, all} {}
    explicit Lanes(double all) : Lanes(float(all)) {}
    explicit Lanes(int all) : Lanes(float(all)) {}

    /// The first `count` (1 to 4) numbers from there on; the other lanes are 0.
    static Lanes load(const float* from, int count)
    {
        Lanes out{};
        if (count == kCount) std::memcpy(&out.v, from, sizeof out.v);
        else std::memcpy(&out.v, from, size_t(count) * sizeof(float));
        return out;
    }
    void store(float* to, int count) const
    {
        if (count == kCount) std::memcpy(to, &v, sizeof v);
        else std::memcpy(to, &v, size_t(count) * sizeof(float));
    }
};

inline Lanes operator+(Lanes a, Lanes b) { return a.v + b.v; }
inline Lanes operator-(Lanes a, Lanes b) { return a.v - b.v; }
inline Lanes operator*(Lanes a, Lanes b) { return a.v * b.v; }
inline Lanes operator/(Lanes a, Lanes b) { return a.v / b.v; }
inline Lanes operator-(Lanes a) { return -a.v; }
inline Lanes& operator+=(Lanes& a, Lanes b) { return a = a + b; }
inline Lanes& operator-=(Lanes& a, Lanes b) { return a = a - b; }
inline Lanes sqrt(Lanes a)
{
    for (int lane = 0; lane < Lanes::kCount; ++lane) a.v[lane] = std::sqrt(a.v[lane]);
    return a;
}

struct LaneMask {
    typedef int32_t Vector __attribute__((vector_size(16)));
    Vector m; // all bits of a lane, or none
};
inline LaneMask operator>(Lanes a, Lanes b) { return {a.v > b.v}; }
inline LaneMask operator<(Lanes a, Lanes b) { return {a.v < b.v}; }
inline LaneMask operator&(LaneMask a, LaneMask b) { return {a.m & b.m}; }
inline Lanes select(LaneMask condition, Lanes x, Lanes y) { return condition.m ? x.v : y.v; }
inline bool any(LaneMask mask) { return mask.m[0] | mask.m[1] | mask.m[2] | mask.m[3]; }

} // namespace nacre
