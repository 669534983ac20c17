// A GL that is its version to the letter, in front of one that forgives: functions and enums of later versions, indexed states that had
// no index yet, and shaders of later versions count as violations; limits are the least that a version must have (1024 where it is 2048:
// small assets then have several layers). What belongs to which version is read from the Khronos headers.
#include "runtime_fixture.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include <fstream>
#include <map>
#include <set>
#include <sstream>

using namespace nacre;
using namespace nacre::test;

namespace {

int claimed = 33;
bool claimsEs = false;
std::set<std::string> violations;

/// What is known in which version, by the header of an API.
struct Known {
    std::map<std::string, int> functions;
    std::map<GLenum, int> enums;

    /// Empty where the header is not where compilers look for it first.
    Known(const char* path, const char* versionMacro, const char* declares)
    {
        std::ifstream file(path);
        int version = 0;
        for (std::string line; std::getline(file, line);) {
            std::istringstream words(line);
            std::string define, name, value;
            words >> define >> name >> value;
            int major = 0, minor = 0;
            if (define == "#define" && std::sscanf(name.c_str(), versionMacro, &major, &minor) == 2) version = 10 * major + minor;
            else if (line.rfind("#ifndef GL_ARB_", 0) == 0) break; // extensions follow
            else if (define == "#define" && value.rfind("0x", 0) == 0) enums.try_emplace(GLenum(std::stoul(value, nullptr, 16)), version);
            else if (define == declares)
                if (const size_t at = line.find(" gl"); at != std::string::npos)
                    if (const size_t end = line.find_first_of(" (", at + 1); end != std::string::npos) functions.try_emplace(line.substr(at + 1, end - at - 1), version);
        }
    }
};
const Known& known()
{
    static const Known desktop("/usr/include/GL/glcorearb.h", "GL_VERSION_%d_%d", "GLAPI");
    static const Known es("/usr/include/GLES3/gl3.h", "GL_ES_VERSION_%d_%d", "GL_APICALL");
    return claimsEs ? es : desktop;
}
std::string claim() { return (claimsEs ? "GL ES " : "GL ") + std::to_string(claimed); }
bool smallTextures() { return claimsEs || claimed < 41; }
constexpr GLint kSmall = 1024, kSmallLayers = 256; // at least 2048 in ES

void check(const char* function, GLenum value)
{
    const auto found = known().enums.find(value);
    if (found != known().enums.end() && found->second <= claimed) return;
    char text[100];
    std::snprintf(text, sizeof text, "%s(0x%04X) in %s", function, value, claim().c_str());
    violations.insert(text);
}
void checkIndexed(const char* function, GLenum what)
{
    check(function, what);
    if (what == GL_SCISSOR_TEST && claimed < 41) violations.insert(std::string(function) + "(GL_SCISSOR_TEST) before 4.1");
}
void checkAttachment(GLenum attachment)
{
    if (claimsEs && attachment >= GL_COLOR_ATTACHMENT4 && attachment <= GL_COLOR_ATTACHMENT31) violations.insert("a fifth attachment in ES");
}

/// ES blends into 32 bits only with EXT_float_blend, which is not claimed.
void checkBlending()
{
    if (!claimsEs || !glIsEnabled(GL_BLEND)) return;
    GLint framebuffer = 0;
    glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer);
    for (GLenum i = 0; framebuffer && i < 4; ++i) {
        GLint buffer = GL_NONE, type = GL_NONE, bits = 0;
        glGetIntegerv(GL_DRAW_BUFFER0 + i, &buffer);
        if (buffer != GL_NONE) glGetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, GLenum(buffer), GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE, &type);
        if (type != GL_NONE) glGetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, GLenum(buffer), GL_FRAMEBUFFER_ATTACHMENT_RED_SIZE, &bits);
        if (bits > 16) violations.insert("blends into 32 bits in ES");
    }
}

void* strictGl(const char* name, void* user)
{
    const auto found = known().functions.find(name);
    if (found == known().functions.end() || found->second > claimed) {
        violations.insert(std::string(name) + " asked for in " + claim());
        return nullptr;
    }
    const std::string wanted = name;
#define STRICT(NAME, ...) \
    if (wanted == NAME) { \
        static constexpr auto kCall = __VA_ARGS__; \
        return reinterpret_cast<void*>(+kCall); \
    }
    STRICT("glGetString", [](GLenum what) -> const GLubyte* {
        static std::string text;
        text = (claimsEs ? "OpenGL ES " : "") + std::to_string(claimed / 10) + "." + std::to_string(claimed % 10) + " strict";
        return what == GL_VERSION ? reinterpret_cast<const GLubyte*>(text.c_str()) : glGetString(what);
    })
    STRICT("glGetIntegerv", [](GLenum what, GLint* v) {
        check("glGetIntegerv", what);
        glGetIntegerv(what, v);
        if (what == GL_MAJOR_VERSION) *v = claimed / 10;
        if (what == GL_MINOR_VERSION) *v = claimed % 10;
        if (what == GL_NUM_EXTENSIONS) *v = claimsEs ? 1 : 0;
        if (what == GL_MAX_TEXTURE_SIZE) *v = smallTextures() ? kSmall : 16384;
        if (what == GL_MAX_ARRAY_TEXTURE_LAYERS) *v = smallTextures() ? kSmallLayers : 2048;
        if (what == GL_MAX_DRAW_BUFFERS || what == GL_MAX_COLOR_ATTACHMENTS) *v = claimsEs ? 4 : 8;
    })
    STRICT("glGetStringi", [](GLenum, GLuint) -> const GLubyte* { return reinterpret_cast<const GLubyte*>("GL_EXT_color_buffer_float"); }) // the only one claimed
    STRICT("glGetBooleanv", [](GLenum what, GLboolean* v) { check("glGetBooleanv", what), glGetBooleanv(what, v); })
    STRICT("glDrawElements", [](GLenum mode, GLsizei n, GLenum type, const void* at) { checkBlending(), glDrawElements(mode, n, type, at); })
    STRICT("glDrawArrays", [](GLenum mode, GLint first, GLsizei n) { checkBlending(), glDrawArrays(mode, first, n); })
    STRICT("glFramebufferTexture2D", [](GLenum target, GLenum attachment, GLenum kind, GLuint texture, GLint level) {
        checkAttachment(attachment), glFramebufferTexture2D(target, attachment, kind, texture, level);
    })
    STRICT("glFramebufferTextureLayer", [](GLenum target, GLenum attachment, GLuint texture, GLint level, GLint layer) {
        checkAttachment(attachment), glFramebufferTextureLayer(target, attachment, texture, level, layer);
    })
    STRICT("glGetFloatv", [](GLenum what, GLfloat* v) { check("glGetFloatv", what), glGetFloatv(what, v); })
    STRICT("glGetIntegeri_v", [](GLenum what, GLuint i, GLint* v) {
        check("glGetIntegeri_v", what);
        if (claimed < 40) violations.insert("glGetIntegeri_v before 4.0"); // nothing that the runtime wants has an index there
        glGetIntegeri_v(what, i, v);
    })
    STRICT("glEnable", [](GLenum what) { check("glEnable", what), glEnable(what); })
    STRICT("glDisable", [](GLenum what) { check("glDisable", what), glDisable(what); })
    STRICT("glIsEnabled", [](GLenum what) { return check("glIsEnabled", what), glIsEnabled(what); })
    STRICT("glEnablei", [](GLenum what, GLuint i) { checkIndexed("glEnablei", what), glEnablei(what, i); })
    STRICT("glDisablei", [](GLenum what, GLuint i) { checkIndexed("glDisablei", what), glDisablei(what, i); })
    STRICT("glIsEnabledi", [](GLenum what, GLuint i) { return checkIndexed("glIsEnabledi", what), glIsEnabledi(what, i); })
    STRICT("glBindTexture", [](GLenum target, GLuint t) { check("glBindTexture", target), glBindTexture(target, t); })
    STRICT("glPixelStorei", [](GLenum what, GLint v) { check("glPixelStorei", what), glPixelStorei(what, v); })
    STRICT("glBeginQuery", [](GLenum target, GLuint q) { check("glBeginQuery", target), glBeginQuery(target, q); })
    STRICT("glGetFramebufferAttachmentParameteriv", [](GLenum target, GLenum attachment, GLenum what, GLint* v) {
        check("glGetFramebufferAttachmentParameteriv", what), glGetFramebufferAttachmentParameteriv(target, attachment, what, v);
    })
    STRICT("glTexImage2D", [](GLenum target, GLint level, GLint format, GLsizei w, GLsizei h, GLint border, GLenum layout, GLenum type, const void* data) {
        check("glTexImage2D", GLenum(format)), check("glTexImage2D", type);
        if (smallTextures() && std::max(w, h) > kSmall) violations.insert("glTexImage2D beyond 1024");
        glTexImage2D(target, level, format, w, h, border, layout, type, data);
    })
    STRICT("glTexImage3D", [](GLenum target, GLint level, GLint format, GLsizei w, GLsizei h, GLsizei d, GLint border, GLenum layout, GLenum type, const void* data) {
        check("glTexImage3D", GLenum(format)), check("glTexImage3D", type);
        if (smallTextures() && (std::max(w, h) > kSmall || d > kSmallLayers)) violations.insert("glTexImage3D beyond 1024 x 1024 x 256");
        glTexImage3D(target, level, format, w, h, d, border, layout, type, data);
    })
    STRICT("glCreateShader", [](GLenum stage) { return check("glCreateShader", stage), glCreateShader(stage); })
    STRICT("glShaderSource", [](GLuint shader, GLsizei count, const GLchar* const* text, const GLint* lengths) {
        int version = 0;
        char profile[8] = "";
        if (std::sscanf(text[0], "#version %d %7s", &version, profile) != 2 || version > 10 * claimed || std::string(profile) != (claimsEs ? "es" : "core"))
            violations.insert("a shader of version " + std::to_string(version) + " " + profile);
        glShaderSource(shader, count, text, lengths);
    })
    STRICT("glDrawBuffers", [](GLsizei n, const GLenum* b) {
        if (n > (claimsEs ? 4 : 8)) violations.insert("too many draw buffers");
        glDrawBuffers(n, b);
    })
#undef STRICT
    return HeadlessGl::getProcAddress(name, user);
}

} // namespace

TEST_CASE("each version of GL and ES is used to the letter and draws the same")
{
    if (!haveGl()) return;
    const Camera camera = lookAt({0, 0, 2}, {0, 0, 0}, 33, 33, 40);
    const std::vector<Light> few = {pointLight({1, 1, 2}, glm::vec3(3))}, many(20, few[0]);
    for (const SplatAsset& asset : {withSharp(randomAsset(60, 9, 4), kAllSharp, 4), randomSss(60, kAllSss, 4)}) {
        Host plain(asset);
        GLint major = 0, minor = 0;
        glGetIntegerv(GL_MAJOR_VERSION, &major);
        glGetIntegerv(GL_MINOR_VERSION, &minor);
        const Image expected = plain.draw(camera, few), expectedMany = plain.draw(camera, many);
        for (const int version : {30, 33, 40, 41, 43, 45}) {
            claimed = version, claimsEs = version == 30;
            if (version > 10 * major + minor || (claimsEs && !haveGl(HeadlessKind::kEglEs))) continue;
            if (known().enums.empty()) {
                MESSAGE("SKIPPED: no Khronos header to say what belongs to ", claim());
                continue;
            }
            CAPTURE(asset.model);
            CAPTURE(claim());
            violations.clear();
            Host host({.kind = claimsEs ? HeadlessKind::kEglEs : HeadlessKind::kEgl, .getProcAddress = strictGl});
            host.load(asset);
            CHECK(host.contextInfo().backEnd == (claimsEs ? NACRE_BACK_END_GLES3 : version < 43 ? NACRE_BACK_END_GL33 : NACRE_BACK_END_GL43));
            NacreDrawDesc desc = describe(camera);
            desc.depthTest = 1;
            host.setLights(few);
            glEnable(GL_DEPTH_TEST);
            glEnable(GL_SCISSOR_TEST);
            glScissor(0, 0, 33, 33);
            const auto shoot = [&] { // ES cannot blend into the usual frame of floats
                REQUIRE(host.gl->beginFrame(33, 33, claimsEs ? GL_RGBA16F : GL_RGBA32F));
                REQUIRE_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
                return host.gl->readFrame();
            };
            const float tolerance = claimsEs ? 4e-3f : 1e-5f; // the frame of halves, blended; the network in a compute shader or in fragments
            CHECK(largestDifference(shoot(), expected) < tolerance);
            host.setLights(many);
            CHECK(largestDifference(shoot(), expectedMany) < (claimsEs ? 2e-2f : 1e-3f));
            CHECK(glIsEnabled(GL_SCISSOR_TEST));
            const NacreEdit edit{NACRE_EDIT_ROUGHNESS, NACRE_EDIT_MULTIPLY, {1, 0, 0}, NACRE_REGION_EVERYWHERE, {}, {}};
            if (asset.model == "sss") CHECK(nacreInstanceSetEdits(host.instance, &edit, 1) == NACRE_OK);
            host.setLights(few);
            CHECK(largestDifference(shoot(), expected) < tolerance);
            CHECK(nacreViewPrepare(host.view, &desc, 30) == NACRE_OK);
            CHECK(glGetError() == GL_NO_ERROR);
            for (const std::string& violation : violations) CHECK_MESSAGE(false, violation);
        }
    }
}
