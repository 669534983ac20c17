// Draco in: compressed triangle meshes of KHR_draco_mesh_compression. Only draco.cpp knows the library.
#pragma once

#include "base/result.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nacre {

struct DracoAttribute {
    uint32_t id = 0;              // unique id in the Draco data, as glTF refers to it
    int componentType = 0;        // glTF's number: 5120 int8 ... 5126 float
    int components = 0;           // 1 to 4
    std::vector<std::byte> rows;  // one per vertex, tightly packed, dequantised
};

struct DracoMesh {
    size_t vertexCount = 0;
    std::vector<glm::uvec3> triangles;
    std::vector<DracoAttribute> attributes; // those asked for
};

constexpr uint64_t kMaxDracoTriangles = uint64_t(1) << 26;
constexpr uint64_t kMaxDracoTrianglesPerByte = 64; // of compressed data; a flat regular grid reaches 4

/// Decodes bitstream 2.2 (the only one glTF allows), attributes `ids`. Any bytes are safe: the counts in the header are checked against
/// the limits above before anything is decoded. Errors kBadInput: damaged data, missing attribute; kUnsupported: other bitstreams.
Result<DracoMesh> decodeDraco(std::span<const std::byte> bytes, std::span<const uint32_t> ids, const std::string& name);

} // namespace nacre
