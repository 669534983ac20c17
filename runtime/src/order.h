// The joint order of all splats that a view draws: far to near by the distance of their means from the eye (KHR_gaussian_splatting
// "cameraDistance"), or in an orthographic view by their depth. It says nothing about how the camera is turned, so a view sorts again
// only if the eye or an instance has moved, and a change of the projection (jitter) or a turn of the camera at most culls again.
#pragma once

#include "base/bucket_sort.h"
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
    glm::vec3 fromEye;               // translation of worldFromAsset minus the eye (where clip x = y = w = 0), subtracted in double;
                                     // orthographic: minus any point that stays where it is
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
    float eyeRounding = 0;           // world units: an eye as near as this to that of the last sort is the same, from rounded matrices
};

/// What the keys of an order were computed from.
class OrderSource {
public:
    /// True if keys would be others now.
    bool differs(std::span<const OrderInstance> instances, const OrderCamera& camera) const;
    /// True if the instances have the same splats, wherever they are.
    bool sameSplats(std::span<const OrderInstance> instances) const;
    void remember(std::span<const OrderInstance> instances, const OrderCamera& camera);

    bool orthographic = false;
    glm::vec3 towardsEye{0};

private:
    std::vector<OrderInstance> instances_; // only compared
};

class Order {
public:
    /// `instances` in ascending order of `first`, none overlaps the next. True if farToNear() has changed. Nothing is sorted if neither the
    /// instances nor the eye have moved since the last call, but for the first turn after a move with few splats in the frame.
    bool update(std::span<const OrderInstance> instances, const OrderCamera& camera);

    /// List indices, far to near; equal keys: the lower index is in front. Splats that cannot touch the frame are left out, but for some
    /// near its border.
    std::span<const uint32_t> farToNear() const { return allDrawn_ ? std::span<const uint32_t>(sorted_) : drawn_; }

    /// How many splats of each instance are in farToNear().
    std::span<const uint32_t> drawnOf() const { return drawnOf_; }

    /// Whether the last update() sorted, or only culled or found everything as it was.
    bool hasSorted() const { return hasSorted_; }

private:
    /// dot(normal, d) + offset <= reach * scale holds of what is drawn; world space, d from the eye, scale of the splat.
    struct Plane {
        glm::vec3 normal{0};
        float offset = 0, reach = 0;
        float slack = 0;             // by which offset may change
    };
    struct Frustum {
        Plane planes[5];
        int count = 0;               // of them in use
        bool orthographic = false;
        std::span<const Plane> inUse() const { return std::span(planes).first(size_t(count)); }
        bool covers(const Frustum& other) const;
    };
    static Frustum frustumOf(std::span<const OrderInstance> instances, const OrderCamera& camera);

    /// The sphere around an instance's means, asset units.
    struct Bounds {
        glm::vec3 centre{0};
        float radius = 0, maxScale = 0;
    };
    static Bounds boundsOf(const OrderInstance& instance);
    enum class Side { kInside, kOutside, kAcross };
    struct Block;

    void pass(std::span<const OrderInstance> instances, bool sorts);
    void computeKeys(const Block& block, uint32_t* keys) const;
    Side sideOf(const OrderInstance& instance, const Bounds& bounds, float scale) const;
    void mark(const Block& block);
    void markAll(const OrderInstance& instance);
    void setBits(uint32_t at, uint64_t bits);
    void list(std::span<const OrderInstance> instances);
    bool touches(uint32_t at) const { return touches_[at >> 5] >> (at & 31) & 1u; }
    void sort(bool all);
    void gather();

    OrderSource source_;
    std::vector<Bounds> bounds_;     // of the instances
    std::vector<uint32_t> listed_, keys_; // list indices and their keys
    std::vector<uint32_t> someListed_, someKeys_;
    std::vector<uint32_t> sorted_;
    BucketSort sort_;

    Frustum culled_;                 // the frame that was culled to
    std::vector<uint32_t> touches_;  // a bit for each list index
    size_t touching_ = 0;
    std::vector<uint32_t> drawnOf_;
    std::vector<uint32_t> drawn_;    // what touches, in order
    bool allSorted_ = true, allDrawn_ = true, hasSorted_ = false;
};

} // namespace nacre
