// A pass follows 16 paths of one pixel side by side. At every vertex of every path, all lights are asked: a light without size (point,
// directional) needs one shadow ray and no random number, so the image of a light is the same whichever lights share the pass.
// Environment maps are sampled by radiance and by the surface, combined with the power heuristic (Veach and Guibas 1995).
//
// A path moves through states: a ray (advance() finds the next vertex, through clear surfaces and media) or a vertex (it is lit, then
// scatter() draws the next ray, or a random walk whose exit is the next vertex). Russian roulette weighs survivors by 1/q: no bias.
#include "light_stage/pass_tracer.h"

#include "base/hash.h"
#include "dataset/environment_map.h"
#include "light_stage/capture_camera.h"
#include "light_stage/random_walk.h"

#include <algorithm>

namespace nacre::stage {
namespace {

constexpr uint32_t kRouletteStart = 3; // vertices before paths may end by chance
constexpr float kNarrowDensity = 2.0f; // per steradian: a bounce of lower density counts as diffuse (cosine lobe: 0.32 at most)
constexpr int kMaxClearSurfaces = 256; // straight through alpha and index-matched surfaces, per ray


} // namespace

PixelRays raysOf(const Camera& camera, const std::optional<FileCamera>& lens, int x, int y)
{
    if (!lens)
        return {{float((x - camera.cx) / camera.fx), float((camera.cy - y) / camera.fy), -1.0f}, {float(1.0 / camera.fx), 0, 0}, {0, -float(1.0 / camera.fy), 0}};
    const glm::dvec2 corner = lookedAt(*lens, x, y);
    return {{corner, -1.0f}, {lookedAt(*lens, x + 1, y) - corner, 0}, {lookedAt(*lens, x, y + 1) - corner, 0}};
}

float PassTracer::trace(const Camera& camera, const PixelRays& rays, uint32_t passSeed, float* radiance)
{
    coverage_ = 0.0f;
    const glm::vec3 eye(camera.position());
    const glm::mat3 rotation(camera.worldFromCamera);
    for (int i = 0; i < kLanes; ++i) {
        Lane& lane = lanes_[size_t(i)];
        lane.sampler = {passSeed, uint32_t(i)};
        lane.rng = Rng((uint64_t(passSeed) << 32) | hashBits(uint32_t(i) + 0x51ed270bu));
        const glm::vec2 jitter = lane.sampler.get2(0);
        lane.origin = eye;
        lane.direction = glm::normalize(rotation * (rays.corner + jitter.x * rays.right + jitter.y * rays.down));
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

/// From a ray to the next vertex, straight through what is clear. The lane dies if there is none.
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

        if (!hit.found() && event < kInfinity) {
            lane.throughput *= distances.weightToScatter(body->medium, event);
            lane.origin += lane.direction * event;
            if (!collide(lane, *body)) return;
            --clear; // collisions have a limit of their own
            continue;
        }
        if (firstMet) noteBackFaces(hit);
        if (!hit.found()) return escape(lane, radiance);
        if (body) lane.throughput *= scattering ? distances.weightToSurface(body->medium, hit.distance) : glm::exp(-body->medium.sigmaT * hit.distance);
        if (!meet(lane, hit)) return;
    }
    lane.alive = false;
}

/// Scattered inside a medium. True: the ray goes on; false: there is a vertex, or the lane is dead.
bool PassTracer::collide(Lane& lane, const Body& body)
{
    const bool leaked = !state_.rays->everything().encloses(lane.origin), cut = ++lane.events > kMaxWalkSteps;
    if (leaked || cut) {
        counters.leaked += leaked;
        counters.cut += !leaked;
        return lane.alive = false;
    }
    if (body.invisible) { // light reaches this point straight through the boundary: a vertex
        Vertex& v = lane.vertex;
        v.kind = VertexKind::kPhase;
        v.position = lane.origin;
        v.travel = lane.direction;
        v.medium = lane.medium;
        v.throughput = lane.throughput;
        lane.hasVertex = true;
        return false;
    }
    // Behind a refracting boundary no lamp can be joined by a straight line: walk on to the boundary.
    lane.direction = sampleHenyeyGreenstein(lane.direction, body.medium.g, lane.rng.next2());
    lane.pdf = 0.0f;
    lane.leastAlpha = indirectAlpha_;
    const float q = std::min(1.0f, maxOf(lane.throughput));
    if (!(q > 0.0f) || lane.rng.next() >= q) return lane.alive = false;
    lane.throughput /= q;
    return true;
}

/// Out of the scene, into the maps. Background is not the object's light.
void PassTracer::escape(Lane& lane, float* radiance)
{
    if (lane.entered)
        for (const LightSet::Map& map : lights_.maps) {
            float weight = 1.0f;
            if (lane.pdf > 0.0f) weight = sqr(lane.pdf) / (sqr(lane.pdf) + sqr(map.light.pdf(lane.direction)));
            const glm::vec3 add = lane.throughput * map.light.radiance(lane.direction) * weight;
            addTo(radiance + 3 * map.image, add);
        }
    lane.alive = false;
}

/// A surface or a fibre. True: it is clear here, and the ray goes on behind it; false: there is a vertex.
bool PassTracer::meet(Lane& lane, const RayHit& hit)
{
    Vertex& v = lane.vertex;
    v.throughput = lane.throughput;
    if (state_.isFiber(hit)) {
        enterObject(lane);
        lane.hasVertex = true;
        makeFiberVertex(state_, hit, lane.origin + lane.direction * hit.distance, -lane.direction, lane.leastAlpha > kMinAlpha, v);
        return false;
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
        return true;
    }
    enterObject(lane);
    if (here.invisible) {
        enterMedium(lane, v.surface);
        lane.origin = straightOn;
        return true;
    }
    v.kind = VertexKind::kSurface;
    v.position = v.surface.position;
    v.ng = v.surface.bsdf.ng;
    lane.hasVertex = true;
    return false;
}

void PassTracer::noteBackFaces(const RayHit& hit)
{
    const float nearest = hit.found() ? hit.distance - state_.sheetAt(hit.distance) : kInfinity; // the other side of the sheet that was met does not count
    if (!(hit.backFace < nearest)) return;
    ++counters.backFaces;
    counters.holes += !hit.found();
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
            if (light.beam > 0.0f) f *= std::pow(std::max(0.0f, -glm::dot(w, light.axis)), light.beam);
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
            static const Image kUniform{2, 1, std::vector<float>(8, 1.0f)};
            const Result<Image> map = l.environmentPath.empty() ? kUniform : readEnvironmentMap(l.environmentPath);
            if (!map) return map.error();
            set.maps.push_back({EnvironmentLight(*map, l.intensity), i});
        } else {
            return Error{ErrorCode::kUnsupported, "light " + std::to_string(i) + " is of a kind that the path tracer does not render alone"};
        }
    }
    return set;
}

} // namespace nacre::stage
