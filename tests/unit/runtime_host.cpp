// Whatever a host leaves bound, switched on or running around a draw: the picture is right, or a message says why there is none; and
// nothing wrong is kept for later draws.
#include "runtime_fixture.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include <functional>
#include <utility>

using namespace nacre;
using namespace nacre::test;

namespace {

constexpr int kSize = 33;
const std::vector<Light> kLamp = {pointLight({1, 1, 2}, glm::vec3(3))};
Camera front() { return lookAt({0, 0, 2}, {0, 0, 0}, kSize, kSize, 40); }

std::vector<SplatAsset> assets() { return {withSharp(randomAsset(60, 9, 4), kAllSharp, 4), randomSss(60, kAllSss, 4)}; }

int glVersion()
{
    GLint major = 0, minor = 0;
    glGetIntegerv(GL_MAJOR_VERSION, &major);
    glGetIntegerv(GL_MINOR_VERSION, &minor);
    return 10 * major + minor;
}

Image readBound()
{
    Image image{kSize, kSize, std::vector<float>(4 * kSize * kSize)};
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    glReadPixels(0, 0, kSize, kSize, GL_RGBA, GL_FLOAT, image.rgba.data());
    return image;
}

/// A framebuffer that a test fills. Bound; deleted, with what hangs on it, at scope exit.
struct Target {
    GLuint framebuffer = 0;
    std::vector<GLuint> textures, renderbuffers;
    Target()
    {
        glGenFramebuffers(1, &framebuffer);
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
        glViewport(0, 0, kSize, kSize);
    }
    ~Target()
    {
        glDeleteFramebuffers(1, &framebuffer);
        glDeleteTextures(GLsizei(textures.size()), textures.data());
        glDeleteRenderbuffers(GLsizei(renderbuffers.size()), renderbuffers.data());
    }
    GLuint texture(GLenum target, GLenum format, int layers, int levels = 1)
    {
        const bool depth = format != GL_RGBA32F && format != GL_RGBA16F;
        const GLenum layout = depth ? GL_DEPTH_COMPONENT : GL_RGBA, type = depth ? GL_UNSIGNED_INT : GL_FLOAT;
        GLuint name = 0;
        glGenTextures(1, &name);
        textures.push_back(name);
        glBindTexture(target, name);
        for (int level = 0; level < levels; ++level) {
            const int side = kSize << (levels - 1 - level);
            if (target == GL_TEXTURE_2D) glTexImage2D(target, level, GLint(format), side, side, 0, layout, type, nullptr);
            else if (target == GL_TEXTURE_CUBE_MAP)
                for (GLenum face = 0; face < 6; ++face)
                    glTexImage2D(GL_TEXTURE_CUBE_MAP_POSITIVE_X + face, level, GLint(format), side, side, 0, layout, type, nullptr);
            else glTexImage3D(target, level, GLint(format), side, side, layers, 0, layout, type, nullptr);
        }
        glTexParameteri(target, GL_TEXTURE_MAX_LEVEL, levels - 1);
        return name;
    }
    void renderbuffer(GLenum attachment, GLenum format, int samples = 0)
    {
        GLuint name = 0;
        glGenRenderbuffers(1, &name);
        renderbuffers.push_back(name);
        glBindRenderbuffer(GL_RENDERBUFFER, name);
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, format, kSize, kSize);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachment, GL_RENDERBUFFER, name);
    }
};

/// Clears to black, with depth that hides everything in the left half.
void clearHalfHidden()
{
    glClearColor(0, 0, 0, 0);
    glClearDepth(1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glEnable(GL_SCISSOR_TEST);
    glScissor(0, 0, kSize / 2, kSize);
    glClearDepth(0);
    glClear(GL_DEPTH_BUFFER_BIT);
    glDisable(GL_SCISSOR_TEST);
    glEnable(GL_DEPTH_TEST);
}

NacreDrawDesc depthTested()
{
    NacreDrawDesc desc = describe(front());
    desc.depthTest = 1;
    return desc;
}

} // namespace

// ---- depth --------------------------------------------------------------------------------------------------------------------

TEST_CASE("splats are tested against the image that is attached, whatever texture it is a layer, face or level of")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        host.setLights(kLamp);
        const NacreDrawDesc desc = depthTested();
        const auto shoot = [&](const char* what, const std::function<void(Target&)>& attach) {
            CAPTURE(what);
            Target target;
            attach(target);
            REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
            clearHalfHidden();
            CHECK_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
            CHECK(glGetError() == GL_NO_ERROR);
            glDisable(GL_DEPTH_TEST);
            return readBound();
        };
        const Image expected = shoot("renderbuffers", [](Target& t) {
            t.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA32F);
            t.renderbuffer(GL_DEPTH_ATTACHMENT, GL_DEPTH_COMPONENT24);
        });
        CHECK(largest(expected) > 0.1f);
        CHECK(expected.pixel(kSize / 4, kSize / 2)[3] == 0.0f);
        const auto same = [&](const char* what, const std::function<void(Target&)>& attach) { CHECK(largestDifference(shoot(what, attach), expected) < 1e-5f); };
        for (const int layer : {0, 1})
            same("a layer of arrays, as for the eyes of a headset", [&](Target& t) {
                glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, t.texture(GL_TEXTURE_2D_ARRAY, GL_RGBA32F, 2), 0, layer);
                glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, t.texture(GL_TEXTURE_2D_ARRAY, GL_DEPTH_COMPONENT32F, 2), 0, layer);
            });
        same("an array of one layer", [](Target& t) {
            t.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA32F);
            glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, t.texture(GL_TEXTURE_2D_ARRAY, GL_DEPTH_COMPONENT24, 1), 0, 0);
        });
        for (const GLenum kind : {GL_TEXTURE_2D_ARRAY, GL_TEXTURE_CUBE_MAP})
            same("all layers at once", [&](Target& t) {
                glFramebufferTexture(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, t.texture(kind, GL_RGBA32F, 2), 0);
                glFramebufferTexture(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, t.texture(kind, GL_DEPTH_COMPONENT24, 2), 0);
            });
        for (const GLenum face : {GL_TEXTURE_CUBE_MAP_POSITIVE_X, GL_TEXTURE_CUBE_MAP_NEGATIVE_Z})
            same("a face", [&](Target& t) {
                glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, face, t.texture(GL_TEXTURE_CUBE_MAP, GL_RGBA32F, 1), 0);
                glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, face, t.texture(GL_TEXTURE_CUBE_MAP, GL_DEPTH_COMPONENT24, 1), 0);
            });
        if (glVersion() >= 40)
            same("a face of an array of cubes", [](Target& t) {
                glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, t.texture(GL_TEXTURE_CUBE_MAP_ARRAY, GL_RGBA32F, 6), 0, 0);
                glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, t.texture(GL_TEXTURE_CUBE_MAP_ARRAY, GL_DEPTH_COMPONENT24, 6), 0, 0);
            });
        same("a level", [](Target& t) {
            glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, t.texture(GL_TEXTURE_2D, GL_RGBA32F, 1, 3), 2);
            glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, t.texture(GL_TEXTURE_2D, GL_DEPTH_COMPONENT24, 1, 3), 2);
        });
        same("a level of a layer", [](Target& t) {
            t.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA32F);
            glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, t.texture(GL_TEXTURE_2D_ARRAY, GL_DEPTH_COMPONENT24, 3, 2), 1, 0);
        });
    }
}

static bool liesAboutDepth = false, noBlits = false, blitFailed = false;
static void* depthLiar(const char* name, void* user)
{
    static constexpr auto kParameter = [](GLenum target, GLenum attachment, GLenum what, GLint* value) {
        glGetFramebufferAttachmentParameteriv(target, attachment, what, value);
        if (liesAboutDepth && what == GL_FRAMEBUFFER_ATTACHMENT_DEPTH_SIZE) *value = 32; // a driver that pads
    };
    static constexpr auto kBlit = [](GLint x0, GLint y0, GLint x1, GLint y1, GLint u0, GLint v0, GLint u1, GLint v1, GLbitfield mask, GLenum filter) {
        blitFailed = noBlits;
        if (!noBlits) glBlitFramebuffer(x0, y0, x1, y1, u0, v0, u1, v1, mask, filter);
    };
    static constexpr auto kError = []() -> GLenum { return std::exchange(blitFailed, false) ? GL_INVALID_OPERATION : glGetError(); };
    if (std::strcmp(name, "glGetFramebufferAttachmentParameteriv") == 0) return reinterpret_cast<void*>(+kParameter);
    if (std::strcmp(name, "glBlitFramebuffer") == 0) return reinterpret_cast<void*>(+kBlit);
    if (std::strcmp(name, "glGetError") == 0) return reinterpret_cast<void*>(+kError);
    return HeadlessGl::getProcAddress(name, user);
}

TEST_CASE("multisampled depth hides splats in any format, also if its sizes mislead; what cannot be copied is refused, without a GL error")
{
    if (!haveGl()) return;
    Host host(randomSss(60, kAllSss, 4), depthLiar);
    host.setLights(kLamp);
    const NacreDrawDesc desc = depthTested();
    const auto shoot = [&](GLenum format) {
        const bool stencil = format == GL_DEPTH24_STENCIL8 || format == GL_DEPTH32F_STENCIL8;
        Target resolved;
        resolved.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA32F);
        Target target;
        target.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA32F, 4);
        target.renderbuffer(stencil ? GL_DEPTH_STENCIL_ATTACHMENT : GL_DEPTH_ATTACHMENT, format, 4);
        REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
        clearHalfHidden();
        const NacreResult result = nacreViewDraw(host.view, &desc);
        CHECK(glGetError() == GL_NO_ERROR);
        CHECK_FALSE(blitFailed);
        glDisable(GL_DEPTH_TEST);
        glBindFramebuffer(GL_DRAW_FRAMEBUFFER, resolved.framebuffer);
        glBlitFramebuffer(0, 0, kSize, kSize, 0, 0, kSize, kSize, GL_COLOR_BUFFER_BIT, GL_NEAREST);
        glBindFramebuffer(GL_READ_FRAMEBUFFER, resolved.framebuffer);
        return std::pair(result, readBound());
    };
    liesAboutDepth = noBlits = false;
    const auto [result, expected] = shoot(GL_DEPTH_COMPONENT24);
    REQUIRE(result == NACRE_OK);
    CHECK(expected.pixel(kSize / 4, kSize / 2)[3] == 0.0f);
    CHECK(largest(expected) > 0.1f);
    for (const bool lies : {false, true})
        for (const GLenum format : {GL_DEPTH_COMPONENT16, GL_DEPTH_COMPONENT24, GL_DEPTH24_STENCIL8, GL_DEPTH_COMPONENT32F, GL_DEPTH32F_STENCIL8}) {
            CAPTURE(lies);
            CAPTURE(format);
            liesAboutDepth = lies;
            const auto [r, image] = shoot(format);
            CHECK(r == NACRE_OK);
            CHECK(largestDifference(image, expected) < 1e-5f);
        }
    liesAboutDepth = false, noBlits = true;
    host.messages.clear();
    CHECK(shoot(GL_DEPTH_COMPONENT16).first == NACRE_ERROR_UNSUPPORTED);
    CHECK(host.messages.size() == 1);
    CHECK_MESSAGE(host.lastMessage().find("4 samples") != std::string::npos, host.lastMessage());
    noBlits = false;
    CHECK(shoot(GL_DEPTH_COMPONENT24).first == NACRE_OK);
}

// ---- bright light -------------------------------------------------------------------------------------------------------------

TEST_CASE("a million times the light is a million times the picture in a float target, with few lights and with many, and finite in a half one")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets())
        for (const size_t count : {2, 11, 12, 40}) {
            CAPTURE(asset.model);
            CAPTURE(count);
            Host host(asset);
            std::vector<Light> lights, bright;
            for (size_t i = 0; i < count; ++i) lights.push_back(directionalLight({std::sin(float(i)), std::cos(float(i)), 0.7f}, {0.4f, 0.3f, 0.5f}));
            for (Light light : lights) light.intensity *= 1e6f, bright.push_back(light);
            const Image image = host.draw(front(), lights);
            Image dimmed = host.draw(front(), bright);
            CHECK(largest(dimmed) > 1e5f);
            for (size_t i = 0; i < dimmed.rgba.size(); ++i)
                if (i % 4 < 3) dimmed.rgba[i] *= 1e-6f;
            CHECK(largestDifference(dimmed, image) < 4e-3f * largest(image)); // layers of half floats against layers of floats

            Target half;
            half.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA16F);
            glClear(GL_COLOR_BUFFER_BIT);
            const NacreDrawDesc desc = describe(front());
            REQUIRE(nacreViewDraw(host.view, &desc) == NACRE_OK);
            const Image clamped = readBound();
            CHECK(allFinite(clamped));
            CHECK(largest(clamped) > 3e4f);
        }
}

TEST_CASE("an asset of any size shows the same picture")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        const std::vector<Light> sun = {directionalLight({0.3f, 0.5f, 1}, glm::vec3(1))};
        const Image expected = host.draw(front(), sun);
        for (const float scale : {1e-4f, 1e6f}) { // worldFromAsset takes it back
            CAPTURE(scale);
            SplatAsset scaled = asset;
            for (glm::vec3& p : scaled.cloud.positions) p *= scale;
            for (glm::vec3& s : scaled.cloud.scales) s *= scale;
            for (Channel& c : scaled.channels)
                if (c.name == "network") c.values.back() /= scale; // 1 / half-size
            host.load(scaled);
            host.setLights(sun);
            host.moveTo(glm::scale(glm::dmat4(1), glm::dvec3(1 / double(scale))));
            CHECK(largestDifference(host.draw(front()), expected) < 2e-3f);
        }
    }
}

// ---- what drops or alters draws -----------------------------------------------------------------------------------------------

TEST_CASE("what a failed conditional render drops is not kept for results: the next draw is right")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host fresh(asset), host(asset);
        const NacreDrawDesc desc = describe(front());
        const std::vector<Light> other = {pointLight({-1, 0.5f, 1.5f}, glm::vec3(2))};
        const Image expected = fresh.draw(front(), kLamp), expectedOther = fresh.draw(front(), other);
        host.gl->makeCurrent();
        GLuint nothing = 0;
        glGenQueries(1, &nothing);
        const auto occluded = [&](const NacreDrawDesc& d) {
            REQUIRE(host.gl->beginFrame(kSize, kSize));
            glBeginConditionalRender(nothing, GL_QUERY_WAIT);
            CHECK(nacreViewDraw(host.view, &d) == NACRE_OK);
            glEndConditionalRender();
        };
        REQUIRE(host.gl->beginFrame(kSize, kSize));
        glBeginQuery(GL_SAMPLES_PASSED, nothing);
        glEndQuery(GL_SAMPLES_PASSED);

        host.setLights(kLamp);
        occluded(desc); // the first draw of all
        CHECK(largest(host.gl->readFrame()) == 0.0f);
        CHECK(largestDifference(host.draw(front()), expected) == 0.0f);

        host.setLights(other); // a light moves behind the wall, for many frames, with none between them and the next draw that shows
        for (int i = 0; i < 12; ++i) occluded(desc);
        CHECK(largestDifference(host.draw(front()), expectedOther) == 0.0f);

        host.setLights(kLamp); // as does the camera
        NacreDrawDesc moved = desc;
        moved.viewFromWorld[12] += 0.1f;
        occluded(moved);
        occluded(desc);
        CHECK(largestDifference(host.draw(front()), expected) == 0.0f);
        host.draw(front());
        host.draw(front());
        CHECK(host.stats().lightPassesRun == 0); // and then it rests
        CHECK(host.stats().combinePassesRun == 0);

        host.setLights(other); // prepared outside, the passes count
        REQUIRE(nacreViewPrepare(host.view, &desc, 0) == NACRE_OK);
        glFinish();
        occluded(desc);
        CHECK(host.stats().lightPassesRun == 0);
        CHECK(largestDifference(host.draw(front()), expectedOther) == 0.0f);
        glDeleteQueries(1, &nothing);
        CHECK(glGetError() == GL_NO_ERROR);
    }
}

TEST_CASE("queries, transform feedback and a program pipeline that the host has running stay its own")
{
    if (!haveGl()) return;
    static const char* vertex = "#version 330 core\nout float captured; void main() { gl_Position = vec4(0, 0, 0, 1); captured = 7.0; }";
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset);
        if (glVersion() < 41) {
            MESSAGE("SKIPPED: pausing transform feedback and pipelines needs GL 4.1");
            return;
        }
        const Image expected = host.draw(front(), kLamp);
        const GLuint shader = glCreateShader(GL_VERTEX_SHADER), program = glCreateProgram();
        glShaderSource(shader, 1, &vertex, nullptr);
        glCompileShader(shader);
        glAttachShader(program, shader);
        const char* varying = "captured";
        glTransformFeedbackVaryings(program, 1, &varying, GL_INTERLEAVED_ATTRIBS);
        glLinkProgram(program);
        GLuint buffer = 0, queries[2], pipeline = 0, vertexArray = 0;
        glGenBuffers(1, &buffer);
        glBindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, buffer);
        glBufferData(GL_TRANSFORM_FEEDBACK_BUFFER, 4096, nullptr, GL_DYNAMIC_READ);
        glGenQueries(2, queries);
        glGenProgramPipelines(1, &pipeline);
        glGenVertexArrays(1, &vertexArray);
        const NacreInstance second = host.place(asset);
        REQUIRE(host.gl->beginFrame(kSize, kSize));

        glBindVertexArray(vertexArray);
        glUseProgram(program);
        glBeginQuery(GL_PRIMITIVES_GENERATED, queries[0]); // the same as ours
        glBeginQuery(GL_TRANSFORM_FEEDBACK_PRIMITIVES_WRITTEN, queries[1]);
        glBeginTransformFeedback(GL_POINTS);
        glDrawArrays(GL_POINTS, 0, 1);
        const NacreDrawDesc desc = describe(front(), {&second, 1});
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_OK);
        CHECK(glGetError() == GL_NO_ERROR);
        glDrawArrays(GL_POINTS, 0, 1);
        glEndTransformFeedback();
        glEndQuery(GL_PRIMITIVES_GENERATED);
        glEndQuery(GL_TRANSFORM_FEEDBACK_PRIMITIVES_WRITTEN);
        CHECK(glGetError() == GL_NO_ERROR);
        GLuint written = 0;
        glGetQueryObjectuiv(queries[1], GL_QUERY_RESULT, &written);
        CHECK(written == 2);

        glUseProgram(0);
        glBindProgramPipeline(pipeline);
        REQUIRE(host.gl->beginFrame(kSize, kSize));
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_OK);
        CHECK(largestDifference(host.gl->readFrame(), expected) == 0.0f);
        GLint bound = 0;
        glGetIntegerv(GL_PROGRAM_PIPELINE_BINDING, &bound);
        CHECK(GLuint(bound) == pipeline);
        CHECK(glGetError() == GL_NO_ERROR);
    }
}

// ---- other contexts -----------------------------------------------------------------------------------------------------------

namespace {

/// A context of its own kind beside the one that is current; leaves that current.
class OtherContext {
public:
    OtherContext(EGLContext share, bool compatibility)
        : display_(eglGetCurrentDisplay()), first_(eglGetCurrentContext())
    {
        const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 3, EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                     compatibility ? EGL_CONTEXT_OPENGL_COMPATIBILITY_PROFILE_BIT : EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
        eglBindAPI(EGL_OPENGL_API);
        context_ = eglCreateContext(display_, EGL_NO_CONFIG_KHR, share, attributes);
    }
    ~OtherContext()
    {
        first();
        if (context_ != EGL_NO_CONTEXT) eglDestroyContext(display_, context_);
    }
    OtherContext(const OtherContext&) = delete;
    bool made() const { return context_ != EGL_NO_CONTEXT; }
    void other() { REQUIRE(eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_)); }
    void first() { eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, first_); }
    void none() { eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT); }

private:
    EGLDisplay display_;
    EGLContext first_, context_;
};

/// In a context that has nothing yet: a view that sees the asset.
NacreView placeAlone(NacreContext context, const SplatAsset& source)
{
    const auto bytes = encodeAsset(source);
    NacreInstanceDesc desc{};
    desc.structSize = sizeof desc;
    NacreInstance instance{};
    NacreView view{};
    REQUIRE(nacreAssetCreate(context, bytes->data(), bytes->size(), &desc.asset) == NACRE_OK);
    REQUIRE(nacreInstanceCreate(&desc, &instance) == NACRE_OK);
    REQUIRE(nacreViewCreate(context, nullptr, &view) == NACRE_OK);
    return view;
}

constexpr GLenum kAlphaTest = 0x0BC0, kPolygonStipple = 0x0B42, kClampFragmentColor = 0x891B, kFixedOnly = 0x891D; // compatibility profile

} // namespace

TEST_CASE("what only a compatibility profile has does not show in the picture, nor in those that follow, and is put back")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host core(asset);
        const Image expected = core.draw(front(), kLamp);
        OtherContext legacy(EGL_NO_CONTEXT, true);
        if (!legacy.made()) {
            MESSAGE("SKIPPED: no compatibility profile");
            return;
        }
        legacy.other();
        const auto alphaFunc = reinterpret_cast<void (*)(GLenum, GLfloat)>(eglGetProcAddress("glAlphaFunc"));
        const auto stipple = reinterpret_cast<void (*)(const GLubyte*)>(eglGetProcAddress("glPolygonStipple"));
        NacreContextDesc contextDesc{};
        contextDesc.structSize = sizeof contextDesc, contextDesc.getProcAddress = HeadlessGl::getProcAddress;
        NacreContext context{};
        REQUIRE(nacreContextCreate(&contextDesc, &context) == NACRE_OK);
        {
            Target target;
            target.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA32F);
            const NacreView drawn = placeAlone(context, asset);
            const NacreLight lamp = toNacre(kLamp[0]);
            REQUIRE(nacreContextSetLights(context, &lamp, 1) == NACRE_OK);
            const GLubyte holes[128] = {};
            glEnable(kAlphaTest);
            alphaFunc(GL_GREATER, 0.5f);
            glEnable(kPolygonStipple);
            stipple(holes);
            glClampColor(kClampFragmentColor, GL_TRUE);
            const NacreDrawDesc desc = describe(front());
            for (int i = 0; i < 2; ++i) {
                glClearColor(0, 0, 0, 0);
                glClear(GL_COLOR_BUFFER_BIT);
                CHECK(nacreViewDraw(drawn, &desc) == NACRE_OK);
                Image image = readBound();
                for (int y = 0; y < kSize / 2; ++y) std::swap_ranges(image.pixel(0, y), image.pixel(0, y) + 4 * kSize, image.pixel(0, kSize - 1 - y));
                CHECK(largestDifference(image, expected) == 0.0f);
                if (i == 1) break;
                GLint clamp = 0;
                glGetIntegerv(kClampFragmentColor, &clamp);
                CHECK(clamp == GL_TRUE);
                CHECK(glIsEnabled(kAlphaTest));
                CHECK(glIsEnabled(kPolygonStipple));
                glDisable(kAlphaTest);
                glDisable(kPolygonStipple);
                glClampColor(kClampFragmentColor, kFixedOnly);
            }
            CHECK(glGetError() == GL_NO_ERROR);
        }
        nacreContextDestroy(context);
    }
}

TEST_CASE("in another context, sharing or not, or in none, calls fail with the cause, touch nothing, and work again in their own")
{
    if (!haveGl()) return;
    for (const bool sharing : {true, false}) {
        CAPTURE(sharing);
        const SplatAsset asset = randomSss(60, kAllSss, 4);
        Host host(asset);
        const Image expected = host.draw(front(), kLamp);
        const NacreDrawDesc desc = describe(front());
        const auto bytes = encodeAsset(asset);
        OtherContext window(sharing ? eglGetCurrentContext() : EGL_NO_CONTEXT, false);
        REQUIRE(window.made());
        const auto refused = [&](const char* cause) {
            host.messages.clear();
            NacreAsset made{};
            CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_GL);
            CHECK(nacreViewPrepare(host.view, &desc, 0) == NACRE_ERROR_GL);
            CHECK(nacreAssetCreate(host.context, bytes->data(), bytes->size(), &made) == NACRE_ERROR_GL);
            CHECK(made.id == 0);
            CHECK(host.messages.size() == 3);
            CHECK_MESSAGE(host.lastMessage().find(cause) != std::string::npos, host.lastMessage());
        };
        window.none();
        refused("no OpenGL context is current");

        window.other();
        NacreContextDesc contextDesc{};
        contextDesc.structSize = sizeof contextDesc, contextDesc.getProcAddress = HeadlessGl::getProcAddress;
        NacreContext context{};
        REQUIRE(nacreContextCreate(&contextDesc, &context) == NACRE_OK);
        const NacreView own = placeAlone(context, asset);
        {
            Target target;
            target.renderbuffer(GL_COLOR_ATTACHMENT0, GL_RGBA32F);
            glClearColor(0, 0, 0, 0);
            glClear(GL_COLOR_BUFFER_BIT);
            refused("another OpenGL context is current");
            CHECK(largest(readBound()) == 0.0f);
            GLint vertexArray = -1, bound = 0;
            glGetIntegerv(GL_VERTEX_ARRAY_BINDING, &vertexArray);
            CHECK(vertexArray == 0);

            window.first();
            const NacreAsset doomed = host.create(asset);
            const NacreInstance doomedInstance = host.place(doomed);
            const NacreView doomedView = host.addView();
            CHECK(nacreViewDraw(doomedView, &desc) == NACRE_OK);
            window.other();
            const auto forgets = [&](const char* function) {
                CHECK_MESSAGE(host.lastMessage().find(std::string(function) + " frees no GL objects") != std::string::npos, host.lastMessage());
                CHECK(host.messages.size() == 1);
                host.messages.clear();
            };
            host.messages.clear();
            nacreViewDestroy(doomedView), forgets("nacreViewDestroy");
            nacreInstanceDestroy(doomedInstance), forgets("nacreInstanceDestroy");
            nacreAssetDestroy(doomed), forgets("nacreAssetDestroy");
            glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &bound);
            CHECK(GLuint(bound) == target.framebuffer);
            CHECK(nacreViewDraw(own, &desc) == NACRE_OK);
            CHECK(glGetError() == GL_NO_ERROR);
        }
        nacreContextDestroy(context);
        window.first();
        CHECK(largestDifference(host.draw(front()), expected) == 0.0f);
        CHECK(glGetError() == GL_NO_ERROR);
    }
}

// ---- ahead of draws -----------------------------------------------------------------------------------------------------------

static int links = 0;
static void* countLinks(const char* name, void* user)
{
    static constexpr auto kLink = [](GLuint program) { ++links, glLinkProgram(program); };
    if (std::strcmp(name, "glLinkProgram") == 0) return reinterpret_cast<void*>(+kLink);
    return HeadlessGl::getProcAddress(name, user);
}

TEST_CASE("a view prepared for so many lights links no program in draws with any number up to that, nor for another asset of the same kind")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : assets()) {
        CAPTURE(asset.model);
        Host host(asset, countLinks);
        host.setLights(std::vector<Light>(20, kLamp[0]));
        const NacreDrawDesc desc = describe(front());
        REQUIRE(nacreViewPrepare(host.view, &desc, 60) == NACRE_OK); // without any framebuffer
        glFinish();
        const int before = links;
        host.draw(front());
        CHECK(host.stats().lightPassesRun == 0);
        CHECK(host.stats().combinePassesRun == 0);
        CHECK(host.stats().sorted == 0);
        for (const size_t lights : {0, 1, 2, 3, 5, 6, 9, 11, 12, 20, 30, 35, 36, 47, 60}) {
            host.draw(front(), std::vector<Light>(lights, kLamp[0]));
            CHECK(links == before);
        }
        Host other(asset);
        CHECK(largestDifference(host.draw(front(), kLamp), other.draw(front(), kLamp)) == 0.0f);
        SplatAsset half = asset; // the same channels, other numbers
        for (float& opacity : half.cloud.opacities) opacity *= 0.5f;
        host.load(half), other.load(half);
        CHECK(largestDifference(host.draw(front(), kLamp), other.draw(front(), kLamp)) == 0.0f);
        CHECK(links == before);
    }
}

TEST_CASE("more lights than a batch holds leave the host's blending of every draw buffer alone")
{
    if (!haveGl()) return;
    const std::vector<Light> many(60, pointLight({0.5f, 1, 1}, glm::vec3(0.01f)));
    for (const SplatAsset& asset : {withSharp(randomAsset(50, 4, 1), kAllSharp, 1), randomSss(50, kAllSss, 1)}) {
        CAPTURE(asset.model);
        Host host(asset);
        GLint version = 0, got = 0;
        glGetIntegerv(GL_MAJOR_VERSION, &version);
        if (version < 4) return; // one function for all buffers: the state test covers it
        host.draw(offCentre(), many); // a draw that runs every pass
        for (GLuint i = 0; i < 4; ++i) glBlendFuncSeparatei(i, GL_DST_COLOR, GL_SRC_ALPHA, GL_ZERO, GL_DST_ALPHA);
        std::vector<Light> moved = many;
        moved.back().position.x += 0.5f;
        host.draw(offCentre(), moved);
        for (GLuint i = 0; i < 4; ++i) {
            CAPTURE(i);
            glGetIntegeri_v(GL_BLEND_SRC_RGB, i, &got);
            CHECK(got == GL_DST_COLOR);
            glGetIntegeri_v(GL_BLEND_DST_ALPHA, i, &got);
            CHECK(got == GL_DST_ALPHA);
        }
    }
}
