#include "light_stage/fur.h"

#include <doctest/doctest.h>

#include <glm/gtc/constants.hpp>

#include <cmath>
#include <cstring>

using namespace nacre;

namespace {

/// A square of side `size` at height y, facing up, of material `material`.
TriangleMesh square(float size, float x, int material)
{
    TriangleMesh m;
    m.material = material;
    m.positions = {{x, 0, 0}, {x, 0, size}, {x + size, 0, size}, {x + size, 0, 0}};
    m.texcoords[0] = {{0, 0}, {0, 1}, {1, 1}, {1, 0}};
    m.triangles = {{0, 1, 2}, {0, 2, 3}};
    return m;
}

MeshScene twoSquares() // of areas 1 and 4
{
    MeshScene scene;
    scene.meshes = {square(1, 0, 0), square(2, 10, 1)};
    scene.materials.resize(2);
    scene.materials[0].name = "skin";
    scene.materials[0].baseColor = {0.4f, 0.2f, 0.1f, 1};
    scene.materials[1].name = "coat";
    return scene;
}

FurSettings fur(float density, float length = 0.05f, float radius = 0.001f)
{
    FurSettings s;
    s.density = density;
    s.length = length;
    s.radius = radius;
    return s;
}

glm::vec3 pointAt(const HairStrands& hair, size_t strand, float t)
{
    const glm::vec4* p = &hair.controlPoints[4 * strand];
    const float s = 1 - t;
    return glm::vec3(s * s * s * p[0] + 3 * s * s * t * p[1] + 3 * s * t * t * p[2] + t * t * t * p[3]);
}

double arcLength(const HairStrands& hair, size_t strand)
{
    double sum = 0;
    for (int i = 0; i < 400; ++i) sum += glm::length(pointAt(hair, strand, float(i + 1) / 400) - pointAt(hair, strand, float(i) / 400));
    return sum;
}

bool sameBytes(const HairStrands& a, const HairStrands& b)
{
    return a.segmentCount() == b.segmentCount() && a.colors == b.colors &&
           std::memcmp(a.controlPoints.data(), b.controlPoints.data(), a.controlPoints.size() * sizeof(glm::vec4)) == 0;
}

} // namespace

TEST_CASE("strands are spread evenly over the area")
{
    const auto hair = growFur(twoSquares(), fur(3000));
    REQUIRE(hair);
    REQUIRE(hair->segmentCount() == 15000);
    CHECK(hair->colors.size() == hair->segmentCount());
    size_t small = 0, patches[16] = {};
    for (size_t i = 0; i < hair->segmentCount(); ++i) {
        const glm::vec4 root = hair->controlPoints[4 * i];
        if (root.x < 5)
            ++small;
        else
            ++patches[std::min(3, int((root.x - 10) * 2)) * 4 + std::min(3, int(root.z * 2))];
    }
    CHECK(std::abs(double(small) - 3000) <= 1);
    for (const size_t n : patches) CHECK(std::abs(double(n) - 750) < 25); // random roots would stray by 27 in the root mean square
}

TEST_CASE("strands start on the surface, end outside, and are as long and as thick as asked")
{
    FurSettings s = fur(400, 0.2f, 0.004f);
    s.lengthVariation = 0.5f;
    s.tipRadius = 0.25f;
    s.lean = s.disorder = s.clump = 1;
    const auto hair = growFur(twoSquares(), s);
    REQUIRE(hair);
    double shortest = 1, longest = 0;
    for (size_t i = 0; i < hair->segmentCount(); ++i) {
        const glm::vec4 root = hair->controlPoints[4 * i], tip = hair->controlPoints[4 * i + 3];
        CHECK(root.y == 0);
        CHECK(root.w == doctest::Approx(0.004f));
        CHECK(tip.w == doctest::Approx(0.001f));
        for (int k = 1; k < 4; ++k) CHECK(hair->controlPoints[4 * i + k].y > hair->controlPoints[4 * i + k - 1].y); // never back into a flat surface
        const double length = arcLength(*hair, i);
        shortest = std::min(shortest, length);
        longest = std::max(longest, length);
    }
    CHECK(longest <= 0.2 * 1.001);
    CHECK(longest > 0.199);
    CHECK(shortest >= 0.1 * 0.999);
    CHECK(shortest < 0.101);
}

TEST_CASE("combed fur hangs towards the ground on a wall, and stands straight without lean, disorder and clumps")
{
    MeshScene scene = twoSquares();
    scene.meshes.resize(1);
    for (glm::vec3& p : scene.meshes[0].positions) p = {p.x, -p.z, 0}; // upright, facing +Z
    FurSettings s = fur(1000);
    const auto combed = growFur(scene, s);
    REQUIRE(combed);
    glm::dvec3 mean(0);
    for (size_t i = 0; i < combed->segmentCount(); ++i)
        mean += glm::dvec3(combed->controlPoints[4 * i + 3] - combed->controlPoints[4 * i]) / double(combed->segmentCount());
    CHECK(mean.y < -0.2 * s.length);
    CHECK(mean.z > 0.3 * s.length);
    s.lean = s.disorder = s.clump = 0;
    const auto straight = growFur(scene, s);
    REQUIRE(straight);
    for (size_t i = 0; i < straight->segmentCount(); ++i) {
        const glm::vec3 d(straight->controlPoints[4 * i + 3] - straight->controlPoints[4 * i]);
        CHECK(d.z == doctest::Approx(glm::length(d)));
    }
}

TEST_CASE("strands take the colour of the surface at their root")
{
    MeshScene scene = twoSquares();
    scene.textures.push_back({"stripes", 2, 1, {255, 0, 0, 255, 0, 0, 188, 255}, TextureWrap::kRepeat, TextureWrap::kRepeat, true});
    scene.materials[1].baseColor = {0.5f, 0.5f, 0.5f, 1};
    scene.materials[1].baseColorTexture.texture = 0;
    scene.meshes[0].colors.assign(4, glm::vec4(0.5f, 1, 1, 1));
    const auto hair = growFur(scene, fur(50));
    REQUIRE(hair);
    for (size_t i = 0; i < hair->segmentCount(); ++i) {
        const float x = hair->controlPoints[4 * i].x;
        const glm::vec3 expected = x < 5 ? glm::vec3(0.2f, 0.2f, 0.1f) : x < 11 ? glm::vec3(0.5f, 0, 0) : glm::vec3(0, 0, 0.25144f); // sRGB 188
        CHECK(glm::length(hair->colors[i] - expected) < 1e-3f);
    }
}

TEST_CASE("fur grows on the chosen material only, and not where an alpha mask cuts the surface away")
{
    MeshScene scene = twoSquares();
    FurSettings s = fur(100);
    for (const char* filter : {"coat", "#1"}) {
        s.material = filter;
        const auto hair = growFur(scene, s);
        REQUIRE(hair);
        CHECK(hair->segmentCount() == 400);
        for (size_t i = 0; i < hair->segmentCount(); ++i) CHECK(hair->controlPoints[4 * i].x >= 10);
    }
    s.material.assign(1, '*');
    CHECK(growFur(scene, s)->segmentCount() == 500);
    scene.materials[0].alphaMode = AlphaMode::kMask;
    scene.materials[0].baseColor.a = 0.3f;
    CHECK(growFur(scene, s)->segmentCount() == 400);
    s.material = "wool";
    const auto none = growFur(scene, s);
    REQUIRE(!none);
    CHECK(none.error().message.find("'wool'") != std::string::npos);
    CHECK(none.error().message.find("#0 'skin', #1 'coat'") != std::string::npos);
}

TEST_CASE("fur repeats itself for a seed and differs between seeds")
{
    FurSettings s = fur(500);
    const auto a = growFur(twoSquares(), s), b = growFur(twoSquares(), s);
    s.seed = 1;
    const auto c = growFur(twoSquares(), s);
    REQUIRE((a && b && c));
    CHECK(sameBytes(*a, *b));
    CHECK(!sameBytes(*a, *c));
}

TEST_CASE("degenerate meshes give finite strands or a clear error")
{
    MeshScene scene = twoSquares();
    TriangleMesh bad;
    bad.positions = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {NAN, 0, 0}, {3e38f, 0, 0}, {-3e38f, 3e38f, 0}, {1e-30f, 0, 0}, {0, 1e-30f, 0}};
    bad.normals.assign(8, glm::vec3(NAN));
    bad.triangles = {{0, 1, 2}, {0, 0, 0}, {0, 1, 3}, {0, 6, 7}};
    scene.meshes.insert(scene.meshes.begin(), bad);
    scene.meshes[1].normals = {{0, -1, 0}, {0, 0, 0}, {NAN, 0, 0}, {0, 1e-20f, 0}};
    const auto hair = growFur(scene, fur(1000, 0.5f));
    REQUIRE(hair);
    CHECK(hair->segmentCount() == 5000);
    for (const glm::vec4& p : hair->controlPoints) REQUIRE(std::isfinite(p.x + p.y + p.z + p.w));

    scene.meshes.resize(1);
    scene.meshes[0].triangles.resize(3);
    CHECK(growFur(scene, fur(1000)).error().message.find("no area") != std::string::npos);
    scene.meshes[0].triangles = {{0, 4, 5}}; // a triangle the size of the number range
    CHECK(!growFur(scene, fur(1000)));
    CHECK(!growFur(MeshScene{}, fur(1000)));
}

TEST_CASE("settings out of range and strand counts out of bounds are errors that say what to try")
{
    const MeshScene scene = twoSquares();
    const auto message = [&](const FurSettings& s) {
        const auto r = growFur(scene, s);
        return r ? std::string("accepted") : r.error().message;
    };
    CHECK(message(fur(0)).find("density is 0, expected") != std::string::npos);
    CHECK(message(fur(-3)).find("density is -3") != std::string::npos);
    CHECK(message(fur(NAN)).find("density") != std::string::npos);
    CHECK(message(fur(100, 0)).find("length is 0") != std::string::npos);
    CHECK(message(fur(100, INFINITY)).find("length") != std::string::npos);
    CHECK(message(fur(100, 0.05f, 0)).find("radius is 0") != std::string::npos);
    CHECK(message(fur(100, 0.05f, 0.06f)).find("radius") != std::string::npos);
    CHECK(message(fur(1e9f)).find("5e+09 strands, at most 4000000") != std::string::npos);
    CHECK(message(fur(1e9f)).find("density below 800000") != std::string::npos);
    CHECK(message(fur(0.01f)).find("density above 0.2") != std::string::npos);
    FurSettings s = fur(100);
    s.clump = 1.5f;
    CHECK(message(s).find("clump is 1.5") != std::string::npos);
    s = fur(100);
    s.lengthVariation = 1;
    CHECK(message(s).find("length variation is 1") != std::string::npos);
}
