// Keys: |d|^2 with d = worldFromAsset p + fromEye, orthographic -dot(towardsEye, d). All splats are sorted; those that cannot touch the
// frame are left out afterwards, because what is in the frame changes when the camera turns and the order does not.
//
// Culling is conservative: the shader decides exactly. Along an axis of the frame a splat of scale s reaches
//   sqrt(2 ln 255 ((J s / w)^2 + lowPass)) + 1 pixel          J = half * |row - at * wRow|, |at| <= 1 + kJacobianMargin
// from its mean (row, wRow: rows of clipFromView that make x and w), at most kReach (J s / w + sqrt(lowPass)) + 1. Times w / half this
// is a plane moved outwards by a multiple of s:
//   +-x - (1 + (kReach sqrt(lowPass) + 1) / half) w <= kReach max|row - at * wRow| s
// Each plane is also opened by an angle, so that jitter and small turns find everything they draw in the list.
#include "order.h"

#include "splats/blend.h"

#include <algorithm>
#include <cmath>

namespace nacre {

constexpr float kReach = 3.37f;        // sqrt(2 ln 255), where alpha falls to 1/255 at opacity 1, and 1 % for matrices that have drifted
constexpr float kAngleMargin = 0.05f;  // radians that the camera may turn before it culls again
constexpr float kRounding = 1e-6f;     // of positions, relative to their distance

static double worldScale(const OrderInstance& i) { return std::cbrt(std::abs(glm::determinant(glm::dmat3(i.worldFromAsset)))); }

/// True if what `other` holds without its margins is within these.
bool Order::Frustum::covers(const Frustum& other) const
{
    const float angle = orthographic ? 0.0f : kAngleMargin;
    for (int k = 0; k < kPlanes; ++k) {
        const Plane &a = planes[k], &b = other.planes[k];
        if (!(glm::length(a.normal - b.normal) <= angle && std::abs(b.offset - a.offset) <= a.slack && b.reach <= (1.0f + kAngleMargin) * a.reach)) return false;
    }
    return orthographic == other.orthographic;
}

/// True for what reaches the frame, or would after a small turn.
bool Order::Frustum::holds(const glm::vec3& d, float scale) const
{
    const float away = (orthographic ? kRounding : kAngleMargin) * glm::length(d);
    for (const Plane& p : planes)
        if (glm::dot(p.normal, d) + p.offset > (1.0f + kAngleMargin) * p.reach * scale + away + p.slack) return false; // NaN is left to the shader
    return true;
}

Order::Frustum Order::frustumOf(std::span<const OrderInstance> instances, const OrderCamera& camera)
{
    const OrderInstance& any = instances.front(); // all see the same camera
    const glm::dmat3 viewFromWorld = glm::dmat3(any.viewFromAsset) * glm::inverse(glm::dmat3(any.worldFromAsset));
    const glm::dvec3 viewAtZero = glm::dvec3(any.viewTranslation) - viewFromWorld * glm::dvec3(any.fromEye); // where d is 0
    const double cameraScale = any.viewScale / worldScale(any);
    float lowPass = 0;
    for (const OrderInstance& i : instances) lowPass = std::max(lowPass, i.lowPass);

    const glm::dmat4 rows = glm::transpose(glm::dmat4(camera.clipFromView));
    const glm::dvec3 w(rows[3]);
    const auto plane = [&](const glm::dvec4& clip, double reach, double slack) { // dot(clip, view position) <= reach * (scale in view space)
        const glm::dvec3 normal = glm::transpose(viewFromWorld) * glm::dvec3(clip);
        const double unit = 1.0 / glm::length(normal);
        const double offset = camera.orthographic ? glm::dot(glm::dvec3(clip), viewAtZero) + clip.w : 0.0; // the eye lies on all planes
        return Plane{glm::vec3(normal * unit), float(offset * unit), float(reach * cameraScale * unit), float(slack * unit)};
    };
    Frustum f;
    f.orthographic = camera.orthographic;
    for (int axis = 0; axis < 2; ++axis) {
        const double half = 0.5 * camera.viewport[axis], border = 1.0 + (kReach * std::sqrt(lowPass) + 1.0) / half;
        const glm::dvec3 row(rows[axis]);
        const double at = 1.0 + kJacobianMargin;
        const double reach = kReach * std::max(glm::length(row - at * w), glm::length(row + at * w)); // convex in at
        const double slack = camera.orthographic ? kAngleMargin : 0.0;
        f.planes[2 * axis] = plane(rows[axis] - border * rows[3], reach, slack);
        f.planes[2 * axis + 1] = plane(-rows[axis] - border * rows[3], reach, slack);
    }
    if (camera.orthographic) {
        f.planes[4] = {}; // holds everything: w is 1
    } else {
        f.planes[4] = plane(-rows[3], 0, 0);
        f.planes[4].offset = float(camera.nearW / glm::length(glm::transpose(viewFromWorld) * w));
        f.planes[4].slack = kAngleMargin * f.planes[4].offset;
    }
    return f;
}

/// The keys depend on nothing else.
bool Order::sameKeys(std::span<const OrderInstance> instances, const OrderCamera& camera) const
{
    const auto same = [&](const OrderInstance& a, const OrderInstance& b) {
        return a.positions == b.positions && a.count == b.count && a.first == b.first && a.asset == b.asset && a.worldFromAsset == b.worldFromAsset &&
               glm::length(a.fromEye - b.fromEye) <= camera.eyeRounding;
    };
    return camera.orthographic == orthographic_ && camera.towardsEye == towardsEye_ &&
           std::equal(instances.begin(), instances.end(), sortedAt_.begin(), sortedAt_.end(), same);
}

void Order::sortAll(std::span<const OrderInstance> instances)
{
    keys_.clear();
    sorted_.clear();
    for (const OrderInstance& i : instances)
        for (uint32_t g = 0; g < i.count; ++g) {
            const glm::vec3 d = i.worldFromAsset * i.positions[g] + i.fromEye;
            keys_.push_back(radixKey(orthographic_ ? -glm::dot(towardsEye_, d) : glm::dot(d, d)));
            sorted_.push_back(i.first + g);
        }
    radixSort(std::span(keys_), std::span(sorted_), scratch_);
    std::reverse(sorted_.begin(), sorted_.end()); // after a stable near-to-far sort: ties keep the lower index in front
}

/// Leaves out of sorted_ what culled_ does not hold.
void Order::cull(std::span<const OrderInstance> instances)
{
    uint32_t end = 0;
    for (const OrderInstance& i : instances) end = std::max(end, i.first + i.count);
    touches_.assign(end / 32 + 1, 0u);
    size_t held = 0;
    for (const OrderInstance& i : instances) {
        const float scale = float(worldScale(i));
        for (uint32_t g = 0; g < i.count; ++g) {
            const glm::vec3 d = i.worldFromAsset * i.positions[g] + i.fromEye;
            const uint32_t at = i.first + g, bit = culled_.holds(d, i.maxScales[g] * scale);
            touches_[at >> 5] |= bit << (at & 31);
            held += bit;
        }
    }
    allDrawn_ = held == sorted_.size();
    if (allDrawn_) return;
    drawn_.resize(sorted_.size());
    size_t n = 0;
    for (const uint32_t at : sorted_) {
        drawn_[n] = at;
        n += touches_[at >> 5] >> (at & 31) & 1u;
    }
    drawn_.resize(n);
}

bool Order::update(std::span<const OrderInstance> instances, const OrderCamera& camera)
{
    hasSorted_ = !sameKeys(instances, camera);
    if (hasSorted_) {
        orthographic_ = camera.orthographic, towardsEye_ = camera.towardsEye;
        sortedAt_.assign(instances.begin(), instances.end());
        sortAll(instances);
    }
    if (instances.empty()) {
        allDrawn_ = true;
        return hasSorted_;
    }

    const Frustum frustum = frustumOf(instances, camera);
    if (!hasSorted_ && culled_.covers(frustum)) return false;
    const bool allBefore = allDrawn_;
    culled_ = frustum;
    cull(instances);
    return hasSorted_ || !(allBefore && allDrawn_);
}

} // namespace nacre
