// SIMD twin of projectGaussian (projection.h), one Gaussian per lane. Only the logarithm is taken lane by lane, by the same library
// function, so that the results are the scalar ones bit for bit. Parity test: tests/unit/render_projection.cpp.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/project_gaussians.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "render/project_gaussians.h"
#include "render/projection_simd-inl.h"

#include <algorithm>
#include <cmath>
#include <limits>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;
constexpr int kN = int(hn::MaxLanes(D()));

size_t projectLanes(const View<float>& view, const GaussianGeometry<float>* splats, size_t count, uint32_t firstIndex,
                    ProjectedGaussian<float>* projected, uint32_t* visible)
{
    const D d;
    const auto set = [d](float x) HWY_ATTR { return hn::Set(d, x); };
    const V zero = hn::Zero(d), infinity = set(std::numeric_limits<float>::infinity());
    alignas(64) float in[11][kN], out[9][kN], qMax[kN], seen[kN];
    size_t n = 0;
    for (size_t first = 0; first < count; first += kN) {
        const int lanes = int(std::min<size_t>(kN, count - first));
        for (int l = 0; l < kN; ++l) { // a vector that is not full repeats its last splat
            const GaussianGeometry<float>& g = splats[first + std::min(l, lanes - 1)];
            for (int k = 0; k < 3; ++k) in[k][l] = g.position[k], in[3 + k][l] = g.scale[k];
            for (int k = 0; k < 4; ++k) in[6 + k][l] = g.rotation[k];
            in[10][l] = g.opacity;
        }
        V x[11];
        for (int k = 0; k < 11; ++k) x[k] = hn::Load(d, in[k]);
        const ProjectionLanes<D> s(view, x, x + 3, x + 6);
        const V opacity = x[10] * s.compensation;
        auto on = hn::And(s.front, hn::Ge(opacity, set(kMinAlpha)));
        if (hn::AllFalse(d, on)) continue;
        hn::Store(hn::IfThenElse(on, opacity / set(kMinAlpha), set(1)), d, qMax);
        for (int l = 0; l < kN; ++l) qMax[l] = std::log(qMax[l]);
        const V q = set(2) * hn::Load(d, qMax), invDet = set(1) / s.det;
        const V mean[2] = {set(view.fx) * (s.t[0] / s.t[2]) + set(view.cx), set(view.fy) * (s.t[1] / s.t[2]) + set(view.cy)};
        const V extent[2] = {hn::Sqrt(q * s.cxx), hn::Sqrt(q * s.cyy)}, c0 = s.cyy * invDet, c2 = s.cxx * invDet;
        // Cull: positive tests, so that overflow to infinity or NaN fails.
        on = hn::And(on, hn::And(hn::Gt(mean[0] + extent[0], zero), hn::Lt(mean[0] - extent[0], set(view.width))));
        on = hn::And(on, hn::And(hn::Gt(mean[1] + extent[1], zero), hn::Lt(mean[1] - extent[1], set(view.height))));
        on = hn::And(on, hn::And(hn::Lt(extent[0], infinity), hn::Lt(extent[1], infinity)));
        on = hn::And(on, hn::And(hn::Gt(c0, zero), hn::Gt(c2, zero)));
        const V result[9] = {mean[0], mean[1], c0, hn::Neg(s.cxy) * invDet, c2, opacity, hn::Sqrt(dot3(s.t, s.t)), extent[0], extent[1]};
        for (int k = 0; k < 9; ++k) hn::Store(result[k], d, out[k]);
        hn::Store(hn::IfThenElseZero(on, set(1)), d, seen);
        for (int l = 0; l < lanes; ++l) {
            if (seen[l] == 0.0f) continue;
            projected[first + l] = {{out[0][l], out[1][l]}, {out[2][l], out[3][l], out[4][l]}, out[5][l], out[6][l], {out[7][l], out[8][l]}};
            visible[n++] = firstIndex + uint32_t(first) + uint32_t(l);
        }
    }
    return n;
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nacre {

HWY_EXPORT(projectLanes);

size_t projectGaussians(const View<float>& view, std::span<const GaussianGeometry<float>> splats, uint32_t firstIndex,
                        ProjectedGaussian<float>* projected, uint32_t* visible)
{
    return HWY_DYNAMIC_DISPATCH(projectLanes)(view, splats.data(), splats.size(), firstIndex, projected, visible);
}

} // namespace nacre
#endif
