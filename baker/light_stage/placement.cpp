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
    glm::dmat4 turn(1.0);
    if (up.z > 0.5f) turn = glm::dmat4(1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1);
    glm::dvec3 center(0.0);
    double radius = 0.0;
    boundingSphere(scene, center, radius);
    for (const glm::vec4& p : hair.controlPoints) // a Bezier curve lies within their hull
        radius = std::max(radius, glm::length(glm::dvec3(p) - center) + double(p.w));
    center = glm::dvec3(turn * glm::dvec4(center, 1.0));
    if (!(radius > 0)) radius = 1.0;

    Placement out;
    out.unitsPerMetre = 1.0 / radius;
    out.stageFromScene = turn;
    for (int column = 0; column < 3; ++column) out.stageFromScene[column] *= out.unitsPerMetre;
    out.stageFromScene[3] = glm::dvec4(-center * out.unitsPerMetre, 1.0);
    if (fit) {
        out.worldFromMesh = out.stageFromScene;
        out.worldFromMesh[3] = out.stageFromScene * glm::dvec4(-scene.origin, 1.0);
    } else {
        out.worldFromMesh = turn;
        out.center = center + glm::dvec3(turn * glm::dvec4(scene.origin, 0.0));
        out.radius = radius;
    }
    return out;
}

void transformMesh(MeshScene& scene, const Placement& placement)
{
    const glm::dmat3 turn = glm::dmat3(placement.stageFromScene) * (1.0 / placement.unitsPerMetre);
    for (TriangleMesh& mesh : scene.meshes) {
        for (glm::vec3& p : mesh.positions) p = glm::vec3(placement.stageFromScene * glm::dvec4(p, 1.0));
        for (glm::vec3& n : mesh.normals) n = glm::vec3(turn * glm::dvec3(n));
        for (glm::vec4& t : mesh.tangents) t = glm::vec4(glm::vec3(turn * glm::dvec3(t)), t.w);
    }
}

Camera onStage(const Camera& camera, const Placement& placement)
{
    Camera out = camera;
    out.worldFromCamera[3] = glm::dvec4((camera.position() - placement.center) / placement.radius, 1.0);
    return out;
}

Light onStage(const Light& light, const Placement& placement)
{
    Light out = light;
    if (light.type != LightType::kPoint) return out; // directions and maps are as they were
    out.position = glm::vec3((glm::dvec3(light.position) - placement.center) / placement.radius);
    out.intensity = glm::vec3(glm::dvec3(light.intensity) / (placement.radius * placement.radius)); // I / r^2 stays
    return out;
}

void transformHair(HairStrands& hair, const Placement& placement)
{
    for (glm::vec4& p : hair.controlPoints)
        p = glm::vec4(glm::vec3(placement.stageFromScene * glm::dvec4(glm::dvec3(p), 1.0)), float(double(p.w) * placement.unitsPerMetre));
}

} // namespace nacre
