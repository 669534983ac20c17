// Shadows of splats on the splats of other instances, against products of 1 - alpha along rays.
#include "render/visibility_embree.h"
#include "runtime_shadow_receivers.h"

using namespace nacre;
using namespace nacre::test;

namespace {

constexpr int kCells = 20, kCellPixels = 8, kImage = kCells * kCellPixels;

SplatAsset receivers(bool sss, float height = 0.3f) { return shadowReceivers(sss, kCells, height); }

/// A slab of wide splats around the origin, thick enough to hold nearly all light up.
SplatAsset slab(float opacity = 0.95f)
{
    constexpr int kSide = 10, kLayers = 3;
    SplatAsset a = randomAsset(kSide * kSide * kLayers, 0, 9);
    for (size_t g = 0; g < a.cloud.count; ++g) {
        const int x = int(g) % kSide, y = int(g) / kSide % kSide, z = int(g) / (kSide * kSide);
        a.cloud.positions[g] = {0.7f * ((2 * x + 1.0f) / kSide - 1), 0.5f * ((2 * y + 1.0f) / kSide - 1), 0.03f * float(z)};
        a.cloud.scales[g] = {0.07f, 0.06f, 0.01f};
        a.cloud.opacities[g] = opacity;
        a.cloud.rotations[g] = glm::quat(1, 0, 0, 0);
    }
    return a;
}

NacreDrawDesc above()
{
    NacreDrawDesc desc{};
    desc.structSize = sizeof desc;
    copy(desc.viewFromWorld, glm::lookAt(glm::dvec3(0, 0, 3), glm::dvec3(0), glm::dvec3(0, 1, 0)));
    copy(desc.clipFromView, glm::ortho(-1.0, 1.0, -1.0, 1.0, 0.1, 10.0));
    desc.viewportWidth = desc.viewportHeight = kImage;
    return desc;
}

NacreLight light(NacreLightType type, glm::vec3 place, uint32_t flags = NACRE_LIGHT_SPLAT_SHADOWS)
{
    NacreLight l{};
    l.structSize = sizeof l;
    l.type = type;
    const bool directional = type == NACRE_LIGHT_DIRECTIONAL;
    if (directional) place = glm::normalize(place);
    std::memcpy(directional ? l.direction : l.position, &place, sizeof place);
    if (type == NACRE_LIGHT_SPOT) {
        const glm::vec3 down = -glm::normalize(place);
        std::memcpy(l.direction, &down, sizeof down);
        l.outerCone = 1.3f;
    }
    for (float& i : l.intensity) i = directional ? 2.0f : 20.0f;
    if (type == NACRE_LIGHT_SPHERE) l.radius = 0.01f;
    l.flags = flags;
    return l;
}

/// One receiver, which alone is drawn, and whatever casts.
struct Scene : Host {
    explicit Scene(bool sss) : source(receivers(sss)) { receiver = place(source); }
    Image draw(std::span<const NacreLight> lights)
    {
        REQUIRE_MESSAGE(nacreContextSetLights(context, lights.data(), lights.size()) == NACRE_OK, lastMessage());
        return draw();
    }
    Image draw()
    {
        NacreDrawDesc desc = above();
        desc.instances = &receiver, desc.instanceCount = 1;
        return Host::draw(desc);
    }
    std::vector<float> factors(const Image& lit, const Image& shadowed) const
    {
        std::vector<float> out;
        for (int y = 0; y < kCells; ++y)
            for (int x = 0; x < kCells; ++x) {
                const int px = x * kCellPixels + kCellPixels / 2, py = kImage - 1 - (y * kCellPixels + kCellPixels / 2);
                REQUIRE(lit.pixel(px, py)[0] > 1e-3f);
                out.push_back(shadowed.pixel(px, py)[0] / lit.pixel(px, py)[0]);
            }
        return out;
    }
    const SplatAsset source;
    NacreInstance receiver{};
};

std::vector<GaussianGeometry<float>> gaussians(const SplatAsset& a, const glm::vec3& shift)
{
    std::vector<GaussianGeometry<float>> out;
    for (size_t g = 0; g < a.cloud.count; ++g) {
        const glm::vec3 p = a.cloud.positions[g] + shift, &s = a.cloud.scales[g];
        const glm::quat& q = a.cloud.rotations[g];
        out.push_back({{p.x, p.y, p.z}, {s.x, s.y, s.z}, {q.w, q.x, q.y, q.z}, a.cloud.opacities[g]});
    }
    return out;
}

/// Product over the Gaussians between a splat and the light.
double transmittance(const std::vector<RayGaussian>& casters, const NacreLight& l, const glm::vec3& from)
{
    const bool directional = l.type == NACRE_LIGHT_DIRECTIONAL;
    const glm::vec3 way = directional ? glm::make_vec3(l.direction) : glm::make_vec3(l.position) - from;
    double product = 1;
    for (const RayGaussian& g : casters) {
        const bool beyond = !directional && glm::dot(glm::make_vec3(g.center) - from, glm::normalize(way)) > glm::length(way);
        if (!beyond) product *= 1 - std::min(alphaOnRay(g, from, glm::normalize(way)), double(kMaxAlpha));
    }
    return product;
}

void checkAgainstRays(const Scene& scene, const NacreLight& l, const std::vector<float>& found, const std::vector<RayGaussian>& casters)
{
    double worst = 0, sum = 0;
    int dark = 0, lit = 0;
    for (size_t g = 0; g < found.size(); ++g) {
        const double wanted = transmittance(casters, l, scene.source.cloud.positions[g]), error = std::abs(found[g] - wanted);
        dark += wanted < 0.05, lit += wanted > 0.99;
        worst = std::max(worst, error), sum += error;
        if (wanted > 0.9999) CHECK(found[g] > 0.95f);
        if (wanted < 0.001) CHECK(found[g] < 0.05f);
    }
    MESSAGE("light of type ", int(l.type), ": ", lit, " lit, ", dark, " dark, error up to ", worst, ", mean ", sum / double(found.size()));
    CHECK(dark > 30);
    CHECK(lit > 30);
    CHECK(worst < 0.05);                          // at the edge: a texel, and the low-pass of what is projected
    CHECK(sum / double(found.size()) < 0.005);
}

std::vector<RayGaussian> prepared(const std::vector<GaussianGeometry<float>>& splats)
{
    std::vector<RayGaussian> out;
    for (const auto& g : splats)
        if (RayGaussian r; prepareRayGaussian(g, r)) out.push_back(r);
    return out;
}

} // namespace

TEST_CASE("splat shadows: a slab darkens the splats of another instance by what rays through it lose, and lets go of them when it moves")
{
    if (!haveGl()) return;
    const glm::vec3 at(0.1f, -0.1f, 0.8f);
    for (const bool sss : {false, true})
        for (const NacreLight& l : {light(NACRE_LIGHT_DIRECTIONAL, {0.3f, 0.2f, 1}), light(NACRE_LIGHT_POINT, {0.3f, 0.2f, 2.2f}), light(NACRE_LIGHT_SPOT, {-0.4f, 0.3f, 2.5f}),
                                    light(NACRE_LIGHT_SPHERE, {0.2f, 0.1f, 2.4f})}) {
            CAPTURE(sss);
            Scene scene(sss);
            REQUIRE(nacreContextSetShadowBudget(scene.context, 16, 256) == NACRE_OK);
            const Image alone = scene.draw(std::vector<NacreLight>{l});
            CHECK(scene.stats().shadowMapsDrawn == 0);
            const NacreInstance caster = scene.place(slab(), glm::translate(glm::dmat4(1), glm::dvec3(at)));
            const Image shadowed = scene.draw();
            CHECK(scene.stats().shadowMapsDrawn == 1);
            checkAgainstRays(scene, l, scene.factors(alone, shadowed), prepared(gaussians(slab(), at)));

            for (int frame = 0; frame < 3; ++frame) { // at rest
                CHECK(scene.draw().rgba == shadowed.rgba);
                if (frame == 0) continue; // the GPU has told by now
                CHECK(scene.stats().shadowMapsDrawn == 0);
                CHECK(scene.stats().shadowPassesRun == 0);
                CHECK(scene.stats().relightSplats == 0);
            }
            NacreLight without = l;
            without.flags = 0;
            CHECK(scene.draw(std::vector<NacreLight>{without}).rgba == alone.rgba);
            scene.draw(std::vector<NacreLight>{l});
            const glm::mat4 away = glm::translate(glm::mat4(1), glm::vec3(5, 0, 0.8f));
            REQUIRE(nacreInstanceSetTransform(caster, &away[0][0]) == NACRE_OK);
            CHECK(scene.draw().rgba == alone.rgba);
            const glm::mat4 below = glm::translate(glm::mat4(1), glm::vec3(0, 0, -0.8f)); // behind the receiver
            REQUIRE(nacreInstanceSetTransform(caster, &below[0][0]) == NACRE_OK);
            CHECK(scene.draw().rgba == alone.rgba);
            const glm::mat4 back = glm::translate(glm::mat4(1), at);
            REQUIRE(nacreInstanceSetTransform(caster, &back[0][0]) == NACRE_OK);
            CHECK(scene.draw().rgba == shadowed.rgba);
            REQUIRE(nacreInstanceSetHidden(caster, 1) == NACRE_OK);
            CHECK(scene.draw().rgba == alone.rgba);
            REQUIRE(nacreInstanceSetHidden(caster, 0) == NACRE_OK);
            CHECK(scene.draw().rgba == shadowed.rgba);
            nacreInstanceDestroy(caster);
            CHECK(scene.draw().rgba == alone.rgba);
            CHECK_MESSAGE(scene.messages.empty(), scene.lastMessage());
        }
}

TEST_CASE("splat shadows: casters multiply, lights add up")
{
    if (!haveGl()) return;
    for (const bool sss : {false, true}) {
        Scene scene(sss);
        const std::vector<NacreLight> lights = {light(NACRE_LIGHT_DIRECTIONAL, {0.3f, 0.2f, 1}), light(NACRE_LIGHT_POINT, {0.3f, 0.2f, 2.2f}), light(NACRE_LIGHT_POINT, {-0.5f, 0, 2}, 0)};
        const Image alone = scene.draw({&lights[0], 1});
        const glm::vec3 places[2] = {{0.4f, 0, 0.7f}, {-0.2f, 0.2f, 1.0f}};
        std::vector<RayGaussian> all;
        for (const glm::vec3& p : places) {
            scene.place(slab(0.4f), glm::translate(glm::dmat4(1), glm::dvec3(p)));
            for (const RayGaussian& g : prepared(gaussians(slab(0.4f), p))) all.push_back(g);
        }
        Image sum = scene.draw({&lights[0], 1});
        const std::vector<float> found = scene.factors(alone, sum);
        double worst = 0;
        for (size_t g = 0; g < found.size(); ++g) worst = std::max(worst, std::abs(found[g] - transmittance(all, lights[0], scene.source.cloud.positions[g])));
        CHECK(worst < 0.05);
        for (size_t i = 1; i < lights.size(); ++i) {
            const Image one = scene.draw({&lights[i], 1});
            for (size_t k = 0; k < sum.rgba.size(); ++k)
                if (k % 4 != 3) sum.rgba[k] += one.rgba[k];
        }
        CHECK(largestDifference(scene.draw(lights), sum) < 5e-3f * largest(sum)); // sss is blended as half floats
    }
}

TEST_CASE("splat shadows: an instance never shades itself, nor do instances that the light leaves out")
{
    if (!haveGl()) return;
    Scene scene(false);
    NacreLight l = light(NACRE_LIGHT_DIRECTIONAL, {0.3f, 0.2f, 1}), plain = light(NACRE_LIGHT_DIRECTIONAL, {0.3f, 0.2f, 1}, 0);
    nacreInstanceDestroy(scene.receiver);
    scene.receiver = scene.place(slab()); // thick: it would
    const NacreInstance casting = scene.place(slab(), glm::translate(glm::dmat4(1), glm::dvec3(9, 0, 1)));
    const Image lit = scene.draw({&plain, 1});
    CHECK(scene.draw({&l, 1}).rgba == lit.rgba);

    const glm::mat4 over = glm::translate(glm::mat4(1), glm::vec3(0, 0, 0.8f));
    REQUIRE(nacreInstanceSetTransform(casting, &over[0][0]) == NACRE_OK);
    CHECK(scene.draw().rgba != lit.rgba);
    REQUIRE(nacreInstanceSetMasks(casting, 2, 0) == NACRE_OK);
    l.mask = 1;
    CHECK(scene.draw({&l, 1}).rgba == lit.rgba);
}

TEST_CASE("splat shadows: no more maps than the budget are drawn, and all of them in time")
{
    if (!haveGl()) return;
    Host host;
    const NacreAsset asset = host.create(receivers(false));
    std::vector<NacreInstance> all;
    for (int i = 0; i < 6; ++i) all.push_back(host.place(asset, glm::translate(glm::dmat4(1), glm::dvec3(2.2 * i, 0, 0))));
    const NacreInstance caster = host.place(slab(), glm::scale(glm::translate(glm::dmat4(1), glm::dvec3(5, 0, 3)), glm::dvec3(8)));
    const std::vector<NacreLight> lights = {light(NACRE_LIGHT_DIRECTIONAL, {0, 0, 1}), light(NACRE_LIGHT_DIRECTIONAL, {0.1f, 0.1f, 1})};
    REQUIRE(nacreContextSetLights(host.context, lights.data(), lights.size()) == NACRE_OK);
    NacreDrawDesc desc = above();
    copy(desc.clipFromView, glm::ortho(-1.0, 13.0, -1.0, 1.0, 0.1, 30.0));
    desc.instances = all.data(), desc.instanceCount = all.size();
    REQUIRE(nacreContextSetShadowBudget(host.context, 0, 64) == NACRE_OK);
    host.draw(desc);
    CHECK(host.stats().shadowMapsDrawn == 0);
    CHECK(host.stats().shadowMapsPending == 12);
    REQUIRE(nacreContextSetShadowBudget(host.context, 5, 64) == NACRE_OK);
    uint32_t drawn = 0;
    for (int frame = 0; frame < 12; ++frame) {
        host.draw(desc);
        CHECK(host.stats().shadowMapsDrawn <= 5);
        if (frame == 0) CHECK(host.stats().shadowMapsDrawn == 5);
        drawn += host.stats().shadowMapsDrawn;
    }
    CHECK(drawn >= 12);
    CHECK(host.stats().shadowMapsDrawn == 0);
    CHECK(host.stats().shadowMapsPending == 0);
    const Image inTime = host.draw(desc);
    REQUIRE(nacreContextSetShadowBudget(host.context, 100, 64) == NACRE_OK);
    const glm::mat4 away = glm::translate(glm::mat4(1), glm::vec3(100, 0, 3)), back = glm::scale(glm::translate(glm::mat4(1), glm::vec3(5, 0, 3)), glm::vec3(8));
    REQUIRE(nacreInstanceSetTransform(caster, &away[0][0]) == NACRE_OK);
    CHECK(host.draw(desc).rgba != inTime.rgba);
    REQUIRE(nacreInstanceSetTransform(caster, &back[0][0]) == NACRE_OK);
    CHECK(host.draw(desc).rgba == inTime.rgba);
    CHECK(host.stats().shadowMapsDrawn == 12);
    for (const uint32_t size : {0u, 15u, 1u << 20}) CHECK(nacreContextSetShadowBudget(host.context, 1, size) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(nacreContextSetShadowBudget({}, 1, 64) == NACRE_ERROR_INVALID_ARGUMENT);
}
