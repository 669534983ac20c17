#include "appearance/sss/sss_resolve.h"

#include "appearance/sss/sss_backward.h"
#include "render/lanes.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace nacre {

namespace {

constexpr int kMaxPlanes = kSssSurfaceChannels + kSssLightChannels * kMaxLightsPerStep;

/// Neighbours in a row of pixels, with their channels side by side.
struct PixelGroup {
    Lanes channels[kMaxPlanes], alpha, ray[3];
    SssPixel<Lanes> pixel;
};

/// A light, the same for all lanes.
struct LightLanes {
    Lanes position[3], intensity[3], radius;
    LightSample<Lanes> directional;
    bool isPoint;
};

LightLanes spread(const Light& light)
{
    LightLanes o{};
    for (int c = 0; c < 3; ++c) {
        o.position[c] = Lanes(light.position[c]), o.intensity[c] = Lanes(light.intensity[c]);
        o.directional.dir[c] = Lanes(light.directionToLight[c]);
    }
    o.radius = Lanes(std::max(light.radius, kMinLightRadius));
    o.directional.falloff = Lanes(1); // and distance 0: no gradient to the point
    o.isPoint = light.type == LightType::kPoint;
    return o;
}

LightSample<Lanes> lightAt(const LightLanes& light, const Lanes* point)
{
    return light.isPoint ? samplePointLight(light.position, light.radius, point) : light.directional;
}

/// What both directions go through: the image in rows of groups of pixels.
struct Resolve {
    const PixelRays& rays;
    int lights, channels;
    const float* planes;
    size_t pixels;
    LightLanes light[kMaxLightsPerStep];

    Resolve(const PixelRays& rays, const LitView& lit, const float* planes)
        : rays(rays), lights(lit.lightCount), channels(kSssSurfaceChannels + kSssLightChannels * lights), planes(planes),
          pixels(size_t(rays.width) * rays.height)
    {
        for (int l = 0; l < lights; ++l) light[l] = spread(lit.lights[l]);
    }

    // work(first pixel, pixels, group, or null where nothing is seen)
    template <class Work> void forEachGroup(Work work) const
    {
        tbb::parallel_for(0, rays.height, [&](int y) {
            for (int x = 0; x < rays.width; x += Lanes::kCount) {
                const size_t at = size_t(y) * rays.width + x;
                const int count = std::min(Lanes::kCount, rays.width - x);
                PixelGroup group;
                group.alpha = Lanes::load(planes + size_t(channels) * pixels + at, count);
                const bool seen = any(group.alpha > Lanes(0));
                if (seen) gather(x, y, count, group);
                work(at, count, seen ? &group : nullptr);
            }
        });
    }

    void gather(int x, int y, int count, PixelGroup& group) const
    {
        const size_t at = size_t(y) * rays.width + x;
        for (int k = 0; k < channels; ++k) group.channels[k] = Lanes::load(planes + size_t(k) * pixels + at, count);
        float columns[Lanes::kCount];
        for (int lane = 0; lane < Lanes::kCount; ++lane) columns[lane] = float(x + lane) + 0.5f;
        sssPixelRay(rays, Lanes::load(columns, Lanes::kCount), float(y) + 0.5f, group.ray); // depth is the distance from the eye
        const Lanes eye[3] = {Lanes(rays.eye[0]), Lanes(rays.eye[1]), Lanes(rays.eye[2])};
        group.pixel = sssPixel(group.channels, group.alpha, eye, group.ray);
    }
};

} // namespace

void sssResolve(const PixelRays& rays, const LitView& lit, const float* planes, float* image)
{
    const Resolve resolve(rays, lit, planes);
    const size_t pixels = resolve.pixels;
    std::copy_n(planes + size_t(resolve.channels) * pixels, pixels, image + size_t(3 * resolve.lights) * pixels);
    resolve.forEachGroup([&](size_t at, int count, const PixelGroup* group) {
        for (int l = 0; l < resolve.lights; ++l) {
            float* out = image + size_t(3 * l) * pixels + at;
            if (!group) {
                for (int c = 0; c < 3; ++c) std::fill_n(out + size_t(c) * pixels, count, 0.0f);
                continue;
            }
            const LightLanes& light = resolve.light[l];
            const LightSample<Lanes> to = lightAt(light, group->pixel.point);
            const SssReflection<Lanes> o = sssReflect(group->pixel.surface, group->pixel.wo, to.dir);
            const Lanes* own = group->channels + kSssSurfaceChannels + kSssLightChannels * l;
            for (int c = 0; c < 3; ++c)
                sssRadiance(own, light.intensity[c] * to.falloff, o.value[c], c)
                    .store(out + size_t(c) * pixels, count);
        }
    });
}

void sssResolveBackward(const PixelRays& rays, const LitView& lit, const float* planes, const float* dImage, float* dPlanes)
{
    const Resolve resolve(rays, lit, planes);
    const size_t pixels = resolve.pixels;
    const int channels = resolve.channels;
    resolve.forEachGroup([&](size_t at, int count, const PixelGroup* group) {
        Lanes d[kMaxPlanes], dAlpha{};
        if (!group) std::fill_n(d, channels, Lanes{});
        else {
            SssPixelGradient<Lanes> gradient;
            for (int l = 0; l < resolve.lights; ++l) {
                const LightLanes& light = resolve.light[l];
                const LightSample<Lanes> to = lightAt(light, group->pixel.point);
                Lanes dPixel[3];
                for (int c = 0; c < 3; ++c) dPixel[c] = Lanes::load(dImage + size_t(3 * l + c) * pixels + at, count);
                const int own = kSssSurfaceChannels + kSssLightChannels * l;
                sssPixelLightBackward(group->pixel, group->channels + own, to, light.radius, light.intensity,
                                      sssReflect(group->pixel.surface, group->pixel.wo, to.dir), dPixel, d + own, gradient);
            }
            sssPixelBackward(group->pixel, group->channels, group->ray, gradient, d, &dAlpha);
        }
        for (int k = 0; k < channels; ++k) d[k].store(dPlanes + size_t(k) * pixels + at, count);
        dAlpha += Lanes::load(dImage + size_t(3 * resolve.lights) * pixels + at, count);
        dAlpha.store(dPlanes + size_t(channels) * pixels + at, count);
    });
}

} // namespace nacre
