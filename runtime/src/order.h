// The joint order of all splats that a view draws: far to near by the distance of their means from the eye (KHR_gaussian_splatting
// "cameraDistance"), or in an orthographic view by their depth. It says nothing about how the camera is turned, so a view sorts again
// only if the eye or an instance has moved, and a change of the projection (jitter) or a turn of the camera at most culls again.
#pragma once

#include "base/radix_sort.h"

#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

/// The splats of one instance: list indices first, first + 1, ...
struct OrderInstance {
    const glm::vec3* positions;      // asset space, `count` of them; must live and stay as they are while update() is called with them
    const float* maxScales;          // asset units, standard deviation along the longest axis
    uint32_t count, first;
    glm::mat3 worldFromAsset;
    glm::vec3 fromEye;               // translation of worldFromAsset minus the eye (where clip x = y = w = 0), in double; orthographic: any fixed point
    glm::mat3 viewFromAsset;         // rotation times viewScale
    glm::vec3 viewTranslation;
    float viewScale, lowPass;        // length of one asset unit in view space; pixels^2
    uint64_t asset = 0;              // tells assets apart whose positions lie at one address one after the other
};

struct OrderCamera {
    glm::mat4 clipFromView;
    glm::vec2 viewport;              // pixels
    float nearW;                     // smallest clip w of what is drawn
    bool orthographic;
    glm::vec3 towardsEye{0};         // world, unit; orthographic only
    float eyeRounding = 0;           // world units: an eye that is so near to that of the last sort is the same, seen through rounded matrices
};

class Order {
public:
    /// `instances` in ascending order of `first`, none overlaps the next. True if farToNear() has changed. With the same positions, instances and eye as in the last call nothing is sorted.
    bool update(std::span<const OrderInstance> instances, const OrderCamera& camera);

    /// List indices, far to near; equal keys: the lower index is in front. Splats that cannot touch the frame are left out, but for some
    /// near its border.
    std::span<const uint32_t> farToNear() const { return allDrawn_ ? std::span<const uint32_t>(sorted_) : drawn_; }

    /// Whether the last update() sorted, or only culled or found everything as it was.
    bool hasSorted() const { return hasSorted_; }

private:
    /// dot(normal, d) + offset <= reach * scale holds of what is drawn; world space, d from the eye, scale of the splat.
    struct Plane {
        glm::vec3 normal{0};
        float offset = 0, reach = 0;
        float slack = 0;             // by which offset may change
    };
    static constexpr int kPlanes = 5;
    struct Frustum {
        Plane planes[kPlanes];
        bool orthographic = false;
        bool covers(const Frustum& other) const;
        bool holds(const glm::vec3& d, float scale) const;
    };
    static Frustum frustumOf(std::span<const OrderInstance> instances, const OrderCamera& camera);

    bool sameKeys(std::span<const OrderInstance> instances, const OrderCamera& camera) const;
    void sortAll(std::span<const OrderInstance> instances);
    void cull(std::span<const OrderInstance> instances);

    std::vector<OrderInstance> sortedAt_; // as they were when they were sorted; only compared
    bool orthographic_ = false;
    glm::vec3 towardsEye_{0};
    std::vector<uint32_t> keys_, sorted_;
    RadixScratch<uint32_t> scratch_;

    Frustum culled_;                 // the frame that was culled to
    std::vector<uint32_t> touches_;  // a bit for each list index
    std::vector<uint32_t> drawn_;
    bool allDrawn_ = true, hasSorted_ = false;
};

} // namespace nacre
