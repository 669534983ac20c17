#include "train/object_region.h"

#include "base/random.h"
#include "dataset/normalise.h"
#include "splats/morton.h"

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace nacre {

ObjectRegion regionOf(const std::vector<OlatSplit>& splits)
{
    const Framing framing = frameCameras(splits);
    return {glm::vec3(framing.centre), float(framing.halfSize)};
}

namespace {

constexpr float kThin = 0.02f; // of the region's radius: how far from a plane its points lie

float height(const glm::vec4& plane, const glm::vec3& p) { return glm::dot(glm::vec3(plane), p) - plane.w; }

glm::vec3 across(const glm::vec3& n) { return glm::normalize(std::abs(n.z) < 0.7f ? glm::cross(n, glm::vec3(0, 0, 1)) : glm::cross(n, glm::vec3(1, 0, 0))); }

/// Least squares through the points near a plane.
glm::vec4 fitted(const glm::vec4& plane, const std::vector<glm::vec3>& points, float thin)
{
    const glm::vec3 n(plane), u = across(n), v = glm::cross(n, u);
    glm::dmat3 normal(1e-9);
    glm::dvec3 moment(0);
    for (const glm::vec3& p : points) {
        const float h = height(plane, p);
        if (std::abs(h) > thin) continue;
        const glm::dvec3 x(glm::dot(p, u), glm::dot(p, v), 1.0);
        normal += glm::outerProduct(x, x), moment += double(h) * x;
    }
    const glm::dvec3 fit = glm::inverse(normal) * moment; // height = fit . (u, v, 1)
    const glm::vec3 m = n - float(fit.x) * u - float(fit.y) * v;
    const float length = glm::length(m);
    if (!std::isfinite(length) || !(length > 0)) return plane;
    return glm::vec4(m / length, (plane.w + float(fit.z)) / length);
}

} // namespace

std::optional<glm::vec4> supportingPlane(const std::vector<glm::vec3>& all, const ObjectRegion& region, const std::vector<Camera>& cameras)
{
    constexpr int kTries = 1500, kSectors = 12, kRings = 4;
    constexpr float kFarthest = 1.8f;    // radii: the distance is of no account
    constexpr float kAround = 0.4f;      // radii from the middle: what is nearer may be the object's own flat side
    constexpr double kAbove = 0.9;       // of the cameras
    constexpr double kMostBelow = 0.05;  // of the points
    constexpr double kCovered = 0.3;     // of the cells around the object
    const float radius = region.radius, thin = kThin * radius;
    std::vector<glm::vec3> points;
    for (const glm::vec3& p : all)
        if (glm::distance(p, region.center) < kFarthest * radius) points.push_back(p);
    if (points.size() < 30) return std::nullopt;

    /// Cells around the object that hold points of the plane; 0 if it is no table.
    const auto covers = [&](const glm::vec4& plane) {
        const glm::vec3 n(plane), foot = region.center - height(plane, region.center) * n, u = across(n), v = glm::cross(n, u);
        size_t below = 0;
        std::array<int, kSectors * kRings> cells{};
        for (const glm::vec3& p : points) {
            const float h = height(plane, p);
            below += h < -2 * thin;
            if (std::abs(h) > thin) continue;
            const glm::vec3 d = p - foot;
            const float r = glm::length(d) / radius - kAround, angle = std::atan2(glm::dot(d, v), glm::dot(d, u)) / 6.2831853f + 0.5f;
            if (r < 0) continue;
            ++cells[size_t(std::min(int(r / 0.25f), kRings - 1) * kSectors + std::clamp(int(angle * kSectors), 0, kSectors - 1))];
        }
        return double(below) > kMostBelow * double(points.size()) ? 0 : std::count_if(cells.begin(), cells.end(), [](int c) { return c > 0; });
    };
    Random random(1, 0x4013);
    glm::vec4 best(0);
    ptrdiff_t most = 0;
    const auto consider = [&](const glm::vec4& plane) {
        const float over = height(plane, region.center);
        if (!(over > 0 && over < radius)) return; // through the region, under its centre
        size_t above = 0;
        for (const Camera& c : cameras) above += height(plane, glm::vec3(c.position())) > 0;
        if (double(above) < kAbove * double(cameras.size())) return;
        if (const ptrdiff_t n = covers(plane); n > most) most = n, best = plane;
    };
    for (int k = 0; k < kTries; ++k) {
        const auto any = [&] { return points[random.below(uint32_t(points.size()))]; };
        const glm::vec3 a = any(), b = any(), c = any();
        glm::vec3 n = glm::cross(b - a, c - a);
        if (!(glm::length(n) > 0.02f * radius * radius)) continue; // nearly in a line
        n = glm::normalize(n);
        if (glm::dot(n, region.center - a) < 0) n = -n;
        consider(glm::vec4(n, glm::dot(n, a)));
    }
    if (most == 0) return std::nullopt;
    for (int round = 0; round < 3; ++round) best = fitted(best, points, thin);
    if (double(covers(best)) < kCovered * kSectors * kRings) return std::nullopt;
    return best;
}

InitialSplats splatsForRegion(const ObjectRegion& region, const std::vector<glm::vec3>& points, size_t count, uint64_t seed)
{
    constexpr double kOnPoints = 0.75, kAround = 0.05, kOnPlane = 0.05; // of the splats
    constexpr float kNearest = 1.1f, kFarthest = 6.0f;               // radii, of those around: nearer than the cameras and beyond them
    constexpr float kCell = 0.04f;                                   // radii
    Random random(seed, 0x4012);
    InitialSplats found;
    const auto add = [&](const glm::vec3& p, const glm::vec3& scale, const glm::quat& rotation, float opacity) {
        if (region.plane && height(*region.plane, p) < -2 * kThin * region.radius) return;
        found.cloud.positions.push_back(p), found.cloud.scales.push_back(scale), found.cloud.rotations.push_back(rotation), found.cloud.opacities.push_back(opacity);
    };
    const glm::quat upright(1, 0, 0, 0);
    const auto share = [&](double of) { return size_t(of * double(count)); };

    std::set<std::array<int, 3>> cells; // that hold points: their number tells the surface's area
    std::vector<glm::vec3> object; // those of the surroundings would take most
    for (const glm::vec3& p : points) {
        if (!region.holds(&p.x) || (region.plane && height(*region.plane, p) < kThin * region.radius)) continue;
        object.push_back(p);
        const glm::vec3 u = glm::floor((p - region.center) / (kCell * region.radius));
        cells.insert({int(u.x), int(u.y), int(u.z)});
    }
    const size_t onPoints = std::min(object.size(), share(kOnPoints));
    const float near = onPoints > 0 ? kCell * region.radius * std::sqrt(0.7f * float(cells.size()) / float(onPoints)) : 0;
    for (size_t i = 0; i < onPoints; ++i)
        add(object[size_t((double(i) + random.uniform()) * double(object.size()) / double(onPoints))], glm::vec3(0.6f * near), upright, 0.5f);

    const auto direction = [&] {
        glm::vec3 d;
        do d = 2.0f * glm::vec3(random.uniform(), random.uniform(), random.uniform()) - 1.0f;
        while (!(glm::dot(d, d) <= 1 && glm::dot(d, d) > 1e-4f));
        return glm::normalize(d);
    };
    const size_t around = share(kAround), onPlane = region.plane ? share(kOnPlane) : 0, inside = count - onPoints - around - onPlane;
    const float spacing = region.radius * std::cbrt(4.19f / float(std::max<size_t>(inside, 1)));
    for (size_t i = 0; i < inside; ++i) { // faint, so that light and gradients pass the nearest ones
        const glm::vec3 p = region.center + region.radius * std::cbrt(random.uniform()) * direction();
        add(p, glm::vec3(0.6f * spacing), upright, 0.1f);
    }
    for (size_t i = 0; i < around; ++i) {
        const float away = region.radius * kNearest * std::pow(kFarthest / kNearest, random.uniform());
        add(region.center + away * direction(), glm::vec3(0.6f * away * std::sqrt(12.6f / float(around))), upright, 0.1f);
    }
    if (onPlane > 0) {
        const glm::vec3 n(*region.plane), foot = region.center - height(*region.plane, region.center) * n, u = across(n), v = glm::cross(n, u);
        const glm::quat turn = glm::quat_cast(glm::mat3(u, v, n));
        for (size_t i = 0; i < onPlane; ++i) {
            const float r = 3.0f * region.radius * std::sqrt(random.uniform()), angle = 6.2831853f * random.uniform();
            const float size = 0.6f * 3.0f * region.radius * std::sqrt(3.14f / float(onPlane));
            add(foot + r * (std::cos(angle) * u + std::sin(angle) * v), glm::vec3(size, size, 0.2f * size), turn, 0.5f);
        }
    }

    InitialSplats out;
    const SplatCloud& from = found.cloud;
    SplatCloud& to = out.cloud;
    to.count = from.positions.size();
    for (uint32_t i : mortonOrder(to.count, [&](size_t k) { return &from.positions[k].x; }))
        to.positions.push_back(from.positions[i]), to.scales.push_back(from.scales[i]), to.rotations.push_back(from.rotations[i]), to.opacities.push_back(from.opacities[i]);
    out.colors.assign(to.count, glm::vec3(1.0f));
    return out;
}

namespace {

/// A splat as a piece of a surface.
struct Facet {
    glm::vec3 position;
    float area; // times opacity
};

/// Splats whose cells of a grid touch, in groups; those of small groups are loose.
void cutLoose(const std::vector<Facet>& facets, const ObjectRegion& region, ObjectCut& cut)
{
    constexpr int kCells = 24;        // a side
    constexpr double kFilled = 0.1;   // of a cell's face that its splats cover, for others to count as its neighbours: haze holds nothing together
    constexpr double kSmall = 0.02;   // of the area of the largest group
    const auto cellOf = [&](const glm::vec3& p) {
        const glm::vec3 u = (p - region.center + region.radius) / (2 * region.radius) * float(kCells);
        const glm::ivec3 i = glm::clamp(glm::ivec3(u), glm::ivec3(0), glm::ivec3(kCells - 1));
        return (i.z * kCells + i.y) * kCells + i.x;
    };
    std::vector<double> area(size_t(kCells * kCells * kCells), 0.0);
    for (size_t i = 0; i < facets.size(); ++i)
        if (cut.kept[i]) area[size_t(cellOf(facets[i].position))] += double(facets[i].area);
    const double side = 2 * double(region.radius) / kCells;
    const auto filled = [&](size_t cell) { return area[cell] * 6.28 > kFilled * side * side; };
    std::vector<int> group(area.size(), -1);
    std::vector<double> sums;
    for (int start = 0; start < int(area.size()); ++start) {
        if (!filled(size_t(start)) || group[size_t(start)] >= 0) continue;
        std::vector<int> open = {start};
        const int name = int(sums.size());
        sums.push_back(0), group[size_t(start)] = name;
        while (!open.empty()) {
            const int cell = open.back(), x = cell % kCells, y = cell / kCells % kCells, z = cell / (kCells * kCells);
            open.pop_back();
            sums[size_t(name)] += area[size_t(cell)];
            if (!filled(size_t(cell))) continue; // the rim: it leads no further
            for (int dz = -1; dz <= 1; ++dz)
                for (int dy = -1; dy <= 1; ++dy)
                    for (int dx = -1; dx <= 1; ++dx) {
                        if (std::min({x + dx, y + dy, z + dz}) < 0 || std::max({x + dx, y + dy, z + dz}) >= kCells) continue;
                        const size_t next = size_t(((z + dz) * kCells + y + dy) * kCells + x + dx);
                        if (area[next] > 0 && group[next] < 0) group[next] = name, open.push_back(int(next));
                    }
        }
    }
    if (sums.empty()) return;
    const double least = kSmall * *std::max_element(sums.begin(), sums.end());
    for (size_t i = 0; i < facets.size(); ++i)
        if (const int of = group[size_t(cellOf(facets[i].position))]; cut.kept[i] && (of < 0 || sums[size_t(of)] < least)) cut.kept[i] = 0, ++cut.loose;
}

} // namespace

ObjectCut findObject(const SplatCloud& cloud, const ObjectRegion& region, const std::vector<Camera>& cameras)
{
    constexpr float kOpaque = 0.5f;
    ObjectCut cut;
    cut.kept.assign(cloud.count, 1);
    std::vector<Facet> facets;
    std::vector<glm::vec3> opaque;
    for (size_t i = 0; i < cloud.count; ++i) {
        const glm::vec3& s = cloud.scales[i];
        facets.push_back({cloud.positions[i], cloud.opacities[i] * s.x * s.y * s.z / std::min({s.x, s.y, s.z})});
        if (cloud.opacities[i] > kOpaque) opaque.push_back(cloud.positions[i]);
    }
    cut.plane = region.plane ? region.plane : supportingPlane(opaque, region, cameras);
    for (size_t i = 0; i < cloud.count; ++i) {
        const glm::vec3& p = cloud.positions[i];
        if (!region.holds(&p.x)) cut.kept[i] = 0, ++cut.outside;
        else if (cut.plane && height(*cut.plane, p) < kThin * region.radius) cut.kept[i] = 0, ++cut.below;
    }
    cutLoose(facets, region, cut);
    return cut;
}

} // namespace nacre
