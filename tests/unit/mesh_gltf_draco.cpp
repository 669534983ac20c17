// KHR_draco_mesh_compression: round trips through the encoder, and damage.
#include "mesh_draco_builder.h"
#include "mesh_support.h"

#include "interchange/draco.h"

#include <algorithm>
#include <array>
#include <cmath>

using namespace nacre;

namespace {

/// The corners of all triangles, in an order of their own: Draco reorders vertices and triangles.
using Corner = std::array<float, 12>; // position, normal, texture coordinates, colour

template <class Mesh, class Texcoords>
std::vector<std::array<Corner, 3>> sortedTriangles(const Mesh& m, const Texcoords& uv, const std::vector<glm::uvec3>& triangles)
{
    std::vector<std::array<Corner, 3>> out;
    for (const glm::uvec3& t : triangles) {
        std::array<Corner, 3> corners;
        for (int k = 0; k < 3; k++) {
            const uint32_t i = t[k];
            corners[size_t(k)] = {m.positions[i].x, m.positions[i].y, m.positions[i].z, m.normals[i].x, m.normals[i].y, m.normals[i].z,
                                  uv[i].x, uv[i].y, m.colors[i].x, m.colors[i].y, m.colors[i].z, m.colors[i].w};
        }
        // The same triangle may begin at another corner; its winding must stay.
        std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
                        return std::lround(a[0] * 100) != std::lround(b[0] * 100) ? a[0] < b[0] : a[2] < b[2];
                    }), corners.end());
        out.push_back(corners);
    }
    const auto key = [](const std::array<Corner, 3>& t) {
        std::array<long, 6> k;
        for (size_t i = 0; i < 3; i++) k[2 * i] = std::lround(t[i][0] * 100), k[2 * i + 1] = std::lround(t[i][2] * 100);
        return k;
    };
    std::sort(out.begin(), out.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
    return out;
}

} // namespace

TEST_CASE("a compressed mesh comes back: triangles, winding and every attribute, within the quantisation")
{
    for (const DracoMethod method : {DracoMethod::kSequential, DracoMethod::kEdgebreaker}) {
        const DracoInput in = dracoGrid(8, 14);
        const MeshScene scene = load(dracoBuilder(in, method).glb());
        REQUIRE(scene.meshes.size() == 1);
        CHECK(scene.warnings.empty());
        const TriangleMesh& m = scene.meshes[0];
        CHECK(m.positions.size() == in.positions.size());
        const auto expected = sortedTriangles(in, in.texcoords, in.triangles), found = sortedTriangles(m, m.texcoords[0], m.triangles);
        REQUIRE(found.size() == expected.size());
        for (size_t t = 0; t < found.size(); t++)
            for (size_t k = 0; k < 3; k++)
                for (size_t c = 0; c < 12; c++) {
                    // Steps of quantisation: positions 2^-14, normals and texture coordinates 2^-12 (an octahedron's are wider), colours 1/255.
                    const float tolerance = c < 3 ? 1e-4f : c < 8 ? 2e-3f : 0.5f / 255.0f + 1e-6f;
                    CHECK(std::fabs(found[t][k][c] - expected[t][k][c]) <= tolerance);
                }
    }
}

TEST_CASE("lossless sequential data is exact, and attributes outside the Draco data come from their accessors")
{
    DracoInput in;
    in.positions = kQuad;
    in.triangles = {{0, 1, 2}, {0, 2, 3}};
    GltfBuilder b = dracoBuilder(in, DracoMethod::kSequential);
    b.attributes()["TEXCOORD_0"] = b.floats(kQuadTexcoords);
    const TriangleMesh m = load(b.glb()).meshes[0];
    CHECK(m.positions == kQuad);
    CHECK(m.texcoords[0] == kQuadTexcoords);
    CHECK(m.triangles == std::vector<glm::uvec3>{{0, 1, 2}, {0, 2, 3}});
}

TEST_CASE("Draco data cut off at any byte is an error of one line")
{
    for (const DracoMethod method : {DracoMethod::kSequential, DracoMethod::kEdgebreaker}) {
        const Bytes good = encodeDraco(dracoGrid(4, 10), method);
        const uint32_t ids[] = {0, 1, 2, 3};
        REQUIRE(decodeDraco(good, ids, "good"));
        for (size_t n = 0; n < good.size(); n++) {
            const Bytes cut(good.begin(), good.begin() + ptrdiff_t(n)); // a copy, so that a sanitizer sees the first byte too many
            const Result<DracoMesh> r = decodeDraco(cut, ids, "cut");
            REQUIRE(!r);
            CHECK(r.error().message.find('\n') == std::string::npos);
        }
    }
}

TEST_CASE("Draco headers that claim too much, other versions and missing attributes are refused by name")
{
    const GltfBuilder good = dracoBuilder(dracoGrid(4, 10), DracoMethod::kSequential);
    const size_t at = good.root["bufferViews"][0]["byteOffset"];
    GltfBuilder b = good;
    for (size_t i = 0; i < 5; i++) b.bin[at + 11 + i] = std::byte(i < 4 ? 0xff : 0x0f); // 2^32 - 1 triangles
    checkRefused(b.glb(), ErrorCode::kBadInput, {"KHR_draco_mesh_compression", "claims 4294967295 triangles"});
    b = good;
    b.bin[at + 5] = std::byte(1);
    checkRefused(b.glb(), ErrorCode::kUnsupported, {"Draco bitstream 1.2", "2.2"});
    b = good;
    b.bin[at] = std::byte('X');
    checkRefused(b.glb(), ErrorCode::kBadInput, {"not Draco data"});
    b = good;
    b.primitive()["extensions"]["KHR_draco_mesh_compression"]["attributes"]["NORMAL"] = 77;
    checkRefused(b.glb(), ErrorCode::kBadInput, {"no attribute 77"});
    b = good;
    b.primitive()["extensions"]["KHR_draco_mesh_compression"]["attributes"]["NORMAL"] = 2; // two components
    checkRefused(b.glb(), ErrorCode::kBadInput, {"NORMAL", "2 components, expected 3"});
}
