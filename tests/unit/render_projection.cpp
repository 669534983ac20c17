// The SIMD projection against the scalar one.
#include "render/project_gaussians.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <vector>

using namespace nacre;

TEST_CASE("the SIMD projection equals the scalar one bit for bit and sees the same splats")
{
    Camera camera;
    camera.width = 61, camera.height = 47;
    camera.fx = camera.fy = 80;
    camera.cx = 30, camera.cy = 24;
    camera.worldFromCamera[3] = glm::dvec4(0, 0, 3, 1);
    const View<float> view = makeView<float>(camera, 0.1);
    std::mt19937_64 rng(3);
    std::uniform_real_distribution<float> u(-1, 1);
    std::vector<GaussianGeometry<float>> splats(2003); // no multiple of any vector
    for (size_t i = 0; i < splats.size(); ++i) {
        GaussianGeometry<float>& g = splats[i];
        for (float& p : g.position) p = (i % 4 ? 1.0f : 6.0f) * u(rng); // beside the image and behind the camera too
        for (float& s : g.scale) s = 0.1f * std::exp(2 * u(rng));
        for (float& q : g.rotation) q = i % 9 ? u(rng) : 0.0f;
        g.opacity = 0.5f + 0.5f * u(rng);
        if (i % 6 == 0) g.opacity *= 0.01f;
        if (i % 7 == 0) g.scale[2] = 1e-6f;
        if (i % 101 == 0) g.position[i % 3] = NAN;
        if (i % 103 == 0) g.scale[0] = INFINITY;
        if (i % 107 == 0) g.scale[1] = 1e18f;
    }
    std::vector<ProjectedGaussian<float>> projected(splats.size());
    std::vector<uint32_t> visible(splats.size());
    visible.resize(projectGaussians(view, splats, 100, projected.data(), visible.data()));
    CHECK(visible.size() > 300);
    CHECK(visible.size() < 1900);
    size_t v = 0;
    for (size_t i = 0; i < splats.size(); ++i) {
        ProjectedGaussian<float> p;
        if (!projectGaussian(view, splats[i], p)) continue;
        CAPTURE(i);
        REQUIRE(v < visible.size());
        REQUIRE(visible[v++] == 100 + i);
        REQUIRE(std::memcmp(&p, &projected[i], sizeof p) == 0);
    }
    CHECK(v == visible.size());
}
