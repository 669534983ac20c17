#include "splat/splat_normals.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nacre {

namespace {

glm::vec3 shortAxis(const GaussianGeometry<float>& g, const glm::vec3& outside)
{
    float unit[4], m[9];
    detail::normalizeQuaternion(g.rotation, unit);
    detail::rotationMatrix(unit, m);
    const int axis = int(std::min_element(g.scale, g.scale + 3) - g.scale);
    const glm::vec3 n(m[axis], m[3 + axis], m[6 + axis]);
    return glm::dot(n, outside) < 0 ? -n : n;
}

/// Splats sorted by the cell of a grid that holds their centre.
class CellGrid {
public:
    CellGrid(std::span<const GaussianGeometry<float>> splats, float cell) : cell_(cell), order_(splats.size()), keys_(splats.size())
    {
        for (size_t i = 0; i < splats.size(); ++i) keys_[i] = key(cellOf(splats[i].position));
        std::iota(order_.begin(), order_.end(), 0u);
        std::sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) { return std::pair(keys_[a], a) < std::pair(keys_[b], b); });
        std::vector<uint64_t> sorted(keys_.size());
        for (size_t k = 0; k < order_.size(); ++k) sorted[k] = keys_[order_[k]];
        keys_.swap(sorted);
    }
    glm::ivec3 cellOf(const float* p) const
    {
        const auto index = [&](float x) { return int(std::clamp(std::floor(x / cell_), -1e6f, 1e6f)); };
        return {index(p[0]), index(p[1]), index(p[2])};
    }
    template <class Visit>
    void visit(const glm::ivec3& cell, Visit visit) const
    {
        const uint64_t k = key(cell);
        for (size_t i = size_t(std::lower_bound(keys_.begin(), keys_.end(), k) - keys_.begin()); i < keys_.size() && keys_[i] == k; ++i) visit(order_[i]);
    }

private:
    static uint64_t key(const glm::ivec3& c) // 21 bits each
    {
        const auto bits = [](int x) { return uint64_t(uint32_t(x + (1 << 20))); };
        return bits(c.x) << 42 | bits(c.y) << 21 | bits(c.z);
    }
    float cell_;
    std::vector<uint32_t> order_;
    std::vector<uint64_t> keys_;
};

} // namespace

std::vector<glm::vec3> splatNormals(std::span<const GaussianGeometry<float>> splats, std::span<const glm::vec3> outside)
{
    constexpr float kCosine = 0.7071f;
    const size_t n = splats.size();
    if (n == 0) return {};
    std::vector<glm::vec3> axes(n), normals(n);
    std::vector<float> sizes(n);
    for (size_t i = 0; i < n; ++i) {
        axes[i] = shortAxis(splats[i], outside[i]);
        sizes[i] = std::max({splats[i].scale[0], splats[i].scale[1], splats[i].scale[2]});
    }
    std::nth_element(sizes.begin(), sizes.begin() + ptrdiff_t(n / 2), sizes.end());
    const float size = std::max(sizes[n / 2], 1e-6f);
    const CellGrid grid(splats, 2 * size);
    tbb::parallel_for(size_t(0), n, [&](size_t i) {
        const glm::ivec3 cell = grid.cellOf(splats[i].position);
        const glm::vec3 p(splats[i].position[0], splats[i].position[1], splats[i].position[2]);
        glm::vec3 sum(0);
        for (int k = 0; k < 27; ++k)
            grid.visit(cell + glm::ivec3(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1), [&](uint32_t j) {
                const glm::vec3 d = glm::vec3(splats[j].position[0], splats[j].position[1], splats[j].position[2]) - p;
                if (glm::dot(axes[i], axes[j]) < kCosine) return;
                sum += splats[j].opacity * std::exp(-0.5f * glm::dot(d, d) / (size * size)) * axes[j];
            });
        const float length = glm::length(sum);
        normals[i] = length > 1e-6f ? sum / length : axes[i];
    });
    return normals;
}

} // namespace nacre
