// The sss model in the runtime: against the reference renderer, over many lights, under edits and inside a host's frame.
#include "runtime_fixture.h"

#include "eval/splat_renderer.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

using namespace nacre;
using namespace nacre::test;

static std::vector<Light> lightsAround(int count)
{
    std::vector<Light> lights;
    for (int i = 0; i < count; ++i) {
        const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
        const glm::vec3 at(1.5 * r * std::cos(2.4 * i), 1.5 * r * std::sin(2.4 * i), 1.5 * z), color(0.2f + 0.1f * float(i % 3), 0.3f, 0.5f - 0.1f * float(i % 4));
        lights.push_back(i % 3 == 1 ? directionalLight(at, color, i % 2 ? 0.2f : 0.0f) : pointLight(at, 3.0f * color));
    }
    return lights;
}

static Image reference(const SplatAsset& asset, const Camera& camera, std::span<const Light> lights, std::span<const SplatEdit> edits = {})
{
    const auto renderer = makeReferenceRenderer(asset);
    REQUIRE(renderer);
    REQUIRE((*renderer)->setEdits(edits));
    auto image = (*renderer)->render(camera, lights);
    REQUIRE(image);
    return std::move(*image);
}

TEST_CASE("sss: GL draws the reference image, with and without maps, network, scattering and share")
{
    if (!haveGl()) return;
    Host host;
    for (int which = 0; which <= kAllSss; ++which) {
        CAPTURE(which);
        const SplatAsset asset = randomSss(800, which, 5);
        host.load(asset);
        const std::vector<Light> lights = lightsAround(3);
        const Image expected = reference(asset, offCentre(), lights), drawn = host.draw(offCentre(), lights);
        CHECK(largest(expected) > 0.3f);
        CHECK(psnr(drawn, expected) > 50.0); // the G-buffer is blended in half floats: 2^-11 a layer
    }
}

TEST_CASE("sss: more lights than one G-buffer holds match the reference, and light adds up")
{
    if (!haveGl()) return;
    const SplatAsset asset = randomSss(400, kAllSss, 6);
    Host host(asset);
    for (const int count : {0, 1, 2, 3, 5, 11, 12, 36, 60, 256}) { // at the borders between layers and between passes
        CAPTURE(count);
        std::vector<Light> lights = lightsAround(std::max(count, 1));
        lights.resize(size_t(count));
        for (Light& light : lights) light.intensity *= 3.0f / float(count);
        CHECK(psnr(host.draw(offCentre(), lights), reference(asset, offCentre(), lights)) > 50.0);
    }
    const std::vector<Light> lights = lightsAround(14);
    const Image all = host.draw(offCentre(), lights);
    Image sum = all;
    std::fill(sum.rgba.begin(), sum.rgba.end(), 0.0f);
    for (const Light& light : lights) {
        const Image one = host.draw(offCentre(), {{light}});
        for (size_t i = 0; i < sum.rgba.size(); ++i) sum.rgba[i] += one.rgba[i];
    }
    for (size_t i = 0; i < sum.rgba.size(); ++i)
        if (i % 4 != 3) REQUIRE(std::abs(sum.rgba[i] - all.rgba[i]) < 2e-3f * (1 + all.rgba[i])); // half floats
    // twice the light is twice the image, but for half floats of scattered light
    std::vector<Light> twice = lights;
    for (Light& light : twice) light.intensity *= 2.0f;
    const Image brighter = host.draw(offCentre(), twice);
    for (size_t i = 0; i < all.rgba.size(); ++i)
        if (i % 4 != 3) REQUIRE(std::abs(brighter.rgba[i] - 2 * all.rgba[i]) < 2e-3f * (1 + all.rgba[i]));
}

static int dispatches = 0;
static void* countDispatches(const char* name, void* user)
{
    static constexpr auto kDispatch = [](GLuint x, GLuint y, GLuint z) { ++dispatches, glDispatchCompute(x, y, z); };
    return std::strcmp(name, "glDispatchCompute") == 0 ? reinterpret_cast<void*>(+kDispatch) : HeadlessGl::getProcAddress(name, user);
}
static void* withoutCompute(const char* name, void* user)
{
    return std::strcmp(name, "glDispatchCompute") == 0 ? nullptr : HeadlessGl::getProcAddress(name, user);
}

TEST_CASE("sss: the network in a compute shader, where there is one, draws what it draws in fragments")
{
    if (!haveGl()) return;
    Host fragments(withoutCompute), compute(countDispatches);
    GLint major = 0, minor = 0;
    glGetIntegerv(GL_MAJOR_VERSION, &major), glGetIntegerv(GL_MINOR_VERSION, &minor);
    if (10 * major + minor < 43) {
        MESSAGE("SKIPPED: no compute shaders before OpenGL 4.3, here is " << major << "." << minor);
        return;
    }
    for (const size_t splats : {1, 64, 65, 700}) // workgroups that are not full
        for (const int which : {0, int(kSssNetwork), int(kAllSss)})
            for (const int lights : {1, 3, 6, 37}) {
                CAPTURE(splats);
                CAPTURE(which);
                CAPTURE(lights);
                const SplatAsset asset = randomSss(splats, which, 11);
                const auto draw = [&](Host& host) {
                    host.gl->makeCurrent();
                    host.load(asset);
                    return host.draw(offCentre(), lightsAround(lights));
                };
                const Image expected = draw(fragments);
                dispatches = 0;
                const Image drawn = draw(compute);
                CHECK(dispatches == int((which & kSssNetwork) != 0));
                CHECK(largest(expected) > 0.1f);
                CHECK(largestDifference(drawn, expected) < 1e-3f * largest(expected));
            }
}

TEST_CASE("sss: a grid of more rows than a texture has, were it as narrow as that of a small asset, takes many lights")
{
    if (!haveGl()) return;
    Host host;
    GLint texels = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &texels);
    constexpr size_t kLights = 256;
    const size_t count = size_t(texels) / (kLights / 4) * 64 + 1; // four lights to a slot; 64: the narrowest grid
    if (count > 20000) {
        MESSAGE("SKIPPED: textures of " << texels << " texels hold the narrow grid of any asset worth a test");
        return;
    }
    host.load(randomSss(count, 0, 8, 0.01f));
    const Image few = host.draw(offCentre(), lightsAround(1)), most = host.draw(offCentre(), lightsAround(int(kLights)));
    CHECK(largest(most) > largest(few));
}

TEST_CASE("sss: the light pass runs when lights or camera change, the sum also for edits, and nothing at rest")
{
    if (!haveGl()) return;
    Host host(randomSss(50, kAllSss, 7));
    const auto passes = [&] { return std::array<uint32_t, 2>{host.stats().lightPassesRun, host.stats().combinePassesRun}; };
    host.draw(offCentre(), lightsAround(2));
    CHECK(passes() == std::array<uint32_t, 2>{1, 1});
    const Image first = host.draw(offCentre());
    CHECK(passes() == std::array<uint32_t, 2>{0, 0});
    Camera moved = offCentre();
    moved.worldFromCamera[3][0] += 0.01;
    host.draw(moved);
    CHECK(passes() == std::array<uint32_t, 2>{1, 1});
    NacreEdit edit{NACRE_EDIT_SUBSURFACE, NACRE_EDIT_MULTIPLY, {0.5f, 0, 0}, NACRE_REGION_EVERYWHERE, {}, {}};
    REQUIRE(nacreInstanceSetEdits(host.instance, &edit, 1) == NACRE_OK);
    host.draw(moved);
    CHECK(passes() == std::array<uint32_t, 2>{0, 1});
    REQUIRE(nacreInstanceSetEdits(host.instance, nullptr, 0) == NACRE_OK);
    CHECK(largestDifference(host.draw(offCentre()), first) == 0.0f);
}

TEST_CASE("sss: every edit changes the image as in the reference, only in its region; factors of 1 change no pixel")
{
    if (!haveGl()) return;
    const SplatAsset asset = randomSss(400, kAllSss, 8);
    Host host(asset);
    const std::vector<Light> lights = lightsAround(4);
    const Image baked = host.draw(offCentre(), lights);
    for (int target = NACRE_EDIT_BASE_COLOR; target <= NACRE_EDIT_OPACITY; ++target)
        for (const int operation : {NACRE_EDIT_SET, NACRE_EDIT_MULTIPLY})
            for (const int region : {NACRE_REGION_EVERYWHERE, NACRE_REGION_BOX, NACRE_REGION_SPHERE}) {
                CAPTURE(target);
                CAPTURE(operation);
                CAPTURE(region);
                NacreEdit edit{NacreEditTarget(target), NacreEditOperation(operation), {1, 1, 1}, NacreEditRegion(region), {-1, -1, 0}, {1, 1, 1}};
                if (region == NACRE_REGION_SPHERE) edit.low[0] = 0.3f, edit.low[1] = 0.2f, edit.low[2] = 0.3f, edit.high[0] = 0.25f;
                if (operation == NACRE_EDIT_MULTIPLY) {
                    REQUIRE(nacreInstanceSetEdits(host.instance, &edit, 1) == NACRE_OK);
                    REQUIRE(largestDifference(host.draw(offCentre()), baked) == 0.0f);
                }
                edit.value[0] = 0.4f, edit.value[1] = 0.1f, edit.value[2] = 0.7f;
                REQUIRE(nacreInstanceSetEdits(host.instance, &edit, 1) == NACRE_OK);
                const Image edited = host.draw(offCentre());
                SplatEdit same{EditTarget(target), operation == NACRE_EDIT_MULTIPLY, {0.4f, 0.1f, 0.7f}, EditRegion(region), {}, {}};
                std::copy_n(edit.low, 3, same.low), std::copy_n(edit.high, 3, same.high);
                CHECK(largestDifference(edited, baked) > 1e-3f);
                CHECK(psnr(edited, reference(asset, offCentre(), lights, {&same, 1})) > 50.0);
            }
}

TEST_CASE("sss: edits that make no sense are refused by name, and bigs has no materials")
{
    if (!haveGl()) return;
    Host host(randomSss(5, kAllSss, 9));
    const NacreEdit good{NACRE_EDIT_ROUGHNESS, NACRE_EDIT_SET, {0.5f, 0, 0}, NACRE_REGION_EVERYWHERE, {}, {}};
    const auto refuses = [&](const char* text, auto change) {
        NacreEdit edit = good;
        change(edit);
        CHECK(nacreInstanceSetEdits(host.instance, &edit, 1) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK_MESSAGE(host.lastMessage().find(text) != std::string::npos, host.lastMessage());
    };
    refuses("unknown target", [](NacreEdit& e) { const int raw = 77; std::memcpy(&e.target, &raw, sizeof raw); });
    refuses("unknown operation", [](NacreEdit& e) { const int raw = 2; std::memcpy(&e.operation, &raw, sizeof raw); });
    refuses("unknown region", [](NacreEdit& e) { const int raw = -1; std::memcpy(&e.region, &raw, sizeof raw); });
    refuses("values must be", [](NacreEdit& e) { e.value[0] = NAN; });
    refuses("values must be", [](NacreEdit& e) { e.value[0] = -0.1f; });
    refuses("region is not finite", [](NacreEdit& e) { e.region = NACRE_REGION_BOX, e.high[1] = INFINITY; });
    refuses("radius", [](NacreEdit& e) { e.region = NACRE_REGION_SPHERE, e.high[0] = -1; });
    const std::vector<NacreEdit> many(NACRE_MAX_EDITS + 1, good);
    CHECK(nacreInstanceSetEdits(host.instance, many.data(), many.size()) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(nacreInstanceSetEdits(host.instance, nullptr, 1) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(nacreInstanceSetEdits({}, &good, 1) == NACRE_ERROR_INVALID_ARGUMENT);
    host.load(oneSplat(0));
    CHECK(nacreInstanceSetEdits(host.instance, &good, 1) == NACRE_ERROR_UNSUPPORTED);
    CHECK(nacreInstanceSetEdits(host.instance, nullptr, 0) == NACRE_OK);
}

TEST_CASE("sss: the asset names its model")
{
    if (!haveGl()) return;
    Host host(randomSss(5, kAllSss, 7));
    CHECK(std::string(host.info().model) == "sss");
}

TEST_CASE("sss: extreme materials and lights stay finite, and like the reference")
{
    if (!haveGl()) return;
    SplatAsset asset = randomSss(60, kAllSss, 10);
    for (size_t g = 0; g < asset.cloud.count; ++g) {
        asset.channels[1].values[3 * g] = float(g % 2);         // roughness
        asset.channels[1].values[3 * g + 1] = float(g / 2 % 2); // metalness
        if (g % 3 == 0) // normals that cancel against those of the neighbours
            for (int k = 0; k < 3; ++k) asset.channels[2].values[3 * g + size_t(k)] *= -1.0f;
    }
    Host host(asset);
    Camera inside = offCentre();
    inside.worldFromCamera[3] = glm::dvec4(glm::dvec3(asset.cloud.positions[0]), 1.0);
    const std::vector<Light> lights[] = {
        {pointLight(asset.cloud.positions[1], glm::vec3(1))},                     // on a splat
        {pointLight({1e6f, 0, 0}, glm::vec3(1e12f))},                             // far and strong
        {directionalLight({-0.9f, -0.7f, -1.6f}, glm::vec3(1))},                  // opposite the camera: no half vector
        {pointLight({0.9f, 0.7f, 1.6f}, glm::vec3(1e4f))},                        // in the camera, HDR
    };
    for (const auto& light : lights)
        for (const Camera& camera : {offCentre(), inside}) {
            const Image drawn = host.draw(camera, light);
            CHECK(allFinite(drawn));
            CHECK(psnr(drawn, reference(asset, camera, light)) > 35.0); // roughness 0: a half float of the normal moves the highlight
        }
}
