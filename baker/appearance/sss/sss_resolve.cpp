#include "appearance/sss/sss_resolve.h"

#include "appearance/sss/sss_backward.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace nacre {

namespace {

constexpr int kMaxPlanes = kSssSurfaceChannels + kSssLightChannels * kMaxLightsPerStep + 1;

/// One pixel's channels, side by side.
struct PixelChannels {
    float g[kMaxPlanes];
    float alpha, ray[3];
    bool empty = true;
};

PixelChannels gather(const PixelRays& rays, const float* planes, int channels, size_t pixels, int x, int y)
{
    PixelChannels p;
    const size_t at = size_t(y) * rays.width + x;
    p.alpha = planes[size_t(channels) * pixels + at];
    if (!(p.alpha > 0)) return p;
    p.empty = false;
    for (int k = 0; k < channels; ++k) p.g[k] = planes[size_t(k) * pixels + at];
    float length2 = 0;
    for (int k = 0; k < 3; ++k) {
        p.ray[k] = rays.origin[k] + (float(x) + 0.5f) * rays.right[k] + (float(y) + 0.5f) * rays.down[k];
        length2 += p.ray[k] * p.ray[k];
    }
    const float inv = 1.0f / std::sqrt(length2);
    for (float& r : p.ray) r *= inv; // depth is the distance from the eye
    return p;
}

SssLightAt<float> lightAt(const Light& light, const float* point)
{
    if (light.type == LightType::kPoint)
        return sssPointLightAt(&light.position.x, std::max(light.radius, kMinLightRadius), point);
    return {{light.directionToLight.x, light.directionToLight.y, light.directionToLight.z},
            1.0f,
            0.0f}; // distance 0: no gradient to the point
}

} // namespace

void sssResolve(const PixelRays& rays, const LitView& lit, const float* planes, float* image)
{
    const int lights = lit.lightCount, channels = kSssSurfaceChannels + kSssLightChannels * lights;
    const size_t pixels = size_t(rays.width) * rays.height;
    std::copy_n(planes + size_t(channels) * pixels, pixels, image + size_t(3 * lights) * pixels);
    tbb::parallel_for(0, rays.height, [&](int y) {
        for (int x = 0; x < rays.width; ++x) {
            const size_t at = size_t(y) * rays.width + x;
            const PixelChannels p = gather(rays, planes, channels, pixels, x, y);
            const SssPixel<float> pixel = p.empty ? SssPixel<float>{} : sssPixel(p.g, p.alpha, rays.eye, p.ray);
            for (int l = 0; l < lights; ++l) {
                if (p.empty) {
                    for (int c = 0; c < 3; ++c) image[size_t(3 * l + c) * pixels + at] = 0.0f;
                    continue;
                }
                const SssLightAt<float> light = lightAt(lit.lights[l], pixel.point);
                const SssReflection<float> o = sssReflect(pixel.surface, pixel.wo, light.wi);
                const float* own = p.g + kSssSurfaceChannels + kSssLightChannels * l;
                for (int c = 0; c < 3; ++c)
                    image[size_t(3 * l + c) * pixels + at] =
                        sssRadiance(pixel, own, lit.lights[l].intensity[c] * light.falloff, o.value[c], c);
            }
        }
    });
}

void sssResolveBackward(const PixelRays& rays, const LitView& lit, const float* planes, const float* dImage, float* dPlanes)
{
    const int lights = lit.lightCount, channels = kSssSurfaceChannels + kSssLightChannels * lights;
    const size_t pixels = size_t(rays.width) * rays.height;
    tbb::parallel_for(0, rays.height, [&](int y) {
        for (int x = 0; x < rays.width; ++x) {
            const size_t at = size_t(y) * rays.width + x;
            const PixelChannels p = gather(rays, planes, channels, pixels, x, y);
            float d[kMaxPlanes] = {}, dAlpha = 0;
            if (!p.empty) {
                const SssPixel<float> pixel = sssPixel(p.g, p.alpha, rays.eye, p.ray);
                SssPixelGradient<float> gradient;
                for (int l = 0; l < lights; ++l) {
                    const Light& light = lit.lights[l];
                    const SssLightAt<float> to = lightAt(light, pixel.point);
                    const float dPixel[3] = {dImage[size_t(3 * l) * pixels + at], dImage[size_t(3 * l + 1) * pixels + at],
                                             dImage[size_t(3 * l + 2) * pixels + at]};
                    const int own = kSssSurfaceChannels + kSssLightChannels * l;
                    sssPixelLightBackward(pixel, p.g + own, to, std::max(light.radius, kMinLightRadius), &light.intensity.x,
                                          sssReflect(pixel.surface, pixel.wo, to.wi), dPixel, d + own, gradient);
                }
                sssPixelBackward(pixel, p.g, p.ray, gradient, d, &dAlpha);
            }
            for (int k = 0; k < channels; ++k) dPlanes[size_t(k) * pixels + at] = d[k];
            dPlanes[size_t(channels) * pixels + at] = dAlpha + dImage[size_t(3 * lights) * pixels + at];
        }
    });
}

} // namespace nacre
