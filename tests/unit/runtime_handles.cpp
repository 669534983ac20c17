// Ids and arguments of any kind: every function of the API refuses what does not live and what makes no sense, and goes on afterwards.
#include "runtime_fixture.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include <functional>
#include <limits>

using namespace nacre;
using namespace nacre::test;

namespace {

const Camera kCamera = lookAt({0.3, 0.2, 2}, {0, 0, 0}, 16, 16, 20);
const std::vector<Light> kLamp = {pointLight({1, 1, 2}, glm::vec3(3))};

/// A function that takes an id, called with good arguments otherwise.
struct Call {
    const char* name;
    std::function<NacreResult(uint64_t)> call;
};

NacreInstanceDesc instanceDesc(NacreAsset asset)
{
    NacreInstanceDesc desc{};
    desc.structSize = sizeof desc, desc.asset = asset;
    return desc;
}

/// Every function that returns a result, by the kind of id that it takes.
struct Calls {
    std::vector<std::byte> bytes;
    NacreLight light = toNacre(kLamp[0]);
    NacreEdit edit{};
    float matrix[16], tint[3] = {1, 1, 1}, ambient[3] = {1, 1, 1};
    NacreEnvironment environment{};
    NacreDetail detail{};
    NacreDrawDesc draw = describe(kCamera);

    Calls()
    {
        bytes = *encodeAsset(randomSss(5, kAllSss, 1));
        edit.target = NACRE_EDIT_ROUGHNESS;
        copy(matrix, glm::dmat4(1));
        environment.structSize = sizeof environment, environment.sh = ambient, environment.shCount = 1;
        detail.structSize = sizeof detail, detail.leaveOut = NACRE_WITHOUT_NETWORK;
    }
    std::vector<Call> ofContext()
    {
        return {
            {"nacreContextGetInfo", [](uint64_t id) { NacreContextInfo i{}; i.structSize = sizeof i; return nacreContextGetInfo({id}, &i); }},
            {"nacreAssetCreate", [this](uint64_t id) { NacreAsset a{~0ull}; const auto r = nacreAssetCreate({id}, bytes.data(), bytes.size(), &a); return made(r, a.id); }},
            {"nacreAssetDecode", [this](uint64_t id) { NacreAsset a{~0ull}; const auto r = nacreAssetDecode({id}, bytes.data(), bytes.size(), &a); return made(r, a.id); }},
            {"nacreAssetCreateDetail", [this](uint64_t id) { NacreAsset a{~0ull}; const auto r = nacreAssetCreateDetail({id}, bytes.data(), bytes.size(), &detail, &a); return made(r, a.id); }},
            {"nacreAssetDecodeDetail", [this](uint64_t id) { NacreAsset a{~0ull}; const auto r = nacreAssetDecodeDetail({id}, bytes.data(), bytes.size(), &detail, &a); return made(r, a.id); }},
            {"nacreContextSetLights", [this](uint64_t id) { return nacreContextSetLights({id}, &light, 1); }},
            {"nacreContextSetEnvironment", [this](uint64_t id) { return nacreContextSetEnvironment({id}, &environment); }},
            {"nacreViewCreate", [](uint64_t id) { NacreView v{~0ull}; const auto r = nacreViewCreate({id}, nullptr, &v); return made(r, v.id); }},
        };
    }
    std::vector<Call> ofAsset()
    {
        return {
            {"nacreAssetGetInfo", [](uint64_t id) { NacreAssetInfo i{}; i.structSize = sizeof i; return nacreAssetGetInfo({id}, &i); }},
            {"nacreAssetUploadStep", [](uint64_t id) { return nacreAssetUploadStep({id}, 1000, nullptr); }},
            {"nacreInstanceCreate", [](uint64_t id) { NacreInstance i{~0ull}; const auto d = instanceDesc({id}); const auto r = nacreInstanceCreate(&d, &i); return made(r, i.id); }},
        };
    }
    std::vector<Call> ofInstance()
    {
        return {
            {"nacreInstanceSetTransform", [this](uint64_t id) { return nacreInstanceSetTransform({id}, matrix); }},
            {"nacreInstanceSetHidden", [](uint64_t id) { return nacreInstanceSetHidden({id}, 0); }},
            {"nacreInstanceSetMasks", [](uint64_t id) { return nacreInstanceSetMasks({id}, 0, 0); }},
            {"nacreInstanceSetTint", [this](uint64_t id) { return nacreInstanceSetTint({id}, tint); }},
            {"nacreInstanceSetEdits", [this](uint64_t id) { return nacreInstanceSetEdits({id}, &edit, 1); }},
        };
    }
    std::vector<Call> ofView()
    {
        return {
            {"nacreViewDraw", [this](uint64_t id) { return nacreViewDraw({id}, &draw); }},
            {"nacreViewPrepare", [this](uint64_t id) { return nacreViewPrepare({id}, &draw, 1); }},
            {"nacreViewGetStats", [](uint64_t id) { NacreDrawStats s{}; s.structSize = sizeof s; return nacreViewGetStats({id}, &s); }},
        };
    }

private:
    /// What creates leaves 0 where it fails, and something else where it does not.
    static NacreResult made(NacreResult result, uint64_t id)
    {
        CHECK((id != 0) == (result == NACRE_OK));
        CHECK(id != ~0ull);
        return result;
    }
};

/// A scene with two objects of each kind, so that slots and serial numbers differ.
struct Scene {
    Host host;
    NacreInstance second;
    Scene() : host(randomSss(5, kAllSss, 1))
    {
        second = host.place(randomAsset(5, 4, 1));
        host.addView();
        host.setLights(kLamp);
    }
    uint64_t live() const
    {
        const NacreContextInfo i = host.contextInfo();
        return i.assets + 1000ull * i.instances + 1000000ull * i.views;
    }
};

void destroyAll(uint64_t id)
{
    nacreAssetDestroy({id}), nacreInstanceDestroy({id}), nacreViewDestroy({id});
    nacreContextSetProfiling({id}, 0);
}

} // namespace

TEST_CASE("each function takes ids of its own kind that live, and no others")
{
    if (!haveGl()) return;
    Calls calls;
    auto elsewhere = std::make_unique<Scene>(); // a context that is gone later
    Scene scene;
    Host& host = scene.host;
    REQUIRE(host.gl->beginFrame(16, 16));
    const Image before = host.draw(kCamera);

    NacreAsset staleAsset = host.create(randomAsset(3, 0, 1));
    NacreInstance staleInstance = host.place(staleAsset);
    NacreView staleView = host.addView();
    nacreInstanceDestroy(staleInstance), nacreAssetDestroy(staleAsset), nacreViewDestroy(staleView);
    const NacreAsset reused = host.create(randomAsset(3, 0, 1)); // perhaps in the slots of those
    const NacreInstance reusedInstance = host.place(reused);
    REQUIRE(nacreInstanceSetHidden(reusedInstance, 1) == NACRE_OK);
    host.addView();

    std::vector<uint64_t> bad = {0, 1, ~0ull, staleAsset.id, staleInstance.id, staleView.id, elsewhere->host.context.id, elsewhere->host.asset.id,
                                 elsewhere->host.instance.id, elsewhere->host.view.id};
    elsewhere.reset();
    host.gl->makeCurrent();
    std::mt19937_64 rng(1);
    for (int i = 0; i < 200; ++i) bad.push_back(rng() >> (rng() % 64));

    const struct {
        std::vector<Call> calls;
        uint64_t id;
    } kinds[] = {{calls.ofContext(), host.context.id}, {calls.ofAsset(), host.asset.id}, {calls.ofInstance(), host.instance.id}, {calls.ofView(), host.view.id}};
    const uint64_t live = scene.live();
    for (size_t k = 0; k < std::size(kinds); ++k) {
        std::vector<uint64_t> wrong = bad;
        for (size_t other = 0; other < std::size(kinds); ++other)
            if (other != k) wrong.push_back(kinds[other].id);
        for (int bit = 0; bit < 64; ++bit) wrong.push_back(kinds[k].id ^ 1ull << bit);
        for (const Call& c : kinds[k].calls) {
            CAPTURE(std::string(c.name));
            for (const uint64_t id : wrong) {
                CAPTURE(id);
                const NacreResult result = c.call(id);
                if (result != NACRE_ERROR_INVALID_ARGUMENT) FAIL_CHECK("result ", result);
            }
        }
    }
    for (const uint64_t id : bad) destroyAll(id), nacreContextDestroy({id});
    CHECK(scene.live() == live);
    REQUIRE(host.gl->beginFrame(16, 16));
    CHECK(largestDifference(host.draw(kCamera), before) == 0.0f);
    for (const auto& kind : kinds)
        for (const Call& c : kind.calls) {
            CAPTURE(std::string(c.name));
            CHECK_MESSAGE(c.call(kind.id) == NACRE_OK, host.lastMessage());
        }
    CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("an instance of another context, a stale one or none among those of a draw is refused by its place")
{
    if (!haveGl()) return;
    Host other(randomAsset(5, 4, 1)), host(randomAsset(5, 4, 1));
    const NacreInstance gone = host.place(host.asset);
    nacreInstanceDestroy(gone);
    host.setLights(kLamp);
    const Image before = host.draw(kCamera);
    for (const uint64_t id : {other.instance.id, gone.id, host.asset.id, host.view.id, uint64_t(0)}) {
        const NacreInstance list[] = {host.instance, {id}};
        const NacreDrawDesc desc = describe(kCamera, list);
        host.messages.clear();
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_INVALID_ARGUMENT);
        REQUIRE(host.messages.size() == 1);
        CHECK_MESSAGE(host.lastMessage().find("1") != std::string::npos, host.lastMessage());
        CHECK(nacreViewPrepare(host.view, &desc, 0) == NACRE_ERROR_INVALID_ARGUMENT);
    }
    NacreDrawDesc desc = describe(kCamera);
    desc.instanceCount = 3;
    CHECK(nacreViewDraw(host.view, &desc) != NACRE_ERROR_GL); // a count without an array: all, or refused, but no crash
    CHECK(largestDifference(host.draw(kCamera), before) == 0.0f);
}

TEST_CASE("with the context everything in it is gone, and its ids stay refused when another context takes its place")
{
    if (!haveGl()) return;
    Calls calls;
    std::vector<std::pair<Call, uint64_t>> all;
    uint64_t context = 0;
    const auto expectRefused = [&] {
        for (const auto& [c, id] : all) {
            CAPTURE(std::string(c.name));
            CHECK(c.call(id) == NACRE_ERROR_INVALID_ARGUMENT);
            destroyAll(id);
        }
        nacreContextDestroy({context});
    };
    {
        Scene scene;
        context = scene.host.context.id;
        const auto add = [&](const std::vector<Call>& some, uint64_t id) {
            for (const Call& c : some) all.emplace_back(c, id);
        };
        add(calls.ofContext(), context), add(calls.ofAsset(), scene.host.asset.id), add(calls.ofInstance(), scene.host.instance.id),
            add(calls.ofView(), scene.host.view.id);
        nacreContextDestroy(scene.host.context);
        expectRefused();
    }
    expectRefused();
    Scene next;
    const uint64_t live = next.live();
    expectRefused();
    CHECK(next.live() == live);
    CHECK(largest(next.host.draw(kCamera)) > 0.0f);
}

TEST_CASE("null pointers are refused with a message, by every function that takes one")
{
    if (!haveGl()) return;
    Host host(randomSss(5, kAllSss, 1));
    NacreInstanceDesc instance = instanceDesc(host.asset);
    const auto bytes = encodeAsset(randomAsset(3, 0, 1));
    const std::pair<const char*, std::function<NacreResult()>> calls[] = {
        {"GetInfo", [&] { return nacreContextGetInfo(host.context, nullptr); }},
        {"AssetCreate, no bytes", [&] { NacreAsset a{}; return nacreAssetCreate(host.context, nullptr, 5, &a); }},
        {"AssetCreate", [&] { return nacreAssetCreate(host.context, bytes->data(), bytes->size(), nullptr); }},
        {"AssetDecode, no bytes", [&] { NacreAsset a{}; return nacreAssetDecode(host.context, nullptr, 5, &a); }},
        {"AssetDecode", [&] { return nacreAssetDecode(host.context, bytes->data(), bytes->size(), nullptr); }},
        {"AssetCreateDetail, no bytes", [&] { NacreAsset a{}; return nacreAssetCreateDetail(host.context, nullptr, 5, nullptr, &a); }},
        {"AssetCreateDetail", [&] { return nacreAssetCreateDetail(host.context, bytes->data(), bytes->size(), nullptr, nullptr); }},
        {"AssetDecodeDetail, no bytes", [&] { NacreAsset a{}; return nacreAssetDecodeDetail(host.context, nullptr, 5, nullptr, &a); }},
        {"AssetDecodeDetail", [&] { return nacreAssetDecodeDetail(host.context, bytes->data(), bytes->size(), nullptr, nullptr); }},
        {"AssetGetInfo", [&] { return nacreAssetGetInfo(host.asset, nullptr); }},
        {"SetTransform", [&] { return nacreInstanceSetTransform(host.instance, nullptr); }},
        {"SetTint", [&] { return nacreInstanceSetTint(host.instance, nullptr); }},
        {"SetEdits", [&] { return nacreInstanceSetEdits(host.instance, nullptr, 1); }},
        {"SetLights", [&] { return nacreContextSetLights(host.context, nullptr, 1); }},
        {"ViewCreate", [&] { return nacreViewCreate(host.context, nullptr, nullptr); }},
        {"Draw", [&] { return nacreViewDraw(host.view, nullptr); }},
        {"GetStats", [&] { return nacreViewGetStats(host.view, nullptr); }},
    };
    for (const auto& [name, call] : calls) {
        CAPTURE(std::string(name));
        host.messages.clear();
        CHECK(call() == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(host.messages.size() == 1);
    }
    NacreInstance made{~0ull};
    CHECK(nacreInstanceCreate(nullptr, &made) == NACRE_ERROR_INVALID_ARGUMENT); // nothing says whose message it were
    CHECK(nacreInstanceCreate(&instance, nullptr) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(made.id == 0);
    CHECK(nacreContextSetEnvironment(host.context, nullptr) == NACRE_OK);
    CHECK(nacreInstanceSetEdits(host.instance, nullptr, 0) == NACRE_OK);
    CHECK(nacreViewPrepare(host.view, nullptr, 3) == NACRE_OK);
}

// ---- absurd numbers -----------------------------------------------------------------------------------------------------------

namespace {

const uint32_t kAbsurd[] = {
    0x7FC00000, 0x7F800000, 0xFF800000, // NaN and infinities
    0x7F7FFFFF, 0xFF7FFFFF,             // the largest floats
    0x00000001, 0x80000001, 0x00800000, // the smallest
    0x58635FA9, 0xD8635FA9,             // 1e15
    0x2EDBE6FF, 0,                      // 1e-10
    0xBF800000, 0x40000000, 0x461C4000, // -1, 2, 1e4
    0xFFFFFFFF, 0x7FFFFFFF, 7,          // as integers
};

/// Overwrites each word of a struct from `first` to `end` with each absurd value and calls; a refusal must come with a message of one line.
template <class Desc, class Function>
void eachWord(Host& host, const Desc& good, size_t first, size_t end, Function call)
{
    int accepted = 0, refused = 0;
    for (size_t at = first; at + 4 <= end; at += 4)
        for (const uint32_t value : kAbsurd) {
            Desc desc = good;
            std::memcpy(reinterpret_cast<char*>(&desc) + at, &value, 4);
            host.messages.clear();
            const NacreResult result = call(desc);
            ++(result == NACRE_OK ? accepted : refused);
            if (result == NACRE_OK) continue;
            CAPTURE(at);
            CAPTURE(value);
            CHECK((result == NACRE_ERROR_INVALID_ARGUMENT || result == NACRE_ERROR_UNSUPPORTED));
            CHECK(host.messages.size() >= 1);
            CHECK_MESSAGE(host.lastMessage().find('\n') == std::string::npos, host.lastMessage());
        }
    CHECK(accepted > 0);
    CHECK(refused > 0);
}

} // namespace

TEST_CASE("absurd numbers in any field are refused with a message or drawn finite, and leave nothing behind")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : {withSharp(randomAsset(8, 4, 1), kAllSharp, 1), randomSss(8, kAllSss, 1)}) {
        CAPTURE(asset.model);
        Host host(asset);
        const Image before = host.draw(kCamera, kLamp);
        const NacreDrawDesc good = describe(kCamera);
        const auto draws = [&](const NacreDrawDesc& desc) {
            REQUIRE(host.gl->beginFrame(16, 16));
            const NacreResult result = nacreViewDraw(host.view, &desc);
            if (!allFinite(host.gl->readFrame())) FAIL_CHECK("not finite");
            return result;
        };

        eachWord(host, good, offsetof(NacreDrawDesc, viewFromWorld), offsetof(NacreDrawDesc, depthTest), [&](const NacreDrawDesc& d) {
            if (d.viewportWidth > 4096 || d.viewportHeight > 4096) return nacreViewPrepare(host.view, &d, 0);
            return draws(d);
        });
        CHECK(largestDifference(host.draw(kCamera), before) < 1e-5f);

        const NacreInstance second = host.place(host.asset);
        NacreInstanceDesc place = instanceDesc(host.asset);
        copy(place.worldFromAsset, glm::dmat4(1));
        eachWord(host, place, offsetof(NacreInstanceDesc, worldFromAsset), offsetof(NacreInstanceDesc, lightMask), [&](const NacreInstanceDesc& d) {
            const NacreResult result = nacreInstanceSetTransform(second, d.worldFromAsset);
            if (result == NACRE_OK) CHECK(draws(good) == NACRE_OK);
            return result;
        });
        NacreDrawDesc tinted = good; // a place for three floats
        eachWord(host, tinted, offsetof(NacreDrawDesc, viewFromWorld), offsetof(NacreDrawDesc, viewFromWorld) + 12, [&](const NacreDrawDesc& d) {
            const NacreResult result = nacreInstanceSetTint(second, d.viewFromWorld);
            if (result == NACRE_OK) CHECK(draws(good) == NACRE_OK);
            return result;
        });
        nacreInstanceDestroy(second);
        CHECK(largestDifference(host.draw(kCamera), before) < 1e-5f); // the layers of deep scenes stay as fine as they were

        for (int type = NACRE_LIGHT_POINT; type <= NACRE_LIGHT_RECTANGLE; ++type) {
            CAPTURE(type);
            NacreLight light = toNacre(pointLight({0.3f, 0.5f, 1}, glm::vec3(1), 0.1f));
            light.type = NacreLightType(type);
            light.direction[2] = -1, light.halfWidth[0] = 0.2f, light.halfHeight = 0.3f, light.innerCone = 0.1f, light.outerCone = 0.7f, light.samples = 4;
            eachWord(host, light, offsetof(NacreLight, type), offsetof(NacreLight, shadowMap), [&](const NacreLight& l) {
                const NacreResult result = nacreContextSetLights(host.context, &l, 1);
                if (result == NACRE_OK) CHECK(draws(good) == NACRE_OK);
                return result;
            });
        }
        host.setLights(kLamp);

        const float sky[12] = {1, 1, 1, 0.5f, 0.5f, 0.5f, 0.25f, 0, 0, 0, 0.1f, 0.2f};
        NacreEnvironment environment{};
        environment.structSize = sizeof environment, environment.sh = sky, environment.shCount = 4, environment.directions = 4;
        eachWord(host, environment, offsetof(NacreEnvironment, worldFromMap), offsetof(NacreEnvironment, mask), [&](const NacreEnvironment& e) {
            const NacreResult result = nacreContextSetEnvironment(host.context, &e);
            if (result == NACRE_OK) CHECK(draws(good) == NACRE_OK);
            return result;
        });
        CHECK(nacreContextSetEnvironment(host.context, nullptr) == NACRE_OK);
        CHECK(largestDifference(host.draw(kCamera), before) < 1e-5f);

        if (asset.model != "sss") continue;
        NacreEdit edit{};
        edit.target = NACRE_EDIT_OPACITY, edit.operation = NACRE_EDIT_MULTIPLY, edit.region = NACRE_REGION_SPHERE, edit.high[0] = 1;
        eachWord(host, edit, 0, sizeof edit, [&](const NacreEdit& e) {
            const NacreResult result = nacreInstanceSetEdits(host.instance, &e, 1);
            if (result == NACRE_OK) CHECK(draws(good) == NACRE_OK);
            return result;
        });
        CHECK(nacreInstanceSetEdits(host.instance, nullptr, 0) == NACRE_OK);
        CHECK(largestDifference(host.draw(kCamera), before) < 1e-5f);
    }
}

TEST_CASE("absurd shadow maps are refused with a message or drawn finite, and without them it is as before")
{
    if (!haveGl()) return;
    Host host(randomAsset(8, 4, 1));
    const Image before = host.draw(kCamera, kLamp);
    const GLenum targets[] = {GL_TEXTURE_2D, GL_TEXTURE_2D_ARRAY, GL_TEXTURE_CUBE_MAP}; // by NacreShadowMapKind
    GLuint textures[3];
    glGenTextures(3, textures);
    for (int kind = 0; kind < 3; ++kind) {
        glBindTexture(targets[kind], textures[kind]);
        if (kind == NACRE_SHADOW_MAP_ARRAY) glTexImage3D(targets[kind], 0, GL_DEPTH_COMPONENT32F, 8, 8, 2, 0, GL_DEPTH_COMPONENT, GL_FLOAT, nullptr);
        for (GLenum face = 0; face < 6 && kind == NACRE_SHADOW_MAP_CUBE; ++face)
            glTexImage2D(GL_TEXTURE_CUBE_MAP_POSITIVE_X + face, 0, GL_DEPTH_COMPONENT32F, 8, 8, 0, GL_DEPTH_COMPONENT, GL_FLOAT, nullptr);
        if (kind == NACRE_SHADOW_MAP_2D) glTexImage2D(targets[kind], 0, GL_DEPTH_COMPONENT32F, 8, 8, 0, GL_DEPTH_COMPONENT, GL_FLOAT, nullptr);
        glTexParameteri(targets[kind], GL_TEXTURE_MAX_LEVEL, 0);
    }
    float matrices[8 * 16] = {};
    for (int m = 0; m < 8; ++m)
        for (int k = 0; k < 4; ++k) matrices[16 * m + 5 * k] = 1;

    const NacreDrawDesc desc = describe(kCamera);
    const auto lit = [&](const NacreShadowMap& map) {
        NacreLight light = toNacre(kLamp[0]);
        light.shadowMap = &map;
        NacreResult result = nacreContextSetLights(host.context, &light, 1);
        if (result != NACRE_OK) return result;
        REQUIRE(host.gl->beginFrame(16, 16));
        result = nacreViewDraw(host.view, &desc);
        if (!allFinite(host.gl->readFrame())) FAIL_CHECK("not finite");
        return result;
    };
    for (int kind = 0; kind < 3; ++kind) {
        CAPTURE(kind);
        NacreShadowMap map{};
        map.structSize = sizeof map, map.kind = NacreShadowMapKind(kind), map.texture = textures[kind], map.layers = kind == NACRE_SHADOW_MAP_ARRAY ? 2 : 0;
        map.clipFromWorld = kind == NACRE_SHADOW_MAP_CUBE ? nullptr : matrices;
        map.nearPlane = 0.1f, map.farPlane = 10, map.bias = 0.01f, map.softness = 1;
        CHECK_MESSAGE(lit(map) == NACRE_OK, host.lastMessage());
        eachWord(host, map, offsetof(NacreShadowMap, nearPlane), offsetof(NacreShadowMap, revision), lit);
        if (kind != NACRE_SHADOW_MAP_CUBE)
            for (const uint32_t value : kAbsurd) {
                std::memcpy(&matrices[6], &value, 4);
                host.messages.clear();
                if (lit(map) != NACRE_OK) CHECK(host.messages.size() == 1);
            }
        matrices[6] = 0;
        for (const uint32_t name : {0u, 0x7FFFFFFFu, textures[(kind + 1) % 3]}) { // none, one that is not there, one of another kind
            CAPTURE(name);
            NacreShadowMap other = map;
            other.texture = name;
            host.messages.clear();
            if (lit(other) != NACRE_OK) CHECK(host.messages.size() == 1);
            CHECK(glGetError() == GL_NO_ERROR);
        }
    }
    host.setLights(kLamp);
    CHECK(largestDifference(host.draw(kCamera), before) < 1e-6f);
    CHECK(glGetError() == GL_NO_ERROR);
    glDeleteTextures(3, textures);
}

TEST_CASE("absurd counts and sizes are refused with a message or do no harm")
{
    if (!haveGl()) return;
    Host host(randomSss(8, kAllSss, 1));
    const Image before = host.draw(kCamera, kLamp);
    NacreLight light = toNacre(kLamp[0]);
    const float pixel[3] = {1, 1, 1};
    const auto environment = [&](int width, int height, uint32_t shCount, uint32_t directions) {
        NacreEnvironment e{};
        e.structSize = sizeof e, e.width = width, e.height = height, e.shCount = shCount, e.directions = directions;
        (shCount ? e.sh : e.pixels) = pixel;
        return e;
    };
    const std::pair<const char*, std::function<NacreResult()>> refused[] = {
        {"an asset of no bytes", [&] { NacreAsset a{}; return nacreAssetCreate(host.context, pixel, 0, &a); }},
        {"size of a light", [&] { light.structSize = 4; return nacreContextSetLights(host.context, &light, 1); }},
        {"size of a light, larger", [&] { light.structSize = sizeof light + 8; return nacreContextSetLights(host.context, &light, 1); }},
        {"a map of no pixels", [&] { auto e = environment(0, 0, 0, 0); return nacreContextSetEnvironment(host.context, &e); }},
        {"a map of a negative width", [&] { auto e = environment(-1, 1, 0, 0); return nacreContextSetEnvironment(host.context, &e); }},
        {"a huge map", [&] { auto e = environment(1 << 30, 1 << 30, 0, 0); return nacreContextSetEnvironment(host.context, &e); }},
        {"five functions", [&] { auto e = environment(0, 0, 5, 0); return nacreContextSetEnvironment(host.context, &e); }},
        {"many directions", [&] { auto e = environment(1, 1, 0, 1 << 30); return nacreContextSetEnvironment(host.context, &e); }},
        {"neither", [&] { auto e = environment(1, 1, 0, 0); e.pixels = nullptr; return nacreContextSetEnvironment(host.context, &e); }},
        {"size of the environment", [&] { auto e = environment(1, 1, 0, 0); e.structSize = 3; return nacreContextSetEnvironment(host.context, &e); }},
        {"edits", [&] { const std::vector<NacreEdit> many(NACRE_MAX_EDITS + 1); return nacreInstanceSetEdits(host.instance, many.data(), many.size()); }},
        {"size of a view", [&] { NacreViewDesc d{}; d.structSize = 1; NacreView v{}; return nacreViewCreate(host.context, &d, &v); }},
        {"size of the stats", [&] { NacreDrawStats s{}; s.structSize = sizeof s + 8; return nacreViewGetStats(host.view, &s); }},
        {"size of infos", [&] { NacreContextInfo i{}; return nacreContextGetInfo(host.context, &i); }},
    };
    for (const auto& [name, call] : refused) {
        CAPTURE(std::string(name));
        host.messages.clear();
        REQUIRE(host.gl->beginFrame(16, 16));
        const NacreResult result = call();
        CHECK(result != NACRE_OK);
        CHECK(result != NACRE_ERROR_GL);
        CHECK(host.messages.size() == 1);
    }
    NacreDrawDesc wide = describe(kCamera); // than the host's viewport, which is what pixels are made for
    wide.viewportWidth = wide.viewportHeight = 1 << 28;
    REQUIRE(host.gl->beginFrame(16, 16));
    CHECK(nacreViewDraw(host.view, &wide) == NACRE_OK);
    CHECK(allFinite(host.gl->readFrame()));
    CHECK(nacreAssetUploadStep(host.asset, ~0ull, nullptr) == NACRE_OK);
    CHECK(nacreAssetUploadStep(host.asset, 0, nullptr) == NACRE_OK);
    CHECK(largestDifference(host.draw(kCamera), before) == 0.0f);
    CHECK(glGetError() == GL_NO_ERROR);
}
