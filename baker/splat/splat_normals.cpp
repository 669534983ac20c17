#include "splat/splat_normals.h"

#include "splat/splat_grid.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace nacre {

namespace {

constexpr float kFacingCosine = 0.7071f;

glm::vec3 shortAxis(const GaussianGeometry<float>& g, const glm::vec3& outside)
{
    float unit[4], m[9];
    detail::normalizeQuaternion(g.rotation, unit);
    detail::rotationMatrix(unit, m);
    const int axis = int(std::min_element(g.scale, g.scale + 3) - g.scale);
    const glm::vec3 n(m[axis], m[3 + axis], m[6 + axis]);
    return glm::dot(n, outside) < 0 ? -n : n;
}

} // namespace

std::vector<glm::vec3> splatNormals(std::span<const GaussianGeometry<float>> splats, std::span<const glm::vec3> outside)
{
    const size_t n = splats.size();
    if (n == 0) return {};
    std::vector<glm::vec3> axes(n), normals(n);
    for (size_t i = 0; i < n; ++i) axes[i] = shortAxis(splats[i], outside[i]);
    const float size = medianSplatSize(splats);
    const SplatGrid grid(splats, 2 * size);
    tbb::parallel_for(size_t(0), n, [&](size_t i) {
        const glm::vec3 p(splats[i].position[0], splats[i].position[1], splats[i].position[2]);
        glm::vec3 sum(0);
        grid.visitNear(splats[i].position, [&](uint32_t j) {
            const glm::vec3 d = glm::vec3(splats[j].position[0], splats[j].position[1], splats[j].position[2]) - p;
            if (glm::dot(axes[i], axes[j]) < kFacingCosine) return;
            sum += splats[j].opacity * std::exp(-0.5f * glm::dot(d, d) / (size * size)) * axes[j];
        });
        const float length = glm::length(sum);
        normals[i] = length > 1e-6f ? sum / length : axes[i];
    });
    return normals;
}

std::vector<uint32_t> splatNeighbours(std::span<const GaussianGeometry<float>> splats, std::span<const glm::vec3> normals)
{
    const size_t n = splats.size();
    std::vector<uint32_t> neighbours(n * kSplatNeighbours);
    if (n == 0) return neighbours;
    const SplatGrid grid(splats, 2 * medianSplatSize(splats));
    tbb::enumerable_thread_specific<std::vector<std::pair<float, uint32_t>>> workspaces;
    tbb::parallel_for(size_t(0), n, [&](size_t i) {
        auto& near = workspaces.local(); // square distance, index
        near.clear();
        const glm::vec3 p(splats[i].position[0], splats[i].position[1], splats[i].position[2]);
        grid.visitNear(splats[i].position, [&](uint32_t j) {
            if (j == i || glm::dot(normals[i], normals[j]) < kFacingCosine) return;
            const glm::vec3 d = glm::vec3(splats[j].position[0], splats[j].position[1], splats[j].position[2]) - p;
            near.emplace_back(glm::dot(d, d), j);
        });
        const size_t found = std::min(near.size(), size_t(kSplatNeighbours));
        std::partial_sort(near.begin(), near.begin() + ptrdiff_t(found), near.end());
        for (size_t k = 0; k < kSplatNeighbours; ++k) neighbours[i * kSplatNeighbours + k] = k < found ? near[k].second : uint32_t(i);
    });
    return neighbours;
}

} // namespace nacre
