// Per-vertex tangents from texture coordinates.
//
// A triangle with edges e1, e2 and texture edges (u1, v1), (u2, v2) has the tangent dP/du = (e1 v2 - e2 v1) / (u1 v2 - u2 v1)
// (Lengyel, "Computing Tangent Space Basis Vectors for an Arbitrary Mesh", 2001). A vertex gets the sum over its triangles of
// dP/du, projected onto the plane of the normal, normalised and weighted by the angle at the corner: the rule of MikkTSpace
// (Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008) on the vertices as they are, without its welding of equal vertices.
#include "mesh/tangents.h"

#include <algorithm>
#include <cmath>

namespace nacre {
namespace {

glm::dvec3 normalizeOrZero(const glm::dvec3& v)
{
    const double length = glm::length(v);
    return length > 0 ? v / length : glm::dvec3(0.0);
}

double angleBetween(const glm::dvec3& a, const glm::dvec3& b) { return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)); }

glm::dvec3 faceNormal(const TriangleMesh& mesh, const glm::uvec3& t)
{
    const glm::dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    return normalizeOrZero(glm::cross(b - a, c - a));
}

/// Twice the signed area in the texture; positive where u and v turn like the vertices.
double textureArea(const std::vector<glm::dvec2>& uv, const glm::uvec3& t)
{
    const glm::dvec2 d1 = uv[t.y] - uv[t.x], d2 = uv[t.z] - uv[t.x];
    return d1.x * d2.y - d2.x * d1.y;
}

template <class T>
void repeatRows(std::vector<T>& rows, const std::vector<uint32_t>& sources)
{
    if (rows.empty()) return;
    rows.reserve(rows.size() + sources.size());
    for (uint32_t i : sources) rows.push_back(rows[i]);
}

/// Gives every vertex triangles of one handedness only, and returns that handedness.
std::vector<float> splitMirroredVertices(TriangleMesh& mesh, std::vector<glm::dvec2>& uv)
{
    const auto sideOf = [&](const glm::uvec3& t) {
        const double area = textureArea(uv, t);
        return area == 0 ? 0 : area < 0 ? 1 : 2; // +1 where v falls along the bitangent
    };
    std::vector<uint8_t> sides(mesh.positions.size(), 0);
    for (const glm::uvec3& t : mesh.triangles)
        for (int k = 0; k < 3; ++k) sides[t[k]] |= uint8_t(sideOf(t));

    std::vector<uint32_t> copies, copyOf(mesh.positions.size(), 0);
    for (size_t i = 0; i < sides.size(); ++i)
        if (sides[i] == 3) copyOf[i] = uint32_t(mesh.positions.size() + copies.size()), copies.push_back(uint32_t(i));
    std::vector<float> handedness(sides.size());
    for (size_t i = 0; i < sides.size(); ++i) handedness[i] = sides[i] == 2 ? -1.0f : 1.0f;
    if (copies.empty()) return handedness;

    for (glm::uvec3& t : mesh.triangles)
        if (sideOf(t) == 2)
            for (int k = 0; k < 3; ++k)
                if (sides[t[k]] == 3) t[k] = copyOf[t[k]];
    repeatRows(mesh.positions, copies);
    repeatRows(mesh.normals, copies);
    for (auto& set : mesh.texcoords) repeatRows(set, copies);
    repeatRows(mesh.colors, copies);
    repeatRows(uv, copies);
    handedness.resize(mesh.positions.size(), -1.0f);
    return handedness;
}

/// Any unit vector across `n` (Duff et al., "Building an Orthonormal Basis, Revisited", 2017).
glm::dvec3 anyAcross(const glm::dvec3& n)
{
    const double sign = std::copysign(1.0, n.z), a = -1.0 / (sign + n.z), b = n.x * n.y * a;
    return {1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x};
}

} // namespace

void makeTangents(TriangleMesh& mesh, const TextureSlot& slot)
{
    const std::vector<glm::vec2>& set = mesh.texcoords[slot.texcoord];
    std::vector<glm::dvec2> uv(mesh.positions.size(), glm::dvec2(0.0));
    for (size_t i = 0; i < set.size(); ++i) uv[i] = glm::dmat2(slot.uvScaleRotate) * glm::dvec2(set[i]); // the offset cancels
    const std::vector<float> handedness = splitMirroredVertices(mesh, uv);

    std::vector<glm::dvec3> sums(mesh.positions.size(), glm::dvec3(0.0)), faceNormals;
    if (mesh.normals.empty()) faceNormals.resize(mesh.positions.size(), glm::dvec3(0, 0, 1));
    for (const glm::uvec3& t : mesh.triangles) {
        const double area = textureArea(uv, t);
        if (mesh.normals.empty())
            for (int k = 0; k < 3; ++k) faceNormals[t[k]] = faceNormal(mesh, t);
        if (area == 0) continue;
        const glm::dvec3 a(mesh.positions[t.x]), e1 = glm::dvec3(mesh.positions[t.y]) - a, e2 = glm::dvec3(mesh.positions[t.z]) - a;
        const glm::dvec3 dPdu = (e1 * (uv[t.z].y - uv[t.x].y) - e2 * (uv[t.y].y - uv[t.x].y)) * (area < 0 ? -1.0 : 1.0);
        for (int k = 0; k < 3; ++k) {
            const glm::dvec3 n = mesh.normals.empty() ? faceNormals[t[k]] : glm::dvec3(mesh.normals[t[k]]);
            const glm::dvec3 corner(mesh.positions[t[k]]);
            const double angle = angleBetween(glm::dvec3(mesh.positions[t[(k + 1) % 3]]) - corner, glm::dvec3(mesh.positions[t[(k + 2) % 3]]) - corner);
            sums[t[k]] += angle * normalizeOrZero(dPdu - n * glm::dot(n, dPdu));
        }
    }

    mesh.tangents.resize(mesh.positions.size());
    for (size_t i = 0; i < mesh.tangents.size(); ++i) {
        const glm::dvec3 n = mesh.normals.empty() ? faceNormals[i] : glm::dvec3(mesh.normals[i]);
        const glm::dvec3 t = normalizeOrZero(sums[i] - n * glm::dot(n, sums[i]));
        mesh.tangents[i] = glm::vec4(t == glm::dvec3(0.0) ? anyAcross(n) : t, handedness[i]);
    }
}

} // namespace nacre
