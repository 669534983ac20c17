// The bounding sphere is Badoiu and Clarkson's (Smaller Core-Sets for Balls, 2003): the centre walks towards the farthest point by
// 1 / (i + 1) of the way, i = 1, 2, ...; after n steps its radius is within a factor 1 + 1/sqrt(n) of the smallest, on surfaces far closer.
// The walk starts in the middle of the bounding box; the best centre seen is kept, so that it is never worse than that one.
#include "light_stage/placement.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace nacre {

static constexpr int kSphereSteps = 200;

template <class Each>
static void forEachPosition(const MeshScene& scene, Each each)
{
    for (const TriangleMesh& mesh : scene.meshes)
        for (const glm::vec3& p : mesh.positions) each(glm::dvec3(p));
}

static void boundingSphere(const MeshScene& scene, glm::dvec3& center, double& radius)
{
    glm::dvec3 low(std::numeric_limits<double>::infinity()), high(-low);
    forEachPosition(scene, [&](const glm::dvec3& p) { low = glm::min(low, p), high = glm::max(high, p); });
    glm::dvec3 c = 0.5 * (low + high);
    double best2 = std::numeric_limits<double>::infinity();
    for (int i = 1; i <= kSphereSteps; ++i) {
        double farthest2 = -1.0;
        glm::dvec3 farthest(0.0);
        forEachPosition(scene, [&](const glm::dvec3& p) {
            const glm::dvec3 d = p - c;
            if (const double d2 = glm::dot(d, d); d2 > farthest2) farthest2 = d2, farthest = p;
        });
        if (farthest2 < best2) best2 = farthest2, center = c;
        c += (farthest - c) / double(i + 1);
    }
    radius = std::sqrt(best2);
}

Placement placeMesh(const MeshScene& scene, const HairStrands& hair, const glm::vec3& up, bool fit)
{
    assert(scene.triangleCount() > 0);
    Placement out;
    if (up.z > 0.5f) out.worldFromMesh = glm::dmat4(1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1);
    boundingSphere(scene, out.center, out.radius);
    for (const glm::vec4& p : hair.controlPoints) // a Bezier curve lies within their hull
        out.radius = std::max(out.radius, glm::length(glm::dvec3(p) - out.center) + double(p.w));
    out.center = glm::dvec3(out.worldFromMesh * glm::dvec4(out.center, 1.0));
    if (!(out.radius > 0)) out.radius = 1.0;
    if (!fit) return out;
    out.unitsPerMetre = 1.0 / out.radius;
    for (int column = 0; column < 3; ++column) out.worldFromMesh[column] *= out.unitsPerMetre;
    out.worldFromMesh[3] = glm::dvec4(-out.center * out.unitsPerMetre, 1.0);
    out.center = glm::dvec3(0.0);
    out.radius = 1.0;
    return out;
}

void transformMesh(MeshScene& scene, const Placement& placement)
{
    const glm::dmat3 turn = glm::dmat3(placement.worldFromMesh) * (1.0 / placement.unitsPerMetre);
    for (TriangleMesh& mesh : scene.meshes) {
        for (glm::vec3& p : mesh.positions) p = glm::vec3(placement.worldFromMesh * glm::dvec4(p, 1.0));
        for (glm::vec3& n : mesh.normals) n = glm::vec3(turn * glm::dvec3(n));
        for (glm::vec4& t : mesh.tangents) t = glm::vec4(glm::vec3(turn * glm::dvec3(t)), t.w);
    }
}

void transformHair(HairStrands& hair, const Placement& placement)
{
    for (glm::vec4& p : hair.controlPoints)
        p = glm::vec4(glm::vec3(placement.worldFromMesh * glm::dvec4(glm::dvec3(p), 1.0)), float(double(p.w) * placement.unitsPerMetre));
}

} // namespace nacre
