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

/// A light as renderers hold it: four rows of four numbers, a column of the light texture (GLSL twin: sampleLight in light.glsl).
///   row 0   point: position in asset space, w: cap radius^2 in world units; directional: unit direction towards it, w: -1
///   row 1   intensity rgb, w: directional: widening of highlights (highlightWidening in light.h)
///   row 2   xyz: unit axis along which it shines, asset space, w: scale of the cone
///   row 3   x: offset of the cone, y: 1 / range^2 in world units, 0: unlimited, z: a quarter of the squared radius of what shines, which
///           widens highlights by z / distance^2, w: a LightEmission
enum LightEmission { kEmitsAround = 0, kEmitsCone = 1, kEmitsCosine = 2 };
constexpr int kLightRows = 4;

template <class T>
struct PackedLightSample {
    T direction[3], falloff, widening;
};

/// What a point `p` of asset space sees of it; worldScale2 turns squared asset distances into squared world distances. Cone and window are
/// those of KHR_lights_punctual.
template <class T>
NACRE_HD inline PackedLightSample<T> samplePackedLight(const T rows[kLightRows][4], const T* p, T worldScale2)
{
    if (rows[0][3] < T(0)) return {{rows[0][0], rows[0][1], rows[0][2]}, T(1), rows[1][3]};
    using std::sqrt;
    PackedLightSample<T> s{};
    T d[3], r2 = T(0);
    for (int c = 0; c < 3; ++c) d[c] = rows[0][c] - p[c], r2 += d[c] * d[c];
    const T inverse = r2 > T(1e-20) ? T(1) / sqrt(r2) : T(0), distance2 = r2 * worldScale2;
    for (int c = 0; c < 3; ++c) s.direction[c] = inverse > T(0) ? d[c] * inverse : T(c == 2);
    s.falloff = T(1) / (distance2 > rows[0][3] ? distance2 : rows[0][3]);
    s.widening = rows[3][2] * s.falloff;
    const T reach = distance2 * rows[3][1] < T(1) ? distance2 * rows[3][1] : T(1);
    s.falloff *= T(1) - reach * reach;
    if (rows[3][3] > T(0)) {
        T shines = rows[3][0];
        for (int c = 0; c < 3; ++c) shines -= rows[2][3] * rows[2][c] * s.direction[c];
        shines = shines > T(0) ? (shines < T(1) ? shines : T(1)) : T(0);
        s.falloff *= rows[3][3] < T(kEmitsCosine) ? shines * shines : shines;
    }
    return s;
}

} // namespace nacre
