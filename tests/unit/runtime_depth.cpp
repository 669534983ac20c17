// Depth that splats write: as casters of shadows, and of a picture, against the same sums in float64.
#include "runtime_fixture.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

using namespace nacre;
using namespace nacre::test;

namespace {

constexpr int kSize = 64;

/// A projection as a host would set it, and how it draws with it.
struct Depths {
    const char* name;
    bool reversed = false, zeroToOne = false;
};
std::vector<Depths> depths()
{
    std::vector<Depths> all = {{"GL"}};
    GLint major = 0, minor = 0;
    glGetIntegerv(GL_MAJOR_VERSION, &major);
    glGetIntegerv(GL_MINOR_VERSION, &minor);
    if (10 * major + minor >= 45) all.push_back({"reversed, from 0 to 1", true, true});
    else MESSAGE("SKIPPED: reversed depth, glClipControl needs OpenGL 4.5");
    return all;
}

glm::dmat4 projection(const Camera& camera, const Depths& d)
{
    glm::dmat4 p = clipFromView(camera);
    const double near = 0.5, far = 6;
    p[2][2] = -(far + near) / (far - near), p[3][2] = -2 * far * near / (far - near);
    if (!d.zeroToOne) return p;
    glm::dmat4 m(1.0);
    m[2][2] = d.reversed ? -0.5 : 0.5, m[3][2] = 0.5;
    return m * p;
}

NacreDrawDesc describe(const Camera& camera, const Depths& d)
{
    NacreDrawDesc desc = test::describe(camera);
    copy(desc.clipFromView, projection(camera, d));
    return desc;
}

void use(const Depths& d)
{
    if (d.zeroToOne) glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    glDepthFunc(d.reversed ? GL_GREATER : GL_LESS);
}
void useDefaults(const Depths& d)
{
    if (d.zeroToOne) glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
    glDepthFunc(GL_LESS);
}

double windowDepth(const Camera& camera, const Depths& d, const glm::dvec3& world)
{
    const glm::dvec4 clip = projection(camera, d) * glm::inverse(camera.worldFromCamera) * glm::dvec4(world, 1);
    return d.zeroToOne ? clip.z / clip.w : 0.5 * clip.z / clip.w + 0.5;
}

/// Depth of the bound framebuffer, rows top to bottom.
std::vector<float> readDepth()
{
    std::vector<float> rows(kSize * kSize), out;
    glReadPixels(0, 0, kSize, kSize, GL_DEPTH_COMPONENT, GL_FLOAT, rows.data());
    for (int y = kSize - 1; y >= 0; --y) out.insert(out.end(), &rows[size_t(y) * kSize], &rows[size_t(y) * kSize] + kSize);
    return out;
}

/// A depth buffer of float, with colour or without, with several samples or one. Bound.
struct Target {
    GLuint framebuffer = 0, depth = 0, color = 0;
    Target(bool withColor, int samples, float cleared)
    {
        glGenFramebuffers(1, &framebuffer);
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
        glGenRenderbuffers(1, &depth);
        glGenRenderbuffers(1, &color);
        glBindRenderbuffer(GL_RENDERBUFFER, depth);
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, GL_DEPTH_COMPONENT32F, kSize, kSize);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, depth);
        if (withColor) {
            glBindRenderbuffer(GL_RENDERBUFFER, color);
            glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, GL_RGBA16F, kSize, kSize);
            glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, color);
        } else {
            glDrawBuffer(GL_NONE);
            glReadBuffer(GL_NONE);
        }
        REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
        glViewport(0, 0, kSize, kSize);
        glClearDepth(double(cleared));
        glClear(GL_DEPTH_BUFFER_BIT | GL_COLOR_BUFFER_BIT);
        glClearDepth(1);
    }
    ~Target()
    {
        glDeleteFramebuffers(1, &framebuffer);
        glDeleteRenderbuffers(1, &depth);
        glDeleteRenderbuffers(1, &color);
    }
    std::vector<float> read() const
    {
        const Target single(false, 0, 0);
        glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer);
        glBindFramebuffer(GL_DRAW_FRAMEBUFFER, single.framebuffer);
        glBlitFramebuffer(0, 0, kSize, kSize, 0, 0, kSize, kSize, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
        glBindFramebuffer(GL_FRAMEBUFFER, single.framebuffer);
        std::vector<float> out = readDepth();
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
        return out;
    }
};

struct Projected {
    ProjectedGaussian<double> splat;
    double depth, opacity; // of the window; as stored
};
std::vector<Projected> project(std::span<const SplatAsset> assets, std::span<const glm::dvec3> places, const Camera& camera, const Depths& d)
{
    std::vector<Projected> out;
    for (size_t i = 0; i < assets.size(); ++i) {
        const SplatAsset& a = assets[i];
        const View<double> view = makeView<double>(camera, a.lowPassVariance);
        for (size_t g = 0; g < a.cloud.count; ++g) {
            const glm::dvec3 p = glm::dvec3(a.cloud.positions[g]) + places[i];
            const glm::vec3& s = a.cloud.scales[g];
            const glm::quat& q = a.cloud.rotations[g];
            Projected one;
            if (!projectGaussian(view, {{p.x, p.y, p.z}, {s.x, s.y, s.z}, {q.w, q.x, q.y, q.z}, double(a.cloud.opacities[g])}, one.splat)) continue;
            one.depth = windowDepth(camera, d, p), one.opacity = a.cloud.opacities[g];
            out.push_back(one);
        }
    }
    std::stable_sort(out.begin(), out.end(), [](const Projected& a, const Projected& b) { return a.splat.distance < b.splat.distance; });
    return out;
}

const std::vector<SplatAsset>& scene()
{
    static const std::vector<SplatAsset> all = {randomAsset(300, 0, 3, 0.08f), randomSss(300, 0, 4, 0.08f)};
    return all;
}
const glm::dvec3 kPlaces[] = {{-0.2, 0, 0}, {0.25, 0.1, 0.2}};
Camera camera() { return lookAt({0.9, 0.7, 1.6}, {0, 0, 0}, kSize, kSize, 70); }

void addScene(Host& host)
{
    for (size_t i = 0; i < scene().size(); ++i) host.place(scene()[i], glm::translate(glm::dmat4(1), kPlaces[i]));
    host.setLights(std::vector<Light>{directionalLight({0, 0, 1}, glm::vec3(2))});
}

} // namespace

TEST_CASE("depth: casters are the nearest splats whose alpha suffices, in a target without colour, with nothing sorted or lit")
{
    if (!haveGl()) return;
    Host host;
    addScene(host);
    for (const Depths& d : depths())
        for (const float least : {0.0f, 0.2f}) {
            CAPTURE(d.name);
            const Target target(false, 0, d.reversed ? 0.0f : 1.0f);
            use(d);
            glDisable(GL_DEPTH_TEST);
            glDepthMask(GL_FALSE);
            NacreDrawDesc desc = describe(camera(), d);
            desc.depthAlpha = least;
            REQUIRE_MESSAGE(nacreViewDrawDepth(host.view, &desc) == NACRE_OK, host.lastMessage());
            GLboolean mask = GL_TRUE;
            glGetBooleanv(GL_DEPTH_WRITEMASK, &mask);
            CHECK(mask == GL_FALSE);
            CHECK(!glIsEnabled(GL_DEPTH_TEST));
            glDepthMask(GL_TRUE);
            useDefaults(d);
            const NacreDrawStats stats = host.stats();
            CHECK(stats.sorted == 0);
            CHECK(stats.relightSplats == 0);
            CHECK(stats.instancesDrawn == 2);
            const std::vector<float> found = readDepth();
            const std::vector<Projected> splats = project(scene(), kPlaces, camera(), d);
            const double threshold = least > 0 ? least : 0.5;
            int covered = 0, wrong = 0;
            for (int y = 0; y < kSize; ++y)
                for (int x = 0; x < kSize; ++x) {
                    double nearest = d.reversed ? 0 : 1;
                    for (const Projected& p : splats) {
                        double dx, dy;
                        const double alpha = splatAlpha(p.splat, x + 0.5, y + 0.5, &dx, &dy) * p.opacity / p.splat.opacity;
                        if (alpha >= threshold) nearest = d.reversed ? std::max(nearest, p.depth) : std::min(nearest, p.depth);
                    }
                    covered += nearest > 0 && nearest < 1;
                    wrong += std::abs(found[size_t(y) * kSize + size_t(x)] - nearest) > 1e-5;
                }
            CHECK(covered > 300);
            CHECK(wrong <= 2); // where alpha is the threshold but for rounding
        }
}

TEST_CASE("depth: a picture writes the mean depth of its splats where they cover the pixel, and nothing elsewhere")
{
    if (!haveGl()) return;
    Host host;
    addScene(host);
    for (const Depths& d : depths())
        for (const int samples : {0, 4})
            for (const bool tested : {false, true}) {
                CAPTURE(d.name);
                CAPTURE(samples);
                CAPTURE(tested);
                const float middle = float(windowDepth(camera(), d, glm::dvec3(0))); // tested: only what is in front of the middle is seen
                const Target target(true, samples, tested ? middle : d.reversed ? 0.0f : 1.0f);
                use(d);
                NacreDrawDesc desc = describe(camera(), d);
                desc.depthTest = tested, desc.depthWrite = 1, desc.depthAlpha = 0.6f;
                REQUIRE_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
                useDefaults(d);
                CHECK(!glIsEnabled(GL_DEPTH_TEST));
                const std::vector<float> found = target.read();
                const std::vector<Projected> splats = project(scene(), kPlaces, camera(), d);
                int covered = 0, wrong = 0;
                for (int y = 0; y < kSize; ++y)
                    for (int x = 0; x < kSize; ++x) {
                        double sum = 0, transmittance = 1;
                        for (const Projected& p : splats) {
                            double dx, dy;
                            const double alpha = splatAlpha(p.splat, x + 0.5, y + 0.5, &dx, &dy);
                            const bool hidden = tested && (d.reversed ? p.depth <= double(middle) : p.depth >= double(middle));
                            if (!(alpha >= double(kMinAlpha)) || hidden) continue;
                            const double a = std::min(alpha, double(kMaxAlpha));
                            sum += transmittance * a * p.depth, transmittance *= 1 - a;
                        }
                        const double coverage = 1 - transmittance, untouched = tested ? double(middle) : d.reversed ? 0 : 1;
                        const double wanted = coverage >= double(desc.depthAlpha) ? sum / coverage : untouched;
                        covered += coverage >= double(desc.depthAlpha);
                        wrong += std::abs(found[size_t(y) * kSize + size_t(x)] - wanted) > 1e-5;
                    }
                CHECK(covered > 300);
                CHECK(wrong <= 2); // where the coverage is the threshold but for rounding
                CHECK_MESSAGE(host.messages.empty(), host.lastMessage());
            }
}

TEST_CASE("depth: depthWrite changes no colour, and an alpha out of range is refused")
{
    if (!haveGl()) return;
    Host host;
    addScene(host);
    NacreDrawDesc desc = test::describe(camera());
    const Image before = host.draw(desc);
    desc.depthWrite = 1;
    CHECK(host.draw(desc).rgba == before.rgba);
    for (const float alpha : {-0.1f, 1.5f, NAN}) {
        desc.depthAlpha = alpha;
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(nacreViewDrawDepth(host.view, &desc) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(host.lastMessage().find("depthAlpha") != std::string::npos);
    }
    desc.depthAlpha = 0; // a view that turns from shadows to pictures draws the same as before
    REQUIRE(nacreViewDrawDepth(host.view, &desc) == NACRE_OK);
    CHECK(host.draw(desc).rgba == before.rgba);
}
