#include "eval/runtime_types.h"

#include "splats/blend.h"

#include <glm/gtc/type_ptr.hpp>

#include <cstring>

namespace nacre {

/// OpenGL clip space, infinite far plane. Image y runs down and GL's window y up; cx, cy count from the top-left corner.
static glm::mat4 clipFromView(const Camera& c)
{
    glm::mat4 p(0.0f);
    p[0][0] = float(2.0 * c.fx / c.width);
    p[1][1] = float(2.0 * c.fy / c.height);
    p[2][0] = float(1.0 - 2.0 * c.cx / c.width);
    p[2][1] = float(2.0 * c.cy / c.height - 1.0);
    p[2][2] = -1.0f;
    p[2][3] = -1.0f;
    p[3][2] = -2.0f * kNearPlane;
    return p;
}

static void copy(float out[16], const glm::mat4& m) { std::memcpy(out, glm::value_ptr(m), sizeof m); }

Result<std::vector<NacreLight>> toNacreLights(std::span<const Light> lights)
{
    std::vector<NacreLight> out;
    for (const Light& light : lights) {
        if (!light.isPunctual())
            return Error{ErrorCode::kUnsupported, "the GL renderer takes point and directional lights; expand others first (rendererLights)"};
        const bool point = light.type == LightType::kPoint;
        NacreLight n{};
        n.structSize = sizeof n;
        n.type = point ? NACRE_LIGHT_POINT : NACRE_LIGHT_DIRECTIONAL;
        std::memcpy(n.position, glm::value_ptr(light.position), sizeof n.position);
        std::memcpy(n.direction, glm::value_ptr(light.directionToLight), sizeof n.direction);
        std::memcpy(n.intensity, glm::value_ptr(light.intensity), sizeof n.intensity);
        n.radius = light.radius;
        out.push_back(n);
    }
    return out;
}

NacreDrawDesc drawDescOf(const Camera& camera)
{
    NacreDrawDesc desc{};
    desc.structSize = sizeof desc;
    copy(desc.viewFromWorld, glm::mat4(glm::inverse(camera.worldFromCamera)));
    copy(desc.clipFromView, clipFromView(camera));
    desc.viewportWidth = camera.width;
    desc.viewportHeight = camera.height;
    return desc;
}

} // namespace nacre
