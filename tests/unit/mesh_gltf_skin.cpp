// Skins and morph targets at rest.
#include "mesh_support.h"

#include <glm/gtc/matrix_transform.hpp>

#include <cmath>

using namespace nacre;

namespace {

/// The quad of mesh_builder.h on two joints (nodes 1 and 2); vertices 0 and 3 hang on the first, 1 and 2 on the second.
GltfBuilder skinnedQuad()
{
    GltfBuilder b = quadBuilder();
    Bytes joints;
    for (int i = 0; i < 4; i++)
        for (uint8_t j : {uint8_t(i == 1 || i == 2), uint8_t(0), uint8_t(0), uint8_t(0)}) appendValue(joints, j);
    b.attributes()["JOINTS_0"] = b.accessor(b.view(joints), 5121, "VEC4", 4);
    b.attributes()["WEIGHTS_0"] = b.floats(Vec4s(4, {1, 0, 0, 0}));
    b.root["nodes"][0]["skin"] = 0;
    b.add("nodes", {{"name", "left"}});
    b.add("nodes", {{"name", "right"}});
    b.add("skins", {{"joints", {1, 2}}});
    return b;
}

int matrices(GltfBuilder& b, const std::vector<glm::mat4>& rows)
{
    Bytes bytes;
    append(bytes, rows.data(), rows.size() * sizeof(glm::mat4));
    return b.accessor(b.view(bytes), 5126, "MAT4", rows.size());
}

} // namespace

TEST_CASE("the transform of the node that shows a skinned mesh has no part in it, nor have its parents")
{
    GltfBuilder b = skinnedQuad();
    b.root["nodes"][0]["translation"] = {3, 0, 0};
    b.root["nodes"][0]["scale"] = {0.01, 0.01, 0.01};
    b.add("nodes", {{"children", {0}}, {"rotation", {0, 1, 0, 0}}});
    const MeshScene scene = load(b.glb());
    CHECK(scene.meshes[0].positions == kQuad);
    CHECK(scene.meshes[0].normals == Vec3s(4, {0, 0, 1}));
    CHECK(scene.warnings.empty());
}

TEST_CASE("joints move their vertices: the joint's world transform times its inverse bind matrix")
{
    GltfBuilder b = skinnedQuad();
    // Bound at x = 1; at rest one higher and turned a quarter about z. The armature above stands at (0, 10, 0).
    const glm::dmat4 bind = glm::translate(glm::dmat4(1), {1, 0, 0});
    b.root["nodes"][2] = {{"translation", {1, 1, 0}}, {"rotation", {0, 0, std::sqrt(0.5), std::sqrt(0.5)}}};
    b.add("nodes", {{"children", {1, 2}}, {"translation", {0, 10, 0}}});
    b.root["skins"][0]["inverseBindMatrices"] = matrices(b, {glm::mat4(1), glm::mat4(glm::inverse(bind))});
    const MeshScene scene = load(b.glb());
    const auto& p = scene.meshes[0].positions;
    CHECK(near(p[0], {-1, 9, 0}));
    CHECK(near(p[3], {-1, 11, 0}));
    CHECK(near(p[1], {2, 11, 0})); // (1, -1) is (0, -1) in the joint, turned (1, 0), at (1, 11)
    CHECK(near(p[2], {0, 11, 0}));
    for (const glm::vec3& n : scene.meshes[0].normals) CHECK(near(n, {0, 0, 1}));
}

TEST_CASE("weights are normalised, in any number of sets, of floats and of integers")
{
    GltfBuilder b = skinnedQuad();
    b.root["nodes"][2]["translation"] = {0, 0, 4};
    // Vertex 1: joint 1 with 3, and with 1 in the second set joint 0: three quarters of the way.
    b.attributes()["WEIGHTS_0"] = b.floats(Vec4s{{1, 0, 0, 0}, {3, 0, 0, 0}, {0.5f, 0, 0, 0}, {1, 0, 0, 0}});
    b.attributes()["JOINTS_1"] = b.accessor(-1, 5123, "VEC4", 4);
    b.attributes()["WEIGHTS_1"] = b.floats(Vec4s{{0, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}});
    const MeshScene scene = load(b.glb());
    CHECK(scene.meshes[0].positions[0].z == 0.0f);
    CHECK(scene.meshes[0].positions[1].z == doctest::Approx(3.0f));
    CHECK(scene.meshes[0].positions[2].z == doctest::Approx(4.0f));

    GltfBuilder integers = skinnedQuad();
    integers.root["nodes"][2]["translation"] = {0, 0, 4};
    Bytes bytes;
    for (int i = 0; i < 4; i++)
        for (uint8_t w : {127, 127, 0, 0}) appendValue(bytes, w); // 254, not 255: rounding of the exporter
    const int weights = integers.accessor(integers.view(bytes), 5121, "VEC4", 4);
    integers.root["accessors"][size_t(weights)]["normalized"] = true;
    integers.attributes()["WEIGHTS_0"] = weights;
    CHECK(load(integers.glb()).meshes[0].positions[1].z == doctest::Approx(2.0f));
}

TEST_CASE("a skeleton far from the origin bends its mesh without rounding it")
{
    GltfBuilder b = skinnedQuad();
    b.add("nodes", {{"children", {1, 2}}, {"translation", {6378137, 0, 0}}});
    const MeshScene scene = load(b.glb());
    for (size_t i = 0; i < 4; i++) CHECK(near(glm::vec3(scene.origin - glm::dvec3(6378137, 0, 0)) + scene.meshes[0].positions[i], kQuad[i], 1e-6f));
}

TEST_CASE("a mirrored skeleton keeps the outside outside")
{
    GltfBuilder b = skinnedQuad();
    b.add("nodes", {{"children", {1, 2}}, {"scale", {-1, 1, 1}}});
    const TriangleMesh m = load(b.glb()).meshes[0];
    for (const glm::uvec3& t : m.triangles) CHECK(glm::cross(m.positions[t.y] - m.positions[t.x], m.positions[t.z] - m.positions[t.x]).z > 0);
    CHECK(m.normals[0] == glm::vec3(0, 0, 1));
}

TEST_CASE("skins that are wrong are errors or warnings that say where")
{
    GltfBuilder b = skinnedQuad();
    b.root["skins"][0]["joints"] = {1};
    checkRefused(b.glb(), ErrorCode::kBadInput, {"vertex 1", "joint 1", "has 1"});
    b = skinnedQuad();
    b.root["nodes"][0]["skin"] = 3;
    checkRefused(b.glb(), ErrorCode::kBadInput, {"skin is 3"});
    b = skinnedQuad();
    b.root["skins"][0]["inverseBindMatrices"] = matrices(b, {glm::mat4(1)});
    checkRefused(b.glb(), ErrorCode::kBadInput, {"2 joints", "1 inverse bind"});
    b = skinnedQuad();
    b.root["skins"][0]["inverseBindMatrices"] = matrices(b, {glm::mat4(1), glm::transpose(glm::translate(glm::mat4(1), {5, 0, 0}))});
    checkRefused(b.glb(), ErrorCode::kBadInput, {"inverse bind matrix 1", "columns, not rows"});
    b = skinnedQuad();
    b.root["nodes"][2]["scale"] = {1, 0, 1};
    CHECK(warns(load(b.glb()), "joints flatten"));
    b = skinnedQuad();
    b.attributes()["WEIGHTS_0"] = b.floats(Vec4s{{1, 0, 0, 0}, {0, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}});
    CHECK(warns(load(b.glb()), "1 vertices of a skin have no weights"));
    b = skinnedQuad();
    b.attributes().erase("JOINTS_0");
    CHECK(warns(load(b.glb()), "has no joints"));
}

TEST_CASE("morph targets: the node's weights, else the mesh's, else none; no word about weights of 0")
{
    GltfBuilder b = quadBuilder();
    const int up = b.floats(Vec3s(4, {0, 0, 1})), side = b.floats(Vec3s(4, {1, 0, 0})), tilt = b.floats(Vec3s(4, {1, 0, 0}));
    b.primitive()["targets"] = {{{"POSITION", up}}, {{"POSITION", side}, {"NORMAL", tilt}}};
    const auto moved = [&] { return load(b.glb()).meshes[0].positions[0] - kQuad[0]; };
    CHECK(moved() == glm::vec3(0));
    CHECK(load(b.glb()).warnings.empty());
    b.root["meshes"][0]["weights"] = {0.5, 0};
    CHECK(moved() == glm::vec3(0, 0, 0.5f));
    b.root["nodes"][0]["weights"] = {0, 1};
    CHECK(moved() == glm::vec3(1, 0, 0));
    const MeshScene scene = load(b.glb());
    CHECK(near(scene.meshes[0].normals[0], glm::normalize(glm::vec3(1, 0, 1))));
    CHECK(scene.warnings.empty());
    // Two nodes, each with its own shape.
    b.add("nodes", {{"mesh", 0}, {"weights", {2, 0}}});
    CHECK(load(b.glb()).meshes[1].positions[0] == kQuad[0] + glm::vec3(0, 0, 2));

    b.root["nodes"][0]["weights"] = {1};
    checkRefused(b.glb(), ErrorCode::kBadInput, {"nodes[0].weights", "2 numbers"});
    b.root["nodes"][0]["weights"] = {1, 1};
    b.primitive()["targets"][1]["POSITION"] = b.floats(Vec3s(3, {1, 0, 0}));
    checkRefused(b.glb(), ErrorCode::kBadInput, {"morph target", "3 elements"});
}

TEST_CASE("a mesh is morphed before its skin bends it")
{
    GltfBuilder b = skinnedQuad();
    b.primitive()["targets"] = {{{"POSITION", b.floats(Vec3s(4, {1, 0, 0}))}}};
    b.root["meshes"][0]["weights"] = {1};
    b.root["nodes"][1]["scale"] = b.root["nodes"][2]["scale"] = {2, 2, 2};
    CHECK(near(load(b.glb()).meshes[0].positions[1], 2.0f * (kQuad[1] + glm::vec3(1, 0, 0))));
}
