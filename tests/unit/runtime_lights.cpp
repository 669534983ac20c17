// Every kind of light as the runtime draws it, both models: against scalar references that know no points, and against one another.
#include "runtime_fixture.h"

#include "light_check.h"
#include "light_set.h"

#include "appearance/sss/sss.h"
#include "base/fibonacci_sphere.h"

#include <functional>
#include <numbers>

using namespace nacre;
using namespace nacre::test;

namespace {

/// What a place sees of a light.
struct Seen {
    glm::dvec3 direction{0, 0, 1}, irradiance{0};
    double widening = 0, distance = -1; // -1: so far away that it does not matter
};
using Emitter = std::function<Seen(const glm::dvec3&)>;

glm::dvec3 vec(const float v[3]) { return {v[0], v[1], v[2]}; }

void store(float out[3], const glm::dvec3& v)
{
    for (int c = 0; c < 3; ++c) out[c] = float(v[c]);
}

/// I / r^2, in the window of KHR_lights_punctual, times `shines` of the cosine between axis and way.
Emitter emitterAt(const glm::dvec3& position, const glm::dvec3& intensity, double range, double cap, const glm::dvec3& axis, std::function<double(double)> shines)
{
    return [=](const glm::dvec3& p) {
        const glm::dvec3 to = position - p;
        const double r = glm::length(to), window = range > 0 ? std::clamp(1 - std::pow(r / range, 4), 0.0, 1.0) : 1.0;
        return Seen{to / r, intensity * window * shines(-glm::dot(axis, to) / r) / std::max(r * r, cap * cap), 0, r};
    };
}

double always(double) { return 1; }
double lambert(double cosine) { return std::max(cosine, 0.0); }

/// By definition, area lights by brute force.
std::vector<Emitter> emittersOf(const NacreLight& l)
{
    const glm::dvec3 position = vec(l.position), direction = vec(l.direction), intensity = vec(l.intensity);
    const double range = l.range;
    switch (l.type) {
    case NACRE_LIGHT_POINT: return {emitterAt(position, intensity, range, l.radius, {}, always)};
    case NACRE_LIGHT_DIRECTIONAL: return {[=](const glm::dvec3&) { return Seen{direction, intensity, 0.25 * double(l.radius) * l.radius, -1}; }};
    case NACRE_LIGHT_SPOT: {
        const double outer = std::cos(double(l.outerCone)), inner = std::cos(double(l.innerCone));
        return {emitterAt(position, intensity, range, l.radius, direction, [=](double c) { return std::pow(std::clamp((c - outer) / (inner - outer), 0.0, 1.0), 2); })};
    }
    case NACRE_LIGHT_SPHERE: { // a surface that shines with the cosine; half of it is seen, and gives I / r^2. The window counts from points inside
        std::vector<Emitter> points;
        constexpr int n = 600;
        for (int i = 0; i < n; ++i) {
            const glm::dvec3 d = fibonacciDirection(i, n);
            if (range > 0) points.push_back(emitterAt(position + std::sqrt(0.75) * double(l.radius) * d, intensity / double(n), range, 0, {}, always));
            else points.push_back(emitterAt(position + double(l.radius) * d, intensity * (4.0 / n), 0, 0, d, lambert));
        }
        return points;
    }
    case NACRE_LIGHT_RECTANGLE: {
        std::vector<Emitter> points;
        const glm::dvec3 width = vec(l.halfWidth), height = double(l.halfHeight) * glm::normalize(glm::cross(direction, width));
        constexpr int n = 18;
        for (int y = 0; y < n; ++y)
            for (int x = 0; x < n; ++x)
                points.push_back(emitterAt(position + ((2 * x + 1.0) / n - 1) * width + ((2 * y + 1.0) / n - 1) * height, intensity * (1.0 / (n * n)), range, 0, direction, lambert));
        return points;
    }
    }
    return {};
}

/// Channels of a splat that are blended; bigs: its radiance.
std::vector<double> channelsOf(const SplatAsset& asset, size_t g, const glm::dvec3& eye, std::span<const Emitter> emitters)
{
    const glm::dvec3 p = asset.cloud.positions[g], out = glm::normalize(eye - p);
    std::vector<double> channels;
    if (asset.model == "bigs") {
        channels.resize(3);
        for (const Emitter& emitter : emitters) {
            const Seen s = emitter(p);
            const glm::dvec3 unit = bigsRadiance(asset, g, out, s.direction, s.widening);
            for (int c = 0; c < 3; ++c) channels[size_t(c)] += s.irradiance[c] * unit[c];
        }
        return channels;
    }
    const SssChannels of(asset);
    const SssMaterial m = of.material(g);
    const size_t scattered = kSssSurfaceChannels, shares = scattered + 3;
    channels.resize(shares + emitters.size());
    for (int c = 0; c < 3; ++c) channels[size_t(kSssNormal + c)] = m.normal[c], channels[size_t(kSssBase + c)] = m.base[c];
    channels[kSssRoughness] = m.roughness, channels[kSssMetalness] = m.metalness, channels[kSssSubsurface] = m.subsurface;
    channels[kSssDepth] = glm::distance(p, eye);
    float first[kSssHidden1];
    if (of.network()) of.firstLayer(g, first);
    for (size_t t = 0; t < emitters.size(); ++t) {
        const Seen s = emitters[t](p);
        const VisibilityMap map = of.visibility(g);
        const double visible = map.texels ? mapVisibility(map, &s.direction.x) : 1.0;
        channels[shares + t] = visible;
        if (!of.network()) continue;
        const float wo[3] = {float(out.x), float(out.y), float(out.z)}, wi[3] = {float(s.direction.x), float(s.direction.y), float(s.direction.z)};
        float in[kSssLightInputs];
        sssLightInputs(wo, wi, float(visible), float(s.distance) * of.network()[kSssFrame + 3], in);
        const SssActivations<float> a = sssNetworkLight(of.network(), first, in);
        channels[shares + t] *= a.share;
        for (int c = 0; c < 3; ++c) channels[scattered + size_t(c)] += m.subsurface * m.residual[c] * s.irradiance[c] * a.residual[c];
    }
    return channels;
}

glm::dvec3 resolve(const SplatAsset& asset, const double* blended, double alpha, const glm::dvec3& eye, const glm::dvec3& ray, std::span<const Emitter> emitters)
{
    glm::dvec3 rgb(0);
    if (asset.model == "bigs") return {blended[0], blended[1], blended[2]};
    for (int c = 0; c < 3; ++c) rgb[c] = blended[kSssSurfaceChannels + c];
    if (!(alpha > 0)) return rgb;
    const SssPixel<double> pixel = sssPixel(blended, alpha, &eye.x, &ray.x);
    for (size_t t = 0; pixel.inverseLength > 0 && t < emitters.size(); ++t) {
        const Seen s = emitters[t]({pixel.point[0], pixel.point[1], pixel.point[2]});
        const SssReflection<double> o = sssReflect(pixel.surface, pixel.wo, &s.direction.x, s.widening);
        const double own[kSssLightChannels] = {blended[size_t(kSssSurfaceChannels) + 3 + t], 0, 0, 0};
        for (int c = 0; c < 3; ++c) rgb[c] += sssRadiance(own, s.irradiance[c], o.value[c], c);
    }
    return rgb;
}

Image reference(const SplatAsset& asset, const Camera& camera, std::span<const Emitter> emitters)
{
    return blendedImage(
        asset, camera, [&](size_t g) { return channelsOf(asset, g, camera.position(), emitters); },
        [&](const double* blended, double alpha, const glm::dvec3& ray) { return resolve(asset, blended, alpha, camera.position(), ray, emitters); });
}

NacreLight lightOf(NacreLightType type, const glm::dvec3& position, double distance)
{
    NacreLight l{};
    l.structSize = sizeof l;
    l.type = type;
    store(l.position, type == NACRE_LIGHT_DIRECTIONAL ? glm::dvec3(0) : position);
    store(l.direction, glm::normalize(type == NACRE_LIGHT_DIRECTIONAL ? position : -position + glm::dvec3(0.1, 0.05, -0.1)));
    store(l.intensity, (type == NACRE_LIGHT_DIRECTIONAL ? 1 : distance * distance) * glm::dvec3(1, 0.8, 0.6));
    return l;
}

/// One of each kind, around a ball of radius 0.5. The area lights are 0.6 wide, and as near as 1.5 times that.
std::vector<NacreLight> everyKind()
{
    const glm::dvec3 towards = glm::normalize(glm::dvec3(0.5, 0.6, 0.7));
    std::vector<NacreLight> lights;
    for (const NacreLightType type : {NACRE_LIGHT_POINT, NACRE_LIGHT_DIRECTIONAL, NACRE_LIGHT_SPOT, NACRE_LIGHT_SPHERE, NACRE_LIGHT_RECTANGLE})
        for (const double range : {0.0, 1.7}) {
            if (type == NACRE_LIGHT_DIRECTIONAL && range > 0) continue;
            NacreLight l = lightOf(type, 1.4 * towards, 1.2);
            l.range = float(range);
            l.innerCone = 0.1f, l.outerCone = 0.4f; // its edge falls onto the ball
            l.radius = type == NACRE_LIGHT_SPHERE ? 0.3f : type == NACRE_LIGHT_DIRECTIONAL ? 0.05f : 0.0f;
            store(l.halfWidth, 0.3 * glm::normalize(glm::cross(vec(l.direction), glm::dvec3(0, 1, 0.2))));
            l.halfHeight = 0.2f;
            lights.push_back(l);
        }
    return lights;
}

/// Splats with maps that let light through from a side, not at random: a random texel of a map would ask an area light for its shape.
void smoothMaps(SplatAsset& asset)
{
    for (Channel& c : asset.channels) {
        if (c.name != "visibility") continue;
        const int n = c.components == 256 ? 16 : 32;
        for (size_t g = 0; g < asset.cloud.count; ++g)
            for (int k = 0; k < n * n; ++k) {
                const double u = (k % n + 0.5) / n * 2 - 1, v = (k / n + 0.5) / n * 2 - 1, z = 1 - std::abs(u) - std::abs(v);
                const glm::dvec3 d = glm::normalize(z >= 0 ? glm::dvec3(u, v, z) : glm::dvec3((1 - std::abs(v)) * (u < 0 ? -1 : 1), (1 - std::abs(u)) * (v < 0 ? -1 : 1), z));
                c.bytes[g * size_t(n * n) + size_t(k)] = uint8_t(255 * std::clamp(0.5 + 4 * glm::dot(d, glm::dvec3(asset.cloud.positions[g])), 0.0, 1.0));
            }
    }
}

std::vector<SplatAsset> bothModels(size_t count)
{
    std::vector<SplatAsset> assets = {withSharp(randomAsset(count, 9, 3), kAllSharp, 4, 100), randomSss(count, kAllSss, 5)};
    for (SplatAsset& a : assets) smoothMaps(a);
    return assets;
}

void setLights(Host& host, std::span<const NacreLight> lights)
{
    REQUIRE_MESSAGE(nacreContextSetLights(host.context, lights.data(), lights.size()) == NACRE_OK, host.lastMessage());
}

void setEnvironment(Host& host, const NacreEnvironment* e)
{
    REQUIRE_MESSAGE(nacreContextSetEnvironment(host.context, e) == NACRE_OK, host.lastMessage());
}

Image sumOf(const Image& a, const Image& b)
{
    Image sum = a;
    for (size_t i = 0; i < sum.rgba.size(); ++i)
        if (i % 4 != 3) sum.rgba[i] += b.rgba[i];
    return sum;
}

struct SmallMap {
    std::vector<float> pixels;
    NacreEnvironment description{};

    SmallMap()
    {
        constexpr int w = 32, h = 16;
        std::mt19937 rng(1);
        for (int i = 0; i < w * h; ++i) {
            const float bright = i % 37 == 5 ? 8.0f : 0.15f, r = float(rng() >> 8) * 0x1p-24f;
            pixels.insert(pixels.end(), {bright * r, bright * 0.7f, bright * (1 - 0.5f * r)});
        }
        description.structSize = sizeof description;
        description.width = w, description.height = h, description.pixels = pixels.data();
    }
};

} // namespace

TEST_CASE("lights of every kind, alone: what GL draws is what their definitions say, area lights by brute force")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels(300)) {
        Host host(asset);
        for (const NacreLight& l : everyKind()) {
            CAPTURE(asset.model);
            CAPTURE(l.type);
            CAPTURE(l.range);
            setLights(host, {&l, 1});
            const Image expected = reference(asset, offCentre(), emittersOf(l)), drawn = host.draw(offCentre());
            CHECK(largest(expected) > 0.1f);
            const bool area = l.type == NACRE_LIGHT_SPHERE || l.type == NACRE_LIGHT_RECTANGLE;
            CHECK(psnr(drawn, expected) >= (area ? 45.0 : 50.0)); // the G-buffer is blended in half floats: 2^-11 a layer
        }
    }
}

TEST_CASE("environments of pixels and of coefficients, and ambient light: what GL draws is what the scalar code draws of their directions")
{
    if (!haveGl()) return;
    SmallMap map;
    std::vector<float> sh = {2.0f, 1.5f, 1.0f, 0.3f, 0.5f, 0.6f, -0.5f, 0.2f, 0.4f, 0.1f, -0.3f, 0.2f};
    NacreEnvironment series{}, ambient{};
    series.structSize = ambient.structSize = sizeof series;
    series.sh = ambient.sh = sh.data(), series.shCount = 4, ambient.shCount = 1;
    const glm::dmat3 turn(glm::rotate(glm::dmat4(1), 0.7, glm::normalize(glm::dvec3(1, 2, 3))));
    for (int c = 0; c < 3; ++c) store(series.worldFromMap + 3 * c, turn[c]);
    for (const SplatAsset& asset : bothModels(300)) {
        Host host(asset);
        for (NacreEnvironment e : {map.description, series, ambient}) {
            CAPTURE(asset.model);
            CAPTURE(e.shCount);
            e.intensity = 0.25f;
            setEnvironment(host, &e);
            LightSet set;
            set.setEnvironment(&e);
            CHECK(set.points().size() == 64);
            std::vector<Emitter> emitters;
            for (const LightPoint& p : set.points())
                emitters.push_back([&p](const glm::dvec3&) { return Seen{p.direction, p.intensity, 0.25 * double(p.sourceRadius) * p.sourceRadius, -1}; });
            const Image expected = reference(asset, offCentre(), emitters), drawn = host.draw(offCentre());
            CHECK(largest(expected) > 0.1f);
            CHECK(psnr(drawn, expected) >= 50.0);
            // and of many more of them
            e.directions = 512;
            setEnvironment(host, &e);
            CHECK(psnr(drawn, host.draw(offCentre())) >= 45.0);
        }
        setEnvironment(host, nullptr);
        CHECK(largest(host.draw(offCentre())) <= 1.0f); // coverage
        CHECK(host.stats().lightsUsed == 0);
    }
}

TEST_CASE("light adds up: of two sets of lights together, environment and area lights among them, what each of them gives")
{
    if (!haveGl()) return;
    SmallMap map;
    map.description.intensity = 0.1f;
    std::vector<NacreLight> lights = everyKind();
    for (NacreLight& l : lights)
        for (float& i : l.intensity) i *= 0.2f;
    for (const SplatAsset& asset : bothModels(200)) {
        CAPTURE(asset.model);
        Host host(asset);
        for (const size_t cut : {size_t(1), size_t(4), lights.size()}) {
            const std::span<const NacreLight> all(lights);
            setLights(host, all);
            setEnvironment(host, &map.description);
            const Image both = host.draw(offCentre());
            setEnvironment(host, nullptr);
            setLights(host, all.first(cut));
            const Image first = host.draw(offCentre());
            setLights(host, all.subspan(cut));
            setEnvironment(host, &map.description);
            CHECK(psnr(both, sumOf(first, host.draw(offCentre()))) >= 60.0);
        }
    }
}

TEST_CASE("hundreds of lights of all kinds are the sum of their halves")
{
    if (!haveGl()) return;
    std::vector<NacreLight> lights;
    for (int i = 0; i < 330; ++i) {
        const glm::dvec3 at = 1.6 * fibonacciDirection(i, 330);
        NacreLight l = lightOf(NacreLightType(i % 3), at, 0.08);
        if (l.type == NACRE_LIGHT_DIRECTIONAL)
            for (float& v : l.intensity) v *= 0.006f;
        l.innerCone = 0.2f, l.outerCone = 0.6f;
        lights.push_back(l);
    }
    for (const SplatAsset& asset : bothModels(150)) {
        CAPTURE(asset.model);
        Host host(asset);
        const std::span<const NacreLight> all(lights);
        setLights(host, all);
        const Image both = host.draw(offCentre());
        CHECK(host.stats().lightsUsed == 330);
        CHECK(largest(both) > 0.1f);
        setLights(host, all.first(170));
        const Image first = host.draw(offCentre());
        setLights(host, all.subspan(170));
        CHECK(psnr(both, sumOf(first, host.draw(offCentre()))) >= 60.0);
    }
}

TEST_CASE("an instance that is turned, scaled and mirrored sees lights of every kind as one that was made so")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels(200)) {
        Host host(asset);
        for (const double mirror : {1.0, -1.0}) {
            constexpr double scale = 2.5;
            const glm::dmat4 worldFromAsset = glm::scale(glm::rotate(glm::translate(glm::dmat4(1), {3, -2, 5}), 0.8, glm::normalize(glm::dvec3(1, 2, -1))),
                                                         scale * glm::dvec3(mirror, 1, 1));
            for (const NacreLight& l : everyKind()) {
                CAPTURE(asset.model);
                CAPTURE(l.type);
                CAPTURE(mirror);
                host.moveTo(glm::dmat4(1));
                setLights(host, {&l, 1});
                const Image expected = host.draw(offCentre());
                NacreLight moved = l; // the same light in the world where all is `scale` times as large
                const glm::dmat3 turn = glm::dmat3(worldFromAsset) / scale;
                const bool far = l.type == NACRE_LIGHT_DIRECTIONAL;
                store(moved.position, worldFromAsset * glm::dvec4(vec(l.position), 1));
                store(moved.direction, turn * vec(l.direction));
                store(moved.intensity, vec(l.intensity) * (far ? 1 : scale * scale));
                store(moved.halfWidth, turn * vec(l.halfWidth) * scale);
                moved.halfHeight *= float(scale), moved.range *= float(scale), moved.radius *= far ? 1.0f : float(scale);
                setLights(host, {&moved, 1});
                host.moveTo(worldFromAsset);
                NacreDrawDesc desc = describe(offCentre());
                copy(desc.viewFromWorld, glm::inverse(offCentre().worldFromCamera) * glm::inverse(worldFromAsset));
                CHECK(psnr(host.draw(desc), expected) >= 60.0);
            }
        }
    }
}

TEST_CASE("what stays the same is not evaluated again: an environment beside a lamp that moves, lights that are set again")
{
    if (!haveGl()) return;
    SmallMap map;
    std::vector<NacreLight> lights = everyKind();
    for (const SplatAsset& asset : bothModels(200)) {
        CAPTURE(asset.model);
        Host host(asset), fresh(asset);
        setEnvironment(host, &map.description);
        setLights(host, lights);
        host.draw(offCentre());
        const NacreDrawStats all = host.stats();
        CHECK(all.lightsUsed > 64);
        for (int i = 0; i < 3; ++i) host.draw(offCentre());
        setEnvironment(host, &map.description);
        setLights(host, lights);
        host.draw(offCentre());
        CHECK(host.stats().lightPassesRun == 0);
        CHECK(host.stats().relightSplats == 0);
        CHECK(host.stats().lightsUsed == all.lightsUsed);

        lights[0].position[0] += 0.1f; // a point light: one slot, and so one group of four
        setLights(host, lights);
        const Image moved = host.draw(offCentre());
        CHECK(host.stats().lightPassesRun == 1);
        CHECK(host.stats().relightSplats <= all.relightSplats / 10);
        setEnvironment(fresh, &map.description);
        setLights(fresh, lights);
        CHECK(psnr(moved, fresh.draw(offCentre())) >= 60.0);
        setLights(host, {});
        setEnvironment(host, nullptr);
    }
}

TEST_CASE("lights that reach nothing are skipped and told")
{
    if (!haveGl()) return;
    std::vector<NacreLight> lights = {lightOf(NACRE_LIGHT_POINT, {1, 1, 1}, 1), lightOf(NACRE_LIGHT_POINT, {9, 0, 0}, 1), lightOf(NACRE_LIGHT_SPOT, {0, 0, 3}, 1),
                                      lightOf(NACRE_LIGHT_POINT, {1, 0, 1}, 1), lightOf(NACRE_LIGHT_POINT, {0, 1, 1}, 1), lightOf(NACRE_LIGHT_POINT, {1e4, 0, 0}, 1)};
    lights[1].range = 8;                                                          // out of range
    lights[2].direction[0] = 0, lights[2].direction[1] = 0, lights[2].direction[2] = 1, lights[2].innerCone = 0.1f, lights[2].outerCone = 0.3f; // away
    lights[3].mask = 2;                                                           // not for this one
    std::fill_n(lights[4].intensity, 3, 0.0f);                                    // none
    for (const SplatAsset& asset : bothModels(100)) {
        CAPTURE(asset.model);
        Host host(asset), alone(asset);
        REQUIRE(nacreInstanceSetMasks(host.instance, 1, 1) == NACRE_OK);
        setLights(host, lights);
        const Image drawn = host.draw(offCentre());
        CHECK(host.stats().lightsUsed == 1);
        CHECK(host.stats().lightsSkipped == 5);
        setLights(alone, {lights.data(), 1});
        CHECK(largestDifference(drawn, alone.draw(offCentre())) == 0.0f);
    }
}
