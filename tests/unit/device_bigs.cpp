// bigs and the geometry's step on the device, emulated in three orders of threads, against the CPU's kernels, which train_bigs.cpp and train_geometry.cpp
// hold against float64.
#include "device/bigs.h"
#include "device/geometry.h"

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
        const Case c(90, parts, uint64_t(parts.functions + 100 * parts.lights));
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

TEST_CASE("the geometry's step and that of the surroundings' light are the CPU's on the device")
{
    constexpr size_t kCount = 300;
    Random random(6);
    const auto u = [&] { return 2 * random.uniform() - 1; };
    SplatGeometry cpu;
    cpu.resize(kCount);
    std::vector<uint32_t> splats;
    std::vector<ScreenGradient<float>> dSplats;
    std::vector<uint8_t> active;
    std::vector<float> dDistance, dColors;
    std::vector<AmbientRow> ambient(kCount);
    for (size_t i = 0; i < kCount; ++i) {
        for (int k = 0; k < 3; ++k) cpu.raw[i][size_t(k)] = u(), cpu.raw[i][size_t(3 + k)] = -3 + u(), ambient[i].value[size_t(k)] = -4 + u();
        for (size_t k = 6; k < 10; ++k) cpu.raw[i][k] = i % 40 == 0 ? 0.0f : u();
        cpu.raw[i][10] = 5 * u();
        cpu.activate(i);
        if (i % 4 == 3) continue;
        splats.push_back(uint32_t(i)), active.push_back(i % 3 != 0), dDistance.push_back(u());
        ScreenGradient<float> d{};
        for (float* x : {&d.mean[0], &d.mean[1], &d.conic[0], &d.conic[1], &d.conic[2], &d.opacity}) *x = u();
        if (i % 50 == 1) d.opacity = NAN; // sits out
        dSplats.push_back(d);
    }
    const size_t stride = channelStride(6);
    dColors.resize(splats.size() * stride);
    for (float& d : dColors) d = u();
    for (size_t v = 0; v < splats.size(); ++v) dColors[v * stride + 5] = dDistance[v];
    Camera camera;
    camera.width = 64, camera.height = 48, camera.fx = camera.fy = 80, camera.cx = 32, camera.cy = 24;
    camera.worldFromCamera = glm::dmat4(1);
    camera.worldFromCamera[3] = glm::dvec4(0, 0, 4, 1);
    const View<float> view = makeView<float>(camera, 0.1f);
    const GeometryRates rates{0.01f, 0.02f, 0.03f, 0.04f};
    const SplatGeometry before = cpu;
    std::vector<AmbientRow> ambientCpu = ambient;
    stepGeometry(cpu, view, splats, dSplats.data(), dDistance.data(), active.data(), rates, 3, 1e-3f);
    std::vector<float> colorsCpu(splats.size() * stride, 0.5f);
    for (size_t v = 0; v < splats.size(); ++v)
        for (size_t c = 0; c < 3; ++c) {
            for (size_t l = 0; l < 2; ++l) colorsCpu[v * stride + 3 * l + c] += std::exp(ambient[splats[v]].value[c]);
            if (active[v]) stepAmbientChannel(ambientCpu[splats[v]], c, dColors[v * stride + c] + dColors[v * stride + 3 + c], 0.02f);
        }

    for (const Emulation& order : kOrders) {
        Device device(order);
        const auto up = [&](auto& buffer, const auto& values) { buffer.upload(device, std::span(values.data(), values.size())); };
        Buffer<GeometryRow> raw, momentum, second;
        Buffer<GaussianGeometry<float>> activated;
        Buffer<uint32_t> fromVisible;
        Buffer<ScreenGradient<float>> d;
        Buffer<uint8_t> on;
        Buffer<float> colors, gradients;
        Buffer<AmbientRow> rows;
        up(raw, before.raw), up(momentum, before.momentum), up(second, before.second), up(activated, before.activated), up(fromVisible, splats), up(d, dSplats);
        up(on, active), up(gradients, dColors), up(rows, ambient), up(colors, std::vector<float>(splats.size() * stride, 0.5f));
        TileView tiles{};
        tiles.splatFromVisible = fromVisible.data(), tiles.visibleCount = uint32_t(splats.size());
        stepGeometry(device, {raw.data(), momentum.data(), second.data(), activated.data()}, view, tiles, d.data(), gradients.data(), int(stride), 5, on.data(),
                     GeometryAdam(rates, 3), 1e-3f);
        addAmbient(device, tiles, rows.data(), 2, colors.data());
        stepAmbient(device, tiles, gradients.data(), 2, on.data(), 0.02f, rows.data());
        float most = 0, mostAmbient = 0, mostColor = 0;
        for (size_t i = 0; i < kCount; ++i) {
            for (size_t k = 0; k < kGeometryParameters; ++k) most = std::max(most, std::abs(raw.data()[i][k] - cpu.raw[i][k]));
            most = std::max(most, std::abs(activated.data()[i].opacity - cpu.activated[i].opacity));
            for (size_t c = 0; c < 3; ++c) mostAmbient = std::max(mostAmbient, std::abs(rows.data()[i].value[c] - ambientCpu[i].value[c]));
        }
        for (size_t k = 0; k < colorsCpu.size(); ++k) mostColor = std::max(mostColor, std::abs(colors.data()[k] - colorsCpu[k]));
        CHECK(most < 1e-6f); // the CPU's exponential
        CHECK(mostAmbient == 0);
        CHECK(mostColor < 1e-6f);
    }
}
