// One splat of sss as a bake keeps it, a row of numbers: what it gives to the G-buffer, and its step. Host and device.
#pragma once

#include "appearance/sss/sss.h"
#include "appearance/sss/sss_network.h"
#include "appearance/visibility_map.h"
#include "base/light.h"

#include <cmath>

namespace nacre {

// All before the normal go through a logistic function.
constexpr int kSssRowBase = 0, kSssRowRough = 3, kSssRowMetal = 4, kSssRowScatter = 5, kSssRowNormal = 6, kSssRowCode = 9,
              kSssRowFloats = kSssRowCode + kSssCodeInputs;
constexpr float kSssMostRaw = 7; // a logistic beyond that has no slope left
constexpr float kSssBeta1 = 0.9f, kSssBeta2 = 0.99f;
constexpr float kSssNetworkRate = 6e-3f;
NACRE_HD constexpr float sssRowRate(int k)
{
    return k >= kSssRowCode ? 3e-2f : k >= kSssRowNormal || k == kSssRowMetal ? 1e-2f : 2e-2f;
}

/// What a step does to all splats alike.
struct SssStep {
    float rate, correction1, correction2; // of Adam
    float metalPull, scatterPull, sharePull; // gradients of the regularisers, per splat; the last per light, too
    bool residual, share, code;              // parts in use
    NACRE_HD bool network() const { return residual || share; }
};

/// Adam: moves `value`, whose own rate is `rate`.
NACRE_HD inline void sssAdam(const SssStep& step, float rate, float gradient, float& value, float& momentum, float& second)
{
    momentum = kSssBeta1 * momentum + (1 - kSssBeta1) * gradient;
    second = kSssBeta2 * second + (1 - kSssBeta2) * gradient * gradient;
    value -= step.rate * rate * (momentum / step.correction1) / (std::sqrt(second / step.correction2) + 1e-15f);
}

NACRE_HD inline float sssFromRaw(float raw) { return 1.0f / (1.0f + std::exp(-raw)); }
NACRE_HD inline float sssRawSlope(float raw)
{
    const float y = sssFromRaw(raw);
    return y * (1 - y);
}

NACRE_HD inline float sssRowSubsurface(const float* row, bool residual) { return residual ? sssFromRaw(row[kSssRowScatter]) : 0.0f; }

NACRE_HD inline void sssRowUnitNormal(const float* row, float* n)
{
    const float *raw = row + kSssRowNormal, length2 = raw[0] * raw[0] + raw[1] * raw[1] + raw[2] * raw[2];
    const float length = std::sqrt(length2 < 1e-20f ? 1e-20f : length2);
    for (int k = 0; k < 3; ++k) n[k] = raw[k] / length;
}

/// The channels of the surface, kSssSurfaceChannels of them.
NACRE_HD inline void sssRowChannels(const float* row, const float* position, const float* eye, bool residual, float* out)
{
    sssRowUnitNormal(row, out + kSssNormal);
    for (int c = 0; c < 3; ++c) out[kSssBase + c] = sssFromRaw(row[kSssRowBase + c]);
    out[kSssRoughness] = sssFromRaw(row[kSssRowRough]), out[kSssMetalness] = sssFromRaw(row[kSssRowMetal]);
    out[kSssSubsurface] = sssRowSubsurface(row, residual);
    const float d[3] = {position[0] - eye[0], position[1] - eye[1], position[2] - eye[2]};
    out[kSssDepth] = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

/// What the network is told of a light, in[kSssLightInputs]; returns its falloff. toEye: unit; `frame` as sssFixedInputs; `nearness`: it is told how
/// near the light is.
template <class L>
NACRE_HD inline float sssRowLight(const L& light, const float* position, const float* toEye, const VisibilityMap& map, const float* frame, bool nearness,
                                  float* in)
{
    const LightSample<float> s = sampleLight(light, position);
    const float distance = light.type == LightType::kPoint ? std::sqrt(s.distance2) : -1.0f;
    sssLightInputs(toEye, s.dir, map.texels ? mapVisibility(map, s.dir) : 1.0f, distance * frame[3], in);
    if (!nearness) in[kSssNearnessInput] = 0; // no gradient either: its weights stay 0
    return s.falloff;
}

/// The channels of one light, kSssLightChannels of them. `share`, `residual`: the network's answer, where those parts are in use.
NACRE_HD inline void sssRowLightChannels(const SssStep& step, float visibility, float falloff, const float* intensity, float subsurface, float share,
                                         const float* residual, float* out)
{
    out[kSssIncident] = visibility * (step.share ? share : 1.0f);
    for (int c = 0; c < 3; ++c) out[kSssScattered + c] = step.residual ? subsurface * falloff * intensity[c] * residual[c] : 0.0f;
}

/// From the gradient `d` of these channels that of the network's answer; adds to that of the subsurfaceness.
NACRE_HD inline void sssRowLightBackward(const SssStep& step, const float* d, float visibility, float falloff, const float* intensity, float subsurface,
                                         float share, const float* residual, float* dResidual, float* dShare, float* dSubsurface)
{
    *dShare = step.share ? d[kSssIncident] * visibility + step.sharePull * (share - 1) : 0.0f;
    for (int c = 0; c < 3; ++c) {
        const float perResidual = d[kSssScattered + c] * falloff * intensity[c];
        dResidual[c] = step.residual ? perResidual * subsurface : 0.0f;
        if (step.residual) *dSubsurface += perResidual * residual[c];
    }
}

/// Gradient of a row up to its code. d: of the channels of the surface; dSubsurface: what the lights add to one of them.
NACRE_HD inline void sssRowBackward(const SssStep& step, const float* row, const float* d, float dSubsurface, float* gradient)
{
    for (int c = 0; c < 3; ++c) gradient[kSssRowBase + c] = d[kSssBase + c] * sssRawSlope(row[kSssRowBase + c]);
    gradient[kSssRowRough] = d[kSssRoughness] * sssRawSlope(row[kSssRowRough]);
    gradient[kSssRowMetal] = (d[kSssMetalness] + step.metalPull) * sssRawSlope(row[kSssRowMetal]);
    gradient[kSssRowScatter] = step.residual ? (d[kSssSubsurface] + dSubsurface + step.scatterPull) * sssRawSlope(row[kSssRowScatter]) : 0.0f;
    float normal[3], along = 0;
    sssRowUnitNormal(row, normal);
    for (int k = 0; k < 3; ++k) along += d[kSssNormal + k] * normal[k];
    for (int k = 0; k < 3; ++k) gradient[kSssRowNormal + k] = d[kSssNormal + k] - along * normal[k];
}

/// One number of a row.
NACRE_HD inline void sssStepNumber(const SssStep& step, int k, float gradient, float& value, float& momentum, float& second)
{
    sssAdam(step, sssRowRate(k), gradient, value, momentum, second);
    if (k < kSssRowNormal) value = value < -kSssMostRaw ? -kSssMostRaw : kSssMostRaw < value ? kSssMostRaw : value;
}

} // namespace nacre
