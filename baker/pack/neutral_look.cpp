// Neutral look by linear least squares.
//
// KHR colour of a splat seen along d = normalize(mean - camera): max(0, 0.5 + sum_f sh_f y_f(d)). The wanted radiance is
// L(-d) is the sum over the lights in bigs.h. Sampled in 64 Fibonacci directions d_k, the same
// for all splats, the normal equations have one matrix: sh = (Yᵀ Y)⁻¹ Yᵀ (L_k - 0.5), a fixed 16 x 64 matrix times the samples.
#include "pack/neutral_look.h"

#include "appearance/bigs/bigs_asset.h"
#include "appearance/model_table.h"
#include "appearance/sss/sss.h"
#include "appearance/sss/sss_asset.h"
#include "base/fibonacci_sphere.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

namespace nacre {
namespace {

constexpr int kFunctions = 16, kDirections = 64, kMaxLights = 64;

struct ViewSamples {
    std::array<std::array<float, 3>, kDirections> toCamera;            // -d_k
    std::array<std::array<float, kMaxShFunctions>, kDirections> yView; // its SH
    std::array<std::array<double, kDirections>, kFunctions> solve;     // (Yᵀ Y)⁻¹ Yᵀ
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

struct Incident {
    glm::vec3 direction;  // unit, towards the light
    glm::vec3 irradiance; // facing the light
};

Incident incidentAt(const Light& light, const glm::vec3& position)
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
    std::vector<Incident> incidents;
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
        for (const Incident& i : incidents)
            facing += luminance(i.irradiance) * std::max(0.0, glm::dot(n, glm::dvec3(i.direction)));
    }
    return std::numbers::pi / facing;
}

using Radiance = std::array<glm::dvec3, kDirections>; // of one splat in all view directions, under the sum of the lights

void sampleBigs(const BigsCoefficients<float>& g, std::span<const Incident> incidents, const ViewSamples& views,
                Radiance& radiance)
{
    std::array<std::array<float, kMaxShFunctions>, kMaxLights> yLight;
    for (size_t t = 0; t < incidents.size(); ++t) {
        const glm::vec3& w = incidents[t].direction;
        shBasis(kMaxShFunctions, w.x, w.y, w.z, yLight[t].data());
    }
    std::array<float, 3 * kMaxShFunctions> a;
    // Transport that does not depend on the view is evaluated once per light, with an empty s.
    const BigsCoefficients<float> withoutView{g.tDir, g.tInd, g.rho, nullptr, 0};
    std::array<BigsTerms<float>, kMaxLights> terms;
    for (size_t t = 0; t < incidents.size(); ++t) terms[t] = bigsTerms(withoutView, a.data(), yLight[t].data());

    for (size_t k = 0; k < kDirections; ++k) {
        bigsContractView(g, views.yView[k].data(), a.data());
        glm::dvec3 sum(0.0);
        for (size_t t = 0; t < incidents.size(); ++t) {
            BigsTerms<float> viewed = terms[t];
            if (viewed.direct > 0)
                for (int i = 0; i < g.sFunctions; ++i)
                    for (int c = 0; c < 3; ++c) viewed.scatter[c] += a[size_t(3 * i + c)] * yLight[t][size_t(i)];
            const BigsSharpTerms<float> sharp = bigsSharpTerms(g, views.toCamera[k].data(), &incidents[t].direction.x);
            for (int c = 0; c < 3; ++c) sum[c] += double(incidents[t].irradiance[c]) * bigsTransport(viewed, sharp, c);
        }
        radiance[k] = sum;
    }
}

/// sss: the splat as a surface of its own. The network is asked once per light, as seen along the normal: its answer hardly depends on the
/// view, and 64 directions would take a minute.
void sampleSss(const SssChannels& channels, size_t splat, std::span<const Incident> incidents, const ViewSamples& views, Radiance& radiance)
{
    const SssMaterial m = channels.material(splat);
    SssSurface<float> surface{{m.base[0], m.base[1], m.base[2]}, m.roughness, m.metalness, {m.normal[0], m.normal[1], m.normal[2]}, 1 - m.subsurface};
    radiance.fill(glm::dvec3(0.0));
    float first[kSssHidden1];
    if (channels.network()) channels.firstLayer(splat, first);
    for (const Incident& light : incidents) {
        const float* w = &light.direction.x;
        float share = channels.visibility(splat).texels ? mapVisibility(channels.visibility(splat), w) : 1.0f;
        glm::dvec3 scattered(0.0);
        if (channels.network()) {
            float in[kSssLightInputs];
            sssLightInputs(m.normal, w, share, -1.0f, in);
            const SssActivations<float> a = sssNetworkLight(channels.network(), first, in);
            share *= a.share;
            scattered = double(m.subsurface) * glm::dvec3(a.residual[0], a.residual[1], a.residual[2]);
        }
        for (size_t k = 0; k < kDirections; ++k) {
            const SssReflection<float> o = sssReflect(surface, views.toCamera[k].data(), w);
            const glm::dvec3 reflected(o.value[0], o.value[1], o.value[2]);
            radiance[k] += glm::dvec3(light.irradiance) * (double(share) * reflected + scattered);
        }
    }
}

/// Writes the radiance of splat i.
using Sampler = std::function<void(size_t i, std::span<const Incident> incidents, const ViewSamples& views, Radiance& radiance)>;

Sampler bigsSampler(const SplatAsset& asset)
{
    return [channels = BigsChannels(asset)](size_t i, std::span<const Incident> incidents, const ViewSamples& views, Radiance& radiance) {
        sampleBigs(channels.at(i), incidents, views, radiance);
    };
}

Sampler sssSampler(const SplatAsset& asset)
{
    return [channels = SssChannels(asset)](size_t i, std::span<const Incident> incidents, const ViewSamples& views, Radiance& radiance) {
        sampleSss(channels, i, incidents, views, radiance);
    };
}

/// How a model is sampled, and under how many of the lights: as many as take seconds.
struct ModelSampler {
    const char* model;
    Sampler (*make)(const SplatAsset&);
    size_t lights;
};
constexpr ModelSampler kSamplers[] = {{"bigs", bigsSampler, kMaxLights}, {"sss", sssSampler, 16}};

} // namespace

Result<NeutralLook> fitNeutralLook(const SplatAsset& asset, std::span<const Light> allLights)
{
    if (Status s = validate(asset); !s) return s.error();
    const ModelSampler* model = std::find_if(std::begin(kSamplers), std::end(kSamplers), [&](const ModelSampler& m) { return asset.model == m.model; });
    if (model == std::end(kSamplers)) return Error{ErrorCode::kUnsupported, "no neutral look for model '" + asset.model + "'"};
    std::vector<Light> lights = pickLights(allLights, model->lights);
    const double exposure = exposureOf(lights, asset.cloud);
    if (!(exposure > 0 && std::isfinite(exposure)))
        return Error{ErrorCode::kBadInput, "cannot fit a neutral look: none of the " + std::to_string(allLights.size()) +
                                               " lights is a point or directional light with a positive, finite intensity"};
    for (Light& light : lights) light.intensity *= float(exposure);

    static const ViewSamples views = makeViewSamples();
    const Sampler sample = model->make(asset);

    NeutralLook look;
    look.shFunctions = kFunctions;
    look.sh.resize(asset.cloud.count * kFunctions);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, asset.cloud.count, 64), [&](const tbb::blocked_range<size_t>& range) {
        std::array<Incident, kMaxLights> incidents;
        Radiance radiance;
        for (size_t i = range.begin(); i < range.end(); ++i) {
            for (size_t t = 0; t < lights.size(); ++t) incidents[t] = incidentAt(lights[t], asset.cloud.positions[i]);
            sample(i, std::span(incidents).first(lights.size()), views, radiance);
            for (size_t f = 0; f < kFunctions; ++f) {
                glm::dvec3 sum(0.0);
                for (size_t k = 0; k < kDirections; ++k) sum += views.solve[f][k] * (radiance[k] - 0.5);
                look.sh[i * kFunctions + f] = glm::vec3(sum);
            }
        }
    });
    return look;
}

} // namespace nacre
