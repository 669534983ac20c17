// The repairs of a triangle mesh.
#include "mesh/mesh_repair.h"

#include "mesh/mesh_transform.h"

#include <algorithm>

namespace nacre {
namespace {

constexpr double kLeastArea = 1e-19; // |e1 x e2| over the mesh's size squared

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

size_t dropZeroAreaTriangles(TriangleMesh& mesh)
{
    Bounds bounds;
    addBounds(mesh, glm::dmat4(1.0), bounds);
    const double size = glm::length(bounds.high - bounds.low), least = kLeastArea * size * size;
    return std::erase_if(mesh.triangles, [&](const glm::uvec3& t) {
        const glm::dvec3 n = crossOfEdges(mesh, t);
        return !(glm::length(n) >= least && glm::length(n) > 0.0);
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

size_t countBackwardTriangles(const TriangleMesh& mesh)
{
    if (mesh.normals.empty()) return 0;
    return size_t(std::count_if(mesh.triangles.begin(), mesh.triangles.end(), [&](const glm::uvec3& t) {
        const glm::dvec3 n = crossOfEdges(mesh, t);
        return glm::dot(n, glm::dvec3(mesh.normals[t.x])) < 0 && glm::dot(n, glm::dvec3(mesh.normals[t.y])) < 0 && glm::dot(n, glm::dvec3(mesh.normals[t.z])) < 0;
    }));
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
