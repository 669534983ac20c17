// SIMD twin of stepSplatReference and activateReference (geometry_row.h), one splat per lane: gathers the rows of as many active splats as
// there are lanes, takes the gradient through the projection, steps Adam and activates in registers, and writes the rows back.
// Lanes do not mix and only the exponential of the activation rounds differently from the reference. Parity test: tests/unit/train_geometry.cpp.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "splat/geometry_step.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "render/projection_simd-inl.h"
#include "render/simd_math-inl.h"
#include "splat/geometry.h"

#include <algorithm>
#include <cmath>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;
constexpr int kN = int(hn::MaxLanes(D()));

HWY_INLINE V set(float x) { return hn::Set(D(), x); }

/// The rows of kN splats, turned: [parameter][lane].
struct Rows {
    alignas(64) float lane[kGeometryParameters][kN];
    HWY_INLINE void gather(const GeometryRow& row, int l)
    {
        for (int k = 0; k < kGeometryParameters; ++k) lane[k][l] = row[k];
    }
    HWY_INLINE void scatter(GeometryRow& row, int l) const
    {
        for (int k = 0; k < kGeometryParameters; ++k) row[k] = lane[k][l];
    }
    HWY_INLINE V load(int k) const { return hn::Load(D(), lane[k]); }
    HWY_INLINE void store(int k, V v) { hn::Store(v, D(), lane[k]); }
};

HWY_INLINE V exponential(V x) { return exp2(D(), x * set(1.44269504f)); }

/// Twin of activateReference: bounds `raw` and fills `activated`, both in the order of GeometryRow.
HWY_INLINE void activateLanes(Rows& raw, Rows& activated)
{
    const D d;
    V rotation[4], unit[4];
    for (int k = 0; k < 4; ++k) rotation[k] = raw.load(6 + k);
    const auto lost = hn::Eq(normalizeQuaternions(d, rotation, unit), hn::Zero(d));
    for (int k = 0; k < 4; ++k) raw.store(6 + k, hn::IfThenElse(lost, unit[k], rotation[k]));
    for (int k = 0; k < 3; ++k) {
        const V logScale = clampLanes(d, raw.load(3 + k), set(kMinLogScale), set(kMaxLogScale));
        raw.store(3 + k, logScale);
        activated.store(3 + k, exponential(logScale));
    }
    const V opacity = clampLanes(d, raw.load(10), set(-kMaxOpacityLogit), set(kMaxOpacityLogit));
    raw.store(10, opacity);
    activated.store(10, set(1) / (set(1) + exponential(hn::Neg(opacity))));
    for (int k : {0, 1, 2, 6, 7, 8, 9}) activated.store(k, raw.load(k));
}

HWY_INLINE void scatterActivated(const Rows& activated, int l, GaussianGeometry<float>& g)
{
    for (int k = 0; k < 3; ++k) g.position[k] = activated.lane[k][l], g.scale[k] = activated.lane[3 + k][l];
    for (int k = 0; k < 4; ++k) g.rotation[k] = activated.lane[6 + k][l];
    g.opacity = activated.lane[10][l];
}

void activateSplat(GeometryRow& raw, GaussianGeometry<float>& activated)
{
    Rows rows, out;
    for (int l = 0; l < kN; ++l) rows.gather(raw, l);
    activateLanes(rows, out);
    rows.scatter(raw, 0);
    scatterActivated(out, 0, activated);
}

/// Twin of projectGaussianBackward and the derivatives of the activations: gradient of the raw parameters.
HWY_INLINE void rawGradient(const View<float>& view, const Rows& raw, const V* scale, V opacity, const V* dMean, const V* dConic,
                            V dOpacity, V dDistance, V opacityPull, V* out)
{
    const D d;
    const V position[3] = {raw.load(0), raw.load(1), raw.load(2)};
    const V rotation[4] = {raw.load(6), raw.load(7), raw.load(8), raw.load(9)};
    const ProjectionLanes<D> s(view, position, scale, rotation);
    const V invDet = set(1) / s.det, v = set(view.lowPassVariance), two = set(2), four = set(4), zero = hn::Zero(d);

    const V pulled = hn::IfThenElseZero(s.front, dOpacity * s.compensation) + opacityPull;
    out[10] = pulled * opacity * (set(1) - opacity);
    const V dCompensation = dOpacity * opacity;

    const V conic[3] = {s.cyy * invDet, hn::Neg(s.cxy) * invDet, s.cxx * invDet};
    V dDet = hn::Neg(dot3(dConic, conic)) * invDet;
    dDet = dDet - set(0.5f) * dCompensation * s.compensation * invDet;
    const V dAA = dConic[2] * invDet + dDet * v, dBB = dConic[0] * invDet + dDet * v, dAB = hn::Neg(dConic[1]) * invDet;
    const V length = hn::Sqrt(s.detRaw);
    const V dLength = hn::IfThenElseZero(hn::Gt(length, zero), dCompensation / (length * hn::Sqrt(s.det)));
    V dN[3], bxn[3], nxa[3], dA[3], dB[3];
    for (int k = 0; k < 3; ++k) dN[k] = s.n[k] * (two * dDet + dLength);
    cross3(s.b, dN, bxn);
    cross3(dN, s.a, nxa);
    for (int k = 0; k < 3; ++k) {
        dA[k] = two * dAA * s.a[k] + dAB * s.b[k] + bxn[k];
        dB[k] = two * dBB * s.b[k] + dAB * s.a[k] + nxa[k];
    }

    V dG[9], dTanX = zero, dTanY = zero;
    for (int k = 0; k < 3; ++k) {
        const V da = s.jx * dA[k], db = s.jy * dB[k];
        out[3 + k] = hn::IfThenElseZero(s.front, da * (s.g[k] - s.tanX * s.g[6 + k]) + db * (s.g[3 + k] - s.tanY * s.g[6 + k])) * scale[k];
        const V daS = da * scale[k], dbS = db * scale[k];
        dG[k] = daS;
        dG[3 + k] = dbS;
        dG[6 + k] = hn::Neg(s.tanX) * daS - s.tanY * dbS;
        dTanX = dTanX - daS * s.g[6 + k];
        dTanY = dTanY - dbS * s.g[6 + k];
    }
    const V invZ = set(1) / s.t[2];
    V dT[3] = {hn::IfThenElseZero(s.freeX, dTanX * invZ), hn::IfThenElseZero(s.freeY, dTanY * invZ),
               zero - (dot3(dA, s.rowA) * s.jx + dot3(dB, s.rowB) * s.jy) * invZ};
    dT[2] = dT[2] - hn::IfThenElseZero(s.freeX, dTanX * s.tanX * invZ);
    dT[2] = dT[2] - hn::IfThenElseZero(s.freeY, dTanY * s.tanY * invZ);
    dT[0] = dT[0] + dMean[0] * s.jx;
    dT[1] = dT[1] + dMean[1] * s.jy;
    dT[2] = dT[2] - (dMean[0] * s.jx * s.t[0] + dMean[1] * s.jy * s.t[1]) * invZ;
    const V perLength = dDistance / hn::Sqrt(dot3(s.t, s.t));
    for (int k = 0; k < 3; ++k) dT[k] = dT[k] + perLength * s.t[k];
    for (int k = 0; k < 3; ++k)
        out[k] = hn::IfThenElseZero(s.front, set(view.r[k]) * dT[0] + set(view.r[3 + k]) * dT[1] + set(view.r[6 + k]) * dT[2]);

    V m[9];
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            m[3 * i + k] = set(view.r[i]) * dG[k] + set(view.r[3 + i]) * dG[3 + k] + set(view.r[6 + i]) * dG[6 + k];
    const V w = s.unit[0], x = s.unit[1], y = s.unit[2], z = s.unit[3];
    const V dUnit[4] = {two * (x * (m[7] - m[5]) + y * (m[2] - m[6]) + z * (m[3] - m[1])),
                        two * (y * (m[1] + m[3]) + z * (m[2] + m[6]) + w * (m[7] - m[5])) - four * x * (m[4] + m[8]),
                        two * (x * (m[1] + m[3]) + z * (m[5] + m[7]) + w * (m[2] - m[6])) - four * y * (m[0] + m[8]),
                        two * (x * (m[2] + m[6]) + y * (m[5] + m[7]) + w * (m[3] - m[1])) - four * z * (m[0] + m[4])};
    const V along = dUnit[0] * w + dUnit[1] * x + dUnit[2] * y + dUnit[3] * z;
    for (int k = 0; k < 4; ++k) out[6 + k] = hn::IfThenElseZero(s.front, (dUnit[k] - along * s.unit[k]) * s.invNorm);
}

/// Steps the splats of the visible list's entries active[0 .. count).
void stepSplats(SplatGeometry& geometry, const View<float>& view, const uint32_t* splatFromVisible, const ScreenGradient<float>* dSplats,
                const float* dDistance, const uint32_t* active, size_t count, const GeometryAdam& adam, float opacityPull)
{
    const D d;
    Rows raw, momentum, second, activated;
    alignas(64) float shape[4][kN], screen[7][kN]; // activated scale and opacity; gradient of mean, conic, opacity, distance
    for (size_t first = 0; first < count; first += kN) {
        const int lanes = int(std::min<size_t>(kN, count - first));
        for (int l = 0; l < kN; ++l) { // a vector that is not full repeats its last splat
            const uint32_t v = active[first + std::min(l, lanes - 1)];
            const size_t i = splatFromVisible[v];
            raw.gather(geometry.raw[i], l), momentum.gather(geometry.momentum[i], l), second.gather(geometry.second[i], l);
            const GaussianGeometry<float>& g = geometry.activated[i];
            for (int k = 0; k < 3; ++k) shape[k][l] = g.scale[k];
            shape[3][l] = g.opacity;
            const ScreenGradient<float>& s = dSplats[v];
            screen[0][l] = s.mean[0], screen[1][l] = s.mean[1], screen[5][l] = s.opacity;
            for (int k = 0; k < 3; ++k) screen[2 + k][l] = s.conic[k];
            screen[6][l] = dDistance ? dDistance[v] : 0.0f;
        }
        const V scale[3] = {hn::Load(d, shape[0]), hn::Load(d, shape[1]), hn::Load(d, shape[2])};
        const V dMean[2] = {hn::Load(d, screen[0]), hn::Load(d, screen[1])};
        const V dConic[3] = {hn::Load(d, screen[2]), hn::Load(d, screen[3]), hn::Load(d, screen[4])};
        V gradient[kGeometryParameters];
        rawGradient(view, raw, scale, hn::Load(d, shape[3]), dMean, dConic, hn::Load(d, screen[5]), hn::Load(d, screen[6]),
                    set(opacityPull), gradient);
        for (int k = 0; k < kGeometryParameters; ++k) {
            const auto usable = hn::Lt(hn::Abs(gradient[k]), set(GeometryAdam::kMaxGradient));
            const V m0 = momentum.load(k), s0 = second.load(k), x = raw.load(k);
            const V m = m0 + set(1.0f - GeometryAdam::kBeta1) * (gradient[k] - m0);
            const V s = s0 + set(1.0f - GeometryAdam::kBeta2) * (gradient[k] * gradient[k] - s0);
            const V stepped = x - set(adam.rate[k]) * m / (hn::Sqrt(s * set(adam.correction2)) + set(GeometryAdam::kEpsilon));
            momentum.store(k, hn::IfThenElse(usable, m, m0));
            second.store(k, hn::IfThenElse(usable, s, s0));
            raw.store(k, hn::IfThenElse(usable, stepped, x));
        }
        activateLanes(raw, activated);
        for (int l = 0; l < lanes; ++l) {
            const size_t i = splatFromVisible[active[first + l]];
            raw.scatter(geometry.raw[i], l), momentum.scatter(geometry.momentum[i], l), second.scatter(geometry.second[i], l);
            scatterActivated(activated, l, geometry.activated[i]);
        }
    }
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace nacre {

HWY_EXPORT(activateSplat);
HWY_EXPORT(stepSplats);

void SplatGeometry::activate(size_t i) { HWY_DYNAMIC_DISPATCH(activateSplat)(raw[i], activated[i]); }

void stepGeometry(SplatGeometry& geometry, const View<float>& view, std::span<const uint32_t> splatFromVisible,
                  const ScreenGradient<float>* dSplats, const float* dDistance, const uint8_t* active, const GeometryRates& rates,
                  int step, float opacityPull)
{
    constexpr size_t kChunk = 256;
    const GeometryAdam adam(rates, step);
    const auto run = HWY_DYNAMIC_DISPATCH(stepSplats);
    const size_t count = splatFromVisible.size();
    tbb::parallel_for(size_t(0), (count + kChunk - 1) / kChunk, [&](size_t chunk) {
        uint32_t list[kChunk];
        size_t n = 0;
        for (size_t v = chunk * kChunk; v < std::min(count, (chunk + 1) * kChunk); ++v)
            if (active[v]) list[n++] = uint32_t(v);
        run(geometry, view, splatFromVisible.data(), dSplats, dDistance, list, n, adam, opacityPull);
    });
}

} // namespace nacre
#endif
