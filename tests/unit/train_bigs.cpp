// bigs: gradients in float64 against finite differences, properties of the evaluator, and the SIMD training kernels against both.
#include "appearance/bigs/bigs_backward.h"
#include "appearance/bigs/bigs_training.h"
#include "appearance/shared_adam.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <random>

using namespace nacre;

namespace {

struct Coefficients {
    std::vector<double> values; // as in training: tDir 25, tInd 75, rho 3, lobe 7 (normal of any length, log sharpness, k), shadow, forward 4, s
    int sFunctions;
    std::vector<uint8_t> map;   // visibility, or empty
    mutable double lobe[7], forward[4]; // as evaluated
    explicit Coefficients(int sFunctions) : values(kScatter + 3 * bigsPairCount(sFunctions)), sFunctions(sFunctions) {}
    BigsCoefficients<double> view() const
    {
        std::copy_n(&values[kLobe], 7, lobe);
        const double length = std::sqrt(lobe[0] * lobe[0] + lobe[1] * lobe[1] + lobe[2] * lobe[2]);
        for (int k = 0; k < 3; ++k) lobe[k] /= length;
        lobe[3] = std::exp(lobe[3]);
        std::copy_n(&values[kForward], 4, forward);
        forward[0] = std::exp(forward[0]);
        return {&values[0], &values[25], &values[100], values.data() + kScatter, sFunctions, lobe, {map.empty() ? nullptr : map.data()}, values[kShadow], forward};
    }
    BigsGradient<double> gradient() { return {&values[0], &values[25], &values[100], values.data() + kScatter}; }
};

void randomDirection(std::mt19937_64& rng, double* d)
{
    std::normal_distribution<double> n;
    double length = 0;
    for (int k = 0; k < 3; ++k) d[k] = n(rng), length += d[k] * d[k];
    for (int k = 0; k < 3; ++k) d[k] /= std::sqrt(length);
}

// Values around the middle of the clamps, so that both sides occur.
Coefficients randomCoefficients(std::mt19937_64& rng, int sFunctions)
{
    std::normal_distribution<double> n;
    Coefficients g(sFunctions);
    for (double& v : g.values) v = 0.3 * n(rng);
    g.values[0] += 1.0;
    for (int c = 0; c < 3; ++c) g.values[100 + c] = 0.4, g.values[25 + c] += 0.5, g.values[kLobeColor + c] = 0.5 + 0.2 * c, g.values[kForward + 1 + c] = 0.7 - 0.2 * c;
    g.values[kLobe + 2] += 1.0, g.values[kLobeSharpness] = 1.5 + g.values[kLobeSharpness], g.values[kShadow] = 0.8, g.values[kForward] += 1.0;
    g.map.resize(kVisibilityTexels); // smooth and away from the ends of the slope
    for (int t = 0; t < kVisibilityTexels; ++t) g.map[size_t(t)] = uint8_t(127 + 20 * std::sin(0.4 * (t % kVisibilitySize)) - 8 * std::cos(0.3 * (t / kVisibilitySize)));
    return g;
}

struct Directions {
    double wo[3], wi[3], yView[25], yLight[25];
    Directions(std::mt19937_64& rng)
    {
        randomDirection(rng, wo), shBasis(25, wo[0], wo[1], wo[2], yView);
        randomDirection(rng, wi), shBasis(25, wi[0], wi[1], wi[2], yLight);
    }
};

} // namespace

TEST_CASE("bigs gradient matches finite differences for every coefficient, with regularisers")
{
    std::mt19937_64 rng(3);
    for (int sFunctions : {0, 1, 4, 9, 16, 25}) {
        int checked = 0;
        for (int trial = 0; trial < 4; ++trial) {
            const Coefficients g = randomCoefficients(rng, sFunctions);
            const Directions dir(rng);
            const double weights[3] = {0.7, -0.4, 1.1}, positive = 0.3, energy = 0.2;
            const auto loss = [&](const Coefficients& x) {
                double a[75], sum = 0;
                bigsContractView(x.view(), dir.yView, a);
                const BigsTerms<double> t = bigsTerms(x.view(), a, dir.yLight);
                const auto square = [](double v) { return v < 0 ? v * v : 0.0; };
                sum += positive * square(t.direct);
                for (int c = 0; c < 3; ++c) {
                    const double excess = bigsScatteredEnergy(x.view(), dir.yLight, c) - 1;
                    sum += weights[c] * bigsTransport(t, bigsSharpTerms(x.view(), dir.wo, dir.wi), c) + positive * (square(t.scatter[c]) + square(t.indirect[c])) +
                           energy * (excess > 0 ? excess * excess : 0.0);
                }
                return sum;
            };
            double a[75];
            bigsContractView(g.view(), dir.yView, a);
            const BigsTerms<double> t = bigsTerms(g.view(), a, dir.yLight);
            BigsTerms<double> d{};
            bigsTransportBackward(t, bigsSharpTerms(g.view(), dir.wo, dir.wi).visible, weights, false, d);
            bigsPositiveBackward(t, positive, d);
            Coefficients gradient(sFunctions);
            BigsGradient<double> out = gradient.gradient();
            bigsTermsBackward(sFunctions, dir.yView, dir.yLight, d, out);
            bigsEnergyBackward(g.view(), dir.yLight, energy, out);
            for (size_t k = 0; k < g.values.size(); ++k) {
                if (k >= size_t(kLobe) && k < size_t(kScatter)) continue; // of bigsSharpBackward, below
                Coefficients lo = g, hi = g;
                lo.values[k] -= 1e-6, hi.values[k] += 1e-6;
                CHECK(gradient.values[k] == doctest::Approx((loss(hi) - loss(lo)) / 2e-6).epsilon(1e-6).scale(1.0));
                checked += gradient.values[k] != 0;
            }
        }
        CHECK(checked > 50);
    }
}

TEST_CASE("the leaky clamp lets descent raise a negative value and nothing else")
{
    BigsTerms<double> t{-0.1, {0.2, -0.3, 0.4}, {-0.2, 0.1, -0.1}}, d{};
    const double up[3] = {-1, -1, -1}, down[3] = {1, 1, 1};
    bigsTransportBackward(t, 0.5, up, true, d);
    CHECK(d.direct < 0);
    CHECK(d.indirect[0] < 0);
    d = {};
    bigsTransportBackward(t, 0.5, down, true, d);
    CHECK(d.direct == 0);
    CHECK(d.indirect[0] == 0);
    CHECK(d.indirect[1] == 1);
    d = {};
    bigsTransportBackward(t, 0.5, up, false, d);
    CHECK(d.direct == 0);
}

TEST_CASE("gradient of lobe, shadow and forward light matches finite differences")
{
    std::mt19937_64 rng(4);
    int lit = 0;
    for (int trial = 0; trial < 200; ++trial) {
        Coefficients g = randomCoefficients(rng, 0);
        const Directions dir(rng);
        const double weights[3] = {0.7, -0.4, 1.1};
        const auto value = [&](const Coefficients& x) {
            const BigsTerms<double> t = bigsTerms<double>(x.view(), nullptr, dir.yLight);
            double sum = 0;
            for (int c = 0; c < 3; ++c) sum += weights[c] * bigsTransport(t, bigsSharpTerms(x.view(), dir.wo, dir.wi), c);
            return sum;
        };
        BigsSharpGradient<double> d;
        bigsSharpBackward(g.view(), bigsTerms<double>(g.view(), nullptr, dir.yLight), dir.wo, dir.wi, weights, d);
        const double* n = &g.values[kLobe];
        const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        const double analytic[12] = {d.normal[0] / length, d.normal[1] / length, d.normal[2] / length, d.logSharpness, d.color[0], d.color[1], d.color[2], d.shadow,
                                     d.forwardLogSharpness, d.forwardColor[0], d.forwardColor[1], d.forwardColor[2]};
        lit += d.color[0] != 0;
        for (int k = 0; k < 12; ++k) {
            Coefficients hi = g, lo = g;
            const double step = 1e-6;
            hi.values[size_t(kLobe + k)] += step, lo.values[size_t(kLobe + k)] -= step;
            CAPTURE(trial);
            CAPTURE(k);
            CHECK((value(hi) - value(lo)) / (2 * step) == doctest::Approx(analytic[k]).epsilon(1e-5).scale(0.1));
        }
    }
    CHECK(lit > 50);
}

TEST_CASE("neighbours learn together, and groups without a signal stand still")
{
    SharedAdam adam;
    const size_t count = 4096;
    std::vector<float> gradient(4 * count, 0.0f), x(4 * count, 0.0f);
    std::vector<uint8_t> active(count, 1);
    std::mt19937_64 rng(9);
    std::normal_distribution<float> noise;
    for (int step = 0; step < 50; ++step) {
        for (size_t i = 0; i < count; ++i) // one splat in 50 of the first half sees a highlight that is too dim; the rest only faint noise
            for (size_t k = 0; k < 4; ++k) gradient[4 * i + k] = i < count / 2 && i % 50 == 0 ? -1.0f : 1e-4f * noise(rng);
        const auto delta = adam.step(gradient, active, {0.01f, 0.01f});
        for (size_t k = 0; k < x.size(); ++k) x[k] -= delta[k];
    }
    double unseen = 0, still = 0;
    for (size_t i = 0; i < count; ++i) (i < count / 2 ? unseen : still) += i % 50 ? x[4 * i + 1] / double(count / 2) : 0.0;
    CHECK(unseen > 0.5);            // splats that never saw it brighten with their neighbours
    CHECK(std::abs(still) < 0.01);
    active.assign(count, 0);
    for (float d : adam.step(gradient, active, {0.01f, 0.01f})) CHECK(d == 0.0f);
}

TEST_CASE("s is reciprocal: swapping light and view changes nothing")
{
    std::mt19937_64 rng(5);
    for (int trial = 0; trial < 20; ++trial) {
        const Coefficients g = randomCoefficients(rng, 25);
        const Directions dir(rng);
        double aView[75], aLight[75];
        bigsContractView(g.view(), dir.yView, aView);
        bigsContractView(g.view(), dir.yLight, aLight);
        for (int c = 0; c < 3; ++c) {
            double forward = 0, backward = 0;
            for (int i = 0; i < 25; ++i) forward += aView[3 * i + c] * dir.yLight[i], backward += aLight[3 * i + c] * dir.yView[i];
            CHECK(forward == doctest::Approx(backward).epsilon(1e-12));
        }
    }
}

TEST_CASE("fewer functions of s are a prefix of more")
{
    std::mt19937_64 rng(6);
    Coefficients full = randomCoefficients(rng, 25), small(9);
    for (size_t k = kScatter + 3 * bigsPairCount(9); k < full.values.size(); ++k) full.values[k] = 0;
    std::copy(full.values.begin(), full.values.begin() + small.values.size(), small.values.begin());
    const Directions dir(rng);
    double a[75], b[75];
    bigsContractView(full.view(), dir.yView, a);
    bigsContractView(small.view(), dir.yView, b);
    const BigsTerms<double> x = bigsTerms(full.view(), a, dir.yLight), y = bigsTerms(small.view(), b, dir.yLight);
    for (int c = 0; c < 3; ++c) CHECK(x.scatter[c] == doctest::Approx(y.scatter[c]).epsilon(1e-12));
}

namespace {

// A few splats, some invisible, two point lights and a directional one.
struct Scene {
    static constexpr size_t kCount = 37;
    BigsParameters parameters;
    std::vector<GaussianGeometry<float>> geometry{kCount};
    std::vector<uint32_t> visibleFromSplat;
    size_t visible = 0;
    LitView lit;
    BigsBands bands;

    explicit Scene(int sFunctions, uint64_t seed = 12)
    {
        std::mt19937_64 rng(seed);
        std::uniform_real_distribution<float> u(-1, 1);
        parameters.sFunctions = sFunctions;
        parameters.resize(kCount);
        for (size_t i = 0; i < kCount; ++i) {
            const Coefficients g = randomCoefficients(rng, sFunctions);
            for (size_t k = 0; k < g.values.size(); ++k) parameters.value[parameters.index(i, int(k))] = float(g.values[k]);
            for (uint8_t texel : g.map) parameters.visibility.push_back(texel);
            for (float& p : geometry[i].position) p = u(rng);
            visibleFromSplat.push_back(i % 5 == 3 ? ~0u : uint32_t(visible++));
        }
        lit.eye[0] = 0.5f, lit.eye[1] = -3, lit.eye[2] = 1;
        lit.lightCount = 3;
        lit.lights[0].position = {2, 3, 4}, lit.lights[0].intensity = {20, 30, 25};
        lit.lights[1].position = geometry[0].position[0] + glm::vec3(0), lit.lights[1].radius = 0.5f; // may lie inside its radius
        lit.lights[2].type = LightType::kDirectional, lit.lights[2].directionToLight = glm::normalize(glm::vec3(1, -1, 0.5f));
        bands.scatter = sFunctions;
        bands.lobe = bands.forward = true;
    }
    Coefficients coefficients(size_t i) const
    {
        Coefficients g(parameters.sFunctions);
        for (size_t k = 0; k < g.values.size(); ++k) g.values[k] = parameters.value[parameters.index(i, int(k))];
        if (!parameters.visibility.empty()) g.map.assign(&parameters.visibility[kVisibilityTexels * i], &parameters.visibility[kVisibilityTexels * i] + kVisibilityTexels);
        return g;
    }
    double falloff(size_t i, int l, double* yLight, double* wi) const
    {
        const Light& light = lit.lights[l];
        double p[3], q[3];
        for (int k = 0; k < 3; ++k) p[k] = geometry[i].position[k], q[k] = light.position[k];
        LightSample<double> s = samplePointLight(q, double(light.radius), p);
        if (light.type == LightType::kDirectional) {
            for (int k = 0; k < 3; ++k) s.dir[k] = light.directionToLight[k];
            s.falloff = 1;
        }
        std::copy_n(s.dir, 3, wi);
        shBasis(25, s.dir[0], s.dir[1], s.dir[2], yLight);
        return s.falloff;
    }
    void viewBasis(size_t i, double* yView, double* wo) const
    {
        double p[3], e[3];
        for (int k = 0; k < 3; ++k) p[k] = geometry[i].position[k], e[k] = lit.eye[k];
        const LightSample<double> s = samplePointLight(e, 0.0, p);
        std::copy_n(s.dir, 3, wo);
        shBasis(25, s.dir[0], s.dir[1], s.dir[2], yView);
    }
    VisibleView view() const { return {geometry, visibleFromSplat, visible}; }
};

} // namespace

TEST_CASE("without s, all else of a splat stays where it was, optimiser state included")
{
    Scene scene(9);
    BigsParameters& p = scene.parameters;
    for (size_t i = 0; i < p.momentum.size(); ++i) p.momentum[i] = 0.5f * p.value[i] + 1;
    const BigsParameters before = p;
    p.dropScatter();
    CHECK(p.coefficients() == kScatter);
    CHECK(p.value.size() == p.blocks() * kScatter * kLanes16);
    CHECK(p.secondMoment == before.secondMoment);
    for (size_t i = 0; i < p.count; ++i)
        for (int k = 0; k < kScatter; ++k) {
            REQUIRE(p.value[p.index(i, k)] == before.value[before.index(i, k)]);
            REQUIRE(p.momentum[p.index(i, k)] == before.momentum[before.index(i, k)]);
        }
}

TEST_CASE("where s is left out it is and stays zero; nothing else changes, neither there nor beside it")
{
    std::vector<uint8_t> kept(Scene::kCount);
    for (size_t i = 0; i < Scene::kCount; ++i) kept[i] = i >= 16 && i % 3 == 0; // a block without s, a mixed one, a last one that is short
    const auto step = [&](bool leaveOut) {
        Scene scene(9);
        for (size_t i = 0; i < Scene::kCount; ++i)
            for (int k = kScatter; k < scene.parameters.coefficients() && !kept[i]; ++k) scene.parameters.value[scene.parameters.index(i, k)] = 0;
        if (leaveOut) scene.parameters.keepScatter(kept);
        std::mt19937_64 rng(8);
        std::uniform_real_distribution<float> u(-1, 1);
        std::vector<float> colors(scene.visible * 16), dColors(scene.visible * 16);
        for (float& d : dColors) d = u(rng);
        AlignedVector<float> terms(scene.parameters.blocks() * kBigsTermStride * kLanes16);
        BigsUpdate update;
        for (float& r : update.rate) r = 0.01f;
        update.positiveWeight = 0.02f, update.energyWeight = 0.03f;
        BigsLobeGradients lobe, forward;
        bigsForward(scene.parameters, scene.view(), scene.lit, scene.bands, {}, colors.data(), terms.data());
        bigsBackwardAndStep(scene.parameters, scene.view(), scene.lit, scene.bands, {}, std::vector<uint8_t>(scene.visible, 1).data(), dColors.data(),
                            terms.data(), update, lobe, forward);
        return std::pair(scene.parameters, colors);
    };
    const auto [out, outColors] = step(true);
    const auto [all, allColors] = step(false);
    CHECK(outColors == allColors);
    size_t learnt = 0;
    for (size_t i = 0; i < Scene::kCount; ++i)
        for (int k = 0; k < out.coefficients(); ++k) {
            CAPTURE(i);
            CAPTURE(k);
            const bool none = k >= kScatter && !kept[i];
            REQUIRE(out.value[out.index(i, k)] == (none ? 0.0f : all.value[all.index(i, k)]));
            REQUIRE(out.momentum[out.index(i, k)] == (none ? 0.0f : all.momentum[all.index(i, k)]));
            learnt += none && all.value[all.index(i, k)] != 0;
        }
    CHECK(learnt > 100); // had it not been left out
}

TEST_CASE("splats without s stay so when they are saved, moved and split, and the asset has zeros for them")
{
    const std::vector<GaussianGeometry<float>> geometry(6);
    const auto model = makeTrainableAppearance("bigs", {4});
    model->resize(6);
    ByteWriter saved;
    model->leaveOut("s", std::vector<uint8_t>{1, 0, 1, 0, 0, 1});
    model->save(saved);
    const auto loaded = makeTrainableAppearance("bigs", {4});
    ByteReader in(saved.bytes);
    REQUIRE(loaded->load(in));
    loaded->resize(7);
    loaded->copySplat(1, 6);
    loaded->copySplat(2, 4);
    loaded->permute(std::vector<uint32_t>{6, 5, 4, 3, 2, 1, 0}); // without s: 6, 3, 1, now in rows 0, 3, 5

    std::vector<GaussianGeometry<float>> seven(7);
    std::vector<uint32_t> visible(7);
    for (uint32_t i = 0; i < 7; ++i) visible[i] = i, seven[i].position[0] = float(i);
    const VisibleView view{seven, visible, 7};
    LitView lit;
    lit.lightCount = 1, lit.lights[0].position = {1, 2, 3}, lit.lights[0].intensity = glm::vec3(5);
    lit.eye[2] = 4;
    std::vector<float> colors(7 * 16), d(7 * 16, 1.0f);
    const float random[3] = {0.1f, 0.2f, 0.3f};
    loaded->beginStep(0.5, 1, 1, random, [&] { return std::span<const GaussianGeometry<float>>(seven); });
    loaded->forward(view, lit, colors.data());
    loaded->backwardAndStep(view, lit, std::vector<uint8_t>(7, 1).data(), d.data());
    bool found = false;
    for (const Channel& c : loaded->exportChannels()) {
        if (c.name != "s") continue;
        found = true;
        for (size_t i = 0; i < 7; ++i) {
            CAPTURE(i);
            const bool zero = std::all_of(&c.values[c.components * i], &c.values[c.components * i] + c.components, [](float x) { return x == 0; });
            CHECK(zero == (i == 0 || i == 3 || i == 5));
        }
    }
    CHECK(found);
}

TEST_CASE("SIMD forward equals the scalar evaluator")
{
    for (int sFunctions : {0, 9, 25}) {
        Scene scene(sFunctions);
        std::vector<float> colors(scene.visible * 16);
        AlignedVector<float> terms(scene.parameters.blocks() * kBigsTermStride * kLanes16);
        bigsForward(scene.parameters, scene.view(), scene.lit, scene.bands, {}, colors.data(), terms.data());
        for (size_t i = 0; i < Scene::kCount; ++i) {
            if (scene.visibleFromSplat[i] == ~0u) continue;
            const Coefficients g = scene.coefficients(i);
            double yView[25], yLight[25], a[75], wo[3], wi[3];
            scene.viewBasis(i, yView, wo);
            bigsContractView(g.view(), yView, a);
            for (int l = 0; l < 3; ++l) {
                const double falloff = scene.falloff(i, l, yLight, wi);
                const BigsTerms<double> t = bigsTerms(g.view(), a, yLight);
                for (int c = 0; c < 3; ++c) {
                    const double expected = scene.lit.lights[l].intensity[c] * falloff * bigsTransport(t, bigsSharpTerms(g.view(), wo, wi), c);
                    const double bound = scene.lit.lights[l].intensity[c] * falloff;
                    CAPTURE(i);
                    CHECK(std::abs(colors[scene.visibleFromSplat[i] * 16 + 3 * l + c] - expected) < 2e-5 * (bound + std::abs(expected))); // f32 sums of up to 650 terms
                }
            }
        }
    }
}

TEST_CASE("the fused SIMD step equals gradient, grouped second moment and Adam done one by one")
{
    for (int sFunctions : {0, 4, 25}) {
        Scene scene(sFunctions);
        const Scene before(sFunctions);
        std::mt19937_64 rng(8);
        std::uniform_real_distribution<float> u(-1, 1);
        std::vector<float> colors(scene.visible * 16), dColors(scene.visible * 16);
        AlignedVector<float> terms(scene.parameters.blocks() * kBigsTermStride * kLanes16);
        std::vector<uint8_t> active(scene.visible, 1);
        active[4] = 0;
        for (float& d : dColors) d = u(rng);
        BigsUpdate update;
        for (float& r : update.rate) r = 0.01f;
        update.positiveWeight = 0.02f, update.energyWeight = 0.03f;
        const BigsRandomLight random{true, {0.6f, 0, 0.8f}};
        BigsLobeGradients lobe, forward;
        bigsForward(scene.parameters, scene.view(), scene.lit, scene.bands, random, colors.data(), terms.data());
        bigsBackwardAndStep(scene.parameters, scene.view(), scene.lit, scene.bands, random, active.data(), dColors.data(), terms.data(), update, lobe, forward);

        for (size_t i = 0; i < Scene::kCount; ++i) {
            CAPTURE(i);
            const Coefficients g = before.coefficients(i), after = scene.coefficients(i);
            const uint32_t v = scene.visibleFromSplat[i];
            if (v == ~0u || !active[v]) {
                CHECK(g.values == after.values);
                continue;
            }
            Coefficients gradient(sFunctions);
            BigsGradient<double> out = gradient.gradient();
            BigsSharpGradient<double> sharp;
            double yView[25], yLight[25], a[75], wo[3], wi[3];
            scene.viewBasis(i, yView, wo);
            bigsContractView(g.view(), yView, a);
            for (int l = 0; l < 4; ++l) { // the fourth is the random direction, regularised only
                double dTransport[3] = {0, 0, 0};
                if (l < 3) {
                    const double falloff = scene.falloff(i, l, yLight, wi);
                    for (int c = 0; c < 3; ++c) dTransport[c] = dColors[v * 16 + 3 * l + c] * falloff * scene.lit.lights[l].intensity[c];
                } else {
                    shBasis(25, double(random.direction[0]), double(random.direction[1]), double(random.direction[2]), yLight);
                }
                const BigsTerms<double> t = bigsTerms(g.view(), a, yLight);
                BigsTerms<double> d{};
                const double visible = l < 3 ? bigsSharpTerms(g.view(), wo, wi).visible : 1;
                if (l < 3) bigsSharpBackward(g.view(), t, wo, wi, dTransport, sharp);
                bigsTransportBackward(t, visible, dTransport, true, d);
                bigsPositiveBackward(t, double(update.positiveWeight), d);
                bigsTermsBackward(sFunctions, yView, yLight, d, out);
                bigsEnergyBackward(g.view(), yLight, double(update.energyWeight), out);
            }
            // First Adam step: momentum / correction = gradient, second moment / correction = mean square of the group (of the image
            // gradient and L+ for s: the energy term is left out of the group's scale).
            const auto checkGroup = [&](size_t first, size_t count, const std::vector<double>& scaleGradient) {
                double square = 0;
                for (size_t k = first; k < first + count; ++k) square += scaleGradient[k] * scaleGradient[k];
                const double root = std::sqrt(square / double(count));
                for (size_t k = first; k < first + count; ++k) {
                    double expected = g.values[k] - 0.01 * (root > 0 ? gradient.values[k] / root : 0);
                    if ((k >= 100 && k < 103) || k == kShadow) expected = std::clamp(expected, 0.0, 1.0);
                    CHECK(after.values[k] == doctest::Approx(expected).epsilon(1e-4).scale(1.0)); // f32 gradient over its f32 norm
                }
            };
            checkGroup(0, 25, gradient.values);
            checkGroup(25, 75, gradient.values);
            checkGroup(100, 3, gradient.values);
            const double* n = &g.values[kLobe];
            const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
            for (int k = 0; k < 3; ++k) gradient.values[size_t(kLobe + k)] = sharp.normal[k] / length; // of the raw normal
            gradient.values[kShadow] = sharp.shadow;
            checkGroup(kLobe, 3, gradient.values);
            checkGroup(kShadow, 1, gradient.values);
            CHECK(lobe.active[i] == 1);
            const double scale = std::abs(sharp.logSharpness) + std::abs(sharp.color[0]) + std::abs(sharp.color[1]) + std::abs(sharp.color[2]) + 1e-3;
            CHECK(std::abs(lobe.gradient[4 * i] - sharp.logSharpness) < 1e-4 * scale);
            for (int c = 0; c < 3; ++c) CHECK(std::abs(lobe.gradient[4 * i + 1 + size_t(c)] - sharp.color[c]) < 1e-4 * scale);
            CHECK(forward.active[i] == 1);
            const double* f = sharp.forwardColor;
            const double forwardScale = std::abs(sharp.forwardLogSharpness) + std::abs(f[0]) + std::abs(f[1]) + std::abs(f[2]) + 1e-3;
            CHECK(std::abs(forward.gradient[4 * i] - sharp.forwardLogSharpness) < 1e-4 * forwardScale);
            for (int c = 0; c < 3; ++c) CHECK(std::abs(forward.gradient[4 * i + 1 + size_t(c)] - f[c]) < 1e-4 * forwardScale);
            std::vector<double> withoutEnergy = gradient.values;
            Coefficients energyOnly(sFunctions);
            BigsGradient<double> energyOut = energyOnly.gradient();
            for (int l = 0; l < 4; ++l) {
                if (l < 3) scene.falloff(i, l, yLight, wi);
                else shBasis(25, 0.6, 0.0, 0.8, yLight);
                bigsEnergyBackward(g.view(), yLight, double(update.energyWeight), energyOut);
            }
            for (size_t k = 0; k < withoutEnergy.size(); ++k) withoutEnergy[k] -= energyOnly.values[k];
            for (int degree = 0; degree * degree < sFunctions; ++degree) {
                const size_t first = kScatter + 3 * bigsPairCount(degree * degree), last = kScatter + 3 * bigsPairCount((degree + 1) * (degree + 1));
                checkGroup(first, last - first, withoutEnergy);
            }
        }
    }
}

TEST_CASE("resize after a shrink hands out clean splats; permute keeps rows whole")
{
    Scene scene(4);
    BigsParameters& p = scene.parameters;
    std::vector<uint32_t> order(Scene::kCount);
    for (size_t i = 0; i < order.size(); ++i) order[i] = uint32_t(order.size() - 1 - i);
    const Coefficients last = scene.coefficients(Scene::kCount - 1);
    p.permute(order);
    CHECK(scene.coefficients(0).values == last.values);
    p.resize(20);
    p.resize(37);
    for (double v : scene.coefficients(25).values) CHECK(v == 0.0);
}
