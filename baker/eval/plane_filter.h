// One-channel images and separable filters on them, for the metrics. Double precision, fixed order of sums: deterministic.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace nacre {

struct Plane {
    int width = 0, height = 0;
    std::vector<double> values; // rows top to bottom
    Plane(int w, int h) : width(w), height(h), values(size_t(w) * size_t(h)) {}
    double* row(int y) { return values.data() + size_t(y) * size_t(width); }
    const double* row(int y) const { return values.data() + size_t(y) * size_t(width); }
};

enum class Border { kZero, kReplicate };

/// Correlates rows with `kx`, then columns with `ky`. Kernels have odd length and are centred.
inline Plane filterSeparable(const Plane& in, const std::vector<double>& kx, const std::vector<double>& ky, Border border)
{
    const int w = in.width, h = in.height;
    const int rx = int(kx.size()) / 2, ry = int(ky.size()) / 2;
    Plane horizontal(w, h), out(w, h);
    std::vector<double> padded(size_t(w + 2 * rx));
    for (int y = 0; y < h; ++y) {
        const double* src = in.row(y);
        std::fill_n(padded.begin(), rx, border == Border::kReplicate ? src[0] : 0.0);
        std::copy_n(src, w, padded.begin() + rx);
        std::fill_n(padded.end() - rx, rx, border == Border::kReplicate ? src[w - 1] : 0.0);
        double* dst = horizontal.row(y);
        for (size_t k = 0; k < kx.size(); ++k) // tap by tap: the inner loop runs over contiguous pixels
            for (int x = 0; x < w; ++x) dst[x] += kx[k] * padded[size_t(x) + k];
    }
    for (int y = 0; y < h; ++y) {
        double* dst = out.row(y);
        for (int k = -ry; k <= ry; ++k) {
            if (border == Border::kZero && (y + k < 0 || y + k >= h)) continue;
            const double* src = horizontal.row(std::clamp(y + k, 0, h - 1));
            const double weight = ky[size_t(k + ry)];
            for (int x = 0; x < w; ++x) dst[x] += weight * src[x];
        }
    }
    return out;
}

} // namespace nacre
