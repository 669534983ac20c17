// The window and constants of SSIM (Wang et al. 2004), for images with values in [0, 1].
#pragma once

#include <array>
#include <cmath>

namespace nacre {

constexpr int kSsimRadius = 5;
constexpr double kSsimC1 = 0.01 * 0.01, kSsimC2 = 0.03 * 0.03;

/// A Gaussian of standard deviation 1.5 pixels; the weights sum to 1.
inline std::array<double, 2 * kSsimRadius + 1> ssimWindow()
{
    std::array<double, 2 * kSsimRadius + 1> window;
    double sum = 0;
    for (int i = -kSsimRadius; i <= kSsimRadius; ++i) sum += window[size_t(i + kSsimRadius)] = std::exp(-0.5 * i * i / (1.5 * 1.5));
    for (double& w : window) w /= sum;
    return window;
}

} // namespace nacre
