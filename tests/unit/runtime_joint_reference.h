// The float64 reference of a scene of both models.
#pragma once

#include "runtime_fixture.h"

#include "appearance/reference_model.h"

namespace nacre::test {

/// Assets in the world, blended jointly in float64: one list of splats, emitted colour of bigs and one G-buffer of surfaces beside each
/// other, the surfaces shaded where they cover the pixel.
inline Image jointReference(std::span<const SplatAsset> assets, const Camera& camera, std::span<const Light> lights)
{
    std::vector<std::unique_ptr<ReferenceModel>> models;
    const ReferenceModel* surfaces = nullptr;
    for (const SplatAsset& asset : assets) {
        models.push_back(makeReferenceModel(asset));
        if (asset.model == "sss") surfaces = models.back().get();
    }
    const int ofSurfaces = surfaces ? surfaces->channels(lights.size()) : 0, coverage = 3 + ofSurfaces, channels = coverage + 1;
    std::vector<ProjectedGaussian<double>> splats;
    std::vector<double> values;
    float eye[3];
    for (int k = 0; k < 3; ++k) eye[k] = float(camera.position()[k]);
    for (size_t a = 0; a < assets.size(); ++a) {
        const View<double> view = makeView<double>(camera, assets[a].lowPassVariance);
        const SplatCloud& cloud = assets[a].cloud;
        for (size_t g = 0; g < cloud.count; ++g) {
            const glm::vec3 &p = cloud.positions[g], &s = cloud.scales[g];
            const glm::quat& q = cloud.rotations[g];
            ProjectedGaussian<double> projected;
            if (!projectGaussian(view, GaussianGeometry<double>{{p.x, p.y, p.z}, {s.x, s.y, s.z}, {q.w, q.x, q.y, q.z}, cloud.opacities[g]}, projected)) continue;
            splats.push_back(projected);
            const bool surface = assets[a].model == "sss";
            std::vector<float> own(size_t(models[a]->channels(lights.size())));
            models[a]->shade(g, eye, lights, own.data());
            values.resize(values.size() + size_t(channels));
            std::copy(own.begin(), own.end(), values.end() - channels + (surface ? 3 : 0));
            values.back() = surface;
        }
    }
    std::vector<uint32_t> order(splats.size());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return splats[a].distance < splats[b].distance; });
    Image image{camera.width, camera.height, std::vector<float>(size_t(4) * camera.width * camera.height)};
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            std::vector<double> blended(static_cast<size_t>(channels));
            float* pixel = image.pixel(x, y);
            pixel[3] = float(blendPixel<double>(order, splats.data(), values.data(), channels, x + 0.5, y + 0.5, blended.data()));
            const std::vector<float> shaded(blended.begin() + 3, blended.end());
            const glm::vec3 ray(pixelRay(camera, x + 0.5, y + 0.5));
            float ofSurface[3] = {};
            if (shaded.back() > 0) surfaces->resolve(shaded.data(), shaded.back(), eye, &ray.x, lights, ofSurface);
            for (int c = 0; c < 3; ++c) pixel[c] = float(blended[size_t(c)]) + ofSurface[c];
        }
    return image;
}

} // namespace nacre::test
