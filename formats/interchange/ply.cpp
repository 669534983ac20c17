// The PLY format: lines of text up to "end_header", then the rows of one element after the other.
#include "interchange/ply.h"

#include "base/limits.h"
#include "base/text.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string_view>

namespace nacre {
namespace {

constexpr size_t kMaxHeaderBytes = size_t(64) << 10, kMaxProperties = 1024;
constexpr float kLeastLogScale = -40, kMostLogit = 16;

Error bad(const std::string& message) { return {ErrorCode::kBadInput, message}; }

// ---- The header ---------------------------------------------------------------------------------------------------------------

enum class Format { kText, kLittleEndian, kBigEndian };
enum class Type { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

constexpr struct {
    const char *name, *otherName;
    Type type;
    size_t size;
} kTypes[] = {{"char", "int8", Type::kInt8, 1},     {"uchar", "uint8", Type::kUint8, 1},    {"short", "int16", Type::kInt16, 2},
              {"ushort", "uint16", Type::kUint16, 2}, {"int", "int32", Type::kInt32, 4},      {"uint", "uint32", Type::kUint32, 4},
              {"float", "float32", Type::kFloat, 4},  {"double", "float64", Type::kDouble, 8}};

// What a splat needs, in the order in which its numbers are gathered.
enum Slot { kPosition = 0, kColor = 3, kOpacity = 6, kScale = 7, kRotation = 10, kRest = 14 };
constexpr size_t kMostRest = 45, kSlots = kRest + kMostRest;
constexpr const char* kNames[kRest] = {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"};

struct Property {
    Type type;
    size_t size;
    int slot; // -1: skipped
};

struct Element {
    std::string name;
    uint64_t count = 0;
    std::vector<Property> properties;
    bool lists = false;
    size_t rowBytes = 0;
};

struct Header {
    Format format = Format::kText;
    std::vector<Element> elements;
    size_t bytes = 0; // of the header itself
};

std::vector<std::string_view> words(std::string_view line)
{
    std::vector<std::string_view> out;
    for (size_t at = 0; (at = line.find_first_not_of(" \t\r", at)) != line.npos;) {
        const size_t end = std::min(line.find_first_of(" \t\r", at), line.size());
        out.push_back(line.substr(at, end - at));
        at = end;
    }
    return out;
}

int slotOf(std::string_view name)
{
    for (int i = 0; i < kRest; ++i)
        if (name == kNames[i]) return i;
    constexpr std::string_view kPrefix = "f_rest_";
    unsigned index = 0;
    if (name.substr(0, kPrefix.size()) != kPrefix) return -1;
    const auto [end, error] = std::from_chars(name.data() + kPrefix.size(), name.data() + name.size(), index);
    return error == std::errc() && end == name.data() + name.size() && index < kMostRest ? int(kRest + index) : -1;
}

/// One line of the header, which is split already.
Status readLine(const std::vector<std::string_view>& w, Header& header, bool& hasFormat)
{
    if (w.empty() || w[0] == "comment" || w[0] == "obj_info") return ok();
    if (w[0] == "format" && w.size() == 3) {
        if (w[1] == "ascii") header.format = Format::kText;
        else if (w[1] == "binary_little_endian") header.format = Format::kLittleEndian;
        else if (w[1] == "binary_big_endian") header.format = Format::kBigEndian;
        else return bad("unknown format " + inQuotes(w[1]));
        hasFormat = true;
        return w[2] == "1.0" ? ok() : Status(Error{ErrorCode::kUnsupported, "version " + inQuotes(w[2]) + " of PLY, expected 1.0"});
    }
    if (w[0] == "element" && w.size() == 3) {
        Element& element = header.elements.emplace_back();
        element.name = w[1];
        const auto [end, error] = std::from_chars(w[2].data(), w[2].data() + w[2].size(), element.count);
        if (error != std::errc() || end != w[2].data() + w[2].size()) return bad(inQuotes(w[2]) + " is no number of elements");
        return ok();
    }
    if (w[0] == "property" && w.size() >= 3 && !header.elements.empty()) {
        Element& element = header.elements.back();
        if (w[1] == "list") {
            element.lists = true;
            return ok();
        }
        const auto type = std::find_if(std::begin(kTypes), std::end(kTypes), [&](const auto& t) { return w[1] == t.name || w[1] == t.otherName; });
        if (type == std::end(kTypes) || w.size() != 3) return bad("unknown type " + inQuotes(w[1]));
        if (element.properties.size() >= kMaxProperties) return bad("more than " + std::to_string(kMaxProperties) + " properties");
        const int slot = element.name == "vertex" ? slotOf(w[2]) : -1;
        for (const Property& p : element.properties)
            if (slot >= 0 && p.slot == slot) return bad("property " + inQuotes(w[2]) + " occurs twice");
        element.properties.push_back({type->type, type->size, slot});
        element.rowBytes += type->size;
        return ok();
    }
    return bad("not a line of a PLY header: " + inQuotes(w[0]));
}

Result<Header> readHeader(std::string_view text)
{
    constexpr std::string_view kTooLong = "the PLY header has no 'end_header' within ";
    Header header;
    bool hasFormat = false;
    for (size_t number = 1, at = 0;; ++number) {
        const size_t end = text.substr(0, kMaxHeaderBytes).find('\n', at);
        if (end == text.npos) return bad(std::string(kTooLong) + std::to_string(std::min(text.size(), kMaxHeaderBytes)) + " bytes (truncated, or not a .ply?)");
        const auto w = words(text.substr(at, end - at));
        at = end + 1;
        if (w.size() == 1 && w[0] == "end_header") {
            header.bytes = at;
            break;
        }
        if (number == 1) continue; // "ply"
        if (Status s = readLine(w, header, hasFormat); !s) return Error{s.error().code, "line " + std::to_string(number) + " of the header: " + s.error().message};
    }
    if (!hasFormat) return bad("the PLY header has no line 'format'");
    return header;
}

/// How many functions the look has, from the f_rest_* that are there.
Result<int> shFunctions(const Element& vertex)
{
    std::array<bool, kSlots> has{};
    size_t rest = 0;
    for (const Property& p : vertex.properties)
        if (p.slot >= 0) has[size_t(p.slot)] = true, rest += p.slot >= kRest;
    for (size_t i = 0; i < kRest; ++i)
        if (!has[i]) {
            const std::string message = std::string("the element 'vertex' has no property '") + kNames[i] + "'";
            if (!has[kPosition] && !has[kScale])
                return Error{ErrorCode::kUnsupported, message + ": a mesh, a point cloud or packed splats; expected the uncompressed .ply of 3D Gaussian splatting"};
            if (i == kScale + 2) return Error{ErrorCode::kUnsupported, message + ": flat splats (2DGS) are not read"};
            return bad(message + "; expected the .ply of 3D Gaussian splatting");
        }
    for (int functions : {1, 4, 9, 16})
        if (rest == size_t(3 * (functions - 1)) && std::all_of(has.begin() + kRest, has.begin() + std::ptrdiff_t(kRest + rest), [](bool b) { return b; }))
            return functions;
    return bad("the element 'vertex' has " + std::to_string(rest) + " properties f_rest_*, expected f_rest_0 up to f_rest_8, 23 or 44, or none");
}

// ---- Rows ---------------------------------------------------------------------------------------------------------------------

template <class T>
double numberAt(const std::byte* at, bool swap)
{
    std::array<std::byte, sizeof(T)> bytes;
    std::memcpy(bytes.data(), at, sizeof(T));
    if (swap) std::reverse(bytes.begin(), bytes.end());
    return double(std::bit_cast<T>(bytes));
}

double numberAt(Type type, const std::byte* at, bool swap)
{
    switch (type) {
    case Type::kInt8: return numberAt<int8_t>(at, swap);
    case Type::kUint8: return numberAt<uint8_t>(at, swap);
    case Type::kInt16: return numberAt<int16_t>(at, swap);
    case Type::kUint16: return numberAt<uint16_t>(at, swap);
    case Type::kInt32: return numberAt<int32_t>(at, swap);
    case Type::kUint32: return numberAt<uint32_t>(at, swap);
    case Type::kFloat: return numberAt<float>(at, swap);
    case Type::kDouble: return numberAt<double>(at, swap);
    }
    return 0;
}

/// Words of a text as numbers, whatever the locale.
class TextNumbers {
public:
    explicit TextNumbers(std::string_view text) : at_(text.data()), end_(text.data() + text.size()) {}
    bool next(double& value)
    {
        const auto space = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; };
        while (at_ < end_ && space(*at_)) ++at_;
        if (at_ < end_ && *at_ == '+') ++at_;
        const auto [stop, error] = std::from_chars(at_, end_, value);
        if (error == std::errc::result_out_of_range) { // of double: from_chars does not say on which side
            const std::string_view text(at_, size_t(stop - at_));
            value = text.find("e-") != text.npos || text.find("E-") != text.npos ? 0 : text[0] == '-' ? -HUGE_VAL : HUGE_VAL;
        } else if (error != std::errc()) {
            return false;
        }
        at_ = stop;
        return at_ == end_ || space(*at_);
    }
    bool atEnd() const
    {
        return std::all_of(at_, end_, [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; });
    }

private:
    const char *at_, *end_;
};

/// How many splats had to be mended, and how.
struct Mended {
    size_t rotations = 0, opacities = 0, scales = 0;
};

std::string numberOf(double value) { return std::isnan(value) ? "not a number" : numberText(value); }

/// The numbers of one splat, as the file has them, into row `i`.
Status takeSplat(const std::array<double, kSlots>& n, size_t i, PlainSplats& splats, Mended& mended)
{
    const size_t functions = size_t(splats.look.shFunctions);
    const auto where = [&](size_t slot) {
        return "splat " + std::to_string(i) + ": " + (slot < kRest ? kNames[slot] : "f_rest_" + std::to_string(slot - kRest)) + " is " + numberOf(n[slot]);
    };
    for (size_t slot = 0; slot < kRest + 3 * (functions - 1); ++slot) {
        const bool mendable = std::isinf(n[slot]) && (slot == kOpacity || (slot >= kScale && slot < kRotation && n[slot] < 0));
        if (!(std::abs(n[slot]) <= double(kLargestNumber)) && !mendable)
            return bad(where(slot) + (std::isfinite(n[slot]) ? ", too large to draw" : "") + "; remove the splat or train again");
    }
    SplatCloud& cloud = splats.cloud;
    for (int k = 0; k < 3; ++k) {
        cloud.positions[i][k] = float(n[size_t(kPosition + k)]);
        const double logScale = n[size_t(kScale + k)];
        if (logScale > std::log(double(kLargestNumber))) return bad(where(size_t(kScale + k)) + ", the logarithm of a size too large to draw");
        if (logScale < double(kLeastLogScale)) ++mended.scales;
        cloud.scales[i][k] = float(std::exp(std::max(logScale, double(kLeastLogScale))));
    }
    if (std::isinf(n[kOpacity])) ++mended.opacities;
    cloud.opacities[i] = float(1 / (1 + std::exp(-n[kOpacity])));

    glm::dquat q(n[kRotation], n[kRotation + 1], n[kRotation + 2], n[kRotation + 3]);
    const double length = glm::length(q);
    if (length > 1e-12) q = q / length;
    else q = glm::dquat(1, 0, 0, 0), ++mended.rotations;
    cloud.rotations[i] = glm::quat(q);

    glm::vec3* sh = &splats.look.sh[i * functions];
    for (int c = 0; c < 3; ++c) {
        sh[0][c] = float(n[size_t(kColor + c)]);
        for (size_t f = 1; f < functions; ++f) sh[f][c] = float(n[kRest + size_t(c) * (functions - 1) + f - 1]);
    }
    return ok();
}

void resize(size_t count, int functions, PlainSplats& splats)
{
    SplatCloud& cloud = splats.cloud;
    cloud.count = count;
    cloud.positions.resize(count), cloud.rotations.resize(count), cloud.scales.resize(count), cloud.opacities.resize(count);
    splats.look.shFunctions = functions;
    splats.look.sh.resize(count * size_t(functions));
}

std::vector<std::string> warningsOf(const Mended& mended)
{
    std::vector<std::string> lines;
    if (mended.rotations) lines.push_back(std::to_string(mended.rotations) + " splats have a rotation of length 0: taken as not rotated");
    if (mended.opacities) lines.push_back(std::to_string(mended.opacities) + " splats have an infinite opacity logit: taken as opacity 0 or 1");
    if (mended.scales) lines.push_back(std::to_string(mended.scales) + " scales are 0 or nearly: taken as e^-40");
    return lines;
}

} // namespace

bool looksLikePly(std::span<const std::byte> bytes)
{
    return bytes.size() >= 4 && std::memcmp(bytes.data(), "ply", 3) == 0 && (bytes[3] == std::byte('\n') || bytes[3] == std::byte('\r'));
}

Result<PlyFile> decodePly(std::span<const std::byte> bytes)
{
    if (!looksLikePly(bytes)) return bad("not a .ply: it does not begin with a line 'ply'");
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const Result<Header> read = readHeader(text);
    if (!read) return read.error();
    const Header& header = *read;
    const auto vertex = std::find_if(header.elements.begin(), header.elements.end(), [](const Element& e) { return e.name == "vertex"; });
    if (vertex == header.elements.end()) return bad("the .ply has no element 'vertex'");
    if (vertex->lists) return bad("the element 'vertex' has a property that is a list; expected the .ply of 3D Gaussian splatting");
    const Result<int> functions = shFunctions(*vertex);
    if (!functions) return functions.error();
    if (vertex->count == 0) return bad("the .ply holds no splats");

    // Every element up to the splats, against the bytes that there are. A number of a text takes two bytes, except the last.
    const bool isText = header.format == Format::kText;
    size_t left = bytes.size() - header.bytes + (isText ? 1 : 0), before = 0, numbersBefore = 0;
    for (auto e = header.elements.begin(); e <= vertex; ++e) {
        const size_t rowBytes = isText ? 2 * e->properties.size() : e->rowBytes;
        if (e->lists) return Error{ErrorCode::kUnsupported, "the element " + inQuotes(e->name) + " before the splats has lists, which are not read"};
        if (rowBytes == 0) continue;
        if (e->count > left / rowBytes)
            return bad("truncated: " + std::to_string(e->count) + " rows of the element " + inQuotes(e->name) + " take " + std::to_string(rowBytes) +
                       (isText ? " bytes or more each, " : " bytes each, ") + std::to_string(left) + " bytes are left");
        left -= size_t(e->count) * rowBytes;
        if (e != vertex) before += size_t(e->count) * e->rowBytes, numbersBefore += size_t(e->count) * e->properties.size();
    }
    if (!isText && vertex + 1 == header.elements.end() && left > 0)
        return bad(std::to_string(left) + " bytes follow the last splat: the file is damaged, or its header is of another");

    PlyFile out;
    Mended mended;
    resize(size_t(vertex->count), *functions, out.splats);
    std::array<double, kSlots> numbers{};
    TextNumbers words(text.substr(header.bytes));
    double skipped = 0;
    for (size_t k = 0; isText && k < numbersBefore; ++k)
        if (!words.next(skipped)) return bad("number " + std::to_string(k) + " before the splats is missing or none (truncated?)");
    const std::byte* row = bytes.data() + header.bytes + (isText ? 0 : before);
    const bool swap = header.format == Format::kBigEndian;
    for (size_t i = 0; i < vertex->count; ++i) {
        for (const Property& p : vertex->properties) {
            double value = 0;
            if (isText) {
                if (!words.next(value)) return bad("splat " + std::to_string(i) + ": a number is missing or none (truncated?)");
            } else if (p.slot >= 0) {
                value = numberAt(p.type, row, swap);
            }
            if (!isText) row += p.size;
            if (p.slot >= 0) numbers[size_t(p.slot)] = value;
        }
        if (Status s = takeSplat(numbers, i, out.splats, mended); !s) return s.error();
    }
    if (isText && vertex + 1 == header.elements.end() && !words.atEnd()) return bad("more numbers follow the last splat: the file is damaged, or its header is of another");
    out.warnings = warningsOf(mended);
    return out;
}

std::vector<std::byte> encodePly(const PlainSplats& splats)
{
    static_assert(std::endian::native == std::endian::little, "floats are copied as they are");
    const size_t count = splats.cloud.count, functions = size_t(splats.look.shFunctions), rest = functions - 1;
    // As Brush says that screen-space filtering keeps the light of small splats (mip-splatting); others skip comments.
    std::string header = "ply\nformat binary_little_endian 1.0\ncomment Nacre\ncomment SplatRenderMode: mip\ncomment colours: ";
    header += splats.srgb ? "sRGB, to be blended as they are\n" : "linear Rec.709\n";
    header += "element vertex " + std::to_string(count) + "\n";
    const auto property = [&](const std::string& name) { header += "property float " + name + "\n"; };
    for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"}) property(name);
    for (size_t k = 0; k < 3 * rest; ++k) property("f_rest_" + std::to_string(k));
    for (const char* name : {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"}) property(name);
    header += "end_header\n";

    const size_t floats = 17 + 3 * rest;
    std::vector<std::byte> bytes(header.size() + count * floats * sizeof(float));
    std::memcpy(bytes.data(), header.data(), header.size());
    std::vector<float> row(floats);
    for (size_t i = 0; i < count; ++i) {
        const SplatCloud& cloud = splats.cloud;
        const glm::vec3* sh = &splats.look.sh[i * functions];
        const glm::quat& q = cloud.rotations[i];
        float* out = row.data();
        for (int k = 0; k < 3; ++k) *out++ = cloud.positions[i][k];
        for (int k = 0; k < 3; ++k) *out++ = 0;
        for (int c = 0; c < 3; ++c) *out++ = sh[0][c];
        for (int c = 0; c < 3; ++c)
            for (size_t f = 1; f < functions; ++f) *out++ = sh[f][c];
        const double opacity = cloud.opacities[i];
        *out++ = std::clamp(float(std::log(opacity / (1 - opacity))), -kMostLogit, kMostLogit);
        for (int k = 0; k < 3; ++k) *out++ = float(std::log(double(cloud.scales[i][k])));
        for (float x : {q.w, q.x, q.y, q.z}) *out++ = x;
        std::memcpy(bytes.data() + header.size() + i * floats * sizeof(float), row.data(), floats * sizeof(float));
    }
    return bytes;
}

} // namespace nacre
