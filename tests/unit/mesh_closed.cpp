// Closed surfaces and their seams.
#include "mesh/closed_surface.h"

#include <doctest/doctest.h>

#include <cmath>
#include <numbers>

using namespace nacre;

namespace {

/// A sphere of rings and segments with a seam of its own vertices, `gap` wide; optionally without its last ring.
MeshScene seamSphere(float radius, double gap, bool open, const glm::vec3& centre = glm::vec3(0.0f))
{
    constexpr int kAround = 24, kUp = 12;
    MeshScene scene;
    scene.materials.resize(1);
    TriangleMesh& m = scene.meshes.emplace_back();
    for (int j = 0; j <= kUp; j++)
        for (int i = 0; i <= kAround; i++) {
            const double phi = 2 * std::numbers::pi * i / kAround + (i == kAround ? gap : 0), theta = std::numbers::pi * j / kUp;
            m.positions.push_back(centre + radius * glm::vec3(std::sin(theta) * std::cos(phi), std::cos(theta), -std::sin(theta) * std::sin(phi)));
        }
    for (int j = 0; j < (open ? kUp - 1 : kUp); j++)
        for (int i = 0; i < kAround; i++) {
            const unsigned a = unsigned(j * (kAround + 1) + i), b = a + kAround + 1;
            if (j > 0) m.triangles.push_back({a, b, a + 1});
            if (j < kUp - 1) m.triangles.push_back({a + 1, b, b + 1});
        }
    return scene;
}

} // namespace

TEST_CASE("a seam that differs by rounding is closed; a gap and a hole are open")
{
    for (const float radius : {1e-6f, 1.0f, 1e6f})
        for (const glm::vec3& centre : {glm::vec3(0.0f), glm::vec3(0.3f, -0.7f, 0.2f) * radius}) {
            CAPTURE(radius);
            CHECK(countOpenEdges(seamSphere(radius, 0, false, centre), 0, 1e-6f * radius) == 0);
            CHECK(countOpenEdges(seamSphere(radius, 2e-7, false, centre), 0, 1e-6f * radius) == 0);
            CHECK(countOpenEdges(seamSphere(radius, 1e-3, false, centre), 0, 1e-6f * radius) == 24); // both sides of twelve rings
            CHECK(countOpenEdges(seamSphere(radius, 0, true, centre), 0, 1e-6f * radius) == 24);
        }
    CHECK(countOpenEdges(seamSphere(1.0f, 2e-7, false), 1, 1e-6f) == 0); // no such material, nothing open
}

TEST_CASE("the volume tells the side, and turning the surface inside out changes its sign")
{
    MeshScene scene = seamSphere(1.0f, 0, false);
    const double volume = signedVolume(scene, 0);
    CHECK(volume == doctest::Approx(4.0 / 3.0 * std::numbers::pi).epsilon(0.05));
    turnInsideOut(scene, 0);
    CHECK(signedVolume(scene, 0) == doctest::Approx(-volume));
    CHECK(countOpenEdges(scene, 0, 1e-6f) == 0);
}
