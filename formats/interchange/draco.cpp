// Draco meshes through the Draco library.
//
// The library reserves memory for as many triangles as the data claim, so the claim is read and judged first. Layout of bitstream
// 2.2: "DRACO", major, minor, geometry type, method, flags (u16), metadata if flagged, then for method 0 (sequential) the triangle
// and vertex counts and for method 1 (edgebreaker) a traversal type, the vertex and triangle counts; all counts are LEB128.
#include "interchange/draco.h"

#include <draco/compression/decode.h>
#include <draco/core/varint_decoding.h>
#include <draco/metadata/metadata_decoder.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <new>

namespace nacre {
namespace {

Error bad(const std::string& name, const std::string& what) { return {ErrorCode::kBadInput, name + ": " + what}; }

struct Counts {
    uint32_t triangles = 0, vertices = 0;
};

Result<Counts> readCounts(std::span<const std::byte> bytes, const std::string& name)
{
    constexpr uint8_t kTriangularMesh = 1, kSequential = 0, kEdgebreaker = 1;
    constexpr uint16_t kHasMetadata = 0x8000;
    const Error cutOff = bad(name, "Draco data is cut off within its header");

    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    buffer.set_bitstream_version(DRACO_BITSTREAM_VERSION(2, 2));
    char magic[5];
    uint8_t major = 0, minor = 0, type = 0, method = 0, traversal = 0;
    uint16_t flags = 0;
    if (!buffer.Decode(magic, 5) || std::memcmp(magic, "DRACO", 5) != 0) return bad(name, "not Draco data");
    if (!buffer.Decode(&major) || !buffer.Decode(&minor) || !buffer.Decode(&type) || !buffer.Decode(&method) || !buffer.Decode(&flags)) return cutOff;
    if (major != 2 || minor != 2)
        return Error{ErrorCode::kUnsupported, name + ": Draco bitstream " + std::to_string(major) + "." + std::to_string(minor) +
                                                  ", glTF demands 2.2; compress the mesh again"};
    if (type != kTriangularMesh) return bad(name, "Draco data is not a triangle mesh");
    if (flags & kHasMetadata) {
        draco::GeometryMetadata metadata;
        if (!draco::MetadataDecoder().DecodeGeometryMetadata(&buffer, &metadata)) return bad(name, "damaged Draco metadata");
    }
    Counts counts;
    if (method == kEdgebreaker) {
        if (!buffer.Decode(&traversal) || !draco::DecodeVarint(&counts.vertices, &buffer) || !draco::DecodeVarint(&counts.triangles, &buffer))
            return cutOff;
    } else if (method == kSequential) {
        if (!draco::DecodeVarint(&counts.triangles, &buffer) || !draco::DecodeVarint(&counts.vertices, &buffer)) return cutOff;
    } else {
        return bad(name, "unknown Draco method " + std::to_string(method));
    }
    return counts;
}

Status checkCounts(const Counts& counts, size_t byteCount, const std::string& name)
{
    const uint64_t limit = std::min<uint64_t>(kMaxDracoTriangles, kMaxDracoTrianglesPerByte * byteCount);
    if (counts.triangles > limit || counts.vertices > 3 * uint64_t(counts.triangles))
        return bad(name, "Draco data of " + std::to_string(byteCount) + " bytes claims " + std::to_string(counts.triangles) + " triangles and " +
                             std::to_string(counts.vertices) + " vertices, at most " + std::to_string(limit) +
                             " triangles of 3 vertices are accepted; damaged, or to be split into several meshes");
    return ok();
}

int componentTypeOf(draco::DataType type)
{
    switch (type) {
    case draco::DT_INT8: return 5120;
    case draco::DT_UINT8: return 5121;
    case draco::DT_INT16: return 5122;
    case draco::DT_UINT16: return 5123;
    case draco::DT_UINT32: return 5125;
    case draco::DT_FLOAT32: return 5126;
    default: return 0;
    }
}

/// The values of every vertex; Draco keeps equal ones once and a map from vertex to value.
Result<DracoAttribute> readAttribute(const draco::Mesh& mesh, uint32_t id, const std::string& name)
{
    const draco::PointAttribute* attribute = mesh.GetAttributeByUniqueId(id);
    if (!attribute) return bad(name, "the Draco data has no attribute " + std::to_string(id));
    DracoAttribute out;
    out.id = id;
    out.components = attribute->num_components();
    out.componentType = componentTypeOf(attribute->data_type());
    if (out.componentType == 0 || out.components < 1 || out.components > 4)
        return bad(name, "Draco attribute " + std::to_string(id) + " has a type that glTF does not have");
    if (!attribute->is_mapping_identity() && attribute->indices_map_size() < mesh.num_points())
        return bad(name, "damaged Draco data: attribute " + std::to_string(id) + " does not cover all vertices");
    const size_t rowBytes = size_t(draco::DataTypeLength(attribute->data_type())) * size_t(out.components);
    out.rows.resize(mesh.num_points() * rowBytes);
    for (uint32_t i = 0; i < mesh.num_points(); ++i) {
        const draco::AttributeValueIndex value = attribute->mapped_index(draco::PointIndex(i));
        const auto end = int64_t(value.value() + uint64_t(1)) * attribute->byte_stride();
        if (size_t(attribute->byte_stride()) < rowBytes || attribute->byte_offset() + end > int64_t(attribute->buffer()->data_size()))
            return bad(name, "damaged Draco data: attribute " + std::to_string(id) + " ends too early");
        std::memcpy(out.rows.data() + i * rowBytes, attribute->GetAddress(value), rowBytes);
    }
    return out;
}

Result<DracoMesh> decodeOrThrow(std::span<const std::byte> bytes, std::span<const uint32_t> ids, const std::string& name)
{
    const Result<Counts> counts = readCounts(bytes, name);
    if (!counts) return counts.error();
    if (Status s = checkCounts(*counts, bytes.size(), name); !s) return s.error();

    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    draco::Decoder decoder;
    auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
    if (!decoded.ok()) return bad(name, std::string("damaged Draco data: ") + decoded.status().error_msg());
    const draco::Mesh& mesh = *decoded.value();

    DracoMesh out;
    out.vertexCount = mesh.num_points();
    if (out.vertexCount > 3 * uint64_t(counts->triangles)) return bad(name, "damaged Draco data: more vertices than corners");
    out.triangles.resize(mesh.num_faces());
    for (uint32_t i = 0; i < mesh.num_faces(); ++i) {
        const draco::Mesh::Face& face = mesh.face(draco::FaceIndex(i));
        for (int k = 0; k < 3; ++k) {
            if (face[size_t(k)].value() >= out.vertexCount) return bad(name, "damaged Draco data: a triangle names a vertex that is not there");
            out.triangles[i][k] = face[size_t(k)].value();
        }
    }
    for (uint32_t id : ids) {
        Result<DracoAttribute> attribute = readAttribute(mesh, id, name);
        if (!attribute) return attribute.error();
        out.attributes.push_back(std::move(*attribute));
    }
    return out;
}

} // namespace

Result<DracoMesh> decodeDraco(std::span<const std::byte> bytes, std::span<const uint32_t> ids, const std::string& name)
{
    try {
        return decodeOrThrow(bytes, ids, name);
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, name + ": out of memory while decoding Draco data"};
    } catch (const std::exception& e) { // std::length_error of a container, for one
        return bad(name, std::string("damaged Draco data: ") + e.what());
    }
}

} // namespace nacre
