// Scenes: what overlaps is drawn as one, what is apart costs its own share, and each view sees what it should.
#include "runtime_joint_reference.h"

#include "appearance/sss/sss.h"

using namespace nacre;
using namespace nacre::test;

namespace {

const Camera kCamera = offCentre();
const std::vector<Light> kLights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f}), directionalLight({-0.3f, 0.4f, 0.9f}, {0.3f, 0.6f, 0.9f}, 0.1f)};

glm::dmat4 shift(glm::dvec3 by) { return glm::translate(glm::dmat4(1), by); }

/// Where an instance at `by` puts its splats: light transport does not notice, the network of sss has its own frame.
SplatAsset translated(SplatAsset asset, glm::vec3 by)
{
    for (glm::vec3& p : asset.cloud.positions) p += by;
    for (Channel& c : asset.channels)
        if (c.name == "network")
            for (int k = 0; k < 3; ++k) c.values[size_t(kSssFrame + k)] += by[k];
    return asset;
}

/// The splats of both, a's first. Channels per asset are a's.
SplatAsset merged(SplatAsset a, const SplatAsset& b)
{
    const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
    a.cloud.count += b.cloud.count;
    append(a.cloud.positions, b.cloud.positions);
    append(a.cloud.rotations, b.cloud.rotations);
    append(a.cloud.scales, b.cloud.scales);
    append(a.cloud.opacities, b.cloud.opacities);
    for (Channel& c : a.channels) {
        if (c.perAsset) continue;
        append(c.values, b.find(c.name.c_str())->values);
        append(c.bytes, b.find(c.name.c_str())->bytes);
    }
    return a;
}

/// On a grid of 1/16, so that many splats are equally far and the order of ties shows; translations of multiples of it are exact.
SplatAsset onGrid(SplatAsset asset)
{
    for (glm::vec3& p : asset.cloud.positions) p = glm::round(16.0f * p) / 16.0f;
    return asset;
}

struct Work {
    uint32_t light, view, combine, projected, sorted;
    uint64_t splats;
    bool operator==(const Work&) const = default;
};
constexpr Work kNone{};
Work work(const Host& host, NacreView view)
{
    const NacreDrawStats s = host.stats(view);
    return {s.lightPassesRun, s.viewPassesRun, s.combinePassesRun, s.projected, s.sorted, s.relightSplats};
}

std::vector<SplatAsset> bothModels() { return {withSharp(randomAsset(200, 9, 4), kAllSharp, 4), randomSss(200, kAllSss, 4)}; }

} // namespace

// ---- one joint order ----------------------------------------------------------------------------------------------------------

TEST_CASE("two instances that overlap show what one asset of both shows, bit for bit, equal distances included")
{
    if (!haveGl()) return;
    SplatAsset waxA = onGrid(randomSss(300, kAllSss, 1)), waxB = onGrid(randomSss(200, kAllSss, 2));
    for (size_t k = 0; k < waxB.channels.size(); ++k)
        if (waxB.channels[k].perAsset) waxB.channels[k] = waxA.channels[k];
    const std::pair<SplatAsset, SplatAsset> pairs[] = {
        {onGrid(withSharp(randomAsset(300, 9, 1), kAllSharp, 1)), onGrid(withSharp(randomAsset(200, 9, 2), kAllSharp, 3))}, {waxA, waxB}};
    for (const auto& [a, b] : pairs) {
        CAPTURE(a.model);
        Host scene, one(merged(a, b));
        scene.place(a), scene.place(b);
        const Image joint = scene.draw(kCamera, kLights);
        CHECK(largest(joint) > 0.3f);
        CHECK(scene.stats().instancesDrawn == 2);
        CHECK(scene.stats().splatsDrawn == 500);
        CHECK(largestDifference(joint, one.draw(kCamera, kLights)) == 0.0f);
    }
}

TEST_CASE("instances elsewhere show what one asset of moved splats shows")
{
    if (!haveGl()) return;
    const SplatAsset a = onGrid(withSharp(randomAsset(300, 9, 1), kAllSharp, 1)), b = onGrid(withSharp(randomAsset(200, 9, 2), kAllSharp, 3));
    const glm::vec3 atA(-0.25f, 0.125f, 0), atB(0.25f, 0, 0.1875f);
    Host scene, one(merged(translated(a, atA), translated(b, atB)));
    scene.place(a, shift(atA)), scene.place(b, shift(atB));
    const Image joint = scene.draw(kCamera, kLights), expected = one.draw(kCamera, kLights);
    CHECK(psnr(joint, expected) > 60.0);
    CHECK(largestDifference(joint, expected) < 1e-4f * largest(expected)); // lights are packed into other frames; another order would cost more
}

TEST_CASE("overlapping instances of any models are blended jointly: against a float64 reference")
{
    if (!haveGl()) return;
    const SplatAsset fur = withSharp(randomAsset(250, 9, 1), kAllSharp, 1), moss = randomAsset(200, 0, 2), wax = randomSss(250, kAllSss, 3),
                     soap = randomSss(200, kSssMaps, 4);
    const std::vector<std::vector<SplatAsset>> scenes = {{fur, moss}, {wax, soap}, {fur, wax}, {wax, moss}, {fur, wax, moss, soap}};
    for (const std::vector<SplatAsset>& scene : scenes)
        for (const int lightCount : {1, 2, 14, 40}) { // fewer than the first layers hold, and more than a pass
            if (lightCount == 40 && scene[0].model == scene[1].model) continue; // of one model: in the tests of the model
            CAPTURE(scene.size());
            CAPTURE(scene[0].model);
            CAPTURE(scene[1].model);
            CAPTURE(lightCount);
            std::vector<Light> lights(kLights.begin(), kLights.begin() + std::min(lightCount, 2));
            for (int i = 2; i < lightCount; ++i) lights.push_back(pointLight(1.5f * glm::vec3(std::cos(float(i)), 0.5f, std::sin(float(i))), glm::vec3(0.3f)));
            Host host;
            std::vector<SplatAsset> inWorld;
            for (size_t i = 0; i < scene.size(); ++i) {
                const glm::vec3 at = 0.2f * glm::vec3(i % 2 ? 1 : -1, i / 2, 0.5f);
                host.place(scene[i], shift(at));
                inWorld.push_back(translated(scene[i], at));
            }
            const Image drawn = host.draw(kCamera, lights), expected = jointReference(inWorld, kCamera, lights);
            CHECK(largest(expected) > 0.3f);
            const bool surfaces = scene[0].model == "sss" || scene[1].model == "sss";
            CHECK(psnr(drawn, expected) > (surfaces ? 50.0 : 75.0)); // layers of half floats; floats
        }
}

TEST_CASE("a surface that a cloud of the other model covers is shaded as it is without, only fainter")
{
    if (!haveGl()) return;
    SplatAsset wax = randomSss(1, kAllSss, 7), veil = oneSplat(0, glm::vec3(0.4f), 0.5f);
    wax.cloud.positions[0] = glm::vec3(0), wax.cloud.scales[0] = glm::vec3(0.5f), wax.cloud.opacities[0] = 0.9f;
    const Camera front = lookAt({0, 0, 2}, {0, 0, 0}, 33, 33, 40);
    Host host;
    const NacreInstance surface = host.place(wax), cloud = host.place(veil, shift({0, 0, 0.5}));
    host.setLights({{pointLight({1, 1, 2}, glm::vec3(3))}});
    const Image behind = host.draw(describe(front, {&surface, 1})), before = host.draw(describe(front, {&cloud, 1})), both = host.draw(front);
    for (int c = 0; c < 4; ++c)
        CHECK(both.pixel(16, 16)[c] == doctest::Approx(before.pixel(16, 16)[c] + (1 - before.pixel(16, 16)[3]) * behind.pixel(16, 16)[c]).epsilon(2e-3));
    CHECK(both.pixel(16, 16)[0] > before.pixel(16, 16)[0] + 0.01f);
}

// ---- many instances -----------------------------------------------------------------------------------------------------------

TEST_CASE("a hundred instances show what one asset of all their splats shows; one that moves costs its own share")
{
    if (!haveGl()) return;
    const SplatAsset prop = onGrid(randomAsset(40, 4, 6));
    Host scene, one;
    const NacreAsset asset = scene.create(prop);
    std::vector<NacreInstance> instances;
    SplatAsset all;
    for (int i = 0; i < 100; ++i) {
        const glm::vec3 at(0.5f * float(i % 10) - 2.25f, 0.25f * float(i % 3), 0.5f * float(i / 10) - 2.25f);
        instances.push_back(scene.place(asset, shift(at)));
        const SplatAsset here = translated(prop, at);
        all = i ? merged(std::move(all), here) : here;
    }
    one.load(all);
    const Camera camera = lookAt({3, 3, 5}, {0, 0, 0}, 96, 72, 90);
    const Image drawn = scene.draw(camera, kLights), expected = one.draw(camera, kLights);
    CHECK(psnr(drawn, expected) > 60.0);
    CHECK(scene.stats().instancesDrawn == 100);
    CHECK(scene.stats().lightPassesRun == 100);
    CHECK(scene.contextInfo().instances == 100);
    CHECK(scene.contextInfo().assets == 1);

    scene.draw(camera);
    CHECK(work(scene, scene.view) == kNone);
    const float upwards[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.25f, 0.5f, 0, 1};
    REQUIRE(nacreInstanceSetTransform(instances[17], upwards) == NACRE_OK);
    scene.draw(camera);
    CHECK(work(scene, scene.view).light == 1);
    CHECK(work(scene, scene.view).combine == 1);
    CHECK(work(scene, scene.view).splats <= 3 * 40);
    nacreInstanceDestroy(instances[17]);
    scene.draw(camera);
    CHECK(scene.stats().instancesDrawn == 99);
    CHECK(work(scene, scene.view).light == 0);
}

TEST_CASE("programs are compiled for kinds of assets, not for assets or instances")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host host(asset);
        host.draw(kCamera, kLights);
        const uint32_t before = host.contextInfo().programs;
        CHECK(before > 0);
        host.place(host.asset, shift({0.5, 0, 0}));
        host.place(asset, shift({0, 0.5, 0}));
        host.draw(kCamera);
        host.draw(host.addView(), describe(kCamera));
        CHECK(host.contextInfo().programs == before);
    }
}

TEST_CASE("relighting within a budget gets there in some draws, and shows then what it shows without")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host host, fresh;
        for (int i = 0; i < 6; ++i)
            for (Host* h : {&host, &fresh}) h->place(asset, shift({0.3 * i - 0.8, 0, 0}));
        host.draw(kCamera, {{directionalLight({0, 1, 0}, glm::vec3(1))}});
        host.setLights(kLights);
        NacreDrawDesc desc = describe(kCamera);
        desc.maxRelightSplats = 450;
        int draws = 0;
        uint64_t pending = ~0ull;
        for (; draws < 100; ++draws) {
            CHECK(allFinite(host.draw(desc)));
            CHECK(host.stats().relightSplats <= 450);
            pending = host.stats().relightPending;
            if (pending == 0) break;
            CHECK(host.stats().relightSplats > 0);
        }
        CHECK(pending == 0);
        CHECK(draws >= 2);
        CHECK(largestDifference(host.draw(desc), fresh.draw(kCamera, kLights)) == 0.0f);
        host.draw(desc);
        CHECK(work(host, host.view) == kNone);
    }
}

TEST_CASE("of many lights the one that moves is evaluated again, and shows what all of them evaluated afresh show")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        std::vector<Light> lights;
        for (int i = 0; i < 40; ++i) lights.push_back(pointLight(2.0f * glm::vec3(std::cos(float(i)), std::sin(0.7f * float(i)), 1), glm::vec3(0.2f)));
        Host host(asset), fresh(asset);
        host.draw(kCamera, lights);
        const uint64_t all = host.stats().relightSplats;
        lights[13].position += 0.5f;
        const Image moved = host.draw(kCamera, lights);
        CHECK(host.stats().lightPassesRun == 1);
        if (asset.model == "bigs") CHECK(host.stats().relightSplats < all / 4);
        CHECK(largestDifference(moved, fresh.draw(kCamera, lights)) < 1e-5f * largest(moved));
        CHECK(host.stats().lightsUsed == 40);
    }
}

// ---- views --------------------------------------------------------------------------------------------------------------------

TEST_CASE("views that take turns keep their own order and caches: from the second round on nothing is done again")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host host(asset), fresh(asset);
        host.place(asset, shift({0.4, 0.1, -0.2}));
        fresh.place(asset, shift({0.4, 0.1, -0.2}));
        const Camera cameras[] = {kCamera, lookAt({-1.5, 0.3, 1}, {0.1, 0, 0}, 40, 30, 40)};
        const NacreView views[] = {host.view, host.addView()};
        host.setLights(kLights);
        Image first[2];
        for (int v = 0; v < 2; ++v) first[v] = host.draw(views[v], describe(cameras[v]));
        if (asset.model == "bigs") CHECK(work(host, views[1]).light == 0); // what depends on lights alone is shared
        for (int round = 0; round < 3; ++round)
            for (int v = 0; v < 2; ++v) {
                CHECK(largestDifference(host.draw(views[v], describe(cameras[v])), first[v]) == 0.0f);
                CHECK(work(host, views[v]) == kNone);
            }
        for (int v = 0; v < 2; ++v) CHECK(largestDifference(first[v], fresh.draw(cameras[v], kLights)) == 0.0f);
    }
}

TEST_CASE("light masks say which instance is lit by which lights, view masks where it is drawn; 0 is all")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host host, reference;
        const NacreInstance a = host.place(asset), b = host.place(asset, shift({0.5, 0, 0}));
        const NacreInstance ra = reference.place(asset), rb = reference.place(asset, shift({0.5, 0, 0}));
        std::vector<NacreLight> lights = {toNacre(kLights[0]), toNacre(kLights[1])};
        lights[0].mask = 1, lights[1].mask = 6;
        REQUIRE(nacreContextSetLights(host.context, lights.data(), 2) == NACRE_OK);
        REQUIRE(nacreInstanceSetMasks(a, 1, 1) == NACRE_OK);
        REQUIRE(nacreInstanceSetMasks(b, 2, 2) == NACRE_OK);
        const NacreView first = host.addView(1), second = host.addView(2), third = host.addView(4), both = host.addView(3);
        const Image seenA = host.draw(first, describe(kCamera)), seenB = host.draw(second, describe(kCamera));
        reference.setLights({{kLights[0]}});
        CHECK(largestDifference(seenA, reference.draw(describe(kCamera, {&ra, 1}))) == 0.0f);
        reference.setLights({{kLights[1]}});
        CHECK(largestDifference(seenB, reference.draw(describe(kCamera, {&rb, 1}))) == 0.0f);
        CHECK(largest(host.draw(third, describe(kCamera))) == 0.0f);
        CHECK(host.stats(third).instancesDrawn == 0);
        host.draw(both, describe(kCamera));
        CHECK(host.stats(both).instancesDrawn == 2);
        host.draw(host.view, describe(kCamera));
        CHECK(host.stats().instancesDrawn == 2);
        CHECK(host.stats().lightsUsed == 2);

        REQUIRE(nacreInstanceSetMasks(a, 0, 0) == NACRE_OK);
        REQUIRE(nacreInstanceSetMasks(b, 0, 0) == NACRE_OK);
        CHECK(largestDifference(host.draw(third, describe(kCamera)), reference.draw(kCamera, kLights)) == 0.0f);
        CHECK(host.stats(third).lightsUsed == 4);
        REQUIRE(nacreInstanceSetMasks(a, 8, 0) == NACRE_OK); // none of the lights
        const Image dark = host.draw(third, describe(kCamera, {&a, 1}));
        for (size_t i = 0; i < dark.rgba.size(); ++i)
            if (i % 4 != 3) REQUIRE(dark.rgba[i] == 0.0f);
        CHECK(largest(dark) > 0.1f);
    }
}

TEST_CASE("an instance that is hidden is not drawn, shades nothing and comes back as it was")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host host(asset);
        const Image alone = host.draw(kCamera, kLights);
        const NacreInstance second = host.place(asset, shift({0.2, 0, 0.2}));
        const Image both = host.draw(kCamera);
        CHECK(largestDifference(both, alone) > 0.01f);
        REQUIRE(nacreInstanceSetHidden(second, 1) == NACRE_OK);
        CHECK(largestDifference(host.draw(kCamera), alone) == 0.0f);
        CHECK(host.stats().instancesDrawn == 1);
        REQUIRE(nacreInstanceSetHidden(second, 0) == NACRE_OK);
        CHECK(largestDifference(host.draw(kCamera), both) == 0.0f);
        CHECK(host.stats().lightPassesRun == 0);
        REQUIRE(nacreInstanceSetHidden(second, 1) == NACRE_OK);
        REQUIRE(nacreInstanceSetHidden(host.instance, 1) == NACRE_OK);
        CHECK(largest(host.draw(kCamera)) == 0.0f);
        CHECK(host.stats().splatsDrawn == 0);
    }
}

TEST_CASE("a draw takes the instances it is given, in any order, and no others")
{
    if (!haveGl()) return;
    const SplatAsset asset = onGrid(randomAsset(100, 4, 8));
    Host host;
    NacreInstance i[3];
    for (int k = 0; k < 3; ++k) i[k] = host.place(asset, shift({0.25 * k, 0, 0}));
    host.setLights(kLights);
    const Image all = host.draw(kCamera);
    const NacreInstance some[] = {i[0], i[2]}, three[] = {i[0], i[1], i[2]};
    CHECK(largestDifference(host.draw(describe(kCamera, three)), all) == 0.0f);
    const Image two = host.draw(describe(kCamera, some));
    CHECK(host.stats().instancesDrawn == 2);
    nacreInstanceDestroy(i[1]);
    CHECK(largestDifference(host.draw(kCamera), two) == 0.0f);
    NacreDrawDesc none = describe(kCamera);
    none.instances = some, none.instanceCount = 0;
    CHECK(largest(host.draw(none)) == 0.0f);
    CHECK(host.stats().instancesDrawn == 0);
}

// ---- looks --------------------------------------------------------------------------------------------------------------------

TEST_CASE("a tint multiplies all that bigs sends, and of sss base colour and scattered light; 1 changes no pixel, other instances neither")
{
    if (!haveGl()) return;
    const float tint[3] = {0.5f, 0.25f, 0.75f}, white[3] = {1, 1, 1};
    {
        Host host(withSharp(randomAsset(200, 9, 4), kAllSharp, 4));
        Image expected = host.draw(kCamera, kLights);
        REQUIRE(nacreInstanceSetTint(host.instance, white) == NACRE_OK);
        CHECK(largestDifference(host.draw(kCamera), expected) == 0.0f);
        const float brighter[3] = {2, 0.5f, 0};
        REQUIRE(nacreInstanceSetTint(host.instance, brighter) == NACRE_OK);
        const Image drawn = host.draw(kCamera);
        CHECK(host.stats().lightPassesRun == 0);
        for (size_t i = 0; i < expected.rgba.size(); ++i)
            if (i % 4 != 3) expected.rgba[i] *= brighter[i % 4];
        CHECK(largestDifference(drawn, expected) < 1e-5f * largest(expected));
    }
    Host host(randomSss(200, kAllSss, 4)), edited(randomSss(200, kAllSss, 4));
    const Image plain = host.draw(kCamera, kLights);
    REQUIRE(nacreInstanceSetTint(host.instance, white) == NACRE_OK);
    CHECK(largestDifference(host.draw(kCamera), plain) == 0.0f);
    REQUIRE(nacreInstanceSetTint(host.instance, tint) == NACRE_OK);
    NacreEdit edits[2] = {};
    edits[0].target = NACRE_EDIT_BASE_COLOR, edits[1].target = NACRE_EDIT_RESIDUAL;
    for (NacreEdit& e : edits) e.operation = NACRE_EDIT_MULTIPLY, std::copy_n(tint, 3, e.value);
    REQUIRE(nacreInstanceSetEdits(edited.instance, edits, 2) == NACRE_OK);
    const Image tinted = host.draw(kCamera);
    CHECK(psnr(tinted, edited.draw(kCamera, kLights)) > 60.0);
    CHECK(psnr(tinted, plain) < 40.0);

    const NacreInstance second = host.place(host.asset), only[] = {second};
    CHECK(largestDifference(host.draw(describe(kCamera, only)), plain) == 0.0f);
}

TEST_CASE("edits belong to the instance: its siblings stay as baked")
{
    if (!haveGl()) return;
    Host host(randomSss(200, kAllSss, 4));
    const NacreInstance second = host.place(host.asset);
    host.setLights(kLights);
    const Image baked = host.draw(describe(kCamera, {&second, 1}));
    NacreEdit edit{};
    edit.target = NACRE_EDIT_BASE_COLOR, edit.value[0] = 0.9f;
    REQUIRE(nacreInstanceSetEdits(host.instance, &edit, 1) == NACRE_OK);
    CHECK(largestDifference(host.draw(describe(kCamera, {&host.instance, 1})), baked) > 0.05f);
    CHECK(largestDifference(host.draw(describe(kCamera, {&second, 1})), baked) == 0.0f);
}

TEST_CASE("an instance and its mirror image under mirrored lights make a picture that is its own mirror image")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host host;
        const glm::dmat4 right = shift({0.8, 0, 0}) * glm::rotate(glm::dmat4(1), 0.7, glm::normalize(glm::dvec3(1, 2, 3)));
        host.place(asset, right), host.place(asset, glm::scale(glm::dmat4(1), glm::dvec3(-1, 1, 1)) * right);
        std::vector<Light> lights = {kLights[0], kLights[0], kLights[1], kLights[1]};
        lights[1].position.x *= -1, lights[3].directionToLight.x *= -1;
        const Image image = host.draw(lookAt({0, 0.4, 3}, {0, 0, 0}, 80, 50, 60), lights);
        float most = 0;
        for (int y = 0; y < 50; ++y)
            for (int x = 0; x < 40; ++x)
                for (int c = 0; c < 4; ++c) most = std::max(most, std::abs(image.pixel(x, y)[c] - image.pixel(79 - x, y)[c]));
        CHECK(most < 5e-3f * largest(image));
        CHECK(largest(image) > 0.3f);
    }
}

TEST_CASE("an orthographic view shows what a camera far away shows")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host host(asset);
        host.place(asset, shift({0.4, 0.2, -0.3}));
        const double distance = 3000, half = 1;
        const Camera far = lookAt(distance * glm::normalize(glm::dvec3(0.9, 0.7, 1.6)), {0, 0, 0}, 64, 64, 32 * distance / half);
        const Image expected = host.draw(far, kLights);
        NacreDrawDesc desc = describe(far);
        copy(desc.viewFromWorld, glm::lookAt(2.0 * glm::normalize(glm::dvec3(0.9, 0.7, 1.6)), glm::dvec3(0), glm::dvec3(0, 1, 0)));
        copy(desc.clipFromView, glm::ortho(-half, half, -half, half, 0.01, 10.0));
        CHECK(largest(expected) > 0.3f);
        CHECK(psnr(host.draw(desc), expected) > 45.0); // rays at an angle of up to 3e-4; float32 at such distances
        host.draw(desc);
        CHECK(work(host, host.view) == kNone);
    }
}

TEST_CASE("an instance out of the frame is neither relit nor projected; one that comes in shows what it would have shown")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : bothModels()) {
        CAPTURE(asset.model);
        Host scene, fresh;
        const glm::dvec3 behind = kCamera.position() + 3.0 * glm::dvec3(kCamera.worldFromCamera[2]); // the camera looks along -z
        scene.place(asset), fresh.place(asset), fresh.place(asset, shift({0.2, 0, 0}));
        const NacreInstance other = scene.place(asset, shift(behind));
        scene.draw(kCamera, kLights);
        CHECK(scene.stats().instancesDrawn == 1);
        CHECK(scene.stats().combinePassesRun == 1);
        float in[16];
        copy(in, shift({0.2, 0, 0}));
        REQUIRE(nacreInstanceSetTransform(other, in) == NACRE_OK);
        const Image seen = scene.draw(kCamera);
        CHECK(scene.stats().instancesDrawn == 2);
        CHECK(largestDifference(seen, fresh.draw(kCamera, kLights)) == 0.0f);
    }
}
