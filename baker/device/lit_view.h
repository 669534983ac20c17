// A view and its lights as kernels take them: plain data. Twin of LitView (appearance/trainable.h).
#pragma once

#include "appearance/trainable.h"
#include "base/light_sample.h"

namespace nacre {

struct PlainLight {
    LightType type;
    float position[3], directionToLight[3], intensity[3], radius;
};

struct DeviceLitView {
    float eye[3];
    int lightCount;
    PlainLight lights[kMaxLightsPerStep];
};

inline DeviceLitView deviceLitView(const LitView& view)
{
    DeviceLitView out{};
    for (int k = 0; k < 3; ++k) out.eye[k] = view.eye[k];
    out.lightCount = view.lightCount;
    for (int l = 0; l < view.lightCount; ++l) {
        const Light& light = view.lights[l];
        PlainLight& plain = out.lights[l];
        plain.type = light.type, plain.radius = light.radius;
        for (int k = 0; k < 3; ++k)
            plain.position[k] = light.position[k], plain.directionToLight[k] = light.directionToLight[k], plain.intensity[k] = light.intensity[k];
    }
    return out;
}

/// Twin of sampleLight (base/light.h).
NACRE_HD inline LightSample<float> sampleLight(const PlainLight& light, const float p[3])
{
    if (light.type == LightType::kPoint) return samplePointLight(light.position, light.radius, p);
    return {{light.directionToLight[0], light.directionToLight[1], light.directionToLight[2]}, 1.0f};
}

} // namespace nacre
