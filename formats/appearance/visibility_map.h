// Which lights reach a splat past the others: an octahedral map of bytes per splat over the directions, which both models read.
// Host and device.
#pragma once

#include "base/host_device.h"

#include <cstdint>

namespace nacre {

constexpr int kVisibilitySize = 32; // texels per side, as baked
constexpr int kVisibilityTexels = kVisibilitySize * kVisibilitySize;
constexpr float kVisibilitySlope = 4.0f;

/// One splat's map, [size][size]; size is even. Without texels every light arrives.
struct VisibilityMap {
    const uint8_t* texels = nullptr;
    int size = kVisibilitySize;
};
/// How many texels a side of a channel's maps has.
NACRE_HD constexpr int visibilitySize(uint32_t components) { return components == 256 ? 16 : 32; }

/// Texel (i, j) of an octahedral map, one step over the border allowed: the map continues mirrored on the same edge.
NACRE_HD inline int visibilityTexel(int i, int j, int n)
{
    if (i < 0 || i >= n) i = i < 0 ? 0 : n - 1, j = n - 1 - j;
    if (j < 0 || j >= n) j = j < 0 ? 0 : n - 1, i = n - 1 - i;
    return j * n + i;
}

/// The map's bilinear value towards the unit direction w, in [0, 1]. In bounds for any w.
template <class T>
NACRE_HD inline T mapBilinear(const VisibilityMap& map, const T* w)
{
    const T ax = w[0] < T(0) ? -w[0] : w[0], ay = w[1] < T(0) ? -w[1] : w[1], az = w[2] < T(0) ? -w[2] : w[2];
    const T sum = ax + ay + az, inv = T(1) / (sum > T(0.5) ? sum : T(0.5)); // a unit vector has at least 1
    T u = w[0] * inv, v = w[1] * inv;
    if (w[2] < T(0)) { // the lower half folds outwards
        const T foldedU = (T(1) - ay * inv) * (w[0] < T(0) ? T(-1) : T(1));
        v = (T(1) - ax * inv) * (w[1] < T(0) ? T(-1) : T(1));
        u = foldedU;
    }
    const int n = map.size;
    const auto inside = [n](T t) { return t > T(0) ? (t < T(n + 1) ? t : T(n + 1)) : T(0); }; // and NaN becomes 0
    const T x = inside((u + T(1)) * T(n / 2) + T(0.5)), y = inside((v + T(1)) * T(n / 2) + T(0.5)); // texel centres at whole numbers 1..n
    int i = int(x), j = int(y);
    i = i < n ? i : n, j = j < n ? j : n;
    const T fx = x - T(i), fy = y - T(j);
    const T lower = (T(1) - fx) * T(map.texels[visibilityTexel(i - 1, j - 1, n)]) + fx * T(map.texels[visibilityTexel(i, j - 1, n)]);
    const T upper = (T(1) - fx) * T(map.texels[visibilityTexel(i - 1, j, n)]) + fx * T(map.texels[visibilityTexel(i, j, n)]);
    return ((T(1) - fy) * lower + fy * upper) * T(1.0 / 255);
}

/// Transmittance towards the unit direction w. The map holds means over its texels, so across the edge of a hard shadow the bilinear
/// value is a ramp of about two texels: the slope sharpens it around one half.
template <class T>
NACRE_HD inline T mapVisibility(const VisibilityMap& map, const T* w)
{
    const T value = T(0.5) + T(kVisibilitySlope) * (mapBilinear(map, w) - T(0.5));
    return value < T(0) ? T(0) : value > T(1) ? T(1) : value;
}

} // namespace nacre
