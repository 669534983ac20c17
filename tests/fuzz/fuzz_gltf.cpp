// Any bytes into the glTF reader: a scene that keeps the promises of mesh_scene.h, or an error of one line.
#include "interchange/draco.h"
#include "interchange/gltf_file.h"
#include "interchange/jpeg.h"

#include "mesh_draco_builder.h"
#include "mesh_jpeg_builder.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iterator>

using namespace nacre;

static void require(bool condition)
{
    if (!condition) std::abort();
}

template <int N>
static void requireRows(const std::vector<glm::vec<N, float>>& rows, size_t count)
{
    require(rows.empty() || rows.size() == count);
    for (const auto& v : rows)
        for (int i = 0; i < N; i++) require(std::isfinite(v[i]));
}

static void check(const MeshScene& scene)
{
    require(scene.triangleCount() > 0);
    for (const TriangleMesh& m : scene.meshes) {
        const size_t count = m.positions.size();
        require(!m.triangles.empty() && m.material >= 0 && size_t(m.material) < scene.materials.size());
        for (const glm::uvec3& t : m.triangles) require(t.x < count && t.y < count && t.z < count);
        requireRows<3>(m.positions, count);
        requireRows<3>(m.normals, count);
        requireRows<4>(m.tangents, count);
        requireRows<2>(m.texcoords[0], count);
        requireRows<2>(m.texcoords[1], count);
        requireRows<4>(m.colors, count);
        for (const glm::vec3& n : m.normals) require(std::fabs(glm::length(n) - 1.0f) < 1e-5f);
        for (const glm::vec4& t : m.tangents) require(std::fabs(glm::length(glm::vec3(t)) - 1.0f) < 1e-5f && std::fabs(t.w) == 1.0f);
    }
    for (const MeshTexture& t : scene.textures) require(t.width > 0 && t.height > 0 && t.rgba.size() == size_t(t.width) * size_t(t.height) * 4);
    for (const MeshMaterial& m : scene.materials) {
        for (const TextureSlot* slot : {&m.baseColorTexture, &m.normalTexture, &m.anisotropyTexture, &m.transmissionTexture})
            require(slot->texture < int(scene.textures.size()) && (slot->texcoord == 0 || slot->texcoord == 1));
        require(m.roughness >= 0 && m.roughness <= 1 && m.attenuationDistance > 0 && std::fabs(m.scatterAnisotropy) < 1);
    }
}

static void requireLine(const Error& error)
{
    require(!error.message.empty() && error.message.size() < 2000 && error.message.find('\n') == std::string::npos);
}

/// Most mutations only make the lengths of the container disagree. The same content with lengths that agree reaches the code behind.
static Bytes withRepairedLengths(std::span<const std::byte> bytes)
{
    Bytes out(bytes.begin(), bytes.end());
    out.resize(std::max<size_t>(out.size() / 4 * 4, 28));
    constexpr char kBin[] = "BIN";
    const auto bin = std::search(out.begin() + 20, out.end(), reinterpret_cast<const std::byte*>(kBin), reinterpret_cast<const std::byte*>(kBin) + 4);
    const size_t binType = bin == out.end() ? 0 : size_t(bin - out.begin());
    const auto put = [&](size_t offset, size_t value) {
        const uint32_t v = uint32_t(value);
        std::memcpy(out.data() + offset, &v, 4);
    };
    put(0, 0x46546C67), put(4, 2), put(8, out.size()), put(16, 0x4E4F534A);
    const bool hasBin = binType >= 24 && binType % 4 == 0;
    put(12, (hasBin ? binType - 4 : out.size()) - 20);
    if (hasBin) put(binType - 4, out.size() - binType - 4);
    return out;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    const auto bytes = std::as_bytes(std::span(data, size));
    const Bytes file(100, std::byte(7));
    const UriReader reader = [&](const std::string& uri) -> Result<Bytes> {
        require(!uri.empty() && uri[0] != '/' && uri.find('\0') == std::string::npos);
        if (uri.find("lost") != std::string::npos) return Error{ErrorCode::kBadInput, "cannot read it"};
        return file;
    };
    for (const Bytes& input : {Bytes(bytes.begin(), bytes.end()), withRepairedLengths(bytes)}) {
        const Result<MeshScene> scene = gltf::decodeWithin(uint64_t(64) << 20, input, "fuzz.glb", reader);
        if (scene) check(*scene);
        else requireLine(scene.error());
    }
    const uint32_t ids[] = {0, 1};
    if (const Result<DracoMesh> draco = decodeDraco(bytes, ids, "fuzz.drc"); !draco) requireLine(draco.error());
    if (const Result<Image8> jpeg = decodeJpeg(bytes, "fuzz.jpg"); !jpeg) requireLine(jpeg.error());
    return 0;
}

/// Every branch of the reader in one file.
static GltfBuilder richScene()
{
    const json texture = {{"index", 0}, {"texCoord", 1}, {"extensions", {{"KHR_texture_transform", {{"offset", {0, 1}}, {"rotation", 1.5}, {"scale", {0.5, 2}}}}}}};
    GltfBuilder b = quadBuilder({{"name", "a"},
                                 {"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 1, 1}}, {"baseColorTexture", texture}}},
                                 {"normalTexture", {{"index", 0}}},
                                 {"alphaMode", "MASK"},
                                 {"extensions",
                                  {{"KHR_materials_anisotropy", {{"anisotropyStrength", 0.5}}},
                                   {"KHR_materials_volume", {{"attenuationDistance", 0.5}, {"attenuationColor", {1, 0, 1}}}},
                                   {"KHR_materials_volume_scatter", {{"multiscatterColor", {1, 0, 1}}, {"scatterAnisotropy", 0.5}}}}}});
    b.add("images", {{"bufferView", b.view(smallPng())}});
    b.add("samplers", {{"wrapS", 33648}, {"magFilter", 9728}});
    b.add("textures", {{"source", 0}, {"sampler", 0}});
    b.attributes()["COLOR_0"] = b.floats(Vec3s(4, {1, 0, 1}));
    b.attributes()["TEXCOORD_1"] = b.floats(kQuadTexcoords);
    Bytes which, values;
    appendValue(which, uint16_t(2));
    append(values, &kQuad[1], sizeof(glm::vec3));
    b.root["accessors"][0]["sparse"] = {{"count", 1},
                                        {"indices", {{"bufferView", b.view(which)}, {"componentType", 5123}}},
                                        {"values", {{"bufferView", b.view(values)}}}};
    b.mesh({{"attributes", {{"POSITION", 0}}}, {"mode", 5}});
    b.root["nodes"] = {{{"children", {1, 2}}, {"scale", {-1, 2, 1}}, {"rotation", {0, 0, 0, 1}}},
                       {{"mesh", 0}, {"translation", {1, 2, 3}}},
                       {{"mesh", 1}, {"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}},
                       {{"mesh", 0}}};
    b.root["scenes"] = json::array({{{"nodes", {0, 3}}}});
    return b;
}

/// Joints, morph targets, instances and hidden nodes.
static GltfBuilder movedScene()
{
    GltfBuilder b = quadBuilder();
    b.primitive()["targets"] = {{{"POSITION", b.floats(Vec3s(4, {0, 0, 1}))}, {"NORMAL", b.floats(Vec3s(4, {0, 1, 0}))}}};
    Bytes joints, bind;
    for (int i = 0; i < 16; i++) appendValue(joints, uint8_t(i % 2));
    for (int i = 0; i < 32; i++) appendValue(bind, float(i % 5 == 0));
    b.attributes()["JOINTS_0"] = b.accessor(b.view(joints), 5121, "VEC4", 4);
    b.attributes()["WEIGHTS_0"] = b.floats(Vec4s(4, {0.5f, 0.25f, 0.25f, 0}));
    b.add("skins", {{"joints", {1, 2}}, {"inverseBindMatrices", b.accessor(b.view(bind), 5126, "MAT4", 2)}});
    const json instancing = {{"attributes", {{"TRANSLATION", b.floats(Vec3s{{1, 0, 0}, {2, 0, 0}})}, {"SCALE", b.floats(Vec3s(2, {1, -1, 1}))}}}};
    b.root["nodes"] = {{{"mesh", 0}, {"skin", 0}, {"weights", {0.5}}},
                       {{"children", {2}}, {"translation", {1e7, 0, 0}}},
                       {{"rotation", {0, 0, 1, 0}}},
                       {{"mesh", 0}, {"extensions", {{"EXT_mesh_gpu_instancing", instancing}}}},
                       {{"mesh", 0}, {"extensions", {{"KHR_node_visibility", {{"visible", false}}}}}}};
    return b;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    GltfBuilder jpeg = quadBuilder({{"normalTexture", {{"index", 0}}}});
    jpeg.add("images", {{"bufferView", jpeg.view(flatJpeg(1, 2, 3))}});
    jpeg.add("textures", {{"source", 0}});
    const Bytes seeds[] = {
        quadBuilder().glb(),
        richScene().glb(),
        richScene().gltfEmbedded(),
        movedScene().glb(),
        quadBuilder().gltf("quad.bin"),
        jpeg.glb(),
        flatJpeg(200, 100, 50),
        dracoBuilder(dracoGrid(3, 10), DracoMethod::kSequential).glb(),
        dracoBuilder(dracoGrid(3, 10), DracoMethod::kEdgebreaker).glb(),
        encodeDraco(dracoGrid(2, 8), DracoMethod::kSequential),
        encodeDraco(dracoGrid(2, 8), DracoMethod::kEdgebreaker),
    };
    if (i >= std::size(seeds) || seeds[i].size() > cap) return 0;
    std::copy_n(reinterpret_cast<const uint8_t*>(seeds[i].data()), seeds[i].size(), out);
    return seeds[i].size();
}
