// Which splats lie near a place.
#pragma once

#include "render/projection.h"

#include <glm/glm.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <vector>

namespace nacre {

/// Median over the splats of the largest standard deviation, at least 1e-6. There must be splats.
inline float medianSplatSize(std::span<const GaussianGeometry<float>> splats)
{
    std::vector<float> sizes;
    for (const GaussianGeometry<float>& g : splats) sizes.push_back(std::max({g.scale[0], g.scale[1], g.scale[2]}));
    std::nth_element(sizes.begin(), sizes.begin() + ptrdiff_t(sizes.size() / 2), sizes.end());
    return std::max(sizes[sizes.size() / 2], 1e-6f);
}

/// Splats sorted by the cell of a grid that holds their centre.
class SplatGrid {
public:
    SplatGrid(std::span<const GaussianGeometry<float>> splats, float cell) : cell_(cell), order_(splats.size()), keys_(splats.size())
    {
        for (size_t i = 0; i < splats.size(); ++i) keys_[i] = key(cellOf(splats[i].position));
        std::iota(order_.begin(), order_.end(), 0u);
        std::sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) { return std::pair(keys_[a], a) < std::pair(keys_[b], b); });
        std::vector<uint64_t> sorted(keys_.size());
        for (size_t k = 0; k < order_.size(); ++k) sorted[k] = keys_[order_[k]];
        keys_.swap(sorted);
    }
    /// visit(index) for the splats of the cell around p and of the 26 cells next to it.
    template <class Visit>
    void visitNear(const float* p, Visit visit) const
    {
        const glm::ivec3 cell = cellOf(p);
        for (int k = 0; k < 27; ++k) visitCell(cell + glm::ivec3(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1), visit);
    }

private:
    glm::ivec3 cellOf(const float* p) const
    {
        const auto index = [&](float x) { return int(std::clamp(std::floor(x / cell_), -1e6f, 1e6f)); };
        return {index(p[0]), index(p[1]), index(p[2])};
    }
    template <class Visit>
    void visitCell(const glm::ivec3& cell, Visit visit) const
    {
        const uint64_t k = key(cell);
        for (size_t i = size_t(std::lower_bound(keys_.begin(), keys_.end(), k) - keys_.begin()); i < keys_.size() && keys_[i] == k; ++i) visit(order_[i]);
    }
    static uint64_t key(const glm::ivec3& c) // 21 bits each
    {
        const auto bits = [](int x) { return uint64_t(uint32_t(x + (1 << 20))); };
        return bits(c.x) << 42 | bits(c.y) << 21 | bits(c.z);
    }
    float cell_;
    std::vector<uint32_t> order_;
    std::vector<uint64_t> keys_;
};

} // namespace nacre
