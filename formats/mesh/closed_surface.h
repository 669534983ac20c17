// Whether the triangles of a material enclose a volume, and on which side.
#pragma once

#include "mesh/mesh_scene.h"

namespace nacre {

/// Edges along which not as many triangles run one way as the other; 0: the surface is closed. Vertices nearer than `weld` are one:
/// the two sides of a texture seam may differ by rounding.
size_t countOpenEdges(const MeshScene& scene, int material, float weld);

/// Negative if the surface is inside out.
double signedVolume(const MeshScene& scene, int material);

/// Turns triangles and normals round.
void turnInsideOut(MeshScene& scene, int material);

} // namespace nacre
