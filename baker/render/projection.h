// EWA projection of one Gaussian to the image plane and its gradient (Zwicker et al. 2001; Kerbl et al. 2023, appendix A), with the
// opacity-compensated low-pass of mip-splatting (Yu et al. 2024). Scalar reference: T is float or double.
//
//   t = W p + w          camera space, x right, y down, z forward
//   a, b = rows of J W R(q) diag(s), J the perspective Jacobian at t
//   Sigma' = [a.a + v, a.b; a.b, b.b + v]      v = low-pass variance, px^2
//   opacity' = opacity * sqrt(|a x b|^2 / det Sigma')
//
// |a x b|^2 = det(Sigma' - v I) and det Sigma' = |a x b|^2 + v (a.a + b.b) + v^2 are sums of squares: no cancellation however thin the
// Gaussian. Invariant: a visible result is finite, its conic positive definite.
#pragma once

#include "base/camera.h"
#include "base/host_device.h"
#include "splats/blend.h"

#include <cmath>

namespace nacre {

/// A camera prepared for projection. Row-major rotation, pixel units.
template <class T>
struct View {
    T r[9], t[3];           // camera-from-world, x right, y down, z forward
    T eye[3];               // world position
    T fx, fy, cx, cy;
    T minTanX, maxTanX, minTanY, maxTanY; // x/z and y/z in the Jacobian are clamped to these
    T width, height;
    T lowPassVariance;
};

template <class T>
inline View<T> makeView(const Camera& camera, double lowPassVariance)
{
    View<T> v{};
    const glm::dmat4& m = camera.worldFromCamera;
    const double flip[3] = {1, -1, -1}; // OpenGL camera axes -> x right, y down, z forward
    for (int i = 0; i < 3; ++i) {
        double t = 0;
        for (int k = 0; k < 3; ++k) {
            v.r[3 * i + k] = T(flip[i] * m[i][k]);
            t -= flip[i] * m[i][k] * m[3][k];
        }
        v.t[i] = T(t);
        v.eye[i] = T(m[3][i]);
    }
    v.fx = T(camera.fx), v.fy = T(camera.fy), v.cx = T(camera.cx), v.cy = T(camera.cy);
    const double marginX = kJacobianMargin * 0.5 * camera.width / camera.fx;
    const double marginY = kJacobianMargin * 0.5 * camera.height / camera.fy;
    v.minTanX = T(-camera.cx / camera.fx - marginX), v.maxTanX = T((camera.width - camera.cx) / camera.fx + marginX);
    v.minTanY = T(-camera.cy / camera.fy - marginY), v.maxTanY = T((camera.height - camera.cy) / camera.fy + marginY);
    v.width = T(camera.width), v.height = T(camera.height);
    v.lowPassVariance = T(lowPassVariance);
    return v;
}

/// Geometry of one Gaussian after its activations. The quaternion (w, x, y, z) need not be unit: it is normalised here.
template <class T>
struct GaussianGeometry {
    T position[3], scale[3], rotation[4], opacity;
};

template <class T>
struct ProjectedGaussian {
    T mean[2];       // pixels from the top-left corner, pixel centres at +0.5
    T conic[3];      // q(dx, dy) = conic[0] dx^2 + 2 conic[1] dx dy + conic[2] dy^2; alpha = opacity * exp(-q / 2)
    T opacity;       // compensated
    T distance;      // from the eye: the sort key
    T extent[2];     // half-size in pixels of the box where alpha >= kMinAlpha
};

namespace detail {

template <class T>
NACRE_HD inline T dot3(const T* a, const T* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

template <class T>
NACRE_HD inline void cross3(const T* a, const T* b, T* out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/// Unit quaternion; (1, 0, 0, 0) if it is too short to have a direction. Returns 1 / length, or 0 then.
template <class T>
NACRE_HD inline T normalizeQuaternion(const T* q, T* unit)
{
    const T n2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    if (!(n2 > T(1e-20))) {
        unit[0] = T(1), unit[1] = unit[2] = unit[3] = T(0);
        return T(0);
    }
    const T inv = T(1) / std::sqrt(n2);
    for (int i = 0; i < 4; ++i) unit[i] = q[i] * inv;
    return inv;
}

/// Row-major rotation matrix of a unit quaternion.
template <class T>
NACRE_HD inline void rotationMatrix(const T* q, T* m)
{
    const T w = q[0], x = q[1], y = q[2], z = q[3];
    m[0] = T(1) - T(2) * (y * y + z * z), m[1] = T(2) * (x * y - w * z), m[2] = T(2) * (x * z + w * y);
    m[3] = T(2) * (x * y + w * z), m[4] = T(1) - T(2) * (x * x + z * z), m[5] = T(2) * (y * z - w * x);
    m[6] = T(2) * (x * z - w * y), m[7] = T(2) * (y * z + w * x), m[8] = T(1) - T(2) * (x * x + y * y);
}

/// Everything both directions need between input and output.
template <class T>
struct ProjectionSteps {
    T t[3];             // camera space
    T unit[4], invNorm; // rotation
    T g[9];             // W R(q)
    T jx, jy, tanX, tanY;
    bool clampedX, clampedY;
    T rowA[3], rowB[3]; // rows of J W R S before the focal factor jx, jy
    T a[3], b[3], n[3]; // rows, and a x b
    T cxx, cxy, cyy, detRaw, det, compensation;
};

template <class T>
NACRE_HD inline bool projectionSteps(const View<T>& view, const GaussianGeometry<T>& g, ProjectionSteps<T>& s)
{
    for (int i = 0; i < 3; ++i) s.t[i] = dot3(&view.r[3 * i], g.position) + view.t[i];
    if (!(s.t[2] > T(kNearPlane))) return false; // positive test, so NaN is culled too
    s.invNorm = normalizeQuaternion(g.rotation, s.unit);
    T rot[9];
    rotationMatrix(s.unit, rot);
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            s.g[3 * i + k] = view.r[3 * i] * rot[k] + view.r[3 * i + 1] * rot[3 + k] + view.r[3 * i + 2] * rot[6 + k];
    const T invZ = T(1) / s.t[2];
    s.jx = view.fx * invZ, s.jy = view.fy * invZ;
    s.tanX = s.t[0] * invZ, s.tanY = s.t[1] * invZ;
    s.clampedX = s.tanX < view.minTanX || s.tanX > view.maxTanX;
    s.clampedY = s.tanY < view.minTanY || s.tanY > view.maxTanY;
    s.tanX = s.tanX < view.minTanX ? view.minTanX : s.tanX > view.maxTanX ? view.maxTanX : s.tanX;
    s.tanY = s.tanY < view.minTanY ? view.minTanY : s.tanY > view.maxTanY ? view.maxTanY : s.tanY;
    for (int k = 0; k < 3; ++k) {
        s.rowA[k] = (s.g[k] - s.tanX * s.g[6 + k]) * g.scale[k];
        s.rowB[k] = (s.g[3 + k] - s.tanY * s.g[6 + k]) * g.scale[k];
        s.a[k] = s.jx * s.rowA[k];
        s.b[k] = s.jy * s.rowB[k];
    }
    cross3(s.a, s.b, s.n);
    const T v = view.lowPassVariance, aa = dot3(s.a, s.a), bb = dot3(s.b, s.b);
    s.detRaw = dot3(s.n, s.n);
    s.det = s.detRaw + v * (aa + bb) + v * v;
    s.cxx = aa + v, s.cxy = dot3(s.a, s.b), s.cyy = bb + v;
    s.compensation = std::sqrt(s.detRaw / s.det);
    return true;
}

} // namespace detail

/// False if the Gaussian cannot be seen: behind the near plane, too faint, or entirely outside the image.
template <class T>
NACRE_HD inline bool projectGaussian(const View<T>& view, const GaussianGeometry<T>& g, ProjectedGaussian<T>& out)
{
    detail::ProjectionSteps<T> s;
    if (!detail::projectionSteps(view, g, s)) return false;
    out.opacity = g.opacity * s.compensation;
    if (!(out.opacity >= T(kMinAlpha))) return false;
    out.mean[0] = view.fx * (s.t[0] / s.t[2]) + view.cx;
    out.mean[1] = view.fy * (s.t[1] / s.t[2]) + view.cy;
    const T invDet = T(1) / s.det;
    out.conic[0] = s.cyy * invDet, out.conic[1] = -s.cxy * invDet, out.conic[2] = s.cxx * invDet;
    out.distance = std::sqrt(detail::dot3(s.t, s.t));
    const T qMax = T(2) * std::log(out.opacity / T(kMinAlpha));
    out.extent[0] = std::sqrt(qMax * s.cxx);
    out.extent[1] = std::sqrt(qMax * s.cyy);
    // Cull: positive test, so that overflow to infinity or NaN fails.
    return out.mean[0] + out.extent[0] > T(0) && out.mean[0] - out.extent[0] < view.width && out.mean[1] + out.extent[1] > T(0) &&
           out.mean[1] - out.extent[1] < view.height && std::isfinite(out.extent[0]) && std::isfinite(out.extent[1]) &&
           out.conic[0] > T(0) && out.conic[2] > T(0);
}

/// Adds (+=) to `d` the gradient of a loss with respect to position, scale, raw quaternion and opacity, given its gradient with respect
/// to mean, conic (entries as in q: conic[1] stands for both off-diagonal entries), compensated opacity and distance.
template <class T>
NACRE_HD inline void projectGaussianBackward(const View<T>& view, const GaussianGeometry<T>& g, const T dMean[2], const T dConic[3],
                                             T dOpacity, T dDistance, GaussianGeometry<T>& d)
{
    using detail::dot3;
    detail::ProjectionSteps<T> s;
    if (!detail::projectionSteps(view, g, s)) return;
    const T invDet = T(1) / s.det, v = view.lowPassVariance;

    d.opacity += dOpacity * s.compensation;
    const T dCompensation = dOpacity * g.opacity;

    // conic = adj(Sigma') / det; compensation = |n| / sqrt(det)
    const T conic[3] = {s.cyy * invDet, -s.cxy * invDet, s.cxx * invDet};
    T dDet = -(dConic[0] * conic[0] + dConic[1] * conic[1] + dConic[2] * conic[2]) * invDet;
    dDet -= T(0.5) * dCompensation * s.compensation * invDet;
    const T dAA = dConic[2] * invDet + dDet * v, dBB = dConic[0] * invDet + dDet * v, dAB = -dConic[1] * invDet;
    // n enters through det and through the compensation; |n| has a finite slope, sqrt(detRaw) would not
    const T length = std::sqrt(s.detRaw);
    const T dLength = length > T(0) ? dCompensation / (length * std::sqrt(s.det)) : T(0);
    T dN[3], bxn[3], nxa[3], dA[3], dB[3];
    for (int k = 0; k < 3; ++k) dN[k] = s.n[k] * (T(2) * dDet + dLength);
    detail::cross3(s.b, dN, bxn);
    detail::cross3(dN, s.a, nxa);
    for (int k = 0; k < 3; ++k) {
        dA[k] = T(2) * dAA * s.a[k] + dAB * s.b[k] + bxn[k];
        dB[k] = T(2) * dBB * s.b[k] + dAB * s.a[k] + nxa[k];
    }

    // a = jx (g0 - tanX g2) * scale, b = jy (g1 - tanY g2) * scale
    T dG[9], dT[3] = {T(0), T(0), T(0)}, dTanX = T(0), dTanY = T(0);
    for (int k = 0; k < 3; ++k) {
        const T da = s.jx * dA[k], db = s.jy * dB[k];
        d.scale[k] += da * (s.g[k] - s.tanX * s.g[6 + k]) + db * (s.g[3 + k] - s.tanY * s.g[6 + k]);
        const T daS = da * g.scale[k], dbS = db * g.scale[k];
        dG[k] = daS;
        dG[3 + k] = dbS;
        dG[6 + k] = -s.tanX * daS - s.tanY * dbS;
        dTanX -= daS * s.g[6 + k];
        dTanY -= dbS * s.g[6 + k];
    }
    const T invZ = T(1) / s.t[2];
    dT[2] -= (dot3(dA, s.rowA) * s.jx + dot3(dB, s.rowB) * s.jy) * invZ;
    if (!s.clampedX) dT[0] += dTanX * invZ, dT[2] -= dTanX * s.tanX * invZ;
    if (!s.clampedY) dT[1] += dTanY * invZ, dT[2] -= dTanY * s.tanY * invZ;
    dT[0] += dMean[0] * s.jx;
    dT[1] += dMean[1] * s.jy;
    dT[2] -= (dMean[0] * s.jx * s.t[0] + dMean[1] * s.jy * s.t[1]) * invZ;
    const T perLength = dDistance / std::sqrt(dot3(s.t, s.t));
    for (int k = 0; k < 3; ++k) dT[k] += perLength * s.t[k];
    for (int k = 0; k < 3; ++k) d.position[k] += view.r[k] * dT[0] + view.r[3 + k] * dT[1] + view.r[6 + k] * dT[2];

    // g = W R(q): dR = W^T dG, then through the rotation matrix and the normalisation
    T m[9];
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) m[3 * i + k] = view.r[i] * dG[k] + view.r[3 + i] * dG[3 + k] + view.r[6 + i] * dG[6 + k];
    const T w = s.unit[0], x = s.unit[1], y = s.unit[2], z = s.unit[3];
    const T dUnit[4] = {T(2) * (x * (m[7] - m[5]) + y * (m[2] - m[6]) + z * (m[3] - m[1])),
                        T(2) * (y * (m[1] + m[3]) + z * (m[2] + m[6]) + w * (m[7] - m[5])) - T(4) * x * (m[4] + m[8]),
                        T(2) * (x * (m[1] + m[3]) + z * (m[5] + m[7]) + w * (m[2] - m[6])) - T(4) * y * (m[0] + m[8]),
                        T(2) * (x * (m[2] + m[6]) + y * (m[5] + m[7]) + w * (m[3] - m[1])) - T(4) * z * (m[0] + m[4])};
    const T along = dUnit[0] * w + dUnit[1] * x + dUnit[2] * y + dUnit[3] * z;
    for (int k = 0; k < 4; ++k) d.rotation[k] += (dUnit[k] - along * s.unit[k]) * s.invNorm;
}

} // namespace nacre
