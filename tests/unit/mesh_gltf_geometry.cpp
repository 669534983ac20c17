// Containers, accessors, primitives and the repairs of triangles and normals.
#include "mesh_support.h"

#include "base/file.h"

#include <doctest/doctest.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include <stdlib.h> // mkdtemp

using namespace nacre;

TEST_CASE("the same scene reads the same from .glb, from .gltf with embedded data and from .gltf with a file beside it")
{
    const GltfBuilder b = quadBuilder({{"name", "paint"}, {"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.25, 0.125, 1}}}}});
    for (const MeshScene& scene : {load(b.glb()), load(b.gltfEmbedded()), load(b.gltf("my%20data/quad.bin"), {{"my data/quad.bin", b.bin}})}) {
        REQUIRE(scene.meshes.size() == 1);
        const TriangleMesh& m = scene.meshes[0];
        CHECK(m.positions == kQuad);
        CHECK(m.normals == Vec3s(4, {0, 0, 1}));
        CHECK(m.texcoords[0] == kQuadTexcoords);
        CHECK(m.texcoords[1].empty());
        CHECK(m.tangents.empty());
        CHECK(m.colors.empty());
        CHECK(m.triangles == std::vector<glm::uvec3>{{0, 1, 2}, {0, 2, 3}});
        REQUIRE(scene.materials.size() == 1);
        CHECK(scene.materials[0].name == "paint");
        CHECK(scene.materials[0].baseColor == glm::vec4(0.5, 0.25, 0.125, 1));
        CHECK(scene.warnings.empty());
        CHECK(scene.triangleCount() == 2);
    }
}

TEST_CASE("readGltf finds the files beside the .gltf and names what it cannot read")
{
    std::string folder = (std::filesystem::temp_directory_path() / "nacre-mesh-XXXXXX").string();
    REQUIRE(mkdtemp(folder.data()) != nullptr);
    const GltfBuilder b = quadBuilder();
    REQUIRE(writeFileAtomically(folder + "/quad.bin", b.bin));
    REQUIRE(writeFileAtomically(folder + "/quad.gltf", b.gltf("quad.bin")));
    REQUIRE(writeFileAtomically(folder + "/lost.gltf", b.gltf("lost.bin")));
    CHECK(readGltf(folder + "/quad.gltf"));
    for (const char* name : {"/lost.gltf", "/none.glb"}) {
        const Result<MeshScene> lost = readGltf(folder + name);
        REQUIRE(!lost);
        CHECK(lost.error().code == ErrorCode::kBadInput);
        CHECK(mentions(lost.error().message, name));
    }
    std::filesystem::remove_all(folder);
}

namespace {

template <class T>
Bytes packed(const Vec3s& rows, float scale, size_t stride)
{
    Bytes out(rows.size() * stride);
    for (size_t i = 0; i < rows.size(); i++)
        for (int c = 0; c < 3; c++) {
            const T v = T(rows[i][c] * scale);
            std::memcpy(out.data() + i * stride + size_t(c) * sizeof(T), &v, sizeof v);
        }
    return out;
}

/// The positions of three vertices stored as integers T.
template <class T>
Vec3s positionsFrom(int componentType, bool normalized, const Vec3s& stored)
{
    GltfBuilder b;
    const int stride = sizeof(T) == 1 ? 4 : sizeof(T) == 2 ? 8 : 12; // rows of vertex attributes start at multiples of 4
    const int a = b.accessor(b.view(packed<T>(stored, 1.0f, size_t(stride)), stride), componentType, "VEC3", stored.size());
    if (normalized) b.root["accessors"][size_t(a)]["normalized"] = true;
    b.mesh({{"attributes", {{"POSITION", a}}}});
    return load(b.glb()).meshes.at(0).positions;
}

} // namespace

TEST_CASE("every component type is read, plain and normalized")
{
    const Vec3s stored = {{0, 0, 0}, {127, 0, 0}, {0, 100, 7}}, negative = {{-128, -127, 0}, {127, 0, 0}, {0, 100, 7}};
    CHECK(positionsFrom<int8_t>(5120, false, negative) == negative);
    CHECK(positionsFrom<uint8_t>(5121, false, stored) == stored);
    CHECK(positionsFrom<int16_t>(5122, false, negative) == negative);
    CHECK(positionsFrom<uint16_t>(5123, false, stored) == stored);
    CHECK(positionsFrom<uint32_t>(5125, false, stored) == stored);
    CHECK(positionsFrom<float>(5126, false, negative) == negative);

    const Vec3s i8 = positionsFrom<int8_t>(5120, true, negative);
    CHECK(i8[0] == glm::vec3(-1, -1, 0)); // -128 counts as -127
    CHECK(i8[1] == glm::vec3(1, 0, 0));
    CHECK(i8[2] == glm::vec3(0, 100.0f / 127.0f, 7.0f / 127.0f));
    CHECK(positionsFrom<uint8_t>(5121, true, {{0, 0, 0}, {255, 0, 0}, {0, 51, 0}})[2].y == 51.0f / 255.0f);
    CHECK(positionsFrom<int16_t>(5122, true, {{0, 0, 0}, {-32768, 0, 0}, {0, 32767, 0}})[1].x == -1.0f);
    CHECK(positionsFrom<uint16_t>(5123, true, {{0, 0, 0}, {65535, 0, 0}, {0, 13107, 0}})[2].y == 13107.0f / 65535.0f);
}

TEST_CASE("interleaved attributes share a bufferView with a stride")
{
    GltfBuilder b;
    Bytes rows;
    for (size_t i = 0; i < 4; i++) {
        append(rows, &kQuad[i], sizeof(glm::vec3));
        append(rows, &kQuadTexcoords[i], sizeof(glm::vec2));
    }
    const int view = b.view(rows, 20);
    const int position = b.accessor(view, 5126, "VEC3", 4), uv = b.accessor(view, 5126, "VEC2", 4);
    b.root["accessors"][size_t(uv)]["byteOffset"] = 12;
    b.mesh({{"attributes", {{"POSITION", position}, {"TEXCOORD_0", uv}}}, {"indices", b.indices(kQuadIndices)}});
    const MeshScene scene = load(b.glb());
    CHECK(scene.meshes[0].positions == kQuad);
    CHECK(scene.meshes[0].texcoords[0] == kQuadTexcoords);
    CHECK(scene.meshes[0].normals.empty()); // flat shading

    b.root["accessors"][size_t(uv)]["byteOffset"] = 16; // the last row ends 4 bytes after the view
    checkRefused(b.glb(), ErrorCode::kBadInput, {"accessors[1] needs 84 bytes", "bufferViews[0] has 80"});
}

TEST_CASE("sparse accessors replace rows of their base, or of zeros")
{
    GltfBuilder b;
    const int base = b.floats(kQuad);
    Bytes values;
    append(values, &kQuad[2], sizeof(glm::vec3));
    const glm::vec3 moved(5, 6, 7);
    append(values, &moved, sizeof moved);
    json sparse = {{"count", 2}};
    Bytes which;
    for (uint16_t i : {2, 3}) appendValue(which, i);
    sparse["indices"] = {{"bufferView", b.view(which)}, {"componentType", 5123}};
    sparse["values"] = {{"bufferView", b.view(values)}};
    b.root["accessors"][size_t(base)]["sparse"] = sparse;
    b.mesh({{"attributes", {{"POSITION", base}}}, {"indices", b.indices(kQuadIndices)}});
    CHECK(load(b.glb()).meshes[0].positions == Vec3s{kQuad[0], kQuad[1], kQuad[2], moved});

    GltfBuilder zeros = b;
    zeros.root["accessors"][size_t(base)].erase("bufferView");
    zeros.primitive()["indices"] = zeros.indices(std::vector<uint8_t>{0, 2, 3});
    CHECK(load(zeros.glb()).meshes[0].positions == Vec3s{glm::vec3(0), kQuad[2], moved});
    zeros.root["accessors"][size_t(base)]["count"] = 4000000000u;
    checkRefused(zeros.glb(), ErrorCode::kBadInput, {"accessors[0]", "4000000000"});

    GltfBuilder outside = b;
    outside.root["accessors"][size_t(base)]["count"] = 3;
    checkRefused(outside.glb(), ErrorCode::kBadInput, {"accessors[0]", "sparse", "3"});
}

TEST_CASE("indices of 8, 16 and 32 bits, and none, make the same triangles")
{
    const auto trianglesWith = [](auto addIndices) {
        GltfBuilder b = quadBuilder();
        addIndices(b);
        return load(b.glb()).meshes[0].triangles;
    };
    const std::vector<glm::uvec3> expected = {{0, 1, 2}, {0, 2, 3}};
    CHECK(trianglesWith([](GltfBuilder& b) { b.primitive()["indices"] = b.indices(std::vector<uint8_t>{0, 1, 2, 0, 2, 3}); }) == expected);
    CHECK(trianglesWith([](GltfBuilder& b) { b.primitive()["indices"] = b.indices(std::vector<uint32_t>{0, 1, 2, 0, 2, 3}); }) == expected);

    GltfBuilder soup;
    soup.mesh({{"attributes", {{"POSITION", soup.floats(Vec3s{kQuad[0], kQuad[1], kQuad[2], kQuad[0], kQuad[2], kQuad[3]})}}}});
    const TriangleMesh m = load(soup.glb()).meshes[0];
    CHECK(m.triangles == std::vector<glm::uvec3>{{0, 1, 2}, {3, 4, 5}});
    CHECK(m.positions[4] == kQuad[2]);
}

TEST_CASE("strips and fans keep the winding, with and without indices")
{
    // Zigzag over the quad for the strip; around it for the fan. All normals must point to +z.
    for (const bool indexed : {false, true})
        for (const int mode : {5, 6}) {
            GltfBuilder b;
            Vec3s points = mode == 5 ? Vec3s{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 2, 0}} : Vec3s{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {-1, 1, 0}};
            b.mesh({{"attributes", {{"POSITION", b.floats(points)}}}, {"mode", mode}});
            if (indexed) b.primitive()["indices"] = b.indices(std::vector<uint8_t>{0, 1, 2, 3, 4});
            const TriangleMesh m = load(b.glb()).meshes[0];
            REQUIRE(m.triangles.size() == 3);
            for (const glm::uvec3& t : m.triangles) {
                const glm::vec3 n = glm::cross(m.positions[t.y] - m.positions[t.x], m.positions[t.z] - m.positions[t.x]);
                CHECK(n.z > 0);
            }
        }
}

TEST_CASE("points and lines are left out with one warning; a file of nothing else has no triangles")
{
    GltfBuilder b = quadBuilder();
    for (int mode : {0, 1, 3}) b.mesh({{"attributes", {{"POSITION", 0}}}, {"mode", mode}});
    const MeshScene scene = load(b.glb());
    CHECK(scene.meshes.size() == 1);
    CHECK(scene.warnings.size() == 1);
    CHECK(warns(scene, "points and lines"));
    b.primitive()["mode"] = 1;
    checkRefused(b.glb(), ErrorCode::kBadInput, {"no triangles"});
}

TEST_CASE("vertex colours of three and four components, of floats and of normalized integers")
{
    GltfBuilder b = quadBuilder();
    b.attributes()["COLOR_0"] = b.floats(Vec3s(4, {0.25f, 0.5f, 0.75f}));
    CHECK(load(b.glb()).meshes[0].colors == Vec4s(4, {0.25f, 0.5f, 0.75f, 1.0f}));

    Bytes rgba;
    for (int i = 0; i < 4; i++)
        for (uint8_t v : {0, 51, 255, 102}) appendValue(rgba, v);
    const int colors = b.accessor(b.view(rgba), 5121, "VEC4", 4);
    b.attributes()["COLOR_0"] = colors;
    checkRefused(b.glb(), ErrorCode::kBadInput, {"accessors[5]", "COLOR_0", "normalized"});
    b.root["accessors"][size_t(colors)]["normalized"] = true;
    CHECK(load(b.glb()).meshes[0].colors == Vec4s(4, {0.0f, 51.0f / 255.0f, 1.0f, 102.0f / 255.0f}));
}

TEST_CASE("the second set of texture coordinates and given tangents are read")
{
    GltfBuilder b = quadBuilder();
    b.attributes()["TEXCOORD_1"] = b.floats(Vec2s{{0, 0}, {2, 0}, {2, 2}, {0, 2}});
    b.attributes()["TANGENT"] = b.floats(Vec4s(4, {0, 2, 0, -1}));
    const TriangleMesh m = load(b.glb()).meshes[0];
    CHECK(m.texcoords[1][2] == glm::vec2(2, 2));
    CHECK(m.tangents == Vec4s(4, {0, 1, 0, -1}));
}

TEST_CASE("triangles without area are dropped and counted, and vertices nobody uses go")
{
    GltfBuilder b = quadBuilder();
    b.primitive()["indices"] = b.indices(std::vector<uint16_t>{0, 2, 3, 1, 1, 2, 0, 0, 0});
    const MeshScene scene = load(b.glb());
    CHECK(warns(scene, "2 triangles without area"));
    CHECK(scene.meshes[0].positions == Vec3s{kQuad[0], kQuad[2], kQuad[3]});
    CHECK(scene.meshes[0].normals.size() == 3);
    CHECK(scene.meshes[0].texcoords[0] == Vec2s{kQuadTexcoords[0], kQuadTexcoords[2], kQuadTexcoords[3]});
    CHECK(scene.meshes[0].triangles == std::vector<glm::uvec3>{{0, 1, 2}});

    GltfBuilder line;
    line.mesh({{"attributes", {{"POSITION", line.floats(Vec3s{{0, 0, 0}, {1, 1, 1}, {3, 3, 3}})}}}});
    checkRefused(line.glb(), ErrorCode::kBadInput, {"no triangles"});
}

TEST_CASE("a position that is not finite is an error that names the accessor and the element")
{
    for (const float poison : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        GltfBuilder b = quadBuilder();
        Vec3s positions = kQuad;
        positions[2].y = poison;
        b.attributes()["POSITION"] = b.floats(positions);
        checkRefused(b.glb(), ErrorCode::kBadInput, {"accessors[4]", "POSITION", "element 2"});
    }
    GltfBuilder far = quadBuilder(); // finite in the file, not in the world
    far.root["nodes"][0]["scale"] = {1e30, 1, 1};
    far.attributes()["POSITION"] = far.floats(Vec3s{{0, 0, 0}, {1e30f, 0, 0}, {0, 1, 0}, {0, 2, 0}});
    checkRefused(far.glb(), ErrorCode::kBadInput, {"range of float"});
}

TEST_CASE("normals that are not finite are left out with a warning, normals of length 0 become the face's")
{
    GltfBuilder b = quadBuilder();
    Vec3s normals(4, {0, 0, 1});
    normals[1].x = std::numeric_limits<float>::quiet_NaN();
    b.attributes()["NORMAL"] = b.floats(normals);
    MeshScene scene = load(b.glb());
    CHECK(scene.meshes[0].normals.empty());
    CHECK(warns(scene, "accessors[4] (NORMAL)"));

    b.attributes()["NORMAL"] = b.floats(Vec3s{{0, 0, 0}, {0, 3, 0}, {0, 0, 0}, {0, 0, 1e-30f}});
    scene = load(b.glb());
    CHECK(scene.meshes[0].normals == Vec3s{{0, 0, 1}, {0, 1, 0}, {0, 0, 1}, {0, 0, 1}});
    CHECK(warns(scene, "2 normals of length 0"));
}

TEST_CASE("normals that point behind their triangles are said")
{
    GltfBuilder b = quadBuilder();
    CHECK(load(b.glb()).warnings.empty());
    b.attributes()["NORMAL"] = b.floats(Vec3s(4, {0, 0, -1}));
    CHECK(warns(load(b.glb()), "the normals of 2 of 2 triangles point behind them"));
    b.primitive()["indices"] = b.indices(std::vector<uint16_t>{0, 2, 1, 0, 3, 2});
    CHECK(load(b.glb()).warnings.empty());
    b.root["nodes"][0]["scale"] = {1, -1, 1}; // mirrored as a whole
    CHECK(load(b.glb()).warnings.empty());
}

TEST_CASE("an index or a length out of bounds is an error that says which")
{
    GltfBuilder b = quadBuilder();
    b.primitive()["indices"] = b.indices(std::vector<uint16_t>{0, 1, 4});
    checkRefused(b.glb(), ErrorCode::kBadInput, {"indices", "element 2 is 4", "4 vertices"});
    b = quadBuilder();
    b.attributes()["NORMAL"] = b.floats(Vec3s(3, {0, 0, 1}));
    checkRefused(b.glb(), ErrorCode::kBadInput, {"accessors[4] (NORMAL)", "3 elements", "4"});
    const auto changed = [](const char* pointer, const json& value) {
        GltfBuilder c = quadBuilder();
        c.root[json::json_pointer(pointer)] = value;
        return c.glb();
    };
    checkRefused(changed("/accessors/0/count", 5), ErrorCode::kBadInput, {"accessors[0]", "60 bytes", "48"});
    checkRefused(changed("/accessors/0/bufferView", 9), ErrorCode::kBadInput, {"bufferView is 9", "there are 4"});
    checkRefused(changed("/accessors/0/byteOffset", 1e12), ErrorCode::kBadInput, {"accessors[0]"});
    checkRefused(changed("/accessors/0/type", "VEC4"), ErrorCode::kBadInput, {"accessors[0]"});
    checkRefused(changed("/accessors/0/type", "MAT3"), ErrorCode::kBadInput, {"accessors[0].type", "VEC3", "MAT3"});
    checkRefused(changed("/accessors/0/componentType", 5124), ErrorCode::kBadInput, {"accessors[0].componentType", "5124"});
    checkRefused(changed("/accessors/3/componentType", 5126), ErrorCode::kBadInput, {"accessors[3] needs 24 bytes"});
    checkRefused(changed("/accessors/3/componentType", 5122), ErrorCode::kBadInput, {"accessors[3]", "indices"});
    checkRefused(changed("/bufferViews/1/byteLength", 4096), ErrorCode::kBadInput, {"bufferViews[1]", "4144"});
    checkRefused(changed("/bufferViews/1/buffer", 1), ErrorCode::kBadInput, {"bufferViews[1]", "buffer is 1"});
    checkRefused(changed("/meshes/0/primitives/0/material", 1), ErrorCode::kBadInput, {"material is 1"});
    checkRefused(changed("/meshes/0/primitives/0/attributes/POSITION", -1), ErrorCode::kBadInput, {"POSITION", "-1"});
    checkRefused(changed("/meshes/0/primitives/0/attributes/POSITION", 0.5), ErrorCode::kBadInput, {"POSITION", "0.5"});
    checkRefused(changed("/meshes/0/primitives/0/mode", 7), ErrorCode::kBadInput, {"mode", "7"});
    checkRefused(changed("/accessors", 3), ErrorCode::kBadInput, {"accessors", "array"});
    checkRefused(changed("/bufferViews/0/byteStride", 8), ErrorCode::kBadInput, {"bufferViews[0].byteStride is 8", "12 bytes"});
}
