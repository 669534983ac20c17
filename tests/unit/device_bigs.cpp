// bigs on the device, emulated in three orders of threads, against the CPU's kernels, which train_bigs.cpp holds against float64.
#include "device/bigs.h"

#include "base/random.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <vector>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 9}};

struct Parts {
    int functions, lights;
    bool lobe, forward, visibility, scatters, random;
};

/// A model in the middle of a bake, and a view of it.
struct Case {
    BigsState state;
    std::vector<GaussianGeometry<float>> geometry;
    std::vector<uint32_t> visibleFromSplat;
    std::vector<uint8_t> active;
    std::vector<float> dColors;
    LitView lit;
    size_t visible = 0;

    Case(size_t count, const Parts& parts, uint64_t seed)
    {
        Random random(seed);
        const auto u = [&] { return 2 * random.uniform() - 1; };
        BigsParameters& p = state.parameters;
        p.sFunctions = parts.functions;
        p.resize(count);
        if (parts.visibility) {
            p.visibility.resize(count * kVisibilityTexels);
            for (uint8_t& texel : p.visibility) texel = uint8_t(255 * random.uniform());
        }
        if (parts.scatters) p.scatters.resize(count);
        geometry.resize(count), visibleFromSplat.resize(count);
        for (size_t i = 0; i < count; ++i) {
            for (int k = 0; k < p.coefficients(); ++k) p.value[p.index(i, k)] = 0.3f * u(), p.momentum[p.index(i, k)] = 0.01f * u();
            p.value[p.index(i, 0)] += 1, p.value[p.index(i, kLobe + 2)] += 1, p.value[p.index(i, kLobeSharpness)] += 1.5f, p.value[p.index(i, kForward)] += 1;
            for (int c = 0; c < 3; ++c) {
                p.value[p.index(i, kRho + c)] = 0.4f, p.value[p.index(i, kTInd + c)] += 0.5f;
                p.value[p.index(i, kLobeColor + c)] = 0.5f, p.value[p.index(i, kForward + 1 + c)] = 0.4f;
            }
            p.value[p.index(i, kShadow)] = 0.8f;
            for (int k = 0; k < kBigsGroups; ++k) p.secondMoment[(i / kLanes16 * kBigsGroups + size_t(k)) * kLanes16 + i % kLanes16] = 0.01f * random.uniform();
            if (parts.scatters && i < 32) p.scatters[i] = i < 16 ? 0 : uint8_t(i % 3 == 0); // a block without, a mixed one; the others have it
            if (parts.scatters && i >= 32) p.scatters[i] = 1;
            if (parts.scatters && !p.scatters[i])
                for (int k = kScatter; k < p.coefficients(); ++k) p.value[p.index(i, k)] = p.momentum[p.index(i, k)] = 0;
            for (int k = 0; k < 3; ++k) geometry[i].position[k] = u();
            visibleFromSplat[i] = random.uniform() < 0.8f ? uint32_t(visible++) : ~0u;
        }
        active.resize(visible);
        for (uint8_t& a : active) a = random.uniform() < 0.7f;
        dColors.resize(visible * kColorStride);
        for (float& d : dColors) d = 1e-3f * u();
        for (int k = 0; k < 3; ++k) lit.eye[k] = k == 1 ? -4.0f : 0.3f;
        lit.lightCount = parts.lights;
        for (int l = 0; l < parts.lights; ++l) {
            Light& light = lit.lights[l];
            light.type = l % 2 ? LightType::kDirectional : LightType::kPoint;
            light.position = {3 * u(), 3 * u(), 3 * u()};
            light.directionToLight = glm::normalize(glm::vec3(u(), u(), u()));
            light.intensity = {3 + u(), 3 + u(), 3 + u()};
        }
        state.bands = {25, 25, parts.functions, parts.lobe, parts.forward};
        state.random = {parts.random, {0.6f, 0, 0.8f}};
        for (float& rate : state.update.rate) rate = 5e-3f;
        state.update.step = 7, state.update.positiveWeight = 1e-4f, state.update.energyWeight = 1e-3f;
        state.sharedRates = {6e-2f, 5e-2f};
    }

    VisibleView view() const { return {geometry, visibleFromSplat, visible}; }
};

struct Result {
    std::vector<float> colors, value, momentum, second;
};

Result onDevice(Case c, const Emulation& order, bool learn = true)
{
    Device device(order);
    Buffer<GaussianGeometry<float>> geometry;
    Buffer<uint32_t> visible;
    Buffer<uint8_t> active;
    Buffer<float> dColors, colors;
    geometry.upload(device, std::span<const GaussianGeometry<float>>(c.geometry)), visible.upload(device, std::span<const uint32_t>(c.visibleFromSplat));
    active.upload(device, std::span<const uint8_t>(c.active)), dColors.upload(device, std::span<const float>(c.dColors));
    colors.reserve(device, c.visible * kColorStride), colors.zero(device);
    TileView tiles{};
    tiles.visibleFromSplat = visible.data(), tiles.visibleCount = uint32_t(c.visible);
    DeviceBigs bigs;
    bigs.upload(device, c.state);
    const DeviceLitView lit = deviceLitView(c.lit);
    bigs.forward(device, c.state, tiles, geometry.data(), lit, colors.data());
    if (learn) bigs.backwardAndStep(device, c.state, tiles, geometry.data(), lit, active.data(), dColors.data());
    bigs.download(device, c.state);
    Result r;
    r.colors.resize(c.visible * kColorStride);
    colors.download(device, std::span(r.colors));
    const BigsParameters& p = c.state.parameters;
    r.value.assign(p.value.begin(), p.value.end()), r.momentum.assign(p.momentum.begin(), p.momentum.end());
    r.second.assign(p.secondMoment.begin(), p.secondMoment.end());
    return r;
}

Result onCpu(Case c)
{
    Result r;
    r.colors.assign(c.visible * kColorStride, 0.0f);
    BigsParameters& p = c.state.parameters;
    AlignedVector<float> terms(p.blocks() * kBigsTermStride * kLanes16);
    BigsLobeGradients lobe, forward;
    bigsForward(p, c.view(), c.lit, c.state.bands, c.state.random, r.colors.data(), terms.data());
    bigsBackwardAndStep(p, c.view(), c.lit, c.state.bands, c.state.random, c.active.data(), c.dColors.data(), terms.data(), c.state.update, lobe, forward);
    const auto share = [&](SharedAdam& adam, const BigsLobeGradients& g, int first, float least, float most) {
        const std::span<const float> steps = adam.step(g.gradient, g.active, c.state.sharedRates);
        for (size_t i = 0; i < p.count; ++i) {
            if (!g.active[i]) continue;
            p.value[p.index(i, first)] = std::clamp(p.value[p.index(i, first)] - steps[4 * i], least, most);
            for (int k = 1; k < 4; ++k) p.value[p.index(i, first + k)] = std::max(0.0f, p.value[p.index(i, first + k)] - steps[4 * i + size_t(k)]);
        }
    };
    if (c.state.bands.lobe) share(c.state.shared, lobe, kLobeSharpness, kMinLogSharpness, kMaxLogSharpness);
    if (c.state.bands.forward) share(c.state.sharedForward, forward, kForward, kMinLogForward, kMaxLogForward);
    r.value.assign(p.value.begin(), p.value.end()), r.momentum.assign(p.momentum.begin(), p.momentum.end());
    r.second.assign(p.secondMoment.begin(), p.secondMoment.end());
    return r;
}

float worst(const std::vector<float>& a, const std::vector<float>& b)
{
    float most = 0;
    REQUIRE(a.size() == b.size());
    for (size_t i = 0; i < a.size(); ++i) most = std::max(most, std::isfinite(a[i] - b[i]) ? std::abs(a[i] - b[i]) : 1e30f);
    return most;
}

bool same(const std::vector<float>& a, const std::vector<float>& b) { return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0; }

} // namespace

TEST_CASE("bigs on the device shades and learns as on the CPU, whatever is in use, in every order of threads")
{
    constexpr Parts kParts[] = {{16, 4, true, true, true, false, true}, {16, 3, true, false, true, true, true},  {0, 1, false, false, false, false, false},
                                {9, 2, false, true, false, false, true}, {25, 1, true, true, true, false, false}, {4, 4, true, true, true, true, false},
                                {1, 2, false, false, true, false, true}};
    for (const Parts& parts : kParts) {
        Case c(90, parts, uint64_t(parts.functions + 100 * parts.lights));
        if (parts.functions == 9 || parts.functions == 0) { // early in a bake: bands, of s none, and a group that rests
            c.state.bands.direct = c.state.bands.indirect = parts.functions == 9 ? 9 : 1, c.state.bands.scatter = parts.functions == 9 ? 4 : 0;
            for (size_t i = 0; i < 90; ++i) {
                const auto clear = [&](int from, int to) {
                    for (int k = from; k < to; ++k) c.state.parameters.value[c.state.parameters.index(i, k)] = 0;
                };
                clear(kTDir + c.state.bands.direct, kTInd), clear(kTInd + 3 * c.state.bands.indirect, kRho);
                clear(kScatter + 3 * bigsPairCount(c.state.bands.scatter), c.state.parameters.coefficients());
            }
            c.state.update.rate[kGroupRho] = 0;
        }
        const Result cpu = onCpu(c), first = onDevice(c, kOrders[0]);
        // Radiance up to 30, summed from up to 1400 products in another order: 1e-6 of it, 30 times over.
        CHECK(worst(cpu.colors, first.colors) < 1e-4f);
        // A step is at most a few times its rate, 6e-2 or less; the exponential of the SIMD kernels is off by 1e-6.
        CHECK(worst(cpu.value, first.value) < 3e-5f);
        CHECK(worst(cpu.momentum, first.momentum) < 1e-6f);
        if (!parts.scatters) CHECK(worst(cpu.second, first.second) < 1e-7f); // a splat without s in a block with it: the CPU goes on for nobody
        for (const Emulation& order : kOrders) {
            const Result again = onDevice(c, order);
            CHECK(same(again.colors, first.colors));
            CHECK(same(again.value, first.value));
            CHECK(same(again.momentum, first.momentum));
            CHECK(same(again.second, first.second));
        }
    }
}

TEST_CASE("bigs on the device leaves splats alone that are not visible or not active")
{
    Case c(50, {16, 2, true, true, true, false, true}, 3);
    std::fill(c.active.begin(), c.active.end(), uint8_t(0));
    const Result r = onDevice(c, kOrders[0]);
    const BigsParameters& p = c.state.parameters;
    CHECK(same(r.value, {p.value.begin(), p.value.end()}));
    CHECK(same(r.momentum, {p.momentum.begin(), p.momentum.end()}));
    CHECK(same(r.second, {p.secondMoment.begin(), p.secondMoment.end()}));
}

TEST_CASE("neighbours learn highlights together on the device as on the CPU")
{
    constexpr size_t kCount = 3000; // three groups of 1024
    for (bool sharing : {true, false})
        for (const Emulation& order : kOrders) {
            Random random(4);
            SharedAdam cpu(sharing), host(sharing);
            Device device(order);
            DeviceSharedAdam adam;
            for (int step = 0; step < 4; ++step) {
                std::vector<float> gradient(kCount * 4);
                std::vector<uint8_t> active(kCount);
                for (float& g : gradient) g = 2 * random.uniform() - 1;
                for (size_t i = 0; i < kCount; ++i) active[i] = i / 16 % 5 != 0 && random.uniform() < 0.5f;
                const SharedAdam::Rates rates{0.06f, 0.05f};
                const auto expected = cpu.step(gradient, active, rates);
                if (step == 0 || step == 2) adam.upload(device, host, kCount); // and once more in between, from what came down
                Buffer<float> g;
                Buffer<uint8_t> on;
                g.upload(device, std::span<const float>(gradient)), on.upload(device, std::span<const uint8_t>(active));
                const auto levels = adam.step(device, g.data(), on.data(), rates);
                float most = 0;
                for (size_t i = 0; i < kCount; ++i) {
                    float delta[4];
                    if (active[i]) levels.step(i, delta);
                    for (size_t k = 0; active[i] && k < 4; ++k) most = std::max(most, std::abs(delta[k] - expected[4 * i + k]));
                }
                CHECK(most < 1e-6f); // sums of up to 1024 gradients in another order
                adam.download(device, host);
            }
        }
}

TEST_CASE("neighbours share indirect light on the device as on the CPU")
{
    for (int functions : {25, 9, 1}) {
        Case c(70, {0, 1, false, false, false, false, false}, 8);
        Random random(2);
        c.state.neighbours.resize(70 * kSplatNeighbours);
        for (uint32_t& n : c.state.neighbours) n = random.below(70);
        c.state.bands.indirect = functions, c.state.shareRate = 0.03f;
        c.state.parameters.value[c.state.parameters.index(5, kTInd)] = -1; // stays as it is
        BigsParameters cpu = c.state.parameters;
        std::vector<float> scratch;
        shareIndirect(cpu, c.state.neighbours, functions, c.state.shareRate, scratch);
        std::vector<float> first;
        for (const Emulation& order : kOrders) {
            Case d = c;
            Device device(order);
            DeviceBigs bigs;
            bigs.upload(device, d.state);
            bigs.shareAmongNeighbours(device, d.state);
            bigs.download(device, d.state);
            const std::vector<float> value(d.state.parameters.value.begin(), d.state.parameters.value.end());
            CHECK(worst(value, {cpu.value.begin(), cpu.value.end()}) < 1e-6f);
            if (first.empty()) first = value;
            CHECK(same(value, first));
        }
        CHECK((functions == 1) == same(first, {c.state.parameters.value.begin(), c.state.parameters.value.end()}));
    }
}
