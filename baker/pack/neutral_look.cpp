// Neutral look by linear least squares.
//
// KHR colour of a splat seen along d = normalize(mean - camera): max(0, 0.5 + sum_f sh_f y_f(d)). The wanted radiance is
// L(-d) is the sum over the lights in bigs.h. Sampled in 64 Fibonacci directions d_k, the same
// for all splats, the normal equations have one matrix: sh = (Yᵀ Y)⁻¹ Yᵀ (L_k - 0.5), a fixed 16 x 64 matrix times the samples.
#include "pack/neutral_look.h"

#include "appearance/model_table.h"
#include "appearance/splat_radiance.h"
#include "base/fibonacci_sphere.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace nacre {
namespace {

constexpr int kFunctions = 16;
constexpr int kDirections = kRadianceDirections;

/// The directions, and how the fit weighs them.
struct ViewSamples : ViewDirections {
    std::array<std::array<double, kDirections>, kFunctions> solve; // (Yᵀ Y)⁻¹ Yᵀ
};

/// Inverse of a symmetric positive definite matrix by Gauss-Jordan; well conditioned here (nearly (64 / 4 pi) I).
using Square = std::array<std::array<double, kFunctions>, kFunctions>;
Square inverse(Square m)
{
    Square inv{};
    for (size_t i = 0; i < kFunctions; ++i) inv[i][i] = 1.0;
    for (size_t p = 0; p < kFunctions; ++p) {
        const double scale = 1.0 / m[p][p];
        for (size_t j = 0; j < kFunctions; ++j) m[p][j] *= scale, inv[p][j] *= scale;
        for (size_t i = 0; i < kFunctions; ++i) {
            if (i == p) continue;
            const double factor = m[i][p];
            for (size_t j = 0; j < kFunctions; ++j) m[i][j] -= factor * m[p][j], inv[i][j] -= factor * inv[p][j];
        }
    }
    return inv;
}

ViewSamples makeViewSamples()
{
    ViewSamples samples{};
    std::array<std::array<double, kFunctions>, kDirections> y{};
    for (size_t k = 0; k < kDirections; ++k) {
        const glm::dvec3 d = fibonacciDirection(int(k), kDirections);
        shBasis(kFunctions, d.x, d.y, d.z, y[k].data());
        samples.toCamera[k] = {float(-d.x), float(-d.y), float(-d.z)};
        shBasis(kMaxShFunctions, float(-d.x), float(-d.y), float(-d.z), samples.yView[k].data());
    }
    Square normal{};
    for (size_t a = 0; a < kFunctions; ++a)
        for (size_t b = 0; b < kFunctions; ++b)
            for (size_t k = 0; k < kDirections; ++k) normal[a][b] += y[k][a] * y[k][b];
    const Square inv = inverse(normal);
    for (size_t a = 0; a < kFunctions; ++a)
        for (size_t k = 0; k < kDirections; ++k)
            for (size_t b = 0; b < kFunctions; ++b) samples.solve[a][k] += inv[a][b] * y[k][b];
    return samples;
}

IncidentLight incidentAt(const Light& light, const glm::vec3& position)
{
    if (light.type == LightType::kDirectional) return {light.directionToLight, light.intensity};
    const LightSample<float> sample = samplePointLight<float>(&light.position.x, light.radius, &position.x);
    return {{sample.dir[0], sample.dir[1], sample.dir[2]}, light.intensity * sample.falloff};
}

std::vector<Light> pickLights(std::span<const Light> all, size_t most)
{
    std::vector<Light> usable, picked;
    for (const Light& light : all)
        if (light.isPunctual()) usable.push_back(light);
    const size_t n = std::min(usable.size(), most);
    for (size_t i = 0; i < n; ++i) picked.push_back(usable[i * usable.size() / n]);
    return picked;
}

/// Scale of all intensities for the exposure that the header promises; 0 if the lights are dark.
double exposureOf(const std::vector<Light>& lights, const SplatCloud& cloud)
{
    glm::dvec3 middle(0.0), mean(0.0);
    for (const glm::vec3& p : cloud.positions) middle += glm::dvec3(p) / double(cloud.count);
    const auto luminance = [](const glm::vec3& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; };
    double total = 0, facing = 0;
    std::vector<IncidentLight> incidents;
    for (const Light& light : lights) {
        incidents.push_back(incidentAt(light, glm::vec3(middle)));
        const double e = luminance(incidents.back().irradiance);
        mean += e * glm::dvec3(incidents.back().direction);
        total += e;
    }
    if (!(total > 0)) return 0;
    if (glm::length(mean) < 1e-3 * total) {
        facing = total / 4; // lights from everywhere have no mean direction: the average of max(n.w, 0) over the sphere
    } else {
        const glm::dvec3 n = glm::normalize(mean);
        for (const IncidentLight& i : incidents)
            facing += luminance(i.irradiance) * std::max(0.0, glm::dot(n, glm::dvec3(i.direction)));
    }
    return std::numbers::pi / facing;
}

} // namespace

Result<NeutralLook> fitNeutralLook(const SplatAsset& asset, std::span<const Light> allLights)
{
    if (Status s = validate(asset); !s) return s.error();
    const RadianceSampler sampler = makeRadianceSampler(asset);
    std::vector<Light> lights = pickLights(allLights, sampler.lights);
    const double exposure = exposureOf(lights, asset.cloud);
    if (!(exposure > 0 && std::isfinite(exposure)))
        return Error{ErrorCode::kBadInput, "cannot fit a neutral look: none of the " + std::to_string(allLights.size()) +
                                               " lights is a point or directional light with a positive, finite intensity"};
    for (Light& light : lights) light.intensity *= float(exposure);

    static const ViewSamples views = makeViewSamples();

    NeutralLook look;
    look.shFunctions = kFunctions;
    look.sh.resize(asset.cloud.count * kFunctions);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, asset.cloud.count, 64), [&](const tbb::blocked_range<size_t>& range) {
        std::array<IncidentLight, kMaxRadianceLights> incidents;
        SplatRadiance radiance;
        for (size_t i = range.begin(); i < range.end(); ++i) {
            for (size_t t = 0; t < lights.size(); ++t) incidents[t] = incidentAt(lights[t], asset.cloud.positions[i]);
            sampler.sample(i, std::span(incidents).first(lights.size()), views, radiance);
            for (size_t f = 0; f < kFunctions; ++f) {
                glm::dvec3 sum(0.0);
                for (size_t k = 0; k < kDirections; ++k) sum += views.solve[f][k] * (radiance[k] - 0.5);
                look.sh[i * kFunctions + f] = glm::vec3(sum);
            }
        }
    });
    return look;
}

std::vector<Light> neutralLights(const SplatAsset& asset)
{
    std::vector<Light> lights(makeRadianceSampler(asset).lights);
    for (size_t i = 0; i < lights.size(); ++i) {
        lights[i].type = LightType::kDirectional;
        lights[i].directionToLight = glm::vec3(fibonacciDirection(int(i), int(lights.size())));
    }
    return lights;
}

} // namespace nacre
