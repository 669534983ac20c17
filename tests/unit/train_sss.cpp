// The shading of a pixel of the sss model: energy, reciprocity, limits, and its gradient against finite differences in float64.
#include "appearance/sss/sss_backward.h"
#include "appearance/sss/sss_network_backward.h"
#include "appearance/sss/sss_network_simd.h"
#include "appearance/sss/sss_resolve.h"
#include "appearance/trainable.h"
#include "base/fibonacci_sphere.h"
#include "base/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <vector>

using namespace nacre;

namespace {

struct Case {
    SssSurface<double> surface;
    double wo[3], wi[3], weights[3];
};

glm::dvec3 direction(Random& random)
{
    const double z = 2 * random.uniform() - 1, phi = 6.283185307179586 * random.uniform();
    return {std::sqrt(1 - z * z) * std::cos(phi), std::sqrt(1 - z * z) * std::sin(phi), z};
}

Case randomCase(Random& random)
{
    Case x{};
    for (int c = 0; c < 3; ++c) x.surface.base[c] = random.uniform(), x.weights[c] = 2 * random.uniform() - 1;
    x.surface.roughness = 0.1 + 0.85 * random.uniform(), x.surface.metalness = random.uniform(),
    x.surface.diffuse = random.uniform();
    const glm::dvec3 n = direction(random), o = direction(random), i = direction(random);
    for (int c = 0; c < 3; ++c) x.surface.normal[c] = n[c], x.wo[c] = o[c], x.wi[c] = i[c];
    return x;
}

double weighted(const Case& x)
{
    const SssReflection<double> o = sssReflect(x.surface, x.wo, x.wi);
    double sum = 0;
    for (int c = 0; c < 3; ++c) sum += x.weights[c] * o.value[c];
    return sum;
}

SssSurface<double> surfaceUp(double roughness, double metalness, double base)
{
    return {{base, base, base}, roughness, metalness, {0, 0, 1}};
}

} // namespace

TEST_CASE("sss: the gradient of a pixel's reflection is that of finite differences")
{
    Random random(21);
    int lit = 0;
    for (int trial = 0; trial < 400; ++trial) {
        const Case x = randomCase(random);
        const SssReflection<double> o = sssReflect(x.surface, x.wo, x.wi);
        if (o.nl < 1e-3 || (o.nv > 0 && o.nv < 1e-3)) continue; // not across a clamp
        ++lit;
        SssReflectGradient<double> d;
        sssReflectBackward(x.surface, x.wo, x.wi, o, x.weights, d);
        const auto check = [&](double analytic, const std::function<double&(Case&)>& at) {
            Case hi = x, lo = x;
            const double step = 1e-6;
            at(hi) += step, at(lo) -= step;
            const double numeric = (weighted(hi) - weighted(lo)) / (2 * step);
            CHECK(std::abs(analytic - numeric) < 1e-5 * (1 + std::abs(numeric)));
        };
        check(d.roughness, [](Case& c) -> double& { return c.surface.roughness; });
        check(d.metalness, [](Case& c) -> double& { return c.surface.metalness; });
        check(d.diffuse, [](Case& c) -> double& { return c.surface.diffuse; });
        for (int k = 0; k < 3; ++k) {
            check(d.base[k], [k](Case& c) -> double& { return c.surface.base[k]; });
            check(d.normal[k], [k](Case& c) -> double& { return c.surface.normal[k]; });
            check(d.wo[k], [k](Case& c) -> double& { return c.wo[k]; });
            check(d.wi[k], [k](Case& c) -> double& { return c.wi[k]; });
        }
    }
    CHECK(lit > 100);
}

TEST_CASE("sss: the gradient through a pixel's point is that of finite differences")
{
    Random random(22);
    for (int trial = 0; trial < 100; ++trial) {
        const glm::dvec3 light = 2.0 * direction(random), weight = direction(random);
        glm::dvec3 point = direction(random);
        const double radius = trial % 3 ? 0.1 : 10.0, dFalloff = random.uniform(); // 10: the radius caps the falloff
        const auto value = [&] {
            const LightSample<double> o = samplePointLight(&light.x, radius, &point.x);
            return glm::dot(weight, glm::dvec3(o.dir[0], o.dir[1], o.dir[2])) + dFalloff * o.falloff;
        };
        double d[3] = {};
        sssPointLightBackward(samplePointLight(&light.x, radius, &point.x), radius, &weight.x, dFalloff, d);
        for (int k = 0; k < 3; ++k) {
            const double was = point[k], step = 1e-6;
            point[k] = was + step;
            const double hi = value();
            point[k] = was - step;
            const double lo = value();
            point[k] = was;
            CHECK(std::abs(d[k] - (hi - lo) / (2 * step)) < 1e-6 * (1 + std::abs(d[k])));
        }
    }
}

TEST_CASE("sss: a white surface reflects no more than it gets, and without Fresnel and gloss exactly base/pi")
{
    const int count = 20000;
    for (double roughness : {0.2, 0.5, 1.0})
        for (double metalness : {0.0, 1.0})
            for (double cosine : {1.0, 0.5, 0.1}) {
                const double wi[3] = {std::sqrt(1 - cosine * cosine), 0, cosine};
                double albedo = 0;
                for (int i = 0; i < count; ++i) {
                    const glm::dvec3 wo(fibonacciDirection(i, count));
                    if (wo.z <= 0) continue;
                    // value is f cos(theta_i): per unit irradiance across w_i; to a ratio of fluxes, integrate f cos(theta_o)
                    albedo += sssReflect(surfaceUp(roughness, metalness, 1.0), &wo.x, wi).value[0] / cosine * wo.z * 4 *
                              3.14159265358979 / count;
                }
                CAPTURE(roughness);
                CAPTURE(metalness);
                CAPTURE(cosine);
                CHECK(albedo < 1.03); // a dielectric at grazing light: (1 - F) of the diffuse part looks at the half vector, not
                                      // at the normal
                CHECK(albedo > 0.15); // a metal at grazing light: one bounce, and k of the paper masks more than GGX does
            }
    const double up[3] = {0, 0, 1};
    SssSurface<double> matte = surfaceUp(1.0, 0.0, 0.5);
    CHECK(std::abs(sssReflect(matte, up, up).value[0] - 0.5 * 0.96 / 3.14159265358979 - 0.04 / (4 * 3.14159265358979)) < 1e-9);
}

TEST_CASE("sss: reflection is reciprocal")
{
    Random random(23);
    for (int trial = 0; trial < 200; ++trial) {
        const Case x = randomCase(random);
        const SssReflection<double> there = sssReflect(x.surface, x.wo, x.wi), back = sssReflect(x.surface, x.wi, x.wo);
        if (there.nl <= 0 || back.nl <= 0) continue;
        for (int c = 0; c < 3; ++c)
            CHECK(std::abs(there.value[c] / there.nl - back.value[c] / back.nl) <
                  1e-9 * (1 + std::abs(there.value[c] / there.nl)));
    }
}

TEST_CASE("sss: roughness and metalness at both ends, grazing and opposite directions, in float: finite, never negative")
{
    Random random(24);
    for (int trial = 0; trial < 2000; ++trial) {
        SssSurface<float> s{};
        for (float& b : s.base) b = trial % 2 ? 1.0f : 0.0f;
        s.roughness = trial % 3 ? 0.0f : 1.0f, s.metalness = trial % 5 ? 0.0f : 1.0f;
        const glm::vec3 n(direction(random));
        glm::vec3 wo(direction(random)), wi(direction(random));
        if (trial % 4 == 0) wo = n, wi = n;                                            // the peak
        if (trial % 4 == 1) wi = -wo;                                                  // no half vector
        if (trial % 4 == 2) wi = glm::normalize(wi - glm::dot(wi, n) * n + 1e-6f * n); // grazing
        for (int c = 0; c < 3; ++c) s.normal[c] = n[c];
        const SssReflection<float> o = sssReflect(s, &wo.x, &wi.x);
        const float ones[3] = {1, 1, 1};
        SssReflectGradient<float> d;
        sssReflectBackward(s, &wo.x, &wi.x, o, ones, d);
        for (int c = 0; c < 3; ++c) {
            CHECK(std::isfinite(o.value[c]));
            CHECK(o.value[c] >= 0);
            for (float g : {d.base[c], d.normal[c], d.wi[c], d.wo[c], d.roughness, d.metalness}) CHECK(std::isfinite(g));
        }
    }
}

namespace {

struct PixelCase {
    double g[kSssSurfaceChannels], alpha, eye[3], ray[3], channels[2][kSssLightChannels], light[2][3], intensity[2][3],
        weight[2][3];
};

PixelCase randomPixel(Random& random)
{
    PixelCase x{};
    const auto u = [&] { return double(random.uniform()); };
    x.alpha = 0.3 + 0.7 * u();
    const glm::dvec3 n = direction(random), eye = 3.0 * (n + 0.5 * direction(random));
    for (int c = 0; c < 3; ++c)
        x.g[kSssNormal + c] = 0.8 * x.alpha * n[c], x.g[kSssBase + c] = x.alpha * u(), x.eye[c] = eye[c],
                         x.ray[c] = -eye[c] / 3 + 0.1 * u();
    x.g[kSssRoughness] = x.alpha * (0.2 + 0.7 * u()), x.g[kSssMetalness] = x.alpha * u(), x.g[kSssSubsurface] = x.alpha * u(),
    x.g[kSssDepth] = x.alpha * (2.8 + 0.2 * u());
    for (int l = 0; l < 2; ++l) {
        const glm::dvec3 light = 2.5 * (n + 0.6 * direction(random));
        for (int c = 0; c < 3; ++c) x.light[l][c] = light[c], x.intensity[l][c] = 5 * u(), x.weight[l][c] = 2 * u() - 1;
        for (double& k : x.channels[l]) k = u();
    }
    return x;
}

double shown(const PixelCase& x) // weighted sum over lights and channels
{
    const SssPixel<double> pixel = sssPixel(x.g, x.alpha, x.eye, x.ray);
    double sum = 0;
    for (int l = 0; l < 2; ++l) {
        const LightSample<double> at = samplePointLight(x.light[l], 0.01, pixel.point);
        const SssReflection<double> o = sssReflect(pixel.surface, pixel.wo, at.dir);
        for (int c = 0; c < 3; ++c)
            sum += x.weight[l][c] * sssRadiance(x.channels[l], x.intensity[l][c] * at.falloff, o.value[c], c);
    }
    return sum;
}

} // namespace

TEST_CASE("sss: the gradient of a pixel with respect to all its channels is that of finite differences")
{
    Random random(25);
    for (int trial = 0; trial < 100; ++trial) {
        PixelCase x = randomPixel(random);
        const SssPixel<double> pixel = sssPixel(x.g, x.alpha, x.eye, x.ray);
        REQUIRE(pixel.inverseLength > 0);
        SssPixelGradient<double> d;
        double dLight[2][kSssLightChannels], dG[kSssSurfaceChannels], dAlpha;
        for (int l = 0; l < 2; ++l) {
            const LightSample<double> at = samplePointLight(x.light[l], 0.01, pixel.point);
            sssPixelLightBackward(pixel, x.channels[l], at, 0.01, x.intensity[l], sssReflect(pixel.surface, pixel.wo, at.dir),
                                  x.weight[l], dLight[l], d);
        }
        sssPixelBackward(pixel, x.g, x.ray, d, dG, &dAlpha);
        const auto check = [&](double& at, double analytic) {
            const double was = at, step = 1e-6;
            at = was + step;
            const double hi = shown(x);
            at = was - step;
            const double lo = shown(x);
            at = was;
            CHECK(std::abs(analytic - (hi - lo) / (2 * step)) < 1e-5 * (1 + std::abs(analytic)));
        };
        for (int k = 0; k < kSssSurfaceChannels; ++k) check(x.g[k], dG[k]);
        check(x.alpha, dAlpha);
        for (int l = 0; l < 2; ++l)
            for (int k = 0; k < kSssLightChannels; ++k) check(x.channels[l][k], dLight[l][k]);
    }
}

TEST_CASE("sss: a pixel of no alpha, or whose normals cancel, shows scattered light only; gradients stay finite")
{
    Random random(26);
    for (float alpha : {0.0f, 1e-30f, 1e-4f, 1.0f}) {
        float g[kSssSurfaceChannels] = {1e-6f * alpha, 0, 0, alpha, alpha, alpha, alpha, alpha, 0, 3 * alpha};
        const float eye[3] = {0, 0, 3}, ray[3] = {0, 0, -1}, light[kSssLightChannels] = {1, 0.1f, 0.2f, 0.3f},
                    intensity[3] = {1, 1, 1};
        const SssPixel<float> pixel = sssPixel(g, alpha, eye, ray);
        CHECK(pixel.inverseLength == 0);
        const LightSample<float> at = samplePointLight(eye, 0.01f, pixel.point);
        CHECK(sssRadiance(light, 1e30f, sssReflect(pixel.surface, pixel.wo, at.dir).value[1], 1) == 0.2f);
        SssPixelGradient<float> d;
        float dLight[kSssLightChannels], dG[kSssSurfaceChannels], dAlpha;
        sssPixelLightBackward(pixel, light, at, 0.01f, intensity, sssReflect(pixel.surface, pixel.wo, at.dir), intensity, dLight,
                              d);
        sssPixelBackward(pixel, g, ray, d, dG, &dAlpha);
        for (float x : dG) CHECK(x == 0.0f);
        CHECK(dAlpha == 0.0f);
        CHECK(dLight[kSssScattered] == 1.0f);
    }
}

namespace {

// What both directions of the resolve pass give one pixel, by the scalar code in float64.
struct ScalarPixel {
    double image[6], dPlanes[kSssSurfaceChannels + 2 * kSssLightChannels + 1];
};

ScalarPixel resolveScalar(const PixelRays& rays, const LitView& lit, int x, int y, const double* channels, const double* dImage)
{
    constexpr int kChannels = kSssSurfaceChannels + 2 * kSssLightChannels;
    ScalarPixel out{};
    double eye[3], ray[3], length2 = 0;
    for (int k = 0; k < 3; ++k) {
        eye[k] = rays.eye[k], ray[k] = rays.origin[k] + (x + 0.5) * rays.right[k] + (y + 0.5) * rays.down[k];
        length2 += ray[k] * ray[k];
    }
    for (double& r : ray) r /= std::sqrt(length2);
    const SssPixel<double> pixel = sssPixel(channels, channels[kChannels], eye, ray);
    SssPixelGradient<double> gradient;
    for (int l = 0; l < 2; ++l) {
        const Light& light = lit.lights[l];
        const double radius = std::max(light.radius, kMinLightRadius);
        double position[3], intensity[3];
        LightSample<double> at{};
        for (int k = 0; k < 3; ++k) position[k] = light.position[k], intensity[k] = light.intensity[k], at.dir[k] = light.directionToLight[k];
        at.falloff = 1;
        if (light.type == LightType::kPoint) at = samplePointLight(position, radius, pixel.point);
        const SssReflection<double> o = sssReflect(pixel.surface, pixel.wo, at.dir);
        const int own = kSssSurfaceChannels + kSssLightChannels * l;
        for (int c = 0; c < 3; ++c) out.image[3 * l + c] = sssRadiance(channels + own, intensity[c] * at.falloff, o.value[c], c);
        sssPixelLightBackward(pixel, channels + own, at, radius, intensity, o, dImage + 3 * l, out.dPlanes + own, gradient);
    }
    sssPixelBackward(pixel, channels, ray, gradient, out.dPlanes, &out.dPlanes[kChannels]);
    out.dPlanes[kChannels] += dImage[6];
    return out;
}

} // namespace

TEST_CASE("sss: resolving four pixels at a time is resolving each, whatever the width; where nothing is seen, all is 0")
{
    constexpr int kChannels = kSssSurfaceChannels + 2 * kSssLightChannels;
    Random random(27);
    LitView lit;
    lit.lightCount = 2;
    lit.lights[0].position = {1, 2, 2}, lit.lights[0].intensity = {3, 4, 5};
    lit.lights[1].type = LightType::kDirectional, lit.lights[1].directionToLight = {0, 0.6f, 0.8f};
    for (int width : {1, 4, 7, 10}) {
        const PixelRays rays{{0, 0, 3}, {-0.5f, 0.4f, -1}, {1.0f / float(width), 0, 0}, {0, -0.25f, 0}, width, 3};
        const size_t pixels = size_t(width) * 3;
        std::vector<float> planes((kChannels + 1) * pixels), dImage(7 * pixels), image(7 * pixels, -1), dPlanes(planes.size(), -1);
        for (float& p : planes) p = random.uniform();
        for (float& d : dImage) d = 2 * random.uniform() - 1;
        for (size_t i = 0; i < pixels; ++i) {
            const bool empty = i % 10 > 3, cancelled = i % 10 == 2;
            for (int k = 0; k <= kChannels; ++k) {
                float& p = planes[size_t(k) * pixels + i];
                if (empty) p = 0;
                else if (k == kChannels) p = 0.2f + 0.8f * p;
                else if (k < kSssBase) p = cancelled ? 0 : p - 0.2f;
                else if (k == kSssDepth) p = 3 * planes[size_t(kChannels) * pixels + i];
            }
        }
        sssResolve(rays, lit, planes.data(), image.data());
        sssResolveBackward(rays, lit, planes.data(), dImage.data(), dPlanes.data());
        for (size_t i = 0; i < pixels; ++i) {
            double channels[kChannels + 1], weights[7];
            for (int k = 0; k <= kChannels; ++k) channels[k] = planes[size_t(k) * pixels + i];
            for (int k = 0; k < 7; ++k) weights[k] = dImage[size_t(k) * pixels + i];
            const ScalarPixel expected = resolveScalar(rays, lit, int(i) % width, int(i) / width, channels, weights);
            CHECK(image[6 * pixels + i] == planes[size_t(kChannels) * pixels + i]);
            for (int k = 0; k < 6; ++k) {
                const double got = image[size_t(k) * pixels + i];
                CHECK(std::abs(got - expected.image[k]) < 1e-4 * (1 + std::abs(expected.image[k])));
            }
            if (channels[kChannels] == 0) continue; // no splat asks for it
            for (int k = 0; k <= kChannels; ++k) {
                const double got = dPlanes[size_t(k) * pixels + i];
                CHECK(std::abs(got - expected.dPlanes[k]) < 1e-3 * (1 + std::abs(expected.dPlanes[k])));
            }
        }
    }
}

namespace {

std::vector<double> randomWeights(Random& random)
{
    std::vector<double> w(kSssAllWeights);
    for (double& x : w) x = 0.5 * (2 * random.uniform() - 1);
    return w;
}

struct Inputs {
    double fixed[kSssFixedInputs], code[kSssCodeInputs], light[kSssLightInputs];
};

Inputs randomInputs(Random& random)
{
    Inputs in{};
    for (double& x : in.fixed) x = 2 * random.uniform() - 1;
    for (double& x : in.code) x = 2 * random.uniform() - 1;
    for (double& x : in.light) x = 2 * random.uniform() - 1;
    return in;
}

void firstLayer(const std::vector<double>& w, const Inputs& in, double* first)
{
    sssNetworkFixed(w.data(), in.fixed, first);
    sssNetworkCode(w.data() + kSssCode, in.code, first);
}

/// What dFirst says of the weights of the first layer, of the fixed inputs and of the code.
void firstLayerBackward(const std::vector<double>& w, const Inputs& in, const double* dFirst, double* dW, double* dFixed, double* dCode)
{
    sssNetworkFixedBackward(w.data(), in.fixed, dFirst, dW, dFixed);
    sssLayerBackward(w.data() + kSssCode, in.code, kSssCodeInputs, kSssHidden1, dFirst, dW + kSssCode, static_cast<double*>(nullptr), dCode);
}

} // namespace

TEST_CASE("sss: the gradient of the network is that of finite differences, for weights and inputs")
{
    Random random(31);
    std::vector<double> w = randomWeights(random);
    Inputs in = randomInputs(random);
    const double dResidual[3] = {0.3, -0.7, 0.5}, dShare = 0.9;
    const auto value = [&] {
        double first[kSssHidden1];
        firstLayer(w, in, first);
        const SssActivations<double> a = sssNetworkLight(w.data(), first, in.light);
        return dResidual[0] * a.residual[0] + dResidual[1] * a.residual[1] + dResidual[2] * a.residual[2] + dShare * a.share;
    };
    std::vector<double> dW(kSssAllWeights);
    double first[kSssHidden1], dFirst[kSssHidden1] = {}, dLight[kSssLightInputs] = {}, dFixed[kSssFixedInputs] = {}, dCode[kSssCodeInputs] = {};
    firstLayer(w, in, first);
    sssNetworkLightBackward(w.data(), first, in.light, sssNetworkLight(w.data(), first, in.light), dResidual, dShare, dW.data(),
                            dFirst, dLight);
    firstLayerBackward(w, in, dFirst, dW.data(), dFixed, dCode);
    const auto check = [&](double& x, double analytic) {
        const double was = x, step = 1e-6;
        x = was + step;
        const double hi = value();
        x = was - step;
        const double lo = value();
        x = was;
        CHECK(std::abs(analytic - (hi - lo) / (2 * step)) < 1e-7 * (1 + std::abs(analytic)));
    };
    for (size_t k = 0; k < kSssAllWeights; ++k) check(w[k], dW[k]);
    for (int k = 0; k < kSssFixedInputs; ++k) check(in.fixed[k], dFixed[k]);
    for (int k = 0; k < kSssCodeInputs; ++k) check(in.code[k], dCode[k]);
    for (int k = 0; k < kSssLightInputs; ++k) check(in.light[k], dLight[k]);
}

TEST_CASE("sss: the network stays bounded and smooth far outside what it has seen")
{
    Random random(32);
    const std::vector<double> w = randomWeights(random);
    std::vector<float> single(w.begin(), w.end());
    for (double scale : {0.0, 1.0, 1e3, 1e10}) {
        Inputs in = randomInputs(random);
        float first[kSssHidden1], fixed[kSssFixedInputs], light[kSssLightInputs];
        for (int k = 0; k < kSssFixedInputs; ++k) fixed[k] = float(scale * in.fixed[k]);
        for (int k = 0; k < kSssLightInputs; ++k) light[k] = float(scale * in.light[k]);
        sssNetworkFixed(single.data(), fixed, first);
        const SssActivations<float> a = sssNetworkLight(single.data(), first, light);
        for (float r : a.residual) CHECK((r >= 0 && r <= 1));
        CHECK((a.share >= 0 && a.share <= 2));
    }
    // What is known of a splat and of a light: positions and distances may be anything, the inputs never are.
    for (float far : {0.0f, 1.0f, 1e6f, 1e30f}) {
        const float position[3] = {far, -far, 0.5f * far}, normal[3] = {0, 0, 1}, frame[4] = {0.1f, 0, 0, 2};
        float fixed[kSssFixedInputs], light[kSssLightInputs];
        sssFixedInputs(position, normal, frame, fixed);
        sssLightInputs(normal, normal, 0.5f, far, light);
        for (float x : fixed) CHECK(std::abs(x) <= 1.0f);
        for (float x : light) CHECK(std::abs(x) <= 1.0f);
    }
}

TEST_CASE("sss: a network of zeros lets light in as visibility says, and adds a residual that its bias sets")
{
    const std::vector<double> w(kSssWeights);
    double first[kSssHidden1];
    const Inputs in{};
    sssNetworkFixed(w.data(), in.fixed, first);
    const SssActivations<double> a = sssNetworkLight(w.data(), first, in.light);
    CHECK(a.share == 1.0);
    CHECK(a.residual[1] == 0.5);
}

TEST_CASE("sss: roughness starts again, but for splats that keep what they have learnt; a saved model knows that it has")
{
    const auto roughness = [](const TrainableAppearance& model) {
        const std::vector<Channel> channels = model.exportChannels();
        const Channel& material = *std::find_if(channels.begin(), channels.end(), [](const Channel& c) { return c.name == "material"; });
        std::vector<float> out;
        for (size_t i = 0; i < model.count(); ++i) out.push_back(material.values[material.components * i]);
        return out;
    };
    const auto tries = [](const TrainableAppearance& model) {
        const std::vector<OptionalPart> parts = model.optionalParts();
        return std::any_of(parts.begin(), parts.end(), [](const OptionalPart& p) { return p.name == "learnt-roughness" && p.bySplat; });
    };
    const auto model = makeTrainableAppearance("sss", {});
    model->resize(3);
    CHECK(tries(*model));
    const float learnt = roughness(*model)[0];
    model->leaveOut("learnt-roughness", std::vector<uint8_t>{1, 0, 0});
    const std::vector<float> some = roughness(*model);
    CHECK(some[0] == learnt);
    CHECK(some[1] < 0.5f * learnt);
    CHECK(some[1] == some[2]);
    CHECK_FALSE(tries(*model));
    ByteWriter saved;
    model->save(saved);
    const auto loaded = makeTrainableAppearance("sss", {});
    ByteReader in(saved.bytes);
    REQUIRE(loaded->load(in));
    CHECK(roughness(*loaded) == some);
    CHECK_FALSE(tries(*loaded));
    AppearanceOptions untried;
    untried.without = {"roughness-restart"};
    CHECK_FALSE(tries(*makeTrainableAppearance("sss", untried)));
}

TEST_CASE("sss: sixteen Gaussians at once give what each gives alone, and the sum of their gradients")
{
    Random random(33);
    const std::vector<double> w = randomWeights(random);
    SssWeights weights;
    for (size_t k = 0; k < w.size(); ++k) weights.value[k] = float(w[k]);
    weights.transpose();
    constexpr int kLights = 3;
    auto batch = std::make_unique<SssBatch>();
    std::vector<Inputs> in;
    for (int row = 0; row < kLights * kSssLanes; ++row) {
        const int lane = row % kSssLanes;
        in.push_back(randomInputs(random));
        if (row >= kSssLanes) // the same Gaussian under another light
            std::copy_n(in[size_t(lane)].fixed, kSssFixedInputs, in.back().fixed), std::copy_n(in[size_t(lane)].code, kSssCodeInputs, in.back().code);
        for (int k = 0; k < kSssFixedInputs; ++k) batch->fixed[lane][k] = float(in.back().fixed[k]);
        for (int k = 0; k < kSssCodeInputs; ++k) batch->code[lane][k] = float(in.back().code[k]);
        for (int k = 0; k < kSssLightInputs; ++k) batch->light[row][k] = float(in.back().light[k]);
        for (int c = 0; c < 3; ++c) batch->dResidual[row][c] = 2 * random.uniform() - 1;
        batch->dShare[row] = 2 * random.uniform() - 1;
    }
    std::vector<double> want(kSssAllWeights), wantCode(kSssLanes * kSssCodeInputs);
    std::vector<float> got(kSssAllWeights);
    sssBatchForward(weights, kLights, *batch);
    for (int row = 0; row < kLights * kSssLanes; ++row) {
        const Inputs& x = in[size_t(row)];
        double first[kSssHidden1], dFirst[kSssHidden1] = {}, dLight[kSssLightInputs] = {}, dFixed[kSssFixedInputs] = {},
                                   dResidual[3];
        firstLayer(w, x, first);
        const SssActivations<double> a = sssNetworkLight(w.data(), first, x.light);
        for (int c = 0; c < 3; ++c) {
            CHECK(std::abs(batch->residual[row][c] - a.residual[c]) < 2e-5);
            dResidual[c] = batch->dResidual[row][c];
        }
        CHECK(std::abs(batch->share[row] - a.share) < 2e-5);
        sssNetworkLightBackward(w.data(), first, x.light, a, dResidual, double(batch->dShare[row]), want.data(), dFirst, dLight);
        firstLayerBackward(w, x, dFirst, want.data(), dFixed, &wantCode[size_t(row % kSssLanes * kSssCodeInputs)]);
    }
    sssBatchBackward(weights, kLights, *batch, got.data());
    double largest = 0;
    for (double x : want) largest = std::max(largest, std::abs(x));
    for (size_t k = 0; k < want.size(); ++k) CHECK(std::abs(got[k] - want[k]) < 1e-4 * largest);
    CHECK(largest > 0.1);
    for (size_t k = 0; k < wantCode.size(); ++k) CHECK(std::abs(batch->dCode[0][k] - wantCode[k]) < 1e-4 * largest);

    // without its share: the same residual, and gradients as if nothing depended on the share
    std::vector<float> whole(kSssAllWeights), bare(kSssAllWeights);
    const std::vector<float> residual(batch->residual[0], batch->residual[0] + 3 * kLights * kSssLanes);
    std::memset(batch->dShare, 0, sizeof batch->dShare);
    sssBatchBackward(weights, kLights, *batch, whole.data());
    weights.share = false;
    std::fill_n(batch->dShare, kLights * kSssLanes, 1.0f);
    sssBatchForward(weights, kLights, *batch);
    sssBatchBackward(weights, kLights, *batch, bare.data());
    CHECK(std::equal(residual.begin(), residual.end(), batch->residual[0]));
    for (int row = 0; row < kLights * kSssLanes; ++row) CHECK(batch->share[row] == 1.0f);
    CHECK(bare == whole);
    weights.share = true;

    sssBatchForward(weights, kLights, *batch);
    std::memset(batch->dResidual, 0, sizeof batch->dResidual), std::memset(batch->dShare, 0, sizeof batch->dShare);
    std::vector<float> nothing(kSssAllWeights);
    sssBatchBackward(weights, kLights, *batch, nothing.data());
    for (float x : nothing) CHECK(x == 0.0f);
}

TEST_CASE("sss: codes of new splats say nothing; a bake without codes stores none")
{
    for (const bool with : {true, false}) {
        AppearanceOptions options;
        if (!with) options.without = {"code"};
        const auto model = makeTrainableAppearance("sss", options);
        model->resize(3);
        const std::vector<Channel> channels = model->exportChannels();
        const auto has = [&](const char* name) { return std::any_of(channels.begin(), channels.end(), [&](const Channel& c) { return c.name == name; }); };
        CHECK(has("network"));
        CHECK(has("code") == with);
        CHECK(has("codeWeights") == with);
        for (const Channel& c : channels)
            if (c.name == "code") CHECK(std::all_of(c.values.begin(), c.values.end(), [](float x) { return x == 0; })); // until something is learnt
    }
}
