// The sRGB transfer functions (IEC 61966-2-1). Γ of design and metrics is srgbFromLinear(clamp(x, 0, 1)).
#pragma once

#include "base/host_device.h"

#include <cmath>

namespace nacre {

template <class T>
NACRE_HD inline T srgbFromLinear(T x)
{
    return x <= T(0.0031308) ? T(12.92) * x : T(1.055) * std::pow(x, T(1.0 / 2.4)) - T(0.055);
}

template <class T>
NACRE_HD inline T linearFromSrgb(T x)
{
    return x <= T(0.04045) ? x / T(12.92) : std::pow((x + T(0.055)) / T(1.055), T(2.4));
}

} // namespace nacre
