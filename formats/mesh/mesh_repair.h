// What makes a mesh fit to be rendered: placed in the world, without triangles that have no area, normals of unit length.
#pragma once

#include "mesh/mesh_scene.h"

namespace nacre {

/// Applies an affine transform. Normals follow the inverse transpose, tangents the linear part; a mirroring transform flips the
/// winding and the handedness. Normals and tangents come out unit, or zero where they have no direction. False: a position overflows.
bool transformMesh(TriangleMesh& mesh, const glm::dmat4& worldFromLocal);

/// Removes triangles whose area is too small for their normal to be computed in float (|e1 x e2|^2 below the smallest normal float:
/// edges of 1e-10 m), and tells how many.
size_t dropZeroAreaTriangles(TriangleMesh& mesh);

/// Gives zero normals the area-weighted mean direction of the triangles around, and tells how many. Needs triangles with area.
size_t replaceZeroNormals(TriangleMesh& mesh);

/// Removes vertices that no triangle uses; the others keep their order.
void dropUnusedVertices(TriangleMesh& mesh);

} // namespace nacre
