#include "splat/visual_hull.h"

#include "base/random.h"
#include "render/projection.h"
#include "splats/morton.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace nacre {

void frameCube(std::span<const Camera> cameras, float center[3], float* halfSize)
{
    // Least squares: sum over axes of (I - d d^T) (x - o) = 0.
    glm::dmat3 a(0.0);
    glm::dvec3 b(0.0);
    for (const Camera& c : cameras) {
        const glm::dvec3 d = -glm::normalize(glm::dvec3(c.worldFromCamera[2]));
        const glm::dmat3 m = glm::dmat3(1.0) - glm::outerProduct(d, d);
        a += m, b += m * c.position();
    }
    glm::dvec3 x(0.0);
    const double n = double(cameras.size());
    const bool onePlace = std::all_of(cameras.begin(), cameras.end(), [&](const Camera& c) { // there all axes meet, whatever they look at
        return glm::distance(c.position(), cameras[0].position()) <= 1e-5 * glm::length(c.position());
    });
    if (glm::determinant(a / n) > 1e-6 && !onePlace) {
        x = glm::inverse(a) * b;
    } else { // one camera, or parallel axes: a unit in front of them
        for (const Camera& c : cameras) x += (c.position() - glm::normalize(glm::dvec3(c.worldFromCamera[2]))) / n;
    }
    double half = 0;
    for (const Camera& c : cameras)
        half = std::max(half, glm::length(c.position() - x) * 0.5 * std::max(c.width / c.fx, c.height / c.fy));
    for (int k = 0; k < 3; ++k) center[k] = float(x[k]);
    *halfSize = float(half);
}

namespace {

constexpr double kMostOutside = 0.05; // of the cameras that frame a voxel of the object, when they vote
constexpr double kLies = 0.1;         // a mask that excludes so much of what the vote finds is wrong (right ones: 0.007 at most),
constexpr double kHoles = 0.25;       // and if the others together exclude so much of it, they have holes (without: 0.05, of fur 0.11)

glm::vec3 voxelCenter(const VisualHull& hull, size_t x, size_t y, size_t z)
{
    const float voxel = 2.0f * hull.halfSize / float(hull.resolution);
    return glm::vec3(hull.center[0], hull.center[1], hull.center[2]) - hull.halfSize + (glm::vec3(x, y, z) + 0.5f) * voxel;
}

/// What the mask shows of a point; kMaskUnknown if the camera does not frame it.
MaskValue maskAt(const View<float>& v, const std::vector<uint8_t>& mask, const glm::vec3& p)
{
    float t[3];
    for (int k = 0; k < 3; ++k) t[k] = detail::dot3(&v.r[3 * k], &p.x) + v.t[k];
    if (!(t[2] > kNearPlane)) return kMaskUnknown;
    const float px = v.fx * t[0] / t[2] + v.cx, py = v.fy * t[1] / t[2] + v.cy;
    if (px < 0 || py < 0 || px >= v.width || py >= v.height) return kMaskUnknown;
    return MaskValue(mask[size_t(py) * size_t(v.width) + size_t(px)]);
}

/// Keeps the voxels that no more than a share of the cameras that can tell see outside. Of voxels that are not kept the vote may stop early.
void carve(VisualHull& hull, std::span<const View<float>> views, std::span<const std::vector<uint8_t>> masks, const std::vector<uint8_t>& trusted, double share)
{
    const size_t n = size_t(hull.resolution), most = size_t(share * double(views.size()));
    hull.inside.assign(n * n * n, 0);
    tbb::parallel_for(size_t(0), n, [&](size_t z) {
        for (size_t y = 0; y < n; ++y)
            for (size_t x = 0; x < n; ++x) {
                const glm::vec3 p = voxelCenter(hull, x, y, z);
                size_t seen = 0, outside = 0;
                for (size_t c = 0; c < views.size() && outside <= most; ++c) {
                    if (!trusted[c]) continue;
                    const MaskValue mask = maskAt(views[c], masks[c], p);
                    seen += mask != kMaskUnknown, outside += mask == kMaskBackground;
                }
                hull.inside[(z * n + y) * n + x] = seen > 0 && double(outside) <= share * double(seen);
            }
    });
}

/// Of each mask: the share of the hull, as far as it can tell, that it excludes.
std::vector<double> excludes(const VisualHull& hull, std::span<const View<float>> views, std::span<const std::vector<uint8_t>> masks)
{
    constexpr size_t kStep = 2; // every other voxel each way says enough
    const size_t n = size_t(hull.resolution);
    std::vector<double> share(views.size());
    tbb::parallel_for(size_t(0), views.size(), [&](size_t c) {
        size_t seen = 0, outside = 0;
        for (size_t z = 0; z < n; z += kStep)
            for (size_t y = 0; y < n; y += kStep)
                for (size_t x = 0; x < n; x += kStep) {
                    if (!hull.inside[(z * n + y) * n + x]) continue;
                    const MaskValue mask = maskAt(views[c], masks[c], voxelCenter(hull, x, y, z));
                    seen += mask != kMaskUnknown, outside += mask == kMaskBackground;
                }
        share[c] = double(outside) / double(std::max<size_t>(seen, 1));
    });
    return share;
}

} // namespace

VisualHull carveVisualHull(std::span<const Camera> cameras, std::span<const std::vector<uint8_t>> masks, int resolution, std::vector<size_t>* wrong)
{
    VisualHull hull;
    frameCube(cameras, hull.center, &hull.halfSize);
    hull.resolution = resolution;
    const size_t n = size_t(resolution);
    const float voxel = 2.0f * hull.halfSize / float(resolution);
    std::vector<View<float>> views;
    for (const Camera& c : cameras) views.push_back(makeView<float>(c, 0.0));

    std::vector<uint8_t> trusted(views.size(), 1);
    carve(hull, views, masks, trusted, kMostOutside);
    const std::vector<double> share = excludes(hull, views, masks);
    for (size_t c = 0; c < views.size(); ++c) {
        trusted[c] = share[c] <= kLies;
        if (!trusted[c] && wrong) wrong->push_back(c);
    }
    // Right masks are all believed: where few cameras look into a hollow, the vote fills it. (bunny_wax: 5 % of its volume, worth 0.1 dB.)
    const auto volume = [&] { return double(std::count(hull.inside.begin(), hull.inside.end(), 1)); };
    const double byVote = volume();
    std::vector<uint8_t> voted = hull.inside;
    carve(hull, views, masks, trusted, 0);
    if (volume() < (1 - kHoles) * byVote) hull.inside = std::move(voted);

    const auto at = [&](int64_t x, int64_t y, int64_t z) {
        return x >= 0 && y >= 0 && z >= 0 && x < int64_t(n) && y < int64_t(n) && z < int64_t(n) && hull.inside[(size_t(z) * n + size_t(y)) * n + size_t(x)];
    };
    std::vector<std::vector<OrientedPoint>> slices(n);
    tbb::parallel_for(size_t(0), n, [&](size_t z) {
        for (size_t y = 0; y < n; ++y)
            for (size_t x = 0; x < n; ++x) {
                const int64_t i = int64_t(x), j = int64_t(y), k = int64_t(z);
                if (!at(i, j, k)) continue;
                if (at(i - 1, j, k) && at(i + 1, j, k) && at(i, j - 1, k) && at(i, j + 1, k) && at(i, j, k - 1) && at(i, j, k + 1)) continue;
                OrientedPoint s;
                const glm::vec3 p = voxelCenter(hull, x, y, z);
                for (int c = 0; c < 3; ++c) s.position[c] = p[c];
                float g[3] = {0, 0, 0}; // occupancy gradient over a 5^3 neighbourhood points inwards
                for (int dz = -2; dz <= 2; ++dz)
                    for (int dy = -2; dy <= 2; ++dy)
                        for (int dx = -2; dx <= 2; ++dx)
                            if (at(i + dx, j + dy, k + dz)) g[0] -= float(dx), g[1] -= float(dy), g[2] -= float(dz);
                const float length = std::sqrt(detail::dot3(g, g));
                for (int c = 0; c < 3; ++c) s.normal[c] = length > 0 ? g[c] / length : (c == 2 ? 1.0f : 0.0f);
                slices[z].push_back(s);
            }
    });
    for (const auto& slice : slices) hull.surface.insert(hull.surface.end(), slice.begin(), slice.end());
    hull.surfaceArea = double(hull.surface.size()) * voxel * voxel;
    return hull;
}

bool touchesBorder(const VisualHull& hull)
{
    const size_t n = size_t(hull.resolution);
    for (size_t i = 0; i < hull.inside.size(); ++i) {
        const size_t x = i % n, y = i / n % n, z = i / (n * n);
        if (hull.inside[i] && (x == 0 || y == 0 || z == 0 || x == n - 1 || y == n - 1 || z == n - 1)) return true;
    }
    return false;
}

std::vector<OrientedPoint> sampleHull(const VisualHull& hull, size_t count, uint64_t seed)
{
    Random random(seed, 0x4011);
    std::vector<OrientedPoint> points(count);
    const float voxel = hull.resolution > 0 ? 2.0f * hull.halfSize / float(hull.resolution) : 0.0f;
    for (size_t i = 0; i < count; ++i) {
        OrientedPoint& p = points[i];
        if (hull.surface.empty()) {
            for (int k = 0; k < 3; ++k) p.position[k] = hull.center[k] + hull.halfSize * (2.0f * random.uniform() - 1.0f), p.normal[k] = k == 2;
            continue;
        }
        // Stratified along the scan order of the boundary voxels, which is spread over the whole surface.
        const double at = (double(i) + random.uniform()) * double(hull.surface.size()) / double(count);
        p = hull.surface[std::min(hull.surface.size() - 1, size_t(at))];
        for (float& x : p.position) x += voxel * (random.uniform() - 0.5f);
    }
    const std::vector<uint32_t> order = mortonOrder(count, [&](size_t i) { return points[i].position; });
    std::vector<OrientedPoint> sorted(count);
    for (size_t i = 0; i < count; ++i) sorted[i] = points[order[i]];
    return sorted;
}

} // namespace nacre
