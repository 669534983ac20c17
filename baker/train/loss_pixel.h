// The loss at one pixel (loss.h): scalar reference of what the CPU computes with vectors, and what devices compute.
#pragma once

#include "base/color.h"
#include "base/host_device.h"
#include "render/ssim_window.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace nacre {

/// The value of a half of [0, 1], or of -0, which images hold.
NACRE_HD inline float radianceFromHalf(uint16_t half)
{
    half &= 0x7fff;
    return half < 1024 ? float(half) * 0x1p-24f : std::bit_cast<float>((uint32_t(half) << 13) + (112u << 23));
}

/// One channel: Γ(x) and Γ'(x) of the render cut at 1, and the displayed difference to first order. NaN stays NaN.
struct PixelLoss {
    float encoded, slope, shown;
};

NACRE_HD inline PixelLoss pixelLoss(float render, uint16_t radiance)
{
    const float x = render > 1.0f ? 1.0f : render;
    PixelLoss p;
    p.encoded = srgbFromLinear(x);
    p.slope = x <= 0.0031308f ? 12.92f : (p.encoded + 0.055f) / (2.4f * x);
    p.shown = (x - radianceFromHalf(radiance)) * p.slope;
    return p;
}

/// Squared error of one channel as displayed; 0 where the alpha of the reference, the planes of a PreparedImage, is at most 0.5.
NACRE_HD inline float objectError(float render, const uint16_t* reference, size_t pixels, size_t channel, size_t i)
{
    if (reference[3 * pixels + i] < 32768) return 0.0f;
    const float x = srgbFromLinear(std::clamp(render, 0.0f, 1.0f));
    const float difference = x - float(reference[channel * pixels + i]) / 65535.0f;
    return difference * difference;
}

/// SSIM from blurred moments of render a and reference b, and its derivatives with respect to those that depend on a.
struct SsimPixel {
    float ssim, dMa, dMaa, dMab;
};

NACRE_HD inline SsimPixel ssimPixel(float ma, float mb, float maa, float mbb, float mab)
{
    constexpr float c1 = float(kSsimC1), c2 = float(kSsimC2);
    const float va = maa - ma * ma, vb = mbb - mb * mb, vab = mab - ma * mb;
    const float n1 = 2 * ma * mb + c1, n2 = 2 * vab + c2, d1 = ma * ma + mb * mb + c1, d2 = va + vb + c2;
    const float s = n1 * n2 / (d1 * d2);
    const float dVa = -s / d2, dVab = 2 * n1 / (d1 * d2);
    const float dMa = 2 * mb * n2 / (d1 * d2) - s * 2 * ma / d1 - 2 * ma * dVa - mb * dVab;
    return {s, dMa, dVa, dVab};
}

} // namespace nacre
