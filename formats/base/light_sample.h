// How one point sees one light. Scalar reference, host and device; without branches, so that T can be a number or a vector of them
// (render/lanes.h of the baker). GLSL twin: light.glsl.
#pragma once

#include "base/host_device.h"
#include "base/select.h"

#include <cmath>

namespace nacre {

/// No light is smaller than this, so that a light on top of a Gaussian stays finite (asset units).
constexpr float kMinLightRadius = 1e-3f;

/// Unit direction towards the light and the falloff that turns intensity into irradiance.
template <class T>
struct LightSample {
    T dir[3];
    T falloff;               // point light: 1 / max(distance^2, radius^2)
    T distance2 = T(0);      // 0: directional, which no movement of the point changes
};

/// Point light at `position` seen from `p`. At zero distance the direction is +Z: any unit vector is as good.
template <class T>
NACRE_HD inline LightSample<T> samplePointLight(const T* position, T radius, const T* p)
{
    using std::sqrt;
    LightSample<T> s{};
    T d[3];
    for (int c = 0; c < 3; ++c) d[c] = position[c] - p[c], s.distance2 += d[c] * d[c];
    const T inv = select(s.distance2 > T(1e-20), T(1) / sqrt(s.distance2), T(0));
    for (int c = 0; c < 3; ++c) s.dir[c] = select(inv > T(0), d[c] * inv, T(c == 2));
    const T least = select(radius > T(kMinLightRadius), radius, T(kMinLightRadius));
    s.falloff = T(1) / select(s.distance2 > least * least, s.distance2, least * least);
    return s;
}

} // namespace nacre
