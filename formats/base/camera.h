// A pinhole camera. Right-handed, x right, y up, looks down -Z (OpenGL / Blender axes).
#pragma once

#include <glm/glm.hpp>

namespace nacre {

struct Camera {
    int width = 0, height = 0;          // pixels
    double fx = 0, fy = 0;              // focal lengths, pixels, positive
    double cx = 0, cy = 0;              // principal point, pixels from the top-left corner (image centre = width/2, height/2)
    glm::dmat4 worldFromCamera{1.0};    // rigid
    glm::dvec3 position() const { return glm::dvec3(worldFromCamera[3]); }
};

/// Unit direction, in the world, in which the camera sees the position (x, y) of its image, pixels from the top-left corner.
inline glm::dvec3 pixelRay(const Camera& camera, double x, double y)
{
    const glm::dvec3 d((x - camera.cx) / camera.fx, (camera.cy - y) / camera.fy, -1.0);
    return glm::normalize(glm::dmat3(camera.worldFromCamera) * d);
}

} // namespace nacre
