// What makes a mesh fit to be rendered: no triangles without area, normals of unit length.
#pragma once

#include "mesh/mesh_scene.h"

namespace nacre {

/// Removes triangles without area (below 1e-19 of the mesh's size squared, edges of 3e-10 of it: rounding), and tells how many.
size_t dropZeroAreaTriangles(TriangleMesh& mesh);

/// Gives zero normals the area-weighted mean direction of the triangles around, and tells how many. Needs triangles with area.
size_t replaceZeroNormals(TriangleMesh& mesh);

/// Triangles whose three normals point behind them: the normals or the winding are the wrong way round.
size_t countBackwardTriangles(const TriangleMesh& mesh);

/// Removes vertices that no triangle uses; the others keep their order.
void dropUnusedVertices(TriangleMesh& mesh);

} // namespace nacre
