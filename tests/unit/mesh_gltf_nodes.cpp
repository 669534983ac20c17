// Node hierarchies: transforms, instances, scenes, and trees that are none.
#include "mesh_support.h"

#include "interchange/gltf_file.h"

#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>

using namespace nacre;

namespace {

glm::vec3 faceNormal(const TriangleMesh& m, size_t triangle)
{
    const glm::uvec3& t = m.triangles[triangle];
    return glm::normalize(glm::cross(m.positions[t.y] - m.positions[t.x], m.positions[t.z] - m.positions[t.x]));
}

json toJson(const glm::dmat4& m)
{
    json out = json::array();
    for (int i = 0; i < 16; i++) out.push_back(m[i / 4][i % 4]);
    return out;
}

} // namespace

TEST_CASE("transforms go down the hierarchy: translation after rotation after scale, and matrices the same")
{
    const glm::dquat turn = glm::angleAxis(0.7, glm::normalize(glm::dvec3(1, 2, 3)));
    const glm::dmat4 parent = glm::translate(glm::dmat4(1), {1, 2, 3}) * glm::mat4_cast(turn) * glm::scale(glm::dmat4(1), {2, 3, 0.5});
    const glm::dmat4 child = glm::rotate(glm::dmat4(1), 0.3, {0, 1, 0}) * glm::translate(glm::dmat4(1), {-4, 0, 1});

    GltfBuilder b = quadBuilder();
    b.root["nodes"] = {{{"translation", {1, 2, 3}}, {"rotation", {turn.x, turn.y, turn.z, turn.w}}, {"scale", {2, 3, 0.5}}, {"children", {1}}},
                       {{"matrix", toJson(child)}, {"mesh", 0}, {"name", "leaf"}}};
    GltfBuilder flat = quadBuilder();
    flat.root["nodes"] = {{{"matrix", toJson(parent * child)}, {"mesh", 0}}};
    flat.root["meshes"][0]["name"] = "panel";

    const MeshScene deep = load(b.glb()), shallow = load(flat.glb());
    CHECK(deep.meshes[0].name == "leaf");
    CHECK(shallow.meshes[0].name == "panel"); // the node has no name
    for (size_t i = 0; i < 4; i++) {
        const glm::vec3 expected(parent * child * glm::dvec4(kQuad[i], 1.0));
        CHECK(near(deep.meshes[0].positions[i], expected, 1e-5f)); // float rounding of coordinates of about 10
        CHECK(near(shallow.meshes[0].positions[i], expected, 1e-5f));
        // Normals stay across the surface under unequal scale.
        CHECK(near(deep.meshes[0].normals[i], faceNormal(deep.meshes[0], 0), 1e-5f));
        CHECK(std::fabs(glm::length(deep.meshes[0].normals[i]) - 1.0f) < 1e-6f);
    }
}

TEST_CASE("a mirroring transform keeps winding and normals outside and flips the handedness of tangents")
{
    GltfBuilder b = quadBuilder();
    b.attributes()["TANGENT"] = b.floats(Vec4s(4, {1, 0, 0, 1}));
    for (const json& scale : {json{-1, 1, 1}, json{1, 1, -1}, json{-2, -2, -2}}) {
        b.root["nodes"][0]["scale"] = scale;
        const TriangleMesh m = load(b.glb()).meshes[0];
        const glm::vec3 outside(0, 0, scale[2].get<float>() < 0 ? -1 : 1); // where the front of the quad goes
        for (size_t t = 0; t < 2; t++) CHECK(near(faceNormal(m, t), outside));
        for (size_t i = 0; i < 4; i++) {
            CHECK(near(m.normals[i], outside));
            CHECK(near(glm::vec3(m.tangents[i]), {scale[0].get<float>() < 0 ? -1 : 1, 0, 0}));
            // The bitangent is the image of the bitangent: +y, mirrored or not.
            const glm::vec3 bitangent = glm::cross(m.normals[i], glm::vec3(m.tangents[i])) * m.tangents[i].w;
            CHECK(near(bitangent, {0, scale[1].get<float>() < 0 ? -1 : 1, 0}));
        }
    }
}

TEST_CASE("instances of a mesh are copies, each under its own node")
{
    GltfBuilder b = quadBuilder();
    b.root["nodes"] = {{{"mesh", 0}, {"name", "a"}}, {{"mesh", 0}, {"name", "b"}, {"translation", {0, 0, 5}}}, {{"mesh", 0}, {"scale", {-1, 1, 1}}}};
    const MeshScene scene = load(b.glb());
    REQUIRE(scene.meshes.size() == 3);
    CHECK(scene.meshes[0].name == "a");
    CHECK(scene.meshes[1].name == "b");
    for (size_t i = 0; i < 4; i++) CHECK(scene.meshes[1].positions[i] == scene.meshes[0].positions[i] + glm::vec3(0, 0, 5));
    CHECK(scene.meshes[2].positions[1] == glm::vec3(-1, -1, 0));
    CHECK(scene.materials.size() == 1);
}

TEST_CASE("a primitive without a material has the default one, appended once")
{
    GltfBuilder b = quadBuilder({{"name", "own"}});
    for (int i = 0; i < 2; i++) b.mesh({{"attributes", {{"POSITION", 0}}}, {"indices", 3}});
    const MeshScene scene = load(b.glb());
    REQUIRE(scene.materials.size() == 2);
    CHECK(scene.meshes[0].material == 0);
    CHECK(scene.meshes[1].material == 1);
    CHECK(scene.meshes[2].material == 1);
    CHECK(scene.materials[1].baseColor == glm::vec4(1.0f));
    CHECK(scene.materials[1].metallic == 1.0f);
    CHECK(scene.materials[1].roughness == 1.0f);
}

TEST_CASE("the default scene is read, or else the first, or else all roots")
{
    GltfBuilder b = quadBuilder();
    b.root["nodes"] = {{{"mesh", 0}, {"name", "a"}}, {{"mesh", 0}, {"name", "b"}}, {{"name", "group"}, {"children", {3}}}, {{"mesh", 0}, {"name", "c"}}};
    const auto names = [&] {
        std::string out;
        for (const TriangleMesh& m : load(b.glb()).meshes) out += m.name;
        return out;
    };
    CHECK(names() == "abc");
    b.root["scenes"] = {{{"nodes", {1}}}, {{"nodes", {0, 2}}}};
    CHECK(names() == "b");
    b.root["scene"] = 1;
    CHECK(names() == "ac");
    b.root["scene"] = 2;
    checkRefused(b.glb(), ErrorCode::kBadInput, {"scene is 2", "there are 2"});
    b.root["scene"] = 0;
    b.root["scenes"][0] = json::object();
    checkRefused(b.glb(), ErrorCode::kBadInput, {"no triangles"});
}

TEST_CASE("nodes with two parents, cycles and nodes twice in a scene are errors")
{
    const auto withNodes = [](std::vector<json> nodes, std::vector<int> roots) {
        GltfBuilder b = quadBuilder();
        b.root["nodes"] = nodes;
        b.root["scenes"] = json::array({{{"nodes", roots}}});
        return b.glb();
    };
    const json leaf = {{"mesh", 0}};
    const auto group = [](std::vector<int> children) { return json{{"children", children}}; };
    checkRefused(withNodes({group({2}), group({2}), leaf}, {0, 1}), ErrorCode::kBadInput, {"nodes[2]", "two parents", "0 and 1"});
    checkRefused(withNodes({group({1, 1}), leaf}, {0}), ErrorCode::kBadInput, {"nodes[1]", "two parents"});
    checkRefused(withNodes({group({0})}, {0}), ErrorCode::kBadInput, {"nodes[0]", "cycle"});
    checkRefused(withNodes({leaf, group({2}), group({1})}, {0}), ErrorCode::kBadInput, {"nodes[1]", "cycle"});
    checkRefused(withNodes({leaf}, {0, 0}), ErrorCode::kBadInput, {"nodes[0]", "twice"});
    checkRefused(withNodes({group({1}), leaf}, {0, 1}), ErrorCode::kBadInput, {"nodes[1]", "twice"});
    checkRefused(withNodes({leaf, json{{"children", {"0"}}}}, {0}), ErrorCode::kBadInput, {"nodes[1].children[0]", "number", "string"});
    checkRefused(withNodes({group({7})}, {0}), ErrorCode::kBadInput, {"children", "is 7"});
}

TEST_CASE("transforms that are none are errors")
{
    const auto withNode = [](const char* key, const json& value) {
        GltfBuilder b = quadBuilder();
        b.root["nodes"][0][key] = value;
        return b.glb();
    };
    checkRefused(withNode("rotation", {0, 0, 0, 0}), ErrorCode::kBadInput, {"nodes[0].rotation", "quaternion"});
    checkRefused(withNode("rotation", {0, 0, 1}), ErrorCode::kBadInput, {"nodes[0].rotation", "4 numbers"});
    checkRefused(withNode("scale", {"1", 1, 1}), ErrorCode::kBadInput, {"nodes[0].scale[0]", "number"});
    checkRefused(withNode("matrix", {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}), ErrorCode::kBadInput, {"nodes[0].matrix", "affine"});
    // A rotation that is a little off unit length is one.
    CHECK(near(load(withNode("rotation", {0, 0, 0, 1.01})).meshes[0].positions[2], kQuad[2]));
}

TEST_CASE("a chain of 20000 nodes is no problem")
{
    GltfBuilder b = quadBuilder();
    json nodes = json::array();
    for (int i = 0; i < 20000; i++) nodes.push_back({{"children", {i + 1}}, {"translation", {0, 0, 1}}});
    nodes.push_back({{"mesh", 0}});
    b.root["nodes"] = nodes;
    const MeshScene scene = load(b.glb());
    CHECK(scene.origin.z + double(scene.meshes[0].positions[0].z) == 20000.0);
}

TEST_CASE("many nodes that show one big mesh stop at the limit of decoded bytes")
{
    GltfBuilder b = quadBuilder();
    for (int i = 0; i < 1000; i++) b.add("nodes", {{"mesh", 0}});
    const size_t each = 4 * (12 + 12 + 8) + 2 * 12; // one quad
    CHECK(gltf::decodeWithin(1001 * each + 100, b.glb(), "many.glb", {})); // and 12 bytes of indices, read once
    const Result<MeshScene> refused = gltf::decodeWithin(1000 * each, b.glb(), "many.glb", {});
    REQUIRE(!refused);
    CHECK(mentions(refused.error().message, "fewer instances"));
    CHECK(gltf::kMaxDecodedBytes == uint64_t(8) << 30); // what decodeGltf() allows
}
