// Generated tangents: direction, handedness in glTF's convention, mirrored halves, transforms of texture coordinates.
#include "mesh_support.h"

#include "mesh/tangents.h"

#include <cmath>

using namespace nacre;

namespace {

TriangleMesh quad(Vec2s texcoords)
{
    TriangleMesh m;
    m.positions = kQuad;
    m.normals = Vec3s(4, {0, 0, 1});
    m.texcoords[0] = std::move(texcoords);
    m.triangles = {{0, 1, 2}, {0, 2, 3}};
    return m;
}

void checkFrames(const TriangleMesh& m)
{
    REQUIRE(m.tangents.size() == m.positions.size());
    for (size_t i = 0; i < m.tangents.size(); i++) {
        CHECK(std::fabs(glm::length(glm::vec3(m.tangents[i])) - 1.0f) < 1e-6f);
        CHECK(std::fabs(m.tangents[i].w) == 1.0f);
        if (!m.normals.empty()) CHECK(std::fabs(glm::dot(glm::vec3(m.tangents[i]), m.normals[i])) < 1e-6f);
    }
}

} // namespace

TEST_CASE("on an upright image the tangent points right and the bitangent up")
{
    TriangleMesh m = quad(kQuadTexcoords);
    makeTangents(m, TextureSlot{0});
    checkFrames(m);
    CHECK(m.tangents == Vec4s(4, {1, 0, 0, 1}));
}

TEST_CASE("tangents follow rising u and bitangents falling v for any linear map of the image, mirrored or not")
{
    for (int i = 0; i < 32; i++) {
        const float angle = 0.39f * float(i), stretch = 1.0f + 0.2f * float(i % 5), side = i % 2 ? 1.0f : -1.0f;
        // uv = A * (x, y)
        const glm::mat2 a = glm::mat2(std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle)) * glm::mat2(stretch, 0, 0.3f, side);
        Vec2s uv;
        for (const glm::vec3& p : kQuad) uv.push_back(a * glm::vec2(p));
        TriangleMesh m = quad(uv);
        makeTangents(m, TextureSlot{0});
        checkFrames(m);
        const glm::mat2 positionFromUv = glm::inverse(a);
        const glm::vec2 dPdu = glm::normalize(positionFromUv[0]), dPdv = positionFromUv[1];
        for (size_t k = 0; k < 4; k++) {
            CHECK(near(glm::vec3(m.tangents[k]), glm::vec3(dPdu, 0), 1e-5f));
            const glm::vec3 bitangent = glm::cross(m.normals[k], glm::vec3(m.tangents[k])) * m.tangents[k].w;
            CHECK(glm::dot(glm::vec2(bitangent), dPdv) < 0);
        }
    }
}

TEST_CASE("a transform of the texture coordinates turns the tangents with the image")
{
    TriangleMesh m = quad(kQuadTexcoords);
    TextureSlot slot{0};
    slot.uvScaleRotate = glm::mat2(0, -1, 1, 0); // u' = v, v' = -u
    makeTangents(m, slot);
    for (const glm::vec4& t : m.tangents) CHECK(near(glm::vec3(t), {0, -1, 0})); // v rises downwards
}

TEST_CASE("a vertex between mirrored halves is split, and all its rows with it")
{
    TriangleMesh m;
    m.positions = {{-1, 0, 0}, {0, 0, 0}, {1, 0, 0}, {-1, 1, 0}, {0, 1, 0}, {1, 1, 0}};
    m.normals = Vec3s(6, {0, 0, 1});
    m.texcoords[0] = {{1, 1}, {0, 1}, {1, 1}, {1, 0}, {0, 0}, {1, 0}}; // u = |x|
    m.colors = Vec4s(6, {1, 1, 1, 1});
    m.triangles = {{0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}};
    makeTangents(m, TextureSlot{0});
    checkFrames(m);
    CHECK(m.positions.size() == 8); // the two on the seam
    CHECK(m.colors.size() == 8);
    CHECK(m.texcoords[0].size() == 8);
    for (const glm::uvec3& t : m.triangles)
        for (int k = 0; k < 3; k++) {
            const float middle = (m.positions[t.x].x + m.positions[t.y].x + m.positions[t.z].x) / 3;
            CHECK(near(glm::vec3(m.tangents[t[k]]), {middle < 0 ? -1 : 1, 0, 0}));
            CHECK(m.tangents[t[k]].w == (middle < 0 ? -1.0f : 1.0f));
        }
}

TEST_CASE("without texture coordinates, or with all of them equal, tangents lie across the normal all the same")
{
    for (const glm::vec3 n : {glm::vec3(0, 0, 1), glm::vec3(0, 0, -1), glm::normalize(glm::vec3(1, 2, -3))})
        for (const Vec2s& uv : {Vec2s{}, Vec2s(4, {0.5f, 0.5f})}) {
            TriangleMesh m = quad(uv);
            m.normals = Vec3s(4, n);
            makeTangents(m, TextureSlot{0});
            checkFrames(m);
        }
}

TEST_CASE("the reader makes tangents where the material needs them, and only there")
{
    const auto tangentsUnder = [](const json& material, bool withNormals = true) {
        GltfBuilder b = quadBuilder(material);
        if (!withNormals) b.attributes().erase("NORMAL");
        b.add("images", {{"bufferView", b.view(smallPng())}});
        b.add("textures", {{"source", 0}});
        return load(b.glb()).meshes[0].tangents;
    };
    const json normalMap = {{"normalTexture", {{"index", 0}}}};
    CHECK(tangentsUnder(json::object()).empty());
    CHECK(tangentsUnder(normalMap) == Vec4s(4, {1, 0, 0, 1}));
    CHECK(tangentsUnder(normalMap, false) == Vec4s(4, {1, 0, 0, 1}));
    CHECK(tangentsUnder({{"extensions", {{"KHR_materials_clearcoat", {{"clearcoatNormalTexture", {{"index", 0}}}}}}}}).size() == 4);
    CHECK(tangentsUnder({{"extensions", {{"KHR_materials_anisotropy", {{"anisotropyStrength", 0.5}}}}}}).size() == 4);

    GltfBuilder given = quadBuilder(normalMap); // the file's own win; without normals they are ignored, as the specification says
    given.add("images", {{"bufferView", given.view(smallPng())}});
    given.add("textures", {{"source", 0}});
    given.attributes()["TANGENT"] = given.floats(Vec4s(4, {0, 1, 0, -1}));
    CHECK(load(given.glb()).meshes[0].tangents == Vec4s(4, {0, 1, 0, -1}));
    given.attributes()["TANGENT"] = given.floats(Vec4s(4, {0, 0, 0, 1}));
    CHECK(load(given.glb()).meshes[0].tangents == Vec4s(4, {1, 0, 0, 1}));
    CHECK(warns(load(given.glb()), "tangents of length 0"));
}
