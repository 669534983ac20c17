// JSON through nlohmann-json. Its parser does not recurse, so deep nesting cannot overflow the stack; what it throws stays here.
#include "interchange/json.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>
#include <new>
#include <optional>
#include <set>

namespace nacre {

using nlohmann::json;

struct JsonDocument::State {
    std::string name;
    json value;
    std::optional<Error> error;
};

static const json& valueOf(const void* v) { return *static_cast<const json*>(v); }

/// Where and what: "line 3, column 14 (byte 57): NaN is not JSON; ...". `at` is the first byte that does not fit.
static std::string syntaxError(std::string_view text, size_t at)
{
    const auto isWord = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '+' || c == '-' || c == '.'; };
    if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff") || text.substr(0, 4).find('\0') != std::string_view::npos)
        return "at byte 1: the text is not UTF-8 (UTF-16?); save it as UTF-8";
    at = std::min(at, text.size());
    size_t first = at; // of the word that the byte stands in
    if (at > 0 && at < text.size() && text[at] == '"') first = std::min(first, text.rfind('"', at - 1)); // the parser stops where a text ends
    while (first > 0 && isWord(text[first - 1])) --first;
    size_t last = at;
    while (last < text.size() && last - first < 40 && isWord(text[last])) ++last;
    const std::string_view word = text.substr(first, last - first);

    size_t before = first; // what stands before the word, white space left out
    while (before > 0 && std::isspace(static_cast<unsigned char>(text[before - 1]))) --before;
    const char previous = before > 0 ? text[before - 1] : '\0', here = at < text.size() ? text[at] : '\0';
    std::string lower(word);
    for (char& c : lower) c = char(std::tolower(static_cast<unsigned char>(c)));
    const std::string_view name = std::string_view(lower).substr(!lower.empty() && (lower[0] == '-' || lower[0] == '+'));
    std::string why;
    if (at == text.size()) why = "the file ends too early";
    else if (name == "nan" || name == "inf" || name == "infinity" || name == "1.#inf" || name == "1.#qnan")
        why = inQuotes(word) + " is not JSON; write a finite number, and look for what made it";
    else if (name == "true" || name == "false" || name == "none" || name == "undefined")
        why = inQuotes(word) + " is not JSON; expected true, false or null";
    else if ((here == '/' || here == '#') || (previous == '/' && before == first)) why = "comments are not JSON; remove them";
    else if ((here == ']' || here == '}') && previous == ',') why = "a comma before the closing bracket; remove it";
    else if (here == '"') why = "a text where a comma, a colon or a bracket should be";
    else if (here == '\'') why = "text in single quotes; use double quotes";
    else if (static_cast<unsigned char>(here) < 0x20 && !std::isspace(static_cast<unsigned char>(here))) why = "a control character";
    else if (here == '\n' || here == '\r') why = "a line break inside a text";
    else if (!word.empty() && (std::isdigit(static_cast<unsigned char>(name.empty() ? word[0] : name[0])) || word[0] == '.' || word[0] == '+'))
        why = inQuotes(word) + " is not a number as JSON writes it";
    else why = "unexpected " + inQuotes(word.empty() ? text.substr(at, 1) : word);

    const size_t place = at == text.size() ? at : first;
    const auto line = 1 + std::count(text.begin(), text.begin() + ptrdiff_t(place), '\n');
    const size_t lineStart = text.substr(0, place).rfind('\n') + 1; // npos + 1 is 0
    return "at line " + std::to_string(line) + ", column " + std::to_string(place - lineStart + 1) + " (byte " + std::to_string(place + 1) + "): " + why;
}

/// Watches for a key that is there twice in one object: one of the two values would win without a word.
class DuplicateKeys {
public:
    std::string found; // the first one
    bool operator()(int, json::parse_event_t event, json& parsed)
    {
        if (event == json::parse_event_t::object_start) open_.emplace_back();
        else if (event == json::parse_event_t::object_end) open_.pop_back();
        else if (event == json::parse_event_t::key && !open_.back().insert(parsed.get_ref<const std::string&>()).second && found.empty())
            found = inQuotes(parsed.get_ref<const std::string&>());
        return true;
    }

private:
    std::vector<std::set<std::string>> open_;
};

Result<JsonDocument> JsonDocument::parse(std::span<const std::byte> bytes, const std::string& name)
{
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    JsonDocument doc;
    doc.state_ = std::make_shared<State>();
    doc.state_->name = name;
    DuplicateKeys duplicates;
    try {
        doc.state_->value = json::parse(text.begin(), text.end(), std::ref(duplicates));
    } catch (const json::parse_error& e) { // e.byte counts from 1
        return Error{ErrorCode::kBadInput, name + ": not valid JSON " + syntaxError(text, std::max<size_t>(e.byte, 1) - 1)};
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, name + ": out of memory while parsing " + std::to_string(bytes.size()) + " bytes of JSON"};
    } catch (const std::exception& e) { // "... number overflow parsing '1e999'"
        const std::string_view what = e.what();
        const size_t from = what.find('\''), to = what.rfind('\'');
        const std::string_view number = from < to && to != std::string_view::npos ? what.substr(from + 1, to - from - 1) : std::string_view();
        return Error{ErrorCode::kBadInput, name + ": JSON holds a number out of range" + (number.empty() ? "" : ": " + inQuotes(number))};
    }
    if (!duplicates.found.empty())
        return Error{ErrorCode::kBadInput, name + ": the key " + duplicates.found + " is there twice in one object; remove one of them"};
    return doc;
}

JsonNode JsonDocument::root() const { return {state_.get(), &state_->value, ""}; }
bool JsonDocument::failed() const { return state_->error.has_value(); }
const Error& JsonDocument::error() const { return *state_->error; }
const std::string& JsonDocument::name() const { return state_->name; }

void JsonNode::fail(const std::string& expected, const std::string& found, ErrorCode code) const
{
    if (document_->error) return;
    document_->error = Error{code, document_->name + ": " + (where_.empty() ? "top level" : where_) + ": expected " + expected +
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
