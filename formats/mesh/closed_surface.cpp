// Welding goes by a grid of cells sixteen times as wide as the distance: a vertex looks for one near enough in the cells that its surroundings touch,
// mostly one. It joins the first it finds, so chains of vertices do not melt into one.
#include "mesh/closed_surface.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace nacre {
namespace {

class Welder {
public:
    explicit Welder(float distance) : distance_(std::max(double(distance), 1e-30)) {}

    /// Number of the place of `p`.
    uint32_t operator()(const glm::vec3& p)
    {
        const auto [known, isNew] = exact_.try_emplace(p, 0);
        if (!isNew) return known->second;
        const glm::i64vec3 low = cellOf(glm::dvec3(p) - distance_), high = cellOf(glm::dvec3(p) + distance_);
        for (int64_t x = low.x; x <= high.x; ++x)
            for (int64_t y = low.y; y <= high.y; ++y)
                for (int64_t z = low.z; z <= high.z; ++z)
                    if (const auto cell = cells_.find({x, y, z}); cell != cells_.end())
                        for (const uint32_t place : cell->second)
                            if (glm::distance(glm::dvec3(places_[place]), glm::dvec3(p)) <= distance_) return known->second = place;
        known->second = uint32_t(places_.size());
        places_.push_back(p);
        cells_[cellOf(glm::dvec3(p))].push_back(known->second);
        return known->second;
    }

private:
    glm::i64vec3 cellOf(const glm::dvec3& p) const { return glm::i64vec3(glm::floor(glm::clamp(p / (16.0 * distance_), -4e18, 4e18))); }

    struct Hash {
        static uint64_t mix(uint64_t h, uint64_t v) { return h = (h ^ v) * 0x9e3779b97f4a7c15ull, h ^ (h >> 29); }
        size_t operator()(const glm::vec3& p) const
        {
            uint64_t h = 0;
            for (int i = 0; i < 3; ++i) h = mix(h, __builtin_bit_cast(uint32_t, p[i] + 0.0f));
            return size_t(h);
        }
        size_t operator()(const glm::i64vec3& c) const { return size_t(mix(mix(mix(0, uint64_t(c.x)), uint64_t(c.y)), uint64_t(c.z))); }
    };

    double distance_;
    std::vector<glm::vec3> places_;
    std::unordered_map<glm::vec3, uint32_t, Hash> exact_;
    std::unordered_map<glm::i64vec3, std::vector<uint32_t>, Hash> cells_;
};

} // namespace

size_t countOpenEdges(const MeshScene& scene, int material, float weld)
{
    Welder placeOf(weld);
    std::unordered_map<uint64_t, int> balance;
    for (const TriangleMesh& m : scene.meshes) {
        if (m.material != material) continue;
        for (const glm::uvec3& t : m.triangles)
            for (int k = 0; k < 3; ++k) {
                const uint32_t a = placeOf(m.positions[t[k]]), b = placeOf(m.positions[t[(k + 1) % 3]]);
                if (a != b) balance[(uint64_t(std::min(a, b)) << 32) | std::max(a, b)] += a < b ? 1 : -1;
            }
    }
    return size_t(std::count_if(balance.begin(), balance.end(), [](const auto& edge) { return edge.second != 0; }));
}

double signedVolume(const MeshScene& scene, int material)
{
    double sum = 0.0;
    for (const TriangleMesh& m : scene.meshes)
        if (m.material == material)
            for (const glm::uvec3& t : m.triangles)
                sum += glm::dot(glm::dvec3(m.positions[t.x]), glm::cross(glm::dvec3(m.positions[t.y]), glm::dvec3(m.positions[t.z]))) / 6.0;
    return sum;
}

void turnInsideOut(MeshScene& scene, int material)
{
    for (TriangleMesh& m : scene.meshes) {
        if (m.material != material) continue;
        for (glm::uvec3& t : m.triangles) std::swap(t.y, t.z);
        for (glm::vec3& n : m.normals) n = -n;
    }
}

} // namespace nacre
