// Where an asset lies in the dataset that it was baked from, and what the dataset's lights are in it.
//
// Poses and positions of a capture come in any unit, from any origin. An asset has its object at about unit size near its origin, so that
// float32 and every constant that is a length serve all captures alike. Its axes stay those of the dataset.
#pragma once

#include "base/camera.h"
#include "base/light.h"

#include <memory>

namespace nacre {

struct AssetFrame {
    double scale = 1;            // dataset units in one asset unit
    glm::dvec3 translation{0.0}; // p_dataset = scale * p_asset + translation
    double lightGain = 1;        // an irradiance in the dataset times this is the irradiance in the asset
    bool operator==(const AssetFrame&) const = default;

    glm::dvec3 positionInAsset(const glm::dvec3& inDataset) const { return (inDataset - translation) / scale; }
    glm::dvec3 positionInDataset(const glm::dvec3& inAsset) const { return scale * inAsset + translation; }
};

inline Camera cameraInAsset(const AssetFrame& frame, Camera camera)
{
    camera.worldFromCamera[3] = glm::dvec4(frame.positionInAsset(camera.position()), 1.0);
    return camera;
}

/// A point light keeps the irradiance it gives: I / r^2 with both in the same unit of length.
inline Light lightInAsset(const AssetFrame& frame, Light light)
{
    double gain = frame.lightGain;
    if (light.type == LightType::kPoint) {
        light.position = frame.positionInAsset(glm::dvec3(light.position) + glm::dvec3(light.positionRest));
        light.positionRest = glm::vec3(0.0f);
        light.radius = float(light.radius / frame.scale);
        gain /= frame.scale * frame.scale;
    }
    light.intensity = glm::dvec3(light.intensity) * gain;
    if (light.group) {
        auto group = std::make_shared<std::vector<Light>>();
        for (const Light& l : *light.group) group->push_back(lightInAsset(frame, l));
        light.group = std::move(group);
    }
    return light;
}

/// The inverse, for what is reported to the user.
inline Light lightInDataset(const AssetFrame& frame, const Light& light)
{
    return lightInAsset({1.0 / frame.scale, -frame.translation / frame.scale, 1.0 / frame.lightGain}, light);
}

} // namespace nacre
