// Reading the JSON of a .glb whose bytes are untrusted: every access checks, and says what is wrong where. Of the reader only.
//
// A fault is thrown (`Fault`) and becomes an Error at the reader's one way out: the parsing code then reads like the list of what an asset
// must have.
#pragma once

#include "base/result.h"
#include "base/text.h"

#include <nlohmann/json.hpp>

#include <cstddef>
#include <span>
#include <string>

namespace nacre::glb {

using nlohmann::json;

struct Fault {
    ErrorCode code;
    std::string message;
};

[[noreturn]] void bad(const std::string& message);
[[noreturn]] void unsupported(const std::string& message);

/// Bounds size and nesting before the parser sees the text.
json parseJson(std::span<const std::byte> chunk);

const json* find(const json& object, const char* key);
const json& need(const json& object, const char* key, const std::string& where);
size_t toSize(const json& value, const std::string& where);
size_t needSize(const json& object, const char* key, const std::string& where);
size_t sizeOr(const json& object, const char* key, size_t absent, const std::string& where);
float toFloat(const json& value, const std::string& where);
std::string needString(const json& object, const char* key, const std::string& where);
/// A name that will appear in messages: short and printable.
std::string needName(const json& object, const char* key, const std::string& where);
/// Element `index` of the document's array `key`.
const json& element(const json& document, const char* key, size_t index);

struct View {
    std::span<const std::byte> bytes;
    size_t stride; // 0: tight
};
/// Known to lie in the file.
View bufferView(const json& document, std::span<const std::byte> bin, size_t index);

} // namespace nacre::glb
