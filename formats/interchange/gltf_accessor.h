// Inside the glTF reader: accessors (glTF 2.0, section 3.6.2) as arrays of float vectors or indices.
#pragma once

#include "interchange/gltf_file.h"

#include <glm/glm.hpp>

#include <vector>

namespace nacre::gltf {

/// Component types by their number in the file.
enum ComponentType : int { kInt8 = 5120, kUint8 = 5121, kInt16 = 5122, kUint16 = 5123, kUint32 = 5125, kFloat32 = 5126 };

/// Elements of an accessor that has no bufferView: they are zero and the file holds nothing of them, so they need a bound of their own.
constexpr uint64_t kMaxZeroFilled = uint64_t(1) << 22;

struct Accessor {
    std::string where;
    size_t count = 0;
    int components = 0; // 1 to 4; of a matrix 16
    int componentType = kFloat32;
    bool normalized = false;
    const std::byte* rows = nullptr; // null: zeros
    size_t stride = 0;
    // Sparse: rows[sparseIndices[i]] = sparseRows[i], both tightly packed. Bounds are checked, the indices' values not yet.
    size_t sparseCount = 0;
    int sparseIndexType = kUint32;
    const std::byte *sparseIndices = nullptr, *sparseRows = nullptr;
};

/// Everything in bounds, or a fault.
Accessor readAccessor(const File& file, const JsonNode& index);

/// `count` rows of `components` values at `rows`; integers become c / 127 and so on (section 3.6.2.4) if normalized.
void convertRows(const std::byte* rows, size_t count, size_t stride, int components, int componentType, bool normalized, float* out);

std::vector<glm::mat4> readMatrices(File& file, const Accessor& accessor);

/// One value per row. The accessor's type must be SCALAR of an unsigned integer type.
std::vector<uint32_t> readIndices(File& file, const JsonNode& index);

void readFloats(const Accessor& accessor, float* out); // count * components

template <int N>
std::vector<glm::vec<N, float>> readVectors(File& file, const Accessor& accessor)
{
    if (accessor.components != N)
        bad(accessor.where + " has " + std::to_string(accessor.components) + " components, expected " + std::to_string(N));
    file.take(accessor.count, sizeof(glm::vec<N, float>), accessor.where);
    std::vector<glm::vec<N, float>> out(accessor.count);
    if (!out.empty()) readFloats(accessor, &out[0][0]);
    return out;
}

} // namespace nacre::gltf
