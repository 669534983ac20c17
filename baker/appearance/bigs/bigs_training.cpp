// SIMD twin of bigs.h and bigs_backward.h over blocks of 16 splats, one splat per lane. Parity test: tests/unit/train_bigs.cpp.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "appearance/bigs/bigs_training.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "appearance/bigs/bigs_backward.h"
#include "appearance/bigs/bigs_training.h"
#include "render/simd_math-inl.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#ifndef NACRE_BIGS_SHARED
#define NACRE_BIGS_SHARED
namespace nacre {

constexpr int kTermsPerLight = 8;                                // direct, scatter rgb, indirect rgb, 1 - visibility

/// One block's splats, gathered from the per-splat arrays.
struct BlockInput {
    alignas(64) float position[3][kLanes16];
    uint32_t visible[kLanes16];
    size_t first;   // splat
    int lanes;      // how many splats the block has
    bool any;       // at least one is visible
};

inline BlockInput gatherBlock(size_t block, const VisibleView& view)
{
    BlockInput in;
    in.first = block * kLanes16;
    in.lanes = int(std::min<size_t>(kLanes16, view.geometry.size() - block * kLanes16));
    in.any = false;
    for (int l = 0; l < kLanes16; ++l) {
        const size_t splat = block * kLanes16 + std::min(l, in.lanes - 1);
        in.visible[l] = l < in.lanes ? view.visibleFromSplat[splat] : ~0u;
        in.any = in.any || in.visible[l] != ~0u;
        for (int k = 0; k < 3; ++k) in.position[k][l] = view.geometry[splat].position[k];
    }
    return in;
}

} // namespace nacre
#endif

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, kLanes16>;
using V = hn::Vec<D>;
constexpr int kN = int(hn::MaxLanes(D()));

HWY_INLINE V set(float x) { return hn::Set(D(), x); }
HWY_INLINE V zero() { return hn::Zero(D()); }

// Twin of shBasis<25>.
void shBasis25(V x, V y, V z, V* out)
{
    const V xx = hn::Mul(x, x), yy = hn::Mul(y, y), zz = hn::Mul(z, z), xy = hn::Mul(x, y), yz = hn::Mul(y, z), xz = hn::Mul(x, z);
    const auto mul = [](float k, V v) { return hn::Mul(set(k), v); };
    const V xxMinusYy = hn::Sub(xx, yy);
    const V x2MinusY2times3 = hn::Sub(hn::Mul(set(3), xx), yy), xxMinus3yy = hn::Sub(xx, hn::Mul(set(3), yy));
    const V zz7m1 = hn::MulAdd(set(7), zz, set(-1)), zz7m3 = hn::MulAdd(set(7), zz, set(-3));
    const V zz4 = hn::Sub(hn::Sub(hn::Mul(set(4), zz), xx), yy);
    out[0] = set(0.28209479177387814f);
    out[1] = mul(-0.48860251190291992f, y);
    out[2] = mul(0.48860251190291992f, z);
    out[3] = mul(-0.48860251190291992f, x);
    out[4] = mul(1.0925484305920792f, xy);
    out[5] = mul(-1.0925484305920792f, yz);
    out[6] = mul(0.31539156525252005f, hn::Sub(hn::Sub(hn::Add(zz, zz), xx), yy));
    out[7] = mul(-1.0925484305920792f, xz);
    out[8] = mul(0.54627421529603959f, xxMinusYy);
    out[9] = mul(-0.59004358992664352f, hn::Mul(y, x2MinusY2times3));
    out[10] = mul(2.8906114426405538f, hn::Mul(xy, z));
    out[11] = mul(-0.45704579946446577f, hn::Mul(y, zz4));
    out[12] = mul(0.37317633259011546f, hn::Mul(z, hn::Sub(hn::Add(zz, zz), hn::Mul(set(3), hn::Add(xx, yy)))));
    out[13] = mul(-0.45704579946446577f, hn::Mul(x, zz4));
    out[14] = mul(1.4453057213202769f, hn::Mul(z, xxMinusYy));
    out[15] = mul(-0.59004358992664352f, hn::Mul(x, xxMinus3yy));
    out[16] = mul(2.5033429417967046f, hn::Mul(xy, xxMinusYy));
    out[17] = mul(-1.7701307697799304f, hn::Mul(yz, x2MinusY2times3));
    out[18] = mul(0.94617469575756008f, hn::Mul(xy, zz7m1));
    out[19] = mul(-0.66904654355728921f, hn::Mul(yz, zz7m3));
    out[20] = mul(0.10578554691520431f, hn::MulAdd(zz, hn::MulAdd(set(35), zz, set(-30)), set(3)));
    out[21] = mul(-0.66904654355728921f, hn::Mul(xz, zz7m3));
    out[22] = mul(0.47308734787878004f, hn::Mul(xxMinusYy, zz7m1));
    out[23] = mul(-1.7701307697799304f, hn::Mul(xz, xxMinus3yy));
    out[24] = mul(0.62583573544917614f, hn::Sub(hn::Mul(xx, xxMinus3yy), hn::Mul(yy, x2MinusY2times3)));
}

// All directions of one half-block, their SH, and the irradiance factor of each light. Entry [lightCount] is the random light.
struct Directions {
    V toEye[3], toLight[kMaxLightsPerStep][3];
    V yView[25];
    V yLight[kMaxLightsPerStep + 1][25];
    V falloff[kMaxLightsPerStep];
};

HWY_INLINE void unitSh(V dx, V dy, V dz, V length2, V* unit, V* out)
{
    const auto usable = hn::Gt(length2, set(1e-20f)); // samplePointLight's +Z where there is no direction
    const V inv = hn::Div(set(1), hn::Sqrt(hn::IfThenElse(usable, length2, set(1))));
    unit[0] = hn::IfThenElseZero(usable, hn::Mul(dx, inv)), unit[1] = hn::IfThenElseZero(usable, hn::Mul(dy, inv));
    unit[2] = hn::IfThenElse(usable, hn::Mul(dz, inv), set(1));
    shBasis25(unit[0], unit[1], unit[2], out);
}

void evaluateDirections(const BlockInput& in, int lane, const LitView& view, const BigsRandomLight& random, Directions& d)
{
    const V px = hn::Load(D(), in.position[0] + lane), py = hn::Load(D(), in.position[1] + lane), pz = hn::Load(D(), in.position[2] + lane);
    const auto towards = [&](float x, float y, float z, V* unit, V* out) {
        const V dx = hn::Sub(set(x), px), dy = hn::Sub(set(y), py), dz = hn::Sub(set(z), pz);
        const V length2 = hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, hn::Mul(dz, dz)));
        unitSh(dx, dy, dz, length2, unit, out);
        return length2;
    };
    towards(view.eye[0], view.eye[1], view.eye[2], d.toEye, d.yView);
    for (int t = 0; t < view.lightCount; ++t) {
        const Light& light = view.lights[t];
        if (light.type == LightType::kPoint) {
            const V length2 = towards(light.position.x, light.position.y, light.position.z, d.toLight[t], d.yLight[t]);
            const float radius = std::max(light.radius, kMinLightRadius);
            d.falloff[t] = hn::Div(set(1), hn::Max(length2, set(radius * radius)));
        } else {
            for (int k = 0; k < 3; ++k) d.toLight[t][k] = set(light.directionToLight[k]);
            shBasis25(d.toLight[t][0], d.toLight[t][1], d.toLight[t][2], d.yLight[t]);
            d.falloff[t] = set(1);
        }
    }
    if (random.on) shBasis25(set(random.direction[0]), set(random.direction[1]), set(random.direction[2]), d.yLight[view.lightCount]);
}

HWY_INLINE V dot(const V* a, const V* b) { return hn::MulAdd(a[0], b[0], hn::MulAdd(a[1], b[1], hn::Mul(a[2], b[2]))); }

// 1 - mapVisibility towards a light. Four bytes of a map of its own per splat: nothing to gain from SIMD.
V darkness(const BigsParameters& parameters, const BlockInput& in, int lane, const V* toLight)
{
    const D d;
    alignas(64) float w[3][kN], dark[kN] = {};
    for (int k = 0; k < 3; ++k) hn::Store(toLight[k], d, w[k]);
    for (int k = 0; k < kN; ++k) {
        if (in.visible[lane + k] == ~0u) continue;
        const float direction[3] = {w[0][k], w[1][k], w[2][k]};
        dark[k] = 1 - mapVisibility(VisibilityMap{&parameters.visibility[(in.first + size_t(lane + k)) * kVisibilityTexels]}, direction);
    }
    return hn::Load(d, dark);
}

// Twin of bigsLobe and its part of bigsSharpBackward.
struct Lobe {
    V normal[3], inverseLength, sharpness, color[3];

    explicit Lobe(const float* value)
    {
        const D d;
        V raw[3];
        for (int k = 0; k < 3; ++k) raw[k] = hn::Load(d, value + (kLobe + k) * kLanes16), color[k] = hn::Load(d, value + (kLobeColor + k) * kLanes16);
        inverseLength = hn::Div(set(1), hn::Sqrt(hn::Max(dot(raw, raw), set(1e-20f))));
        for (int k = 0; k < 3; ++k) normal[k] = hn::Mul(raw[k], inverseLength);
        sharpness = exp2(d, hn::Mul(set(1.44269504f), hn::Load(d, value + kLobeSharpness * kLanes16)));
    }

    struct Shape {
        V half[3], cosine, u, front, shape;
    };
    Shape at(const V* toEye, const V* toLight) const
    {
        Shape s;
        for (int k = 0; k < 3; ++k) s.half[k] = hn::Add(toEye[k], toLight[k]);
        const V length2 = dot(s.half, s.half), inv = hn::Div(set(1), hn::Sqrt(hn::Max(length2, set(1e-12f))));
        for (int k = 0; k < 3; ++k) s.half[k] = hn::Mul(s.half[k], inv);
        s.cosine = hn::Max(dot(normal, s.half), zero());
        s.u = hn::Div(set(1), hn::MulAdd(sharpness, hn::Max(hn::NegMulAdd(s.cosine, s.cosine, set(1)), zero()), set(1)));
        s.front = hn::Max(hn::Mul(set(kBigsLobeFacing), dot(normal, toLight)), zero());
        s.shape = hn::IfThenElseZero(hn::Gt(length2, set(1e-12f)), hn::Mul(hn::Mul(s.u, s.u), hn::Min(s.front, set(1))));
        return s;
    }
    // dShape -> raw normal and log sharpness, added
    void backward(const Shape& s, const V* toLight, V dShape, V* dNormal, V* dLogSharpness) const
    {
        dShape = hn::IfThenElseZero(hn::Gt(s.shape, zero()), dShape);
        const V u2 = hn::Mul(s.u, s.u), dU = hn::Mul(hn::Mul(set(2), dShape), hn::Mul(s.u, hn::Min(s.front, set(1))));
        const V x = hn::Mul(hn::Mul(dU, u2), sharpness); // -d sine2
        const V dCosine = hn::Mul(hn::Mul(set(2), s.cosine), x);
        *dLogSharpness = hn::NegMulAdd(x, hn::Max(hn::NegMulAdd(s.cosine, s.cosine, set(1)), zero()), *dLogSharpness);
        const V dFront = hn::IfThenElseZero(hn::Lt(s.front, set(1)), hn::Mul(hn::Mul(dShape, u2), set(kBigsLobeFacing)));
        V d[3];
        for (int k = 0; k < 3; ++k) d[k] = hn::MulAdd(dCosine, s.half[k], hn::Mul(dFront, toLight[k]));
        const V along = dot(d, normal);
        for (int k = 0; k < 3; ++k) dNormal[k] = hn::MulAdd(inverseLength, hn::NegMulAdd(along, normal[k], d[k]), dNormal[k]);
    }
};

// Twin of bigsForward and its part of bigsSharpBackward.
struct Forward {
    V sharpness, color[3];

    explicit Forward(const float* value)
    {
        const D d;
        sharpness = exp2(d, hn::Mul(set(1.44269504f), hn::Load(d, value + kForward * kLanes16)));
        for (int c = 0; c < 3; ++c) color[c] = hn::Load(d, value + (kForward + 1 + c) * kLanes16);
    }

    struct Shape {
        V q, u, shape; // q = sharpness (1 + wo.wi)
    };
    Shape at(const V* toEye, const V* toLight) const
    {
        Shape s;
        s.q = hn::Mul(sharpness, hn::Max(hn::Add(set(1), dot(toEye, toLight)), zero()));
        s.u = hn::Div(set(1), hn::Add(set(1), s.q));
        s.shape = hn::Mul(s.u, hn::Sqrt(s.u));
        return s;
    }
    static V logSharpness(const Shape& s, V dShape) { return hn::Mul(hn::Mul(set(-1.5f), dShape), hn::Mul(s.shape, hn::Mul(s.u, s.q))); }
};

// a[i][c] = sum_j c_ij,c y_j(w_o), twin of bigsContractView.
void contractView(const float* s, int functions, const V* yView, V* a)
{
    const D d;
    for (int i = 0; i < 3 * functions; ++i) a[i] = zero();
    for (int c = 0; c < 3; ++c) {
        const float* coefficient = s + c * kLanes16;
        for (int j = 0; j < functions; ++j) {
            V sum = zero();
            for (int i = 0; i < j; ++i, coefficient += 3 * kLanes16) {
                const V x = hn::Load(d, coefficient);
                sum = hn::MulAdd(x, yView[i], sum);
                a[3 * i + c] = hn::MulAdd(x, yView[j], a[3 * i + c]);
            }
            sum = hn::MulAdd(hn::Load(d, coefficient), yView[j], sum);
            coefficient += 3 * kLanes16;
            a[3 * j + c] = hn::Add(a[3 * j + c], sum);
        }
    }
}

struct Terms {
    V direct, scatter[3], indirect[3];
};

// Twin of bigsTerms for L lights at once, so that every coefficient is loaded once and the sums stay in registers.
template <int L>
void evaluateTerms(const float* value, const BigsBands& bands, const Directions& dir, Terms* t)
{
    const D d;
    V a[3 * kMaxShFunctions];
    contractView(value + kScatter * kLanes16, bands.scatter, dir.yView, a);
    V sum[L];
    for (int l = 0; l < L; ++l) sum[l] = zero();
    for (int k = 0; k < bands.direct; ++k) {
        const V x = hn::Load(d, value + (kTDir + k) * kLanes16);
        for (int l = 0; l < L; ++l) sum[l] = hn::MulAdd(x, dir.yLight[l][k], sum[l]);
    }
    for (int l = 0; l < L; ++l) t[l].direct = sum[l];
    for (int c = 0; c < 3; ++c) {
        for (int l = 0; l < L; ++l) sum[l] = zero();
        for (int k = 0; k < bands.indirect; ++k) {
            const V x = hn::Load(d, value + (kTInd + 3 * k + c) * kLanes16);
            for (int l = 0; l < L; ++l) sum[l] = hn::MulAdd(x, dir.yLight[l][k], sum[l]);
        }
        for (int l = 0; l < L; ++l) t[l].indirect[c] = sum[l];
        for (int l = 0; l < L; ++l) sum[l] = hn::Load(d, value + (kRho + c) * kLanes16);
        for (int k = 0; k < bands.scatter; ++k)
            for (int l = 0; l < L; ++l) sum[l] = hn::MulAdd(a[3 * k + c], dir.yLight[l][k], sum[l]);
        for (int l = 0; l < L; ++l) t[l].scatter[c] = sum[l];
    }
}

void evaluateTermsAny(int lights, const float* value, const BigsBands& bands, const Directions& dir, Terms* t)
{
    switch (lights) {
    case 1: return evaluateTerms<1>(value, bands, dir, t);
    case 2: return evaluateTerms<2>(value, bands, dir, t);
    case 3: return evaluateTerms<3>(value, bands, dir, t);
    case 4: return evaluateTerms<4>(value, bands, dir, t);
    default: return evaluateTerms<5>(value, bands, dir, t);
    }
}

void forwardBlock(const BigsParameters& parameters, size_t block, const BlockInput& in, const LitView& view, const BigsBands& bands,
                  const BigsRandomLight& random, float* colors, float* terms)
{
    const D d;
    const int lights = view.lightCount + (random.on ? 1 : 0);
    alignas(64) float lanes[3 * kMaxLightsPerStep][kN];
    for (int lane = 0; lane < kLanes16; lane += kN) {
        bool any = false;
        for (int k = 0; k < kN; ++k) any = any || in.visible[lane + k] != ~0u;
        if (!any) continue;
        Directions dir;
        evaluateDirections(in, lane, view, random, dir);
        Terms t[kMaxLightsPerStep + 1];
        const float* value = parameters.value.data() + block * parameters.coefficients() * kLanes16 + lane;
        evaluateTermsAny(lights, value, bands, dir, t);
        const Lobe lobe(value);
        const Forward forward(value);
        const V shadow = hn::Load(d, value + kShadow * kLanes16);
        for (int l = 0; l < lights; ++l) {
            V dark = zero(), shape = zero(), ahead = zero();
            if (l < view.lightCount) {
                if (!parameters.visibility.empty()) dark = darkness(parameters, in, lane, dir.toLight[l]);
                if (bands.lobe) shape = lobe.at(dir.toEye, dir.toLight[l]).shape;
                if (bands.forward) ahead = forward.at(dir.toEye, dir.toLight[l]).shape;
            }
            const V lit = hn::NegMulAdd(shadow, dark, set(1));
            float* kept = terms + (block * kBigsTermStride + size_t(kTermsPerLight) * l) * kLanes16 + lane;
            hn::Store(t[l].direct, d, kept);
            hn::Store(dark, d, kept + 7 * kLanes16);
            for (int c = 0; c < 3; ++c) {
                if (l < view.lightCount) {
                    const V lobes = hn::MulAdd(forward.color[c], ahead, hn::Mul(lobe.color[c], shape));
                    const V sharp = hn::MulAdd(hn::Max(t[l].direct, zero()), hn::Max(t[l].scatter[c], zero()), lobes);
                    const V transport = hn::MulAdd(lit, sharp, hn::Max(t[l].indirect[c], zero()));
                    hn::Store(hn::Mul(hn::Mul(transport, dir.falloff[l]), set(view.lights[l].intensity[c])), d, lanes[3 * l + c]);
                }
                hn::Store(t[l].scatter[c], d, kept + (1 + c) * kLanes16);
                hn::Store(t[l].indirect[c], d, kept + (4 + c) * kLanes16);
            }
        }
        for (int k = 0; k < kN; ++k) {
            const size_t v = in.visible[lane + k];
            if (v == ~0u) continue;
            for (int c = 0; c < 3 * view.lightCount; ++c) colors[v * kColorStride + c] = lanes[c][k];
        }
    }
}

struct Adam {
    V oneMinusBeta1, beta1, rate;
    hn::Mask<D> on;
    HWY_INLINE void step(float* value, float* momentum, V gradient) const
    {
        const D d;
        const V m = hn::Load(d, momentum), x = hn::Load(d, value);
        const V newM = hn::MulAdd(beta1, m, hn::Mul(oneMinusBeta1, gradient));
        hn::Store(hn::IfThenElse(on, newM, m), d, momentum);
        hn::Store(hn::IfThenElse(on, hn::NegMulAdd(rate, newM, x), x), d, value);
    }
};

struct BiasCorrection {
    float first, second;
    explicit BiasCorrection(const BigsUpdate& u) : first(1 - std::pow(u.beta1, float(u.step))), second(1 - std::pow(u.beta2, float(u.step))) {}
};

// Folds the mean square gradient of a group into its second moment and returns the step size rate / sqrt(v).
HWY_INLINE V stepSize(float* secondMoment, V meanSquare, float rate, const BigsUpdate& u, const BiasCorrection& bias, hn::Mask<D> on)
{
    const D d;
    const V old = hn::Load(d, secondMoment);
    const V v = hn::MulAdd(set(u.beta2), old, hn::Mul(set(1 - u.beta2), meanSquare));
    hn::Store(hn::IfThenElse(on, v, old), d, secondMoment);
    const V root = hn::Sqrt(hn::Mul(v, set(1 / bias.second)));
    return hn::Div(set(rate / bias.first), hn::Add(root, set(1e-15f)));
}

// Gradient gate of a clamp max(value, 0): open where value > 0 or where descent would raise it (bigsTransportBackward, leaky).
HWY_INLINE V gate(V value, V gradient)
{
    return hn::IfThenElseZero(hn::Or(hn::Gt(value, zero()), hn::Lt(gradient, zero())), gradient);
}

void backwardBlock(BigsParameters& parameters, size_t block, const BlockInput& in, const uint8_t* active, const LitView& view,
                   const BigsBands& bands, const BigsRandomLight& random, const float* dColors, const float* terms, const BigsUpdate& update,
                   BigsLobeGradients& lobeGradients, BigsLobeGradients& forwardGradients)
{
    const D d;
    const int lights = view.lightCount + (random.on ? 1 : 0);
    const BiasCorrection bias(update);
    alignas(64) float scratchOn[kN], scatters[kN], gathered[3 * kMaxLightsPerStep][kN];
    for (int lane = 0; lane < kLanes16; lane += kN) {
        bool any = false;
        for (int k = 0; k < kN; ++k) {
            const uint32_t v = in.visible[lane + k];
            const bool on = v != ~0u && active[v];
            scratchOn[k] = on ? 1.0f : 0.0f;
            scatters[k] = on && (parameters.scatters.empty() || (lane + k < in.lanes && parameters.scatters[in.first + size_t(lane + k)])) ? 1.0f : 0.0f;
            any = any || on;
        }
        if (!any) continue;
        const auto on = hn::Gt(hn::Load(d, scratchOn), zero());
        float* value = parameters.value.data() + block * parameters.coefficients() * kLanes16 + lane;
        float* momentum = parameters.momentum.data() + block * parameters.coefficients() * kLanes16 + lane;
        float* second = parameters.secondMoment.data() + block * kBigsGroups * kLanes16 + lane;
        for (int k = 0; k < kN; ++k) // all stores before the first load: a vector read of what was just written in parts would wait
            for (int c = 0; c < 3 * view.lightCount; ++c)
                gathered[c][k] = in.visible[lane + k] != ~0u ? dColors[size_t(in.visible[lane + k]) * kColorStride + c] : 0.0f;
        const auto term = [&](int l, int i) {
            return hn::Load(d, terms + (block * kBigsTermStride + size_t(kTermsPerLight) * l + i) * kLanes16 + lane);
        };

        Directions dir;
        evaluateDirections(in, lane, view, random, dir);
        Terms t[kMaxLightsPerStep + 1], g[kMaxLightsPerStep + 1];
        const Lobe lobe(value);
        const Forward forward(value);
        const V shadow = hn::Load(d, value + kShadow * kLanes16);
        V dShadow = zero(), dNormal[3] = {zero(), zero(), zero()}, dLogSharpness = zero(), dLobeColor[3] = {zero(), zero(), zero()};
        V dForwardSharpness = zero(), dForwardColor[3] = {zero(), zero(), zero()};
        for (int l = 0; l < lights; ++l) {
            t[l].direct = term(l, 0);
            for (int c = 0; c < 3; ++c) {
                t[l].scatter[c] = term(l, 1 + c);
                t[l].indirect[c] = term(l, 4 + c);
            }
        }
        for (int l = 0; l < lights; ++l) {
            const V dark = term(l, 7), lit = hn::NegMulAdd(shadow, dark, set(1));
            const V direct = hn::Max(t[l].direct, zero());
            V dTransport[3], dUnshadowed = zero();
            for (int c = 0; c < 3; ++c) {
                dTransport[c] = zero();
                if (l < view.lightCount)
                    dTransport[c] = hn::Mul(hn::Mul(hn::Load(d, gathered[3 * l + c]), dir.falloff[l]), set(view.lights[l].intensity[c]));
                dUnshadowed = hn::MulAdd(dTransport[c], hn::Max(t[l].scatter[c], zero()), dUnshadowed);
                g[l].scatter[c] = gate(t[l].scatter[c], hn::Mul(hn::Mul(dTransport[c], lit), direct));
                g[l].indirect[c] = gate(t[l].indirect[c], dTransport[c]);
            }
            g[l].direct = gate(t[l].direct, hn::Mul(dUnshadowed, lit));
            dShadow = hn::NegMulAdd(dark, hn::Mul(dUnshadowed, direct), dShadow);
            if (bands.lobe && l < view.lightCount) {
                const Lobe::Shape s = lobe.at(dir.toEye, dir.toLight[l]);
                V dShape = zero();
                for (int c = 0; c < 3; ++c) {
                    dLobeColor[c] = hn::MulAdd(hn::Mul(dTransport[c], lit), s.shape, dLobeColor[c]);
                    dShape = hn::MulAdd(dTransport[c], lobe.color[c], dShape);
                }
                dShadow = hn::NegMulAdd(dark, hn::Mul(dShape, s.shape), dShadow);
                lobe.backward(s, dir.toLight[l], hn::Mul(dShape, lit), dNormal, &dLogSharpness);
            }
            if (bands.forward && l < view.lightCount) {
                const Forward::Shape s = forward.at(dir.toEye, dir.toLight[l]);
                V dShape = zero();
                for (int c = 0; c < 3; ++c) {
                    dForwardColor[c] = hn::MulAdd(hn::Mul(dTransport[c], lit), s.shape, dForwardColor[c]);
                    dShape = hn::MulAdd(dTransport[c], forward.color[c], dShape);
                }
                dShadow = hn::NegMulAdd(dark, hn::Mul(dShape, s.shape), dShadow);
                dForwardSharpness = hn::Add(dForwardSharpness, Forward::logSharpness(s, hn::Mul(dShape, lit)));
            }
            if (update.positiveWeight > 0) {
                const V w = set(2 * update.positiveWeight);
                g[l].direct = hn::MulAdd(w, hn::Min(t[l].direct, zero()), g[l].direct);
                for (int c = 0; c < 3; ++c) {
                    g[l].scatter[c] = hn::MulAdd(w, hn::Min(t[l].scatter[c], zero()), g[l].scatter[c]);
                    g[l].indirect[c] = hn::MulAdd(w, hn::Min(t[l].indirect[c], zero()), g[l].indirect[c]);
                }
            }
        }

        const V oneMinusBeta1 = set(1 - update.beta1), beta1 = set(update.beta1);
        V gradient[75];
        const auto stepGroup = [&](BigsGroup group, int first, int count) {
            V square = zero();
            for (int k = 0; k < count; ++k) square = hn::MulAdd(gradient[k], gradient[k], square);
            const V rate = stepSize(second + group * kLanes16, hn::Mul(square, set(1.0f / float(count))), update.rate[group], update, bias, on);
            const Adam adam{oneMinusBeta1, beta1, rate, on};
            for (int k = 0; k < count; ++k) adam.step(value + (first + k) * kLanes16, momentum + (first + k) * kLanes16, gradient[k]);
        };

        // h[i][c] = sum_t d(rho+s)_t,c y_i(w_t): the whole gradient of s is h y^T + y h^T
        const int functions = bands.scatter;
        V h[3 * kMaxShFunctions];
        for (int i = 0; i < functions; ++i)
            for (int c = 0; c < 3; ++c) {
                V sum = zero();
                for (int l = 0; l < lights; ++l) sum = hn::MulAdd(g[l].scatter[c], dir.yLight[l][i], sum);
                h[3 * i + c] = sum;
            }
        V energy[3 * kMaxShFunctions]; // extra gradient of the pairs (0, i)
        if (update.energyWeight > 0 && functions > 0) {
            for (int i = 0; i < 3 * functions; ++i) energy[i] = zero();
            constexpr float kSqrt4Pi = 3.5449077018110320f;
            for (int l = 0; l < lights; ++l)
                for (int c = 0; c < 3; ++c) {
                    V sum = zero();
                    for (int i = 0; i < functions; ++i)
                        sum = hn::MulAdd(hn::Load(d, value + (kScatter + 3 * (i * (i + 1) / 2) + c) * kLanes16), dir.yLight[l][i], sum);
                    const V excess = hn::Max(hn::MulAdd(set(kSqrt4Pi), sum, set(-1)), zero());
                    const V slope = hn::Mul(set(2 * kSqrt4Pi * update.energyWeight), excess);
                    for (int i = 0; i < functions; ++i) energy[3 * i + c] = hn::MulAdd(slope, dir.yLight[l][i], energy[3 * i + c]);
                }
        }

        if (update.rate[kGroupDirect] > 0) {
            for (int k = 0; k < bands.direct; ++k) {
                gradient[k] = zero();
                for (int l = 0; l < lights; ++l) gradient[k] = hn::MulAdd(g[l].direct, dir.yLight[l][k], gradient[k]);
            }
            stepGroup(kGroupDirect, kTDir, bands.direct);
        }
        if (update.rate[kGroupIndirect] > 0 && bands.indirect > 0) {
            for (int k = 0; k < bands.indirect; ++k)
                for (int c = 0; c < 3; ++c) {
                    V sum = zero();
                    for (int l = 0; l < lights; ++l) sum = hn::MulAdd(g[l].indirect[c], dir.yLight[l][k], sum);
                    gradient[3 * k + c] = sum;
                }
            stepGroup(kGroupIndirect, kTInd, 3 * bands.indirect);
        }
        if (update.rate[kGroupRho] > 0) {
            for (int c = 0; c < 3; ++c) {
                gradient[c] = zero();
                for (int l = 0; l < lights; ++l) gradient[c] = hn::Add(gradient[c], g[l].scatter[c]);
            }
            stepGroup(kGroupRho, kRho, 3);
            for (int c = 0; c < 3; ++c) { // the albedo stays physical
                float* rho = value + (kRho + c) * kLanes16;
                hn::Store(hn::Min(hn::Max(hn::Load(d, rho), zero()), set(1)), d, rho);
            }
        }

        const auto keepGradients = [&](BigsLobeGradients& kept, V dSharpness, const V* dColor) {
            alignas(64) float out[4][kN];
            hn::Store(dSharpness, d, out[0]);
            for (int c = 0; c < 3; ++c) hn::Store(dColor[c], d, out[1 + c]);
            for (int k = 0; k < kN; ++k) {
                const size_t splat = in.first + size_t(lane + k);
                if (scratchOn[k] == 0.0f) continue;
                kept.active[splat] = 1;
                for (int j = 0; j < 4; ++j) kept.gradient[4 * splat + size_t(j)] = out[j][k];
            }
        };
        if (bands.lobe) {
            for (int k = 0; k < 3; ++k) gradient[k] = dNormal[k];
            if (update.rate[kGroupNormal] > 0) stepGroup(kGroupNormal, kLobe, 3);
            keepGradients(lobeGradients, dLogSharpness, dLobeColor);
        }
        if (bands.forward) keepGradients(forwardGradients, dForwardSharpness, dForwardColor);
        if (!parameters.visibility.empty() && update.rate[kGroupShadow] > 0) {
            gradient[0] = dShadow;
            stepGroup(kGroupShadow, kShadow, 1);
            float* x = value + kShadow * kLanes16;
            hn::Store(hn::Min(hn::Max(hn::Load(d, x), zero()), set(1)), d, x);
        }

        // s, degree by degree. The mean square of a degree's gradient has a closed form from four running sums per channel:
        // sum_{a<b} (h_a y_b + h_b y_a)^2 + sum_a (h_a y_a)^2 = |h|^2 |y|^2 + (h.y)^2 - sum_a (h_a y_a)^2
        V yy = zero(), hh[3], hy[3], diagonal[3];
        for (int c = 0; c < 3; ++c) hh[c] = hy[c] = diagonal[c] = zero();
        V before = zero();
        for (int degree = 0; degree * degree < functions; ++degree) {
            const int b0 = degree * degree, b1 = (degree + 1) * (degree + 1);
            V square = zero();
            for (int b = b0; b < b1; ++b) {
                yy = hn::MulAdd(dir.yView[b], dir.yView[b], yy);
                for (int c = 0; c < 3; ++c) {
                    const V x = hn::Mul(h[3 * b + c], dir.yView[b]);
                    hh[c] = hn::MulAdd(h[3 * b + c], h[3 * b + c], hh[c]);
                    hy[c] = hn::Add(hy[c], x);
                    diagonal[c] = hn::MulAdd(x, x, diagonal[c]);
                }
            }
            for (int c = 0; c < 3; ++c) square = hn::Add(square, hn::Sub(hn::MulAdd(hh[c], yy, hn::Mul(hy[c], hy[c])), diagonal[c]));
            const int pairs = b1 * (b1 + 1) / 2 - b0 * (b0 + 1) / 2;
            const V meanSquare = hn::Mul(hn::Max(hn::Sub(square, before), zero()), set(1.0f / float(3 * pairs)));
            before = square;
            const int group = kGroupScatter0 + degree;
            if (!(update.rate[group] > 0)) continue;
            const V rate = stepSize(second + group * kLanes16, meanSquare, update.rate[group], update, bias, on);
            const Adam adam{oneMinusBeta1, beta1, rate, hn::Gt(hn::Load(d, scatters), zero())};
            for (int b = b0; b < b1; ++b) {
                const size_t row = size_t(kScatter + 3 * (b * (b + 1) / 2)) * kLanes16;
                for (int a = 0; a <= b; ++a)
                    for (int c = 0; c < 3; ++c) {
                        V slope = hn::Mul(h[3 * a + c], dir.yView[b]);
                        if (a < b) slope = hn::MulAdd(h[3 * b + c], dir.yView[a], slope);
                        if (a == 0 && update.energyWeight > 0) slope = hn::Add(slope, energy[3 * b + c]);
                        adam.step(value + row + (3 * a + c) * kLanes16, momentum + row + (3 * a + c) * kLanes16, slope);
                    }
            }
        }
    }
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <tbb/parallel_for.h>

namespace nacre {

HWY_EXPORT(forwardBlock);
HWY_EXPORT(backwardBlock);

void BigsParameters::resize(size_t newCount)
{
    const size_t old = count;
    count = newCount;
    value.resize(blocks() * coefficients() * kLanes16);
    momentum.resize(value.size());
    secondMoment.resize(blocks() * kBigsGroups * kLanes16);
    if (!visibility.empty()) visibility.resize(count * kVisibilityTexels, 255);
    if (!scatters.empty()) scatters.resize(count, 1);
    for (size_t i = old; i < count; ++i) { // the last block may hold what was there before an earlier shrink
        for (int k = 0; k < coefficients(); ++k) value[index(i, k)] = momentum[index(i, k)] = 0.0f;
        for (int k = 0; k < kBigsGroups; ++k) secondMoment[(i / kLanes16 * kBigsGroups + k) * kLanes16 + i % kLanes16] = 0.0f;
    }
}

void BigsParameters::copySplat(size_t from, size_t to)
{
    for (int k = 0; k < coefficients(); ++k) value[index(to, k)] = value[index(from, k)], momentum[index(to, k)] = 0.0f;
    if (!visibility.empty())
        std::copy_n(&visibility[from * kVisibilityTexels], kVisibilityTexels, &visibility[to * kVisibilityTexels]);
    if (!scatters.empty()) scatters[to] = scatters[from];
    for (int k = 0; k < kBigsGroups; ++k) secondMoment[(to / kLanes16 * kBigsGroups + k) * kLanes16 + to % kLanes16] = 0.0f;
}

void BigsParameters::permute(std::span<const uint32_t> order)
{
    const auto apply = [&](AlignedVector<float>& data, int rows) {
        AlignedVector<float> out(data.size());
        for (size_t i = 0; i < order.size(); ++i)
            for (int k = 0; k < rows; ++k)
                out[(i / kLanes16 * rows + k) * kLanes16 + i % kLanes16] = data[(order[i] / kLanes16 * rows + k) * kLanes16 + order[i] % kLanes16];
        data.swap(out);
    };
    apply(value, coefficients());
    apply(momentum, coefficients());
    apply(secondMoment, kBigsGroups);
    const auto applyBytes = [&](std::vector<uint8_t>& data, size_t row) {
        std::vector<uint8_t> out(data.size());
        for (size_t i = 0; i < order.size() && !data.empty(); ++i) std::copy_n(&data[order[i] * row], row, &out[i * row]);
        data.swap(out);
    };
    applyBytes(visibility, kVisibilityTexels);
    applyBytes(scatters, 1);
}

void BigsParameters::dropScatter()
{
    if (sFunctions == 0) return;
    const size_t oldRow = size_t(coefficients()) * kLanes16;
    sFunctions = 0;
    scatters.clear();
    const size_t row = size_t(coefficients()) * kLanes16;
    for (AlignedVector<float>* data : {&value, &momentum}) {
        for (size_t block = 1; block < blocks(); ++block) std::copy_n(data->data() + block * oldRow, row, data->data() + block * row);
        data->resize(blocks() * row);
        data->shrink_to_fit();
    }
}

void BigsParameters::keepScatter(std::span<const uint8_t> kept)
{
    scatters.assign(kept.begin(), kept.end());
    for (size_t i = 0; i < count; ++i)
        for (int k = kScatter; k < coefficients() && !scatters[i]; ++k) value[index(i, k)] = momentum[index(i, k)] = 0.0f;
}

namespace {

/// What is in use of a block.
BigsBands bandsOf(const BigsParameters& parameters, size_t block, const BigsBands& bands)
{
    if (parameters.scatters.empty()) return bands;
    const size_t first = block * kLanes16, lanes = std::min<size_t>(kLanes16, parameters.count - first);
    const std::span<const uint8_t> scatters(&parameters.scatters[first], lanes);
    BigsBands used = bands;
    if (std::all_of(scatters.begin(), scatters.end(), [](uint8_t s) { return s == 0; })) used.scatter = 0;
    return used;
}

} // namespace

void bigsForward(const BigsParameters& parameters, const VisibleView& view, const LitView& lit, const BigsBands& bands,
                 const BigsRandomLight& random, float* colors, float* terms)
{
    const auto run = HWY_DYNAMIC_DISPATCH(forwardBlock);
    tbb::parallel_for(size_t(0), parameters.blocks(), [&](size_t block) {
        const BlockInput in = gatherBlock(block, view);
        if (in.any) run(parameters, block, in, lit, bandsOf(parameters, block, bands), random, colors, terms);
    });
}

void bigsBackwardAndStep(BigsParameters& parameters, const VisibleView& view, const LitView& lit, const BigsBands& bands,
                         const BigsRandomLight& random, const uint8_t* active, const float* dColors, const float* terms,
                         const BigsUpdate& update, BigsLobeGradients& lobe, BigsLobeGradients& forward)
{
    if (bands.lobe) lobe.clear(parameters.count);
    if (bands.forward) forward.clear(parameters.count);
    const auto run = HWY_DYNAMIC_DISPATCH(backwardBlock);
    tbb::parallel_for(size_t(0), parameters.blocks(), [&](size_t block) {
        const BlockInput in = gatherBlock(block, view);
        if (in.any) run(parameters, block, in, active, lit, bandsOf(parameters, block, bands), random, dColors, terms, update, lobe, forward);
    });
}

} // namespace nacre
#endif
