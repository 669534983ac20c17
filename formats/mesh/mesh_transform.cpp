// Affine placement, linear blend skinning, and joining of copies.
#include "mesh/mesh_transform.h"

#include <algorithm>
#include <cmath>

namespace nacre {
namespace {

glm::dmat4 blend(const SkinInfluences& influences, std::span<const glm::dmat4> matrices, size_t vertex)
{
    glm::dmat4 sum(0.0);
    for (size_t k = vertex * influences.perVertex; k < (vertex + 1) * influences.perVertex; ++k)
        if (influences.weights[k] > 0.0f) sum += double(influences.weights[k]) * matrices[influences.joints[k]];
    return sum;
}

glm::dvec3 moved(const glm::dmat4& m, const glm::vec3& p) { return glm::dmat3(m) * glm::dvec3(p) + glm::dvec3(m[3]); }

bool isMirror(const glm::dmat4& m) { return glm::determinant(glm::dmat3(m)) < 0; }

/// `matrixOf(i)`: where vertex i goes. A triangle is mirrored if its first vertex is.
template <class MatrixOf>
bool place(TriangleMesh& mesh, MatrixOf matrixOf)
{
    for (glm::uvec3& t : mesh.triangles)
        if (isMirror(matrixOf(t.x))) std::swap(t.y, t.z);
    bool finite = true;
    for (size_t i = 0; i < mesh.positions.size(); ++i) {
        const glm::dmat4 m = matrixOf(i);
        glm::vec3& p = mesh.positions[i];
        p = glm::vec3(moved(m, p));
        finite = finite && std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
        if (mesh.normals.empty()) continue;
        const glm::dmat3 linear(m);
        const double side = isMirror(m) ? -1.0 : 1.0;
        // Columns of det * inverse transpose: no division, so that a transform that flattens the mesh has normals too.
        const glm::dmat3 cofactor(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]), glm::cross(linear[0], linear[1]));
        mesh.normals[i] = unitOrZero(side * (cofactor * glm::dvec3(mesh.normals[i])));
        if (mesh.tangents.empty()) continue;
        glm::vec4& t = mesh.tangents[i];
        t = glm::vec4(unitOrZero(linear * glm::dvec3(t)), (t.w < 0 ? -1.0f : 1.0f) * float(side));
    }
    return finite;
}

template <class MatrixOf>
void addPlaced(const TriangleMesh& mesh, MatrixOf matrixOf, Bounds& bounds)
{
    for (const glm::uvec3& t : mesh.triangles)
        for (int k = 0; k < 3; ++k) bounds.add(moved(matrixOf(t[k]), mesh.positions[t[k]]));
}

} // namespace

glm::vec3 unitOrZero(const glm::dvec3& v)
{
    // Scaled first: squares of very large or small components would overflow or vanish.
    const double largest = std::max({std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)});
    if (!(largest > 0) || !std::isfinite(largest)) return glm::vec3(0.0f);
    return glm::vec3(glm::normalize(v / largest));
}

bool transformMesh(TriangleMesh& mesh, const glm::dmat4& worldFromLocal)
{
    return place(mesh, [&](size_t) -> const glm::dmat4& { return worldFromLocal; });
}

bool skinMesh(TriangleMesh& mesh, const SkinInfluences& influences, std::span<const glm::dmat4> worldFromLocal)
{
    return place(mesh, [&](size_t i) { return blend(influences, worldFromLocal, i); });
}

void addBounds(const TriangleMesh& mesh, const glm::dmat4& worldFromLocal, Bounds& bounds)
{
    addPlaced(mesh, [&](size_t) -> const glm::dmat4& { return worldFromLocal; }, bounds);
}

void addBounds(const TriangleMesh& mesh, const SkinInfluences& influences, std::span<const glm::dmat4> worldFromLocal, Bounds& bounds)
{
    addPlaced(mesh, [&](size_t i) { return blend(influences, worldFromLocal, i); }, bounds);
}

void appendMesh(TriangleMesh& mesh, const TriangleMesh& more)
{
    const auto append = [](auto& rows, const auto& added) { rows.insert(rows.end(), added.begin(), added.end()); };
    const uint32_t first = uint32_t(mesh.positions.size());
    append(mesh.positions, more.positions);
    append(mesh.normals, more.normals);
    append(mesh.tangents, more.tangents);
    for (int set = 0; set < 2; ++set) append(mesh.texcoords[set], more.texcoords[set]);
    append(mesh.colors, more.colors);
    for (const glm::uvec3& t : more.triangles) mesh.triangles.push_back(t + first);
}

} // namespace nacre
