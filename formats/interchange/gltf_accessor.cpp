// Accessors: a typed, strided view of a buffer, perhaps with some rows replaced (sparse).
#include "interchange/gltf_accessor.h"

#include "base/text.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <type_traits>

namespace nacre::gltf {
namespace {

size_t componentSize(int type)
{
    switch (type) {
    case kInt8:
    case kUint8: return 1;
    case kInt16:
    case kUint16: return 2;
    case kUint32:
    case kFloat32: return 4;
    }
    return 0;
}

int readComponentType(const JsonNode& node)
{
    const int type = node.integer(0, 65535);
    if (componentSize(type) == 0) node.fail("5120, 5121, 5122, 5123, 5125 or 5126", std::to_string(type));
    return type;
}

int componentCount(const JsonNode& type)
{
    const std::string name = type.string();
    if (name == "SCALAR") return 1;
    if (name == "VEC2") return 2;
    if (name == "VEC3") return 3;
    if (name == "VEC4") return 4;
    if (name == "MAT4") return 16;
    type.fail("SCALAR, VEC2, VEC3, VEC4 or MAT4", inQuotes(name));
    return 1;
}

/// Tightly packed rows of a sparse accessor.
const std::byte* sparseArray(const File& file, const JsonNode& node, size_t count, size_t rowBytes)
{
    const File::View view = file.view(node["bufferView"]);
    const uint64_t offset = node["byteOffset"].exists() ? node["byteOffset"].size(uint64_t(1) << 40) : 0;
    file.check();
    if (offset > view.bytes.size() || count > (view.bytes.size() - offset) / rowBytes)
        bad(node.where() + " needs " + std::to_string(count) + " values of " + std::to_string(rowBytes) + " bytes, " + view.where + " has " +
            std::to_string(view.bytes.size()) + " bytes");
    return view.bytes.data() + offset;
}

template <class T>
void convertAs(const std::byte* rows, size_t count, size_t stride, int components, bool normalized, float* out)
{
    constexpr float kLargest = std::is_floating_point_v<T> ? 1.0f : float(std::numeric_limits<T>::max());
    const float divisor = normalized ? kLargest : 1.0f;
    for (size_t i = 0; i < count; ++i, rows += stride)
        for (int c = 0; c < components; ++c) {
            T value;
            std::memcpy(&value, rows + size_t(c) * sizeof(T), sizeof(T));
            const float x = float(value) / divisor;
            *out++ = normalized ? std::max(x, -1.0f) : x; // -128 / 127 counts as -1
        }
}

template <class T>
void indicesAs(const std::byte* rows, size_t count, size_t stride, uint32_t* out)
{
    for (size_t i = 0; i < count; ++i, rows += stride) {
        T value;
        std::memcpy(&value, rows, sizeof(T));
        out[i] = value;
    }
}

void convertIndices(const std::byte* rows, size_t count, size_t stride, int type, uint32_t* out)
{
    if (type == kUint8) indicesAs<uint8_t>(rows, count, stride, out);
    if (type == kUint16) indicesAs<uint16_t>(rows, count, stride, out);
    if (type == kUint32) indicesAs<uint32_t>(rows, count, stride, out);
}

bool isUnsigned(int type) { return type == kUint8 || type == kUint16 || type == kUint32; }

/// The rows that a sparse accessor replaces.
std::vector<uint32_t> sparseRowIndices(const Accessor& a)
{
    std::vector<uint32_t> indices(a.sparseCount);
    convertIndices(a.sparseIndices, a.sparseCount, componentSize(a.sparseIndexType), a.sparseIndexType, indices.data());
    for (uint32_t i : indices)
        if (i >= a.count) bad(a.where + ".sparse replaces element " + std::to_string(i) + " of " + std::to_string(a.count));
    return indices;
}

} // namespace

Accessor readAccessor(const File& file, const JsonNode& index)
{
    const JsonNode& node = file.at(file.accessors, index);
    Accessor a;
    a.where = node.where();
    a.count = node["count"].size(UINT32_MAX);
    a.components = componentCount(node["type"]);
    a.componentType = readComponentType(node["componentType"]);
    a.normalized = node["normalized"].exists() && node["normalized"].boolean();
    const uint64_t offset = node["byteOffset"].exists() ? node["byteOffset"].size(uint64_t(1) << 40) : 0;
    file.check();
    const size_t rowBytes = componentSize(a.componentType) * size_t(a.components);

    if (node["bufferView"].exists()) {
        const File::View view = file.view(node["bufferView"]);
        a.stride = view.stride ? view.stride : rowBytes;
        if (a.stride < rowBytes) bad(view.where + ".byteStride is " + std::to_string(a.stride) + ", elements of " + a.where + " have " + std::to_string(rowBytes) + " bytes");
        const uint64_t needed = a.count == 0 ? 0 : (a.count - 1) * a.stride + rowBytes; // below 2^32 * 252
        if (offset > view.bytes.size() || needed > view.bytes.size() - offset)
            bad(a.where + " needs " + std::to_string(offset + needed) + " bytes, " + view.where + " has " + std::to_string(view.bytes.size()));
        a.rows = view.bytes.data() + offset;
    } else if (a.count > kMaxZeroFilled) {
        bad(a.where + " has no bufferView and " + std::to_string(a.count) + " elements, at most " + std::to_string(kMaxZeroFilled) +
            " zeros are accepted");
    }

    const JsonNode sparse = node["sparse"];
    if (sparse.exists()) {
        a.sparseCount = sparse["count"].size(a.count);
        a.sparseIndexType = readComponentType(sparse["indices"]["componentType"]);
        file.check();
        if (!isUnsigned(a.sparseIndexType)) bad(sparse.where() + ".indices are not of an unsigned integer type");
        a.sparseIndices = sparseArray(file, sparse["indices"], a.sparseCount, componentSize(a.sparseIndexType));
        a.sparseRows = sparseArray(file, sparse["values"], a.sparseCount, rowBytes);
    }
    return a;
}

void convertRows(const std::byte* rows, size_t count, size_t stride, int components, int componentType, bool normalized, float* out)
{
    switch (componentType) {
    case kInt8: return convertAs<int8_t>(rows, count, stride, components, normalized, out);
    case kUint8: return convertAs<uint8_t>(rows, count, stride, components, normalized, out);
    case kInt16: return convertAs<int16_t>(rows, count, stride, components, normalized, out);
    case kUint16: return convertAs<uint16_t>(rows, count, stride, components, normalized, out);
    case kUint32: return convertAs<uint32_t>(rows, count, stride, components, normalized, out);
    case kFloat32: return convertAs<float>(rows, count, stride, components, false, out);
    }
}

void readFloats(const Accessor& a, float* out)
{
    if (a.rows) convertRows(a.rows, a.count, a.stride, a.components, a.componentType, a.normalized, out);
    else std::fill_n(out, a.count * size_t(a.components), 0.0f);
    const size_t rowBytes = componentSize(a.componentType) * size_t(a.components);
    const std::vector<uint32_t> replaced = sparseRowIndices(a);
    for (size_t i = 0; i < replaced.size(); ++i)
        convertRows(a.sparseRows + i * rowBytes, 1, rowBytes, a.components, a.componentType, a.normalized,
                    out + size_t(replaced[i]) * size_t(a.components));
}

std::vector<glm::mat4> readMatrices(File& file, const Accessor& accessor)
{
    if (accessor.components != 16) bad(accessor.where + " is not of type MAT4");
    file.take(accessor.count, sizeof(glm::mat4), accessor.where);
    std::vector<glm::mat4> out(accessor.count);
    if (!out.empty()) readFloats(accessor, &out[0][0][0]);
    return out;
}

std::vector<uint32_t> readIndices(File& file, const JsonNode& index)
{
    const Accessor a = readAccessor(file, index);
    if (a.components != 1 || !isUnsigned(a.componentType)) bad(a.where + " holds indices, but is not SCALAR of type 5121, 5123 or 5125");
    file.take(a.count, sizeof(uint32_t), a.where);
    std::vector<uint32_t> out(a.count, 0);
    if (a.rows) convertIndices(a.rows, a.count, a.stride, a.componentType, out.data());
    const std::vector<uint32_t> replaced = sparseRowIndices(a);
    for (size_t i = 0; i < replaced.size(); ++i)
        convertIndices(a.sparseRows + i * componentSize(a.componentType), 1, 0, a.componentType, &out[replaced[i]]);
    return out;
}

} // namespace nacre::gltf
