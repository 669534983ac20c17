// Every back end in every kind of context draws the same scene, and each keeps to what was asked of it.
#include "runtime_joint_reference.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include <map>
#include <set>

using namespace nacre;
using namespace nacre::test;

namespace {

struct Where {
    const char* name;
    HeadlessKind kind;
    NacreBackEnd backEnd;
    bool fewDrawBuffers = false; // 4, the least that ES must have
};
constexpr Where kWheres[] = {
    {"GL 3.3, EGL", HeadlessKind::kEgl, NACRE_BACK_END_GL33},         {"GL 4.3, EGL", HeadlessKind::kEgl, NACRE_BACK_END_GL43},
    {"ES 3.0, EGL", HeadlessKind::kEglEs, NACRE_BACK_END_GLES3},      {"ES 3.0 with 4 draw buffers, EGL", HeadlessKind::kEglEs, NACRE_BACK_END_GLES3, true},
    {"GL 3.3, OSMesa", HeadlessKind::kOsMesa, NACRE_BACK_END_GL33},   {"GL 4.3, OSMesa", HeadlessKind::kOsMesa, NACRE_BACK_END_GL43},
};

template <class Function>
Function glFunction(const char* name) { return reinterpret_cast<Function>(HeadlessGl::getProcAddress(name, nullptr)); }

int glVersion()
{
    GLint major = 0, minor = 0;
    const auto get = glFunction<PFNGLGETINTEGERVPROC>("glGetIntegerv");
    get(GL_MAJOR_VERSION, &major), get(GL_MINOR_VERSION, &minor);
    return 10 * major + minor;
}

/// False, with the reason, where this cannot be tested.
bool have(const Where& where)
{
    if (!haveGl(where.kind)) return false;
    if (where.backEnd != NACRE_BACK_END_GL43) return true;
    const auto gl = HeadlessGl::create(where.kind);
    if (glVersion() < 43) MESSAGE("SKIPPED: OpenGL is older than 4.3");
    return glVersion() >= 43;
}

PFNGLGETINTEGERVPROC realGetIntegerv = nullptr;
void* fourDrawBuffers(const char* name, void* user)
{
    static constexpr auto kGet = [](GLenum what, GLint* value) {
        realGetIntegerv(what, value);
        if (what == GL_MAX_DRAW_BUFFERS || what == GL_MAX_COLOR_ATTACHMENTS) *value = 4;
    };
    void* real = HeadlessGl::getProcAddress(name, user);
    if (std::strcmp(name, "glGetIntegerv") != 0) return real;
    realGetIntegerv = reinterpret_cast<PFNGLGETINTEGERVPROC>(real);
    return reinterpret_cast<void*>(+kGet);
}

HostOptions options(const Where& where)
{
    return {.kind = where.kind, .backEnd = where.backEnd, .getProcAddress = where.fewDrawBuffers ? fourDrawBuffers : HeadlessGl::getProcAddress};
}

std::vector<Light> lightsAround(int count)
{
    std::vector<Light> lights;
    for (int i = 0; i < count; ++i) {
        const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
        const glm::vec3 at(1.5 * r * std::cos(2.4 * i), 1.5 * r * std::sin(2.4 * i), 1.5 * z), color = 2.0f / float(count) * glm::vec3(1, 0.8f, 1.2f);
        lights.push_back(i % 3 == 1 ? directionalLight(at, color, i % 2 ? 0.2f : 0.0f) : pointLight(at, 3.0f * color));
    }
    return lights;
}

SplatAsset shining() { return withSharp(randomAsset(200, 9, 4), kAllSharp, 4); }
SplatAsset waxen() { return randomSss(200, kAllSss, 4); }

} // namespace

TEST_CASE("every back end in every kind of context draws the reference, one model or both in a scene, under few lights and many")
{
    const SplatAsset bigs = shining(), sss = waxen();
    const std::vector<std::vector<SplatAsset>> scenes = {{bigs}, {sss}, {bigs, sss}};
    for (const int count : {3, 30})
        for (const auto& scene : scenes) {
            const std::vector<Light> lights = lightsAround(count);
            const Image expected = jointReference(scene, offCentre(), lights);
            CHECK(largest(expected) > 0.3f);
            Image first;
            for (const Where& where : kWheres) {
                CAPTURE(std::string(where.name));
                CAPTURE(scene.size());
                CAPTURE(scene[0].model);
                CAPTURE(count);
                if (!have(where)) continue;
                Host host(options(where));
                for (const SplatAsset& asset : scene) host.place(asset);
                const Image drawn = host.draw(offCentre(), lights);
                CHECK(host.contextInfo().backEnd == where.backEnd);
                CHECK(psnr(drawn, expected) > 50.0);
                if (first.rgba.empty()) first = drawn;
                CHECK(psnr(drawn, first) > 60.0);
                CHECK(glFunction<PFNGLGETERRORPROC>("glGetError")() == GL_NO_ERROR);
                CHECK_MESSAGE(host.messages.empty(), host.lastMessage());
            }
        }
}

TEST_CASE("every shader that assets of any channels need compiles and links in every back end")
{
    for (const Where& where : kWheres) {
        CAPTURE(std::string(where.name));
        if (!have(where)) continue;
        Host host(options(where));
        std::vector<NacreInstance> placed;
        for (const int functions : {0, 1, 4, 9, 16, 25})
            for (const int sharp : {0, int(kLobe), int(kVisibility), kVisibility | kShadow, int(kAllSharp)})
                placed.push_back(host.place(withSharp(randomAsset(3, functions, 1), sharp, 1)));
        for (int which = 0; which <= kAllSss; ++which) placed.push_back(host.place(randomSss(3, which, 1)));
        for (const size_t lights : {0, 1, 2, 3, 5, 8, 11, 12, 24, 48, 60}) {
            CHECK_MESSAGE(nacreViewPrepare(host.view, nullptr, lights) == NACRE_OK, host.lastMessage());
            for (const NacreInstance& one : placed) { // each alone: the raster of a scene depends on what is mixed in it
                const NacreDrawDesc desc = describe(offCentre(), {&one, 1});
                if (lights == 3) CHECK_MESSAGE(nacreViewPrepare(host.view, &desc, lights) == NACRE_OK, host.lastMessage());
            }
        }
        CHECK(host.contextInfo().programs > 20);
    }
}

TEST_CASE("a back end that the context cannot do is refused, with what it needs and what was found")
{
    struct Refusal {
        HeadlessKind kind;
        NacreBackEnd backEnd;
        const char* needs;
    };
    for (const Refusal& r : {Refusal{HeadlessKind::kEgl, NACRE_BACK_END_GLES3, "OpenGL ES 3.0"}, Refusal{HeadlessKind::kOsMesa, NACRE_BACK_END_GLES3, "OpenGL ES 3.0"},
                             Refusal{HeadlessKind::kEglEs, NACRE_BACK_END_GL33, "OpenGL 3.3"}, Refusal{HeadlessKind::kEglEs, NACRE_BACK_END_GL43, "OpenGL 4.3"}}) {
        if (!haveGl(r.kind)) continue;
        const auto gl = HeadlessGl::create(r.kind);
        std::string message;
        NacreContextDesc desc{};
        desc.structSize = sizeof desc;
        desc.getProcAddress = HeadlessGl::getProcAddress;
        desc.message = [](NacreSeverity, const char* text, void* user) { *static_cast<std::string*>(user) += text; };
        desc.messageUser = &message;
        desc.backEnd = r.backEnd;
        NacreContext context{1};
        CHECK(nacreContextCreate(&desc, &context) == NACRE_ERROR_UNSUPPORTED);
        CHECK(context.id == 0);
        CHECK_MESSAGE(message.find(std::string("needs ") + r.needs) != std::string::npos, message);
        CHECK_MESSAGE(message.find("found OpenGL") != std::string::npos, message);
    }
}

static std::set<std::string> askedFor;
static void* listNames(const char* name, void* user)
{
    askedFor.insert(name);
    return HeadlessGl::getProcAddress(name, user);
}
static const char* extensionShown = "";
static void* oneExtension(const char* name, void* user)
{
    static constexpr auto kString = [](GLenum, GLuint) { return reinterpret_cast<const GLubyte*>(extensionShown); };
    return std::strcmp(name, "glGetStringi") == 0 ? reinterpret_cast<void*>(+kString) : HeadlessGl::getProcAddress(name, user);
}
static void* olderEs(const char* name, void* user)
{
    static constexpr auto kGet = [](GLenum what, GLint* value) {
        realGetIntegerv(what, value);
        if (what == GL_MAJOR_VERSION) *value = 3;
        if (what == GL_MINOR_VERSION) *value = 0;
    };
    if (std::strcmp(name, "glGetIntegerv") != 0) return oneExtension(name, user);
    realGetIntegerv = reinterpret_cast<PFNGLGETINTEGERVPROC>(HeadlessGl::getProcAddress(name, user));
    return reinterpret_cast<void*>(+kGet);
}

TEST_CASE("functions of compute shaders are not even asked for by another back end")
{
    if (!haveGl()) return;
    for (const NacreBackEnd backEnd : {NACRE_BACK_END_GL33, NACRE_BACK_END_AUTO}) {
        askedFor.clear();
        Host host(HostOptions{.backEnd = backEnd, .getProcAddress = listNames});
        CHECK(askedFor.contains("glDispatchCompute") == (host.contextInfo().backEnd == NACRE_BACK_END_GL43));
        CHECK((host.contextInfo().backEnd == NACRE_BACK_END_GL43) == (backEnd == NACRE_BACK_END_AUTO && glVersion() >= 43));
    }
}

TEST_CASE("ES 3.0 needs float targets, and says so")
{
    if (!haveGl(HeadlessKind::kEglEs)) return;
    const auto gl = HeadlessGl::create(HeadlessKind::kEglEs);
    for (const char* extension : {"GL_OES_depth24", "GL_EXT_color_buffer_float"}) {
        extensionShown = extension;
        std::string message;
        NacreContextDesc desc{};
        desc.structSize = sizeof desc;
        desc.getProcAddress = olderEs;
        desc.message = [](NacreSeverity, const char* text, void* user) { *static_cast<std::string*>(user) += text; };
        desc.messageUser = &message;
        NacreContext context{};
        const bool enough = extension == std::string("GL_EXT_color_buffer_float");
        CHECK(nacreContextCreate(&desc, &context) == (enough ? NACRE_OK : NACRE_ERROR_UNSUPPORTED));
        CHECK((message.find("EXT_color_buffer_float") != std::string::npos) == !enough);
        nacreContextDestroy(context);
    }
}

// ---- the host's state in ES ---------------------------------------------------------------------------------------------------

namespace {

const std::vector<Light> kLamp = {pointLight({1, 1, 2}, glm::vec3(3))};
Camera front() { return lookAt({0, 0, 2}, {0, 0, 0}, 33, 33, 40); }

/// Two float targets and depth.
struct EsTarget {
    GLuint framebuffer = 0, images[3] = {};
    EsTarget()
    {
        glGenFramebuffers(1, &framebuffer);
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
        glGenRenderbuffers(3, images);
        const GLenum formats[] = {GL_RGBA16F, GL_RGBA16F, GL_DEPTH24_STENCIL8}, attachments[] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1, GL_DEPTH_ATTACHMENT};
        for (int i = 0; i < 3; ++i) {
            glBindRenderbuffer(GL_RENDERBUFFER, images[i]);
            glRenderbufferStorage(GL_RENDERBUFFER, formats[i], 33, 33);
            glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachments[i], GL_RENDERBUFFER, images[i]);
        }
        glDrawBuffers(2, attachments);
        const float black[4] = {0, 0, 0, 0}, grey[4] = {0.5f, 0.5f, 0.5f, 0.5f}, far = 1;
        glClearBufferfv(GL_COLOR, 0, black), glClearBufferfv(GL_COLOR, 1, grey), glClearBufferfv(GL_DEPTH, 0, &far);
        REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
    }
    ~EsTarget() { glDeleteFramebuffers(1, &framebuffer), glDeleteRenderbuffers(3, images); }
    Image read(GLenum target) const
    {
        Image image{33, 33, std::vector<float>(4 * 33 * 33)};
        glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer);
        glReadBuffer(GL_COLOR_ATTACHMENT0 + target);
        glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
        glReadPixels(0, 0, 33, 33, GL_RGBA, GL_FLOAT, image.rgba.data());
        return image;
    }
};

std::map<std::string, std::vector<double>> snapshotEs(bool indexed)
{
    std::map<std::string, std::vector<double>> state;
    const auto get = [&](const char* name, GLenum what, size_t count) {
        GLfloat v[16] = {};
        glGetFloatv(what, v);
        state[name].assign(v, v + count);
    };
#define G(what, n) get(#what, what, n);
    G(GL_DRAW_FRAMEBUFFER_BINDING, 1) G(GL_READ_FRAMEBUFFER_BINDING, 1) G(GL_RENDERBUFFER_BINDING, 1) G(GL_VERTEX_ARRAY_BINDING, 1) G(GL_ARRAY_BUFFER_BINDING, 1)
    G(GL_ELEMENT_ARRAY_BUFFER_BINDING, 1) G(GL_UNIFORM_BUFFER_BINDING, 1) G(GL_PIXEL_UNPACK_BUFFER_BINDING, 1) G(GL_PIXEL_PACK_BUFFER_BINDING, 1)
    G(GL_CURRENT_PROGRAM, 1) G(GL_ACTIVE_TEXTURE, 1) G(GL_UNPACK_ROW_LENGTH, 1) G(GL_UNPACK_SKIP_ROWS, 1) G(GL_UNPACK_SKIP_PIXELS, 1) G(GL_UNPACK_SKIP_IMAGES, 1)
    G(GL_UNPACK_IMAGE_HEIGHT, 1) G(GL_UNPACK_ALIGNMENT, 1) G(GL_DRAW_BUFFER0, 1) G(GL_DRAW_BUFFER1, 1) G(GL_DRAW_BUFFER2, 1) G(GL_READ_BUFFER, 1) G(GL_DEPTH_FUNC, 1)
    G(GL_DEPTH_WRITEMASK, 1) G(GL_CULL_FACE_MODE, 1) G(GL_FRONT_FACE, 1) G(GL_VIEWPORT, 4) G(GL_SCISSOR_BOX, 4) G(GL_COLOR_CLEAR_VALUE, 4) G(GL_COLOR_WRITEMASK, 4)
    G(GL_BLEND, 1) G(GL_BLEND_SRC_RGB, 1) G(GL_BLEND_DST_RGB, 1) G(GL_BLEND_SRC_ALPHA, 1) G(GL_BLEND_DST_ALPHA, 1) G(GL_BLEND_EQUATION_RGB, 1)
    G(GL_BLEND_EQUATION_ALPHA, 1) G(GL_DEPTH_TEST, 1) G(GL_SCISSOR_TEST, 1) G(GL_STENCIL_TEST, 1) G(GL_CULL_FACE, 1) G(GL_RASTERIZER_DISCARD, 1)
    G(GL_POLYGON_OFFSET_FILL, 1) G(GL_SAMPLE_ALPHA_TO_COVERAGE, 1) G(GL_SAMPLE_COVERAGE, 1) G(GL_DITHER, 1) G(GL_PRIMITIVE_RESTART_FIXED_INDEX, 1)
#undef G
    for (GLuint i = 0; indexed && i < 4; ++i) {
        std::vector<double>& buffer = state["draw buffer " + std::to_string(i)];
        GLboolean mask[4];
        glGetBooleani_v(GL_COLOR_WRITEMASK, i, mask);
        buffer.assign(mask, mask + 4);
        buffer.push_back(glIsEnabledi(GL_BLEND, i));
        for (const GLenum what : {GL_BLEND_SRC_RGB, GL_BLEND_DST_RGB, GL_BLEND_SRC_ALPHA, GL_BLEND_DST_ALPHA, GL_BLEND_EQUATION_RGB, GL_BLEND_EQUATION_ALPHA}) {
            GLint v = 0;
            glGetIntegeri_v(what, i, &v);
            buffer.push_back(v);
        }
    }
    GLint active = 0;
    glGetIntegerv(GL_ACTIVE_TEXTURE, &active);
    for (GLuint unit = 0; unit < 16; ++unit) {
        glActiveTexture(GL_TEXTURE0 + unit);
        for (const GLenum what : {GL_TEXTURE_BINDING_2D, GL_TEXTURE_BINDING_2D_ARRAY, GL_TEXTURE_BINDING_3D, GL_TEXTURE_BINDING_CUBE_MAP, GL_SAMPLER_BINDING}) {
            GLint v = 0;
            glGetIntegerv(what, &v);
            state["unit " + std::to_string(unit)].push_back(v);
        }
    }
    glActiveTexture(GLenum(active));
    return state;
}

/// Everything to what is neither the default nor what the runtime uses; `indexed`: ES 3.2, draw buffers differ.
void scrambleEs(bool indexed)
{
    GLuint buffers[5], vertexArray = 0;
    glGenVertexArrays(1, &vertexArray);
    glBindVertexArray(vertexArray);
    glGenBuffers(5, buffers);
    const GLenum targets[] = {GL_ARRAY_BUFFER, GL_ELEMENT_ARRAY_BUFFER, GL_UNIFORM_BUFFER, GL_PIXEL_UNPACK_BUFFER, GL_PIXEL_PACK_BUFFER};
    for (int i = 0; i < 5; ++i) glBindBuffer(targets[i], buffers[i]), glBufferData(targets[i], 1 << 16, nullptr, GL_STATIC_DRAW);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
    for (GLuint unit = 0; unit < 8; ++unit) {
        glActiveTexture(GL_TEXTURE0 + unit);
        GLuint t[3], sampler;
        glGenTextures(3, t);
        glGenSamplers(1, &sampler);
        glBindTexture(GL_TEXTURE_2D, t[0]), glBindTexture(GL_TEXTURE_2D_ARRAY, t[1]), glBindTexture(GL_TEXTURE_CUBE_MAP, t[2]);
        glBindSampler(unit, sampler);
    }
    glPixelStorei(GL_UNPACK_ALIGNMENT, 8), glPixelStorei(GL_UNPACK_ROW_LENGTH, 77), glPixelStorei(GL_UNPACK_SKIP_ROWS, 3), glPixelStorei(GL_UNPACK_SKIP_PIXELS, 5);
    glPixelStorei(GL_UNPACK_SKIP_IMAGES, 2), glPixelStorei(GL_UNPACK_IMAGE_HEIGHT, 99);
    glColorMask(GL_FALSE, GL_TRUE, GL_TRUE, GL_TRUE);
    glBlendFuncSeparate(GL_DST_COLOR, GL_SRC_ALPHA, GL_ZERO, GL_DST_ALPHA);
    glBlendEquationSeparate(GL_FUNC_SUBTRACT, GL_MIN);
    glEnable(GL_BLEND);
    for (GLuint i = 0; indexed && i < 4; ++i) {
        (i % 2 ? glEnablei : glDisablei)(GL_BLEND, i);
        glColorMaski(i, i % 2, i % 3 == 0, 1, i % 2 == 0);
        glBlendFuncSeparatei(i, GL_DST_COLOR, GL_SRC_ALPHA, GLenum(i % 2 ? GL_ONE : GL_ZERO), GL_DST_ALPHA);
        glBlendEquationSeparatei(i, GL_FUNC_SUBTRACT, GLenum(i % 2 ? GL_MAX : GL_MIN));
    }
    glDepthFunc(GL_ALWAYS), glDepthMask(GL_TRUE), glCullFace(GL_FRONT_AND_BACK), glFrontFace(GL_CW), glPolygonOffset(3, 4), glSampleCoverage(0.0f, GL_FALSE);
    glViewport(0, 0, 33, 33), glScissor(0, 0, 20, 33);
    for (const GLenum what : {GL_DEPTH_TEST, GL_SCISSOR_TEST, GL_CULL_FACE, GL_RASTERIZER_DISCARD, GL_POLYGON_OFFSET_FILL, GL_SAMPLE_ALPHA_TO_COVERAGE,
                              GL_SAMPLE_COVERAGE, GL_PRIMITIVE_RESTART_FIXED_INDEX})
        glEnable(what);
    glClearColor(0.1f, 0.2f, 0.3f, 0.4f);
}

} // namespace

TEST_CASE("ES: the host's state is the same before and after, in 3.2 with states of each draw buffer and in 3.0 without; what applies shows")
{
    if (!haveGl(HeadlessKind::kEglEs)) return;
    for (const SplatAsset& asset : {shining(), waxen()})
        for (const bool indexed : {true, false}) {
            CAPTURE(asset.model);
            CAPTURE(indexed);
            extensionShown = "GL_EXT_color_buffer_float";
            Host host(HostOptions{.kind = HeadlessKind::kEglEs, .getProcAddress = indexed ? HeadlessGl::getProcAddress : olderEs});
            if (indexed && glVersion() < 32) {
                MESSAGE("SKIPPED: states of draw buffers need ES 3.2");
                continue;
            }
            NacreDrawDesc desc = describe(front());
            desc.depthTest = 1;
            host.setLights(kLamp);
            host.load(asset);
            Image expected;
            {
                const EsTarget plain;
                glViewport(0, 0, 33, 33);
                REQUIRE_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
                expected = plain.read(0);
                CHECK(largest(expected) > 0.1f);
            }
            for (int y = 0; y < 33; ++y) // colour mask and scissor
                for (int x = 0; x < 33; ++x)
                    for (int c = 0; c < 4; ++c)
                        if (c == 0 || x >= 20) expected.pixel(x, y)[c] = 0;
            const EsTarget target;
            scrambleEs(indexed);
            REQUIRE(glGetError() == GL_NO_ERROR);
            const auto before = snapshotEs(indexed);
            REQUIRE(glGetError() == GL_NO_ERROR);
            const NacreInstance second = host.place(asset);
            const NacreView view = host.addView();
            NacreDrawDesc only = describe(front(), {&second, 1});
            only.depthTest = 1;
            REQUIRE(nacreViewPrepare(view, &only, 8) == NACRE_OK);
            REQUIRE_MESSAGE(nacreViewDraw(view, &only) == NACRE_OK, host.lastMessage());
            CHECK(glGetError() == GL_NO_ERROR);
            const auto after = snapshotEs(indexed);
            for (const auto& [name, value] : before) {
                CAPTURE(name);
                CHECK(after.at(name) == value);
            }
            CHECK(largestDifference(target.read(0), expected) == 0.0f);
            for (const float v : target.read(1).rgba) REQUIRE(v == 0.5f);
            CHECK(glGetError() == GL_NO_ERROR);
        }
}

namespace {

enum class EsDepth { kRenderbuffer, kTexture, kFirstLayer, kSecondLayer, kFace, kSamples };

/// What is drawn over such a depth buffer, which hides everything in the left half.
Image drawOverDepth(const Host& host, EsDepth kind)
{
    GLuint framebuffers[2], colors[2], depth = 0;
    const int samples = kind == EsDepth::kSamples ? 4 : 0;
    const bool texture = kind != EsDepth::kRenderbuffer && kind != EsDepth::kSamples;
    glGenFramebuffers(2, framebuffers);
    glGenRenderbuffers(2, colors);
    for (const int i : {1, 0}) { // what is drawn into, and where its samples are resolved
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffers[i]);
        glBindRenderbuffer(GL_RENDERBUFFER, colors[i]);
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, i == 0 ? samples : 0, GL_RGBA16F, 33, 33);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, colors[i]);
    }
    if (!texture) {
        glGenRenderbuffers(1, &depth);
        glBindRenderbuffer(GL_RENDERBUFFER, depth);
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, GL_DEPTH_COMPONENT24, 33, 33);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, depth);
    } else {
        glGenTextures(1, &depth);
        const GLenum target = kind == EsDepth::kTexture ? GL_TEXTURE_2D : kind == EsDepth::kFace ? GL_TEXTURE_CUBE_MAP : GL_TEXTURE_2D_ARRAY;
        glBindTexture(target, depth);
        if (target == GL_TEXTURE_2D_ARRAY) {
            glTexStorage3D(target, 1, GL_DEPTH_COMPONENT24, 33, 33, 2);
            glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, depth, 0, kind == EsDepth::kSecondLayer);
        } else {
            glTexStorage2D(target, 1, GL_DEPTH_COMPONENT24, 33, 33);
            glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, target == GL_TEXTURE_2D ? target : GL_TEXTURE_CUBE_MAP_NEGATIVE_Y, depth, 0);
        }
    }
    REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
    const float black[4] = {0, 0, 0, 0}, near = 0, far = 1;
    glClearBufferfv(GL_COLOR, 0, black), glClearBufferfv(GL_DEPTH, 0, &far);
    glEnable(GL_SCISSOR_TEST);
    glScissor(0, 0, 16, 33);
    glClearBufferfv(GL_DEPTH, 0, &near);
    glDisable(GL_SCISSOR_TEST);
    glViewport(0, 0, 33, 33);
    NacreDrawDesc desc = describe(front());
    desc.depthTest = 1;
    for (int i = 0; i < 2; ++i) { // at rest the depth buffer is known already
        glClearBufferfv(GL_COLOR, 0, black);
        CHECK_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
        CHECK(glGetError() == GL_NO_ERROR);
    }
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffers[1]);
    glBlitFramebuffer(0, 0, 33, 33, 0, 0, 33, 33, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffers[1]);
    Image image{33, 33, std::vector<float>(4 * 33 * 33)};
    glReadPixels(0, 0, 33, 33, GL_RGBA, GL_FLOAT, image.rgba.data());
    glDeleteFramebuffers(2, framebuffers);
    glDeleteRenderbuffers(2, colors);
    texture ? glDeleteTextures(1, &depth) : glDeleteRenderbuffers(1, &depth);
    CHECK(glGetError() == GL_NO_ERROR);
    return image;
}

} // namespace

TEST_CASE("ES: splats are tested against depth in a renderbuffer, a texture, a layer, a face and samples, although 3.0 cannot tell the first three apart")
{
    if (!haveGl(HeadlessKind::kEglEs)) return;
    extensionShown = "GL_EXT_color_buffer_float";
    for (const bool to3 : {true, false})
        for (const SplatAsset& asset : {shining(), waxen()}) {
            CAPTURE(asset.model);
            CAPTURE(to3);
            Host host(HostOptions{.kind = HeadlessKind::kEglEs, .getProcAddress = to3 ? olderEs : HeadlessGl::getProcAddress});
            host.load(asset);
            host.setLights(kLamp);
            const Image expected = drawOverDepth(host, EsDepth::kRenderbuffer);
            CHECK(largest(expected) > 0.1f);
            for (int y = 0; y < 33; ++y) REQUIRE(expected.pixel(8, y)[3] == 0.0f);
            for (const EsDepth kind : {EsDepth::kTexture, EsDepth::kFirstLayer, EsDepth::kFirstLayer, EsDepth::kTexture, EsDepth::kSecondLayer, EsDepth::kFace, EsDepth::kSamples}) {
                CAPTURE(int(kind)); // names come again for other things: what was known of one is wrong
                CHECK(largestDifference(drawOverDepth(host, kind), expected) <= (kind == EsDepth::kSamples ? 2e-2f : 0.0f)); // edges of quads, by sample
            }
        }
}

// ---- hosts that restore their own state ---------------------------------------------------------------------------------------

static size_t questions = 0;
static void* countQuestions(const char* name, void* user)
{
#define COUNT(function, ...)                                                                                                     \
    if (std::strcmp(name, #function) == 0) {                                                                                     \
        static constexpr auto kCall = __VA_ARGS__;                                                                               \
        return reinterpret_cast<void*>(+kCall);                                                                                  \
    }
    COUNT(glGetIntegerv, [](GLenum what, GLint* v) { ++questions, glGetIntegerv(what, v); })
    COUNT(glGetFloatv, [](GLenum what, GLfloat* v) { ++questions, glGetFloatv(what, v); })
    COUNT(glGetBooleanv, [](GLenum what, GLboolean* v) { ++questions, glGetBooleanv(what, v); })
    COUNT(glGetIntegeri_v, [](GLenum what, GLuint i, GLint* v) { ++questions, glGetIntegeri_v(what, i, v); })
    COUNT(glGetBooleani_v, [](GLenum what, GLuint i, GLboolean* v) { ++questions, glGetBooleani_v(what, i, v); })
    COUNT(glIsEnabled, [](GLenum what) { return ++questions, glIsEnabled(what); })
    COUNT(glIsEnabledi, [](GLenum what, GLuint i) { return ++questions, glIsEnabledi(what, i); })
#undef COUNT
    return HeadlessGl::getProcAddress(name, user);
}

TEST_CASE("for a host that restores its own state hardly anything is read, the picture is the same, and what applies still does")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : {shining(), waxen()}) {
        CAPTURE(asset.model);
        Image images[2];
        size_t asked[2];
        for (const bool own : {false, true}) {
            Host host(HostOptions{.flags = own ? uint32_t(NACRE_HOST_RESTORES_STATE) : 0, .getProcAddress = countQuestions});
            host.load(asset);
            host.setLights(kLamp);
            NacreDrawDesc desc = describe(front());
            desc.depthTest = 1;
            for (int i = 0; i < 4; ++i) {
                REQUIRE(host.gl->beginFrame(33, 33));
                glEnable(GL_SCISSOR_TEST); // what a host sets for the draw, each time
                glScissor(0, 0, 20, 33);
                glColorMask(GL_FALSE, GL_TRUE, GL_TRUE, GL_TRUE);
                glBindVertexArray(0);
                glEnable(GL_CULL_FACE), glCullFace(GL_FRONT_AND_BACK), glEnable(GL_RASTERIZER_DISCARD), glEnable(GL_DEPTH_TEST), glEnable(GL_SAMPLE_COVERAGE);
                glSampleCoverage(0.0f, GL_FALSE);
                glPixelStorei(GL_UNPACK_ROW_LENGTH, 77);
                questions = 0;
                REQUIRE_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
                asked[own] = questions;
                CHECK(glGetError() == GL_NO_ERROR);
                GLint framebuffer = 0;
                glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer);
                CHECK((framebuffer != 0 || own));
                glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
                for (const GLenum what : {GL_SCISSOR_TEST, GL_CULL_FACE, GL_RASTERIZER_DISCARD, GL_DEPTH_TEST, GL_SAMPLE_COVERAGE}) glDisable(what);
                images[own] = host.gl->readFrame();
            }
        }
        CHECK(largest(images[0]) > 0.1f);
        CHECK(largestDifference(images[0], images[1]) == 0.0f);
        CHECK(images[1].pixel(25, 16)[3] == 0.0f);
        CHECK(images[1].pixel(16, 16)[0] == 0.0f);
        CHECK(images[1].pixel(16, 16)[3] > 0.0f);
        MESSAGE(asset.model, ": gets of a draw at rest: ", asked[0], ", with NACRE_HOST_RESTORES_STATE ", asked[1]);
        CHECK(asked[1] < 16);
    }
}
