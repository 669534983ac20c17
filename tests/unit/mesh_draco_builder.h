// Draco-compressed primitives for tests, through the Draco encoder.
#pragma once

#include "mesh_builder.h"

#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <memory>

namespace nacre {

enum class DracoMethod { kSequential, kEdgebreaker };

struct DracoInput {
    Vec3s positions;
    Vec3s normals;        // optional
    Vec2s texcoords;      // optional
    Vec4s colors;         // optional; stored as 8-bit normalized integers
    std::vector<glm::uvec3> triangles;
    int positionBits = 0; // quantisation; 0: lossless (sequential only: edgebreaker needs integers)
};

/// Attribute ids: 0 position, then those that are there in the order above.
inline Bytes encodeDraco(const DracoInput& in, DracoMethod method)
{
    draco::Mesh mesh;
    mesh.set_num_points(uint32_t(in.positions.size()));
    mesh.SetNumFaces(in.triangles.size());
    for (uint32_t i = 0; i < in.triangles.size(); i++) {
        const glm::uvec3& t = in.triangles[i];
        mesh.SetFace(draco::FaceIndex(i), {draco::PointIndex(t.x), draco::PointIndex(t.y), draco::PointIndex(t.z)});
    }
    const auto addAttribute = [&](draco::GeometryAttribute::Type type, draco::DataType dataType, int components, const void* rows, size_t rowBytes) {
        draco::GeometryAttribute a;
        a.Init(type, nullptr, uint8_t(components), dataType, dataType == draco::DT_UINT8, int64_t(rowBytes), 0);
        const int id = mesh.AddAttribute(a, true, uint32_t(in.positions.size()));
        for (uint32_t i = 0; i < in.positions.size(); i++)
            mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), static_cast<const char*>(rows) + i * rowBytes);
        return id;
    };
    std::vector<glm::u8vec4> bytes;
    for (const glm::vec4& c : in.colors) bytes.emplace_back(c * 255.0f + 0.5f);
    const int position = addAttribute(draco::GeometryAttribute::POSITION, draco::DT_FLOAT32, 3, in.positions.data(), 12);
    if (!in.normals.empty()) addAttribute(draco::GeometryAttribute::NORMAL, draco::DT_FLOAT32, 3, in.normals.data(), 12);
    if (!in.texcoords.empty()) addAttribute(draco::GeometryAttribute::TEX_COORD, draco::DT_FLOAT32, 2, in.texcoords.data(), 8);
    if (!in.colors.empty()) addAttribute(draco::GeometryAttribute::COLOR, draco::DT_UINT8, 4, bytes.data(), 4);

    draco::ExpertEncoder encoder(mesh);
    encoder.SetEncodingMethod(method == DracoMethod::kSequential ? draco::MESH_SEQUENTIAL_ENCODING : draco::MESH_EDGEBREAKER_ENCODING);
    for (int id = 0; id < mesh.num_attributes(); id++)
        if (mesh.attribute(id)->data_type() == draco::DT_FLOAT32 && in.positionBits > 0)
            encoder.SetAttributeQuantization(id, id == position ? in.positionBits : 12);
    draco::EncoderBuffer buffer;
    Bytes out;
    if (encoder.EncodeToBuffer(&buffer).ok()) append(out, buffer.data(), buffer.size());
    return out;
}

/// A file whose primitive 0 holds the data, with accessors that have no bufferView, as glTF demands.
inline GltfBuilder dracoBuilder(const DracoInput& in, DracoMethod method)
{
    GltfBuilder b;
    json accessors = json::object(), ids = json::object();
    const auto attribute = [&](const char* name, const char* type, int componentType, bool there) {
        if (!there) return;
        accessors[name] = b.accessor(-1, componentType, type, in.positions.size());
        if (componentType == 5121) b.root["accessors"].back()["normalized"] = true;
        ids[name] = ids.size();
    };
    attribute("POSITION", "VEC3", 5126, true);
    attribute("NORMAL", "VEC3", 5126, !in.normals.empty());
    attribute("TEXCOORD_0", "VEC2", 5126, !in.texcoords.empty());
    attribute("COLOR_0", "VEC4", 5121, !in.colors.empty());
    const int indices = b.accessor(-1, 5125, "SCALAR", 3 * in.triangles.size());
    const int view = b.view(encodeDraco(in, method));
    b.mesh({{"attributes", accessors},
            {"indices", indices},
            {"extensions", {{"KHR_draco_mesh_compression", {{"bufferView", view}, {"attributes", ids}}}}}});
    b.root["extensionsUsed"] = b.root["extensionsRequired"] = {"KHR_draco_mesh_compression"};
    return b;
}

/// A bumpy grid of n x n squares with all attributes.
inline DracoInput dracoGrid(int n, int positionBits)
{
    DracoInput in;
    in.positionBits = positionBits;
    for (int y = 0; y <= n; y++)
        for (int x = 0; x <= n; x++) {
            const float u = float(x) / float(n), v = float(y) / float(n);
            in.positions.push_back({u, 0.1f * std::sin(7.0f * u) * std::cos(5.0f * v), v});
            in.normals.push_back(glm::normalize(glm::vec3(-0.7f * std::cos(7.0f * u), 1, 0.5f * std::sin(5.0f * v))));
            in.texcoords.push_back({u, v});
            in.colors.push_back({u, v, 0.5f, 1.0f});
        }
    for (uint32_t y = 0; y < uint32_t(n); y++)
        for (uint32_t x = 0; x < uint32_t(n); x++) {
            const uint32_t a = y * uint32_t(n + 1) + x, c = a + uint32_t(n + 1);
            in.triangles.push_back({a, c, a + 1});
            in.triangles.push_back({a + 1, c, c + 1});
        }
    return in;
}

} // namespace nacre
