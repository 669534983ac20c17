// KHR_materials_iridescence: thin films against Airy's sum over the spectrum, and what a film must not change.
#include "stage_scenes.h"

#include "light_stage/surface.h"

#include <complex>

using namespace nacre;
using namespace nacre::stage;
using namespace nacre::test;

namespace {

/// CIE 1931 by the sums of Gaussians of Wyman, Sloan and Shirley 2013, to linear Rec.709; lambda in nanometres.
glm::dvec3 response(double lambda)
{
    const auto g = [&](double mean, double left, double right) { return std::exp(-0.5 * std::pow((lambda - mean) / (lambda < mean ? left : right), 2)); };
    const glm::dvec3 xyz(1.056 * g(599.8, 37.9, 31.0) + 0.362 * g(442.0, 16.0, 26.7) - 0.065 * g(501.1, 20.4, 26.2),
                         0.821 * g(568.8, 46.9, 40.5) + 0.286 * g(530.9, 16.3, 31.1), 1.217 * g(437.0, 11.8, 36.0) + 0.681 * g(459.0, 26.0, 13.8));
    return {glm::dot(xyz, {3.2404542, -1.5371385, -0.4985314}), glm::dot(xyz, {-0.9692660, 1.8760108, 0.0415560}),
            glm::dot(xyz, {0.0556434, -0.2040259, 1.0572252})};
}

double schlick(double f0, double cosine) { return f0 + (1.0 - f0) * std::pow(1.0 - cosine, 5); }

/// Complex amplitudes at every wavelength, all round trips.
glm::dvec3 airy(double cosine, double filmIor, double thickness, double f0)
{
    const double inside = std::sqrt(1.0 - (1.0 - cosine * cosine) / (filmIor * filmIor)), baseIor = (1.0 + std::sqrt(f0)) / (1.0 - std::sqrt(f0));
    const double r12 = std::sqrt(schlick(std::pow((filmIor - 1.0) / (filmIor + 1.0), 2), cosine));
    const double inner0 = (baseIor - filmIor) / (baseIor + filmIor), r23 = std::copysign(std::sqrt(schlick(inner0 * inner0, inside)), inner0);
    glm::dvec3 sum(0.0), weight(0.0);
    for (double lambda = 360.0; lambda < 830.0; lambda += 0.5) {
        const std::complex<double> turn = std::polar(1.0, 4.0 * M_PI * filmIor * thickness * inside / lambda);
        sum += response(lambda) * std::norm((r12 + r23 * turn) / (1.0 + r12 * r23 * turn));
        weight += response(lambda);
    }
    return glm::clamp(sum / weight, 0.0, 1.0);
}

SurfaceBsdf filmed(float metallic, float roughness, float thickness)
{
    SurfaceBsdf b;
    b.frame = Frame::around({0, 0, 1});
    b.wo = glm::normalize(glm::vec3(0.5f, -0.3f, 0.7f));
    b.baseColor = {0.9f, 0.7f, 0.5f};
    b.diffuse = b.baseColor;
    b.metallic = metallic;
    b.alphaX = b.alphaY = roughness * roughness;
    b.film = 1.0f;
    b.filmIor = 1.8f;
    b.filmThickness = thickness;
    float walk;
    b.finish(glm::vec3(0.0f), &walk);
    return b;
}

MeshMaterial filmMaterial(float thickness)
{
    MeshMaterial m = lambert(glm::vec3(1.0f));
    m.specular = 1.0f;
    m.roughness = 0.1f; // smooth enough that single-scattering microfacets lose nothing visible
    m.iridescence = 1.0f;
    m.iridescenceIor = 1.6f;
    m.iridescenceThicknessMaximum = thickness;
    return m;
}

} // namespace

TEST_CASE("thin films have the colours of Airy's sum")
{
    // What is left: the Gaussians of the eye's response, and the round trips after the third.
    double square = 0.0, worst = 0.0;
    int count = 0;
    for (const double f0 : {0.04, 0.3, 0.9})
        for (const double ior : {1.2, 1.5, 2.2})
            for (const double cosine : {1.0, 0.7, 0.4, 0.15})
                for (double thickness = 0.0; thickness < 1200.0; thickness += 37.0) {
                    const glm::dvec3 exact = airy(cosine, ior, thickness, f0);
                    const glm::dvec3 off = glm::dvec3(thinFilmReflectance(float(cosine), float(ior), float(thickness), glm::vec3(float(f0)))) - exact;
                    for (int c = 0; c < 3; ++c) square += off[c] * off[c] / 3.0, worst = std::max(worst, std::fabs(off[c]));
                    ++count;
                }
    MESSAGE("rms " << std::sqrt(square / count) << ", largest " << worst);
    CHECK(std::sqrt(square / count) < 0.02);
    CHECK(worst < 0.15);
}

TEST_CASE("a film of index one, and one much thicker than light is coherent, have no colour")
{
    for (const float cosine : {1.0f, 0.5f, 0.2f}) {
        const glm::vec3 thick = thinFilmReflectance(cosine, 1.5f, 1e6f, glm::vec3(0.2f));
        CHECK(thick.r == doctest::Approx(thick.g));
        CHECK(thick.r == doctest::Approx(thick.b));
        const glm::vec3 none = thinFilmReflectance(1.0f, 1.0f, 300.0f, glm::vec3(0.2f));
        for (int c = 0; c < 3; ++c) CHECK(none[c] == doctest::Approx(0.2f));
    }
}

TEST_CASE("no film, or one without thickness, changes no bit")
{
    const Camera camera = cameraAt({0, -4, 1}, {0, 0, 0}, 16, 0.5);
    for (const float metallic : {0.0f, 0.5f, 1.0f}) {
        MeshMaterial plain = filmMaterial(0.0f);
        plain.metallic = metallic;
        plain.iridescence = 0.0f;
        MeshMaterial flat = plain, thin = plain;
        flat.iridescenceThicknessMaximum = 300.0f; // factor 0
        thin.iridescence = 1.0f;                   // thickness 0
        const std::vector<Light> lights = {pointLight({2, -2, 3}, 20)};
        const Image bare = renderOrFail(sceneOf({sphere(3)}, {plain}), camera, lights, 16)[0];
        CHECK(renderOrFail(sceneOf({sphere(3)}, {flat}), camera, lights, 16)[0].rgba == bare.rgba);
        CHECK(renderOrFail(sceneOf({sphere(3)}, {thin}), camera, lights, 16)[0].rgba == bare.rgba);
        thin.iridescenceThicknessMaximum = 300.0f;
        CHECK(renderOrFail(sceneOf({sphere(3)}, {thin}), camera, lights, 16)[0].rgba != bare.rgba);
    }
}

TEST_CASE("factor and thickness follow their textures")
{
    MeshScene scene;
    scene.meshes = {plane(1.0f)};
    scene.meshes[0].texcoords[0].assign(4, glm::vec2(0.5f));
    scene.materials = {filmMaterial(500.0f)};
    scene.materials[0].iridescenceThicknessMinimum = 200.0f;
    scene.materials[0].iridescenceTexture.texture = scene.materials[0].iridescenceThicknessTexture.texture = 0;
    scene.textures.resize(1);
    scene.textures[0].width = scene.textures[0].height = 1;
    scene.textures[0].rgba = {51, 102, 255, 255};
    StageScene stage;
    stage.mesh = scene;
    std::vector<std::string> warnings;
    const Result<SurfaceTable> table = SurfaceTable::create(stage, warnings);
    REQUIRE(table);
    RayHit hit;
    hit.mesh = hit.primitive = 0;
    hit.u = hit.v = 0.25f;
    const SurfaceBsdf b = table->evaluate(stage.mesh, hit, {0, 0, 1}).bsdf;
    CHECK(b.film == doctest::Approx(0.2f));
    CHECK(b.filmThickness == doctest::Approx(320.0f));
}

TEST_CASE("a film neither makes light nor breaks the lobes' reciprocity, and directions are drawn as their density says")
{
    for (const float metallic : {0.0f, 0.6f, 1.0f})
        for (const float thickness : {80.0f, 350.0f, 900.0f}) {
            const SurfaceBsdf b = filmed(metallic, 0.5f, thickness);
            glm::dvec3 albedo(0.0), integral(0.0);
            constexpr int kSide = 200;
            for (int i = 0; i < kSide * kSide; ++i) {
                const glm::vec2 u((float(i % kSide) + 0.5f) / kSide, (float(i / kSide) + 0.5f) / kSide);
                const float lobe = float(std::fmod(i * 0.6180339887498949, 1.0));
                glm::vec3 wi, weight;
                float density;
                if (b.sample(lobe, u, &wi, &weight, &density)) albedo += glm::dvec3(weight) / double(kSide * kSide);
                const float z = u.x, s = std::sqrt(1.0f - z * z), phi = 2.0f * kPi * u.y;
                integral += glm::dvec3(b.evaluate({s * std::cos(phi), s * std::sin(phi), z})) * (2.0 * M_PI / (kSide * kSide));
            }
            for (int c = 0; c < 3; ++c) {
                CHECK(albedo[c] <= 1.0);
                CHECK(albedo[c] == doctest::Approx(integral[c]).epsilon(0.01));
            }
            const glm::vec3 wi = glm::normalize(glm::vec3(-0.2f, 0.6f, 0.4f));
            SurfaceBsdf swapped = b;
            swapped.wo = wi;
            float walk;
            swapped.finish(glm::vec3(0.0f), &walk);
            const glm::vec3 there = b.evaluate(wi) / wi.z, back = swapped.evaluate(b.wo) / b.wo.z;
            for (int c = 0; c < 3; ++c) CHECK(there[c] == doctest::Approx(back[c]).epsilon(1e-4));
        }
}

TEST_CASE("white furnace: glass under a film disappears; wax is no brighter than what shines on it")
{
    // What goes into wax is the same in all channels, as glTF has it (1 - the largest F), so the others lose a little.
    const MapFolder maps;
    for (const SubsurfaceBoundary boundary : {SubsurfaceBoundary::kDiffuse, SubsurfaceBoundary::kDielectric}) {
        StageScene scene = sceneOf({sphere(5)}, {filmMaterial(400.0f)});
        SubsurfaceOverride sss;
        sss.material = "m";
        sss.singleScatterAlbedo = glm::vec3(1.0f);
        sss.meanFreePath = glm::vec3(0.3f);
        sss.boundary = boundary;
        scene.subsurface = {sss};
        const std::vector<Image> images = renderOrFail(scene, cameraAt({0, -4, 1}, {0, 0, 0}, 24, 0.5), {maps.constant(glm::vec3(1.0f))}, 64);
        for (int c = 0; c < 3; ++c) {
            const Measured m = measure(images[0], c);
            MESSAGE("channel " << c << ": " << m.mean << " +- " << m.error);
            CHECK(m.mean < 1.01);
            CHECK(m.mean > (boundary == SubsurfaceBoundary::kDiffuse ? 0.85 : 0.98));
        }
    }
}
