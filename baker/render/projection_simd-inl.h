// SIMD twin of detail::projectionSteps (projection.h), one Gaussian per lane. The same operations in the same order and no fused
// multiply-adds, so the results are the scalar ones bit for bit. Included once per SIMD target, hence the toggled guard.
#if defined(NACRE_PROJECTION_SIMD_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef NACRE_PROJECTION_SIMD_INL_H
#undef NACRE_PROJECTION_SIMD_INL_H
#else
#define NACRE_PROJECTION_SIMD_INL_H
#endif

#include "render/projection.h"

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {

template <class V>
HWY_INLINE V dot3(const V* a, const V* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

template <class V>
HWY_INLINE void cross3(const V* a, const V* b, V* out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/// std::clamp: a value that is not a number stays one.
template <class D, class V = hwy::HWY_NAMESPACE::Vec<D>>
HWY_INLINE V clampLanes(D, V x, V lo, V hi)
{
    namespace hn = hwy::HWY_NAMESPACE;
    return hn::IfThenElse(hn::Lt(x, lo), lo, hn::IfThenElse(hn::Gt(x, hi), hi, x));
}

/// Returns 1 / length; where the quaternion is too short to have a direction 0, and the unit is (1, 0, 0, 0).
template <class D, class V = hwy::HWY_NAMESPACE::Vec<D>>
HWY_INLINE V normalizeQuaternions(D d, const V* q, V* unit)
{
    namespace hn = hwy::HWY_NAMESPACE;
    const V n2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], one = hn::Set(d, 1.0f);
    const auto usable = hn::Gt(n2, hn::Set(d, 1e-20f));
    const V inv = hn::IfThenElseZero(usable, one / hn::Sqrt(n2));
    unit[0] = hn::IfThenElse(usable, q[0] * inv, one);
    for (int k = 1; k < 4; ++k) unit[k] = hn::IfThenElseZero(usable, q[k] * inv);
    return inv;
}

template <class D>
struct ProjectionLanes {
    using V = hwy::HWY_NAMESPACE::Vec<D>;
    hwy::HWY_NAMESPACE::Mask<D> front;        // beyond the near plane; the rest means nothing where it is off
    hwy::HWY_NAMESPACE::Mask<D> freeX, freeY; // the tangent was not clamped
    V t[3], unit[4], invNorm, g[9], jx, jy, tanX, tanY, rowA[3], rowB[3], a[3], b[3], n[3];
    V cxx, cxy, cyy, detRaw, det, compensation;

    HWY_INLINE ProjectionLanes(const View<float>& view, const V* position, const V* scale, const V* rotation)
    {
        namespace hn = hwy::HWY_NAMESPACE;
        const D d;
        const auto set = [d](float x) HWY_ATTR { return hn::Set(d, x); };
        for (int i = 0; i < 3; ++i)
            t[i] = set(view.r[3 * i]) * position[0] + set(view.r[3 * i + 1]) * position[1] + set(view.r[3 * i + 2]) * position[2] + set(view.t[i]);
        front = hn::Gt(t[2], set(kNearPlane));
        invNorm = normalizeQuaternions(d, rotation, unit);
        const V w = unit[0], x = unit[1], y = unit[2], z = unit[3], one = set(1), two = set(2);
        const V m[9] = {one - two * (y * y + z * z), two * (x * y - w * z),       two * (x * z + w * y),
                        two * (x * y + w * z),       one - two * (x * x + z * z), two * (y * z - w * x),
                        two * (x * z - w * y),       two * (y * z + w * x),       one - two * (x * x + y * y)};
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k)
                g[3 * i + k] = set(view.r[3 * i]) * m[k] + set(view.r[3 * i + 1]) * m[3 + k] + set(view.r[3 * i + 2]) * m[6 + k];
        const V invZ = one / t[2];
        jx = set(view.fx) * invZ, jy = set(view.fy) * invZ;
        tanX = t[0] * invZ, tanY = t[1] * invZ;
        freeX = hn::Not(hn::Or(hn::Lt(tanX, set(view.minTanX)), hn::Gt(tanX, set(view.maxTanX))));
        freeY = hn::Not(hn::Or(hn::Lt(tanY, set(view.minTanY)), hn::Gt(tanY, set(view.maxTanY))));
        tanX = clampLanes(d, tanX, set(view.minTanX), set(view.maxTanX));
        tanY = clampLanes(d, tanY, set(view.minTanY), set(view.maxTanY));
        for (int k = 0; k < 3; ++k) {
            rowA[k] = (g[k] - tanX * g[6 + k]) * scale[k];
            rowB[k] = (g[3 + k] - tanY * g[6 + k]) * scale[k];
            a[k] = jx * rowA[k];
            b[k] = jy * rowB[k];
        }
        cross3(a, b, n);
        const V v = set(view.lowPassVariance), aa = dot3(a, a), bb = dot3(b, b);
        detRaw = dot3(n, n);
        det = detRaw + v * (aa + bb) + v * v;
        cxx = aa + v, cxy = dot3(a, b), cyy = bb + v;
        compensation = hn::Sqrt(detRaw / det);
    }
};

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#endif
