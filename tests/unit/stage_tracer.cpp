// The path tracer against closed forms: Lambert's law, furnaces, half spaces, reciprocity, superposition.
#include "stage_scenes.h"

using namespace nacre;
using namespace nacre::test;

TEST_CASE("a Lambertian plane under a point light has radiance albedo I cos / (pi r^2) within 0.2 %")
{
    const StageScene scene = sceneOf({plane(50.0f)}, {lambert({0.8f, 0.5f, 0.2f})});
    const Camera camera = cameraAt({0, -3, 4}, {0, 0, 0}, 16, 0.002);
    const glm::vec3 places[2] = {{0, 0, 2}, {1, 2, 1.5f}};
    const std::vector<Image> images = renderOrFail(scene, camera, {pointLight(places[0], 10), pointLight(places[1], 10)}, 16);
    for (size_t i = 0; i < 2; ++i) {
        const double r2 = glm::dot(places[i], places[i]), expected = 10.0 * (places[i].z / std::sqrt(r2)) / (M_PI * r2);
        CHECK(measure(images[i], 0).mean == doctest::Approx(0.8 * expected).epsilon(0.002));
        CHECK(measure(images[i], 1).mean == doctest::Approx(0.5 * expected).epsilon(0.002));
        CHECK(measure(images[i], 2).mean == doctest::Approx(0.2 * expected).epsilon(0.002));
        CHECK(measure(images[i], 0).pixels == 256);
    }
}

TEST_CASE("a directional light gives radiance albedo E cos / pi")
{
    const StageScene scene = sceneOf({plane(50.0f)}, {lambert(glm::vec3(1.0f))});
    const glm::vec3 d = glm::normalize(glm::vec3(0.3f, 0.4f, 0.6f));
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, -3, 4}, {0, 0, 0}, 8, 0.01), {directionalLight(d, 3)}, 16);
    CHECK(measure(images[0], 0).mean == doctest::Approx(3.0 * d.z / M_PI).epsilon(1e-4));
}

TEST_CASE("white furnace: a white diffuse sphere disappears in a constant environment")
{
    const MapFolder maps;
    const StageScene scene = sceneOf({sphere(5)}, {lambert(glm::vec3(1.0f))});
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, -4, 1}, {0, 0, 0}, 48, 0.5), {maps.constant(glm::vec3(0.7f))}, 64);
    const Measured m = measure(images[0], 0);
    MESSAGE("radiance " << m.mean << " +- " << m.error);
    CHECK(m.error < 0.002);
    CHECK(m.is(0.7));
}

TEST_CASE("white furnace: a body that scatters without loss disappears, whatever its boundary")
{
    const MapFolder maps;
    const Light constant = maps.constant(glm::vec3(0.5f));
    for (const SubsurfaceBoundary boundary : {SubsurfaceBoundary::kDiffuse, SubsurfaceBoundary::kNone, SubsurfaceBoundary::kDielectric})
        for (const float g : {0.0f, 0.7f}) {
            CAPTURE(int(boundary));
            CAPTURE(g);
            MeshMaterial m = lambert(glm::vec3(1.0f));
            m.roughness = 0.05f;
            if (boundary != SubsurfaceBoundary::kDiffuse) m.specular = 1.0f;
            StageScene scene = sceneOf({sphere(5)}, {m});
            SubsurfaceOverride sss;
            sss.material = "m";
            sss.singleScatterAlbedo = glm::vec3(1.0f);
            sss.meanFreePath = {0.2f, 0.5f, 1.0f};
            sss.anisotropy = g;
            sss.boundary = boundary;
            scene.subsurface = {sss};
            RenderStats stats;
            const std::vector<Image> images = renderOrFail(scene, cameraAt({0, -4, 1}, {0, 0, 0}, 32, 0.5), {constant}, 64, &stats);
            CHECK(stats.leakedWalks == 0.0);
            CHECK(stats.cutWalks == 0.0);
            for (int c = 0; c < 3; ++c) {
                const Measured v = measure(images[0], c);
                MESSAGE("boundary " << int(boundary) << " g " << g << " channel " << c << ": " << v.mean << " +- " << v.error);
                CHECK(v.error < 0.004);
                // A rough dielectric loses what its microfacets would scatter a second time; at this roughness that is below 1 %.
                if (boundary == SubsurfaceBoundary::kDielectric) CHECK(v.mean == doctest::Approx(0.5).epsilon(0.015));
                else CHECK(v.is(0.5, 12.0));
            }
        }
}

TEST_CASE("half space: reflectance of all three boundaries agrees with adding-doubling")
{
    // Values: tests/bench/results/slab_reference.md (g = 0; adding-doubling, right to 1e-6). By reciprocity, radiance towards the
    // normal under a constant environment is the reflectance for light along the normal.
    const MapFolder maps;
    const Light constant = maps.constant(glm::vec3(1.0f));
    struct Case {
        SubsurfaceBoundary boundary;
        float alpha, g;
        double reflectance;
    };
    const Case cases[] = {
        {SubsurfaceBoundary::kDiffuse, 0.9f, 0.0f, 0.478024},    {SubsurfaceBoundary::kDiffuse, 0.99f, 0.5f, 0.723441},
        {SubsurfaceBoundary::kNone, 0.9f, 0.0f, 0.414947},       {SubsurfaceBoundary::kNone, 0.99f, 0.0f, 0.752721},
        {SubsurfaceBoundary::kNone, 0.9f, 0.5f, 0.277782},       {SubsurfaceBoundary::kDielectric, 0.9f, 0.0f, 0.259925},
        {SubsurfaceBoundary::kDielectric, 0.99f, 0.0f, 0.601989},
    };
    for (const Case& k : cases) {
        CAPTURE(int(k.boundary));
        CAPTURE(k.alpha);
        MeshMaterial m = lambert(glm::vec3(1.0f));
        m.roughness = 0.03f;
        m.specular = k.boundary == SubsurfaceBoundary::kDielectric ? 1.0f : 0.0f;
        StageScene scene = sceneOf({slab(300.0f, 300.0f)}, {m});
        SubsurfaceOverride sss;
        sss.material = "m";
        sss.singleScatterAlbedo = glm::vec3(k.alpha);
        sss.meanFreePath = glm::vec3(1.0f);
        sss.anisotropy = k.g;
        sss.boundary = k.boundary;
        scene.subsurface = {sss};
        const std::vector<Image> images = renderOrFail(scene, cameraAt({0, 0, 5}, {0, 0, 0}, 16, 0.01), {constant}, 256);
        const Measured v = measure(images[0], 1);
        MESSAGE("boundary " << int(k.boundary) << " alpha " << k.alpha << " g " << k.g << ": " << v.mean << " +- " << v.error << ", expected "
                            << k.reflectance);
        CHECK(v.error < 0.005);
        CHECK(v.is(k.reflectance, 7.0));
    }
}

TEST_CASE("regularised caustics keep the light that leaves a medium")
{
    MeshMaterial m = lambert(glm::vec3(1.0f));
    m.roughness = 0.15f;
    m.specular = 1.0f;
    StageScene scene = sceneOf({slab(300.0f, 300.0f)}, {m});
    SubsurfaceOverride sss;
    sss.material = "m";
    sss.singleScatterAlbedo = glm::vec3(0.99f);
    sss.meanFreePath = glm::vec3(1.0f);
    sss.boundary = SubsurfaceBoundary::kDielectric;
    scene.subsurface = {sss};
    const MapFolder maps;
    const Camera camera = cameraAt({0, 0, 5}, {0, 0, 0}, 16, 0.01);
    const std::vector<Light> lights = {directionalLight({1, 0, 1}, 1), maps.constant(glm::vec3(1.0f))};
    const std::vector<Image> exact = renderOrFail(scene, camera, lights, 512), regular = renderOrFail(scene, camera, lights, 512, nullptr, 0, 0.25f);
    for (size_t l = 0; l < 2; ++l) {
        const Measured a = measure(exact[l], 1), b = measure(regular[l], 1);
        MESSAGE((l ? "environment " : "directional ") << a.mean << " +- " << a.error << ", regularised " << b.mean << " +- " << b.error);
        CHECK(std::fabs(a.mean - b.mean) < 0.01 * a.mean + 3.5 * std::hypot(a.error, b.error));
        if (l == 0) CHECK(b.error < 0.6 * a.error); // what it is for
    }
}

TEST_CASE("the diffuse albedo asked for is the reflectance that a half space shows")
{
    const MapFolder maps;
    const Light constant = maps.constant(glm::vec3(1.0f));
    StageScene scene = sceneOf({slab(300.0f, 300.0f)}, {lambert(glm::vec3(1.0f))});
    SubsurfaceOverride sss;
    sss.material = "*";
    sss.albedo = {0.9f, 0.5f, 0.1f};
    sss.meanFreePath = {1.0f, 0.5f, 0.2f};
    scene.subsurface = {sss};
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, 0, 5}, {0, 0, 0}, 16, 0.01), {constant}, 512);
    for (int c = 0; c < 3; ++c) {
        const Measured v = measure(images[0], c);
        // van de Hulst's formula is 0.002 off at worst; the rest is noise
        CHECK(std::fabs(v.mean - sss.albedo[c]) < 0.002 + 3.5 * v.error);
    }
}

TEST_CASE("a mean free path too short to follow is raised, and still shows the albedo asked for")
{
    StageScene scene = sceneOf({sphere(4)}, {lambert(glm::vec3(1.0f))});
    SubsurfaceOverride sss;
    sss.material = "m";
    sss.albedo = glm::vec3(0.8f);
    sss.meanFreePath = glm::vec3(1e-9f);
    scene.subsurface = {sss};
    Result<PathTracer> tracer = PathTracer::create(StageScene(scene));
    REQUIRE(tracer);
    CHECK(tracer->warnings().size() == 1);
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, 0, 4}, {0, 0, 1}, 8, 0.02), {directionalLight({0, 0, 1}, 1)}, 512);
    const Measured m = measure(images[0], 0);
    CHECK(m.error < 0.01 * m.mean);
    CHECK(m.mean == doctest::Approx(0.8 / M_PI).epsilon(0.03)); // noise, and 0.002 of van de Hulst's formula
}

TEST_CASE("a body too thick to walk through ends in a bounded time and says how many walks were cut")
{
    MeshMaterial m = lambert(glm::vec3(1.0f));
    m.roughness = 0.3f;
    for (const SubsurfaceBoundary boundary : {SubsurfaceBoundary::kDiffuse, SubsurfaceBoundary::kNone, SubsurfaceBoundary::kDielectric}) {
        StageScene scene = sceneOf({sphere(3)}, {m});
        SubsurfaceOverride sss;
        sss.material = "m";
        sss.singleScatterAlbedo = glm::vec3(1.0f); // nothing ends a walk but the surface
        sss.meanFreePath = glm::vec3(0.0005f);
        sss.boundary = boundary;
        scene.subsurface = {sss};
        RenderStats stats;
        const std::vector<Image> images = renderOrFail(scene, cameraAt({0, 0, 4}, {0, 0, 0}, 4, 0.3), {pointLight({0, 0, 4}, 10)}, 16, &stats);
        CHECK(stats.cutWalks < 0.1);
        for (const float v : images[0].rgba) CHECK(std::isfinite(v));
    }
}

TEST_CASE("a specular layer over a lossless walk neither adds nor loses light")
{
    const MapFolder maps;
    MeshMaterial m = lambert(glm::vec3(1.0f));
    m.specular = 1.0f;
    m.roughness = 0.1f; // smooth enough that single-scattering microfacets lose nothing visible
    StageScene scene = sceneOf({sphere(5)}, {m});
    SubsurfaceOverride sss;
    sss.material = "m";
    sss.singleScatterAlbedo = glm::vec3(1.0f);
    sss.meanFreePath = glm::vec3(0.3f);
    scene.subsurface = {sss};
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, -4, 1}, {0, 0, 0}, 32, 0.5), {maps.constant(glm::vec3(1.0f))}, 64);
    CHECK(measure(images[0], 1).mean == doctest::Approx(1.0).epsilon(0.01));
}

/// 300 crossing strands of radius 0.02 in the unit ball, white but in blue.
static StageScene tuft()
{
    StageScene scene = sceneOf({}, {lambert(glm::vec3(1.0f))});
    for (int i = 0; i < 300; ++i) {
        const auto random = [&](int k) { return std::fmod(0.6180339887 * (i + 1) * (k + 3) * 1.37 + 0.31 * k, 1.0) * 2.0 - 1.0; };
        const glm::vec3 a(random(0), random(1), random(2)), b(random(3), random(4), random(5)), bend(0.2 * random(6), 0.2 * random(7), 0);
        for (int k = 0; k < 4; ++k) scene.hair.controlPoints.push_back(glm::vec4(glm::mix(a, b, float(k) / 3.0f) + (k % 3 ? bend : glm::vec3(0.0f)), 0.02f));
        scene.hair.colors.push_back(glm::vec3(1.0f, 1.0f, 0.2f));
    }
    return scene;
}

TEST_CASE("white furnace: a tuft of fibres that absorb nothing disappears; dark fibres do not")
{
    const MapFolder maps;
    const Light constant = maps.constant(glm::vec3(0.6f));
    const StageScene scene = tuft();
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, -4, 1}, {0, 0, 0}, 48, 0.6), {constant}, 128);
    const Measured white = measure(images[0], 0), blue = measure(images[0], 2);
    MESSAGE("white " << white.mean << " +- " << white.error << ", dark " << blue.mean);
    CHECK(white.pixels > 100);
    CHECK(white.error < 0.01);
    CHECK(white.is(0.6));
    CHECK(blue.mean < 0.5);
    CHECK(blue.mean > 0.05);
}

TEST_CASE("regularised fibres keep the light that a lamp sends through them")
{
    const StageScene scene = tuft();
    const Camera camera = cameraAt({0, -4, 1}, {0, 0, 0}, 32, 0.6);
    const std::vector<Light> lights = {pointLight({3, -3, 3}, 60)};
    const Measured exact = measure(renderOrFail(scene, camera, lights, 256)[0], 0);
    const Measured regular = measure(renderOrFail(scene, camera, lights, 256, nullptr, 0, 0.25f)[0], 0);
    MESSAGE("lamp on a tuft: " << exact.mean << " +- " << exact.error << ", regularised " << regular.mean << " +- " << regular.error);
    CHECK(regular.mean == doctest::Approx(exact.mean).epsilon(0.06)); // the same paths but for the last lobe: little noise between them
}

TEST_CASE("GGX without multiple scattering: what a white metal loses is known and grows with roughness")
{
    const MapFolder maps;
    const Light constant = maps.constant(glm::vec3(1.0f));
    double before = 1.001;
    for (const float roughness : {0.1f, 0.5f, 1.0f}) {
        MeshMaterial m;
        m.roughness = roughness;
        const std::vector<Image> images = renderOrFail(sceneOf({sphere(5)}, {m}), cameraAt({0, -4, 1}, {0, 0, 0}, 32, 0.5), {constant}, 64);
        const Measured v = measure(images[0], 0);
        MESSAGE("roughness " << roughness << ": a white metal reflects " << v.mean << " +- " << v.error);
        CHECK(v.mean < before);
        CHECK(v.mean > 0.35); // 0.37 at roughness 1
        before = v.mean;
    }
}

TEST_CASE("reciprocity: a small lamp and a small sensor may change places")
{
    // Point lamp and pinhole far from a body of all lobes but clearcoat (whose glTF definition is not reciprocal). The flux through
    // the body from a lamp at A to a sensor at B, summed over the sensor's view of the body, is the same with A and B swapped.
    const glm::dvec3 a(2.5, -2.5, 1.0), b(-1.0, -3.0, 2.5);
    for (const bool wax : {false, true}) {
        MeshMaterial m;
        m.name = "m";
        m.baseColor = {0.9f, 0.6f, 0.3f, 1.0f};
        m.metallic = wax ? 0.0f : 0.4f;
        m.roughness = 0.5f;
        StageScene scene = sceneOf({sphere(4), sphere(4, 0.4f, {0.3f, -0.2f, 1.3f}, 1)}, {m, lambert(glm::vec3(0.7f))});
        if (wax) {
            SubsurfaceOverride sss;
            sss.material = "m";
            sss.albedo = glm::vec3(0.9f, 0.7f, 0.4f);
            sss.meanFreePath = glm::vec3(0.15f);
            scene.subsurface = {sss};
        }
        // Interpolated normals bend the law: the sensor's cosine is that of the facet, the lamp's that of the normal.
        for (TriangleMesh& mesh : scene.mesh.meshes) mesh.normals.clear();
        // Sum of radiance * solid angle * (distance to the lamp's place is inside the image already).
        const auto flux = [&](const glm::dvec3& eye, const glm::dvec3& lamp, uint64_t seed, int channel) {
            StageScene copy = scene;
            Result<PathTracer> tracer = PathTracer::create(std::move(copy));
            REQUIRE(tracer);
            RenderSettings settings;
            settings.samplesPerPixel = 64;
            settings.seed = seed;
            const Camera camera = cameraAt(eye, {0, 0, 0.2}, 48, 1.1);
            const Result<std::vector<Image>> images = tracer->render(camera, std::vector<Light>{pointLight(glm::vec3(lamp), 10.0f)}, settings);
            REQUIRE(images);
            double sum = 0.0;
            for (int y = 0; y < camera.height; ++y)
                for (int x = 0; x < camera.width; ++x) {
                    const double px = (x + 0.5 - camera.cx) / camera.fx, py = (y + 0.5 - camera.cy) / camera.fy;
                    const double solidAngle = 1.0 / (camera.fx * camera.fy * std::pow(1.0 + px * px + py * py, 1.5));
                    sum += (*images)[0].pixel(x, y)[channel] * solidAngle;
                }
            return sum;
        };
        for (int channel = 0; channel < 3; channel += 2) {
            double there[6], back[6], meanThere = 0, meanBack = 0, variance = 0;
            for (int i = 0; i < 6; ++i) {
                there[i] = flux(a, b, uint64_t(i), channel), back[i] = flux(b, a, uint64_t(100 + i), channel);
                meanThere += there[i] / 6, meanBack += back[i] / 6;
            }
            for (int i = 0; i < 6; ++i) variance += (std::pow(there[i] - meanThere, 2) + std::pow(back[i] - meanBack, 2)) / (6.0 * 5.0);
            MESSAGE(std::string(wax ? "wax" : "glossy") << ", channel " << channel << ": " << meanThere << " against " << meanBack << " +- "
                                             << std::sqrt(variance));
            CHECK(std::sqrt(variance) < 0.01 * meanThere);
            CHECK(std::fabs(meanThere - meanBack) < 3.17 * std::sqrt(variance)); // Student's t, 10 degrees of freedom, 99 %
        }
    }
}

TEST_CASE("an image is the same whichever lights share its pass and however many threads work")
{
    const MapFolder maps;
    StageScene scene = sceneOf({sphere(4), plane(3.0f, 1)}, {lambert({0.7f, 0.4f, 0.9f}), MeshMaterial{}});
    for (glm::vec3& p : scene.mesh.meshes[1].positions) p.z -= 1.0f;
    const Camera camera = cameraAt({0, -4, 2}, {0, 0, 0}, 24, 0.7);
    const std::vector<Light> lights = {pointLight({2, -2, 3}, 20), directionalLight({0, -1, 1}, 2), maps.constant(glm::vec3(0.3f))};
    const std::vector<Image> together = renderOrFail(scene, camera, lights, 32, nullptr, 2);
    for (size_t i = 0; i < lights.size(); ++i)
        CHECK(renderOrFail(scene, camera, {lights[i]}, 32, nullptr, 1)[0].rgba == together[i].rgba);
}

TEST_CASE("light adds up: one lamp of twice the intensity, or two lamps in one place, give twice the image")
{
    const StageScene scene = sceneOf({sphere(4)}, {MeshMaterial{}});
    const Camera camera = cameraAt({0, -4, 2}, {0, 0, 0}, 16, 0.7);
    const std::vector<Image> images = renderOrFail(scene, camera, {pointLight({2, -2, 3}, 10), pointLight({2, -2, 3}, 20)}, 16);
    for (size_t i = 0; i < images[0].rgba.size(); ++i)
        if (i % 4 != 3) CHECK(images[1].rgba[i] == doctest::Approx(2.0f * images[0].rgba[i]).epsilon(1e-6));
}

TEST_CASE("samples stop at the noise asked for, and the estimate is honest")
{
    const StageScene scene = sceneOf({sphere(4), plane(4.0f, 1)}, {lambert(glm::vec3(0.8f)), lambert(glm::vec3(0.8f))});
    const Camera camera = cameraAt({0, -4, 2}, {0, 0, 0}, 32, 0.7);
    Result<PathTracer> tracer = PathTracer::create(StageScene(scene));
    REQUIRE(tracer);
    const std::vector<Light> lights = {pointLight({3, -2, 3}, 20)};
    RenderSettings settings;
    settings.samplesPerPixel = 4096;
    settings.noiseTarget = 0.02f;
    RenderStats stats, fine;
    const Result<std::vector<Image>> noisy = tracer->render(camera, lights, settings, &stats);
    settings.seed = 7;
    settings.noiseTarget = 0.0f;
    settings.samplesPerPixel = 2048;
    const Result<std::vector<Image>> reference = tracer->render(camera, lights, settings, &fine);
    REQUIRE(noisy);
    REQUIRE(reference);
    CHECK(stats.samplesPerPixel < 2048);
    CHECK(stats.noise[0] <= 0.02f);
    CHECK(fine.noise[0] < stats.noise[0] / 3);
    double error = 0, mean = 0, count = 0;
    for (size_t p = 0; p < 32 * 32; ++p) {
        if ((*reference)[0].rgba[4 * p + 3] < 0.5f) continue;
        const double d = (*noisy)[0].rgba[4 * p] - (*reference)[0].rgba[4 * p];
        error += d * d, mean += (*reference)[0].rgba[4 * p], count += 1;
    }
    const double measured = std::sqrt(error / count) / (mean / count);
    MESSAGE("noise estimated " << stats.noise[0] << ", measured " << measured << " at " << stats.samplesPerPixel << " samples");
    CHECK(measured < 1.5 * stats.noise[0]);
    CHECK(measured > 0.6 * stats.noise[0]);
}

TEST_CASE("alpha is coverage: a half-transparent sheet covers half and lets half of the light through")
{
    MeshMaterial sheet = lambert(glm::vec3(0.5f));
    sheet.alphaMode = AlphaMode::kBlend;
    sheet.baseColor.a = 0.5f;
    StageScene scene = sceneOf({plane(5.0f)}, {sheet});
    const std::vector<Image> alone = renderOrFail(scene, cameraAt({0, -3, 4}, {0, 0, 0}, 32, 0.3), {directionalLight({0, 0, 1}, 1)}, 64);
    double alpha = 0, radiance = 0;
    for (size_t p = 0; p < 32 * 32; ++p) alpha += alone[0].rgba[4 * p + 3] / 1024.0, radiance += alone[0].rgba[4 * p] / 1024.0;
    CHECK(alpha == doctest::Approx(0.5).epsilon(0.02));           // 65536 coin tosses
    CHECK(radiance == doctest::Approx(0.5 * 0.5 / M_PI).epsilon(0.02)); // premultiplied
    // The same sheet, black, as a roof over an opaque floor.
    scene.mesh.materials[0].baseColor = {0, 0, 0, 0.5f};
    scene.mesh.meshes.push_back(plane(5.0f, 1));
    for (glm::vec3& p : scene.mesh.meshes[0].positions) p.z = 1.0f;
    scene.mesh.materials.push_back(lambert(glm::vec3(1.0f)));
    const std::vector<Image> floor = renderOrFail(scene, cameraAt({0, -3, 0.5}, {0, 0, 0}, 16, 0.05), {directionalLight({0, 0, 1}, 1)}, 64);
    CHECK(measure(floor[0], 0).mean == doctest::Approx(0.5 / M_PI).epsilon(1e-4));
}

TEST_CASE("a solid absorbs along the way light takes in it (Beer and Lambert)")
{
    // A slab of clear medium with ior 1, over a white floor far below it in its shadow-free light: radiance through it is exp(-sigma d).
    MeshMaterial clear;
    clear.metallic = 0.0f;
    clear.ior = 1.0f;
    clear.transmission = 1.0f;
    clear.thickness = 1.0f;
    clear.attenuationColor = {0.5f, 0.25f, 1.0f};
    clear.attenuationDistance = 2.0f;
    TriangleMesh box = slab(1.0f, 0.5f);
    StageScene scene = sceneOf({box, plane(20.0f, 1)}, {clear, lambert(glm::vec3(1.0f))});
    for (glm::vec3& p : scene.mesh.meshes[1].positions) p.z = -3.0f;
    const std::vector<Image> images = renderOrFail(scene, cameraAt({0, 0, 5}, {0, 0, 0}, 8, 0.001), {directionalLight({1, 0, 1}, 1)}, 16);
    const double open = std::sqrt(0.5) / M_PI; // the light meets the floor outside the box's shadow
    CHECK(measure(images[0], 0).mean == doctest::Approx(open * std::pow(0.5, 0.25)).epsilon(0.002));
    CHECK(measure(images[0], 1).mean == doctest::Approx(open * std::pow(0.25, 0.25)).epsilon(0.002));
    CHECK(measure(images[0], 2).mean == doctest::Approx(open).epsilon(0.002));
}

TEST_CASE("an open surface used as a volume is reported, with the share of light it leaks")
{
    StageScene scene = sceneOf({sphere(3)}, {lambert(glm::vec3(1.0f))});
    scene.mesh.meshes[0].triangles.resize(scene.mesh.meshes[0].triangles.size() / 2);
    SubsurfaceOverride sss;
    sss.material = "m";
    sss.meanFreePath = glm::vec3(0.5f);
    scene.subsurface = {sss};
    Result<PathTracer> tracer = PathTracer::create(StageScene(scene));
    REQUIRE(tracer);
    REQUIRE(tracer->warnings().size() == 1);
    CHECK(tracer->warnings()[0].find("open along") != std::string::npos);
    RenderStats stats;
    renderOrFail(scene, cameraAt({0, -4, 2}, {0, 0, 0}, 16, 0.7), {pointLight({0, -3, 3}, 10)}, 16, &stats);
    CHECK(stats.leakedWalks > 0.1);
}

TEST_CASE("a body that is inside out is turned round")
{
    StageScene scene = sceneOf({sphere(3)}, {lambert(glm::vec3(1.0f))});
    SubsurfaceOverride sss;
    sss.material = "m";
    sss.meanFreePath = glm::vec3(0.5f);
    scene.subsurface = {sss};
    const Camera camera = cameraAt({0, -4, 2}, {0, 0, 0}, 16, 0.7);
    const std::vector<Light> lights = {pointLight({0, -3, 3}, 10)};
    const double right = measure(renderOrFail(scene, camera, lights, 64)[0], 0).mean;
    for (glm::uvec3& t : scene.mesh.meshes[0].triangles) std::swap(t.y, t.z);
    for (glm::vec3& n : scene.mesh.meshes[0].normals) n = -n;
    Result<PathTracer> tracer = PathTracer::create(StageScene(scene));
    REQUIRE(tracer);
    CHECK(tracer->warnings().size() == 1);
    CHECK(measure(renderOrFail(scene, camera, lights, 64)[0], 0).mean == doctest::Approx(right).epsilon(0.03));
}

TEST_CASE("an override for a material that is not there names those that are")
{
    StageScene scene = sceneOf({sphere(2)}, {lambert(glm::vec3(1.0f))});
    SubsurfaceOverride sss;
    sss.material = "wachs";
    scene.subsurface = {sss};
    const Result<PathTracer> tracer = PathTracer::create(std::move(scene));
    REQUIRE(!tracer);
    CHECK(tracer.error().message.find("'wachs'") != std::string::npos);
    CHECK(tracer.error().message.find("#0 'm'") != std::string::npos);
}
