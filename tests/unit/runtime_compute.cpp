// Orders and pictures by compute shaders, asked for by name, against the vertex and fragment shaders of GL 3.3.
#include "runtime_fixture.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

using namespace nacre;
using namespace nacre::test;

namespace {

const std::vector<Light> kLights = {pointLight({1, 2, 1.5f}, {6, 5, 4}), directionalLight({-1, 0.5f, 0.2f}, {0.5f, 0.7f, 1})};

std::unique_ptr<Host> makeHost(const SplatAsset& asset, NacreBackEnd backEnd)
{
    auto host = std::make_unique<Host>(HostOptions{.backEnd = backEnd});
    host->load(asset);
    host->setLights(kLights);
    return host;
}

/// Null where the context lacks compute shaders.
std::unique_ptr<Host> computeHost(const SplatAsset& asset)
{
    if (!haveGl()) return nullptr;
    const auto gl = HeadlessGl::create();
    GLint major = 0, minor = 0;
    glGetIntegerv(GL_MAJOR_VERSION, &major), glGetIntegerv(GL_MINOR_VERSION, &minor);
    if (10 * major + minor >= 43) return makeHost(asset, NACRE_BACK_END_GL43);
    MESSAGE("SKIPPED: ", (*gl)->description(), " has no compute shaders");
    return nullptr;
}

} // namespace

TEST_CASE("compute shaders show what quads show")
{
    for (const SplatAsset& asset : {randomAsset(4000, 4, 1, 0.1f), withSharp(randomAsset(1500, 9, 2, 0.02f), kAllSharp, 3), randomSss(800, kAllSss, 4)}) {
        CAPTURE(asset.model);
        const std::unique_ptr<Host> computed = computeHost(asset);
        if (!computed) return;
        const std::unique_ptr<Host> plain = makeHost(asset, NACRE_BACK_END_GL33);
        const Camera cameras[] = {offCentre(), lookAt({0.2, 0.1, 0.4}, {-0.3, 0, -0.5}, 130, 90, 70), lookAt({0, 0, 3}, {0, 0.3, 0}, 131, 95, 200)};
        for (const Camera& camera : cameras) {
            const Image expected = plain->draw(camera), image = computed->draw(camera);
            CHECK(psnr(image, expected) > 60);
            CHECK(largest(image) > 0.05f);
            CHECK(glGetError() == GL_NO_ERROR);
        }
        // turned, the order stays; nearer, it does not
        Camera turned = cameras[2];
        turned.worldFromCamera = turned.worldFromCamera * glm::rotate(glm::dmat4(1), 0.3, glm::dvec3(0, 1, 0));
        CHECK(psnr(computed->draw(turned), plain->draw(turned)) > 60);
        CHECK(computed->stats().sorted == 0);
        turned.worldFromCamera[3].z -= 0.2;
        CHECK(psnr(computed->draw(turned), plain->draw(turned)) > 60);
        CHECK(computed->stats().sorted == 1);
    }
}

TEST_CASE("compute shaders follow the host's clip control, depth clamp, scissor and what the target holds")
{
    const SplatAsset asset = randomAsset(1500, 4, 5, 0.1f);
    const std::unique_ptr<Host> computed = computeHost(asset);
    if (!computed) return;
    const std::unique_ptr<Host> plain = makeHost(asset, NACRE_BACK_END_GL33);
    const Camera camera = offCentre();
    NacreDrawDesc desc = describe(camera);
    // a far plane through the asset
    glm::dmat4 projection = clipFromView(camera);
    const double near = 0.5, far = 2;
    projection[2][2] = -(far + near) / (far - near), projection[3][2] = -2 * far * near / (far - near);
    copy(desc.clipFromView, projection);
    for (const bool clamp : {false, true})
        for (const bool upper : {false, true}) {
            CAPTURE(clamp);
            CAPTURE(upper);
            Image images[2];
            for (int k = 0; k < 2; ++k) {
                Host& host = k ? *plain : *computed;
                host.gl->makeCurrent();
                REQUIRE(host.gl->beginFrame(camera.width, camera.height));
                const float background[4] = {0.1f, 0.2f, 0.3f, 0.4f};
                glClearBufferfv(GL_COLOR, 0, background);
                (clamp ? glEnable : glDisable)(GL_DEPTH_CLAMP);
                glEnable(GL_SCISSOR_TEST);
                glScissor(5, 7, 50, 40);
                glClipControl(upper ? GL_UPPER_LEFT : GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
                REQUIRE_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
                glDisable(GL_SCISSOR_TEST), glDisable(GL_DEPTH_CLAMP), glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
                images[k] = host.gl->readFrame();
            }
            CHECK(psnr(images[0], images[1]) > 60);
            CHECK(largestDifference(images[0], images[1]) < 2e-3f);
        }
}

TEST_CASE("compute shaders test the host's depth as GL does, whatever the function, the range and the clip control")
{
    const SplatAsset asset = randomAsset(1500, 4, 9, 0.1f);
    const std::unique_ptr<Host> computed = computeHost(asset);
    if (!computed) return;
    const std::unique_ptr<Host> plain = makeHost(asset, NACRE_BACK_END_GL33);
    const Camera camera = offCentre();
    NacreDrawDesc desc = describe(camera);
    desc.depthTest = 1;
    glm::dmat4 projection = clipFromView(camera);
    const double near = 0.5, far = 5;
    projection[2][2] = -(far + near) / (far - near), projection[3][2] = -2 * far * near / (far - near);
    copy(desc.clipFromView, projection);
    const auto draw = [&](Host& host, GLenum function, bool upper, bool zeroToOne, float first, float last) {
        host.gl->makeCurrent();
        REQUIRE(host.gl->beginFrame(camera.width, camera.height));
        glEnable(GL_SCISSOR_TEST);
        for (int x = 0; x < camera.width; x += 4)       // a stair of depths
            for (int y = 0; y < camera.height; y += 8) {
                glScissor(x, y, 4, 8);
                const float depth = 0.5f + 0.45f * std::sin(0.35f * float(x) + 0.2f * float(y));
                glClearBufferfv(GL_DEPTH, 0, &depth);
            }
        glDisable(GL_SCISSOR_TEST);
        glDepthFunc(function), glDepthRange(first, last);
        glClipControl(upper ? GL_UPPER_LEFT : GL_LOWER_LEFT, zeroToOne ? GL_ZERO_TO_ONE : GL_NEGATIVE_ONE_TO_ONE);
        const NacreResult result = nacreViewDraw(host.view, &desc);
        glDepthFunc(GL_LESS), glDepthRange(0, 1), glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
        REQUIRE_MESSAGE(result == NACRE_OK, host.lastMessage());
        return host.gl->readFrame();
    };
    for (const GLenum function : {GL_LESS, GL_GREATER, GL_LEQUAL, GL_NOTEQUAL, GL_NEVER, GL_ALWAYS})
        for (const int variant : {0, 1, 2}) {
            CAPTURE(function);
            CAPTURE(variant);
            const bool other = variant == 1;
            const float first = variant == 2 ? 0.9f : 0.0f, last = variant == 2 ? 0.1f : 1.0f;
            const Image image = draw(*computed, function, other, other, first, last), expected = draw(*plain, function, other, other, first, last);
            CHECK(psnr(image, expected) > 60);
            CHECK((largest(expected) > 0.05f) == (function != GL_NEVER));
        }
}

TEST_CASE("compute shaders order overlapping instances jointly")
{
    const SplatAsset first = randomAsset(900, 4, 6, 0.1f), second = randomAsset(700, 0, 7, 0.1f);
    const std::unique_ptr<Host> computed = computeHost(first);
    if (!computed) return;
    const std::unique_ptr<Host> plain = makeHost(first, NACRE_BACK_END_GL33);
    const glm::dmat4 aside = glm::translate(glm::dmat4(1), glm::dvec3(0.3, 0.1, -0.2));
    for (Host* host : {computed.get(), plain.get()}) host->place(second, aside);
    CHECK(psnr(computed->draw(offCentre()), plain->draw(offCentre())) > 60);
}

TEST_CASE("compute shaders leave the host's program, textures and images as they were")
{
    const std::unique_ptr<Host> computed = computeHost(randomAsset(300, 4, 8, 0.1f));
    if (!computed) return;
    computed->gl->makeCurrent();
    GLuint textures[8], program = glCreateProgram(), shader = glCreateShader(GL_COMPUTE_SHADER);
    const char* text = "#version 430 core\nlayout(local_size_x = 1) in;\nvoid main() {}\n";
    glShaderSource(shader, 1, &text, nullptr), glCompileShader(shader), glAttachShader(program, shader), glLinkProgram(program);
    glGenTextures(8, textures);
    for (int i = 0; i < 8; ++i) {
        glActiveTexture(GLenum(GL_TEXTURE0 + i));
        glBindTexture(GL_TEXTURE_2D, textures[i]);
        glTexStorage2D(GL_TEXTURE_2D, 1, GL_R32F, 4, 4);
        glBindImageTexture(GLuint(i), textures[i], 0, GL_FALSE, 0, GL_READ_ONLY, GL_R32F);
    }
    glUseProgram(program);
    glActiveTexture(GL_TEXTURE3);
    for (int frame = 0; frame < 2; ++frame) { // the first sorts, the second is at rest
        computed->draw(offCentre());
        GLint value = 0;
        glGetIntegerv(GL_CURRENT_PROGRAM, &value);
        CHECK(GLuint(value) == program);
        glGetIntegerv(GL_ACTIVE_TEXTURE, &value);
        CHECK(value == GL_TEXTURE3);
        for (int i = 0; i < 8; ++i) {
            CAPTURE(i);
            glGetIntegeri_v(GL_IMAGE_BINDING_NAME, GLuint(i), &value);
            CHECK(GLuint(value) == textures[i]);
            glGetIntegeri_v(GL_IMAGE_BINDING_ACCESS, GLuint(i), &value);
            CHECK(value == GL_READ_ONLY);
            glGetIntegeri_v(GL_IMAGE_BINDING_FORMAT, GLuint(i), &value);
            CHECK(value == GL_R32F);
        }
        for (int i = 0; i < 8; ++i) {
            glActiveTexture(GLenum(GL_TEXTURE0 + i));
            glGetIntegerv(GL_TEXTURE_BINDING_2D, &value);
            CHECK(GLuint(value) == textures[i]);
        }
        glActiveTexture(GL_TEXTURE3);
    }
    glUseProgram(0);
    glDeleteProgram(program), glDeleteShader(shader), glDeleteTextures(8, textures);
}
