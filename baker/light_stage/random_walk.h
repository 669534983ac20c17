// Subsurface scattering by a random walk through the body beneath a surface (Chiang, Kutz and Burley 2016): light goes in with a
// cosine distribution, scatters, and comes out wherever it meets the surface from inside. Only triangles of the same material end
// the walk, so that what touches or pierces the body does not cut it. Channels with different mean free paths share one walk.
#pragma once

#include "light_stage/medium.h"
#include "light_stage/ray_scene.h"

namespace nacre::stage {

constexpr uint64_t kMaxWalkSteps = 10000;
constexpr uint64_t kWalkRouletteStart = 16;

enum class WalkEnd : uint8_t { kLeft, kAbsorbed, kLeaked, kCut };

struct WalkResult {
    WalkEnd end = WalkEnd::kAbsorbed;
    RayHit hit;             // kLeft: where
    glm::vec3 outward{0.0f}; // a direction on the outer side of that surface
    glm::vec3 weight{1.0f};
    uint64_t steps = 0;
};

/// `entry`: just beneath the surface; `normal`: geometric, outward, unit.
inline WalkResult randomWalk(const RayScene::Body& body, const Medium& medium, const glm::vec3& entry, const glm::vec3& normal, Rng& rng)
{
    WalkResult walk;
    glm::vec3 p = entry;
    glm::vec3 d = Frame::around(-normal).toWorld(sampleCosine(rng.next2()));
    while (walk.steps < kMaxWalkSteps) {
        const DistanceSampler distances(medium, walk.weight);
        const float event = distances.sample(medium, rng);
        const RayHit hit = body.intersect(p, d, event);
        ++walk.steps;
        if (hit.found()) {
            walk.weight *= distances.weightToSurface(medium, hit.distance);
            walk.hit = hit;
            walk.outward = d;
            walk.end = WalkEnd::kLeft;
            return walk;
        }
        p += d * event;
        if (!body.encloses(p)) { // through a hole; catches an endless step too
            walk.end = WalkEnd::kLeaked;
            return walk;
        }
        walk.weight *= distances.weightToScatter(medium, event);
        d = sampleHenyeyGreenstein(d, medium.g, rng.next2());
        if (walk.steps < kWalkRouletteStart) continue;
        const float q = std::min(1.0f, maxOf(walk.weight));
        if (!(q > 0.0f) || rng.next() >= q) return walk; // kAbsorbed
        walk.weight /= q;
    }
    walk.end = WalkEnd::kCut;
    return walk;
}

} // namespace nacre::stage
