// Where a mesh stands on the stage: upright, and as large as the stage expects.
#pragma once

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
/// origin and scales it to radius 1; `coat` is added to its radius first (fibres, metres). The mesh must have a vertex; a mesh without
/// extent is not scaled.
Placement placeMesh(const MeshScene& scene, const glm::vec3& up, bool fit, double coat = 0.0);

/// Moves positions, normals and tangents.
void transformMesh(MeshScene& scene, const Placement& placement);

} // namespace nacre
