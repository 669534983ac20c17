// An environment map as directional lights: those of appearance/environment_directions.h. The map's zenith is the light's
// directionToLight.
#include "eval/splat_renderer.h"

#include "appearance/environment_directions.h"
#include "dataset/environment_map.h"

namespace nacre {

Result<std::vector<Light>> expandEnvironment(const Light& light, int count)
{
    if (light.type != LightType::kEnvironment) return std::vector<Light>{light};
    if (count < 1)
        return Error{ErrorCode::kBadInput, "an environment needs at least 1 directional light, got " + std::to_string(count)};
    const Result<Image> map = readEnvironmentMap(light.environmentPath);
    if (!map) return map.error();

    const auto cells = environmentCells(map->rgba.data(), map->width, map->height, 4, count);
    const glm::dmat3 worldFromMap = worldFromEnvironment(glm::normalize(glm::dvec3(light.directionToLight)));
    std::vector<Light> lights;
    for (const EnvironmentDirection& d : environmentDirections(cells, count)) {
        Light& l = lights.emplace_back();
        l.type = LightType::kDirectional;
        l.directionToLight = glm::vec3(worldFromMap * d.direction);
        l.radius = float(d.angularRadius);
        l.intensity = glm::vec3(d.irradiance * glm::dvec3(light.intensity));
    }
    return lights;
}

} // namespace nacre
