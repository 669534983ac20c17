// What the runtime tests share: a host with a headless context that speaks only the public C API, asset makers, and a float64
// reference image made from the scalar headers.
#pragma once

#include "appearance/bigs/bigs.h"
#include "appearance/sss/sss_asset.h"
#include "asset/asset_io.h"
#include "eval/headless_gl.h"
#include "eval/splat_renderer.h"
#include "render/projection.h"
#include "render/reference_raster.h"

#include "nacre/nacre.h"

#include <doctest/doctest.h>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/type_ptr.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numeric>
#include <random>

namespace nacre::test {

/// False, with a line that says SKIPPED and why, where no such OpenGL context can be made.
inline bool haveGl(HeadlessKind kind = HeadlessKind::kEgl)
{
    static std::map<HeadlessKind, std::string> known;
    if (!known.contains(kind)) {
        const auto gl = HeadlessGl::create(kind);
        known[kind] = gl ? std::string() : gl.error().message;
    }
    if (!known[kind].empty()) MESSAGE("SKIPPED: ", known[kind]);
    return known[kind].empty();
}

inline Camera lookAt(glm::dvec3 eye, glm::dvec3 target, int width, int height, double focal)
{
    Camera c;
    c.width = width, c.height = height;
    c.fx = focal, c.fy = focal;
    c.cx = 0.5 * width, c.cy = 0.5 * height;
    c.worldFromCamera = glm::inverse(glm::lookAt(eye, target, glm::dvec3(0, 1, 0)));
    return c;
}

inline Light pointLight(glm::vec3 position, glm::vec3 intensity, float radius = 0)
{
    Light light;
    light.position = position, light.intensity = intensity, light.radius = radius;
    return light;
}

/// Nothing symmetric: a flip or a swap shows.
inline Camera offCentre()
{
    Camera c = lookAt({0.9, 0.7, 1.6}, {0, 0, 0}, 72, 56, 80);
    c.cx += 5.3, c.cy -= 3.7, c.fy = 90;
    return c;
}

inline Light directionalLight(glm::vec3 towards, glm::vec3 irradiance, float angularRadius = 0)
{
    Light light;
    light.type = LightType::kDirectional;
    light.directionToLight = glm::normalize(towards), light.intensity = irradiance, light.radius = angularRadius;
    return light;
}

/// `count` splats in a ball of radius 0.5 with random transport. Coefficients are multiples of 2^-10 below 1, so half floats hold them
/// exactly and comparisons with the reference need no allowance for storage.
inline SplatAsset randomAsset(size_t count, int sFunctions, uint32_t seed, float splatScale = 0.05f)
{
    std::mt19937 rng(seed);
    const auto uniform = [&](float lo, float hi) { return lo + (hi - lo) * float(rng() >> 8) * 0x1p-24f; };
    const auto onGrid = [&](float size) { return std::round(1024.0f * uniform(-size, size)) / 1024.0f; };
    SplatAsset a;
    a.model = "bigs";
    a.cloud.count = count;
    std::vector<float> tDir, tInd, rho, s;
    for (size_t g = 0; g < count; ++g) {
        glm::vec3 p;
        do p = {uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)};
        while (glm::dot(p, p) > 1);
        a.cloud.positions.push_back(0.5f * p);
        a.cloud.rotations.push_back(glm::normalize(glm::quat(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(0.1f, 1))));
        a.cloud.scales.push_back(splatScale * glm::vec3(uniform(0.2f, 1), uniform(0.2f, 1), uniform(0.2f, 1)));
        a.cloud.opacities.push_back(uniform(0.05f, 1));
        for (int i = 0; i < 25; ++i) tDir.push_back(i == 0 ? 0.75f + onGrid(0.2f) : onGrid(0.3f));
        for (int i = 0; i < 75; ++i) tInd.push_back(onGrid(0.1f));
        for (int i = 0; i < 3; ++i) rho.push_back(uniform(0, 1));
        for (int i = 0; i < 3 * bigsPairCount(sFunctions); ++i) s.push_back(onGrid(0.1f));
    }
    a.channels = {{"tDir", 25, tDir, {}}, {"tInd", 75, tInd, {}}, {"rho", 3, rho, {}}};
    if (sFunctions) a.channels.push_back({"s", uint32_t(3 * bigsPairCount(sFunctions)), s, {}});
    return a;
}

enum SharpChannels { kLobe = 1, kVisibility = 2, kShadow = 4, kForward = 8, kAllSharp = 15 };

/// Adds the channels of `which`: random normals and colours, sharpness from 0.1 to `sharpest`, random maps and depths of shadow.
inline SplatAsset withSharp(SplatAsset asset, int which, uint32_t seed, float sharpest = 1000)
{
    std::mt19937 rng(seed);
    const auto uniform = [&](float lo, float hi) { return lo + (hi - lo) * float(rng() >> 8) * 0x1p-24f; };
    Channel lobe{"lobe", kBigsLobeFloats, {}, {}}, visibility{"visibility", seed % 2 ? 256u : 1024u, {}, {}}, shadow{"shadow", 1, {}, {}}, forward{"forward", kBigsForwardFloats, {}, {}};
    for (size_t g = 0; g < asset.cloud.count; ++g) {
        const float z = uniform(-1, 1), phi = uniform(0, 6.2832f), r = std::sqrt(1 - z * z);
        const float sharpness = 0.1f * std::pow(10 * sharpest, uniform(0, 1));
        lobe.values.insert(lobe.values.end(), {r * std::cos(phi), r * std::sin(phi), z, sharpness});
        for (int c = 0; c < 3; ++c) lobe.values.push_back(uniform(0, 2));
        for (uint32_t i = 0; i < visibility.components; ++i) visibility.bytes.push_back(uint8_t(rng() >> 24));
        shadow.values.push_back(uniform(0, 1));
        forward.values.push_back(0.1f * std::pow(1000.0f, uniform(0, 1)));
        for (int c = 0; c < 3; ++c) forward.values.push_back(uniform(0, 1));
    }
    if (which & kLobe) asset.channels.push_back(lobe);
    if (which & kVisibility) asset.channels.push_back(visibility);
    if (which & kShadow) asset.channels.push_back(shadow);
    if (which & kForward) asset.channels.push_back(forward);
    return asset;
}

enum SssChannelsOf { kSssMaps = 1, kSssNetwork = 2, kSssScatter = 4, kSssShared = 8 /* the network has a share */, kAllSss = 15 };

/// The splats of randomAsset with random materials, normals that look outwards, random maps and a random network, as `which` says; with its share it has codes, too.
inline SplatAsset randomSss(size_t count, int which, uint32_t seed, float splatScale = 0.05f)
{
    std::mt19937 rng(seed);
    const auto uniform = [&](float lo, float hi) { return lo + (hi - lo) * float(rng() >> 8) * 0x1p-24f; };
    SplatAsset a = randomAsset(count, 0, seed, splatScale);
    a.model = "sss";
    Channel base{"baseColor", 3, {}, {}}, material{"material", (which & kSssScatter) ? 3u : 2u, {}, {}}, normal{"normal", 3, {}, {}};
    Channel maps{"visibility", kVisibilityTexels, {}, {}}, network{"network", uint32_t(kSssNetworkFloats), {}, {}, true};
    for (size_t g = 0; g < count; ++g) {
        for (int c = 0; c < 3; ++c) base.values.push_back(uniform(0, 1));
        for (uint32_t c = 0; c < material.components; ++c) material.values.push_back(c == 0 ? uniform(0.3f, 1) : uniform(0, 1));
        const glm::vec3 n = glm::normalize(a.cloud.positions[g] + 0.1f * glm::vec3(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)) + glm::vec3(0, 0, 1e-3f));
        normal.values.insert(normal.values.end(), {n.x, n.y, n.z});
        for (int i = 0; i < kVisibilityTexels; ++i) maps.bytes.push_back(uint8_t(rng() >> 24));
    }
    for (int i = 0; i < kSssWeights; ++i) network.values.push_back(uniform(-0.4f, 0.4f));
    if (!(which & kSssShared)) std::fill(network.values.begin() + kSssShareOut, network.values.end(), 0.0f);
    network.values.insert(network.values.end(), {0, 0, 0, 2});
    Channel code{"code", kSssCodeInputs, {}, {}}, codeWeights{"codeWeights", kSssHidden1 * kSssCodeInputs, {}, {}, true};
    for (size_t i = 0; i < count * kSssCodeInputs; ++i) code.values.push_back(uniform(-1, 1));
    for (uint32_t i = 0; i < codeWeights.components; ++i) codeWeights.values.push_back(uniform(-0.4f, 0.4f));
    a.channels = {base, material, normal};
    if (which & kSssMaps) a.channels.push_back(maps);
    if (which & kSssNetwork) a.channels.push_back(network);
    if ((which & kSssNetwork) && (which & kSssShared)) a.channels.push_back(code), a.channels.push_back(codeWeights);
    return a;
}

/// One splat at the origin, as randomAsset otherwise.
inline SplatAsset oneSplat(int sFunctions, glm::vec3 scale = glm::vec3(0.1f), float opacity = 0.8f)
{
    SplatAsset a = randomAsset(1, sFunctions, 7);
    a.cloud.positions[0] = glm::vec3(0);
    a.cloud.scales[0] = scale;
    a.cloud.opacities[0] = opacity;
    return a;
}

inline LightSample<double> sampleLight(const Light& light, const double p[3])
{
    if (light.type == LightType::kDirectional) {
        const glm::dvec3 d = glm::normalize(glm::dvec3(light.directionToLight));
        return {{d.x, d.y, d.z}, 1.0};
    }
    const double position[3] = {light.position.x, light.position.y, light.position.z};
    return samplePointLight<double>(position, light.radius, p);
}

/// Radiance of a bigs splat along the unit direction `out` per unit irradiance from the unit direction `in`, in float64.
inline glm::dvec3 bigsRadiance(const SplatAsset& asset, size_t g, const glm::dvec3& out, const glm::dvec3& in, double widening)
{
    const auto row = [&](const char* name) {
        const Channel* c = asset.find(name);
        std::vector<double> values;
        if (c) values.assign(&c->values[g * c->components], &c->values[g * c->components] + c->components);
        return values;
    };
    const std::vector<double> tDir = row("tDir"), tInd = row("tInd"), rho = row("rho"), s = row("s");
    int functions = 0;
    while (3 * bigsPairCount(functions) < int(s.size())) ++functions;
    const std::vector<double> lobe = row("lobe"), forward = row("forward");
    const Channel* visibility = asset.find("visibility");
    const BigsCoefficients<double> k{tDir.data(), tInd.data(), rho.data(), s.data(), functions, lobe.empty() ? nullptr : lobe.data(),
                                     visibility ? VisibilityMap{&visibility->bytes[g * visibility->components], visibilitySize(visibility->components)} : VisibilityMap{},
                                     asset.find("shadow") ? double(asset.find("shadow")->values[g]) : 1.0,
                                     forward.empty() ? nullptr : forward.data()};
    double y[25], a[75];
    shBasis(25, out.x, out.y, out.z, y);
    bigsContractView(k, y, a);
    shBasis(25, in.x, in.y, in.z, y);
    const BigsTerms<double> terms = bigsTerms(k, a, y);
    const BigsSharpTerms<double> sharp = bigsSharpTerms(k, &out.x, &in.x, widening);
    return {bigsTransport(terms, sharp, 0), bigsTransport(terms, sharp, 1), bigsTransport(terms, sharp, 2)};
}

/// Of splat `g` towards `eye` under point and directional lights.
inline glm::dvec3 referenceColor(const SplatAsset& asset, size_t g, glm::dvec3 eye, std::span<const Light> lights)
{
    const glm::dvec3 mean = asset.cloud.positions[g], out = glm::length(eye - mean) > 0 ? glm::normalize(eye - mean) : glm::dvec3(0, 0, 1);
    glm::dvec3 color(0);
    for (const Light& light : lights) {
        const LightSample<double> w = sampleLight(light, &mean.x);
        color += w.falloff * glm::dvec3(light.intensity) * bigsRadiance(asset, g, out, {w.dir[0], w.dir[1], w.dir[2]}, double(highlightWidening(light)));
    }
    return color;
}

/// Splats blended in float64: channelsOf(g) gives numbers to blend, colorOf(blended, alpha, ray) makes the pixel of their sums.
template <class ChannelsOf, class ColorOf>
Image blendedImage(const SplatAsset& asset, const Camera& camera, ChannelsOf channelsOf, ColorOf colorOf)
{
    const View<double> view = makeView<double>(camera, asset.lowPassVariance);
    std::vector<ProjectedGaussian<double>> splats;
    std::vector<double> values;
    const size_t channels = channelsOf(0).size();
    for (size_t g = 0; g < asset.cloud.count; ++g) {
        const glm::vec3 &p = asset.cloud.positions[g], &s = asset.cloud.scales[g];
        const glm::quat& q = asset.cloud.rotations[g];
        const GaussianGeometry<double> geometry{{p.x, p.y, p.z}, {s.x, s.y, s.z}, {q.w, q.x, q.y, q.z}, asset.cloud.opacities[g]};
        ProjectedGaussian<double> projected;
        if (!projectGaussian(view, geometry, projected)) continue;
        splats.push_back(projected);
        const std::vector<double> own = channelsOf(g);
        values.insert(values.end(), own.begin(), own.end());
    }
    std::vector<uint32_t> order(splats.size());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return splats[a].distance < splats[b].distance; });
    Image image{camera.width, camera.height, std::vector<float>(size_t(4) * camera.width * camera.height)};
    std::vector<double> blended(channels);
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            const double alpha = blendPixel<double>(order, splats.data(), values.data(), int(channels), x + 0.5, y + 0.5, blended.data());
            const glm::dvec3 color = colorOf(blended.data(), alpha, pixelRay(camera, x + 0.5, y + 0.5));
            float* out = image.pixel(x, y);
            for (int k = 0; k < 3; ++k) out[k] = float(color[k]);
            out[3] = float(alpha);
        }
    return image;
}

/// The whole image in float64: what the runtime should draw.
inline Image referenceImage(const SplatAsset& asset, const Camera& camera, std::span<const Light> lights)
{
    return blendedImage(
        asset, camera,
        [&](size_t g) {
            const glm::dvec3 c = referenceColor(asset, g, camera.position(), lights);
            return std::vector<double>{c.x, c.y, c.z};
        },
        [](const double* blended, double, const glm::dvec3&) { return glm::dvec3(blended[0], blended[1], blended[2]); });
}

inline float largest(const Image& a)
{
    float most = 0;
    for (const float v : a.rgba) most = std::max(most, std::abs(v));
    return most;
}

inline float largestDifference(const Image& a, const Image& b)
{
    REQUIRE(a.rgba.size() == b.rgba.size());
    float most = 0;
    for (size_t i = 0; i < a.rgba.size(); ++i) most = std::max(most, std::abs(a.rgba[i] - b.rgba[i]));
    return most;
}

/// dB of the premultiplied colours clamped to [0, 1].
inline double psnr(const Image& a, const Image& b)
{
    REQUIRE(a.rgba.size() == b.rgba.size());
    double sum = 0;
    size_t n = 0;
    for (size_t i = 0; i < a.rgba.size(); ++i)
        if (i % 4 != 3) {
            const double d = std::clamp(a.rgba[i], 0.0f, 1.0f) - std::clamp(b.rgba[i], 0.0f, 1.0f);
            sum += d * d;
            ++n;
        }
    return 10 * std::log10(double(n) / std::max(sum, 1e-30));
}

inline bool allFinite(const Image& a)
{
    return std::all_of(a.rgba.begin(), a.rgba.end(), [](float v) { return std::isfinite(v); });
}

inline NacreLight toNacre(const Light& light)
{
    NacreLight n{};
    n.structSize = sizeof n;
    const bool point = light.type == LightType::kPoint;
    n.type = point ? NACRE_LIGHT_POINT : NACRE_LIGHT_DIRECTIONAL;
    std::memcpy(point ? n.position : n.direction, glm::value_ptr(point ? light.position : light.directionToLight), sizeof n.position);
    std::memcpy(n.intensity, glm::value_ptr(light.intensity), sizeof n.intensity);
    n.radius = light.radius;
    return n;
}

inline void copy(float* out, const glm::dmat4& m)
{
    const glm::mat4 f(m);
    std::memcpy(out, glm::value_ptr(f), sizeof f);
}

/// Infinite far plane, near as the reference's.
inline glm::dmat4 clipFromView(const Camera& c)
{
    glm::dmat4 p(0.0);
    p[0][0] = 2 * c.fx / c.width, p[1][1] = 2 * c.fy / c.height;
    p[2][0] = 1 - 2 * c.cx / c.width, p[2][1] = 2 * c.cy / c.height - 1;
    p[2][2] = p[2][3] = -1;
    p[3][2] = -2.0 * double(kNearPlane);
    return p;
}

inline NacreDrawDesc describe(const Camera& camera)
{
    NacreDrawDesc desc{};
    desc.structSize = sizeof desc;
    copy(desc.viewFromWorld, glm::inverse(camera.worldFromCamera));
    copy(desc.clipFromView, clipFromView(camera));
    desc.viewportWidth = camera.width, desc.viewportHeight = camera.height;
    return desc;
}

/// Draws these instances only; the array must outlive the draw.
inline NacreDrawDesc describe(const Camera& camera, std::span<const NacreInstance> only)
{
    NacreDrawDesc desc = describe(camera);
    desc.instances = only.data(), desc.instanceCount = only.size();
    return desc;
}

struct HostOptions {
    HeadlessKind kind = HeadlessKind::kEgl;
    NacreBackEnd backEnd = NACRE_BACK_END_AUTO;
    uint32_t flags = 0; // NacreContextFlags
    NacreGetProcAddress getProcAddress = HeadlessGl::getProcAddress;
};

/// A host application in miniature: one view, one instance of one asset unless a test makes more.
class Host {
public:
    explicit Host(NacreGetProcAddress getProcAddress = HeadlessGl::getProcAddress) : Host(HostOptions{.getProcAddress = getProcAddress}) {}
    explicit Host(const HostOptions& options)
    {
        auto made = HeadlessGl::create(options.kind);
        REQUIRE(made);
        gl = std::move(*made);
        NacreContextDesc desc{};
        desc.structSize = sizeof desc;
        desc.getProcAddress = options.getProcAddress;
        desc.backEnd = options.backEnd, desc.flags = options.flags;
        desc.message = [](NacreSeverity, const char* text, void* user) { static_cast<Host*>(user)->messages.push_back(text); };
        desc.messageUser = this;
        REQUIRE(nacreContextCreate(&desc, &context) == NACRE_OK);
        view = addView();
    }
    explicit Host(const SplatAsset& source, NacreGetProcAddress getProcAddress = HeadlessGl::getProcAddress) : Host(getProcAddress)
    {
        load(source);
    }
    ~Host()
    {
        gl->makeCurrent();
        nacreContextDestroy(context);
    }
    Host(const Host&) = delete;

    NacreAsset create(const SplatAsset& source)
    {
        const auto bytes = encodeAsset(source);
        REQUIRE(bytes);
        return create(*bytes);
    }
    NacreAsset create(std::span<const std::byte> bytes)
    {
        gl->makeCurrent();
        NacreAsset made{};
        REQUIRE_MESSAGE(nacreAssetCreate(context, bytes.data(), bytes.size(), &made) == NACRE_OK, lastMessage());
        return made;
    }
    NacreInstance place(NacreAsset what, const glm::dmat4& worldFromAsset = glm::dmat4(1))
    {
        NacreInstanceDesc desc{};
        desc.structSize = sizeof desc;
        desc.asset = what;
        copy(desc.worldFromAsset, worldFromAsset);
        NacreInstance made{};
        REQUIRE_MESSAGE(nacreInstanceCreate(&desc, &made) == NACRE_OK, lastMessage());
        return made;
    }
    /// Owned by the instance: the asset goes with it.
    NacreInstance place(const SplatAsset& source, const glm::dmat4& worldFromAsset = glm::dmat4(1))
    {
        const NacreAsset made = create(source);
        const NacreInstance placed = place(made, worldFromAsset);
        nacreAssetDestroy(made);
        return placed;
    }
    NacreView addView(uint32_t mask = 0)
    {
        NacreViewDesc desc{};
        desc.structSize = sizeof desc;
        desc.mask = mask;
        NacreView made{};
        REQUIRE_MESSAGE(nacreViewCreate(context, &desc, &made) == NACRE_OK, lastMessage());
        return made;
    }
    void unload()
    {
        nacreInstanceDestroy(instance);
        nacreAssetDestroy(asset);
        instance = {}, asset = {};
    }
    void load(const SplatAsset& source)
    {
        unload();
        asset = create(source);
        instance = place(asset);
    }
    void moveTo(const glm::dmat4& worldFromAsset)
    {
        float m[16];
        copy(m, worldFromAsset);
        REQUIRE_MESSAGE(nacreInstanceSetTransform(instance, m) == NACRE_OK, lastMessage());
    }
    void setLights(std::span<const Light> lights)
    {
        std::vector<NacreLight> converted;
        for (const Light& light : lights) converted.push_back(toNacre(light));
        REQUIRE_MESSAGE(nacreContextSetLights(context, converted.data(), converted.size()) == NACRE_OK, lastMessage());
    }
    Image draw(NacreView through, const NacreDrawDesc& desc)
    {
        gl->makeCurrent();
        REQUIRE(gl->beginFrame(desc.viewportWidth, desc.viewportHeight));
        REQUIRE_MESSAGE(nacreViewDraw(through, &desc) == NACRE_OK, lastMessage());
        return gl->readFrame();
    }
    Image draw(const NacreDrawDesc& desc) { return draw(view, desc); }
    Image draw(const Camera& camera) { return draw(describe(camera)); }
    Image draw(const Camera& camera, std::span<const Light> lights)
    {
        setLights(lights);
        return draw(camera);
    }
    NacreDrawStats stats(NacreView of) const
    {
        NacreDrawStats s{};
        s.structSize = sizeof s;
        REQUIRE(nacreViewGetStats(of, &s) == NACRE_OK);
        return s;
    }
    NacreDrawStats stats() const { return stats(view); }
    NacreAssetInfo info() const
    {
        NacreAssetInfo i{};
        i.structSize = sizeof i;
        REQUIRE(nacreAssetGetInfo(asset, &i) == NACRE_OK);
        return i;
    }
    NacreContextInfo contextInfo() const
    {
        NacreContextInfo i{};
        i.structSize = sizeof i;
        REQUIRE(nacreContextGetInfo(context, &i) == NACRE_OK);
        return i;
    }
    std::string lastMessage() const { return messages.empty() ? "" : messages.back(); }

    std::unique_ptr<HeadlessGl> gl;
    NacreContext context{};
    NacreAsset asset{};
    NacreInstance instance{};
    NacreView view{};
    std::vector<std::string> messages;
};

} // namespace nacre::test
