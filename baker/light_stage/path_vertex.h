// Where a path gathers light: on a surface, where it leaves a random walk, inside a medium, on a fibre.
#pragma once

#include "light_stage/tracer_state.h"

namespace nacre::stage {

// Cosine to the triangle from which rays begin at the triangle itself, so that shadows of what touches it stay whole.
constexpr float kFullLight = 0.1f;

enum class VertexKind : uint8_t { kSurface, kWalkExit, kPhase, kFiber };

/// Where light is gathered. Directions point away from the vertex.
struct Vertex {
    VertexKind kind = VertexKind::kSurface;
    glm::vec3 position{0.0f}, ng{0, 0, 1}; // ng on the side the path came from (kSurface) or goes to (kWalkExit)
    glm::vec3 throughput{1.0f};
    SurfacePoint surface;                  // kSurface, kWalkExit
    bool rougherForLamps = false;          // kSurface, kFiber: lamps without size see lampBsdf, lampHair instead
    SurfaceBsdf lampBsdf;
    glm::vec3 travel{0, 0, 1};             // kPhase: direction before scattering
    int medium = -1;                       // kPhase: the medium it lies in
    HairHit hair, lampHair;                // kFiber, with their frame: t along the fibre
    Frame fiberFrame;
    float nearDistance = 0.0f;             // kFiber: rays from here do not see what is nearer, the fibre itself

    bool onSurface() const { return kind == VertexKind::kSurface || kind == VertexKind::kWalkExit; }
    int mediumAround() const { return kind == VertexKind::kPhase ? medium : -1; }
    /// Where a ray towards `w` begins: off the triangle by `offset`; almost along it or below, from the surface that bulges over it.
    glm::vec3 originTowards(const glm::vec3& w, float offset) const
    {
        if (!onSurface()) return position;
        if (!(glm::dot(w, surface.bsdf.above) > 0.0f)) return position - ng * offset;
        return position + ng * offset + surface.lift * glm::clamp(1.0f - glm::dot(w, ng) / kFullLight, 0.0f, 1.0f);
    }
    float reachFrom() const { return kind == VertexKind::kFiber ? nearDistance : 0.0f; }
    /// f |cos| towards wi.
    glm::vec3 evaluate(const glm::vec3& wi, const PathTracer::State& state) const;
    glm::vec3 evaluateForLamp(const glm::vec3& wi, const PathTracer::State& state) const
    {
        if (!rougherForLamps || kind == VertexKind::kPhase || kind == VertexKind::kWalkExit) return evaluate(wi, state);
        return kind == VertexKind::kFiber ? hairEval(lampHair, fiberFrame.toLocal(wi)) : lampBsdf.evaluate(wi);
    }
    /// Density with which scatter() draws wi.
    float pdf(const glm::vec3& wi, const PathTracer::State& state) const;
};

inline glm::vec3 Vertex::evaluate(const glm::vec3& wi, const PathTracer::State& state) const
{
    if (kind == VertexKind::kPhase)
        return glm::vec3(henyeyGreenstein(glm::dot(travel, wi), state.surfaces->body(medium).medium.g));
    if (kind == VertexKind::kSurface) return surface.bsdf.evaluate(wi);
    if (kind == VertexKind::kFiber) return hairEval(hair, fiberFrame.toLocal(wi));
    const float cosine = glm::dot(surface.bsdf.frame.n, wi);
    if (!(cosine > 0.0f) || !(glm::dot(surface.bsdf.above, wi) > 0.0f)) return glm::vec3(0.0f);
    return glm::vec3(kInvPi * cosine * walkExitFactor(surface.bsdf, cosine));
}

inline float Vertex::pdf(const glm::vec3& wi, const PathTracer::State& state) const
{
    if (kind == VertexKind::kPhase) return henyeyGreenstein(glm::dot(travel, wi), state.surfaces->body(medium).medium.g);
    if (kind == VertexKind::kSurface) return (1.0f - surface.chanceSubsurface) * surface.bsdf.pdf(wi);
    if (kind == VertexKind::kFiber) return hairPdf(hair, fiberFrame.toLocal(wi));
    return std::max(0.0f, glm::dot(surface.bsdf.frame.n, wi)) * kInvPi;
}

/// A ribbon that faces the ray stands for the round fibre; the offset across it says where the fibre was met.
void makeFiberVertex(const PathTracer::State& state, const RayHit& hit, const glm::vec3& position, const glm::vec3& wo, bool indirect, Vertex& v);

} // namespace nacre::stage
