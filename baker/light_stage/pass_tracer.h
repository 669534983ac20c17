// Follows the paths of one pixel, sixteen side by side.
#pragma once

#include "light_stage/environment_light.h"
#include "light_stage/path_vertex.h"
#include "light_stage/sampling.h"
#include "light_stage/shadow_queue.h"

#include <array>

namespace nacre::stage {

/// Lights of one render, split by how they are sampled.
struct LightSet {
    struct Delta {
        bool point;
        glm::vec3 place; // position, or direction to the light
        glm::vec3 intensity;
        size_t image;
        glm::vec3 axis{0.0f}; // of a point, where StageOptics has a beam
        float beam = 0.0f;
    };
    struct Map {
        EnvironmentLight light;
        size_t image;
    };
    std::vector<Delta> deltas;
    std::vector<Map> maps;
};

/// The rays of a pixel: from its top-left corner, in the camera's frame, by the offsets that a step of a pixel right and down makes.
struct PixelRays {
    glm::vec3 corner, right, down;
};
PixelRays raysOf(const Camera& camera, const std::optional<FileCamera>& lens, int x, int y);

/// Fills a set. Errors kBadInput: a map that cannot be read; kUnsupported: a group.
Result<LightSet> gatherLights(std::span<const Light> lights);

struct Counters {
    uint64_t pathRays = 0, shadowRays = 0, walkRays = 0, walks = 0, leaked = 0, cut = 0;
    uint64_t cameraHits = 0, backFaces = 0, holes = 0; // camera rays that met something; that passed a back face first; that then met nothing
    void add(const Counters& c)
    {
        pathRays += c.pathRays, shadowRays += c.shadowRays, walkRays += c.walkRays;
        walks += c.walks, leaked += c.leaked, cut += c.cut;
        cameraHits += c.cameraHits, backFaces += c.backFaces, holes += c.holes;
    }
};

constexpr int kLanes = kSamplesPerPass;

struct Lane {
    bool alive = false, hasVertex = false, entered = false; // entered: something was hit, so an escape is no longer background
    Vertex vertex;
    glm::vec3 origin{0.0f}, direction{0, 0, 1}, throughput{1.0f};
    float nearDistance = 0.0f;
    float pdf = 0.0f;  // of `direction`; 0: the camera's or a straight continuation of it
    int medium = -1;   // material whose medium the ray is in
    int bounces = 0;         // on surfaces
    uint32_t vertices = 0;   // all kinds: numbers the dimensions of the sampler
    uint64_t events = 0;     // collisions in media
    float leastAlpha = kMinAlpha; // of surfaces yet to come, see RenderSettings::indirectRoughness
    PixelSampler sampler;
    Rng rng;
};

/// Follows the 16 paths of a pass. One per thread.
class PassTracer {
public:
    PassTracer(const PathTracer::State& state, const LightSet& lights, const RenderSettings& settings)
        : state_(state), lights_(lights), maxBounces_(settings.maxBounces), indirectAlpha_(std::max(kMinAlpha, sqr(settings.indirectRoughness)))
    {
    }

    /// Adds the pass's radiance, summed over its samples, to `radiance` (3 floats per image); returns how many samples hit the object.
    float trace(const Camera& camera, const PixelRays& rays, uint32_t passSeed, float* radiance);

    Counters counters;

private:
    void advance(Lane& lane, float* radiance);
    bool collide(Lane& lane, const Body& body);
    void escape(Lane& lane, float* radiance);
    bool meet(Lane& lane, const RayHit& hit);
    void noteBackFaces(const RayHit& hit);
    void enterObject(Lane& lane);
    RayHit meetAny(const Lane& lane, float nearDistance, float farDistance);
    void enterMedium(Lane& lane, const SurfacePoint& surface);
    void lightDeltas(bool coherent, float* radiance);
    void lightMaps(float* radiance);
    void scatter(Lane& lane);
    bool leaveAsWalk(Lane& lane);
    glm::vec3 transmittance(glm::vec3 origin, const glm::vec3& direction, float nearDistance, float distance, int medium);

    const PathTracer::State& state_;
    const LightSet& lights_;
    const int maxBounces_;
    const float indirectAlpha_;
    std::array<Lane, kLanes> lanes_;
    float coverage_ = 0.0f;
    ShadowQueue queue_;

    // The vertices of this round, ready for the shadow loop. Lambertian ones are `plain`: f cos = weight * max(0, n.w).
    struct alignas(32) Rows {
        float ox[kLanes], oy[kLanes], oz[kLanes];       // shadow ray origins
        float nx[kLanes], ny[kLanes], nz[kLanes];       // shading normals
        float gx[kLanes], gy[kLanes], gz[kLanes];       // SurfaceBsdf::above
        float r[kLanes], g[kLanes], b[kLanes];          // plain: throughput * albedo / pi
        bool plain[kLanes], lit[kLanes];
    } rows_;
};

} // namespace nacre::stage
