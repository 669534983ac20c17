// Where meshes end up: far from the origin, tiny and huge, in many instances, hidden.
#include "mesh_support.h"

#include "interchange/gltf_file.h"

#include <cmath>

using namespace nacre;

namespace {

/// Uneven, so that rounding would show.
const Vec3s kTetrahedron = {{0.1f, 0.2f, 0.3f}, {1.1f, 0.2f, 0.3f}, {0.1f, 1.3f, 0.3f}, {0.1f, 0.2f, 1.7f}};
const std::vector<uint16_t> kTetrahedronIndices = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};

GltfBuilder tetrahedron()
{
    GltfBuilder b;
    b.mesh({{"attributes", {{"POSITION", b.floats(kTetrahedron)}}}, {"indices", b.indices(kTetrahedronIndices)}});
    return b;
}

glm::dvec3 inWorld(const MeshScene& scene, size_t mesh, size_t vertex) { return scene.origin + glm::dvec3(scene.meshes[mesh].positions[vertex]); }

} // namespace

TEST_CASE("a scene an earth radius away keeps its shape, whichever node carries the distance")
{
    GltfBuilder direct = tetrahedron();
    direct.root["nodes"][0]["translation"] = {6378137.0, -123456.7, 1e7};
    GltfBuilder nested = tetrahedron(); // there and half back
    nested.root["nodes"] = {{{"translation", {12756274.0, -246913.4, 2e7}}, {"children", {1}}}, {{"mesh", 0}, {"translation", {-6378137.0, 123456.7, -1e7}}}};
    GltfBuilder matrix = tetrahedron();
    matrix.root["nodes"][0]["matrix"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 6378137.0, -123456.7, 1e7, 1};
    for (const GltfBuilder& b : {direct, nested, matrix}) {
        const MeshScene scene = load(b.glb());
        CHECK(scene.warnings.empty());
        for (size_t i = 1; i < 4; i++) {
            const glm::vec3 edge = scene.meshes[0].positions[i] - scene.meshes[0].positions[0];
            CHECK(near(edge, kTetrahedron[i] - kTetrahedron[0], 3e-7f)); // rounding of coordinates of about 1
        }
        CHECK(glm::distance(inWorld(scene, 0, 0), glm::dvec3(6378137.1, -123456.5, 1e7 + 0.3)) < 1e-6);
    }
}

TEST_CASE("a scene near the origin stays in the file's coordinates, to the bit")
{
    GltfBuilder b = tetrahedron();
    b.root["nodes"][0]["translation"] = {10, 0, 0};
    const MeshScene scene = load(b.glb());
    CHECK(scene.origin == glm::dvec3(0.0));
    CHECK(scene.meshes[0].positions[0].x == float(10.0 + double(kTetrahedron[0].x)));
}

TEST_CASE("positions that the file itself has rounded are said")
{
    GltfBuilder b;
    Vec3s far = kTetrahedron;
    for (glm::vec3& p : far) p += glm::vec3(6378137, 0, 0);
    b.mesh({{"attributes", {{"POSITION", b.floats(far)}}}, {"indices", b.indices(kTetrahedronIndices)}});
    CHECK(warns(load(b.glb()), "the file itself rounds it"));
    CHECK(load(tetrahedron().glb()).warnings.empty());
}

TEST_CASE("meshes from 1e-12 to 1e12 of a metre across keep all their triangles; the reason is given where that ends")
{
    for (const double size : {1e-20, 1e-12, 1e-6, 1.0, 1e6, 1e12, 1e20}) {
        CAPTURE(size);
        GltfBuilder b = tetrahedron();
        b.root["nodes"][0]["scale"] = {size, size, size};
        const MeshScene scene = load(b.glb());
        CHECK(scene.triangleCount() == 4);
        CHECK(scene.warnings.empty());
        CHECK(double(scene.meshes[0].positions[3].z - scene.meshes[0].positions[0].z) == doctest::Approx(1.4 * size));

        GltfBuilder small; // the same by its coordinates
        Vec3s points = kTetrahedron;
        for (glm::vec3& p : points) p *= float(size);
        small.mesh({{"attributes", {{"POSITION", small.floats(points)}}}, {"indices", small.indices(kTetrahedronIndices)}});
        CHECK(load(small.glb()).triangleCount() == 4);
        CHECK(load(small.glb()).warnings.empty());
    }
    GltfBuilder b = tetrahedron();
    b.root["nodes"][0]["scale"] = {0, 0, 0};
    checkRefused(b.glb(), ErrorCode::kBadInput, {"no triangles with area", "4 triangles", "scale 0"});
    b.root["nodes"] = {{{"scale", {1e-25, 1e-25, 1e-25}}, {"children", {1}}}, {{"mesh", 0}, {"scale", {1e-10, 1e-10, 1e-10}}}};
    checkRefused(b.glb(), ErrorCode::kBadInput, {"too small for float"});
    b.root["nodes"] = {{{"scale", {1e25, 1e25, 1e25}}, {"children", {1}}}, {{"mesh", 0}, {"scale", {1e20, 1e20, 1e20}}}};
    checkRefused(b.glb(), ErrorCode::kBadInput, {"range of float"});
}

TEST_CASE("triangles without area in strips and fans are legal and dropped without a word")
{
    // Two quads joined through repeated vertices, by index and by place.
    GltfBuilder b;
    const Vec3s points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {5, 0, 0}, {6, 0, 0}, {5, 1, 0}, {6, 1, 0}};
    b.mesh({{"attributes", {{"POSITION", b.floats(points)}}}, {"mode", 5}, {"indices", b.indices(std::vector<uint16_t>{0, 1, 2, 3, 3, 4, 4, 5, 6, 7})}});
    const MeshScene scene = load(b.glb());
    CHECK(scene.triangleCount() == 4);
    CHECK(scene.warnings.empty());
    GltfBuilder places;
    Vec3s repeated;
    for (int i : {0, 1, 2, 3, 3, 4, 4, 5, 6, 7}) repeated.push_back(points[size_t(i)]);
    places.mesh({{"attributes", {{"POSITION", places.floats(repeated)}}}, {"mode", 5}});
    CHECK(load(places.glb()).triangleCount() == 4);
    CHECK(load(places.glb()).warnings.empty());
}

TEST_CASE("EXT_mesh_gpu_instancing shows the mesh once per instance, as nodes would")
{
    const auto instanced = [](const char* required) {
        GltfBuilder b = tetrahedron();
        const int t = b.floats(Vec3s{{0, 0, 0}, {2.5f, 0, 0}, {-2.5f, 0, 0.5f}}), r = b.floats(Vec4s{{0, 0, 0, 1}, {0, 0.38268343f, 0, 0.92387953f}, {0, 0, 0, 1}}),
                  s = b.floats(Vec3s{{1, 1, 1}, {0.5f, 0.5f, 0.5f}, {-0.7f, 1, 0.7f}});
        b.root["nodes"][0] = {{"mesh", 0}, {"translation", {1, 2, 3}}};
        b.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {{"TRANSLATION", t}, {"ROTATION", r}, {"SCALE", s}};
        b.root["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
        if (required) b.root["extensionsRequired"] = {required};
        return b;
    };
    GltfBuilder nodes = tetrahedron();
    nodes.root["nodes"] = {{{"translation", {1, 2, 3}}, {"children", {1, 2, 3}}},
                           {{"mesh", 0}},
                           {{"mesh", 0}, {"translation", {2.5, 0, 0}}, {"rotation", {0, 0.38268343, 0, 0.92387953}}, {"scale", {0.5, 0.5, 0.5}}},
                           {{"mesh", 0}, {"translation", {-2.5, 0, 0.5}}, {"scale", {-0.7, 1, 0.7}}}};
    const MeshScene expected = load(nodes.glb());
    for (const char* required : {static_cast<const char*>(nullptr), "EXT_mesh_gpu_instancing"}) {
        const MeshScene scene = load(instanced(required).glb());
        CHECK(scene.warnings.empty());
        REQUIRE(scene.triangleCount() == 12);
        std::vector<glm::vec3> found, wanted; // corners in order, so that winding counts
        for (const TriangleMesh& m : scene.meshes)
            for (const glm::uvec3& t : m.triangles)
                for (int k = 0; k < 3; k++) found.push_back(m.positions[t[k]]);
        for (const TriangleMesh& m : expected.meshes)
            for (const glm::uvec3& t : m.triangles)
                for (int k = 0; k < 3; k++) wanted.push_back(m.positions[t[k]]);
        for (size_t i = 0; i < wanted.size(); i++) CHECK(near(found[i], wanted[i], 1e-5f));
    }

    GltfBuilder b = instanced(nullptr);
    json& attributes = b.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
    attributes.erase("ROTATION"), attributes.erase("SCALE");
    CHECK(load(b.glb()).triangleCount() == 12); // what is missing has its default
    attributes["SCALE"] = b.floats(Vec3s(2, glm::vec3(1)));
    checkRefused(b.glb(), ErrorCode::kBadInput, {"SCALE", "2"});
    attributes.erase("SCALE");
    attributes["ROTATION"] = b.floats(Vec4s(3, glm::vec4(0)));
    checkRefused(b.glb(), ErrorCode::kBadInput, {"ROTATION", "element 0"});
    attributes.erase("ROTATION"), attributes.erase("TRANSLATION");
    checkRefused(b.glb(), ErrorCode::kBadInput, {"none of TRANSLATION"});
    attributes["TRANSLATION"] = b.accessor(-1, 5126, "VEC3", 4000000); // zeros: 4 million instances from nothing
    const Result<MeshScene> refused = gltf::decodeWithin(uint64_t(64) << 20, b.glb(), "many.glb", {});
    REQUIRE(!refused);
    CHECK(mentions(refused.error().message, "fewer instances"));
}

TEST_CASE("rotations of instances may be normalized integers")
{
    GltfBuilder b = tetrahedron();
    Bytes rows;
    for (int16_t v : {0, 23170, 0, 23170}) appendValue(rows, v); // a quarter turn about y
    const int r = b.accessor(b.view(rows), 5122, "VEC4", 1);
    b.root["accessors"][size_t(r)]["normalized"] = true;
    b.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {{"ROTATION", r}};
    CHECK(near(load(b.glb()).meshes[0].positions[1], {0.3f, 0.2f, -1.1f}, 1e-4f)); // 16 bits
}

TEST_CASE("KHR_node_visibility hides a node and what is below it; hidden joints and parents still move the rest")
{
    GltfBuilder b = tetrahedron();
    const json hidden = {{"KHR_node_visibility", {{"visible", false}}}}, visible = {{"KHR_node_visibility", {{"visible", true}}}};
    b.root["nodes"] = {{{"mesh", 0}, {"name", "shown"}, {"extensions", visible}},
                       {{"children", {2}}, {"extensions", hidden}},
                       {{"mesh", 0}, {"name", "below"}, {"extensions", visible}, {"translation", {9, 0, 0}}}};
    b.root["extensionsUsed"] = b.root["extensionsRequired"] = {"KHR_node_visibility"};
    const MeshScene scene = load(b.glb());
    REQUIRE(scene.meshes.size() == 1);
    CHECK(scene.meshes[0].name == "shown");
    CHECK(scene.warnings.empty());
    b.root["nodes"][0]["extensions"] = hidden;
    checkRefused(b.glb(), ErrorCode::kBadInput, {"no triangles"});
}

TEST_CASE("a matrix whose last row is off by rounding is affine; another is refused with the likely cause")
{
    GltfBuilder exact = tetrahedron(), b = tetrahedron();
    exact.root["nodes"][0]["matrix"] = {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 1, 2, 3, 1};
    const MeshScene expected = load(exact.glb());
    b.root["nodes"][0]["matrix"] = {2, 0, 0, 3e-8, 0, 2, 0, -1e-7, 0, 0, 2, 1e-9, 1, 2, 3, 0.99999994};
    const MeshScene scene = load(b.glb());
    for (size_t i = 0; i < 4; i++) CHECK(near(scene.meshes[0].positions[i], expected.meshes[0].positions[i], 1e-6f));
    b.root["nodes"][0]["scale"] = {7, 7, 7};
    CHECK(warns(load(b.glb()), "the matrix counts"));
    b.root["nodes"][0].erase("scale");
    b.root["nodes"][0]["matrix"] = {2, 0, 0, 1, 0, 2, 0, 2, 0, 0, 2, 3, 0, 0, 0, 1};
    checkRefused(b.glb(), ErrorCode::kBadInput, {"nodes[0].matrix", "affine", "row by row"});
    b.root["nodes"][0]["matrix"] = {2, 0, 0, 0.3, 0, 2, 0, 0, 0, 0, 2, 0, 1, 2, 3, 1}; // a projection
    checkRefused(b.glb(), ErrorCode::kBadInput, {"nodes[0].matrix", "affine", "another last row"});
}

TEST_CASE("a GLB ends where its header says: what stands behind is ignored with a word, what is missing is an error")
{
    const Bytes good = tetrahedron().glb();
    for (const size_t more : {1, 4, 100}) {
        Bytes longer = good;
        longer.resize(good.size() + more, std::byte(0xab));
        const MeshScene scene = load(longer);
        CHECK(scene.triangleCount() == 4);
        CHECK(warns(scene, (std::to_string(more) + " bytes behind the end").c_str()));
    }
    const auto withLength = [&](uint32_t length) {
        Bytes b = good;
        std::memcpy(&b[8], &length, 4);
        return b;
    };
    checkRefused(withLength(uint32_t(good.size()) + 4), ErrorCode::kBadInput, {"header says", "the file has"});
    checkRefused(withLength(uint32_t(good.size()) - 4), ErrorCode::kBadInput, {"chunk 1"});
    checkRefused(withLength(0), ErrorCode::kBadInput, {"header says 0 bytes"});
}

TEST_CASE("several scenes and no default: the first, with a word")
{
    GltfBuilder b = tetrahedron();
    b.root["scenes"] = {{{"nodes", {0}}}, {{"nodes", json::array()}}};
    CHECK(warns(load(b.glb()), "2 scenes"));
    b.root["scene"] = 0;
    CHECK(load(b.glb()).warnings.empty());
}
