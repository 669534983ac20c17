// Keys: |d|^2 with d = worldFromAsset p + fromEye, orthographic -dot(towardsEye, d). All splats are sorted, and those that cannot touch
// the frame are left out afterwards, because what is in the frame changes when the camera turns and the order does not. Only while the
// eye moves and more than half of them cannot touch the frame, the others alone are sorted.
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
#include <bit>
#include <cmath>

namespace nacre {

constexpr float kReach = 3.37f;        // sqrt(2 ln 255), where alpha falls to 1/255 at opacity 1, and 1 % for matrices that have drifted
constexpr float kAngleMargin = 0.05f;  // radians that the camera may turn before it culls again
constexpr float kRounding = 1e-6f;     // of positions, relative to their distance

static double worldScale(const OrderInstance& i) { return std::cbrt(std::abs(glm::determinant(glm::dmat3(i.worldFromAsset)))); }

/// True if what `other` holds without its margins is within these.
bool Order::Frustum::covers(const Frustum& other) const
{
    const float angle = orthographic ? 0.0f : 0.98f * kAngleMargin; // the rest is for rounding
    for (int k = 0; k < count; ++k) {
        const Plane &a = planes[k], &b = other.planes[k];
        if (!(glm::length(a.normal - b.normal) <= angle && std::abs(b.offset - a.offset) <= a.slack)) return false;
        if (!(b.reach <= (1.0f + kAngleMargin) * a.reach)) return false;
    }
    return count == other.count && orthographic == other.orthographic;
}

/// Splats from the eye, world space: arrays of one coordinate each, which compilers turn into vectors.
struct Order::Block {
    static constexpr uint32_t kSize = 256;
    uint32_t first, count;           // list indices
    float x[kSize], y[kSize], z[kSize], square[kSize], scale[kSize];

    void place(const OrderInstance& i, uint32_t g)
    {
        first = i.first + g, count = std::min(kSize, i.count - g);
        const uint32_t count = this->count;
        const glm::mat3 m = i.worldFromAsset;
        for (uint32_t k = 0; k < count; ++k) {
            const glm::vec3& p = i.positions[g + k];
            x[k] = m[0].x * p.x + m[1].x * p.y + m[2].x * p.z + i.fromEye.x;
            y[k] = m[0].y * p.x + m[1].y * p.y + m[2].y * p.z + i.fromEye.y;
            z[k] = m[0].z * p.x + m[1].z * p.y + m[2].z * p.z + i.fromEye.z;
        }
        for (uint32_t k = 0; k < count; ++k) square[k] = x[k] * x[k] + y[k] * y[k] + z[k] * z[k];
    }
};

void Order::computeKeys(const Block& b, uint32_t* keys) const
{
    const glm::vec3 t = source_.towardsEye;
    const uint32_t count = b.count;  // here and below: a local, which no store can change
    if (source_.orthographic)
        for (uint32_t k = 0; k < count; ++k) keys[k] = radixKey(-(t.x * b.x[k] + t.y * b.y[k] + t.z * b.z[k]));
    else
        for (uint32_t k = 0; k < count; ++k) keys[k] = radixKey(b.square[k]);
}

/// Where all splats of an instance lie, by their bounding sphere; `scale` is the world length of an asset unit.
Order::Side Order::sideOf(const OrderInstance& i, const Bounds& bounds, float scale) const
{
    const glm::vec3 centre = i.worldFromAsset * bounds.centre + i.fromEye;
    const float radius = 1.01f * scale * bounds.radius; // matrices may have drifted
    const float open = culled_.orthographic ? kRounding : kAngleMargin, rounding = kRounding * (glm::length(centre) + radius);
    bool inside = true;
    for (const Plane& p : culled_.inUse()) {
        const float at = glm::dot(p.normal, centre) + p.offset - p.slack;
        const float reach = (1.0f + kAngleMargin) * p.reach * scale * bounds.maxScale;
        if (at - radius - rounding > reach + open * (glm::length(centre) + radius)) return Side::kOutside;
        inside = inside && at + radius + rounding < 0;
    }
    return inside ? Side::kInside : Side::kAcross;
}

void Order::setBits(uint32_t at, uint64_t bits)
{
    touching_ += size_t(std::popcount(bits));
    bits <<= at & 31;
    touches_[at >> 5] |= uint32_t(bits), touches_[(at >> 5) + 1] |= uint32_t(bits >> 32);
}

void Order::markAll(const OrderInstance& i)
{
    for (uint32_t g = 0; g < i.count; g += 32) setBits(i.first + g, i.count - g < 32 ? (1u << (i.count - g)) - 1 : ~0u);
}

/// Sets the bits of what reaches the frame, or would after a small turn.
void Order::mark(const Block& b)
{
    const uint32_t count = b.count;
    float outside[Block::kSize];     // how far, less what the planes are opened by
    for (uint32_t k = 0; k < count; ++k) outside[k] = 0;
    for (const Plane& p : culled_.inUse()) {
        const glm::vec3 n = p.normal;
        const float offset = p.offset - p.slack, reach = (1.0f + kAngleMargin) * p.reach;
        for (uint32_t k = 0; k < count; ++k) {
            const float by = n.x * b.x[k] + n.y * b.y[k] + n.z * b.z[k] + offset - reach * b.scale[k];
            outside[k] = by > outside[k] ? by : outside[k]; // NaN counts as inside: it is left to the shader
        }
    }
    uint32_t touches[Block::kSize] = {};
    const float open = culled_.orthographic ? kRounding : kAngleMargin;
    for (uint32_t k = 0; k < count; ++k) touches[k] = outside[k] * outside[k] > open * open * b.square[k] ? 0 : 1; // outside > open |d|

    for (uint32_t k = 0; k < count; k += 32) {
        uint32_t bits = 0;
        for (uint32_t j = 0; j < 32; ++j) bits |= touches[k + j] << j;
        setBits(b.first + k, bits);
    }
}

Order::Frustum Order::frustumOf(std::span<const OrderInstance> instances, const OrderCamera& camera)
{
    if (instances.empty()) return {};
    const OrderInstance& any = instances.front(); // all see the same camera
    const glm::dmat3 viewFromWorld = glm::dmat3(any.viewFromAsset) * glm::inverse(glm::dmat3(any.worldFromAsset));
    const glm::dvec3 viewAtZero = glm::dvec3(any.viewTranslation) - viewFromWorld * glm::dvec3(any.fromEye); // where d is 0
    const double cameraScale = any.viewScale / worldScale(any);
    float lowPass = 0;
    for (const OrderInstance& i : instances) lowPass = std::max(lowPass, i.lowPass);

    const glm::dmat4 rows = glm::transpose(glm::dmat4(camera.clipFromView));
    const glm::dvec3 w(rows[3]);
    const auto plane = [&](const glm::dvec4& clip, double reach, double slack) { // dot(clip, (v, 1)) <= reach * scale, in view space
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
    f.count = 4;
    if (!camera.orthographic) {      // where w is 1
        Plane& near = f.planes[f.count++];
        near = plane(-rows[3], 0, 0);
        near.offset = float(camera.nearW / glm::length(glm::transpose(viewFromWorld) * w));
        near.slack = kAngleMargin * near.offset;
    }
    return f;
}

static bool sameSplats(const OrderInstance& a, const OrderInstance& b)
{
    return a.positions == b.positions && a.count == b.count && a.first == b.first && a.asset == b.asset;
}

bool OrderSource::sameSplats(std::span<const OrderInstance> instances) const
{
    return std::equal(instances.begin(), instances.end(), instances_.begin(), instances_.end(), nacre::sameSplats);
}

bool OrderSource::differs(std::span<const OrderInstance> instances, const OrderCamera& camera) const
{
    const auto samePlace = [&](const OrderInstance& a, const OrderInstance& b) {
        return a.worldFromAsset == b.worldFromAsset && glm::length(a.fromEye - b.fromEye) <= camera.eyeRounding;
    };
    return camera.orthographic != orthographic || camera.towardsEye != towardsEye || !sameSplats(instances) ||
           !std::equal(instances.begin(), instances.end(), instances_.begin(), samePlace);
}

void OrderSource::remember(std::span<const OrderInstance> instances, const OrderCamera& camera)
{
    instances_.assign(instances.begin(), instances.end());
    orthographic = camera.orthographic, towardsEye = camera.towardsEye;
}

/// One pass over the positions: bits of those that reach the frame and, if `sorts`, keys of all.
void Order::pass(std::span<const OrderInstance> instances, bool sorts)
{
    if (sorts) keys_.resize(listed_.size());
    uint32_t end = 0;
    for (const OrderInstance& i : instances) end = std::max(end, i.first + i.count);
    touches_.assign(end / 32 + 2, 0u);
    touching_ = 0;
    drawnOf_.clear();
    Block b;
    uint32_t* keys = keys_.data();
    for (size_t n = 0; n < instances.size(); ++n) {
        const OrderInstance& i = instances[n];
        const float scale = float(worldScale(i));
        const Side side = sideOf(i, bounds_[n], scale);
        const size_t before = touching_;
        if (side == Side::kInside) markAll(i);
        const bool places = sorts || side == Side::kAcross;
        for (uint32_t g = 0; places && g < i.count; g += Block::kSize) {
            b.place(i, g);
            if (sorts) computeKeys(b, keys), keys += b.count;
            if (side != Side::kAcross) continue;
            for (uint32_t k = 0; k < b.count; ++k) b.scale[k] = scale * i.maxScales[g + k];
            mark(b);
        }
        drawnOf_.push_back(uint32_t(touching_ - before));
    }
}

Order::Bounds Order::boundsOf(const OrderInstance& i)
{
    if (i.count == 0) return {};
    glm::vec3 low = i.positions[0], high = low;
    float maxScale = 0;
    for (uint32_t g = 0; g < i.count; ++g) {
        low = glm::min(low, i.positions[g]), high = glm::max(high, i.positions[g]);
        maxScale = std::max(maxScale, i.maxScales[g]);
    }
    return {0.5f * (low + high), 0.5f * glm::length(high - low), maxScale};
}

/// What depends on which splats there are, and not on where.
void Order::list(std::span<const OrderInstance> instances)
{
    listed_.clear();
    bounds_.clear();
    for (const OrderInstance& i : instances) {
        bounds_.push_back(boundsOf(i));
        for (uint32_t g = 0; g < i.count; ++g) listed_.push_back(i.first + g);
    }
}

/// All splats, or only those that touch.
void Order::sort(bool all)
{
    std::span<const uint32_t> keys = keys_, list = listed_;
    if (!all) {
        someKeys_.resize(keys_.size()), someListed_.resize(keys_.size());
        size_t n = 0;
        for (size_t i = 0; i < keys_.size(); ++i) {
            someKeys_[n] = keys_[i], someListed_[n] = listed_[i];
            n += touches(listed_[i]);
        }
        keys = std::span(someKeys_).first(n), list = std::span(someListed_).first(n);
    }
    sorted_.resize(keys.size());
    sort_.descending(keys, list, sorted_);
    allSorted_ = all;
}

void Order::gather()
{
    allDrawn_ = touching_ == sorted_.size();
    if (allDrawn_) return;
    drawn_.resize(sorted_.size());
    size_t n = 0;
    for (const uint32_t at : sorted_) {
        drawn_[n] = at;
        n += touches(at);
    }
    drawn_.resize(n);
}

bool Order::update(std::span<const OrderInstance> instances, const OrderCamera& camera)
{
    const Frustum frustum = frustumOf(instances, camera);
    const bool moved = source_.differs(instances, camera);
    hasSorted_ = false;
    if (!moved && culled_.covers(frustum)) return false;
    if (moved) {
        if (!source_.sameSplats(instances)) list(instances);
        source_.remember(instances, camera);
    }
    culled_ = frustum;
    hasSorted_ = moved || !allSorted_;
    const bool allBefore = allDrawn_;
    pass(instances, hasSorted_);
    if (hasSorted_) sort(!moved || 2 * touching_ >= listed_.size());
    gather();
    return hasSorted_ || !(allBefore && allDrawn_);
}

} // namespace nacre
