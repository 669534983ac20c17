// Where a mesh stands on the stage: upright, and as large as the stage expects.
#pragma once

#include "light_stage/hair_strands.h"
#include "mesh/mesh_scene.h"

#include <glm/glm.hpp>

namespace nacre {

struct Placement {
    glm::dmat4 worldFromMesh{1.0}; // a rotation, one scale, a translation
    double unitsPerMetre = 1.0;    // the scale
    glm::dvec3 center{0.0};        // of the bounding sphere, in the world
    double radius = 1.0;           // of it
};

/// glTF (+Y up, metres) into a world whose `up` axis is +Y or +Z: (x, y, z) -> (x, -z, y) for +Z. `fit` moves the bounding sphere to the
/// origin and scales it to radius 1. The sphere holds the fibres too, about the mesh's centre. The mesh must have a vertex; one without
/// extent is not scaled.
Placement placeMesh(const MeshScene& scene, const HairStrands& hair, const glm::vec3& up, bool fit);

/// Moves positions, normals and tangents; control points and radii.
void transformMesh(MeshScene& scene, const Placement& placement);
void transformHair(HairStrands& hair, const Placement& placement);

} // namespace nacre
