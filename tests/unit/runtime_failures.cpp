// A GL or a heap that runs out of memory, and framebuffers that cannot be drawn to: an error with a message, nothing lost, nothing
// left behind, and the next try works.
#include "runtime_fixture.h"

#include "own_heap.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include <utility>

using namespace nacre;
using namespace nacre::test;

static Camera front() { return lookAt({0, 0, 2}, {0, 0, 0}, 33, 33, 40); }
static const std::vector<Light> kLamp = {pointLight({1, 1, 2}, glm::vec3(3))};

// ---- a full heap --------------------------------------------------------------------------------------------------------------

TEST_CASE("a heap too small for the asset gives OUT_OF_MEMORY and no asset")
{
    if (!haveGl()) return;
    Host host;
    const auto bytes = encodeAsset(randomAsset(500, 25, 1));
    REQUIRE(bytes);
    for (size_t most = bytes->size(); most >= bytes->size() / 8; most /= 2) { // smaller would fail the driver, too
        CAPTURE(most);
        NacreAsset asset{};
        largestAllocation = most;
        const NacreResult result = nacreAssetCreate(host.context, bytes->data(), bytes->size(), &asset);
        largestAllocation = ~size_t(0);
        if (result == NACRE_OK) nacreAssetDestroy(std::exchange(asset, {}));
        else CHECK_MESSAGE(result == NACRE_ERROR_OUT_OF_MEMORY, host.lastMessage());
        if (most < bytes->size() / 2) CHECK(result != NACRE_OK); // the s alone takes more
        CHECK(asset.id == 0);
    }
    NacreAsset asset{};
    CHECK(nacreAssetCreate(host.context, bytes->data(), bytes->size(), &asset) == NACRE_OK);
    nacreAssetDestroy(asset);
}

// ---- a full GPU ---------------------------------------------------------------------------------------------------------------

/// While set, this allocation does nothing and raises GL_OUT_OF_MEMORY; lateTextures: it leaves what looks complete.
static bool noTextures = false, noBuffers = false, lateTextures = false;
static bool raised = false;

static void* scarceGl(const char* name, void* user)
{
    static constexpr auto kTexImage2D = [](GLenum target, GLint level, GLint format, GLsizei width, GLsizei height, GLint border,
                                           GLenum layout, GLenum type, const void* pixels) {
        if (noTextures || lateTextures) raised = true;
        if (!noTextures) glTexImage2D(target, level, format, width, height, border, layout, type, pixels);
    };
    static constexpr auto kTexImage3D = [](GLenum target, GLint level, GLint format, GLsizei width, GLsizei height, GLsizei depth, GLint border,
                                           GLenum layout, GLenum type, const void* pixels) {
        if (noTextures || lateTextures) raised = true;
        if (!noTextures) glTexImage3D(target, level, format, width, height, depth, border, layout, type, pixels);
    };
    static constexpr auto kBufferData = [](GLenum target, GLsizeiptr size, const void* data, GLenum usage) {
        if (noBuffers) raised = true;
        else glBufferData(target, size, data, usage);
    };
    static constexpr auto kGetError = []() -> GLenum {
        if (std::exchange(raised, false)) return GL_OUT_OF_MEMORY; // what came of it is later
        return glGetError();
    };
    const std::string wanted = name;
    if (wanted == "glTexImage2D") return reinterpret_cast<void*>(+kTexImage2D);
    if (wanted == "glTexImage3D") return reinterpret_cast<void*>(+kTexImage3D);
    if (wanted == "glBufferData") return reinterpret_cast<void*>(+kBufferData);
    if (wanted == "glGetError") return reinterpret_cast<void*>(+kGetError);
    return HeadlessGl::getProcAddress(name, user);
}

static uint64_t gpuBytes(const Host& host) { return host.contextInfo().gpuBytes; }

TEST_CASE("no GPU memory for the textures or indices of an asset: OUT_OF_MEMORY, others still draw, a later try works")
{
    if (!haveGl()) return;
    const SplatAsset small = randomAsset(10, 4, 1), large = withSharp(randomAsset(200, 4, 2), kAllSharp, 2);
    Host host(small, scarceGl);
    const Image smallImage = host.draw(front(), kLamp);
    const auto bytes = encodeAsset(large);
    REQUIRE(bytes);
    for (bool* lack : {&noTextures, &noBuffers}) {
        NacreAsset asset{};
        *lack = true;
        CHECK(nacreAssetCreate(host.context, bytes->data(), bytes->size(), &asset) == NACRE_ERROR_OUT_OF_MEMORY);
        *lack = false;
        CHECK(asset.id == 0);
        CHECK_FALSE(raised);
        CHECK(glGetError() == GL_NO_ERROR);
        CHECK(largestDifference(host.draw(front()), smallImage) == 0.0f);
    }
    host.load(large);
    Host fresh(large);
    CHECK(largestDifference(host.draw(front(), kLamp), fresh.draw(front(), kLamp)) == 0.0f);
}

TEST_CASE("no GPU memory for more lights or a viewport: OUT_OF_MEMORY, no error left, bytes counted right, a later draw works")
{
    if (!haveGl()) return;
    const std::vector<Light> many(40, kLamp[0]);
    const NacreDrawDesc desc = describe(front());
    for (const SplatAsset& asset : {withSharp(randomAsset(50, 4, 1), kAllSharp, 1), randomSss(50, kAllSss, 1)}) {
        CAPTURE(asset.model);
        Host fresh(asset);
        const Image expected = fresh.draw(front(), many);
        for (bool* lack : {&noTextures, &lateTextures}) {
            Host host(asset, scarceGl);
            host.draw(front());
            const uint64_t unlit = gpuBytes(host);
            host.setLights(many);
            REQUIRE(host.gl->beginFrame(33, 33));
            *lack = true;
            CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_OUT_OF_MEMORY);
            *lack = false;
            CHECK_MESSAGE(host.lastMessage().find("40 lights") != std::string::npos, host.lastMessage());
            CHECK_FALSE(raised);
            CHECK(glGetError() == GL_NO_ERROR);
            CHECK(gpuBytes(host) <= unlit + 48 * 4 * 16); // the columns of the lights fit
            CHECK(largestDifference(host.draw(front()), expected) == 0.0f);
            CHECK(gpuBytes(host) == gpuBytes(fresh));
            if (asset.model != "sss") continue;
            NacreDrawDesc smaller = desc; // other layers
            smaller.viewportWidth = smaller.viewportHeight = 21;
            glViewport(0, 0, 21, 21);
            *lack = true;
            CHECK(nacreViewDraw(host.view, &smaller) == NACRE_ERROR_OUT_OF_MEMORY);
            *lack = false;
            CHECK_MESSAGE(host.lastMessage().find("pixels") != std::string::npos, host.lastMessage());
            CHECK(glGetError() == GL_NO_ERROR);
            CHECK(largestDifference(host.draw(front()), expected) == 0.0f);
            CHECK(gpuBytes(host) == gpuBytes(fresh));
        }
    }
}

TEST_CASE("an asset that is destroyed with its instance leaves no texture or framebuffer behind, whatever its channels")
{
    if (!haveGl()) return;
    Host host;
    const auto objects = [] { // but programs, which the context keeps
        int count = 0;
        for (GLuint name = 1; name < 400; ++name) count += glIsTexture(name) + glIsFramebuffer(name);
        return count;
    };
    REQUIRE(host.gl->beginFrame(33, 33)); // makes the host's own
    const int before = objects();
    for (const int which : {0, int(kAllSharp), -1}) {
        CAPTURE(which);
        host.load(which < 0 ? randomSss(30, kAllSss, 1) : withSharp(randomAsset(30, which ? 4 : 0, 1), which, 1));
        host.draw(front(), kLamp);
        host.draw(front(), std::vector<Light>(9, kLamp[0])); // larger light targets replace the first
        CHECK(objects() > before + 10);
        host.unload();
        nacreViewDestroy(host.view); // its lists and targets stay for the next instances
        CHECK(objects() == before);
        CHECK(gpuBytes(host) == 0);
        host.view = host.addView();
    }
}

// ---- a small GPU --------------------------------------------------------------------------------------------------------------

static GLint smallSize = 0, smallLayers = 0; // what the GL below says its limits are
static void* smallGl(const char* name, void* user)
{
    static constexpr auto kGetIntegerv = [](GLenum what, GLint* value) {
        glGetIntegerv(what, value);
        if (what == GL_MAX_TEXTURE_SIZE) *value = smallSize;
        if (what == GL_MAX_ARRAY_TEXTURE_LAYERS) *value = smallLayers;
    };
    if (std::strcmp(name, "glGetIntegerv") == 0) return reinterpret_cast<void*>(+kGetIntegerv);
    return HeadlessGl::getProcAddress(name, user);
}

TEST_CASE("maps and s that wrap over rows and layers draw the same image; where there are too few layers the asset is refused")
{
    if (!haveGl()) return;
    const SplatAsset asset = withSharp(randomAsset(500, 16, 1), kAllSharp, 1); // 128000 texels of maps, 68000 of s
    Host wide(asset);
    smallSize = 256, smallLayers = 2; // layers of 65536 texels
    {
        Host narrow(asset, smallGl);
        CHECK(largestDifference(narrow.draw(front(), kLamp), wide.draw(front(), kLamp)) == 0.0f);
    }
    smallLayers = 1;
    Host narrow(smallGl);
    const auto bytes = encodeAsset(asset);
    REQUIRE(bytes);
    NacreAsset refused{};
    CHECK(nacreAssetCreate(narrow.context, bytes->data(), bytes->size(), &refused) == NACRE_ERROR_UNSUPPORTED);
    CHECK_MESSAGE(narrow.lastMessage().find("of 500 splats needs") != std::string::npos,
                  narrow.lastMessage());
}

TEST_CASE("layers of maps are no larger than they must be")
{
    if (!haveGl()) return;
    smallSize = 1024, smallLayers = 256;
    Host host(randomSss(1100, kSssMaps, 1), smallGl); // 1126400 bytes of maps, a little more than one layer of 1024 x 1024
    CHECK(gpuBytes(host) < 1126400 + 65536 + 1100 * 170 + 10000); // the last layer whole; slots; lights
}

TEST_CASE("many splats on a small GPU take any number of lights")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : {randomAsset(2000, 4, 1), randomSss(2000, 0, 1)}) {
        CAPTURE(asset.model);
        Host wide(asset);
        smallSize = 256, smallLayers = 256; // 2000 splats are 8 rows of 256, so a texture has 32 slots of four lights
        Host narrow(asset, smallGl);
        for (const size_t count : {128, 129, 200})
            CHECK(largestDifference(narrow.draw(front(), std::vector<Light>(count, kLamp[0])), wide.draw(front(), std::vector<Light>(count, kLamp[0]))) <
                  1e-4f * float(count)); // sums in another grouping
    }
}

TEST_CASE("more lights on an instance than the GPU holds are refused by number, and those set afterwards show what they should")
{
    if (!haveGl()) return;
    smallSize = 256, smallLayers = 256;
    for (const SplatAsset& asset : {randomAsset(60, 4, 1), randomSss(60, kAllSss, 1)}) {
        CAPTURE(asset.model);
        Host host(asset, smallGl), fresh(asset);
        host.draw(front(), kLamp);
        std::vector<Light> many;
        for (int i = 0; i < 300; ++i) many.push_back(pointLight({std::cos(float(i)), 1, 2}, glm::vec3(0.01f)));
        host.setLights(many);
        const NacreDrawDesc desc = describe(front());
        REQUIRE(host.gl->beginFrame(33, 33));
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_UNSUPPORTED);
        CHECK_MESSAGE(host.lastMessage().find("300 lights") != std::string::npos, host.lastMessage());
        const std::vector<Light> few(many.begin(), many.begin() + 3); // of those that were refused
        CHECK(largestDifference(host.draw(front(), few), fresh.draw(front(), few)) == 0.0f);
    }
}

// ---- the host's frame ---------------------------------------------------------------------------------------------------------

TEST_CASE("an incomplete framebuffer gives ERROR_GL with its name and leaves no GL error")
{
    if (!haveGl()) return;
    Host host(oneSplat(0));
    GLuint empty = 0;
    glGenFramebuffers(1, &empty);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, empty);
    const NacreDrawDesc desc = describe(front());
    CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_GL);
    CHECK_MESSAGE(host.lastMessage().find("framebuffer " + std::to_string(empty) + " is incomplete (status 0x8CD7)") != std::string::npos,
                  host.lastMessage());
    CHECK(glGetError() == GL_NO_ERROR);
    glDeleteFramebuffers(1, &empty);
    CHECK(largest(host.draw(front(), kLamp)) > 0.0f);
}

TEST_CASE("a target that holds integers gives ERROR_GL and keeps its pixels")
{
    if (!haveGl()) return;
    Host host(oneSplat(0));
    host.setLights(kLamp);
    GLuint texture = 0, framebuffer = 0;
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA16UI, 33, 33, 0, GL_RGBA_INTEGER, GL_UNSIGNED_SHORT, nullptr);
    glGenFramebuffers(1, &framebuffer);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture, 0);
    const GLuint seven[4] = {7, 7, 7, 7};
    glClearBufferuiv(GL_COLOR, 0, seven);
    glViewport(0, 0, 33, 33);
    const NacreDrawDesc desc = describe(front());
    CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_GL);
    CHECK_MESSAGE(host.lastMessage().find("holds integers") != std::string::npos, host.lastMessage());
    CHECK(glGetError() == GL_NO_ERROR);
    std::vector<GLuint> pixels(33 * 33 * 4);
    glReadPixels(0, 0, 33, 33, GL_RGBA_INTEGER, GL_UNSIGNED_INT, pixels.data());
    CHECK(std::all_of(pixels.begin(), pixels.end(), [](GLuint p) { return p == 7; }));
    glDeleteFramebuffers(1, &framebuffer);
    glDeleteTextures(1, &texture);
}

TEST_CASE("a GL error of the host stays pending through a draw")
{
    if (!haveGl()) return;
    Host host(oneSplat(0));
    host.setLights(kLamp);
    REQUIRE(host.gl->beginFrame(33, 33));
    const NacreDrawDesc desc = describe(front());
    CHECK(nacreViewDraw(host.view, &desc) == NACRE_OK); // makes its textures
    glEnable(GL_TEXTURE_BUFFER_BINDING); // no such capability
    CHECK(nacreViewDraw(host.view, &desc) == NACRE_OK);
    CHECK(host.messages.empty());
    CHECK(glGetError() == GL_INVALID_ENUM);
}

TEST_CASE("a GL error that was pending when memory is asked for is not taken for ours")
{
    if (!haveGl()) return;
    Host host(oneSplat(0));
    host.setLights(kLamp);
    REQUIRE(host.gl->beginFrame(33, 33));
    const NacreDrawDesc desc = describe(front());
    glEnable(GL_TEXTURE_BUFFER_BINDING);
    CHECK(nacreViewDraw(host.view, &desc) == NACRE_OK);
    CHECK_MESSAGE(host.lastMessage().find("pending GL error") != std::string::npos, host.lastMessage());
    CHECK(glGetError() == GL_NO_ERROR);
}
