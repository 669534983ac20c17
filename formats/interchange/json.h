// JSON in, for description files of datasets and for glTF. Only json.cpp knows the library.
//
// A JsonNode is a value and the way to it ("frames[12].light.position"). Getters never fail loudly: the first mismatch is kept in
// the document and a harmless default comes back, so a loader reads a whole frame and then asks once: if (doc.failed()) ...
#pragma once

#include "base/result.h"
#include "base/text.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace nacre {

class JsonNode;

class JsonDocument {
public:
    /// `name` stands for the file in error messages. Any input is safe; error kBadInput with line, column,
    /// byte and likely cause if it is not JSON, or if a key is there twice in one object; kIo out of memory.
    static Result<JsonDocument> parse(std::span<const std::byte> text, const std::string& name);

    JsonNode root() const;
    bool failed() const;
    /// The first mismatch: "name: where: expected ..., found ...".
    const Error& error() const;
    const std::string& name() const;

    struct State;

private:
    std::shared_ptr<State> state_; // shared by copies of the document; nodes point into it
};

/// Valid while its document (or a copy of it) lives.
class JsonNode {
public:
    JsonNode(JsonDocument::State* document, const void* value, std::string where)
        : document_(document), value_(value), where_(std::move(where)) {}

    bool exists() const { return value_ != nullptr; } // present and not null
    bool isNumber() const;
    bool isString() const;
    bool isArray() const;
    bool isObject() const;
    JsonNode operator[](const char* key) const;       // absent if there is no such key; reading an absent node is the error
    std::vector<JsonNode> items() const;              // elements of an array, or values of an object in key order
    JsonNode firstItem() const;                       // the first of them, absent if there is none; records nothing
    std::vector<std::string> keys() const;            // of an object, sorted

    double number(double largest = 1e30) const;       // finite, |x| <= largest
    int integer(int lowest, int highest) const;       // a whole number in the range
    uint64_t size(uint64_t highest) const;            // a whole number from 0; exact up to 2^53
    bool boolean() const;
    std::string string() const;                       // at most 4096 bytes, no NUL
    std::string_view text() const;                    // any string, as it is; valid while the document lives
    std::vector<double> numbers(size_t count) const;  // array of exactly `count`

    /// Records a mismatch at this place: what was expected, what was found.
    void fail(const std::string& expected, const std::string& found, ErrorCode code = ErrorCode::kBadInput) const;
    const std::string& where() const { return where_; }

private:
    std::string describe() const;

    JsonDocument::State* document_;
    const void* value_;
    std::string where_;
};

} // namespace nacre
