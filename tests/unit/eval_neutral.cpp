// The fitted look of viewers that cannot relight.
#include "pack/neutral_look.h"

#include "appearance/bigs/bigs_asset.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <random>

using namespace nacre;

namespace {

SplatAsset makeBigs(size_t count, int sFunctions)
{
    std::mt19937 random(7);
    const auto uniform = [&](float lo, float hi) { return lo + (hi - lo) * float(random() & 0xffff) / 65535.0f; };
    SplatAsset asset;
    asset.model = "bigs";
    asset.cloud.count = count;
    asset.cloud.rotations.assign(count, glm::quat(1, 0, 0, 0));
    asset.cloud.scales.assign(count, glm::vec3(0.1f));
    asset.cloud.opacities.assign(count, 0.5f);
    const auto add = [&](const char* name, uint32_t components, float amplitude, auto mean) {
        Channel channel{name, components, {}};
        for (size_t i = 0; i < count * components; ++i)
            channel.values.push_back(mean(uint32_t(i % components)) + uniform(-amplitude, amplitude));
        asset.channels.push_back(std::move(channel));
    };
    for (size_t i = 0; i < count; ++i)
        asset.cloud.positions.emplace_back(uniform(-0.5f, 0.5f), uniform(-0.5f, 0.5f), uniform(-0.5f, 0.5f));
    add("tDir", 25, 0.02f, [](uint32_t k) { return k == 0 ? 2.0f : 0.0f; }); // stays positive: no clamp
    add("tInd", 75, 0.02f, [](uint32_t k) { return k < 3 ? 1.0f : 0.0f; });
    add("rho", 3, 0.1f, [](uint32_t) { return 0.6f; });
    if (sFunctions) add("s", uint32_t(3 * bigsPairCount(sFunctions)), 0.02f, [](uint32_t) { return 0.0f; });
    return asset;
}

std::vector<Light> makeLights(size_t count)
{
    std::vector<Light> lights(count);
    for (size_t i = 0; i < count; ++i) {
        const float phi = 6.2831853f * float(i) / float(count), z = 0.2f + 0.7f * float(i % 5) / 5.0f;
        const float r = std::sqrt(1 - z * z);
        const glm::vec3 direction(r * std::cos(phi), r * std::sin(phi), z);
        if (i % 2) lights[i].type = LightType::kDirectional;
        lights[i].directionToLight = direction;
        lights[i].position = 5.0f * direction;
        lights[i].intensity = i % 2 ? glm::vec3(3.0f) : glm::vec3(75.0f);
    }
    return lights;
}

/// Radiance of splat `i` towards `wo`, straight from the definition, lights as given.
glm::dvec3 radiance(const SplatAsset& asset, size_t i, const std::vector<Light>& lights, const glm::vec3& wo)
{
    const BigsCoefficients<float> g = BigsChannels(asset).at(i);
    float yView[25], yLight[25], a[75];
    shBasis(25, wo.x, wo.y, wo.z, yView);
    bigsContractView(g, yView, a);
    glm::dvec3 sum(0.0);
    for (const Light& light : lights) {
        glm::vec3 w = light.directionToLight, e = light.intensity;
        if (light.type == LightType::kPoint) {
            const glm::vec3 d = light.position - asset.cloud.positions[i];
            w = glm::normalize(d);
            e /= glm::dot(d, d);
        }
        shBasis(25, w.x, w.y, w.z, yLight);
        const BigsTerms<float> t = bigsTerms(g, a, yLight);
        for (int c = 0; c < 3; ++c) sum[c] += double(e[c]) * bigsTransport(t, bigsSharpTerms(g, &wo.x, &w.x), c);
    }
    return sum;
}

glm::dvec3 fitted(const NeutralLook& look, size_t i, const glm::vec3& wo)
{
    double y[16];
    shBasis(16, double(-wo.x), double(-wo.y), double(-wo.z), y); // KHR's argument points from the camera to the splat
    glm::dvec3 sum(0.5);
    for (size_t f = 0; f < 16; ++f) sum += y[f] * glm::dvec3(look.sh[16 * i + f]);
    return sum;
}

} // namespace

TEST_CASE("asset without s looks the same from everywhere")
{
    const SplatAsset asset = makeBigs(20, 0);
    const auto look = fitNeutralLook(asset, makeLights(10));
    REQUIRE(look);
    CHECK(look->shFunctions == 16);
    for (size_t i = 0; i < look->sh.size(); ++i) {
        if (i % 16 == 0) continue;
        CHECK(glm::length(look->sh[i]) < 1e-5); // f32 radiance of order 1
    }
}

TEST_CASE("views of degree 2 and 3 are reproduced exactly, up to one exposure for all splats")
{
    for (int functions : {4, 9, 16}) {
        CAPTURE(functions);
        const SplatAsset asset = makeBigs(30, functions);
        const std::vector<Light> lights = makeLights(12);
        const auto look = fitNeutralLook(asset, lights);
        REQUIRE(look);
        const double exposure = fitted(*look, 0, {0, 0, 1}).g / radiance(asset, 0, lights, {0, 0, 1}).g;
        for (size_t i = 0; i < asset.cloud.count; ++i)
            for (const glm::vec3& wo :
                 {glm::vec3(0, 0, 1), glm::vec3(0.6f, 0, 0.8f), glm::vec3(0, -0.8f, 0.6f), glm::vec3(-1, 0, 0)}) {
                const glm::dvec3 want = exposure * radiance(asset, i, lights, wo);
                CHECK(glm::length(fitted(*look, i, wo) - want) < 2e-5 * glm::length(want)); // f32 sums of 12 lights x 25 terms
            }
    }
}

TEST_CASE("white Lambertian splat that faces the light has radiance 1")
{
    SplatAsset asset = makeBigs(1, 0);
    asset.cloud.positions[0] = glm::vec3(0.0f);
    for (Channel& channel : asset.channels) std::fill(channel.values.begin(), channel.values.end(), 0.0f);
    // T_dir = 1 in every direction and rho = 1/pi: what a white Lambertian surface sends back of frontal light.
    asset.channels[0].values[0] = std::sqrt(4 * std::numbers::pi_v<float>);
    std::fill(asset.channels[2].values.begin(), asset.channels[2].values.end(), std::numbers::inv_pi_v<float>);
    for (float intensity : {1e-4f, 1.0f, 1e6f}) {
        Light light;
        light.position = {0, 3, 4};
        light.intensity = glm::vec3(intensity);
        const auto look = fitNeutralLook(asset, std::vector<Light>{light});
        REQUIRE(look);
        CHECK(fitted(*look, 0, {1, 0, 0}).g == doctest::Approx(1.0).epsilon(1e-5)); // f32
    }
}

TEST_CASE("opposite lights have no mean direction and still give a sane exposure")
{
    std::vector<Light> lights(2);
    lights[0].type = lights[1].type = LightType::kDirectional;
    lights[1].directionToLight = -lights[0].directionToLight;
    const auto look = fitNeutralLook(makeBigs(3, 4), lights);
    REQUIRE(look);
    for (const glm::vec3& c : look->sh) CHECK(glm::length(c) < 100.0f);
}

TEST_CASE("neutral look does not depend on the number of threads")
{
    const SplatAsset asset = makeBigs(500, 9);
    const std::vector<Light> lights = makeLights(100);
    const auto look = fitNeutralLook(asset, lights);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const auto again = fitNeutralLook(asset, lights);
    REQUIRE(look);
    REQUIRE(again);
    CHECK(std::memcmp(look->sh.data(), again->sh.data(), look->sh.size() * sizeof(glm::vec3)) == 0);
}

TEST_CASE("without usable light there is no neutral look")
{
    const SplatAsset asset = makeBigs(2, 0);
    std::vector<Light> lights(1);
    lights[0].intensity = glm::vec3(0.0f);
    for (const auto& look : {fitNeutralLook(asset, {}), fitNeutralLook(asset, lights)}) {
        REQUIRE_FALSE(look);
        CHECK(look.error().code == ErrorCode::kBadInput);
    }
    lights[0].type = LightType::kEnvironment;
    lights[0].intensity = glm::vec3(1.0f);
    CHECK_FALSE(fitNeutralLook(asset, lights));
}
