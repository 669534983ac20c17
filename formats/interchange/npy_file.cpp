// NumPy's .npy: magic, version, the length of the header (u16, from version 2 on u32), a Python dictionary as text, then the values.
#include "interchange/matrix_file.h"

#include "base/text.h"
#include "interchange/text_lines.h"

#include <cmath>
#include <cstdint>
#include <cstring>

namespace nacre {
namespace {

/// The text behind a key of the dictionary, up to the end of its value.
std::string_view valueOf(std::string_view dictionary, std::string_view key)
{
    const size_t at = dictionary.find(key);
    if (at == std::string_view::npos) return {};
    std::string_view rest = dictionary.substr(at + key.size());
    const size_t colon = rest.find(':');
    if (colon == std::string_view::npos) return {};
    rest = trimmed(rest.substr(colon + 1));
    return rest.substr(0, rest.starts_with('(') ? rest.find(')') : rest.find_first_of(",}"));
}

template <class T>
std::vector<double> widened(std::span<const std::byte> data, size_t count)
{
    std::vector<double> out(count);
    for (size_t i = 0; i < count; ++i) {
        T v;
        std::memcpy(&v, data.data() + i * sizeof v, sizeof v);
        out[i] = double(v);
    }
    return out;
}

} // namespace

Result<Matrix> decodeNpy(std::span<const std::byte> bytes, const std::string& name)
{
    const auto bad = [&](const std::string& what, ErrorCode code = ErrorCode::kBadInput) { return Error{code, name + ": NumPy file: " + what}; };
    const std::string_view text = asText(bytes);
    if (!text.starts_with("\x93NUMPY") || text.size() < 12) return bad("not one (" + std::to_string(bytes.size()) + " bytes)");
    const bool isLong = uint8_t(text[6]) >= 2;
    size_t length = 0, at = isLong ? 12 : 10;
    for (size_t i = at; i-- > 8;) length = length << 8 | uint8_t(text[i]);
    if (length > bytes.size() - at) return bad("cut off in its header");
    const std::string_view dictionary = text.substr(at, length), kind = valueOf(dictionary, "descr");
    at += length;

    const auto shape = numbersOf(valueOf(dictionary, "shape"));
    if (!shape || shape->size() > 2) return bad("expected one or two dimensions, found " + inQuotes(valueOf(dictionary, "shape")), ErrorCode::kUnsupported);
    double count = 1;
    for (const double n : *shape) {
        if (!(n >= 0 && n <= 1e9 && n == std::floor(n))) return bad("a shape of " + inQuotes(valueOf(dictionary, "shape")));
        count *= n;
    }
    const auto is = [&](std::string_view code) { return kind.find(code) != std::string_view::npos; };
    const size_t size = is("<f4") || is("<i4") ? 4 : is("<f8") || is("<i8") ? 8 : 0;
    if (size == 0) return bad("expected float32, float64, int32 or int64, found " + inQuotes(kind), ErrorCode::kUnsupported);
    const std::span<const std::byte> data = bytes.subspan(at);
    if (count > double(data.size() / size)) return bad("cut off: " + std::to_string(data.size()) + " bytes for the shape " + inQuotes(valueOf(dictionary, "shape")));
    Matrix out{shape->empty() ? 1 : size_t(shape->front()), shape->size() == 2 ? size_t(shape->back()) : 1, {}};
    const size_t n = size_t(count);
    out.values = is("<f4") ? widened<float>(data, n) : is("<f8") ? widened<double>(data, n) : is("<i4") ? widened<int32_t>(data, n) : widened<int64_t>(data, n);
    if (valueOf(dictionary, "fortran_order").starts_with("True")) {
        const std::vector<double> columnwise = out.values;
        for (size_t i = 0; i < n; ++i) out.values[i % out.rows * out.columns + i / out.rows] = columnwise[i];
    }
    return out;
}

} // namespace nacre
