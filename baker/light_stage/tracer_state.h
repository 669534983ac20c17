// What all paths of one tracer look at, and never change.
#pragma once

#include "light_stage/hair_bsdf.h"
#include "light_stage/path_tracer.h"
#include "light_stage/ray_scene.h"
#include "light_stage/surface.h"

namespace nacre {

struct PathTracer::State {
    StageScene scene;
    std::vector<std::string> warnings;
    std::unique_ptr<stage::RayScene> rays;
    std::unique_ptr<stage::SurfaceTable> surfaces;
    stage::HairFiber fiber, indirectFiber; // the second: at least kIndirectFiberRoughness, see RenderSettings::indirectRoughness
    float offset = 0.0f; // rays start this far off a surface: more than the rounding of coordinates
    float sheetAt(float distance) const { return offset + 1e-6f * distance; } // within it, surfaces are two sides of one sheet: rounding of both
    bool isFiber(const stage::RayHit& hit) const { return hit.mesh == scene.mesh.meshes.size(); }
};

} // namespace nacre
