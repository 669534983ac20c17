// Embree 3: one scene with everything, and one more per material that bounds a scattering body (the geometries are shared).
// "Robust" traversal: no ray slips between two triangles that share an edge, which a random walk would notice.
#include "light_stage/ray_scene.h"

#include <embree3/rtcore.h>

#include <atomic>
#include <cstddef>
#include <algorithm>
#include <string>
#include <vector>

namespace nacre::stage {

static_assert(sizeof(ShadowPacket) == sizeof(RTCRay8) && offsetof(ShadowPacket, farDistance) == offsetof(RTCRay8, tfar) &&
              offsetof(ShadowPacket, directionX) == offsetof(RTCRay8, dir_x));

struct RayScene::State {
    explicit State(const MeshScene& m) : mesh(m) {}
    const MeshScene& mesh;
    RTCDevice device = nullptr;
    RTCScene scene = nullptr;
    std::vector<RTCGeometry> geometries; // per mesh, then the fibres
    std::vector<Body> bodies; // per material; no scene where there is none
    Body everything;
    RayLog* log = nullptr;
    std::vector<uint32_t> segmentStarts;
    std::vector<uint8_t> singleSided; // per geometry
    std::atomic<ptrdiff_t> bytes{0};
};

static bool countMemory(void* counter, ptrdiff_t bytes, bool /*after*/)
{
    *static_cast<std::atomic<ptrdiff_t>*>(counter) += bytes;
    return true;
}

static RTCScene newScene(RTCDevice device)
{
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    return scene;
}

static RayScene::Body commit(RTCScene scene, RayLog* const* log)
{
    rtcCommitScene(scene);
    RTCBounds b;
    rtcGetSceneBounds(scene, &b);
    return {scene, log, {b.lower_x, b.lower_y, b.lower_z}, {b.upper_x, b.upper_y, b.upper_z}};
}

RayScene::RayScene(const MeshScene& mesh, const HairStrands& hair, int threads) : state_(new State(mesh))
{
    State& s = *state_;
    s.device = rtcNewDevice(threads > 0 ? ("threads=" + std::to_string(threads)).c_str() : nullptr);
    rtcSetDeviceMemoryMonitorFunction(s.device, countMemory, &s.bytes);
    s.scene = newScene(s.device);
    for (const TriangleMesh& m : mesh.meshes) {
        RTCGeometry geometry = rtcNewGeometry(s.device, RTC_GEOMETRY_TYPE_TRIANGLE);
        auto* vertices = static_cast<glm::vec3*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                                         sizeof(glm::vec3), m.positions.size()));
        std::copy(m.positions.begin(), m.positions.end(), vertices);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, m.triangles.data(), 0, sizeof(glm::uvec3),
                                   m.triangles.size());
        rtcCommitGeometry(geometry);
        s.geometries.push_back(geometry);
        s.singleSided.push_back(!mesh.materials[size_t(m.material)].doubleSided);
    }
    s.singleSided.push_back(false); // fibres
    if (hair.segmentCount() > 0) {
        s.segmentStarts.resize(hair.segmentCount());
        for (size_t i = 0; i < s.segmentStarts.size(); ++i) s.segmentStarts[i] = uint32_t(4 * i);
        RTCGeometry geometry = rtcNewGeometry(s.device, RTC_GEOMETRY_TYPE_FLAT_BEZIER_CURVE);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, hair.controlPoints.data(), 0,
                                   sizeof(glm::vec4), hair.controlPoints.size());
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, s.segmentStarts.data(), 0, sizeof(uint32_t),
                                   s.segmentStarts.size());
        rtcCommitGeometry(geometry);
        s.geometries.push_back(geometry);
    }
    for (size_t i = 0; i < s.geometries.size(); ++i) rtcAttachGeometryByID(s.scene, s.geometries[i], unsigned(i));
    s.everything = commit(s.scene, &s.log);
}

RayScene::~RayScene()
{
    for (const Body& body : state_->bodies)
        if (body.scene) rtcReleaseScene(static_cast<RTCScene>(body.scene));
    for (RTCGeometry geometry : state_->geometries) rtcReleaseGeometry(geometry);
    rtcReleaseScene(state_->scene);
    rtcReleaseDevice(state_->device);
}

void RayScene::prepareBody(int material)
{
    State& s = *state_;
    RTCScene scene = newScene(s.device);
    for (size_t i = 0; i < s.mesh.meshes.size(); ++i)
        if (s.mesh.meshes[i].material == material) rtcAttachGeometryByID(scene, s.geometries[i], unsigned(i));
    if (s.bodies.size() <= size_t(material)) s.bodies.resize(size_t(material) + 1);
    s.bodies[size_t(material)] = commit(scene, &s.log);
}

const RayScene::Body& RayScene::body(int material) const { return state_->bodies[size_t(material)]; }
const RayScene::Body& RayScene::everything() const { return state_->everything; }

/// The ray library hands a ray's context back to the filter.
struct FrontContext {
    RTCIntersectContext rtc;
    const uint8_t* singleSided;
    float backFace;
};

static void rejectBackFaces(const RTCFilterFunctionNArguments* a)
{
    if (a->N != 1 || a->valid[0] != -1) return; // single rays only
    auto* context = reinterpret_cast<FrontContext*>(a->context);
    const auto* ray = reinterpret_cast<const RTCRay*>(a->ray);
    const auto* hit = reinterpret_cast<const RTCHit*>(a->hit);
    if (!context->singleSided[hit->geomID]) return;
    if (!(hit->Ng_x * ray->dir_x + hit->Ng_y * ray->dir_y + hit->Ng_z * ray->dir_z > 0.0f)) return;
    context->backFace = std::min(context->backFace, ray->tfar);
    a->valid[0] = 0;
}

/// `singleSided`: cull their back faces; null: meet everything.
static RayHit trace(RTCScene scene, const glm::vec3& origin, const glm::vec3& direction, float nearDistance, float farDistance,
                    const uint8_t* singleSided = nullptr)
{
    RTCRayHit r;
    r.ray.org_x = origin.x, r.ray.org_y = origin.y, r.ray.org_z = origin.z;
    r.ray.dir_x = direction.x, r.ray.dir_y = direction.y, r.ray.dir_z = direction.z;
    r.ray.tnear = nearDistance, r.ray.tfar = farDistance;
    r.ray.time = 0, r.ray.mask = ~0u, r.ray.id = 0, r.ray.flags = 0;
    r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    FrontContext context;
    rtcInitIntersectContext(&context.rtc);
    if (singleSided) context.rtc.filter = rejectBackFaces;
    context.singleSided = singleSided;
    context.backFace = kInfinity;
    rtcIntersect1(scene, &context.rtc, &r);
    RayHit hit;
    hit.backFace = context.backFace;
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return hit;
    const bool back = r.hit.Ng_x * direction.x + r.hit.Ng_y * direction.y + r.hit.Ng_z * direction.z > 0.0f;
    return {r.hit.geomID, r.hit.primID, r.hit.u, r.hit.v, r.ray.tfar, context.backFace, back};
}

RayHit RayScene::intersect(const glm::vec3& origin, const glm::vec3& direction, float nearDistance, float farDistance) const
{
    if (state_->log) state_->log->singles.push_back({origin, direction, nearDistance, farDistance, false, false, state_->scene});
    return trace(state_->scene, origin, direction, nearDistance, farDistance);
}

RayHit RayScene::intersectFront(const glm::vec3& origin, const glm::vec3& direction, float nearDistance, float farDistance) const
{
    if (state_->log) state_->log->singles.push_back({origin, direction, nearDistance, farDistance, false, true, state_->scene});
    return trace(state_->scene, origin, direction, nearDistance, farDistance, state_->singleSided.data());
}

RayHit RayScene::Body::intersect(const glm::vec3& origin, const glm::vec3& direction, float farDistance) const
{
    if (*log) (*log)->singles.push_back({origin, direction, 0.0f, farDistance, false, false, scene});
    return trace(static_cast<RTCScene>(scene), origin, direction, 0.0f, farDistance);
}

static void occludedPacket(RTCScene scene, const int32_t valid[8], ShadowPacket& packet, bool coherent)
{
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcOccluded8(valid, scene, &context, reinterpret_cast<RTCRay8*>(&packet));
}

static bool occludedSingle(RTCScene scene, const glm::vec3& origin, const glm::vec3& direction, float nearDistance, float farDistance)
{
    RTCRay r;
    r.org_x = origin.x, r.org_y = origin.y, r.org_z = origin.z;
    r.dir_x = direction.x, r.dir_y = direction.y, r.dir_z = direction.z;
    r.tnear = nearDistance, r.tfar = farDistance;
    r.time = 0, r.mask = ~0u, r.id = 0, r.flags = 0;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, &r);
    return r.tfar < 0.0f;
}

void RayScene::occluded(const int32_t valid[8], ShadowPacket& packet, bool coherent) const
{
    if (state_->log) {
        RayLog::Packet& p = state_->log->packets.emplace_back();
        p.rays = packet;
        p.coherent = coherent;
        std::copy(valid, valid + 8, p.valid);
    }
    occludedPacket(state_->scene, valid, packet, coherent);
}

bool RayScene::occluded(const glm::vec3& origin, const glm::vec3& direction, float nearDistance, float farDistance) const
{
    if (state_->log) state_->log->singles.push_back({origin, direction, nearDistance, farDistance, true, false, state_->scene});
    return occludedSingle(state_->scene, origin, direction, nearDistance, farDistance);
}

void RayScene::setLog(RayLog* log) const { state_->log = log; }

void RayScene::replay(const RayLog& log) const
{
    for (const RayLog::Single& s : log.singles) {
        RTCScene scene = static_cast<RTCScene>(const_cast<void*>(s.scene));
        if (s.shadow) occludedSingle(scene, s.origin, s.direction, s.nearDistance, s.farDistance);
        else trace(scene, s.origin, s.direction, s.nearDistance, s.farDistance, s.frontOnly ? state_->singleSided.data() : nullptr);
    }
    for (const RayLog::Packet& p : log.packets) {
        ShadowPacket packet = p.rays; // tracing overwrites it
        occludedPacket(state_->scene, p.valid, packet, p.coherent);
    }
}

size_t RayScene::memoryBytes() const { return size_t(std::max<ptrdiff_t>(0, state_->bytes.load())); }

} // namespace nacre::stage
