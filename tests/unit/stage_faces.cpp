// Which faces cameras and light see, and the edge of light on smooth surfaces of few triangles.
#include "stage_scenes.h"

#include "light_stage/placement.h"

using namespace nacre;
using namespace nacre::test;

namespace {

MeshMaterial singleSided(const glm::vec3& albedo) { return lambert(albedo); }
MeshMaterial doubleSided(const glm::vec3& albedo)
{
    MeshMaterial m = lambert(albedo);
    m.doubleSided = true;
    return m;
}

void turnRound(TriangleMesh& m)
{
    for (glm::uvec3& t : m.triangles) std::swap(t.y, t.z);
    for (glm::vec3& n : m.normals) n = -n;
}

const glm::vec3 kRed(0.8f, 0.1f, 0.1f), kBlue(0.1f, 0.1f, 0.8f);

} // namespace

TEST_CASE("of two single-sided sheets back to back a camera sees the one that faces it, whichever comes first")
{
    for (const bool redFirst : {true, false})
        for (const double height : {4.0, -4.0, 300000.0}) {
            CAPTURE(height);
            StageScene scene = sceneOf({plane(1.0f, 0), plane(1.0f, 1)}, {singleSided(kRed), singleSided(kBlue)});
            turnRound(scene.mesh.meshes[1]);
            if (!redFirst) std::swap(scene.mesh.meshes[0], scene.mesh.meshes[1]);
            RenderStats stats;
            const std::vector<Image> images = renderOrFail(scene, cameraAt({0.1, 0, height}, {0, 0, 0}, 8, 1.0 / std::fabs(height)),
                                                           {directionalLight({0, 0, 1}, 3), directionalLight({0, 0, -1}, 3)}, 16, &stats);
            const bool fromAbove = height > 0;
            const Measured red = measure(images[fromAbove ? 0 : 1], 0), blue = measure(images[fromAbove ? 0 : 1], 2);
            CHECK(red.pixels == 64);
            CHECK(red.mean == doctest::Approx((fromAbove ? 0.8 : 0.1) * 3 / M_PI).epsilon(1e-3));
            CHECK(blue.mean == doctest::Approx((fromAbove ? 0.1 : 0.8) * 3 / M_PI).epsilon(1e-3));
            CHECK(measure(images[fromAbove ? 1 : 0], 0).mean == 0.0); // lit from behind
            CHECK(stats.backFaces == 0.0);                           // nothing is hidden that should be seen
        }
}

TEST_CASE("indirect light, too, comes from the sheet that faces it")
{
    // A white wall lit by nothing but what the sheet reflects; the sheet is red towards it, blue away from it.
    for (const bool redFirst : {true, false}) {
        StageScene scene = sceneOf({plane(3.0f, 0), plane(3.0f, 1), plane(3.0f, 2)}, {singleSided(kRed), singleSided(kBlue), doubleSided(glm::vec3(1.0f))});
        turnRound(scene.mesh.meshes[1]);
        for (glm::vec3& p : scene.mesh.meshes[2].positions) p = {p.x, -1.0f, p.y + 3.0f};
        if (!redFirst) std::swap(scene.mesh.meshes[0], scene.mesh.meshes[1]);
        const Image image = renderOrFail(scene, cameraAt({0, 4, 1.5}, {0, -1, 0.7}, 8, 0.1), {directionalLight({0, -0.05f, 1}, 3)}, 256)[0];
        CHECK(measure(image, 0).mean > 5 * measure(image, 2).mean);
    }
}

TEST_CASE("a camera looks through the back of a single-sided sheet and is told; a double-sided one is seen from both sides")
{
    const Camera below = cameraAt({0.1, 0, -4}, {0, 0, 0}, 8, 0.3);
    const std::vector<Light> lights = {directionalLight({0, 0, -1}, 3)};
    RenderStats stats;
    CHECK(measure(renderOrFail(sceneOf({plane(1.0f)}, {doubleSided(kRed)}), below, lights, 16, &stats)[0], 0).mean == doctest::Approx(0.8 * 3 / M_PI).epsilon(1e-3));
    CHECK(stats.backFaces == 0.0);
    const Image none = renderOrFail(sceneOf({plane(1.0f)}, {singleSided(kRed)}), below, lights, 16, &stats)[0];
    for (const float v : none.rgba) CHECK(v == 0.0f);
    CHECK(stats.backFaces == 1.0);
    CHECK(!stats.seesObject);
    // What is clear all through is not seen either, but not for its back.
    StageScene clear = sceneOf({sphere(2)}, {singleSided(kRed)});
    clear.mesh.materials[0].alphaMode = AlphaMode::kBlend;
    clear.mesh.materials[0].baseColor.a = 0.0f;
    renderOrFail(clear, below, lights, 16, &stats);
    CHECK(stats.backFaces == 0.0);
    CHECK(!stats.seesObject);
    // Inside out, a closed body shows its far wall from within.
    StageScene inside = sceneOf({sphere(2)}, {singleSided(kRed)});
    turnRound(inside.mesh.meshes[0]);
    renderOrFail(inside, below, lights, 16, &stats);
    CHECK(stats.backFaces == 1.0);
    CHECK(stats.seesObject);
}

TEST_CASE("a closed single-sided body looks like a double-sided one: its shadow, its light and its outline")
{
    for (const bool smooth : {true, false}) {
        StageScene scene = sceneOf({sphere(3, 1.0f, {0, 0, 1}), plane(5.0f, 1)}, {singleSided(kRed), singleSided(glm::vec3(0.8f))});
        if (!smooth) scene.mesh.meshes[0].normals.clear();
        const Camera camera = cameraAt({0, -6, 4}, {0, 0, 0.5}, 32, 0.8);
        const std::vector<Light> lights = {pointLight({3, -2, 5}, 60)};
        RenderStats stats;
        const Image single = renderOrFail(scene, camera, lights, 32, &stats)[0];
        for (MeshMaterial& m : scene.mesh.materials) m.doubleSided = true;
        CHECK(single.rgba == renderOrFail(scene, camera, lights, 32)[0].rgba);
        CHECK(stats.backFaces == 0.0);
    }
}

TEST_CASE("the back of a single-sided sheet throws a shadow")
{
    // The roof faces down: cameras above look through it, light does not.
    StageScene scene = sceneOf({plane(1.0f, 0), plane(5.0f, 1)}, {singleSided(kRed), doubleSided(glm::vec3(1.0f))});
    turnRound(scene.mesh.meshes[0]);
    for (glm::vec3& p : scene.mesh.meshes[0].positions) p.z = 2.0f;
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, -0.1, 6}, {0, 0, 0}, 8, 0.02), {directionalLight({0, 0, 1}, 3), directionalLight({1, 0, 0.3f}, 3)}, 16);
    CHECK(measure(images[0], 0).pixels == 64);
    CHECK(measure(images[0], 1).mean < 0.05); // what little comes round by way of the roof, which is nearly black in green
    CHECK(measure(images[1], 1).mean > 0.2);  // from the side, below the roof
}

TEST_CASE("volumes are seen from both sides, single-sided as they are")
{
    MeshMaterial glass;
    glass.metallic = 0.0f;
    glass.transmission = 1.0f;
    glass.thickness = 1.0f;
    glass.roughness = 0.1f;
    StageScene scene = sceneOf({sphere(4)}, {glass});
    const MapFolder maps;
    RenderStats stats;
    const Image image = renderOrFail(scene, cameraAt({0, -4, 0}, {0, 0, 0}, 16, 0.2), {maps.constant(glm::vec3(1.0f))}, 64, &stats)[0];
    CHECK(measure(image, 0).mean == doctest::Approx(1.0).epsilon(0.03)); // clear: what goes in comes out
    CHECK(stats.backFaces == 0.0);
}

namespace {

/// A sphere of `around` x `up` quads with smooth normals, as modellers make them.
TriangleMesh globe(int around, int up)
{
    TriangleMesh m;
    for (int j = 0; j <= up; j++)
        for (int i = 0; i <= around; i++) {
            const double phi = 2 * M_PI * i / around, theta = M_PI * j / up;
            m.positions.push_back({std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)});
        }
    m.normals = m.positions;
    for (int j = 0; j < up; j++)
        for (int i = 0; i < around; i++) {
            const unsigned a = unsigned(j * (around + 1) + i), b = a + unsigned(around) + 1;
            if (j > 0) m.triangles.push_back({a, b, a + 1});
            if (j < up - 1) m.triangles.push_back({a + 1, b, b + 1});
        }
    return m;
}

struct Difference {
    double rms = 0, largest = 0; // of radiance over the albedo, where both are covered
};

/// Against a sphere of 130,000 triangles.
Difference fromSphere(const TriangleMesh& mesh, const Camera& camera, const Light& light)
{
    const Image coarse = renderOrFail(sceneOf({mesh}, {lambert(glm::vec3(1.0f))}), camera, {light}, 64)[0];
    const Image fine = renderOrFail(sceneOf({sphere(7)}, {lambert(glm::vec3(1.0f))}), camera, {light}, 64)[0];
    Difference d;
    double count = 0;
    for (size_t p = 0; p < coarse.rgba.size(); p += 4) {
        if (coarse.rgba[p + 3] < 1.0f || fine.rgba[p + 3] < 1.0f) continue;
        const double e = std::fabs(double(coarse.rgba[p]) - double(fine.rgba[p]));
        d.rms += e * e, d.largest = std::max(d.largest, e), count += 1;
    }
    d.rms = std::sqrt(d.rms / count);
    return d;
}

} // namespace

TEST_CASE("smooth spheres of few triangles have the smooth edge of light of a sphere")
{
    // Light across the view: half of the picture is dark. Irradiance pi, so that a facet that faces the light shows 1.
    const Camera camera = cameraAt({0, -5, 0}, {0, 0, 0}, 48, 0.28); // the middle of the sphere, clear of its coarse outline
    for (const glm::vec3 towards : {glm::vec3(1, 0, 0.3f), glm::vec3(0.4f, 0.2f, 1), glm::vec3(-1, 0.1f, -0.6f)})
        for (const int around : {12, 16, 32}) {
            CAPTURE(around);
            const Difference d = fromSphere(globe(around, around / 2), camera, directionalLight(towards, float(M_PI)));
            MESSAGE(around << " x " << around / 2 << ": rms " << d.rms << ", largest " << d.largest);
            // Interpolated normals of a facet of angle a are off by a^2 / 8 at most, seen under the parallax of the sagitta.
            const double a = 2 * M_PI / around;
            CHECK(d.largest < 0.3 * a * a + 0.01);
            CHECK(d.rms < 0.1 * a * a);
        }
}

TEST_CASE("white furnace: a white sphere of few triangles disappears")
{
    const MapFolder maps;
    const Image image = renderOrFail(sceneOf({globe(16, 8)}, {lambert(glm::vec3(1.0f))}), cameraAt({0, -5, 1}, {0, 0, 0}, 32, 0.4), {maps.constant(glm::vec3(0.5f))}, 128)[0];
    const Measured m = measure(image, 0);
    MESSAGE("radiance " << m.mean << " +- " << m.error);
    CHECK(m.is(0.5)); // energy: nothing is made, nothing is lost
}

TEST_CASE("a smooth box touches the ground: its contact shadow has no gap")
{
    // Averaged normals on a box are the worst case: the surface they describe bulges by a good part of an edge.
    TriangleMesh box = slab(1.0f, 1.0f);
    for (glm::vec3& p : box.positions) box.normals.push_back(glm::normalize(p - glm::vec3(0, 0, -0.5f)));
    for (glm::vec3& p : box.positions) p.z += 1.0f;
    const StageScene scene = sceneOf({box, plane(8.0f, 1)}, {lambert(glm::vec3(0.0f)), lambert(glm::vec3(1.0f))});
    const Image image = renderOrFail(scene, cameraAt({3, -0.4, 0.6}, {1.05, 0, 0}, 8, 0.01), {directionalLight({-1, 0, 1}, 3)}, 16)[0];
    CHECK(measure(image, 0).mean < 1e-3); // the ground right beside the wall, in its shadow
}

TEST_CASE("a mesh renders the same in its own units as on the unit sphere, from 1e-12 to 1e12")
{
    for (const float size : {1e-12f, 1e-3f, 1.0f, 1e12f}) {
        CAPTURE(size);
        MeshScene mesh;
        mesh.materials = {lambert(glm::vec3(0.8f))};
        mesh.meshes = {sphere(3, size, glm::vec3(2, 1, -3) * size)};
        const Placement kept = placeMesh(mesh, {}, {0, 0, 1}, false);
        CHECK(kept.radius == doctest::Approx(double(size)).epsilon(0.01));
        StageScene scene;
        scene.mesh = mesh;
        transformMesh(scene.mesh, kept);
        // Both as a dataset in the mesh's own units would have them.
        const glm::dvec3 c = kept.center;
        const double r = kept.radius;
        const Camera camera = onStage(cameraAt(c + r * glm::dvec3(0, -4, 1), c, 16, 0.4), kept);
        const Light light = onStage(pointLight(glm::vec3(c + r * glm::dvec3(2, -3, 3)), float(22 * r * r)), kept);
        CHECK(glm::distance(light.position, glm::vec3(2, -3, 3)) < 1e-5f);
        const Measured m = measure(renderOrFail(scene, camera, {light}, 16)[0], 0);
        CHECK(m.pixels > 100);
        CHECK(m.mean == doctest::Approx(0.1895).epsilon(0.02));
    }
}
