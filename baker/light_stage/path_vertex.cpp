#include "light_stage/path_vertex.h"

#include <algorithm>

namespace nacre::stage {

void makeFiberVertex(const PathTracer::State& state, const RayHit& hit, const glm::vec3& position, const glm::vec3& wo, bool indirect, Vertex& v)
{
    const HairStrands& hair = state.scene.hair;
    const glm::vec4* c = hair.controlPoints.data() + 4 * size_t(hit.primitive);
    const float t = hit.u, s = 1.0f - t;
    const glm::vec4 at = s * s * s * c[0] + 3.0f * s * s * t * c[1] + 3.0f * s * t * t * c[2] + t * t * t * c[3];
    glm::vec3 along(s * s * (c[1] - c[0]) + 2.0f * s * t * (c[2] - c[1]) + t * t * (c[3] - c[2]));
    if (!(glm::dot(along, along) > 0.0f)) along = glm::vec3(c[3] - c[0]);
    along = glm::normalize(along);
    const glm::vec3 across = glm::cross(along, wo);
    const float length = glm::length(across), radius = std::max(at.w, 1e-12f);
    const float h = length > 1e-6f ? -glm::dot(position - glm::vec3(at), across) / (length * radius) : 0.0f;
    v.kind = VertexKind::kFiber;
    v.position = position;
    v.ng = wo;
    v.fiberFrame = length > 1e-6f ? Frame{along, glm::cross(across / length, along), across / length} : Frame::around(along);
    if (!(length > 1e-6f)) v.fiberFrame = {along, v.fiberFrame.t, v.fiberFrame.b};
    const glm::vec3 sigmaA = hairAbsorption(hair.colors[hit.primitive], hair.azimuthalRoughness), local = v.fiberFrame.toLocal(wo);
    v.hair = makeHairHit(state.fiber, h, sigmaA, local);
    v.rougherForLamps = indirect;
    if (indirect) v.lampHair = makeHairHit(state.indirectFiber, h, sigmaA, local);
    v.nearDistance = 2.5f * radius; // from one side of the ribbon to the other, and a little for the bend
}

} // namespace nacre::stage
