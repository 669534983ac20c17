// The look is 0.5 + sum_f sh_f y_f(d) with d from the camera to the splat. Its 16 coefficients minimise
//     sum_k w_k (0.5 + sum_f sh_f y_f(d_k) - c_k)²        over 64 Fibonacci directions d_k, the same for all splats,
// where c_k is the wanted colour and w_k how much of the splat the others let through towards the camera, at least kHiddenWeight.
#include "pack/lit_snapshot.h"

#include "appearance/model_table.h"
#include "appearance/reference_model.h"
#include "appearance/visibility_map.h"
#include "base/color.h"
#include "base/fibonacci_sphere.h"
#include "base/limits.h"
#include "base/spherical_harmonics.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace nacre {
namespace {

constexpr int kFunctions = 16, kDirections = 64;
constexpr double kHiddenWeight = 0.02;
constexpr float kEyeDistance = 4; // asset units: as far as cameras are from an object of unit size

struct Directions {
    std::array<glm::vec3, kDirections> fromCamera;
    std::array<std::array<double, kFunctions>, kDirections> y;
};

Directions makeDirections()
{
    Directions out;
    for (size_t k = 0; k < kDirections; ++k) {
        const glm::dvec3 d = fibonacciDirection(int(k), kDirections);
        out.fromCamera[k] = glm::vec3(d);
        shBasis(kFunctions, d.x, d.y, d.z, out.y[k].data());
    }
    return out;
}

/// Weighted least squares by Cholesky. The weights are above 0, so the matrix is positive definite.
void fit(const Directions& directions, const std::array<double, kDirections>& weights, const std::array<glm::dvec3, kDirections>& colors, glm::vec3* sh)
{
    std::array<std::array<double, kFunctions>, kFunctions> a{};
    std::array<glm::dvec3, kFunctions> b{};
    for (size_t k = 0; k < kDirections; ++k) {
        const auto& y = directions.y[k];
        for (size_t i = 0; i < kFunctions; ++i) {
            const double wy = weights[k] * y[i];
            b[i] += wy * (colors[k] - 0.5);
            for (size_t j = 0; j <= i; ++j) a[i][j] += wy * y[j];
        }
    }
    for (size_t i = 0; i < kFunctions; ++i)
        for (size_t j = 0; j <= i; ++j) {
            for (size_t m = 0; m < j; ++m) a[i][j] -= a[i][m] * a[j][m];
            a[i][j] = i == j ? std::sqrt(a[i][i]) : a[i][j] / a[j][j];
        }
    for (size_t i = 0; i < kFunctions; ++i) {
        for (size_t m = 0; m < i; ++m) b[i] -= a[i][m] * b[m];
        b[i] /= a[i][i];
    }
    for (size_t i = kFunctions; i-- > 0;) {
        for (size_t m = i + 1; m < kFunctions; ++m) b[i] -= a[m][i] * b[m];
        b[i] /= a[i][i];
        sh[i] = glm::vec3(b[i]);
    }
}

double encoded(double linear, bool srgb) { return srgb ? srgbFromLinear(std::clamp(linear, 0.0, 1.0)) : linear; }

} // namespace

Result<PlainSplats> litSnapshot(const SplatAsset& asset, std::span<const Light> lights, const SnapshotOptions& options,
                                const std::function<bool(double)>& goOn)
{
    if (Status s = validate(asset); !s) return s.error();
    const std::unique_ptr<ReferenceModel> model = makeReferenceModel(asset);
    if (!model) return Error{ErrorCode::kUnsupported, "this build cannot light an asset of the model '" + asset.model + "'"};
    std::vector<Light> inAsset;
    for (const Light& light : lights) {
        if (!light.isPunctual()) return Error{ErrorCode::kUnsupported, "a snapshot takes point and directional lights; expand others first"};
        inAsset.push_back(lightInAsset(asset.frame, light));
        inAsset.back().intensity *= float(options.exposure);
    }
    static const Directions directions = makeDirections();
    const Channel* visibility = asset.find("visibility");
    const auto weightsOf = [&](size_t splat) {
        std::array<double, kDirections> weights;
        weights.fill(1);
        if (!visibility || visibility->bytes.empty()) return weights;
        const VisibilityMap map{&visibility->bytes[visibility->components * splat], visibilitySize(visibility->components)};
        for (size_t k = 0; k < kDirections; ++k) {
            const glm::vec3 toCamera = -directions.fromCamera[k];
            weights[k] = std::max(kHiddenWeight, double(mapVisibility(map, &toCamera.x)));
        }
        return weights;
    };

    PlainSplats out{asset.cloud, {}, options.srgb, asset.yUpFromAsset};
    for (size_t i = 0; i < asset.cloud.count; ++i) out.cloud.opacities[i] = model->opacity(i);
    out.look.shFunctions = kFunctions;
    out.look.sh.resize(asset.cloud.count * kFunctions);
    constexpr size_t kBatch = 1024; // splats between two questions whether to go on
    for (size_t first = 0; first < asset.cloud.count; first += kBatch) {
        if (goOn && !goOn(double(first) / double(asset.cloud.count))) return Error{ErrorCode::kCancelled, "stopped"};
        tbb::parallel_for(tbb::blocked_range<size_t>(first, std::min(first + kBatch, asset.cloud.count), 16), [&](const tbb::blocked_range<size_t>& range) {
            std::vector<float> channels(size_t(model->channels(inAsset.size())));
            std::array<glm::dvec3, kDirections> colors;
            for (size_t i = range.begin(); i < range.end(); ++i) {
                for (size_t k = 0; k < kDirections; ++k) {
                    const glm::vec3 ray = directions.fromCamera[k], eye = asset.cloud.positions[i] - kEyeDistance * ray;
                    float rgb[3];
                    std::fill(channels.begin(), channels.end(), 0.0f);
                    model->shade(i, &eye.x, inAsset, channels.data());
                    model->resolve(channels.data(), 1.0f, &eye.x, &ray.x, inAsset, rgb);
                    for (int c = 0; c < 3; ++c) colors[k][c] = encoded(rgb[c], options.srgb);
                }
                fit(directions, weightsOf(i), colors, &out.look.sh[i * kFunctions]);
            }
        });
    }
    for (const glm::vec3& sh : out.look.sh)
        if (!(std::abs(sh.x) + std::abs(sh.y) + std::abs(sh.z) <= kLargestNumber))
            return Error{ErrorCode::kBadInput, "under these lights the radiance is not finite; give less intensity or move them away from the splats"};
    return out;
}

void changeColorSpace(bool srgb, PlainSplats& splats)
{
    if (splats.srgb == srgb) return;
    static const Directions directions = makeDirections();
    const NeutralLook old = std::move(splats.look);
    splats.srgb = srgb, splats.look = {kFunctions, std::vector<glm::vec3>(splats.cloud.count * kFunctions)};
    std::array<double, kDirections> weights;
    weights.fill(1);
    for (size_t i = 0; i < splats.cloud.count; ++i) {
        std::array<glm::dvec3, kDirections> colors;
        for (size_t k = 0; k < kDirections; ++k) {
            glm::dvec3 sum(0.5);
            for (size_t f = 0; f < size_t(old.shFunctions); ++f) sum += directions.y[k][f] * glm::dvec3(old.sh[i * size_t(old.shFunctions) + f]);
            for (int c = 0; c < 3; ++c) colors[k][c] = srgb ? encoded(sum[c], true) : linearFromSrgb(std::max(0.0, sum[c]));
        }
        fit(directions, weights, colors, &splats.look.sh[i * kFunctions]);
    }
}

} // namespace nacre
