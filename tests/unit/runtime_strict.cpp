// A GL that is its version to the letter, in front of one that forgives: functions and enums of later versions, indexed states that had
// no index yet, and shaders of later versions count as violations; limits are the least that a version must have. What belongs to which
// version is read from the Khronos header.
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
std::set<std::string> violations;
std::map<std::string, int> functionVersion;
std::map<GLenum, int> enumVersion;

/// False where the header is not where compilers look for it first.
bool readHeader()
{
    if (!enumVersion.empty()) return true;
    std::ifstream file("/usr/include/GL/glcorearb.h");
    int version = 0;
    for (std::string line; std::getline(file, line);) {
        std::istringstream words(line);
        std::string define, name, value;
        words >> define >> name >> value;
        int major = 0, minor = 0;
        if (define == "#define" && std::sscanf(name.c_str(), "GL_VERSION_%d_%d", &major, &minor) == 2) version = 10 * major + minor;
        else if (line.rfind("#ifndef GL_ARB_", 0) == 0) break; // extensions follow
        else if (define == "#define" && value.rfind("0x", 0) == 0) enumVersion.try_emplace(GLenum(std::stoul(value, nullptr, 16)), version);
        else if (define == "GLAPI")
            if (const size_t at = line.find(" gl"); at != std::string::npos)
                if (const size_t end = line.find_first_of(" (", at + 1); end != std::string::npos) functionVersion.try_emplace(line.substr(at + 1, end - at - 1), version);
    }
    return !enumVersion.empty();
}

void check(const char* function, GLenum value)
{
    const auto found = enumVersion.find(value);
    if (found != enumVersion.end() && found->second <= claimed) return;
    char text[100];
    std::snprintf(text, sizeof text, "%s(0x%04X) in GL %d", function, value, claimed);
    violations.insert(text);
}
void checkIndexed(const char* function, GLenum what)
{
    check(function, what);
    if (what == GL_SCISSOR_TEST && claimed < 41) violations.insert(std::string(function) + "(GL_SCISSOR_TEST) before 4.1");
}

void* strictGl(const char* name, void* user)
{
    const auto known = functionVersion.find(name);
    if (known == functionVersion.end() || known->second > claimed) {
        violations.insert(std::string(name) + " asked for in GL " + std::to_string(claimed));
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
        text = std::to_string(claimed / 10) + "." + std::to_string(claimed % 10) + " strict";
        return what == GL_VERSION ? reinterpret_cast<const GLubyte*>(text.c_str()) : glGetString(what);
    })
    STRICT("glGetIntegerv", [](GLenum what, GLint* v) {
        check("glGetIntegerv", what);
        glGetIntegerv(what, v);
        if (what == GL_MAJOR_VERSION) *v = claimed / 10;
        if (what == GL_MINOR_VERSION) *v = claimed % 10;
        if (what == GL_NUM_EXTENSIONS) *v = 0;
        if (what == GL_MAX_TEXTURE_SIZE) *v = claimed < 41 ? 1024 : 16384;
        if (what == GL_MAX_ARRAY_TEXTURE_LAYERS) *v = claimed < 41 ? 256 : 2048;
        if (what == GL_MAX_DRAW_BUFFERS || what == GL_MAX_COLOR_ATTACHMENTS) *v = 8;
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
        if (claimed < 41 && std::max(w, h) > 1024) violations.insert("glTexImage2D beyond 1024");
        glTexImage2D(target, level, format, w, h, border, layout, type, data);
    })
    STRICT("glTexImage3D", [](GLenum target, GLint level, GLint format, GLsizei w, GLsizei h, GLsizei d, GLint border, GLenum layout, GLenum type, const void* data) {
        check("glTexImage3D", GLenum(format)), check("glTexImage3D", type);
        if (claimed < 41 && (std::max(w, h) > 1024 || d > 256)) violations.insert("glTexImage3D beyond 1024 x 1024 x 256");
        glTexImage3D(target, level, format, w, h, d, border, layout, type, data);
    })
    STRICT("glCreateShader", [](GLenum stage) { return check("glCreateShader", stage), glCreateShader(stage); })
    STRICT("glShaderSource", [](GLuint shader, GLsizei count, const GLchar* const* text, const GLint* lengths) {
        int version = 0;
        if (std::sscanf(text[0], "#version %d", &version) != 1 || version > 10 * claimed) violations.insert("a shader of version " + std::to_string(version));
        glShaderSource(shader, count, text, lengths);
    })
    STRICT("glDrawBuffers", [](GLsizei n, const GLenum* b) {
        if (n > 8) violations.insert("more than 8 draw buffers");
        glDrawBuffers(n, b);
    })
#undef STRICT
    return HeadlessGl::getProcAddress(name, user);
}

} // namespace

TEST_CASE("each version of GL is used to the letter and draws the same")
{
    if (!haveGl()) return;
    if (!readHeader()) {
        MESSAGE("SKIPPED: no Khronos header to say what belongs to which version");
        return;
    }
    const Camera camera = lookAt({0, 0, 2}, {0, 0, 0}, 33, 33, 40);
    const std::vector<Light> few = {pointLight({1, 1, 2}, glm::vec3(3))}, many(20, few[0]);
    for (const SplatAsset& asset : {withSharp(randomAsset(60, 9, 4), kAllSharp, 4), randomSss(60, kAllSss, 4)}) {
        Host plain(asset);
        GLint major = 0, minor = 0;
        glGetIntegerv(GL_MAJOR_VERSION, &major);
        glGetIntegerv(GL_MINOR_VERSION, &minor);
        const Image expected = plain.draw(camera, few), expectedMany = plain.draw(camera, many);
        for (const int version : {33, 40, 41, 43, 45}) {
            if (version > 10 * major + minor) continue;
            CAPTURE(asset.model);
            CAPTURE(version);
            claimed = version;
            violations.clear();
            Host host(asset, strictGl);
            NacreDrawDesc desc = describe(camera);
            desc.depthTest = 1;
            host.setLights(few);
            glEnable(GL_DEPTH_TEST);
            glEnable(GL_SCISSOR_TEST);
            glScissor(0, 0, 33, 33);
            const float tolerance = 1e-5f; // the network in a compute shader or in fragments
            CHECK(largestDifference(host.draw(desc), expected) < tolerance);
            CHECK(largestDifference(host.draw(camera, many), expectedMany) < 1e-3f);
            CHECK(glIsEnabled(GL_SCISSOR_TEST));
            const NacreEdit edit{NACRE_EDIT_ROUGHNESS, NACRE_EDIT_MULTIPLY, {1, 0, 0}, NACRE_REGION_EVERYWHERE, {}, {}};
            if (asset.model == "sss") CHECK(nacreInstanceSetEdits(host.instance, &edit, 1) == NACRE_OK);
            CHECK(largestDifference(host.draw(camera, few), expected) < tolerance);
            CHECK(nacreViewPrepare(host.view, &desc, 30) == NACRE_OK);
            CHECK(glGetError() == GL_NO_ERROR);
            for (const std::string& violation : violations) CHECK_MESSAGE(false, violation);
        }
    }
}
