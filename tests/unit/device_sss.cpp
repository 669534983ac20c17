// sss on a device, emulated: against the scalar reference in float64 and against the model on the CPU.
#include "device/sss.h"

#include "appearance/sss/sss_backward.h"
#include "appearance/sss/sss_network_backward.h"
#include "base/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 5}};

glm::vec3 direction(Random& random)
{
    const float z = 2 * random.uniform() - 1, phi = 6.2831853f * random.uniform();
    return {std::sqrt(1 - z * z) * std::cos(phi), std::sqrt(1 - z * z) * std::sin(phi), z};
}

/// Splats with rows, maps and a network of random numbers, of which a camera sees some in an order of its own, and gradients of their channels.
struct Scene {
    std::unique_ptr<TrainableAppearance> model;
    SssState* state;
    std::vector<GaussianGeometry<float>> geometry;
    std::vector<uint32_t> splatFromVisible, visibleFromSplat;
    std::vector<uint8_t> active;
    LitView lit;
    int stride;
    std::vector<float> dChannels;

    Scene(int lights, std::vector<std::string> without, size_t count = 150) : visibleFromSplat(count, ~0u)
    {
        Random random(uint64_t(31 + lights));
        AppearanceOptions options;
        options.without = std::move(without), options.lightDistancesVary = lights != 3;
        model = makeTrainableAppearance("sss", options);
        model->resize(count);
        state = sssState(*model);
        geometry.resize(count);
        const bool maps = std::find(options.without.begin(), options.without.end(), "visibility") == options.without.end();
        state->visibility.resize(maps ? count * kVisibilityTexels : 0);
        for (uint8_t& texel : state->visibility) texel = uint8_t(random.uniform() < 0.5f ? 255 * random.uniform() : 255);
        for (size_t i = 0; i < count; ++i) {
            for (float& x : geometry[i].position) x = 3 * random.uniform() - 1;
            for (int k = 0; k < kSssRowFloats; ++k)
                state->row[i][size_t(k)] = (k >= kSssRowCode && !state->codeOn ? 0.0f : 4.0f) * (random.uniform() - 0.5f);
            if (random.uniform() < 0.7f) splatFromVisible.push_back(uint32_t(i));
        }
        for (size_t v = splatFromVisible.size(); v > 1; --v)
            std::swap(splatFromVisible[v - 1], splatFromVisible[std::min(v - 1, size_t(random.uniform() * float(v)))]);
        for (size_t v = 0; v < splatFromVisible.size(); ++v) visibleFromSplat[splatFromVisible[v]] = uint32_t(v), active.push_back(random.uniform() < 0.8f);
        for (size_t v = 32; v < std::min<size_t>(64, active.size()); ++v) active[v] = 0; // batches of which none learns
        const float frame[4] = {0.5f, 0.5f, 0.5f, 0.6f};
        std::copy_n(frame, 4, state->frame);
        for (float& w : state->weights.value) w += 0.02f * (random.uniform() - 0.5f);
        state->weights.transpose();
        state->rate = 0.5f, state->correction1 = 0.3f, state->correction2 = 0.05f;
        const glm::vec3 eye = 4.0f * direction(random);
        std::copy_n(&eye.x, 3, lit.eye);
        lit.lightCount = lights;
        for (int l = 0; l < lights; ++l) {
            Light& light = lit.lights[l];
            light.type = l == 1 ? LightType::kDirectional : LightType::kPoint;
            light.position = 5.0f * direction(random), light.directionToLight = direction(random);
            for (int c = 0; c < 3; ++c) light.intensity[c] = 10 * random.uniform();
        }
        stride = channelStride(model->channels(lights));
        dChannels.resize(splatFromVisible.size() * size_t(stride));
        for (float& d : dChannels) d = 1e-3f * (2 * random.uniform() - 1);
    }
    VisibleView view() const { return {geometry, visibleFromSplat, splatFromVisible.size()}; }
    uint32_t visible() const { return uint32_t(splatFromVisible.size()); }
};

struct Stepped {
    std::vector<float> channels;
    SssState state;
    bool operator==(const Stepped& o) const
    {
        const auto same = [](const auto& a, const auto& b) { return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0; };
        return same(channels, o.channels) && same(state.row, o.state.row) && same(state.momentum, o.state.momentum) && same(state.second, o.state.second) &&
               same(state.weights.value, o.state.weights.value) && same(state.networkMomentum, o.state.networkMomentum) &&
               same(state.networkSecond, o.state.networkSecond);
    }
};

/// Forward and a step on the device.
Stepped onDevice(const Scene& scene, const Emulation& order)
{
    Device device(order);
    DeviceSss sss(3, 2); // several batches to a block
    sss.upload(device, *scene.state);
    Buffer<GaussianGeometry<float>> geometry;
    Buffer<uint32_t> splatFromVisible;
    Buffer<uint8_t> active;
    Buffer<float> channels, dChannels;
    geometry.upload(device, std::span<const GaussianGeometry<float>>(scene.geometry));
    splatFromVisible.upload(device, std::span<const uint32_t>(scene.splatFromVisible));
    active.upload(device, std::span<const uint8_t>(scene.active)), dChannels.upload(device, std::span<const float>(scene.dChannels));
    channels.reserve(device, scene.dChannels.size());
    channels.zero(device);
    const DeviceLitView lit = deviceLitView(scene.lit);
    sss.forward(device, geometry.data(), splatFromVisible.data(), scene.visible(), lit, channels.data());
    sss.backwardAndStep(device, geometry.data(), splatFromVisible.data(), scene.visible(), lit, active.data(), dChannels.data());
    Stepped out{std::vector<float>(scene.dChannels.size()), *scene.state};
    channels.download(device, std::span(out.channels));
    sss.download(device, out.state);
    return out;
}

/// The same in float64: channels, gradients of rows and of weights.
struct Exact {
    std::vector<double> channels;
    std::vector<std::array<double, kSssRowFloats>> rows;
    std::vector<double> weights;
};

Exact exactly(const Scene& scene)
{
    const SssState& s = *scene.state;
    const SssStep step = sssStep(s, scene.lit.lightCount);
    const std::vector<double> w(s.weights.value.begin(), s.weights.value.end());
    const double frame[4] = {s.frame[0], s.frame[1], s.frame[2], s.frame[3]};
    Exact out{std::vector<double>(scene.dChannels.size()), std::vector<std::array<double, kSssRowFloats>>(scene.geometry.size()), std::vector<double>(kSssAllWeights)};
    for (size_t v = 0; v < scene.splatFromVisible.size(); ++v) {
        const size_t i = scene.splatFromVisible[v];
        double row[kSssRowFloats], normal[3], p[3], fixed[kSssFixedInputs], first[kSssHidden1], dFirst[kSssHidden1] = {}, eye[3], length = 0;
        std::copy_n(s.row[i].begin(), kSssRowFloats, row), std::copy_n(scene.geometry[i].position, 3, p), std::copy_n(scene.lit.eye, 3, eye);
        for (int k = 0; k < 3; ++k) length += row[kSssRowNormal + k] * row[kSssRowNormal + k];
        for (int k = 0; k < 3; ++k) normal[k] = row[kSssRowNormal + k] / std::sqrt(length);
        const auto raw = [&](int k) { return sssLogistic(row[k]); };
        double* to = &out.channels[v * size_t(scene.stride)];
        const double subsurface = step.residual ? raw(kSssRowScatter) : 0;
        for (int k = 0; k < 3; ++k) to[kSssNormal + k] = normal[k], to[kSssBase + k] = raw(kSssRowBase + k);
        to[kSssRoughness] = raw(kSssRowRough), to[kSssMetalness] = raw(kSssRowMetal), to[kSssSubsurface] = subsurface;
        const LightSample<double> toEye = samplePointLight(eye, 0.0, p);
        to[kSssDepth] = std::sqrt(toEye.distance2);
        sssFixedInputs(p, normal, frame, fixed);
        sssNetworkFixed(w.data(), fixed, first), sssNetworkCode(w.data() + kSssCode, row + kSssRowCode, first);
        const float* d = &scene.dChannels[v * size_t(scene.stride)];
        double dSubsurface = 0;
        for (int l = 0; l < scene.lit.lightCount; ++l) {
            const Light& light = scene.lit.lights[l];
            const double position[3] = {light.position.x, light.position.y, light.position.z};
            LightSample<double> at{{light.directionToLight.x, light.directionToLight.y, light.directionToLight.z}, 1.0};
            if (light.type == LightType::kPoint) at = samplePointLight(position, double(light.radius), p);
            const VisibilityMap map{s.visibility.empty() ? nullptr : &s.visibility[i * kVisibilityTexels]};
            const double visibility = map.texels ? mapVisibility(map, at.dir) : 1.0;
            double in[kSssLightInputs], dIn[kSssLightInputs] = {};
            sssLightInputs(toEye.dir, at.dir, visibility, light.type == LightType::kPoint ? std::sqrt(at.distance2) * frame[3] : -1.0, in);
            if (!s.nearness) in[kSssNearnessInput] = 0;
            const SssActivations<double> a = sssNetworkLight(w.data(), first, in);
            double* own = to + kSssSurfaceChannels + kSssLightChannels * l;
            const float* dOwn = d + kSssSurfaceChannels + kSssLightChannels * l;
            own[kSssIncident] = visibility * (step.share ? a.share : 1);
            double dResidual[3] = {}, dShare = 0;
            if (step.share) dShare = double(dOwn[kSssIncident]) * visibility + double(step.sharePull) * (a.share - 1);
            for (int c = 0; c < 3 && step.residual; ++c) {
                const double irradiance = at.falloff * double(light.intensity[c]);
                own[kSssScattered + c] = subsurface * irradiance * a.residual[c];
                dResidual[c] = double(dOwn[kSssScattered + c]) * irradiance * subsurface;
                dSubsurface += double(dOwn[kSssScattered + c]) * irradiance * a.residual[c];
            }
            if (scene.active[v]) sssNetworkLightBackward(w.data(), first, in, a, dResidual, dShare, out.weights.data(), dFirst, dIn);
        }
        if (!scene.active[v]) continue;
        std::array<double, kSssRowFloats>& g = out.rows[i];
        const auto slope = [&](int k) { return raw(k) * (1 - raw(k)); };
        for (int c = 0; c < 3; ++c) g[size_t(kSssRowBase + c)] = double(d[kSssBase + c]) * slope(kSssRowBase + c);
        g[kSssRowRough] = double(d[kSssRoughness]) * slope(kSssRowRough);
        g[kSssRowMetal] = (double(d[kSssMetalness]) + double(step.metalPull)) * slope(kSssRowMetal);
        if (step.residual) g[kSssRowScatter] = (double(d[kSssSubsurface]) + dSubsurface + double(step.scatterPull)) * slope(kSssRowScatter);
        double along = 0, dFixed[kSssFixedInputs] = {}, dCode[kSssCodeInputs] = {};
        for (int k = 0; k < 3; ++k) along += double(d[kSssNormal + k]) * normal[k];
        for (int k = 0; k < 3; ++k) g[size_t(kSssRowNormal + k)] = double(d[kSssNormal + k]) - along * normal[k];
        sssNetworkFixedBackward(w.data(), fixed, dFirst, out.weights.data(), dFixed);
        sssLayerBackward(w.data() + kSssCode, row + kSssRowCode, kSssCodeInputs, kSssHidden1, dFirst, out.weights.data() + kSssCode, static_cast<double*>(nullptr), dCode);
        for (size_t k = 0; k < kSssCodeInputs; ++k) g[kSssRowCode + k] = step.code ? dCode[k] : 0.0;
    }
    return out;
}

/// The largest difference, in units of the root mean square of `b`.
template <class A, class B>
double difference(const A& a, const B& b)
{
    double most = 0, square = 0;
    for (size_t k = 0; k < b.size(); ++k) {
        const double off = std::abs(double(a[k]) - double(b[k]));
        most = std::isfinite(off) ? std::max(most, off) : 1e30;
        square += double(b[k]) * double(b[k]);
    }
    return square > 0 ? most / std::sqrt(square / double(b.size())) : most;
}

std::vector<float> flat(const std::vector<SssRow>& rows, float scale = 1)
{
    std::vector<float> out;
    for (const SssRow& row : rows)
        for (float x : row) out.push_back(x * scale);
    return out;
}

// Float32 against float64, and sums of hundreds of products in other orders: 64 inputs of a layer, a hundred splats and four lights of a weight. Single
// rounding errors are 6e-8 of a term; the slope of the visibility map, 4 x 16 texels, makes of them 1e-5 of a splat's visibility.
constexpr double kClose = 1e-4;

} // namespace

TEST_CASE("sss on a device: channels and the step are those of float64 and of the CPU, in any order of threads, for any lights and parts")
{
    const std::vector<std::vector<std::string>> parts = {{}, {"residual"}, {"share", "visibility"}, {"residual", "share"}, {"code"}};
    for (int trial = 0; trial < 5; ++trial) {
        const int lights = trial < 4 ? 4 - trial : 2;
        CAPTURE(trial);
        Scene scene(lights, parts[size_t(trial)]);
        const Stepped first = onDevice(scene, kOrders[0]);
        for (const Emulation& order : {kOrders[1], kOrders[2]}) CHECK(onDevice(scene, order) == first);

        const SssState before = *scene.state;
        const Exact exact = exactly(scene);
        CHECK(difference(first.channels, exact.channels) < kClose);
        std::vector<double> gradients;
        for (const auto& row : exact.rows) gradients.insert(gradients.end(), row.begin(), row.end());
        CHECK(difference(flat(first.state.momentum, 1 / (1 - kSssBeta1)), gradients) < kClose);
        std::vector<float> weightGradient = first.state.networkMomentum;
        for (float& x : weightGradient) x /= 1 - kSssBeta1;
        const bool network = sssStep(before, lights).network();
        if (network) CHECK(difference(weightGradient, exact.weights) < kClose);
        else CHECK(first.state.weights.value == before.weights.value);

        // The CPU; what moves where a gradient is all but zero is up to rounding.
        std::vector<float> channels(scene.dChannels.size(), 0.0f);
        scene.model->forward(scene.view(), scene.lit, channels.data());
        scene.model->backwardAndStep(scene.view(), scene.lit, scene.active.data(), scene.dChannels.data());
        CHECK(difference(first.channels, channels) < kClose);
        CHECK(difference(flat(first.state.momentum), flat(scene.state->momentum)) < kClose);
        CHECK(difference(flat(first.state.second), flat(scene.state->second)) < kClose);
        CHECK(difference(first.state.networkMomentum, scene.state->networkMomentum) < kClose);
        size_t moved = 0;
        for (size_t i = 0; i < before.row.size(); ++i)
            for (size_t k = 0; k < kSssRowFloats; ++k) {
                const float now = first.state.row[i][k], gradient = std::abs(first.state.momentum[i][k]);
                moved += now != before.row[i][k];
                if (gradient == 0 || gradient > 1e-6f) CHECK(now == doctest::Approx(scene.state->row[i][k]).epsilon(1e-3));
            }
        CHECK(moved > 300);
        if (network) {
            CHECK(difference(first.state.weights.value, scene.state->weights.value) < 1e-2); // as above
            CHECK(first.state.weights.transposed[kSssSecond + 1] == first.state.weights.value[kSssSecond + kSssHidden1]);
        }
    }
}

TEST_CASE("sss on a device: a view that sees nothing moves no splat, and a second step goes on from the first")
{
    Scene scene(2, {}, 40);
    Device device;
    DeviceSss sss(3, 2);
    sss.upload(device, *scene.state);
    Buffer<GaussianGeometry<float>> geometry;
    geometry.upload(device, std::span<const GaussianGeometry<float>>(scene.geometry));
    const DeviceLitView lit = deviceLitView(scene.lit);
    sss.forward(device, geometry.data(), nullptr, 0, lit, nullptr);
    sss.backwardAndStep(device, geometry.data(), nullptr, 0, lit, nullptr, nullptr);
    SssState after = *scene.state;
    sss.download(device, after);
    CHECK(after.row == scene.state->row);
    CHECK(after.weights.value == scene.state->weights.value);

    // Two steps at once, and with a way over the host between them.
    const Stepped once = onDevice(scene, {});
    Scene again(2, {}, 40);
    *again.state = once.state;
    const Stepped twice = onDevice(again, {});
    Buffer<uint32_t> splatFromVisible;
    Buffer<uint8_t> active;
    Buffer<float> dChannels;
    splatFromVisible.upload(device, std::span<const uint32_t>(scene.splatFromVisible));
    active.upload(device, std::span<const uint8_t>(scene.active)), dChannels.upload(device, std::span<const float>(scene.dChannels));
    sss.upload(device, *scene.state);
    for (int step = 0; step < 2; ++step)
        sss.backwardAndStep(device, geometry.data(), splatFromVisible.data(), scene.visible(), lit, active.data(), dChannels.data());
    sss.download(device, after);
    CHECK(after.row == twice.state.row);
    CHECK(after.weights.value == twice.state.weights.value);
}

TEST_CASE("sss on a device: pixels resolve as on the CPU and as in float64, both ways, in any order of threads")
{
    Random random(77);
    for (int lights : {1, 3, 4}) {
        PixelRays rays{{0.2f, -0.1f, 3}, {-0.5f, 0.4f, -1}, {1.0f / 23, 0, 0.01f}, {0, -0.9f / 17, 0}, 23, 17};
        const size_t pixels = size_t(rays.width) * size_t(rays.height), channels = size_t(DeviceSss::channels(lights));
        LitView lit;
        std::copy_n(rays.eye, 3, lit.eye);
        lit.lightCount = lights;
        for (int l = 0; l < lights; ++l) {
            Light& light = lit.lights[l];
            light.type = l == 2 ? LightType::kDirectional : LightType::kPoint;
            light.position = glm::vec3(0, 0, 2.5f) + direction(random), light.directionToLight = glm::normalize(direction(random) + glm::vec3(0, 0, 1));
            light.radius = l == 1 ? 4.0f : 0.0f; // caps the falloff
            for (int c = 0; c < 3; ++c) light.intensity[c] = 1 + random.uniform();
        }
        std::vector<float> planes((channels + 1) * pixels, 0.0f), dImage(size_t(3 * lights + 1) * pixels);
        for (float& d : dImage) d = 2 * random.uniform() - 1;
        for (size_t i = 0; i < pixels; ++i) {
            if (i % 5 == 0) continue; // nothing there
            const float alpha = i % 7 == 0 ? 5e-4f : 0.2f + 0.8f * random.uniform(); // or hardly anything
            planes[channels * pixels + i] = alpha;
            const glm::vec3 n = glm::normalize(direction(random) + glm::vec3(0, 0, 1.2f));
            for (size_t k = 0; k < channels; ++k)
                planes[k * pixels + i] = alpha * (k < 3 ? n[int(k)] : k == kSssRoughness ? 0.3f + 0.6f * random.uniform() : k == kSssDepth ? 2.5f : random.uniform());
        }

        std::vector<float> image(size_t(3 * lights + 1) * pixels), dPlanes(planes.size()), cpuImage(image.size()), cpuPlanes(planes.size());
        for (const Emulation& order : kOrders) {
            Device device(order);
            DeviceSss sss;
            Buffer<float> in, dIn;
            in.upload(device, std::span<const float>(planes)), dIn.upload(device, std::span<const float>(dImage));
            const DeviceLitView deviceLit = deviceLitView(lit);
            std::vector<float> anImage(image.size()), aGradient(planes.size());
            device.copyOut(anImage.data(), sss.resolve(device, rays, deviceLit, in.data()), anImage.size() * sizeof(float));
            device.copyOut(aGradient.data(), sss.resolveBackward(device, rays, deviceLit, in.data(), dIn.data()), aGradient.size() * sizeof(float));
            if (order.order != ThreadOrder::kForward) CHECK((anImage == image && aGradient == dPlanes));
            image = anImage, dPlanes = aGradient;
        }
        sssResolve(rays, lit, planes.data(), cpuImage.data());
        sssResolveBackward(rays, lit, planes.data(), dImage.data(), cpuPlanes.data());
        CHECK(image == cpuImage); // the same arithmetic
        size_t differ = 0;
        for (size_t i = 0; i < pixels; ++i)
            for (size_t k = 0; k <= channels; ++k) {
                // Pixels without alpha stand among others in the CPU's groups of four: they hand their gradient on, to nobody.
                if (planes[channels * pixels + i] > 0) differ += dPlanes[k * pixels + i] != cpuPlanes[k * pixels + i];
                else if (k < channels) CHECK(dPlanes[k * pixels + i] == 0);
            }
        CHECK(differ == 0);

        std::vector<double> exact(image.size()), dExact(planes.size());
        double eye[3];
        std::copy_n(rays.eye, 3, eye);
        for (size_t i = 0; i < pixels; ++i) {
            std::vector<double> g(channels), d(channels);
            for (size_t k = 0; k < channels; ++k) g[k] = planes[k * pixels + i];
            const double alpha = planes[channels * pixels + i];
            exact[size_t(3 * lights) * pixels + i] = alpha, dExact[channels * pixels + i] = dImage[size_t(3 * lights) * pixels + i];
            if (!(alpha > 0)) continue;
            double ray[3], dAlpha;
            sssPixelRay(rays, double(i % size_t(rays.width)) + 0.5, float(i / size_t(rays.width)) + 0.5f, ray);
            const SssPixel<double> pixel = sssPixel(g.data(), alpha, eye, ray);
            SssPixelGradient<double> gradient;
            for (size_t l = 0; l < size_t(lights); ++l) {
                const Light& light = lit.lights[l];
                const double position[3] = {light.position.x, light.position.y, light.position.z}, radius = std::max(light.radius, kMinLightRadius);
                const double intensity[3] = {light.intensity.x, light.intensity.y, light.intensity.z};
                LightSample<double> to{{light.directionToLight.x, light.directionToLight.y, light.directionToLight.z}, 1.0};
                if (light.type == LightType::kPoint) to = samplePointLight(position, radius, pixel.point);
                const SssReflection<double> o = sssReflect(pixel.surface, pixel.wo, to.dir);
                const size_t own = kSssSurfaceChannels + kSssLightChannels * l;
                double dPixel[3];
                for (size_t c = 0; c < 3; ++c) {
                    exact[(3 * l + c) * pixels + i] = sssRadiance(&g[own], intensity[c] * to.falloff, o.value[c], int(c));
                    dPixel[c] = dImage[(3 * l + c) * pixels + i];
                }
                sssPixelLightBackward(pixel, &g[own], to, radius, intensity, o, dPixel, &d[own], gradient);
            }
            sssPixelBackward(pixel, g.data(), ray, gradient, d.data(), &dAlpha);
            for (size_t k = 0; k < channels; ++k) dExact[k * pixels + i] = d[k];
            dExact[channels * pixels + i] += dAlpha;
        }
        CHECK(difference(image, exact) < 1e-4);    // float32; highlights of roughness 0.3 multiply errors of directions by up to 1 / 0.3^4
        CHECK(difference(dPlanes, dExact) < 1e-3); // and their gradients once more
    }
}
