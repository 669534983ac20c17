// Rays against triangles and fibres. Only ray_scene.cpp knows Embree.
#pragma once

#include "light_stage/hair_strands.h"
#include "mesh/mesh_scene.h"

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace nacre::stage {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr uint32_t kNoHit = ~0u;

struct RayHit {
    uint32_t mesh = kNoHit;     // index into MeshScene::meshes; meshes.size(): the fibres
    uint32_t primitive = 0;     // triangle of the mesh, or segment of the fibres
    float u = 0, v = 0;         // barycentric weights of vertices 1 and 2; fibres: along in [0, 1], across in [-1, 1]
    float distance = kInfinity;
    float backFace = kInfinity; // intersectFront: distance of the nearest back face that was passed on the way
    bool back = false;          // a triangle, met from behind
    bool found() const { return mesh != kNoHit; }
};

/// Eight shadow rays. The layout is that of the ray library, so that a packet is traced where it lies.
struct alignas(32) ShadowPacket {
    float originX[8], originY[8], originZ[8], nearDistance[8];
    float directionX[8], directionY[8], directionZ[8], time[8];
    float farDistance[8]; // -infinity after the trace where something is in the way
    uint32_t mask[8], id[8], flags[8];
};

/// Every ray of one thread, for tracing it again without the renderer around it (tests/bench/bench_stage.cpp).
struct RayLog {
    struct Single {
        glm::vec3 origin, direction;
        float nearDistance, farDistance;
        bool shadow, frontOnly;
        const void* scene;
    };
    struct Packet {
        ShadowPacket rays;
        int32_t valid[8];
        bool coherent;
    };
    std::vector<Single> singles;
    std::vector<Packet> packets;
};

class RayScene {
public:
    /// Keeps references to both; they must outlive it unchanged.
    RayScene(const MeshScene& mesh, const HairStrands& hair, int threads);
    ~RayScene();

    RayHit intersect(const glm::vec3& origin, const glm::vec3& direction, float nearDistance = 0, float farDistance = kInfinity) const;
    /// The same, but triangles of materials that are not double-sided are met from the front only.
    RayHit intersectFront(const glm::vec3& origin, const glm::vec3& direction, float nearDistance = 0, float farDistance = kInfinity) const;
    /// The triangles of one material as a scene of their own, for walks inside that body.
    struct Body {
        void* scene = nullptr;
        RayLog* const* log = nullptr;
        glm::vec3 lower{0.0f}, upper{0.0f};
        RayHit intersect(const glm::vec3& origin, const glm::vec3& direction, float farDistance) const;
        bool encloses(const glm::vec3& p) const
        {
            return p.x >= lower.x && p.y >= lower.y && p.z >= lower.z && p.x <= upper.x && p.y <= upper.y && p.z <= upper.z;
        }
    };
    void prepareBody(int material);                     // once per material, before body()
    const Body& body(int material) const;
    const Body& everything() const;

    /// valid: -1 traces a ray, 0 skips it. coherent: rays start close together and run alike.
    void occluded(const int32_t valid[8], ShadowPacket& packet, bool coherent) const;
    bool occluded(const glm::vec3& origin, const glm::vec3& direction, float nearDistance, float farDistance) const;

    size_t memoryBytes() const;
    void setLog(RayLog* log) const;  // null ends it; one thread only while it is on
    void replay(const RayLog& log) const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace nacre::stage
