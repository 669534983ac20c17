// Shadows that meshes of the host cast onto splats through its shadow maps, against rays through the same triangles.
#include "runtime_shadow_receivers.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

using namespace nacre;
using namespace nacre::test;

namespace {

// Receivers: a grid of small splats that do not overlap in the picture of an orthographic camera above them, at random heights.
constexpr int kCells = 24, kCellPixels = 8, kImage = kCells * kCellPixels;
constexpr float kHalf = 1, kSigma = kReceiverSigma; // of the grid; of a splat

SplatAsset receivers(bool sss) { return shadowReceivers(sss, kCells, 0.3f); }

NacreDrawDesc above()
{
    NacreDrawDesc desc{};
    desc.structSize = sizeof desc;
    copy(desc.viewFromWorld, glm::lookAt(glm::dvec3(0, 0, 3), glm::dvec3(0), glm::dvec3(0, 1, 0)));
    copy(desc.clipFromView, glm::ortho(-double(kHalf), double(kHalf), -double(kHalf), double(kHalf), 0.1, 10.0));
    desc.viewportWidth = desc.viewportHeight = kImage;
    return desc;
}

/// What of the brightness of each receiver is left.
std::vector<float> factors(const Image& lit, const Image& shadowed)
{
    std::vector<float> out;
    for (int y = 0; y < kCells; ++y)
        for (int x = 0; x < kCells; ++x) {
            const int px = x * kCellPixels + kCellPixels / 2, py = kImage - 1 - (y * kCellPixels + kCellPixels / 2);
            REQUIRE(lit.pixel(px, py)[0] > 1e-3f);
            out.push_back(shadowed.pixel(px, py)[0] / lit.pixel(px, py)[0]);
        }
    return out;
}

using Triangle = std::array<glm::dvec3, 3>;

bool hit(const Triangle& t, const glm::dvec3& origin, const glm::dvec3& direction, double farthest)
{
    const glm::dvec3 a = t[1] - t[0], b = t[2] - t[0], p = glm::cross(direction, b);
    const double det = glm::dot(a, p);
    if (std::abs(det) < 1e-14) return false;
    const glm::dvec3 s = origin - t[0], q = glm::cross(s, a);
    const double u = glm::dot(s, p) / det, v = glm::dot(direction, q) / det, at = glm::dot(b, q) / det;
    return u >= 0 && v >= 0 && u + v <= 1 && at > 0 && at < farthest;
}

/// A quad that is not parallel to anything, and a tetrahedron.
std::vector<Triangle> occluder(const glm::dvec3& shift = glm::dvec3(0))
{
    const glm::dvec3 q[4] = {{-0.6, -0.5, 0.7}, {0.1, -0.6, 0.8}, {0.2, 0.1, 0.9}, {-0.5, 0.2, 0.75}};
    const glm::dvec3 p[4] = {{0.3, 0.3, 0.7}, {0.8, 0.35, 0.75}, {0.45, 0.8, 0.7}, {0.5, 0.5, 1.0}};
    std::vector<Triangle> all = {{q[0], q[1], q[2]}, {q[0], q[2], q[3]}, {p[0], p[1], p[2]}, {p[0], p[1], p[3]}, {p[1], p[2], p[3]}, {p[2], p[0], p[3]}};
    for (Triangle& t : all)
        for (glm::dvec3& v : t) v += shift;
    return all;
}

/// A light of the host with the map it draws.
struct Case {
    std::string name;
    NacreLight light{};
    NacreShadowMap map{};
    std::vector<glm::dmat4> clipFromWorld; // by layer or face
    int size = 512;
    double texel = 0; // world size of the largest at the receivers, generously
};

glm::dmat4 reverse(const glm::dmat4& toZeroOne)
{
    glm::dmat4 flip(1.0);
    flip[2][2] = -1, flip[3][2] = 1; // z' = w - z
    return flip * toZeroOne;
}
glm::dmat4 zeroToOne(const glm::dmat4& clip)
{
    glm::dmat4 m(1.0);
    m[2][2] = 0.5, m[3][2] = 0.5;
    return m * clip;
}

NacreLight lightOf(NacreLightType type, glm::vec3 place, glm::vec3 direction)
{
    NacreLight l{};
    l.structSize = sizeof l;
    l.type = type;
    std::memcpy(l.position, &place, sizeof place);
    direction = glm::normalize(direction);
    std::memcpy(l.direction, &direction, sizeof direction);
    for (float& i : l.intensity) i = type == NACRE_LIGHT_DIRECTIONAL ? 2.0f : 20.0f;
    l.outerCone = 1.2f;
    return l;
}

NacreShadowMap mapOf(NacreShadowMapKind kind)
{
    NacreShadowMap m{};
    m.structSize = sizeof m;
    m.kind = kind;
    m.revision = 1;
    return m;
}

std::vector<Case> cases()
{
    std::vector<Case> all;
    const glm::dvec3 towards = glm::normalize(glm::dvec3(0.4, 0.3, 1)), lamp(0.5, 0.4, 3), middle(0, 0, 0.3);
    const glm::dmat4 fromSun = glm::lookAt(middle + 3.0 * towards, middle, glm::dvec3(0, 1, 0)), fromLamp = glm::lookAt(lamp, glm::dvec3(0), glm::dvec3(0, 1, 0));
    const auto box = [](double half) { return glm::ortho(-half, half, -half, half, 0.5, 6.0); };
    {
        Case c{"directional, 2D", lightOf(NACRE_LIGHT_DIRECTIONAL, {}, towards), mapOf(NACRE_SHADOW_MAP_2D), {box(1.7) * fromSun}};
        c.texel = 3.4 / c.size;
        all.push_back(c);
        c.name = "directional, 2D, reversed", c.map.reversed = c.map.zeroToOne = 1;
        c.clipFromWorld = {reverse(zeroToOne(box(1.7))) * fromSun};
        all.push_back(c);
    }
    {
        Case c{"cascades", lightOf(NACRE_LIGHT_DIRECTIONAL, {}, towards), mapOf(NACRE_SHADOW_MAP_ARRAY), {box(0.4) * fromSun, box(0.9) * fromSun, box(1.9) * fromSun}};
        c.map.layers = 3;
        c.texel = 3.8 / c.size;
        all.push_back(c);
    }
    {
        Case c{"spot", lightOf(NACRE_LIGHT_SPOT, lamp, -lamp), mapOf(NACRE_SHADOW_MAP_2D), {glm::perspective(1.2, 1.0, 0.5, 20.0) * fromLamp}};
        c.texel = 2 * std::tan(0.6) * 4 / c.size;
        all.push_back(c);
        c.name = "spot, reversed", c.map.reversed = c.map.zeroToOne = 1;
        c.clipFromWorld = {reverse(zeroToOne(glm::perspective(1.2, 1.0, 0.5, 20.0))) * fromLamp};
        all.push_back(c);
    }
    for (const bool distances : {false, true}) {
        const glm::dvec3 place(0.3, 0.2, 1.9);
        Case c{distances ? "cube of distances" : "cube", lightOf(NACRE_LIGHT_POINT, place, {0, 0, 1}), mapOf(NACRE_SHADOW_MAP_CUBE), {}};
        c.map.nearPlane = 0.2f, c.map.farPlane = 8, c.map.distances = distances;
        const glm::dvec3 looks[6] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}, ups[6] = {{0, -1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}, {0, -1, 0}, {0, -1, 0}};
        for (int f = 0; f < 6; ++f)
            c.clipFromWorld.push_back(glm::perspective(glm::radians(90.0), 1.0, 0.2, 8.0) * glm::lookAt(place, place + looks[f], ups[f]));
        c.texel = 2 * 2.5 / c.size;
        all.push_back(c);
    }
    return all;
}

GLuint occluderProgram()
{
    const auto shader = [](GLenum stage, const char* text) {
        const GLuint s = glCreateShader(stage);
        glShaderSource(s, 1, &text, nullptr);
        glCompileShader(s);
        GLint good = 0;
        glGetShaderiv(s, GL_COMPILE_STATUS, &good);
        REQUIRE(good);
        return s;
    };
    const GLuint p = glCreateProgram();
    glAttachShader(p, shader(GL_VERTEX_SHADER, "#version 330 core\nlayout(location = 0) in vec3 at; uniform mat4 m; out vec3 place; void main() { place = at; gl_Position = m * vec4(at, 1.0); }"));
    glAttachShader(p, shader(GL_FRAGMENT_SHADER, "#version 330 core\nin vec3 place; uniform vec4 from; void main() { gl_FragDepth = from.w > 0.0 ? distance(place, from.xyz) / from.w : gl_FragCoord.z; }"));
    glLinkProgram(p);
    return p;
}

/// Draws the triangles into the layers or faces of a depth texture, as a host would. Its state as a texture is hostile.
class DepthMap {
public:
    explicit DepthMap(const Case& c) : case_(c)
    {
        static constexpr GLenum kTargets[] = {GL_TEXTURE_2D, GL_TEXTURE_2D_ARRAY, GL_TEXTURE_CUBE_MAP};
        target_ = kTargets[c.map.kind];
        glGenTextures(1, &texture);
        glBindTexture(target_, texture);
        const auto image = [&](GLenum at) { glTexImage2D(at, 0, GL_DEPTH_COMPONENT32F, c.size, c.size, 0, GL_DEPTH_COMPONENT, GL_FLOAT, nullptr); };
        if (target_ == GL_TEXTURE_2D) image(target_);
        else if (target_ == GL_TEXTURE_2D_ARRAY)
            glTexImage3D(target_, 0, GL_DEPTH_COMPONENT32F, c.size, c.size, GLsizei(c.clipFromWorld.size()), 0, GL_DEPTH_COMPONENT, GL_FLOAT, nullptr);
        else
            for (GLenum f = 0; f < 6; ++f) image(GL_TEXTURE_CUBE_MAP_POSITIVE_X + f);
        glTexParameteri(target_, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE); // and a default filter that needs mip levels
        glTexParameteri(target_, GL_TEXTURE_WRAP_S, GL_REPEAT);
        glBindTexture(target_, 0);
        glGenFramebuffers(1, &framebuffer_);
        glGenVertexArrays(1, &vertexArray_);
        glGenBuffers(1, &buffer_);
        program_ = occluderProgram();
    }
    ~DepthMap()
    {
        glDeleteTextures(1, &texture);
        glDeleteFramebuffers(1, &framebuffer_);
        glDeleteVertexArrays(1, &vertexArray_);
        glDeleteBuffers(1, &buffer_);
        glDeleteProgram(program_);
    }
    void draw(const std::vector<Triangle>& triangles)
    {
        std::vector<float> vertices;
        for (const Triangle& t : triangles)
            for (const glm::dvec3& v : t) vertices.insert(vertices.end(), {float(v.x), float(v.y), float(v.z)});
        glBindVertexArray(vertexArray_);
        glBindBuffer(GL_ARRAY_BUFFER, buffer_);
        glBufferData(GL_ARRAY_BUFFER, GLsizeiptr(4 * vertices.size()), vertices.data(), GL_STATIC_DRAW);
        glEnableVertexAttribArray(0);
        glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, nullptr);
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
        glDrawBuffer(GL_NONE);
        glReadBuffer(GL_NONE);
        glUseProgram(program_);
        glViewport(0, 0, case_.size, case_.size);
        glEnable(GL_DEPTH_TEST);
        glDepthFunc(case_.map.reversed ? GL_GREATER : GL_LESS);
        glClearDepth(case_.map.reversed ? 0 : 1);
        for (size_t k = 0; k < case_.clipFromWorld.size(); ++k) {
            if (target_ == GL_TEXTURE_2D_ARRAY) glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, texture, 0, GLint(k));
            else glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, target_ == GL_TEXTURE_2D ? target_ : GL_TEXTURE_CUBE_MAP_POSITIVE_X + GLenum(k), texture, 0);
            REQUIRE(glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE);
            glClear(GL_DEPTH_BUFFER_BIT);
            glm::dmat4 m = case_.clipFromWorld[k];
            if (case_.map.zeroToOne) { // window depth is what glClipControl would make of it
                glm::dmat4 back(1.0);
                back[2][2] = 2, back[3][2] = -1;
                m = back * m;
            }
            const glm::mat4 f(m);
            glUniformMatrix4fv(glGetUniformLocation(program_, "m"), 1, GL_FALSE, &f[0][0]);
            const float* p = case_.light.position;
            glUniform4f(glGetUniformLocation(program_, "from"), p[0], p[1], p[2], case_.map.distances ? case_.map.farPlane : 0);
            glDrawArrays(GL_TRIANGLES, 0, GLsizei(vertices.size() / 3));
        }
        glDisable(GL_DEPTH_TEST);
        glDepthFunc(GL_LESS);
        glClearDepth(1);
        REQUIRE(glGetError() == GL_NO_ERROR);
    }
    GLuint texture = 0;

private:
    const Case case_;
    GLenum target_ = 0;
    GLuint framebuffer_ = 0, vertexArray_ = 0, buffer_ = 0, program_ = 0;
};

NacreResult setLight(Host& host, Case& c, GLuint texture, bool shadowed, float softness = 0)
{
    std::vector<float> matrices(16 * c.clipFromWorld.size());
    for (size_t k = 0; k < c.clipFromWorld.size(); ++k) copy(&matrices[16 * k], c.clipFromWorld[k]);
    c.map.texture = texture;
    c.map.softness = softness;
    c.map.clipFromWorld = c.map.kind == NACRE_SHADOW_MAP_CUBE ? nullptr : matrices.data();
    c.light.shadowMap = shadowed ? &c.map : nullptr;
    return nacreContextSetLights(host.context, &c.light, 1);
}

struct Expected {
    double share;          // of the light that reaches a splat, over a disc of two standard deviations
    bool allLit, allDark;  // over a disc that is wider by two texels
};

Expected trace(const Case& c, const glm::dvec3& place, const std::vector<Triangle>& triangles)
{
    const bool directional = c.light.type == NACRE_LIGHT_DIRECTIONAL;
    const glm::dvec3 lamp(c.light.position[0], c.light.position[1], c.light.position[2]), sun(c.light.direction[0], c.light.direction[1], c.light.direction[2]);
    const glm::dvec3 axis = directional ? sun : glm::normalize(lamp - place), right = glm::normalize(glm::cross(axis, glm::dvec3(0, 1, 0.1))), up = glm::cross(axis, right);
    const auto lit = [&](double radius, int i, int n) {
        const double r = radius * std::sqrt((i + 0.5) / n), angle = 2.399963229728653 * i;
        const glm::dvec3 from = place + r * (std::cos(angle) * right + std::sin(angle) * up), way = directional ? 100.0 * sun : lamp - from;
        return std::none_of(triangles.begin(), triangles.end(), [&](const Triangle& t) { return hit(t, from, way, 1); });
    };
    constexpr int kRays = 200;
    int narrow = 0, wide = 0;
    for (int i = 0; i < kRays; ++i) narrow += lit(2 * kSigma, i, kRays), wide += lit(2 * kSigma + 2 * c.texel, i, kRays);
    return {narrow / double(kRays), wide == kRays, wide == 0};
}

/// Fully lit and dark ones as they should be; at the edge a bounded error.
void checkFactors(const Case& c, const SplatAsset& asset, const std::vector<float>& found, const std::vector<Triangle>& triangles, const glm::dmat4& place = glm::dmat4(1))
{
    int lit = 0, dark = 0, edge = 0;
    double worst = 0, sum = 0;
    for (size_t g = 0; g < found.size(); ++g) {
        const Expected e = trace(c, place * glm::dvec4(asset.cloud.positions[g], 1), triangles);
        CAPTURE(g);
        if (e.allLit) {
            CHECK(std::abs(found[g] - 1) < 5e-3f); // eight bits
            ++lit;
        } else if (e.allDark) {
            CHECK(found[g] < 5e-3f);
            ++dark;
        } else {
            worst = std::max(worst, std::abs(found[g] - e.share));
            sum += std::abs(found[g] - e.share);
            ++edge;
        }
    }
    CHECK(lit > 100);
    CHECK(dark > 50);
    CHECK(edge > 20);
    MESSAGE(c.name, ": ", lit, " lit, ", dark, " dark, at the edge ", edge, " with errors up to ", worst, ", mean ", sum / edge);
    CHECK(worst < 0.25);     // sixteen taps over a disc that is wider by a texel
    CHECK(sum / edge < 0.05);
}

} // namespace

TEST_CASE("shadow maps: what rays through the same triangles reach is lit, what they do not is dark")
{
    if (!haveGl()) return;
    for (const bool sss : {false, true}) {
        const SplatAsset asset = receivers(sss);
        Host host(asset);
        for (Case c : cases()) {
            CAPTURE(sss);
            CAPTURE(c.name);
            DepthMap map(c);
            map.draw(occluder());
            REQUIRE(setLight(host, c, 0, false) == NACRE_OK);
            const Image lit = host.draw(above());
            CHECK(host.stats().shadowPassesRun == 0);
            REQUIRE_MESSAGE(setLight(host, c, map.texture, true) == NACRE_OK, host.lastMessage());
            const Image shadowed = host.draw(above());
            CHECK(host.stats().shadowPassesRun == 1);
            checkFactors(c, asset, factors(lit, shadowed), occluder());
            CHECK_MESSAGE(host.messages.empty(), host.lastMessage());
        }
    }
}

TEST_CASE("shadow maps: a new revision, another place and other matrices are seen, and nothing else is done again")
{
    if (!haveGl()) return;
    for (const bool sss : {false, true}) {
        const SplatAsset asset = receivers(sss);
        Host host(asset);
        Case c = cases()[2];
        DepthMap map(c);
        map.draw(occluder());
        REQUIRE(setLight(host, c, 0, false) == NACRE_OK);
        const Image lit = host.draw(above());
        REQUIRE(setLight(host, c, map.texture, true) == NACRE_OK);
        const Image before = host.draw(above());

        for (int frame = 0; frame < 3; ++frame) { // at rest, the light set again or not
            REQUIRE(setLight(host, c, map.texture, true) == NACRE_OK);
            const Image again = host.draw(above());
            if (frame == 0) continue; // the GPU has told by now that the passes were drawn
            CHECK(again.rgba == before.rgba);
            CHECK(host.stats().shadowPassesRun == 0);
            CHECK(host.stats().shadowsSkipped == 1);
            CHECK(host.stats().lightPassesRun == 0);
            CHECK(host.stats().relightSplats == 0);
        }
        const std::vector<Triangle> moved = occluder({0.25, -0.1, 0.1});
        map.draw(moved);
        ++c.map.revision;
        REQUIRE(setLight(host, c, map.texture, true) == NACRE_OK);
        checkFactors(c, asset, factors(lit, host.draw(above())), moved);

        glm::dmat4 place = glm::translate(glm::dmat4(1), glm::dvec3(0.1, 0.05, 0));
        host.moveTo(place);
        REQUIRE(setLight(host, c, 0, false) == NACRE_OK);
        NacreDrawDesc from = above();
        copy(from.viewFromWorld, glm::lookAt(glm::dvec3(0, 0, 3), glm::dvec3(0), glm::dvec3(0, 1, 0)) * glm::inverse(place));
        const Image litThere = host.draw(from);
        REQUIRE(setLight(host, c, map.texture, true) == NACRE_OK);
        checkFactors(c, asset, factors(litThere, host.draw(from)), moved, place);

        host.moveTo(glm::dmat4(1));
        REQUIRE(setLight(host, c, 0, false) == NACRE_OK);
        CHECK(host.draw(above()).rgba == lit.rgba);
        host.setLights({}); // the texture may go
    }
}

TEST_CASE("shadow maps: lights add up, each with its own map or none, in whatever slots")
{
    if (!haveGl()) return;
    for (const bool sss : {false, true}) {
        Host host(receivers(sss));
        std::vector<Case> all = cases();
        std::vector<std::unique_ptr<DepthMap>> maps;
        std::vector<std::vector<float>> matrices;
        std::vector<NacreLight> lights;
        for (Case& c : all) {
            maps.push_back(std::make_unique<DepthMap>(c));
            maps.back()->draw(occluder());
            matrices.emplace_back(16 * c.clipFromWorld.size());
            for (size_t k = 0; k < c.clipFromWorld.size(); ++k) copy(&matrices.back()[16 * k], c.clipFromWorld[k]);
            c.map.texture = maps.back()->texture;
            if (c.map.kind != NACRE_SHADOW_MAP_CUBE) c.map.clipFromWorld = matrices.back().data();
            c.light.shadowMap = lights.size() % 3 == 2 ? nullptr : &c.map;
            for (float& i : c.light.intensity) i *= 0.1f * float(1 + lights.size());
            lights.push_back(c.light);
        }
        const auto draw = [&](std::span<const NacreLight> some) {
            REQUIRE_MESSAGE(nacreContextSetLights(host.context, some.data(), some.size()) == NACRE_OK, host.lastMessage());
            return host.draw(above());
        };
        Image sum = draw({&lights[0], 1});
        for (size_t i = 1; i < lights.size(); ++i) {
            const Image one = draw({&lights[i], 1});
            for (size_t k = 0; k < sum.rgba.size(); ++k)
                if (k % 4 != 3) sum.rgba[k] += one.rgba[k];
        }
        const float allowed = 5e-3f * largest(sum); // sss is blended as half floats
        CHECK(largestDifference(draw(lights), sum) < allowed);
        std::rotate(lights.begin(), lights.begin() + 2, lights.end());
        CHECK(largestDifference(draw(lights), sum) < allowed);
        const NacreLight first = lights.front();
        lights.erase(lights.begin());
        const Image others = draw(lights), one = draw({&first, 1});
        lights.push_back(first);
        const Image together = draw(lights);
        CHECK(largestDifference(together, sum) < allowed);
        float most = 0;
        for (size_t k = 0; k < sum.rgba.size(); ++k)
            if (k % 4 != 3) most = std::max(most, std::abs(others.rgba[k] + one.rgba[k] - together.rgba[k]));
        CHECK(most < allowed);
        host.setLights({});
    }
}

TEST_CASE("shadow maps: textures, cube maps and samplers of the host stay bound as they were")
{
    if (!haveGl()) return;
    Host host(receivers(false));
    for (Case c : cases()) {
        CAPTURE(c.name);
        DepthMap map(c);
        map.draw(occluder());
        GLuint textures[18], samplers[6];
        glGenTextures(18, textures);
        glGenSamplers(6, samplers);
        REQUIRE(host.gl->beginFrame(kImage, kImage));
        static constexpr GLenum kTargets[] = {GL_TEXTURE_2D, GL_TEXTURE_2D_ARRAY, GL_TEXTURE_CUBE_MAP}, kBindings[] = {GL_TEXTURE_BINDING_2D, GL_TEXTURE_BINDING_2D_ARRAY, GL_TEXTURE_BINDING_CUBE_MAP};
        for (GLuint unit = 0; unit < 6; ++unit) {
            glActiveTexture(GL_TEXTURE0 + unit);
            for (size_t k = 0; k < 3; ++k) glBindTexture(kTargets[k], textures[3 * unit + k]);
            glBindSampler(unit, samplers[unit]);
        }
        REQUIRE(setLight(host, c, map.texture, true) == NACRE_OK);
        const NacreDrawDesc desc = above();
        REQUIRE_MESSAGE(nacreViewDraw(host.view, &desc) == NACRE_OK, host.lastMessage());
        CHECK(host.stats().shadowPassesRun == 1);
        for (GLuint unit = 0; unit < 6; ++unit) {
            glActiveTexture(GL_TEXTURE0 + unit);
            GLint bound = 0;
            for (size_t k = 0; k < 3; ++k) {
                glGetIntegerv(kBindings[k], &bound);
                CHECK(GLuint(bound) == textures[3 * unit + k]);
            }
            glGetIntegerv(GL_SAMPLER_BINDING, &bound);
            CHECK(GLuint(bound) == samplers[unit]);
        }
        glActiveTexture(GL_TEXTURE0);
        glDeleteTextures(18, textures);
        glDeleteSamplers(6, samplers);
        host.setLights({});
        CHECK(glGetError() == GL_NO_ERROR);
    }
}

TEST_CASE("shadow maps: what is wrong with one is said")
{
    if (!haveGl()) return;
    Host host(receivers(false));
    Case c = cases()[2];
    DepthMap map(c);
    map.draw(occluder());
    std::vector<float> matrices(16 * 3, 1.0f);
    c.map.texture = map.texture;
    c.map.clipFromWorld = matrices.data();
    c.light.shadowMap = &c.map;
    const Case good = c;
    const auto refuses = [&](const char* text) {
        CAPTURE(text);
        c.light.shadowMap = &c.map;
        CHECK(nacreContextSetLights(host.context, &c.light, 1) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK_MESSAGE(host.lastMessage().find(text) != std::string::npos, host.lastMessage());
        c = good;
        c.map.clipFromWorld = matrices.data();
    };
    c.map.structSize = 4, refuses("structSize");
    c.map.structSize = sizeof c.map + 8, refuses("structSize");
    c.map.kind = NacreShadowMapKind(3), refuses("kind 3");
    c.map.texture = 0, refuses("texture is 0");
    c.map.layers = 0, refuses("layers");
    c.map.layers = 9, refuses("layers");
    c.map.clipFromWorld = nullptr, refuses("null");
    c.map.bias = -1, refuses("bias");
    c.map.bias = NAN, refuses("bias");
    c.map.softness = 65, refuses("softness");
    c.map.distances = 1, refuses("distances");
    c.map.kind = NACRE_SHADOW_MAP_CUBE, refuses("directional");
    c.map.kind = NACRE_SHADOW_MAP_CUBE, c.light.type = NACRE_LIGHT_POINT, refuses("planes");
    matrices[40] = INFINITY;
    refuses("layer 2");

    for (const NacreShadowMapKind kind : {NACRE_SHADOW_MAP_2D, NACRE_SHADOW_MAP_ARRAY}) { // what only a draw can tell
        c = good;
        std::fill(matrices.begin(), matrices.end(), 1.0f);
        c.light.shadowMap = &c.map;
        c.map.kind = kind, c.map.texture = kind == NACRE_SHADOW_MAP_2D ? map.texture : 4711;
        REQUIRE_MESSAGE(nacreContextSetLights(host.context, &c.light, 1) == NACRE_OK, host.lastMessage());
        host.gl->makeCurrent();
        REQUIRE(host.gl->beginFrame(kImage, kImage));
        const NacreDrawDesc desc = above();
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK_MESSAGE(host.lastMessage().find(kind == NACRE_SHADOW_MAP_2D ? "no 2D texture" : "does not exist") != std::string::npos, host.lastMessage());
        CHECK(glGetError() == GL_NO_ERROR);
    }
}

namespace {

template <class Function>
Function glFunction(const char* name) { return reinterpret_cast<Function>(HeadlessGl::getProcAddress(name, nullptr)); }

/// A map whose surface at `depth` covers x < 0 of the world; uploaded, so that it needs nothing but what every context has.
GLuint halfCovered(NacreShadowMapKind kind, float depth)
{
    constexpr int kTexels = 32;
    static constexpr GLenum kTargets[] = {GL_TEXTURE_2D, GL_TEXTURE_2D_ARRAY, GL_TEXTURE_CUBE_MAP};
    std::vector<float> texels(kTexels * kTexels, 1.0f);
    for (size_t i = 0; i < texels.size(); ++i)
        if (int(i) % kTexels < kTexels / 2) texels[i] = depth;
    const GLenum target = kTargets[kind];
    GLuint name = 0;
    glFunction<PFNGLGENTEXTURESPROC>("glGenTextures")(1, &name);
    glFunction<PFNGLBINDTEXTUREPROC>("glBindTexture")(target, name);
    const auto image = glFunction<PFNGLTEXIMAGE2DPROC>("glTexImage2D");
    if (target == GL_TEXTURE_2D) image(target, 0, GL_DEPTH_COMPONENT32F, kTexels, kTexels, 0, GL_DEPTH_COMPONENT, GL_FLOAT, texels.data());
    else if (target == GL_TEXTURE_2D_ARRAY)
        glFunction<PFNGLTEXIMAGE3DPROC>("glTexImage3D")(target, 0, GL_DEPTH_COMPONENT32F, kTexels, kTexels, 1, 0, GL_DEPTH_COMPONENT, GL_FLOAT, texels.data());
    else // of -Z, which is to see it, x grows to the left
        for (GLenum f = 0; f < 6; ++f) {
            std::vector<float> face = texels;
            if (f == 5) std::reverse(face.begin(), face.end());
            image(GL_TEXTURE_CUBE_MAP_POSITIVE_X + f, 0, GL_DEPTH_COMPONENT32F, kTexels, kTexels, 0, GL_DEPTH_COMPONENT, GL_FLOAT, face.data());
        }
    glFunction<PFNGLBINDTEXTUREPROC>("glBindTexture")(target, 0);
    return name;
}

} // namespace

TEST_CASE("shadow maps: every kind of map, and depth of splats, in every context")
{
    for (const HeadlessKind kind : {HeadlessKind::kEgl, HeadlessKind::kEglEs, HeadlessKind::kOsMesa}) {
        if (!haveGl(kind)) continue;
        CAPTURE(int(kind));
        for (const bool sss : {false, true}) {
            Host host(HostOptions{.kind = kind});
            host.load(receivers(sss));
            const glm::dmat4 fromSun = glm::lookAt(glm::dvec3(0, 0, 3), glm::dvec3(0), glm::dvec3(0, 1, 0));
            std::vector<Case> all = {{"2D", lightOf(NACRE_LIGHT_DIRECTIONAL, {}, {0, 0, 1}), mapOf(NACRE_SHADOW_MAP_2D), {glm::ortho(-1.5, 1.5, -1.5, 1.5, 0.5, 6.0) * fromSun}},
                                     {"array", lightOf(NACRE_LIGHT_DIRECTIONAL, {}, {0, 0, 1}), mapOf(NACRE_SHADOW_MAP_ARRAY), {glm::ortho(-1.5, 1.5, -1.5, 1.5, 0.5, 6.0) * fromSun}},
                                     {"cube", lightOf(NACRE_LIGHT_POINT, {0, 0, 3}, {0, 0, 1}), mapOf(NACRE_SHADOW_MAP_CUBE), {}}};
            all[1].map.layers = 1, all[2].map.nearPlane = 0.5f, all[2].map.farPlane = 6;
            for (Case& c : all) {
                CAPTURE(c.name);
                REQUIRE(setLight(host, c, 0, false) == NACRE_OK);
                const Image lit = host.draw(above());
                host.gl->makeCurrent();
                const GLuint texture = halfCovered(c.map.kind, 0.3f);
                REQUIRE_MESSAGE(setLight(host, c, texture, true) == NACRE_OK, host.lastMessage());
                const std::vector<float> found = factors(lit, host.draw(above()));
                for (int x = 0; x < kCells; ++x)
                    for (int y = 0; y < kCells; ++y)
                        if (std::abs(2 * x + 1 - kCells) > 6) // the border, and what its texels are filtered with
                            CHECK(std::abs(found[size_t(y * kCells + x)] - (x < kCells / 2 ? 0.0f : 1.0f)) < 5e-3f);
                host.setLights({});
                glFunction<PFNGLDELETETEXTURESPROC>("glDeleteTextures")(1, &texture);
            }
            NacreDrawDesc desc = above();
            const Image before = host.draw(desc);
            REQUIRE_MESSAGE(nacreViewDrawDepth(host.view, &desc) == NACRE_OK, host.lastMessage());
            desc.depthTest = desc.depthWrite = 1;
            const Image written = host.draw(desc);
            CHECK(written.rgba == before.rgba);
            CHECK(glFunction<PFNGLGETERRORPROC>("glGetError")() == GL_NO_ERROR);
            CHECK_MESSAGE(host.messages.empty(), host.lastMessage());
        }
    }
}

TEST_CASE("shadow maps: a texture without depth is refused at the draw, and the next draw without it is right")
{
    if (!haveGl()) return;
    Host host(receivers(false));
    const Image lit = host.draw(offCentre(), std::vector<Light>{directionalLight({0, 0.3f, 1}, glm::vec3(1))});
    GLuint color = 0;
    glGenTextures(1, &color);
    glBindTexture(GL_TEXTURE_2D, color);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, 16, 16, 0, GL_RGBA, GL_UNSIGNED_BYTE, nullptr);
    const std::vector<float> identity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    NacreShadowMap map{};
    map.structSize = sizeof map, map.texture = color, map.layers = 1, map.clipFromWorld = identity.data();
    NacreLight light = toNacre(directionalLight({0, 0.3f, 1}, glm::vec3(1)));
    light.shadowMap = &map;
    REQUIRE(nacreContextSetLights(host.context, &light, 1) == NACRE_OK);
    REQUIRE(host.gl->beginFrame(offCentre().width, offCentre().height));
    const NacreDrawDesc desc = describe(offCentre());
    CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK_MESSAGE(host.lastMessage().find("holds no depth") != std::string::npos, host.lastMessage());
    CHECK(glGetError() == GL_NO_ERROR);
    light.shadowMap = nullptr;
    REQUIRE(nacreContextSetLights(host.context, &light, 1) == NACRE_OK);
    CHECK(largestDifference(host.draw(offCentre()), lit) == 0.0f);
    glDeleteTextures(1, &color);
}
