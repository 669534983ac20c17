// Where a mesh stands on the stage: upright, and as large as the stage expects.
#pragma once

#include "base/camera.h"
#include "base/light.h"
#include "light_stage/hair_strands.h"
#include "mesh/mesh_scene.h"

#include <glm/glm.hpp>

namespace nacre {

/// The path tracer works on the stage, where the bounding sphere is the unit sphere whatever the mesh's units and place are: rounding, and what
/// counts as near, are then alike for all. The world is the dataset's: the stage itself, or the mesh's own units and place, upright.
struct Placement {
    glm::dmat4 worldFromMesh{1.0};  // from glTF's world: a rotation, one scale, a translation
    glm::dvec3 center{0.0};         // of the bounding sphere, in the world
    double radius = 1.0;            // of it
    glm::dmat4 stageFromScene{1.0}; // from MeshScene's positions
    double unitsPerMetre = 1.0;     // of the stage
};

/// glTF (+Y up, metres) into a world whose `up` axis is +Y or +Z: (x, y, z) -> (x, -z, y) for +Z. `fit`: the world is the stage. The bounding
/// sphere holds the fibres too, about the mesh's centre. The mesh must have a vertex; one without extent is not scaled.
Placement placeMesh(const MeshScene& scene, const HairStrands& hair, const glm::vec3& up, bool fit);

/// Onto the stage: positions, normals and tangents; control points and radii.
void transformMesh(MeshScene& scene, const Placement& placement);
void transformHair(HairStrands& hair, const Placement& placement);

/// From the world onto the stage, where the same surface receives the same light.
Camera onStage(const Camera& camera, const Placement& placement);
Light onStage(const Light& light, const Placement& placement);

} // namespace nacre
