// The contract of nacre.h: what is re-evaluated when, which state survives, what bad input does.
#include "runtime_fixture.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include <map>

using namespace nacre;
using namespace nacre::test;

static Camera front(double distance = 2) { return lookAt({0, 0, distance}, {0, 0, 0}, 33, 33, 40); }
static const std::vector<Light> kLamp = {pointLight({1, 1, 2}, glm::vec3(3))};

// ---- re-evaluation ------------------------------------------------------------------------------------------------------------

struct Passes {
    uint32_t light, view, combine, projected, sorted;
    bool operator==(const Passes&) const = default;
};

static Passes passes(const Host& host)
{
    const NacreDrawStats s = host.stats();
    return {s.lightPassesRun, s.viewPassesRun, s.combinePassesRun, s.projected, s.sorted};
}

TEST_CASE("each pass runs only when its inputs changed")
{
    if (!haveGl()) return;
    Host host(randomAsset(20, 4, 1));
    host.draw(front(), kLamp);
    CHECK(passes(host) == Passes{1, 1, 1, 1, 1});
    CHECK(host.stats().splatsDrawn == 20);
    CHECK(host.stats().instancesDrawn == 1);
    host.draw(front());
    CHECK(passes(host) == Passes{0, 0, 0, 0, 0});
    host.draw(front(), kLamp); // the same lights again
    CHECK(passes(host) == Passes{0, 0, 0, 0, 0});
    host.draw(front(), {{directionalLight({0, 1, 0}, glm::vec3(1))}});
    CHECK(passes(host) == Passes{1, 0, 1, 0, 0});
    host.draw(front(2.5));
    CHECK(passes(host) == Passes{0, 1, 1, 1, 1});
    Camera rolled = front(2.5); // on its side, same place: neither light nor order, which goes by distance, are others
    rolled.worldFromCamera[0] = {0, 1, 0, 0}, rolled.worldFromCamera[1] = {-1, 0, 0, 0};
    host.draw(rolled);
    CHECK(passes(host) == Passes{0, 0, 0, 1, 0});
    Camera jittered = rolled;
    jittered.cx += 0.3;
    host.draw(jittered);
    CHECK(passes(host) == Passes{0, 0, 0, 1, 0});
    host.setLights(kLamp);
    host.moveTo(glm::translate(glm::dmat4(1.0), glm::dvec3(0.1, 0, 0)));
    host.draw(front()); // the instance moves under a point light
    CHECK(passes(host) == Passes{1, 1, 1, 1, 1});
    host.moveTo(glm::translate(glm::dmat4(1.0), glm::dvec3(0.1, 0, 0))); // to where it is
    host.draw(front());
    CHECK(passes(host) == Passes{0, 0, 0, 0, 0});
}

TEST_CASE("an asset without s never runs the view pass")
{
    if (!haveGl()) return;
    Host host(randomAsset(20, 0, 1));
    host.draw(front(), kLamp);
    CHECK(passes(host) == Passes{1, 0, 1, 1, 1});
    host.draw(front(3));
    CHECK(passes(host) == Passes{0, 0, 0, 1, 1});
}

TEST_CASE("a highlight follows the camera, with or without s, and the light pass does not run for it")
{
    if (!haveGl()) return;
    for (const uint32_t functions : {0u, 4u}) {
        const SplatAsset asset = withSharp(randomAsset(60, int(functions), 1), kAllSharp, 1, 30);
        Host host(asset), fresh(asset);
        host.draw(front(), kLamp);
        CHECK(passes(host) == Passes{1, functions > 0, 1, 1, 1});
        const Camera moved = lookAt({1.2, 0.8, 1.2}, {0, 0, 0}, 33, 33, 40);
        const Image image = host.draw(moved);
        CHECK(passes(host) == Passes{0, functions > 0, 1, 1, 1});
        CHECK(largestDifference(image, fresh.draw(moved, kLamp)) == 0.0f);
        CHECK(psnr(image, referenceImage(asset, moved, kLamp)) > 80.0);
        host.draw(moved);
        CHECK(passes(host) == Passes{0, 0, 0, 0, 0});
    }
}

TEST_CASE("hard shadows alone do not depend on the camera")
{
    if (!haveGl()) return;
    Host host(withSharp(randomAsset(20, 0, 1), kVisibility | kShadow, 1));
    host.draw(front(), kLamp);
    host.draw(front(3));
    CHECK(passes(host) == Passes{0, 0, 0, 1, 1});
}

TEST_CASE("cached results draw the same image as fresh ones")
{
    if (!haveGl()) return;
    for (const int which : {0, int(kAllSharp)}) {
        const SplatAsset asset = withSharp(randomAsset(100, 9, 2), which, 2);
        Host used(asset), fresh(asset);
        used.draw(front(3), {{directionalLight({0, 1, 0}, glm::vec3(1))}});
        used.draw(front(), {{kLamp[0], kLamp[0], kLamp[0], kLamp[0], kLamp[0], kLamp[0]}});
        CHECK(largestDifference(used.draw(front(), kLamp), fresh.draw(front(), kLamp)) == 0.0f);
    }
}

TEST_CASE("splats outside the frame are culled, those that reach into it are not")
{
    if (!haveGl()) return;
    SplatAsset asset = randomAsset(3, 0, 1);
    asset.cloud.positions = {{0, 0, 0}, {10, 0, 0}, {1.2f, 0, 0}}; // the frame is 1.65 wide there
    asset.cloud.scales = {glm::vec3(0.01f), glm::vec3(0.01f), glm::vec3(0.3f)};
    Host host(asset);
    const Image image = host.draw(front(), kLamp);
    CHECK(host.stats().splatsDrawn == 2);
    CHECK(largestDifference(image, referenceImage(asset, front(), kLamp)) < 1e-5f);
}

TEST_CASE("profiling reports true times")
{
    if (!haveGl()) return;
    Host host(randomAsset(500, 25, 1));
    nacreContextSetProfiling(host.context, 1);
    host.draw(front(), kLamp);
    CHECK(host.stats().relightSeconds > 0);
    CHECK(host.stats().rasterSeconds > 0);
    CHECK(host.stats().relightSeconds < 60);
}

// ---- the host's frame ---------------------------------------------------------------------------------------------------------

TEST_CASE("splats are blended over what the host has drawn, and hidden by its depth")
{
    if (!haveGl()) return;
    SplatAsset sss = randomSss(1, kAllSss, 7);
    sss.cloud.positions[0] = glm::vec3(0), sss.cloud.scales[0] = glm::vec3(0.5f), sss.cloud.opacities[0] = 0.9f;
    for (const SplatAsset& asset : {oneSplat(0, glm::vec3(0.5f), 0.9f), sss}) {
        CAPTURE(asset.model);
        const float tolerance = asset.model == "sss" ? 1e-3f : 1e-5f; // half floats of the G-buffer
        Host host(asset);
        host.setLights(kLamp);
        const Image alone = host.draw(front());
        const auto over = [&](float depth, int depthTest) {
            REQUIRE(host.gl->beginFrame(33, 33));
            glClearColor(0.25f, 0.5f, 1.0f, 1.0f);
            glClearDepth(depth);
            glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
            glEnable(GL_DEPTH_TEST);
            NacreDrawDesc desc = describe(front());
            desc.depthTest = depthTest;
            REQUIRE(nacreViewDraw(host.view, &desc) == NACRE_OK);
            glDisable(GL_DEPTH_TEST);
            return host.gl->readFrame();
        };
        const float* before = alone.pixel(16, 16);
        const float background[4] = {0.25f, 0.5f, 1.0f, 1.0f};
        const double centreDepth = 0.5 + 0.5 * (1 - 2 * 0.01 / 2); // z/w at distance 2 with near 0.01
        for (const Image& image : {over(1.0f, 1), over(float(centreDepth + 1e-4), 1), over(0.0f, 0)})
            for (int c = 0; c < 4; ++c)
                CHECK(image.pixel(16, 16)[c] == doctest::Approx(before[c] + (1 - before[3]) * background[c]).epsilon(tolerance));
        const Image hidden = over(float(centreDepth - 1e-4), 1);
        for (int c = 0; c < 4; ++c) CHECK(hidden.pixel(16, 16)[c] == background[c]);
    }
}

TEST_CASE("viewport and scissor of the host apply")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : {oneSplat(0, glm::vec3(0.5f)), randomSss(30, kAllSss, 3)}) {
        CAPTURE(asset.model);
        const float tolerance = asset.model == "sss" ? 1e-3f : 1e-5f; // half floats of the G-buffer
        Host host(asset);
        host.setLights(kLamp);
        const Image alone = host.draw(front());
        REQUIRE(host.gl->beginFrame(80, 80));
        glViewport(40, 20, 33, 33);
        glEnable(GL_SCISSOR_TEST);
        glScissor(40, 20, 33, 17);
        const NacreDrawDesc desc = describe(front());
        REQUIRE(nacreViewDraw(host.view, &desc) == NACRE_OK);
        glDisable(GL_SCISSOR_TEST);
        const Image image = host.gl->readFrame();
        for (int y = 0; y < 80; ++y)
            for (int x = 0; x < 80; ++x) {
                const int ax = x - 40, ay = 32 - (79 - y - 20); // window y 20 is the bottom row of the small image
                const bool inside = ax >= 0 && ax < 33 && ay < 33 && ay >= 16;
                // pixel positions are 40 larger, so f32 interpolation rounds differently
                for (int c = 0; c < 4; ++c) REQUIRE(std::abs(image.pixel(x, y)[c] - (inside ? alone.pixel(ax, ay)[c] : 0.0f)) < tolerance * (1 + 5 * alone.pixel(16, 16)[c]));
            }
    }
}

TEST_CASE("a half-float target stays free of infinities")
{
    if (!haveGl()) return;
    Host host(randomAsset(50, 0, 3));
    host.setLights({{pointLight({0, 0, 1}, glm::vec3(1e9f))}});
    GLuint framebuffer = 0, texture = 0;
    glGenFramebuffers(1, &framebuffer);
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA16F, 33, 33, 0, GL_RGBA, GL_FLOAT, nullptr);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture, 0);
    REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
    glViewport(0, 0, 33, 33);
    glClear(GL_COLOR_BUFFER_BIT);
    const NacreDrawDesc desc = describe(front());
    REQUIRE(nacreViewDraw(host.view, &desc) == NACRE_OK);
    Image image{33, 33, std::vector<float>(4 * 33 * 33)};
    glReadPixels(0, 0, 33, 33, GL_RGBA, GL_FLOAT, image.rgba.data());
    CHECK(allFinite(image));
    CHECK(largest(image) > 1e4f);
    glDeleteFramebuffers(1, &framebuffer);
    glDeleteTextures(1, &texture);
}

/// A framebuffer with two RGBA32F colour attachments of 33 x 33, both drawn to, both cleared to 0.5. Bound; deleted at scope exit.
struct TwoTargets {
    GLuint framebuffer = 0, textures[2] = {};
    TwoTargets()
    {
        glGenFramebuffers(1, &framebuffer);
        glGenTextures(2, textures);
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
        const GLenum both[] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
        for (int i = 0; i < 2; ++i) {
            glBindTexture(GL_TEXTURE_2D, textures[i]);
            glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, 33, 33, 0, GL_RGBA, GL_FLOAT, nullptr);
            glFramebufferTexture2D(GL_FRAMEBUFFER, both[i], GL_TEXTURE_2D, textures[i], 0);
        }
        glDrawBuffers(2, both);
        REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
        glViewport(0, 0, 33, 33);
        glClearColor(0.5f, 0.5f, 0.5f, 0.5f);
        glClear(GL_COLOR_BUFFER_BIT);
    }
    ~TwoTargets()
    {
        glDeleteFramebuffers(1, &framebuffer);
        glDeleteTextures(2, textures);
    }
    Image read(int i) const
    {
        Image image{33, 33, std::vector<float>(4 * 33 * 33)};
        glReadBuffer(GL_COLOR_ATTACHMENT0 + GLenum(i));
        glReadPixels(0, 0, 33, 33, GL_RGBA, GL_FLOAT, image.rgba.data());
        return image;
    }
};

/// How many channels of draw buffer 1 the last DrawElements could write: what an unwritten output holds is up to the driver.
static int writableOfSecond = -1;
static void* watchDrawElements(const char* name, void* user)
{
    static constexpr auto kDraw = [](GLenum mode, GLsizei count, GLenum type, const void* indices) {
        GLboolean mask[4];
        glGetBooleani_v(GL_COLOR_WRITEMASK, 1, mask);
        writableOfSecond = int(std::count(mask, mask + 4, GL_TRUE));
        glDrawElements(mode, count, type, indices);
    };
    if (std::strcmp(name, "glDrawElements") == 0) return reinterpret_cast<void*>(+kDraw);
    return HeadlessGl::getProcAddress(name, user);
}

TEST_CASE("of several render targets only the first is drawn to, through the host's colour mask")
{
    if (!haveGl()) return;
    Host host(oneSplat(0, glm::vec3(0.5f)), watchDrawElements);
    host.setLights(kLamp);
    const TwoTargets targets;
    const Image untouched = targets.read(1);
    REQUIRE(untouched.pixel(16, 16)[0] == 0.5f);
    const NacreDrawDesc desc = describe(front());
    glColorMaski(0, GL_TRUE, GL_FALSE, GL_TRUE, GL_TRUE);
    REQUIRE(nacreViewDraw(host.view, &desc) == NACRE_OK);
    CHECK(targets.read(0).pixel(16, 16)[0] != 0.5f);
    CHECK(targets.read(0).pixel(16, 16)[1] == 0.5f);
    CHECK(largestDifference(targets.read(1), untouched) == 0.0f);
    CHECK(writableOfSecond == 0);
    GLboolean second[4];
    glGetBooleani_v(GL_COLOR_WRITEMASK, 1, second);
    CHECK(std::count(second, second + 4, GL_TRUE) == 4);
}

// ---- GL state -----------------------------------------------------------------------------------------------------------------

/// Every value of GL state a host could notice, by name.
static std::map<std::string, std::vector<double>> snapshot()
{
    std::map<std::string, std::vector<double>> state;
    const auto integers = [&](const char* name, GLenum what, int count) {
        GLint v[16] = {};
        glGetIntegerv(what, v);
        state[name].assign(v, v + count);
    };
    const auto floats = [&](const char* name, GLenum what, int count) {
        GLfloat v[16] = {};
        glGetFloatv(what, v);
        state[name].assign(v, v + count);
    };
    const auto enabled = [&](const char* name, GLenum what) { state[name] = {double(glIsEnabled(what))}; };
#define I(what, n) integers(#what, what, n)
    I(GL_DRAW_FRAMEBUFFER_BINDING, 1); I(GL_READ_FRAMEBUFFER_BINDING, 1); I(GL_RENDERBUFFER_BINDING, 1); I(GL_VERTEX_ARRAY_BINDING, 1);
    I(GL_ARRAY_BUFFER_BINDING, 1); I(GL_ELEMENT_ARRAY_BUFFER_BINDING, 1); I(GL_UNIFORM_BUFFER_BINDING, 1);
    I(GL_PIXEL_UNPACK_BUFFER_BINDING, 1); I(GL_PIXEL_PACK_BUFFER_BINDING, 1); I(GL_CURRENT_PROGRAM, 1); I(GL_ACTIVE_TEXTURE, 1);
    I(GL_UNPACK_SWAP_BYTES, 1); I(GL_UNPACK_LSB_FIRST, 1); I(GL_UNPACK_ROW_LENGTH, 1); I(GL_UNPACK_SKIP_ROWS, 1);
    I(GL_UNPACK_SKIP_PIXELS, 1); I(GL_UNPACK_SKIP_IMAGES, 1); I(GL_UNPACK_IMAGE_HEIGHT, 1); I(GL_UNPACK_ALIGNMENT, 1);
    I(GL_PACK_ALIGNMENT, 1); I(GL_PACK_ROW_LENGTH, 1); I(GL_DRAW_BUFFER0, 1); I(GL_DRAW_BUFFER1, 1); I(GL_READ_BUFFER, 1);
    I(GL_DEPTH_FUNC, 1); I(GL_DEPTH_WRITEMASK, 1); I(GL_CULL_FACE_MODE, 1); I(GL_FRONT_FACE, 1); I(GL_POLYGON_MODE, 1);
    I(GL_STENCIL_FUNC, 1); I(GL_STENCIL_REF, 1); I(GL_STENCIL_VALUE_MASK, 1); I(GL_STENCIL_WRITEMASK, 1); I(GL_STENCIL_FAIL, 1);
    I(GL_SCISSOR_BOX, 4); I(GL_LOGIC_OP_MODE, 1); I(GL_PRIMITIVE_RESTART_INDEX, 1); I(GL_PROVOKING_VERTEX, 1);
    I(GL_CLIP_ORIGIN, 1); I(GL_CLIP_DEPTH_MODE, 1); I(GL_PROGRAM_PIPELINE_BINDING, 1); I(GL_COPY_READ_BUFFER_BINDING, 1);
    I(GL_COPY_WRITE_BUFFER_BINDING, 1); I(GL_TEXTURE_BUFFER_BINDING, 1); I(GL_SHADER_STORAGE_BUFFER_BINDING, 1);
    I(GL_ATOMIC_COUNTER_BUFFER_BINDING, 1); I(GL_DRAW_INDIRECT_BUFFER_BINDING, 1); I(GL_DISPATCH_INDIRECT_BUFFER_BINDING, 1);
#undef I
    floats("viewport", GL_VIEWPORT, 4);
    floats("depth range", GL_DEPTH_RANGE, 2);
    floats("clear color", GL_COLOR_CLEAR_VALUE, 4);
    floats("clear depth", GL_DEPTH_CLEAR_VALUE, 1);
    floats("blend color", GL_BLEND_COLOR, 4);
    floats("polygon offset", GL_POLYGON_OFFSET_FACTOR, 1);
    floats("line width", GL_LINE_WIDTH, 1);
#define E(what) enabled(#what, what)
    E(GL_DEPTH_TEST); E(GL_CULL_FACE); E(GL_STENCIL_TEST); E(GL_COLOR_LOGIC_OP); E(GL_RASTERIZER_DISCARD); E(GL_POLYGON_OFFSET_FILL);
    E(GL_PRIMITIVE_RESTART); E(GL_SAMPLE_ALPHA_TO_COVERAGE); E(GL_SAMPLE_ALPHA_TO_ONE); E(GL_SAMPLE_COVERAGE); E(GL_SAMPLE_MASK);
    E(GL_FRAMEBUFFER_SRGB); E(GL_DEPTH_CLAMP); E(GL_DITHER); E(GL_MULTISAMPLE); E(GL_LINE_SMOOTH); E(GL_POLYGON_SMOOTH);
    E(GL_TEXTURE_CUBE_MAP_SEAMLESS); E(GL_PROGRAM_POINT_SIZE);
    for (GLuint i = 0; i < 8; ++i) enabled(("clip distance " + std::to_string(i)).c_str(), GL_CLIP_DISTANCE0 + i);
#undef E
    for (GLuint i = 0; i < 8; ++i) { // per draw buffer
        const std::string at = " " + std::to_string(i);
        GLboolean mask[4];
        glGetBooleani_v(GL_COLOR_WRITEMASK, i, mask);
        state["color mask" + at].assign(mask, mask + 4);
        state["blend" + at] = {double(glIsEnabledi(GL_BLEND, i))};
        for (const GLenum what : {GL_BLEND_SRC_RGB, GL_BLEND_DST_RGB, GL_BLEND_SRC_ALPHA, GL_BLEND_DST_ALPHA, GL_BLEND_EQUATION_RGB,
                                  GL_BLEND_EQUATION_ALPHA}) {
            GLint v = 0;
            glGetIntegeri_v(what, i, &v);
            state["blend state" + at].push_back(v);
        }
        GLfloat box[4];
        glGetFloati_v(GL_VIEWPORT, i, box);
        state["viewport" + at].assign(box, box + 4);
        state["scissor test" + at] = {double(glIsEnabledi(GL_SCISSOR_TEST, i))};
    }
    GLint active = 0;
    glGetIntegerv(GL_ACTIVE_TEXTURE, &active);
    for (GLuint unit = 0; unit < 16; ++unit) {
        glActiveTexture(GL_TEXTURE0 + unit);
        for (const GLenum what : {GL_TEXTURE_BINDING_2D, GL_TEXTURE_BINDING_2D_ARRAY, GL_TEXTURE_BINDING_3D, GL_TEXTURE_BINDING_CUBE_MAP,
                                  GL_TEXTURE_BINDING_BUFFER, GL_SAMPLER_BINDING}) {
            GLint v = 0;
            glGetIntegerv(what, &v);
            state["unit " + std::to_string(unit)].push_back(v);
        }
    }
    glActiveTexture(GLenum(active));
    for (GLuint i = 0; i < 8; ++i)
        for (const GLenum what : {GL_UNIFORM_BUFFER_BINDING, GL_UNIFORM_BUFFER_START, GL_UNIFORM_BUFFER_SIZE, GL_SHADER_STORAGE_BUFFER_BINDING,
                                  GL_SHADER_STORAGE_BUFFER_START, GL_SHADER_STORAGE_BUFFER_SIZE, GL_ATOMIC_COUNTER_BUFFER_BINDING}) {
            GLint64 v = 0;
            glGetInteger64i_v(what, i, &v);
            state["indexed buffers " + std::to_string(i)].push_back(double(v));
        }
    for (GLuint i = 0; i < 8; ++i)
        for (const GLenum what : {GL_IMAGE_BINDING_NAME, GL_IMAGE_BINDING_LEVEL, GL_IMAGE_BINDING_LAYERED, GL_IMAGE_BINDING_LAYER, GL_IMAGE_BINDING_ACCESS,
                                  GL_IMAGE_BINDING_FORMAT}) {
            GLint v = 0;
            glGetIntegeri_v(what, i, &v);
            state["image " + std::to_string(i)].push_back(v);
        }
    return state;
}

/// Sets everything to a value that is neither the default nor what the runtime uses.
static void scramble(GLuint framebuffer)
{
    static const char* vertex = "#version 330 core\nvoid main() { gl_Position = vec4(0); }";
    static const char* fragment = "#version 330 core\nout vec4 c; void main() { c = vec4(1); }";
    const GLuint program = glCreateProgram();
    for (const auto& [type, text] : {std::pair{GL_VERTEX_SHADER, vertex}, std::pair{GL_FRAGMENT_SHADER, fragment}}) {
        const GLuint shader = glCreateShader(GLenum(type));
        glShaderSource(shader, 1, &text, nullptr);
        glCompileShader(shader);
        glAttachShader(program, shader);
    }
    glLinkProgram(program);
    glUseProgram(program);

    GLuint names[12];
    glGenProgramPipelines(1, names);
    glBindProgramPipeline(names[0]);
    glGenVertexArrays(1, names);
    glBindVertexArray(names[0]);
    glGenBuffers(12, names);
    const GLenum targets[] = {GL_ARRAY_BUFFER, GL_ELEMENT_ARRAY_BUFFER, GL_UNIFORM_BUFFER, GL_PIXEL_UNPACK_BUFFER, GL_PIXEL_PACK_BUFFER, GL_COPY_READ_BUFFER,
                              GL_COPY_WRITE_BUFFER, GL_TEXTURE_BUFFER, GL_SHADER_STORAGE_BUFFER, GL_ATOMIC_COUNTER_BUFFER, GL_DRAW_INDIRECT_BUFFER, GL_DISPATCH_INDIRECT_BUFFER};
    for (int i = 0; i < 12; ++i) {
        glBindBuffer(targets[i], names[i]);
        glBufferData(targets[i], 1 << 16, nullptr, GL_STATIC_DRAW);
    }
    glBindBufferBase(GL_UNIFORM_BUFFER, 0, names[2]);
    for (GLuint i = 0; i < 8; ++i) glBindBufferRange(GL_SHADER_STORAGE_BUFFER, i, names[8], 256 * i, 256);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    for (GLuint unit = 0; unit < 8; ++unit) {
        glActiveTexture(GL_TEXTURE0 + unit);
        GLuint t[2], sampler;
        glGenTextures(2, t);
        glGenSamplers(1, &sampler);
        glBindTexture(GL_TEXTURE_2D, t[0]);
        glBindTexture(GL_TEXTURE_2D_ARRAY, t[1]);
        glBindSampler(unit, sampler);
        glSamplerParameteri(sampler, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR); // would make our textures incomplete
        glBindImageTexture(unit, t[1], 2, GL_FALSE, 3, GL_READ_WRITE, GL_R32F);
    }
    glActiveTexture(GL_TEXTURE6);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 8);
    glPixelStorei(GL_UNPACK_ROW_LENGTH, 77);
    glPixelStorei(GL_UNPACK_SKIP_ROWS, 3);
    glPixelStorei(GL_UNPACK_SKIP_PIXELS, 5);
    glPixelStorei(GL_UNPACK_SKIP_IMAGES, 2);
    glPixelStorei(GL_UNPACK_IMAGE_HEIGHT, 99);
    glPixelStorei(GL_UNPACK_SWAP_BYTES, 1);
    for (GLuint i = 0; i < 8; ++i) {
        (i % 2 ? glEnablei : glDisablei)(GL_BLEND, i);
        glColorMaski(i, i % 2, i % 3 == 0, 1, i % 2 == 0);
        glBlendFuncSeparatei(i, GL_DST_COLOR, GL_SRC_ALPHA, GLenum(i % 2 ? GL_ONE : GL_ZERO), GL_DST_ALPHA);
        glBlendEquationSeparatei(i, GL_FUNC_SUBTRACT, GLenum(i % 2 ? GL_MAX : GL_MIN));
        glViewportIndexedf(i, 0.25f * float(i), 1.5f, 33.0f - float(i), 30.0f);
        if (i > 0) (i % 2 ? glEnablei : glDisablei)(GL_SCISSOR_TEST, i);
    }
    glViewportIndexedf(0, 0, 0, 33, 33);
    glDepthFunc(GL_ALWAYS);
    glDepthMask(GL_TRUE);
    glEnable(GL_DEPTH_TEST);
    glEnable(GL_CULL_FACE);
    glCullFace(GL_FRONT_AND_BACK);
    glFrontFace(GL_CW);
    glPolygonMode(GL_FRONT_AND_BACK, GL_POINT);
    glPolygonOffset(3, 4);
    glPrimitiveRestartIndex(2);
    glSampleCoverage(0.0f, GL_FALSE);
    glSampleMaski(0, 0);
    for (const GLenum what : {GL_COLOR_LOGIC_OP, GL_RASTERIZER_DISCARD, GL_POLYGON_OFFSET_FILL, GL_PRIMITIVE_RESTART,
                              GL_SAMPLE_ALPHA_TO_COVERAGE, GL_SAMPLE_ALPHA_TO_ONE, GL_SAMPLE_COVERAGE, GL_SAMPLE_MASK, GL_POLYGON_SMOOTH,
                              GL_FRAMEBUFFER_SRGB, GL_DEPTH_CLAMP})
        glEnable(what);
    for (GLuint i = 0; i < 8; ++i) glEnable(GL_CLIP_DISTANCE0 + i);
    glLogicOp(GL_CLEAR);
    glClearColor(0.1f, 0.2f, 0.3f, 0.4f);
}

TEST_CASE("GL state is the same before and after a draw, whatever it was, and of it only the first colour mask shows in the image")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : {withSharp(randomAsset(100, 9, 4), kAllSharp, 4), randomSss(100, kAllSss, 4)}) {
        CAPTURE(asset.model);
        Host host(asset);
        GLint major = 0;
        glGetIntegerv(GL_MAJOR_VERSION, &major);
        if (major < 4) {
            MESSAGE("SKIPPED: indexed state of the comparison needs GL 4.5");
            return;
        }
        Image expected = host.draw(front(), kLamp);
        for (size_t i = 0; i < expected.rgba.size(); i += 4) expected.rgba[i] = 0.0f; // scramble masks red off
        REQUIRE(host.gl->beginFrame(33, 33));
        GLint framebuffer = 0;
        glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer);
        scramble(GLuint(framebuffer));
        REQUIRE(glGetError() == GL_NO_ERROR);
        const auto before = snapshot();
        REQUIRE(glGetError() == GL_NO_ERROR);

        // creating, relighting, sorting, drawing and failing all happen under the scrambled state
        const NacreInstance second = host.place(asset), doomed = host.place(asset);
        const NacreView view = host.addView(), doomedView = host.addView();
        const NacreDrawDesc desc = describe(front(), {&second, 1}), other = describe(front(), {&doomed, 1});
        host.setLights(kLamp);
        REQUIRE(nacreViewPrepare(doomedView, &other, 8) == NACRE_OK);
        REQUIRE(nacreViewDraw(view, &desc) == NACRE_OK);
        nacreViewDestroy(doomedView);
        nacreInstanceDestroy(doomed);
        NacreDrawDesc broken = desc;
        broken.clipFromView[0] = NAN;
        CHECK(nacreViewDraw(view, &broken) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(glGetError() == GL_NO_ERROR);

        const auto after = snapshot();
        for (const auto& [name, value] : before) {
            CAPTURE(name);
            CHECK(after.at(name) == value);
        }
        glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
        CHECK(largestDifference(host.gl->readFrame(), expected) == 0.0f);
        nacreInstanceDestroy(second);
        CHECK(glGetError() == GL_NO_ERROR);
    }
}

// ---- independence -------------------------------------------------------------------------------------------------------------

TEST_CASE("two contexts and two assets do not influence each other")
{
    if (!haveGl()) return;
    const SplatAsset a = randomAsset(60, 4, 1), b = withSharp(randomAsset(90, 9, 2), kAllSharp, 2);
    const std::vector<Light> other = {directionalLight({0, 1, 0}, {1, 0, 0})};
    Host first(a), second(b);
    const Image expectedA = first.draw(front(), kLamp), expectedB = second.draw(front(), other);
    const NacreInstance firstB = first.place(b); // the same asset in both contexts, and two assets in one
    const NacreDrawDesc onlyA = describe(front(), {&first.instance, 1}), onlyB = describe(front(), {&firstB, 1});
    first.setLights(other);
    CHECK(largestDifference(first.draw(onlyB), expectedB) == 0.0f);
    first.setLights(kLamp);
    CHECK(largestDifference(first.draw(onlyA), expectedA) == 0.0f);
    CHECK(largestDifference(second.draw(front()), expectedB) == 0.0f);
}

// ---- bad input ----------------------------------------------------------------------------------------------------------------

TEST_CASE("damaged bytes give BAD_ASSET, a message and no asset")
{
    if (!haveGl()) return;
    Host host;
    const auto bytes = encodeAsset(randomAsset(5, 4, 1));
    REQUIRE(bytes);
    NacreAsset asset{~0ull};
    for (const size_t cut : {size_t(0), size_t(3), size_t(12), bytes->size() / 2, bytes->size() - 1}) {
        CAPTURE(cut);
        host.messages.clear();
        CHECK(nacreAssetCreate(host.context, bytes->data(), cut, &asset) == NACRE_ERROR_BAD_ASSET);
        CHECK(asset.id == 0);
        CHECK(host.messages.size() == 1);
        CHECK(host.lastMessage().find('\n') == std::string::npos);
    }
    const std::vector<unsigned char> garbage(1000, 0xA5);
    CHECK(nacreAssetCreate(host.context, garbage.data(), garbage.size(), &asset) == NACRE_ERROR_BAD_ASSET);
    CHECK(nacreAssetCreate(host.context, nullptr, 10, &asset) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(nacreAssetCreate(host.context, garbage.data(), garbage.size(), nullptr) == NACRE_ERROR_INVALID_ARGUMENT);
}

TEST_CASE("a coefficient beyond half-float range is rejected by name")
{
    if (!haveGl()) return;
    Host host;
    SplatAsset source = randomAsset(5, 4, 1);
    source.channels[1].values[75 * 3 + 2] = 1e5f;
    const auto bytes = encodeAsset(source);
    REQUIRE(bytes);
    NacreAsset asset{};
    CHECK(nacreAssetCreate(host.context, bytes->data(), bytes->size(), &asset) == NACRE_ERROR_BAD_ASSET);
    CHECK(asset.id == 0);
    CHECK(host.lastMessage().find("'tInd'") != std::string::npos);
    CHECK(host.lastMessage().find("splat 3") != std::string::npos);
}

TEST_CASE("a context that cannot be made says why and is 0")
{
    NacreContext context{~0ull};
    CHECK(nacreContextCreate(nullptr, &context) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(context.id == 0);
    NacreContextDesc desc{};
    CHECK(nacreContextCreate(&desc, &context) == NACRE_ERROR_INVALID_ARGUMENT); // structSize 0
    desc.structSize = sizeof desc;
    CHECK(nacreContextCreate(&desc, &context) == NACRE_ERROR_INVALID_ARGUMENT); // no getProcAddress
    CHECK(nacreContextCreate(&desc, nullptr) == NACRE_ERROR_INVALID_ARGUMENT);
    desc.getProcAddress = [](const char*, void*) -> void* { return nullptr; };
    std::string message;
    desc.message = [](NacreSeverity, const char* text, void* user) { *static_cast<std::string*>(user) = text; };
    desc.messageUser = &message;
    CHECK(nacreContextCreate(&desc, &context) == NACRE_ERROR_UNSUPPORTED);
    CHECK(message.find("getProcAddress found no gl") != std::string::npos);
    desc.flags = 0x80000000u;
    CHECK(nacreContextCreate(&desc, &context) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK_MESSAGE(message.find("flags") != std::string::npos, message);
    desc.flags = 0;
    const int unknown = 17;
    std::memcpy(&desc.backEnd, &unknown, sizeof unknown);
    CHECK(nacreContextCreate(&desc, &context) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK_MESSAGE(message.find("back") != std::string::npos, message);
    CHECK(context.id == 0);
    CHECK(nacreVersion() == NACRE_VERSION_MAJOR * 10000 + NACRE_VERSION_MINOR * 100 + NACRE_VERSION_PATCH);
}

TEST_CASE("numbers that are not finite and matrices that are not what they should be are refused with a message")
{
    if (!haveGl()) return;
    Host host(oneSplat(0));
    const auto refused = [&](auto change, const char* word) {
        NacreDrawDesc desc = describe(front());
        change(desc);
        host.messages.clear();
        REQUIRE(host.gl->beginFrame(33, 33));
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK_MESSAGE(host.lastMessage().find(word) != std::string::npos, host.lastMessage());
        CHECK(nacreViewPrepare(host.view, &desc, 1) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK_MESSAGE(host.lastMessage().find(word) != std::string::npos, host.lastMessage());
    };
    refused([](NacreDrawDesc& d) { d.structSize = 4; }, "structSize");
    refused([](NacreDrawDesc& d) { d.structSize = sizeof d + 8; }, "structSize");
    refused([](NacreDrawDesc& d) { d.viewFromWorld[12] = INFINITY; }, "viewFromWorld");
    refused([](NacreDrawDesc& d) { d.clipFromView[0] = NAN; }, "clipFromView");
    refused([](NacreDrawDesc& d) { std::fill(d.viewFromWorld, d.viewFromWorld + 12, 0.0f); }, "viewFromWorld");
    refused([](NacreDrawDesc& d) { d.viewportWidth = -1; }, "viewport");

    const auto badPlace = [&](auto change, const char* word) {
        NacreInstanceDesc desc{};
        desc.structSize = sizeof desc, desc.asset = host.asset;
        copy(desc.worldFromAsset, glm::dmat4(1.0));
        change(desc);
        NacreInstance made{~0ull};
        host.messages.clear();
        CHECK(nacreInstanceCreate(&desc, &made) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(made.id == 0);
        CHECK_MESSAGE(host.lastMessage().find(word) != std::string::npos, host.lastMessage());
        host.messages.clear();
        if (desc.structSize == sizeof desc) CHECK(nacreInstanceSetTransform(host.instance, desc.worldFromAsset) == NACRE_ERROR_INVALID_ARGUMENT);
        else return;
        CHECK_MESSAGE(host.lastMessage().find(word) != std::string::npos, host.lastMessage());
    };
    badPlace([](NacreInstanceDesc& d) { d.structSize = 4; }, ""); // too short for the asset: there is no context to tell
    badPlace([](NacreInstanceDesc& d) { d.structSize = sizeof d + 8; }, "structSize");
    badPlace([](NacreInstanceDesc& d) { d.worldFromAsset[3] = NAN; }, "worldFromAsset");
    badPlace([](NacreInstanceDesc& d) { d.worldFromAsset[0] = 2; }, "uniform scale");
    badPlace([](NacreInstanceDesc& d) { d.worldFromAsset[0] = 0; }, "uniform scale");
    for (const float scale : {1e-13f, 1e30f})
        badPlace([scale](NacreInstanceDesc& d) { d.worldFromAsset[0] = d.worldFromAsset[5] = d.worldFromAsset[10] = scale; }, "from 1e-12 to 1e12");

    const auto badLight = [&](auto change, const char* word) {
        NacreLight lights[2] = {toNacre(kLamp[0]), toNacre(kLamp[0])};
        change(lights[1]);
        host.messages.clear();
        CHECK(nacreContextSetLights(host.context, lights, 2) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK_MESSAGE(host.lastMessage().find(word) != std::string::npos, host.lastMessage());
        CHECK(host.lastMessage().find("light 1") != std::string::npos);
    };
    const int unknown = 7;
    badLight([&](NacreLight& l) { std::memcpy(&l.type, &unknown, sizeof unknown); }, "type");
    badLight([](NacreLight& l) { l.position[1] = NAN; }, "position");
    badLight([](NacreLight& l) { l.intensity[2] = -1; }, "intensity");
    badLight([](NacreLight& l) { l.intensity[2] = INFINITY; }, "intensity");
    badLight([](NacreLight& l) { l.intensity[2] = 2e15f; }, "1e15");
    badLight([](NacreLight& l) { l.radius = NAN; }, "radius");
    badLight([](NacreLight& l) { l.range = -1; }, "range");
    badLight([](NacreLight& l) { l.structSize -= 8; }, "structSize");
    for (const float radius : {NAN, -0.1f, 1.7f})
        badLight([&](NacreLight& l) { l.type = NACRE_LIGHT_DIRECTIONAL, l.direction[0] = 1, l.radius = radius; }, "radians");
    badLight([](NacreLight& l) { l.type = NACRE_LIGHT_DIRECTIONAL; }, "length 1");
    CHECK(nacreContextSetLights(host.context, nullptr, 1) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(nacreContextSetLights(host.context, nullptr, 0) == NACRE_OK);
}

TEST_CASE("lights that are refused leave those that were set")
{
    if (!haveGl()) return;
    Host host(randomAsset(30, 4, 1));
    const Image before = host.draw(front(), kLamp);
    NacreLight lights[2] = {toNacre(directionalLight({0, 1, 0}, glm::vec3(1))), toNacre(kLamp[0])};
    lights[1].intensity[0] = NAN;
    CHECK(nacreContextSetLights(host.context, lights, 2) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(largestDifference(host.draw(front()), before) == 0.0f);
    CHECK(passes(host) == Passes{0, 0, 0, 0, 0});
}

TEST_CASE("structs of an older host are shorter: what they lack counts as zero, and nothing beyond them is read or written")
{
    if (!haveGl()) return;
    Host host(randomAsset(40, 4, 1));
    const Image expected = host.draw(front(), kLamp);

    NacreDrawDesc draw = describe(front());
    draw.structSize = offsetof(NacreDrawDesc, depthTest);
    std::memset(reinterpret_cast<char*>(&draw) + draw.structSize, 0xA5, sizeof draw - draw.structSize);
    CHECK(largestDifference(host.draw(draw), expected) == 0.0f);

    NacreInstanceDesc place{};
    place.structSize = offsetof(NacreInstanceDesc, worldFromAsset), place.asset = host.asset;
    std::memset(place.worldFromAsset, 0xA5, sizeof place - place.structSize);
    NacreInstance second{};
    REQUIRE_MESSAGE(nacreInstanceCreate(&place, &second) == NACRE_OK, host.lastMessage());
    CHECK(largestDifference(host.draw(describe(front(), {&second, 1})), expected) == 0.0f);

    NacreViewDesc viewDesc{};
    viewDesc.structSize = offsetof(NacreViewDesc, mask), viewDesc.mask = 0xA5A5A5A5u;
    NacreView view{};
    REQUIRE(nacreViewCreate(host.context, &viewDesc, &view) == NACRE_OK);
    CHECK(largestDifference(host.draw(view, describe(front(), {&second, 1})), expected) == 0.0f);

    constexpr size_t kLight = offsetof(NacreLight, range); // of the first is the stride of the array
    const NacreLight whole[2] = {toNacre(kLamp[0]), toNacre(directionalLight({0, 1, 0}, {0.5f, 1, 0.25f}))};
    REQUIRE(nacreContextSetLights(host.context, whole, 2) == NACRE_OK);
    const Image both = host.draw(describe(front(), {&second, 1}));
    constexpr size_t kStride = (kLight + 7) / 8 * 8;
    alignas(8) unsigned char shorter[2 * kStride];
    for (size_t i = 0; i < 2; ++i) {
        NacreLight light = whole[i];
        light.structSize = kStride;
        std::memcpy(shorter + i * kStride, &light, kStride);
    }
    REQUIRE_MESSAGE(nacreContextSetLights(host.context, reinterpret_cast<const NacreLight*>(shorter), 2) == NACRE_OK, host.lastMessage());
    CHECK(largestDifference(host.draw(describe(front(), {&second, 1})), both) == 0.0f);

    const auto keepsTheRest = [](auto info, size_t size, auto get) {
        std::memset(&info, 0xA5, sizeof info);
        info.structSize = size;
        CHECK(get(&info) == NACRE_OK);
        CHECK(info.structSize == size);
        const auto* bytes = reinterpret_cast<const unsigned char*>(&info);
        CHECK(std::all_of(bytes + size, bytes + sizeof info, [](unsigned char b) { return b == 0xA5; }));
    };
    keepsTheRest(NacreAssetInfo{}, offsetof(NacreAssetInfo, model), [&](NacreAssetInfo* i) { return nacreAssetGetInfo(host.asset, i); });
    keepsTheRest(NacreContextInfo{}, offsetof(NacreContextInfo, gpuBytes), [&](NacreContextInfo* i) { return nacreContextGetInfo(host.context, i); });
    keepsTheRest(NacreDrawStats{}, offsetof(NacreDrawStats, relightSplats), [&](NacreDrawStats* s) { return nacreViewGetStats(host.view, s); });
}

TEST_CASE("asset info reports count, bounds, orientation and GPU bytes")
{
    if (!haveGl()) return;
    SplatAsset source = randomAsset(70, 4, 1);
    source.yUpFromAsset = glm::normalize(glm::quat(0.5f, 0.5f, -0.5f, 0.5f));
    Host host(source);
    NacreAssetInfo info = host.info();
    CHECK(info.splatCount == 70);
    CHECK(std::string(info.model) == "bigs");
    CHECK(info.gpuBytes >= 70 * (4 * 16 + 25 * 8 + 10 * 8));
    CHECK(info.yUpFromAsset[3] == doctest::Approx(source.yUpFromAsset.w));
    CHECK(info.yUpFromAsset[1] == doctest::Approx(source.yUpFromAsset.y));
    for (int c = 0; c < 3; ++c) {
        float low = 1, high = -1;
        for (const glm::vec3& p : source.cloud.positions) low = std::min(low, p[c]), high = std::max(high, p[c]);
        CHECK(info.boundsMin[c] == low);
        CHECK(info.boundsMax[c] == high);
    }
    info.structSize = 1;
    CHECK(nacreAssetGetInfo(host.asset, &info) == NACRE_ERROR_INVALID_ARGUMENT);
}

TEST_CASE("GPU bytes count the channels an asset has, and only those")
{
    if (!haveGl()) return;
    const auto gpuBytes = [](int which, size_t lights) {
        Host host(withSharp(randomAsset(70, 4, 1), which, 1));
        host.draw(front(), std::vector<Light>(lights, kLamp[0]));
        return host.contextInfo().gpuBytes;
    };
    const uint64_t texels = 2 * 64;                                                   // of a slot: 70 splats fill two rows
    const uint64_t maps = 70 * 256;                                                   // whole rows of 256
    const uint64_t plain = gpuBytes(0, 5);
    CHECK(gpuBytes(kShadow, 5) == plain);                                             // rides with rho
    CHECK(gpuBytes(kLobe, 5) == plain + 2 * 16 * texels);                             // two slots of floats
    CHECK(gpuBytes(kVisibility, 5) == plain + maps);
    CHECK(gpuBytes(kLobe | kVisibility, 0) == gpuBytes(0, 0) + 2 * 16 * texels + maps);
    CHECK(gpuBytes(kLobe | kVisibility, 5) == plain + 2 * 16 * texels + maps + 2 * 8 * texels); // v: two groups of four halves
}
