// The integrator of the light stage.
//
// A pass follows 16 paths of one pixel side by side. At every vertex of every path, all lights are asked: a light without size (point,
// directional) needs one shadow ray and no random number, so the image of a light is the same whichever lights share the pass.
// Environment maps are sampled by radiance and by the surface, combined with the power heuristic (Veach and Guibas 1995).
//
// A path moves through states: a ray (advance() finds the next vertex, through clear surfaces and media) or a vertex (it is lit, then
// scatter() draws the next ray, or a random walk whose exit is the next vertex). Russian roulette weighs survivors by 1/q: no bias.
#include "light_stage/path_tracer.h"

#include "base/hash.h"
#include "interchange/exr.h"
#include "light_stage/environment_light.h"
#include "light_stage/film.h"
#include "light_stage/hair_bsdf.h"
#include "light_stage/random_walk.h"
#include "light_stage/shadow_queue.h"
#include "light_stage/surface.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <mutex>

namespace nacre {

using namespace stage;

struct PathTracer::State {
    StageScene scene;
    std::vector<std::string> warnings;
    std::unique_ptr<RayScene> rays;
    std::unique_ptr<SurfaceTable> surfaces;
    HairFiber fiber, indirectFiber; // the second: at least kIndirectFiberRoughness, see RenderSettings::indirectRoughness
    float offset = 0.0f; // rays start this far off a surface: more than the rounding of coordinates
    float sheetAt(float distance) const { return offset + 1e-6f * distance; } // within it, surfaces are two sides of one sheet: rounding of both
    bool isFiber(const RayHit& hit) const { return hit.mesh == scene.mesh.meshes.size(); }
};

namespace {

constexpr int kLanes = kSamplesPerPass;
constexpr uint32_t kRouletteStart = 3; // vertices before paths may end by chance
constexpr float kNarrowDensity = 2.0f; // per steradian: a bounce of lower density counts as diffuse (cosine lobe: 0.32 at most)
// Both roughnesses of a fibre seen by another, towards lamps without size. Measured on brown fur (beta 0.3) under a lamp: half of the
// variance, means within 3 %; at 0.6 a fifth of it, but means 10 to 20 % off.
constexpr float kIndirectFiberRoughness = 0.4f;
// Cosine to the triangle from which rays begin at the triangle itself, so that shadows of what touches it stay whole.
constexpr float kFullLight = 0.1f;
constexpr int kMaxClearSurfaces = 256; // straight through alpha and index-matched surfaces, per ray

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

} // namespace

glm::vec3 Vertex::evaluate(const glm::vec3& wi, const PathTracer::State& state) const
{
    if (kind == VertexKind::kPhase)
        return glm::vec3(henyeyGreenstein(glm::dot(travel, wi), state.surfaces->body(medium).medium.g));
    if (kind == VertexKind::kSurface) return surface.bsdf.evaluate(wi);
    if (kind == VertexKind::kFiber) return hairEval(hair, fiberFrame.toLocal(wi));
    const float cosine = glm::dot(surface.bsdf.frame.n, wi);
    if (!(cosine > 0.0f) || !(glm::dot(surface.bsdf.above, wi) > 0.0f)) return glm::vec3(0.0f);
    return glm::vec3(kInvPi * cosine * walkExitFactor(surface.bsdf, cosine));
}

float Vertex::pdf(const glm::vec3& wi, const PathTracer::State& state) const
{
    if (kind == VertexKind::kPhase) return henyeyGreenstein(glm::dot(travel, wi), state.surfaces->body(medium).medium.g);
    if (kind == VertexKind::kSurface) return (1.0f - surface.chanceSubsurface) * surface.bsdf.pdf(wi);
    if (kind == VertexKind::kFiber) return hairPdf(hair, fiberFrame.toLocal(wi));
    return std::max(0.0f, glm::dot(surface.bsdf.frame.n, wi)) * kInvPi;
}

namespace {

/// A ribbon that faces the ray stands for the round fibre; the offset across it says where the fibre was met.
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

/// Lights of one render, split by how they are sampled.
struct LightSet {
    struct Delta {
        bool point;
        glm::vec3 place; // position, or direction to the light
        glm::vec3 intensity;
        size_t image;
    };
    struct Map {
        EnvironmentLight light;
        size_t image;
    };
    std::vector<Delta> deltas;
    std::vector<Map> maps;
};

/// Follows the 16 paths of a pass. One per thread.
class PassTracer {
public:
    PassTracer(const PathTracer::State& state, const LightSet& lights, const RenderSettings& settings)
        : state_(state), lights_(lights), maxBounces_(settings.maxBounces), indirectAlpha_(std::max(kMinAlpha, sqr(settings.indirectRoughness)))
    {
    }

    /// Adds the pass's radiance, summed over its samples, to `radiance` (3 floats per image); returns how many samples hit the object.
    float trace(const Camera& camera, int x, int y, uint32_t passSeed, float* radiance);

    Counters counters;

private:
    void advance(Lane& lane, float* radiance);
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

float PassTracer::trace(const Camera& camera, int x, int y, uint32_t passSeed, float* radiance)
{
    coverage_ = 0.0f;
    const glm::vec3 eye(camera.position());
    const glm::mat3 rotation(camera.worldFromCamera);
    const glm::vec3 corner(float((x - camera.cx) / camera.fx), float((camera.cy - y) / camera.fy), -1.0f);
    const float pixelWidth = float(1.0 / camera.fx), pixelHeight = float(1.0 / camera.fy);
    for (int i = 0; i < kLanes; ++i) {
        Lane& lane = lanes_[size_t(i)];
        lane.sampler = {passSeed, uint32_t(i)};
        lane.rng = Rng((uint64_t(passSeed) << 32) | hashBits(uint32_t(i) + 0x51ed270bu));
        const glm::vec2 jitter = lane.sampler.get2(0);
        lane.origin = eye;
        lane.direction = glm::normalize(rotation * glm::vec3(corner.x + jitter.x * pixelWidth, corner.y - jitter.y * pixelHeight, corner.z));
        lane.throughput = glm::vec3(1.0f);
        lane.pdf = lane.nearDistance = 0.0f;
        lane.medium = -1;
        lane.bounces = 0;
        lane.vertices = 0;
        lane.events = 0;
        lane.leastAlpha = kMinAlpha;
        lane.alive = true;
        lane.hasVertex = lane.entered = false;
    }
    for (bool coherent = true;; coherent = false) {
        bool any = false;
        for (Lane& lane : lanes_) {
            if (lane.alive && !lane.hasVertex) advance(lane, radiance);
            any = any || lane.alive;
        }
        if (!any) return coverage_;
        if (!lights_.deltas.empty()) lightDeltas(coherent, radiance);
        if (!lights_.maps.empty()) lightMaps(radiance);
        for (Lane& lane : lanes_)
            if (lane.alive) scatter(lane);
    }
}

/// From a ray to the next vertex. The lane dies if there is none.
void PassTracer::advance(Lane& lane, float* radiance)
{
    for (int clear = 0; clear < kMaxClearSurfaces; ++clear) {
        const Body* body = lane.medium >= 0 ? &state_.surfaces->body(lane.medium) : nullptr;
        const bool scattering = body && body->medium.scatters();
        float event = kInfinity;
        DistanceSampler distances(body ? body->medium : Medium{}, lane.throughput);
        if (scattering) event = distances.sample(body->medium, lane.rng);
        const float nearDistance = std::min(lane.nearDistance, event);
        const bool firstMet = !lane.entered && clear == 0; // of the camera's ray
        const RayHit hit = lane.entered ? meetAny(lane, nearDistance, event) : state_.rays->intersectFront(lane.origin, lane.direction, nearDistance, event);
        lane.nearDistance = 0.0f;
        ++counters.pathRays;

        if (!hit.found() && event < kInfinity) { // scattered inside the medium
            lane.throughput *= distances.weightToScatter(body->medium, event);
            lane.origin += lane.direction * event;
            const bool leaked = !state_.rays->everything().encloses(lane.origin), cut = ++lane.events > kMaxWalkSteps;
            if (leaked || cut) {
                counters.leaked += leaked;
                counters.cut += !leaked;
                lane.alive = false;
                return;
            }
            if (body->invisible) { // light reaches this point straight through the boundary: a vertex
                Vertex& v = lane.vertex;
                v.kind = VertexKind::kPhase;
                v.position = lane.origin;
                v.travel = lane.direction;
                v.medium = lane.medium;
                v.throughput = lane.throughput;
                lane.hasVertex = true;
                return;
            }
            // Behind a refracting boundary no lamp can be joined by a straight line: walk on to the boundary.
            lane.direction = sampleHenyeyGreenstein(lane.direction, body->medium.g, lane.rng.next2());
            lane.pdf = 0.0f;
            lane.leastAlpha = indirectAlpha_;
            const float q = std::min(1.0f, maxOf(lane.throughput));
            if (!(q > 0.0f) || lane.rng.next() >= q) {
                lane.alive = false;
                return;
            }
            lane.throughput /= q;
            --clear;
            continue;
        }
        if (!hit.found()) { // escaped
            if (firstMet && hit.backFace < kInfinity) ++counters.backFaces, ++counters.holes;
            if (lane.entered)
                for (const LightSet::Map& map : lights_.maps) {
                    float weight = 1.0f;
                    if (lane.pdf > 0.0f) weight = sqr(lane.pdf) / (sqr(lane.pdf) + sqr(map.light.pdf(lane.direction)));
                    const glm::vec3 add = lane.throughput * map.light.radiance(lane.direction) * weight;
                    addTo(radiance + 3 * map.image, add);
                }
            lane.alive = false;
            return;
        }
        if (firstMet && hit.backFace < hit.distance - state_.sheetAt(hit.distance)) ++counters.backFaces;
        if (body) lane.throughput *= scattering ? distances.weightToSurface(body->medium, hit.distance) : glm::exp(-body->medium.sigmaT * hit.distance);

        Vertex& v = lane.vertex;
        v.throughput = lane.throughput;
        if (state_.isFiber(hit)) {
            enterObject(lane);
            lane.hasVertex = true;
            makeFiberVertex(state_, hit, lane.origin + lane.direction * hit.distance, -lane.direction, lane.leastAlpha > kMinAlpha, v);
            return;
        }
        v.surface = state_.surfaces->evaluate(state_.scene.mesh, hit, -lane.direction, lane.leastAlpha);
        const Body& here = state_.surfaces->body(v.surface.material);
        v.rougherForLamps = here.boundary && lane.leastAlpha > kMinAlpha; // evaluate() left it as it is
        if (v.rougherForLamps) {
            v.lampBsdf = v.surface.bsdf;
            v.lampBsdf.roughen(lane.leastAlpha);
        }
        const glm::vec3 straightOn = v.surface.position - v.surface.bsdf.ng * state_.offset;
        if (v.surface.opacity < 1.0f && lane.rng.next() >= v.surface.opacity) {
            lane.origin = straightOn;
            continue;
        }
        enterObject(lane);
        if (here.invisible) {
            enterMedium(lane, v.surface);
            lane.origin = straightOn;
            continue;
        }
        v.kind = VertexKind::kSurface;
        v.position = v.surface.position;
        v.ng = v.surface.bsdf.ng;
        lane.hasVertex = true;
        return;
    }
    lane.alive = false;
}

/// The camera's ray has met something that is not clear.
void PassTracer::enterObject(Lane& lane)
{
    if (lane.entered) return;
    coverage_ += 1.0f;
    ++counters.cameraHits;
    lane.entered = true;
}

/// What a ray meets that is no longer the camera's: any surface, from either side. Where two single-sided sheets lie back to back, the one that
/// faces the ray.
RayHit PassTracer::meetAny(const Lane& lane, float nearDistance, float farDistance)
{
    const RayHit hit = state_.rays->intersect(lane.origin, lane.direction, nearDistance, farDistance);
    const MeshScene& mesh = state_.scene.mesh;
    if (!hit.found() || state_.isFiber(hit) || !hit.back || mesh.materials[size_t(mesh.meshes[hit.mesh].material)].doubleSided) return hit;
    ++counters.pathRays;
    const float slack = state_.sheetAt(hit.distance);
    const RayHit front = state_.rays->intersectFront(lane.origin, lane.direction, std::max(nearDistance, hit.distance - slack),
                                                     std::min(farDistance, hit.distance + slack));
    return front.found() ? front : hit;
}

/// Or leave it, when the surface was met from inside.
void PassTracer::enterMedium(Lane& lane, const SurfacePoint& surface)
{
    lane.medium = surface.fromInside ? -1 : surface.material;
    if (lane.medium >= 0 && state_.surfaces->body(lane.medium).medium.scatters()) ++counters.walks;
}

/// What is left of light that runs straight for `distance` from a point in `medium`: 0 behind anything opaque.
glm::vec3 PassTracer::transmittance(glm::vec3 origin, const glm::vec3& direction, float nearDistance, float distance, int medium)
{
    glm::vec3 left(1.0f);
    for (int clear = 0; clear < kMaxClearSurfaces; ++clear) {
        const RayHit hit = state_.rays->intersect(origin, direction, nearDistance, distance);
        nearDistance = 0.0f;
        counters.shadowRays += clear > 0;
        if (medium >= 0) left *= glm::exp(-state_.surfaces->body(medium).medium.sigmaT * std::min(hit.distance, distance));
        if (!hit.found()) return left;
        if (state_.isFiber(hit)) return glm::vec3(0.0f);
        const SurfacePoint s = state_.surfaces->evaluate(state_.scene.mesh, hit, -direction);
        if (state_.surfaces->body(s.material).invisible) {
            medium = s.fromInside ? -1 : s.material;
        } else {
            left *= 1.0f - s.opacity;
            if (s.opacity >= 1.0f) return glm::vec3(0.0f);
        }
        origin = s.position - s.bsdf.ng * state_.offset;
        distance -= hit.distance;
    }
    return glm::vec3(0.0f);
}

void PassTracer::lightDeltas(bool coherent, float* radiance)
{
    for (int i = 0; i < kLanes; ++i) {
        const Lane& lane = lanes_[size_t(i)];
        const Vertex& v = lane.vertex;
        rows_.lit[i] = lane.alive;
        rows_.plain[i] = lane.alive && v.kind == VertexKind::kSurface && v.surface.bsdf.lambertian();
        rows_.r[i] = rows_.g[i] = rows_.b[i] = 0.0f;
        rows_.ox[i] = rows_.oy[i] = rows_.oz[i] = rows_.nx[i] = rows_.ny[i] = rows_.gx[i] = rows_.gy[i] = 0.0f;
        rows_.nz[i] = rows_.gz[i] = 1.0f;
        if (!lane.alive) continue;
        const glm::vec3 o = v.onSurface() ? v.position + v.ng * state_.offset : v.position;
        rows_.ox[i] = o.x, rows_.oy[i] = o.y, rows_.oz[i] = o.z;
        const glm::vec3& above = v.surface.bsdf.above;
        rows_.gx[i] = above.x, rows_.gy[i] = above.y, rows_.gz[i] = above.z;
        const glm::vec3& n = v.surface.bsdf.frame.n;
        rows_.nx[i] = n.x, rows_.ny[i] = n.y, rows_.nz[i] = n.z;
        if (!rows_.plain[i]) continue;
        const glm::vec3 w = v.throughput * v.surface.bsdf.diffuse * kInvPi;
        rows_.r[i] = w.x, rows_.g[i] = w.y, rows_.b[i] = w.z;
        rows_.lit[i] = maxOf(w) > 0.0f;
    }
    const bool seeThrough = state_.surfaces->seeThrough();

    for (const LightSet::Delta& light : lights_.deltas) {
        alignas(32) float wx[kLanes], wy[kLanes], wz[kLanes], reach[kLanes], strength[kLanes];
        for (int i = 0; i < kLanes; ++i) {
            const float dx = light.point ? light.place.x - rows_.ox[i] : light.place.x;
            const float dy = light.point ? light.place.y - rows_.oy[i] : light.place.y;
            const float dz = light.point ? light.place.z - rows_.oz[i] : light.place.z;
            const float r2 = std::max(dx * dx + dy * dy + dz * dz, kMinLightRadius * kMinLightRadius);
            const float inverse = 1.0f / std::sqrt(r2);
            wx[i] = dx * inverse, wy[i] = dy * inverse, wz[i] = dz * inverse;
            reach[i] = light.point ? r2 * inverse * 0.9999f : kInfinity;
            const float cosine = wx[i] * rows_.nx[i] + wy[i] * rows_.ny[i] + wz[i] * rows_.nz[i];
            const float side = wx[i] * rows_.gx[i] + wy[i] * rows_.gy[i] + wz[i] * rows_.gz[i];
            strength[i] = (cosine > 0.0f && side > 0.0f ? cosine : 0.0f) * (light.point ? inverse * inverse : 1.0f);
        }

        for (int i = 0; i < kLanes; ++i) {
            if (!rows_.lit[i]) continue;
            const Vertex& v = lanes_[size_t(i)].vertex;
            glm::vec3 f = glm::vec3(rows_.r[i], rows_.g[i], rows_.b[i]) * strength[i];
            const glm::vec3 w(wx[i], wy[i], wz[i]);
            if (!rows_.plain[i]) {
                const float falloff = light.point ? sqr(0.9999f / reach[i]) : 1.0f;
                f = v.throughput * v.evaluateForLamp(w, state_) * falloff;
            }
            if (!(f.x + f.y + f.z > 0.0f)) continue;
            const glm::vec3 origin = v.originTowards(w, state_.offset);
            ++counters.shadowRays;
            float* pixel = radiance + 3 * light.image;
            if (seeThrough) addTo(pixel, f * light.intensity * transmittance(origin, w, v.reachFrom(), reach[i], v.mediumAround()));
            else queue_.push(origin, w, v.reachFrom(), reach[i], f * light.intensity, pixel, *state_.rays, coherent);
        }
    }
    queue_.flush(*state_.rays, coherent);
}

/// One direction per map and vertex, drawn from the map.
void PassTracer::lightMaps(float* radiance)
{
    const bool seeThrough = state_.surfaces->seeThrough();
    for (size_t m = 0; m < lights_.maps.size(); ++m) {
        const LightSet::Map& map = lights_.maps[m];
        for (Lane& lane : lanes_) {
            if (!lane.alive) continue;
            const Vertex& v = lane.vertex;
            glm::vec3 w, value;
            float pdf = 0.0f;
            if (!map.light.sample(lane.sampler.get2((uint32_t(m + 1) << 24) + lane.vertices), &w, &value, &pdf)) continue;
            const glm::vec3 f = v.evaluate(w, state_);
            if (!(maxOf(f) > 0.0f)) continue;
            const glm::vec3 origin = v.originTowards(w, state_.offset);
            glm::vec3 left(1.0f);
            ++counters.shadowRays;
            if (seeThrough) left = transmittance(origin, w, v.reachFrom(), kInfinity, v.mediumAround());
            else if (state_.rays->occluded(origin, w, v.reachFrom(), kInfinity)) continue;
            const float weight = sqr(pdf) / (sqr(pdf) + sqr(v.pdf(w, state_)));
            const glm::vec3 add = v.throughput * f * value * left * (weight / pdf);
            addTo(radiance + 3 * map.image, add);
        }
    }
}

/// From a lit vertex to a new ray, or through a random walk to the vertex where it comes out.
void PassTracer::scatter(Lane& lane)
{
    Vertex& v = lane.vertex;
    lane.hasVertex = false;
    lane.throughput = v.throughput;
    if (v.kind != VertexKind::kPhase && ++lane.bounces > maxBounces_) {
        lane.alive = false;
        return;
    }
    const uint32_t dimension = 2 * ++lane.vertices; // 0 and 1: the place in the pixel
    glm::vec3 wi;
    if (v.kind == VertexKind::kPhase) {
        wi = sampleHenyeyGreenstein(v.travel, state_.surfaces->body(v.medium).medium.g, lane.rng.next2());
        lane.pdf = v.pdf(wi, state_);
        lane.origin = v.position;
    } else if (v.kind == VertexKind::kFiber) {
        glm::vec3 local, weight;
        if (!hairSample(v.hair, lane.sampler.get2(dimension), lane.sampler.get2(dimension + 1), &local, &weight, &lane.pdf)) {
            lane.alive = false;
            return;
        }
        wi = v.fiberFrame.toWorld(local);
        lane.throughput *= weight;
        lane.origin = v.position;
        lane.nearDistance = v.nearDistance;
        lane.leastAlpha = indirectAlpha_; // however narrow the lobe: fur is lit by fur
    } else if (v.kind == VertexKind::kWalkExit) {
        const Frame& frame = v.surface.bsdf.frame;
        wi = frame.toWorld(sampleCosine(lane.sampler.get2(dimension)));
        if (!(glm::dot(wi, v.surface.bsdf.above) > 0.0f)) {
            lane.alive = false;
            return;
        }
        lane.pdf = v.pdf(wi, state_);
        lane.throughput *= walkExitFactor(v.surface.bsdf, glm::dot(frame.n, wi));
        lane.origin = v.originTowards(wi, state_.offset);
    } else {
        glm::vec2 choice = lane.sampler.get2(dimension + 1);
        const float walk = v.surface.chanceSubsurface;
        if (choice.x < walk) {
            if (!leaveAsWalk(lane)) lane.alive = false;
            return;
        }
        choice.x = std::min(kOneMinusEpsilon, (choice.x - walk) / (1.0f - walk));
        glm::vec3 weight;
        float pdf = 0.0f;
        if (!v.surface.bsdf.sample(choice.x, lane.sampler.get2(dimension), &wi, &weight, &pdf)) {
            lane.alive = false;
            return;
        }
        lane.throughput *= weight / (1.0f - walk);
        lane.pdf = pdf * (1.0f - walk);
        lane.origin = v.originTowards(wi, state_.offset);
        if (glm::dot(wi, v.surface.bsdf.above) < 0.0f && state_.surfaces->body(v.surface.material).boundary) enterMedium(lane, v.surface);
    }
    lane.direction = wi;
    if (lane.pdf < kNarrowDensity) lane.leastAlpha = indirectAlpha_;
    if (lane.vertices >= kRouletteStart) {
        const float q = std::min(1.0f, maxOf(lane.throughput));
        if (!(q > 0.0f) || lane.rng.next() >= q) {
            lane.alive = false;
            return;
        }
        lane.throughput /= q;
    }
    lane.alive = maxOf(lane.throughput) > 0.0f;
}

bool PassTracer::leaveAsWalk(Lane& lane)
{
    Vertex& v = lane.vertex;
    ++counters.walks;
    const WalkResult walk = randomWalk(state_.rays->body(v.surface.material), v.surface.walk,
                                       v.position - v.surface.geometricNormal * state_.offset, v.surface.geometricNormal, lane.rng);
    counters.walkRays += walk.steps;
    if (walk.end != WalkEnd::kLeft) {
        counters.leaked += walk.end == WalkEnd::kLeaked;
        counters.cut += walk.end == WalkEnd::kCut;
        return false;
    }
    lane.leastAlpha = indirectAlpha_;
    v.throughput = lane.throughput * v.surface.walkWeight * walk.weight / v.surface.chanceSubsurface;
    v.kind = VertexKind::kWalkExit;
    v.surface = state_.surfaces->evaluate(state_.scene.mesh, walk.hit, walk.outward);
    v.position = v.surface.position;
    v.ng = v.surface.geometricNormal;
    lane.hasVertex = true;
    return maxOf(v.throughput) > 0.0f;
}

Result<LightSet> gatherLights(std::span<const Light> lights)
{
    LightSet set;
    for (size_t i = 0; i < lights.size(); ++i) {
        const Light& l = lights[i];
        if (l.type == LightType::kPoint) {
            set.deltas.push_back({true, l.position, l.intensity, i});
        } else if (l.type == LightType::kDirectional) {
            set.deltas.push_back({false, glm::normalize(l.directionToLight), l.intensity, i});
        } else if (l.type == LightType::kEnvironment) {
            const Result<Image> map = readExr(l.environmentPath);
            if (!map) return map.error();
            set.maps.push_back({EnvironmentLight(*map, l.intensity), i});
        } else {
            return Error{ErrorCode::kUnsupported, "light " + std::to_string(i) + " is of a kind that the path tracer does not render alone"};
        }
    }
    return set;
}

} // namespace

PathTracer::PathTracer(std::unique_ptr<State> state) : state_(std::move(state)) {}
PathTracer::PathTracer(PathTracer&&) noexcept = default;
PathTracer& PathTracer::operator=(PathTracer&&) noexcept = default;
PathTracer::~PathTracer() = default;
const RayScene& PathTracer::rays() const { return *state_->rays; }
const std::vector<std::string>& PathTracer::warnings() const { return state_->warnings; }

Result<PathTracer> PathTracer::create(StageScene scene)
{
    auto state = std::make_unique<State>();
    state->scene = std::move(scene);
    Result<SurfaceTable> surfaces = SurfaceTable::create(state->scene, state->warnings);
    if (!surfaces) return surfaces.error();
    state->surfaces = std::make_unique<SurfaceTable>(std::move(*surfaces));
    const HairStrands& hair = state->scene.hair;
    state->fiber = makeHairFiber(hair.longitudinalRoughness, hair.azimuthalRoughness, hair.cuticleTiltRadians, hair.ior);
    state->indirectFiber = makeHairFiber(std::max(hair.longitudinalRoughness, kIndirectFiberRoughness),
                                         std::max(hair.azimuthalRoughness, kIndirectFiberRoughness), hair.cuticleTiltRadians, hair.ior);
    state->rays = std::make_unique<RayScene>(state->scene.mesh, state->scene.hair, 0);
    const RayScene::Body& all = state->rays->everything();
    state->offset = 4e-6f * std::max(maxOf(glm::abs(all.lower)), maxOf(glm::abs(all.upper)));
    for (size_t i = 0; i < state->scene.mesh.materials.size(); ++i)
        if (state->surfaces->body(int(i)).scatters) state->rays->prepareBody(int(i));
    return PathTracer(std::move(state));
}

size_t PathTracer::memoryBytes() const
{
    size_t bytes = state_->rays->memoryBytes();
    for (const TriangleMesh& m : state_->scene.mesh.meshes)
        bytes += m.positions.size() * 12 + m.normals.size() * 12 + m.tangents.size() * 16 + m.texcoords[0].size() * 8 +
                 m.texcoords[1].size() * 8 + m.colors.size() * 16 + m.triangles.size() * 12;
    for (const MeshTexture& t : state_->scene.mesh.textures) bytes += t.rgba.size();
    return bytes + state_->scene.hair.controlPoints.size() * 16;
}

Result<std::vector<Image>> PathTracer::render(const Camera& camera, std::span<const Light> lights, const RenderSettings& settings,
                                              RenderStats* stats) const
{
    const auto start = std::chrono::steady_clock::now();
    Result<LightSet> set = gatherLights(lights);
    if (!set) return set.error();
    const size_t pixels = size_t(camera.width) * size_t(camera.height), lightCount = lights.size();
    const int passes = std::max(1, (settings.samplesPerPixel + kLanes - 1) / kLanes);
    Film film(pixels, lightCount);

    // The camera is part of the seed, so that two cameras do not share their noise.
    const uint64_t key = fnv1a(&camera.worldFromCamera, sizeof camera.worldFromCamera, fnv1a(&settings.seed, sizeof settings.seed));
    const uint32_t imageSeed = hashBits(uint32_t(key) ^ hashBits(uint32_t(key >> 32)));

    tbb::enumerable_thread_specific<Counters> counters;
    std::mutex reporting;
    size_t pixelsDone = 0;
    const auto stopped = [&] { return settings.stop && settings.stop->load(std::memory_order_relaxed); };

    const auto renderPasses = [&](int first, int last) {
        const double before = double(first) / passes, share = double(last - first) / passes;
        pixelsDone = 0;
        tbb::parallel_for(tbb::blocked_range<size_t>(0, pixels, 64), [&](const tbb::blocked_range<size_t>& range) {
            if (stopped()) return;
            PassTracer tracer(*state_, *set, settings);
            std::vector<float> radiance(lightCount * 3);
            for (size_t p = range.begin(); p < range.end(); ++p) {
                const uint32_t pixelSeed = hashCombine(imageSeed, uint32_t(p));
                for (int pass = first; pass < last; ++pass) {
                    std::fill(radiance.begin(), radiance.end(), 0.0f);
                    const int x = int(p % size_t(camera.width)), y = int(p / size_t(camera.width));
                    const float hits = tracer.trace(camera, x, y, hashCombine(pixelSeed, uint32_t(pass)), radiance.data());
                    film.add(p, radiance.data(), hits);
                }
            }
            counters.local().add(tracer.counters);
            if (settings.progress) {
                std::lock_guard lock(reporting);
                pixelsDone += range.size();
                settings.progress(before + share * double(pixelsDone) / double(pixels));
            }
        });
    };

    int done = 0;
    std::vector<float> noise;
    tbb::task_arena arena(settings.threads > 0 ? settings.threads : tbb::task_arena::automatic);
    while (done < passes && !stopped()) {
        // Without a target all passes run at once; with one, the samples grow by half between checks.
        const int next = settings.noiseTarget > 0.0f ? std::min(passes, std::max(done + done / 2, done + 4)) : passes;
        arena.execute([&] { renderPasses(done, next); });
        done = next;
        noise = film.noise(done);
        if (settings.noiseTarget > 0.0f && *std::max_element(noise.begin(), noise.end()) <= settings.noiseTarget) break;
    }
    if (stopped()) return Error{ErrorCode::kCancelled, "rendering was stopped"};

    std::vector<Image> images = film.images(camera.width, camera.height, done);
    if (stats) {
        Counters all;
        for (const Counters& c : counters) all.add(c);
        stats->samplesPerPixel = done * kLanes;
        stats->noise = std::move(noise);
        stats->pathRays = all.pathRays, stats->shadowRays = all.shadowRays, stats->walkRays = all.walkRays;
        stats->seesObject = all.cameraHits > 0;
        stats->backFaces = all.backFaces ? double(all.backFaces) / double(all.cameraHits + all.holes) : 0.0;
        stats->leakedWalks = all.walks ? double(all.leaked) / double(all.walks) : 0.0;
        stats->cutWalks = all.walks ? double(all.cut) / double(all.walks) : 0.0;
        stats->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }
    return images;
}

} // namespace nacre
