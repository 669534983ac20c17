// MAT files of version 5 (MATLAB's save -v6 and -v7): a header of 128 bytes, then elements. An element is a tag (u32 type, u32 size) and its data,
// padded to 8 bytes; data of at most 4 bytes may lie in the tag itself. A compressed element (-v7) is one matrix in zlib and has no padding. A matrix
// element holds elements: flags, dimensions, name, values column by column. The stored type of the values may be narrower than the matrix's class.
#include "interchange/matrix_file.h"

#include "base/text.h"
#include "interchange/inflate.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>

namespace nacre {
namespace {

constexpr size_t kLargest = size_t(1) << 16; // bytes of a variable; calibrations are far below
enum Type : uint32_t { kInt8 = 1, kUint8, kInt16, kUint16, kInt32, kUint32, kSingle, kDouble = 9, kInt64 = 12, kUint64, kMatrix, kCompressed };
constexpr uint32_t kFirstNumeric = 6, kLastNumeric = 15; // classes: double, single, int8 ... uint64
constexpr uint32_t kComplex = 0x0800;

struct Element {
    uint32_t type = 0;
    std::span<const std::byte> data;
};

template <class T>
T valueAt(std::span<const std::byte> bytes, size_t at)
{
    T v;
    std::memcpy(&v, bytes.data() + at, sizeof v);
    return v;
}

/// Takes the element at the front of `bytes`; nothing if it is cut off.
std::optional<Element> takeElement(std::span<const std::byte>& bytes)
{
    if (bytes.size() < 8) return std::nullopt;
    const uint32_t first = valueAt<uint32_t>(bytes, 0);
    if (first >> 16) { // type and size share a word, data in the next
        if (first >> 16 > 4) return std::nullopt;
        const Element small{first & 0xffff, bytes.subspan(4, first >> 16)};
        bytes = bytes.subspan(8);
        return small;
    }
    const size_t size = valueAt<uint32_t>(bytes, 4);
    if (size > bytes.size() - 8) return std::nullopt;
    const Element element{first, bytes.subspan(8, size)};
    const size_t padded = first == kCompressed ? size : (size + 7) / 8 * 8;
    bytes = bytes.subspan(8 + std::min(padded, bytes.size() - 8)); // the last one's padding may lack
    return element;
}

template <class T>
void widen(std::span<const std::byte> data, std::vector<double>& out)
{
    for (size_t at = 0; at + sizeof(T) <= data.size(); at += sizeof(T)) out.push_back(double(valueAt<T>(data, at)));
}

std::vector<double> numbersIn(const Element& e)
{
    std::vector<double> out;
    switch (e.type) {
    case kInt8: widen<int8_t>(e.data, out); break;
    case kUint8: widen<uint8_t>(e.data, out); break;
    case kInt16: widen<int16_t>(e.data, out); break;
    case kUint16: widen<uint16_t>(e.data, out); break;
    case kInt32: widen<int32_t>(e.data, out); break;
    case kUint32: widen<uint32_t>(e.data, out); break;
    case kSingle: widen<float>(e.data, out); break;
    case kDouble: widen<double>(e.data, out); break;
    case kInt64: widen<int64_t>(e.data, out); break;
    case kUint64: widen<uint64_t>(e.data, out); break;
    }
    return out;
}

/// False if the element is broken. Matrices of other kinds than asked for pass.
bool readMatrix(std::span<const std::byte> bytes, std::map<std::string, Matrix>& out)
{
    const auto flags = takeElement(bytes), dimensions = takeElement(bytes), name = takeElement(bytes);
    if (!flags || flags->data.size() < 4 || !dimensions || !name) return false;
    const uint32_t word = valueAt<uint32_t>(flags->data, 0), kind = word & 0xff;
    const std::vector<double> size = numbersIn(*dimensions);
    if (kind < kFirstNumeric || kind > kLastNumeric || word & kComplex || size.size() != 2) return true;
    const auto values = takeElement(bytes);
    if (!values) return false;
    if (values->data.size() > kLargest) return true;
    const std::vector<double> columnwise = numbersIn(*values);
    if (!(size[0] >= 0 && size[1] >= 0 && size[0] * size[1] == double(columnwise.size()))) return false;
    Matrix matrix{size_t(size[0]), size_t(size[1]), std::vector<double>(columnwise.size())};
    if (columnwise.empty()) return true;
    for (size_t i = 0; i < columnwise.size(); ++i) matrix.values[i % matrix.rows * matrix.columns + i / matrix.rows] = columnwise[i];
    out[std::string(reinterpret_cast<const char*>(name->data.data()), std::min<size_t>(name->data.size(), 64))] = std::move(matrix);
    return true;
}

} // namespace

Result<std::map<std::string, Matrix>> decodeMat(std::span<const std::byte> bytes, const std::string& name)
{
    constexpr size_t kHeader = 128;
    const auto bad = [&](const std::string& what, ErrorCode code = ErrorCode::kBadInput) { return Error{code, name + ": MAT file: " + what}; };
    if (bytes.size() < kHeader) return bad("cut off in its header, at byte " + std::to_string(bytes.size()));
    const uint16_t version = valueAt<uint16_t>(bytes, 124), order = valueAt<uint16_t>(bytes, 126);
    constexpr uint16_t kLittle = 0x4d49, kBig = 0x494d; // "IM" and "MI"
    if (order == kLittle && version == 0x0200) return bad("version 7.3 (HDF5); save it again with -v7", ErrorCode::kUnsupported);
    if (order == kBig) return bad("big-endian; save it again with -v7 on another machine", ErrorCode::kUnsupported);
    if (order != kLittle || version != 0x0100) return bad("not of version 5; is it one? Then save it again with -v7");
    std::map<std::string, Matrix> out;
    std::span<const std::byte> rest = bytes.subspan(kHeader);
    while (!rest.empty()) {
        const size_t at = bytes.size() - rest.size();
        const auto element = takeElement(rest);
        if (!element) return bad("cut off in the variable at byte " + std::to_string(at));
        bool isGood = true;
        if (element->type == kMatrix) isGood = readMatrix(element->data, out);
        if (element->type == kCompressed) {
            const auto inflated = inflateZlib(element->data, kLargest + 512);
            if (!inflated) return bad("broken compression of the variable at byte " + std::to_string(at));
            std::span<const std::byte> inside(*inflated);
            if (inside.empty()) continue; // larger than anything asked for
            const auto matrix = takeElement(inside);
            isGood = matrix.has_value() && (matrix->type != kMatrix || readMatrix(matrix->data, out));
        }
        if (!isGood) return bad("a broken variable at byte " + std::to_string(at));
    }
    return out;
}

} // namespace nacre
