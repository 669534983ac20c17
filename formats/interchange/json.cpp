// JSON through nlohmann-json. Its parser does not recurse, so deep nesting cannot overflow the stack; what it throws stays here.
#include "interchange/json.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <new>
#include <optional>

namespace nacre {

using nlohmann::json;

struct JsonDocument::State {
    std::string name;
    json value;
    std::optional<Error> error;
};

static const json& valueOf(const void* v) { return *static_cast<const json*>(v); }

Result<JsonDocument> JsonDocument::parse(std::span<const std::byte> text, const std::string& name)
{
    const char* begin = reinterpret_cast<const char*>(text.data());
    const char* end = begin + text.size();
    JsonDocument doc;
    doc.state_ = std::make_shared<State>();
    doc.state_->name = name;
    try {
        doc.state_->value = json::parse(begin, end);
    } catch (const json::parse_error& e) {
        const char* at = begin + std::min(e.byte, text.size());
        return Error{ErrorCode::kBadInput, name + ": not valid JSON at line " + std::to_string(1 + std::count(begin, at, '\n')) +
                                               (e.byte >= text.size() ? " (the file ends too early)" : "")};
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, name + ": out of memory while parsing " + std::to_string(text.size()) + " bytes of JSON"};
    } catch (const std::exception&) { // a number like 1e999
        return Error{ErrorCode::kBadInput, name + ": JSON holds a number out of range"};
    }
    return doc;
}

JsonNode JsonDocument::root() const { return {state_.get(), &state_->value, ""}; }
bool JsonDocument::failed() const { return state_->error.has_value(); }
const Error& JsonDocument::error() const { return *state_->error; }
const std::string& JsonDocument::name() const { return state_->name; }

void JsonNode::fail(const std::string& expected, const std::string& found) const
{
    if (document_->error) return;
    document_->error = Error{ErrorCode::kBadInput, document_->name + ": " + (where_.empty() ? "top level" : where_) + ": expected " + expected +
                                                       ", found " + found};
}

std::string JsonNode::describe() const
{
    if (!value_) return "nothing";
    const json& v = valueOf(value_);
    if (v.is_string()) return "string";
    if (v.is_array()) return "array of " + std::to_string(v.size());
    if (v.is_number()) return "number " + v.dump();
    return v.type_name();
}

bool JsonNode::isNumber() const { return value_ && valueOf(value_).is_number(); }
bool JsonNode::isString() const { return value_ && valueOf(value_).is_string(); }
bool JsonNode::isArray() const { return value_ && valueOf(value_).is_array(); }
bool JsonNode::isObject() const { return value_ && valueOf(value_).is_object(); }

JsonNode JsonNode::operator[](const char* key) const
{
    const void* found = nullptr;
    if (value_ && valueOf(value_).is_object()) {
        const auto it = valueOf(value_).find(key);
        if (it != valueOf(value_).end() && !it->is_null()) found = &*it;
    }
    return {document_, found, where_.empty() ? key : where_ + "." + key};
}

std::vector<JsonNode> JsonNode::items() const
{
    std::vector<JsonNode> out;
    if (!value_ || !valueOf(value_).is_structured()) {
        fail("array or object", describe());
        return out;
    }
    const json& v = valueOf(value_);
    out.reserve(v.size());
    if (v.is_array())
        for (size_t i = 0; i < v.size(); i++) out.emplace_back(document_, &v[i], where_ + "[" + std::to_string(i) + "]");
    else
        for (auto it = v.begin(); it != v.end(); ++it) out.emplace_back(document_, &it.value(), where_ + "[" + inQuotes(it.key()) + "]");
    return out;
}

JsonNode JsonNode::firstItem() const
{
    if (!value_ || !valueOf(value_).is_structured() || valueOf(value_).empty()) return {document_, nullptr, where_ + "[0]"};
    return {document_, &*valueOf(value_).begin(), where_ + "[0]"};
}

std::vector<std::string> JsonNode::keys() const
{
    std::vector<std::string> out;
    if (!isObject()) {
        fail("object", describe());
        return out;
    }
    for (auto it = valueOf(value_).begin(); it != valueOf(value_).end(); ++it) out.push_back(it.key());
    return out;
}

double JsonNode::number(double largest) const
{
    if (!isNumber()) {
        fail("number", describe());
        return 0.0;
    }
    const double x = valueOf(value_).get<double>();
    if (!(std::fabs(x) <= largest)) {
        fail("finite number of at most " + json(largest).dump(), describe());
        return 0.0;
    }
    return x;
}

int JsonNode::integer(int lowest, int highest) const
{
    const double x = number();
    if (x != std::floor(x) || x < lowest || x > highest) {
        fail("whole number from " + std::to_string(lowest) + " to " + std::to_string(highest), describe());
        return lowest;
    }
    return int(x);
}

uint64_t JsonNode::size(uint64_t highest) const
{
    const double x = number();
    if (x != std::floor(x) || x < 0 || x > double(highest)) {
        fail("whole number from 0 to " + std::to_string(highest), describe());
        return 0;
    }
    return uint64_t(x);
}

bool JsonNode::boolean() const
{
    if (value_ && valueOf(value_).is_boolean()) return valueOf(value_).get<bool>();
    fail("true or false", describe());
    return false;
}

std::string_view JsonNode::text() const
{
    if (isString()) return valueOf(value_).get_ref<const std::string&>();
    fail("string", describe());
    return {};
}

std::string JsonNode::string() const
{
    if (!isString()) {
        fail("string", describe());
        return {};
    }
    const auto& s = valueOf(value_).get_ref<const std::string&>();
    if (s.size() > 4096 || s.find('\0') != std::string::npos) {
        fail("string of at most 4096 bytes", "string of " + std::to_string(s.size()));
        return {};
    }
    return s;
}

std::vector<double> JsonNode::numbers(size_t count) const
{
    std::vector<double> out(count, 0.0);
    if (!isArray() || valueOf(value_).size() != count) {
        fail(std::to_string(count) + " numbers", describe());
        return out;
    }
    const std::vector<JsonNode> nodes = items();
    for (size_t i = 0; i < count; i++) out[i] = nodes[i].number();
    return out;
}

} // namespace nacre
