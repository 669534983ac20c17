// Least squares over the sphere: a product rule of 8 x 16 directions is exact for products of two functions up to degree 7, so the fit is
// a sum. A look of degree 0 stays one, exactly.
#include "asset/look_color.h"

#include "base/color.h"
#include "base/spherical_harmonics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace nacre {

namespace {

constexpr int kAround = 16, kDirections = 8 * kAround, kMostFunctions = 16;

struct Sphere {
    std::array<std::array<float, kMostFunctions>, kDirections> y;
    std::array<float, kDirections> weight;
};

Sphere makeSphere()
{
    constexpr double kHeights[4][2] = {{0.1834346424956498, 0.3626837833783620}, {0.5255324099163290, 0.3137066458778873}, // Gauss-Legendre
                                       {0.7966664774136267, 0.2223810344533745}, {0.9602898564975363, 0.1012285362903763}};
    Sphere sphere{};
    for (int k = 0; k < kDirections; ++k) {
        const double* height = kHeights[k / kAround / 2];
        const double z = k / kAround % 2 ? -height[0] : height[0], r = std::sqrt(1 - z * z), phi = (k % kAround + 0.5) * 2 * std::numbers::pi / kAround;
        std::array<double, kMostFunctions> y;
        shBasis(kMostFunctions, r * std::cos(phi), r * std::sin(phi), z, y.data());
        std::copy(y.begin(), y.end(), sphere.y[size_t(k)].begin());
        sphere.weight[size_t(k)] = float(height[1] * 2 * std::numbers::pi / kAround);
    }
    return sphere;
}

template <class Curve> NeutralLook convert(const NeutralLook& look, Curve curve)
{
    static const Sphere sphere = makeSphere();
    NeutralLook out = look;
    const auto functions = size_t(look.shFunctions);
    for (size_t row = 0; row < look.sh.size(); row += std::max<size_t>(1, functions)) {
        const int directions = functions == 1 ? 1 : kDirections;
        std::array<glm::vec3, kMostFunctions> sum{};
        for (int k = 0; k < directions; ++k) {
            const auto& y = sphere.y[size_t(k)];
            glm::vec3 color(0.5f);
            for (size_t f = 0; f < functions; ++f) color += look.sh[row + f] * y[f];
            for (int c = 0; c < 3; ++c) color[c] = curve(std::max(color[c], 0.0f)) - 0.5f;
            for (size_t f = 0; f < functions; ++f) sum[f] += color * (sphere.weight[size_t(k)] * y[f]);
            if (functions == 1) sum[0] = color / y[0];
        }
        std::copy_n(sum.begin(), functions, out.sh.begin() + ptrdiff_t(row));
    }
    return out;
}

} // namespace

NeutralLook toSrgb(const NeutralLook& linear) { return convert(linear, srgbFromLinear<float>); }
NeutralLook toLinear(const NeutralLook& srgb) { return convert(srgb, linearFromSrgb<float>); }

} // namespace nacre
