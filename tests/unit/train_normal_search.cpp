// Normals that are searched for: found where images tell, left open, with wide and faint lobes, where they do not.
#include "appearance/bigs/normal_search.h"
#include "base/light_sample.h"
#include "base/random.h"

#include <doctest/doctest.h>
#include <glm/glm.hpp>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

using namespace nacre;

namespace {

constexpr size_t kCount = 200;
constexpr float kSharpness = 60, kStrength = 0.8f;

glm::vec3 direction(Random& random)
{
    const float z = 2 * random.uniform() - 1, phi = 6.2831853f * random.uniform(), r = std::sqrt(1 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
}

struct Scene {
    BigsParameters parameters;
    std::vector<GaussianGeometry<float>> geometry{kCount};
    std::vector<glm::vec3> truth, start;
    std::vector<ViewEvidence> views;

    // The first half of the splats is seen in all views, the rest in none; normals start about ten degrees off.
    explicit Scene(int viewCount, float noise = 0)
    {
        Random random(5);
        parameters.resize(kCount);
        for (size_t i = 0; i < kCount; ++i) {
            for (float& p : geometry[i].position) p = 0.1f * random.uniform();
            truth.push_back(glm::normalize(glm::vec3(0, 0, 1) + 0.5f * direction(random)));
            start.push_back(glm::normalize(truth[i] + 0.17f * direction(random)));
            for (int k = 0; k < 3; ++k) at(i, kLobe + k) = start[i][k], at(i, kLobeColor + k) = kStrength;
            at(i, kLobeSharpness) = std::log(kSharpness), at(i, kShadow) = 1;
        }
        for (int v = 0; v < viewCount; ++v) {
            ViewEvidence view;
            const glm::vec3 eye = 4.0f * glm::normalize(direction(random) + glm::vec3(0, 0, 1.2f));
            for (int k = 0; k < 3; ++k) view.lit.eye[k] = eye[k];
            view.lit.lightCount = 4;
            for (int l = 0; l < 4; ++l) view.lit.lights[l].position = 5.0f * glm::normalize(direction(random) + glm::vec3(0, 0, 1.2f)), view.lit.lights[l].intensity = glm::vec3(25);
            for (uint32_t i = 0; i < kCount / 2; ++i) {
                SplatEvidence e{i, 1, {}, {1, 1, 1, 1}, {}};
                const LightSample<float> toEye = samplePointLight(view.lit.eye, 0.0f, geometry[i].position);
                for (int l = 0; l < 4; ++l) {
                    const LightSample<float> to = sampleLight(view.lit.lights[l], geometry[i].position);
                    const float lobe[4] = {truth[i].x, truth[i].y, truth[i].z, kSharpness};
                    e.residual[l] = 25 * to.falloff * kStrength * bigsLobe(lobe, toEye.dir, to.dir) + noise * (random.uniform() + random.uniform() - 1);
                }
                view.splats.push_back(e);
            }
            views.push_back(std::move(view));
        }
    }
    float& at(size_t i, int k) { return parameters.value[parameters.index(i, k)]; }
    glm::vec3 normal(size_t i) { return glm::normalize(glm::vec3(at(i, kLobe), at(i, kLobe + 1), at(i, kLobe + 2))); }
    double medianError(const std::vector<glm::vec3>& normals)
    {
        std::vector<double> angles;
        for (size_t i = 0; i < kCount / 2; ++i) angles.push_back(std::acos(std::min(1.0f, glm::dot(truth[i], normals[i]))));
        std::nth_element(angles.begin(), angles.begin() + kCount / 4, angles.end());
        return angles[kCount / 4];
    }
    std::vector<glm::vec3> normals()
    {
        std::vector<glm::vec3> all;
        for (size_t i = 0; i < kCount; ++i) all.push_back(normal(i));
        return all;
    }
};

} // namespace

TEST_CASE("normals are found from highlights, through noise that hides most of them; what no view shows stays")
{
    Scene scene(60, 0.1f);
    const BigsParameters before = scene.parameters;
    searchNormals(scene.parameters, scene.geometry, scene.views);
    MESSAGE("median error ", scene.medianError(scene.start), " before, ", scene.medianError(scene.normals()), " after");
    CHECK(scene.medianError(scene.normals()) < 0.3 * scene.medianError(scene.start));
    for (size_t i = kCount / 2; i < kCount; ++i)
        for (int k = 0; k < scene.parameters.coefficients(); ++k) REQUIRE(scene.at(i, k) == before.value[before.index(i, k)]);
}

TEST_CASE("the less the images say, the wider and the fainter are the lobes")
{
    double width[2] = {0, 0}, strength[2] = {0, 0};
    for (const int few : {0, 1}) {
        Scene scene(few ? 2 : 60, 0.1f);
        searchNormals(scene.parameters, scene.geometry, scene.views);
        for (size_t i = 0; i < kCount / 2; ++i) width[few] += 1 / (1 + std::exp(scene.at(i, kLobeSharpness))), strength[few] += scene.at(i, kLobeColor);
    }
    CHECK(width[1] > 2 * width[0]);
    CHECK(strength[1] < 0.5 * strength[0]);
}

TEST_CASE("a pixel that is cut at 1 does not contradict a highlight that is brighter")
{
    // All residuals are cut, well below the peak: with saturation said, normals are found; without, the search takes the peak for a plateau.
    double error[2];
    for (const int said : {0, 1}) {
        Scene scene(60);
        for (ViewEvidence& view : scene.views)
            for (SplatEvidence& e : view.splats)
                for (int l = 0; l < 4; ++l)
                    if (e.residual[l] > 0.3f) e.residual[l] = 0.3f, e.saturated[l] = float(said);
        searchNormals(scene.parameters, scene.geometry, scene.views);
        error[said] = scene.medianError(scene.normals());
    }
    CHECK(error[1] < error[0]);
}

TEST_CASE("a search does not depend on the number of threads, and without views it changes nothing")
{
    Scene one(20, 0.1f), many(20, 0.1f), none(0);
    const BigsParameters before = none.parameters;
    {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
        searchNormals(one.parameters, one.geometry, one.views);
    }
    searchNormals(many.parameters, many.geometry, many.views);
    CHECK(one.parameters.value == many.parameters.value);
    searchNormals(none.parameters, none.geometry, none.views);
    CHECK(none.parameters.value == before.value);
}
