// A scene drawn, and the gradient of its image taken, with the scalar formulas in T: float is under test, double is the reference.
#pragma once

#include "appearance/bigs/bigs_asset.h"
#include "appearance/sss/sss_asset.h"
#include "base/half.h"
#include "base/spherical_harmonics.h"
#include "selftest/formulas.h"
#include "selftest/scene.h"
#include "selftest/values.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>

namespace nacre::selftest {

template <class T>
std::vector<T> inT(const float* from, size_t count)
{
    return from ? std::vector<T>(from, from + count) : std::vector<T>();
}

/// The light as seen from `p`.
template <class T>
LightSample<T> lightAt(const Formulas<T>& formulas, const Light& light, const T* p)
{
    const glm::vec3 &at = light.position, &d = light.directionToLight;
    if (light.type == LightType::kDirectional) return {{T(d.x), T(d.y), T(d.z)}, T(1)};
    const T position[3] = {T(at.x), T(at.y), T(at.z)};
    return formulas.pointLight(position, T(light.radius), p);
}

/// What one splat of bigs sends to the eye: three channels.
template <class T>
class ScalarBigs {
public:
    ScalarBigs(const Scene& scene, const Formulas<T>& formulas) : scene_(scene), formulas_(formulas), channels_(scene.asset) {}
    int channels() const { return 3; }

    void shade(size_t splat, const T* p, const T* eye, T* color) const
    {
        const BigsCoefficients<float> f = channels_.at(splat);
        const std::vector<T> tDir = inT<T>(f.tDir, 25), tInd = inT<T>(f.tInd, 75), rho = inT<T>(f.rho, 3), s = inT<T>(f.s, f.s ? size_t(3 * bigsPairCount(f.sFunctions)) : 0),
                             lobe = inT<T>(f.lobe, kBigsLobeFloats), forward = inT<T>(f.forward, kBigsForwardFloats);
        const BigsCoefficients<T> g{tDir.data(), tInd.data(), rho.data(), s.data(), f.sFunctions, f.lobe ? lobe.data() : nullptr, f.visibility, T(f.shadow), f.forward ? forward.data() : nullptr};
        T y[kMaxShFunctions], a[3 * kMaxShFunctions];
        const LightSample<T> toEye = formulas_.pointLight(eye, T(0), p);
        shBasis(25, toEye.dir[0], toEye.dir[1], toEye.dir[2], y);
        bigsContractView(g, y, a);
        std::fill_n(color, 3, T(0));
        for (const Light& light : scene_.lights) {
            const LightSample<T> l = lightAt(formulas_, light, p);
            shBasis(25, l.dir[0], l.dir[1], l.dir[2], y);
            const BigsTerms<T> t = formulas_.terms(g, a, y);
            const BigsSharpTerms<T> sharp = formulas_.sharp(g, toEye.dir, l.dir, T(highlightWidening(light)));
            for (int c = 0; c < 3; ++c) color[c] += T(light.intensity[c]) * l.falloff * formulas_.transport(t, sharp, c);
        }
        if (scene_.halfTarget)
            for (int c = 0; c < 3; ++c) color[c] = std::min(color[c], T(kMaxHalf));
    }
    void resolve(const T* blended, T, const T*, const T*, T* rgb) const { std::copy_n(blended, 3, rgb); }

private:
    const Scene& scene_;
    const Formulas<T>& formulas_;
    BigsChannels channels_;
};

/// sss: the G-buffer, scattered light, and the share of each light; a pixel shades.
template <class T>
class ScalarSss {
public:
    ScalarSss(const Scene& scene, const Formulas<T>& formulas)
        : scene_(scene), formulas_(formulas), channels_(scene.asset), network_(inT<T>(channels_.network(), kSssNetworkFloats))
    {
        const Channel *code = scene.asset.find("code"), *weights = scene.asset.find("codeWeights");
        if (code && weights) code_ = inT<T>(code->values.data(), code->values.size()), codeWeights_ = inT<T>(weights->values.data(), weights->values.size());
    }
    int channels() const { return kShares + int(scene_.lights.size()); }

    void shade(size_t splat, const T* p, const T* eye, T* out) const
    {
        const SssMaterial m = channels_.material(splat);
        const LightSample<T> toEye = formulas_.pointLight(eye, T(0), p);
        const T normal[3] = {T(m.normal[0]), T(m.normal[1]), T(m.normal[2])};
        T first[kSssHidden1];
        if (!network_.empty()) {
            T in[kSssFixedInputs];
            formulas_.fixedInputs(p, normal, &network_[kSssFrame], in);
            sssNetworkFixed(network_.data(), in, first);
            if (!code_.empty()) sssNetworkCode(codeWeights_.data(), &code_[kSssCodeInputs * splat], first);
        }
        T d2 = 0;
        for (int k = 0; k < 3; ++k) {
            out[kSssNormal + k] = normal[k], out[kSssBase + k] = T(m.base[k]), out[kScattered + k] = T(0);
            d2 += (p[k] - eye[k]) * (p[k] - eye[k]);
        }
        out[kSssRoughness] = T(m.roughness), out[kSssMetalness] = T(m.metalness), out[kSssSubsurface] = T(m.subsurface), out[kSssDepth] = std::sqrt(d2);
        for (size_t t = 0; t < scene_.lights.size(); ++t) {
            const Light& light = scene_.lights[t];
            const LightSample<T> l = lightAt(formulas_, light, p);
            const VisibilityMap map = channels_.visibility(splat);
            const T visibility = map.texels ? mapVisibility(map, l.dir) : T(1);
            out[size_t(kShares) + t] = visibility;
            if (network_.empty()) continue;
            T in[kSssLightInputs];
            const T distance = light.type == LightType::kPoint ? std::sqrt(l.distance2) : T(-1);
            sssLightInputs(toEye.dir, l.dir, visibility, distance * network_[kSssFrame + 3], in);
            const SssActivations<T> a = formulas_.network(network_.data(), first, in);
            out[size_t(kShares) + t] *= a.share;
            for (int c = 0; c < 3; ++c) out[kScattered + c] += T(m.subsurface) * T(light.intensity[c]) * l.falloff * a.residual[c];
        }
    }

    void resolve(const T* g, T alpha, const T* eye, const T* ray, T* rgb) const
    {
        std::copy_n(g + kScattered, 3, rgb);
        const SssPixel<T> pixel = formulas_.pixel(g, alpha, eye, ray);
        for (size_t t = 0; pixel.inverseLength > T(0) && t < scene_.lights.size(); ++t) {
            const Light& light = scene_.lights[t];
            const LightSample<T> l = lightAt(formulas_, light, pixel.point);
            const SssReflection<T> o = formulas_.reflect(pixel.surface, pixel.wo, l.dir, T(highlightWidening(light)));
            const T own[kSssLightChannels] = {g[size_t(kShares) + t], T(0), T(0), T(0)};
            for (int c = 0; c < 3; ++c) rgb[c] += sssRadiance(own, T(light.intensity[c]) * l.falloff, o.value[c], c);
        }
        if (scene_.halfTarget)
            for (int c = 0; c < 3; ++c) rgb[c] = std::min(rgb[c], T(kMaxHalf) * alpha);
    }

private:
    static constexpr int kScattered = kSssSurfaceChannels, kShares = kScattered + 3;
    const Scene& scene_;
    const Formulas<T>& formulas_;
    SssChannels channels_;
    std::vector<T> network_, code_, codeWeights_;
};

/// The splats of a scene that the camera sees, nearest first.
template <class T>
struct ScalarView {
    View<T> view;
    std::vector<GaussianGeometry<T>> geometry;    // of all splats
    std::vector<size_t> splat;                    // of each that is seen
    std::vector<ProjectedGaussian<T>> projected;
    std::vector<uint32_t> order;

    ScalarView(const Scene& scene, const Formulas<T>& formulas) : view(makeView<T>(scene.camera, double(scene.asset.lowPassVariance)))
    {
        const SplatCloud& cloud = scene.asset.cloud;
        for (size_t i = 0; i < cloud.count; ++i) {
            const glm::vec3 &p = cloud.positions[i], &s = cloud.scales[i];
            const glm::quat& q = cloud.rotations[i];
            geometry.push_back({{T(p.x), T(p.y), T(p.z)}, {T(s.x), T(s.y), T(s.z)}, {T(q.w), T(q.x), T(q.y), T(q.z)}, T(cloud.opacities[i])});
            ProjectedGaussian<T> out;
            if (!formulas.project(view, geometry.back(), out)) continue;
            splat.push_back(i), projected.push_back(out);
        }
        order.resize(splat.size());
        std::iota(order.begin(), order.end(), 0u);
        std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return projected[a].distance < projected[b].distance; });
    }
};

template <class T, class Model>
Values drawScalarModel(const Scene& scene, const Formulas<T>& formulas, const Model& model)
{
    const ScalarView<T> seen(scene, formulas);
    const int channels = model.channels();
    std::vector<T> colors(seen.splat.size() * size_t(channels));
    for (size_t v = 0; v < seen.splat.size(); ++v) model.shade(seen.splat[v], seen.geometry[seen.splat[v]].position, seen.view.eye, &colors[size_t(channels) * v]);
    ValueGroup color{"colour", {}, 0}, coverage{"alpha", {}, 1};
    std::vector<T> blended(static_cast<size_t>(channels));
    for (int y = 0; y < scene.camera.height; ++y)
        for (int x = 0; x < scene.camera.width; ++x) {
            const T alpha = formulas.blend(seen.order, seen.projected.data(), colors.data(), channels, T(x) + T(0.5), T(y) + T(0.5), blended.data());
            const glm::dvec3 d = pixelRay(scene.camera, x + 0.5, y + 0.5);
            const T ray[3] = {T(d.x), T(d.y), T(d.z)};
            T rgb[3] = {T(0), T(0), T(0)};
            if (!(alpha <= T(0))) model.resolve(blended.data(), alpha, seen.view.eye, ray, rgb);
            for (const T c : rgb) color.values.push_back(double(c));
            coverage.values.push_back(double(alpha));
        }
    return {std::move(color), std::move(coverage)};
}

template <class T>
Values drawScalar(const Scene& scene, const Formulas<T>& formulas)
{
    if (scene.asset.model == "sss") return drawScalarModel(scene, formulas, ScalarSss<T>(scene, formulas));
    return drawScalarModel(scene, formulas, ScalarBigs<T>(scene, formulas));
}

/// The loss whose gradient is compared: radiance and coverage of each pixel times a fixed number in [-1, 1].
inline float lossWeight(size_t pixel, int channel) { return 2 * Random(17, pixel * 4 + uint64_t(channel)).uniform() - 1; }

/// Gradients of all splats in the order of the file, from those of what they are on the screen, [visible].
template <class T>
Values geometryGradients(const View<T>& view, std::span<const GaussianGeometry<T>> geometry, std::span<const size_t> splatFromVisible, const ScreenGradient<T>* dSplats,
                         const Formulas<T>& formulas)
{
    Values out = {{"gradient of positions", {}, 0}, {"gradient of scales", {}, 0}, {"gradient of rotations", {}, 0}, {"gradient of opacities", {}, 0}};
    std::vector<GaussianGeometry<T>> gradients(geometry.size(), GaussianGeometry<T>{});
    for (size_t v = 0; v < splatFromVisible.size(); ++v) {
        const ScreenGradient<T>& d = dSplats[v];
        formulas.projectBackward(view, geometry[splatFromVisible[v]], d.mean, d.conic, d.opacity, T(0), gradients[splatFromVisible[v]]);
    }
    for (const GaussianGeometry<T>& g : gradients) {
        for (int k = 0; k < 3; ++k) out[0].values.push_back(double(g.position[k])), out[1].values.push_back(double(g.scale[k]));
        for (int k = 0; k < 4; ++k) out[2].values.push_back(double(g.rotation[k]));
        out[3].values.push_back(double(g.opacity));
    }
    return out;
}

/// Of a scene of bigs.
template <class T>
Values scalarGradients(const Scene& scene, const Formulas<T>& formulas)
{
    const ScalarView<T> seen(scene, formulas);
    const ScalarBigs<T> model(scene, formulas);
    std::vector<T> colors(3 * seen.splat.size()), dColors(colors.size());
    for (size_t v = 0; v < seen.splat.size(); ++v) model.shade(seen.splat[v], seen.geometry[seen.splat[v]].position, seen.view.eye, &colors[3 * v]);
    std::vector<ScreenGradient<T>> dSplats(seen.splat.size(), ScreenGradient<T>{});
    for (int y = 0; y < scene.camera.height; ++y)
        for (int x = 0; x < scene.camera.width; ++x) {
            const size_t pixel = size_t(y) * size_t(scene.camera.width) + size_t(x);
            const T dColor[3] = {T(lossWeight(pixel, 0)), T(lossWeight(pixel, 1)), T(lossWeight(pixel, 2))};
            const T px = T(x) + T(0.5), py = T(y) + T(0.5);
            T color[3];
            const T alpha = formulas.blend(seen.order, seen.projected.data(), colors.data(), 3, px, py, color);
            blendPixelBackward<T>(seen.order, seen.projected.data(), colors.data(), 3, px, py, color, alpha, dColor, T(lossWeight(pixel, 3)), dSplats.data(), dColors.data());
        }
    Values out = geometryGradients<T>(seen.view, seen.geometry, seen.splat, dSplats.data(), formulas);
    ValueGroup of{"gradient of colours", std::vector<double>(3 * scene.asset.cloud.count), 0};
    for (size_t v = 0; v < seen.splat.size(); ++v)
        for (size_t c = 0; c < 3; ++c) of.values[3 * seen.splat[v] + c] = double(dColors[3 * v + c]);
    out.push_back(std::move(of));
    return out;
}

} // namespace nacre::selftest
