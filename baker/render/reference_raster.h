// Front-to-back alpha blending of projected Gaussians at one pixel (BiGS eq. 1) and its gradient. Scalar reference for every backend.
//
//   alpha_i = min(kMaxAlpha, opacity_i exp(-q_i / 2)), skipped below kMinAlpha
//   C = sum_i T_i alpha_i color_i,  A = 1 - T_end,  T_{i+1} = T_i (1 - alpha_i); the pixel ends after T falls below kMinTransmittance
//
// The backward pass also runs front to back: what lies behind splat i is the total minus the running prefix.
#pragma once

#include "render/projection.h"

#include <span>

namespace nacre {

template <class T>
inline T splatAlpha(const ProjectedGaussian<T>& s, T px, T py, T* dx, T* dy)
{
    *dx = px - s.mean[0], *dy = py - s.mean[1];
    const T q = s.conic[0] * *dx * *dx + T(2) * s.conic[1] * *dx * *dy + s.conic[2] * *dy * *dy;
    return s.opacity * std::exp(T(-0.5) * q);
}

/// `order` lists splats front to back; colors is [splat][channels]. Writes color[channels] (premultiplied) and returns alpha.
template <class T>
inline T blendPixel(std::span<const uint32_t> order, const ProjectedGaussian<T>* splats, const T* colors, int channels, T px, T py,
                    T* color)
{
    T transmittance = T(1), dx, dy;
    for (int c = 0; c < channels; ++c) color[c] = T(0);
    for (uint32_t i : order) {
        T alpha = splatAlpha(splats[i], px, py, &dx, &dy);
        if (!(alpha >= T(kMinAlpha))) continue;
        alpha = alpha < T(kMaxAlpha) ? alpha : T(kMaxAlpha);
        for (int c = 0; c < channels; ++c) color[c] += transmittance * alpha * colors[size_t(i) * channels + c];
        transmittance *= T(1) - alpha;
        if (transmittance < T(kMinTransmittance)) break;
    }
    return T(1) - transmittance;
}

/// Screen-space gradient of one splat; conic as in ProjectedGaussian. `weight` sums the blending weights.
template <class T>
struct ScreenGradient {
    T mean[2], conic[3], opacity, weight;
};

/// Adds (+=) the gradient of one pixel. `color`, `alpha` are blendPixel's results, dColor and dAlpha the loss gradient there.
template <class T>
inline void blendPixelBackward(std::span<const uint32_t> order, const ProjectedGaussian<T>* splats, const T* colors, int channels,
                               T px, T py, const T* color, T alpha, const T* dColor, T dAlpha, ScreenGradient<T>* dSplats, T* dColors)
{
    T total = dAlpha * alpha;
    for (int c = 0; c < channels; ++c) total += dColor[c] * color[c];
    T transmittance = T(1), prefix = T(0), dx, dy;
    for (uint32_t i : order) {
        const ProjectedGaussian<T>& s = splats[i];
        const T raw = splatAlpha(s, px, py, &dx, &dy);
        if (!(raw >= T(kMinAlpha))) continue;
        const T a = raw < T(kMaxAlpha) ? raw : T(kMaxAlpha), w = transmittance * a;
        T value = dAlpha;
        for (int c = 0; c < channels; ++c) {
            value += dColor[c] * colors[size_t(i) * channels + c];
            dColors[size_t(i) * channels + c] += w * dColor[c];
        }
        prefix += w * value;
        ScreenGradient<T>& d = dSplats[i];
        d.weight += w;
        if (raw < T(kMaxAlpha)) { // a capped splat does not feel its geometry
            const T dLog = a * (transmittance * value - (total - prefix) / (T(1) - a)); // gradient of ln(alpha)
            d.mean[0] += dLog * (s.conic[0] * dx + s.conic[1] * dy);
            d.mean[1] += dLog * (s.conic[1] * dx + s.conic[2] * dy);
            d.conic[0] -= T(0.5) * dLog * dx * dx;
            d.conic[1] -= dLog * dx * dy;
            d.conic[2] -= T(0.5) * dLog * dy * dy;
            d.opacity += dLog / s.opacity;
        }
        transmittance *= T(1) - a;
        if (transmittance < T(kMinTransmittance)) break;
    }
}

} // namespace nacre
