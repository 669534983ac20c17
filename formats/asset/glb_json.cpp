#include "asset/glb_json.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

namespace nacre::glb {

constexpr size_t kMaxJsonBytes = size_t(4) << 20; // ours is under 20 kB; a parsed tree takes about 30 times its text
constexpr int kMaxJsonDepth = 64;                 // ours is 9

[[noreturn]] void bad(const std::string& message) { throw Fault{ErrorCode::kBadInput, message}; }
[[noreturn]] void unsupported(const std::string& message) { throw Fault{ErrorCode::kUnsupported, message}; }

json parseJson(std::span<const std::byte> chunk)
{
    const std::string_view text(reinterpret_cast<const char*>(chunk.data()), chunk.size());
    if (text.size() > kMaxJsonBytes)
        bad("the JSON chunk has " + std::to_string(text.size()) + " bytes, at most " + std::to_string(kMaxJsonBytes) +
            " are accepted");
    int depth = 0;
    bool inString = false;
    for (size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (inString) {
            if (c == '\\')
                ++i;
            else if (c == '"')
                inString = false;
        } else if (c == '"') {
            inString = true;
        } else if (c == '{' || c == '[') {
            if (++depth > kMaxJsonDepth) bad("the JSON chunk is nested deeper than " + std::to_string(kMaxJsonDepth) + " levels");
        } else if (c == '}' || c == ']') {
            --depth;
        }
    }
    json document = json::parse(text, nullptr, /*allow_exceptions*/ false);
    if (!document.is_object()) bad("the JSON chunk is not a JSON object");
    return document;
}

const json* find(const json& object, const char* key)
{
    if (!object.is_object()) return nullptr;
    const auto it = object.find(key);
    return it == object.end() ? nullptr : &*it;
}

const json& need(const json& object, const char* key, const std::string& where)
{
    const json* value = find(object, key);
    if (!value) bad(where + " has no '" + key + "'");
    return *value;
}

size_t toSize(const json& value, const std::string& where)
{
    if (!value.is_number_unsigned()) bad(where + " is not a non-negative integer");
    return value.get<size_t>();
}

size_t needSize(const json& object, const char* key, const std::string& where)
{
    return toSize(need(object, key, where), where + "." + key);
}

size_t sizeOr(const json& object, const char* key, size_t absent, const std::string& where)
{
    const json* value = find(object, key);
    return value ? toSize(*value, where + "." + key) : absent;
}

float toFloat(const json& value, const std::string& where)
{
    const double number = value.is_number() ? value.get<double>() : NAN;
    if (!(std::abs(number) <= double(std::numeric_limits<float>::max()))) bad(where + " is not a finite number");
    return float(number);
}

std::string needString(const json& object, const char* key, const std::string& where)
{
    const json& value = need(object, key, where);
    if (!value.is_string()) bad(where + "." + key + " is not a string");
    return value.get<std::string>();
}

std::string needName(const json& object, const char* key, const std::string& where)
{
    const std::string name = needString(object, key, where);
    const auto printable = [](unsigned char c) { return c > 0x20 && c < 0x7f; };
    if (name.empty() || name.size() > 64 || !std::all_of(name.begin(), name.end(), printable))
        bad(where + "." + key + " is not a name of 1 to 64 printable ASCII characters");
    return name;
}

const json& element(const json& document, const char* key, size_t index)
{
    const json& array = need(document, key, "the glTF");
    const std::string what = std::string(key) + "[" + std::to_string(index) + "]";
    if (!array.is_array() || index >= array.size()) bad(what + " does not exist");
    if (!array[index].is_object()) bad(what + " is not an object");
    return array[index];
}

View bufferView(const json& document, std::span<const std::byte> bin, size_t index)
{
    const std::string where = "bufferViews[" + std::to_string(index) + "]";
    const json& view = element(document, "bufferViews", index);
    if (const size_t buffer = needSize(view, "buffer", where); buffer != 0)
        unsupported(where + " lies in buffer " + std::to_string(buffer) + ", only the binary chunk (buffer 0) is read");
    const json& buffer = element(document, "buffers", 0);
    if (find(buffer, "uri")) unsupported("buffers[0] has a URI, only the binary chunk of the .glb is read");
    const size_t total = needSize(buffer, "byteLength", "buffers[0]");
    if (total > bin.size())
        bad("buffers[0] claims " + std::to_string(total) + " bytes, the binary chunk has " + std::to_string(bin.size()));

    const size_t offset = sizeOr(view, "byteOffset", 0, where);
    const size_t length = needSize(view, "byteLength", where);
    if (offset > total || length > total - offset)
        bad(where + " claims bytes " + std::to_string(offset) + " + " + std::to_string(length) + ", the buffer has " +
            std::to_string(total));
    return {bin.subspan(offset, length), sizeOr(view, "byteStride", 0, where)};
}

} // namespace nacre::glb
