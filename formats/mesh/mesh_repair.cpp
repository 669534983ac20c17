// Affine placement and the repairs of a triangle mesh.
#include "mesh/mesh_repair.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre {
namespace {

/// Unit, or zero if `v` has no direction.
glm::vec3 unitOrZero(const glm::dvec3& v)
{
    // Scaled first: squares of very large or small components would overflow or vanish.
    const double largest = std::max({std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)});
    if (!(largest > 0) || !std::isfinite(largest)) return glm::vec3(0.0f);
    return glm::vec3(glm::normalize(v / largest));
}

glm::dvec3 crossOfEdges(const TriangleMesh& mesh, const glm::uvec3& t)
{
    const glm::dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    return glm::cross(b - a, c - a);
}

template <class T>
void keepRows(std::vector<T>& rows, const std::vector<uint32_t>& kept)
{
    if (rows.empty()) return;
    for (size_t i = 0; i < kept.size(); ++i) rows[i] = rows[kept[i]]; // kept[i] >= i
    rows.resize(kept.size());
    rows.shrink_to_fit();
}

} // namespace

bool transformMesh(TriangleMesh& mesh, const glm::dmat4& worldFromLocal)
{
    const glm::dmat3 linear(worldFromLocal);
    const glm::dvec3 origin(worldFromLocal[3]);
    const double side = glm::determinant(linear) < 0 ? -1.0 : 1.0;
    // Columns of det * inverse transpose: no division, so that a transform that flattens the mesh has normals too.
    const glm::dmat3 cofactor(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]), glm::cross(linear[0], linear[1]));

    bool finite = true;
    for (glm::vec3& p : mesh.positions) {
        p = glm::vec3(linear * glm::dvec3(p) + origin);
        finite = finite && std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
    }
    for (glm::vec3& n : mesh.normals) n = unitOrZero(side * (cofactor * glm::dvec3(n)));
    for (glm::vec4& t : mesh.tangents) t = glm::vec4(unitOrZero(linear * glm::dvec3(t)), (t.w < 0 ? -1.0f : 1.0f) * float(side));
    if (side < 0)
        for (glm::uvec3& t : mesh.triangles) std::swap(t.y, t.z);
    return finite;
}

size_t dropZeroAreaTriangles(TriangleMesh& mesh)
{
    return std::erase_if(mesh.triangles, [&](const glm::uvec3& t) {
        const glm::dvec3 n = crossOfEdges(mesh, t);
        return !(glm::dot(n, n) >= double(std::numeric_limits<float>::min()));
    });
}

size_t replaceZeroNormals(TriangleMesh& mesh)
{
    const auto isZero = [](const glm::vec3& n) { return n == glm::vec3(0.0f); };
    if (std::none_of(mesh.normals.begin(), mesh.normals.end(), isZero)) return 0;
    std::vector<glm::dvec3> sums(mesh.positions.size(), glm::dvec3(0.0));
    std::vector<glm::vec3> anyFace(mesh.positions.size(), glm::vec3(0, 0, 1)); // where faces cancel; and at vertices without faces
    for (const glm::uvec3& t : mesh.triangles) {
        const glm::dvec3 n = crossOfEdges(mesh, t);
        for (int k = 0; k < 3; ++k)
            if (isZero(mesh.normals[t[k]])) sums[t[k]] += n, anyFace[t[k]] = unitOrZero(n);
    }
    size_t replaced = 0;
    for (size_t i = 0; i < mesh.normals.size(); ++i) {
        if (!isZero(mesh.normals[i])) continue;
        mesh.normals[i] = unitOrZero(sums[i]);
        if (isZero(mesh.normals[i])) mesh.normals[i] = anyFace[i];
        ++replaced;
    }
    return replaced;
}

void dropUnusedVertices(TriangleMesh& mesh)
{
    constexpr uint32_t kUnused = ~0u;
    std::vector<uint32_t> newIndex(mesh.positions.size(), kUnused);
    for (const glm::uvec3& t : mesh.triangles)
        for (int k = 0; k < 3; ++k) newIndex[t[k]] = 0;
    std::vector<uint32_t> kept;
    for (size_t i = 0; i < newIndex.size(); ++i)
        if (newIndex[i] != kUnused) newIndex[i] = uint32_t(kept.size()), kept.push_back(uint32_t(i));
    if (kept.size() == mesh.positions.size()) return;

    keepRows(mesh.positions, kept);
    keepRows(mesh.normals, kept);
    keepRows(mesh.tangents, kept);
    keepRows(mesh.texcoords[0], kept);
    keepRows(mesh.texcoords[1], kept);
    keepRows(mesh.colors, kept);
    for (glm::uvec3& t : mesh.triangles) t = {newIndex[t.x], newIndex[t.y], newIndex[t.z]};
}

} // namespace nacre
