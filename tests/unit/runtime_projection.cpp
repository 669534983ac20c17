// Projections as engines make them: any clip control, tilted near planes, eyes shifted in the projection, mirrors. Each shows what the
// plain projection of the same scene shows.
#include "runtime_fixture.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

using namespace nacre;
using namespace nacre::test;

namespace {

const std::vector<Light> kLights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f}), directionalLight({-0.3f, 0.4f, 0.9f}, {0.3f, 0.6f, 0.9f})};
const Camera kCamera = offCentre();
constexpr float kTolerance = 2e-3f; // half floats of the G-buffer of sss, drawn at other roundings of position and depth

std::vector<SplatAsset> assets() { return {withSharp(randomAsset(200, 9, 4), kAllSharp, 4), randomSss(200, kAllSss, 4)}; }

bool haveClipControl()
{
    GLint major = 0, minor = 0;
    glGetIntegerv(GL_MAJOR_VERSION, &major);
    glGetIntegerv(GL_MINOR_VERSION, &minor);
    if (10 * major + minor >= 45) return true;
    MESSAGE("SKIPPED: glClipControl needs GL 4.5");
    return false;
}

Image flipped(Image image)
{
    for (int y = 0; y < image.height / 2; ++y)
        std::swap_ranges(image.pixel(0, y), image.pixel(0, y) + 4 * image.width, image.pixel(0, image.height - 1 - y));
    return image;
}

glm::dmat4 plainProjection() { return clipFromView(kCamera); }

NacreDrawDesc withProjection(const glm::dmat4& projection, const glm::dmat4& view = glm::inverse(kCamera.worldFromCamera))
{
    NacreDrawDesc desc = describe(kCamera);
    copy(desc.viewFromWorld, view);
    copy(desc.clipFromView, projection);
    return desc;
}

/// The projection whose near plane is dot(plane, (p, 1)) = 0, view space (Lengyel 2005, "Oblique view frustum depth projection and clipping").
glm::dmat4 oblique(const glm::dmat4& projection, const glm::dvec4& plane)
{
    const auto sign = [](double v) { return double((v > 0) - (v < 0)); };
    const glm::dvec4 corner = glm::inverse(projection) * glm::dvec4(sign(plane.x), sign(plane.y), 1, 1);
    glm::dmat4 rows = glm::transpose(projection);
    rows[2] = plane * (2.0 / glm::dot(plane, corner)) - rows[3];
    return glm::transpose(rows);
}

SplatAsset only(const SplatAsset& asset, const std::vector<bool>& kept)
{
    SplatAsset less = asset;
    less.cloud = {};
    for (Channel& c : less.channels)
        if (!c.perAsset) c.values.clear(), c.bytes.clear();
    for (size_t g = 0; g < asset.cloud.count; ++g) {
        if (!kept[g]) continue;
        ++less.cloud.count;
        less.cloud.positions.push_back(asset.cloud.positions[g]);
        less.cloud.rotations.push_back(asset.cloud.rotations[g]);
        less.cloud.scales.push_back(asset.cloud.scales[g]);
        less.cloud.opacities.push_back(asset.cloud.opacities[g]);
        for (size_t k = 0; k < asset.channels.size(); ++k) {
            const Channel& from = asset.channels[k];
            const auto at = ptrdiff_t(g * from.components), end = at + ptrdiff_t(from.components);
            if (from.perAsset) continue;
            if (!from.bytes.empty()) less.channels[k].bytes.insert(less.channels[k].bytes.end(), from.bytes.begin() + at, from.bytes.begin() + end);
            else less.channels[k].values.insert(less.channels[k].values.end(), from.values.begin() + at, from.values.begin() + end);
        }
    }
    return less;
}

} // namespace

TEST_CASE("an upper-left clip origin turns the picture over and changes nothing else")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        if (!haveClipControl()) return;
        const Image expected = host.draw(kCamera, kLights);
        glClipControl(GL_UPPER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
        const Image image = host.draw(kCamera);
        CHECK(largestDifference(flipped(image), expected) < kTolerance);
        CHECK(largest(image) > 0.1f);
    }
}

TEST_CASE("a clip space whose depth starts at zero shows the same, under depth clamp too")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        if (!haveClipControl()) return;
        host.setLights(kLights);
        glm::dmat4 projection = glm::transpose(plainProjection());
        projection[2] = glm::dvec4(0, 0, -1, -2.0 * 1.9); // near plane at 1.9, through the asset
        for (const bool clamp : {false, true}) {
            CAPTURE(clamp);
            (clamp ? glEnable : glDisable)(GL_DEPTH_CLAMP);
            const Image expected = host.draw(withProjection(glm::transpose(projection)));
            glm::dmat4 zeroToOne = projection;
            zeroToOne[2] = 0.5 * (projection[2] + projection[3]);
            glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
            CHECK(largestDifference(host.draw(withProjection(glm::transpose(zeroToOne))), expected) < kTolerance);
            glm::dmat4 reversed = projection; // z / w is 1 at the near plane, 0 far away
            reversed[2] = projection[3] - zeroToOne[2];
            CHECK(largestDifference(host.draw(withProjection(glm::transpose(reversed))), expected) < kTolerance);
            glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
            CHECK(largest(expected) > 0.1f);
        }
        glDisable(GL_DEPTH_CLAMP);
    }
}

TEST_CASE("an oblique near plane hides the splats behind it and no others")
{
    if (!haveGl()) return;
    const glm::dmat4 view = glm::inverse(kCamera.worldFromCamera);
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        for (const glm::dvec3& normal : {glm::dvec3(0, 1, -0.05), glm::dvec3(0.9, -0.2, -0.1), glm::dvec3(0.3, 0.4, -0.8)}) {
            const glm::dvec3 n = glm::normalize(normal), centre = glm::dvec3(view * glm::dvec4(0, 0, 0, 1));
            const glm::dvec4 plane(n, std::min(-glm::dot(n, centre) + 0.1, -0.02)); // through the asset, the camera on its other side
            std::vector<bool> kept;
            for (const glm::vec3& p : asset.cloud.positions) kept.push_back(glm::dot(plane, view * glm::dvec4(p, 1)) > 0);
            const size_t count = size_t(std::count(kept.begin(), kept.end(), true));
            REQUIRE(count > 20);
            REQUIRE(count < 180);
            Host rest(only(asset, kept));
            const Image expected = rest.draw(kCamera, kLights);
            host.gl->makeCurrent();
            host.setLights(kLights);
            CHECK(largestDifference(host.draw(withProjection(oblique(plainProjection(), plane))), expected) < kTolerance);
            glEnable(GL_DEPTH_CLAMP); // GL itself clips nothing then
            CHECK(largestDifference(host.draw(withProjection(oblique(plainProjection(), plane))), expected) < kTolerance);
            glDisable(GL_DEPTH_CLAMP);
        }
    }
}

TEST_CASE("an eye that the projection shifts sees what a shifted camera sees")
{
    if (!haveGl()) return;
    const glm::dmat4 shift = glm::translate(glm::dmat4(1), glm::dvec3(0.3, -0.2, 0)), view = glm::inverse(kCamera.worldFromCamera);
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        host.setLights(kLights);
        const Image expected = host.draw(withProjection(plainProjection(), shift * view));
        CHECK(largestDifference(host.draw(withProjection(plainProjection() * shift, view)), expected) < kTolerance);
    }
}

TEST_CASE("a mirrored view under a mirrored projection shows the same, and a mirrored asset under mirrored lights its mirror image")
{
    if (!haveGl()) return;
    const glm::dmat4 mirror = glm::scale(glm::dmat4(1), glm::dvec3(1, -1, 1)), view = glm::inverse(kCamera.worldFromCamera);
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        host.setLights(kLights);
        const Image expected = host.draw(kCamera);
        CHECK(largestDifference(host.draw(withProjection(plainProjection() * mirror, mirror * view)), expected) < kTolerance);

        std::vector<Light> lights = kLights;
        for (Light& light : lights) light.position.y *= -1, light.directionToLight.y *= -1;
        host.setLights(lights);
        host.moveTo(mirror);
        CHECK(largestDifference(host.draw(withProjection(plainProjection(), view * mirror)), expected) < kTolerance);
    }
}
