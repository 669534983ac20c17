// Meshes on their way from their own space into the world: rigid, in many copies, or bent by a skin.
#pragma once

#include "mesh/mesh_scene.h"

#include <span>
#include <vector>

namespace nacre {

/// Which joints move a vertex, and how much each.
struct SkinInfluences {
    size_t perVertex = 0;         // 0: no skin
    std::vector<uint32_t> joints; // [vertex][perVertex]
    std::vector<float> weights;   // [vertex][perVertex], at least 0; add up to 1 for a vertex
};

/// Applies an affine transform. Normals follow the inverse transpose, tangents the linear part; a mirroring transform flips the
/// winding and the handedness. Normals and tangents come out unit, or zero where they have no direction. False: a position overflows.
bool transformMesh(TriangleMesh& mesh, const glm::dmat4& worldFromLocal);

/// The same with a transform per vertex: the weighted mean of its joints' matrices (linear blend skinning, glTF 2.0 section 3.7.3.3).
bool skinMesh(TriangleMesh& mesh, const SkinInfluences& influences, std::span<const glm::dmat4> worldFromLocal);

/// Where the vertices of triangles are, in double.
struct Bounds {
    glm::dvec3 low{std::numeric_limits<double>::infinity()}, high{-std::numeric_limits<double>::infinity()};
    void add(const glm::dvec3& p) { low = glm::min(low, p), high = glm::max(high, p); }
};
void addBounds(const TriangleMesh& mesh, const glm::dmat4& worldFromLocal, Bounds& bounds);
void addBounds(const TriangleMesh& mesh, const SkinInfluences& influences, std::span<const glm::dmat4> worldFromLocal, Bounds& bounds);

/// Adds the vertices and triangles of `more`, which has the same optional arrays.
void appendMesh(TriangleMesh& mesh, const TriangleMesh& more);

/// Unit, or zero if `v` has no direction.
glm::vec3 unitOrZero(const glm::dvec3& v);

} // namespace nacre
