// What the glTF reader added to JsonNode: keys, sizes, booleans, long strings.
#include "interchange/json.h"

#include <doctest/doctest.h>

#include <cstring>

using namespace nacre;

static JsonDocument parse(const std::string& text)
{
    Result<JsonDocument> document = JsonDocument::parse(std::as_bytes(std::span(text)), "x.json");
    REQUIRE(document);
    return *document;
}

TEST_CASE("JSON sizes are whole, not negative and exact beyond 32 bits")
{
    const JsonDocument d = parse(R"({"a": 9007199254740991, "b": 5000000000, "c": -1, "d": 1.5, "e": "7"})");
    CHECK(d.root()["a"].size(UINT64_MAX) == 9007199254740991u);
    CHECK(d.root()["b"].size(5000000000u) == 5000000000u);
    CHECK(!d.failed());
    for (const char* key : {"b", "c", "d", "e", "f"}) {
        const JsonDocument fresh = parse(R"({"b": 5000000000, "c": -1, "d": 1.5, "e": "7"})");
        CHECK(fresh.root()[key].size(4999999999u) == 0);
        CHECK(fresh.failed());
        CHECK(fresh.error().message.find(std::string("x.json: ") + key) == 0);
    }
}

TEST_CASE("JSON keys, booleans and long strings; a mismatch of kind is an error")
{
    const std::string longText(100000, 'x');
    const JsonDocument d = parse(R"({"b": true, "a": "short", "c": false, "d": ")" + longText + "\"}");
    CHECK(d.root().keys() == std::vector<std::string>{"a", "b", "c", "d"});
    CHECK(d.root().isObject());
    CHECK(!d.root()["a"].isObject());
    CHECK(d.root()["b"].boolean());
    CHECK(!d.root()["c"].boolean());
    CHECK(d.root()["d"].text() == longText);
    CHECK(!d.failed());
    CHECK(!parse("[1]").root().isObject());
    const auto fails = [](auto read) {
        const JsonDocument fresh = parse(R"({"a": 1})");
        read(fresh.root()["a"]);
        return fresh.failed();
    };
    CHECK(fails([](const JsonNode& n) { return n.boolean(); }));
    CHECK(fails([](const JsonNode& n) { return n.text().size(); }));
    CHECK(fails([](const JsonNode& n) { return n.keys().size(); }));
    CHECK(!fails([](const JsonNode& n) { return n.number(1.0); }));
    CHECK(fails([](const JsonNode& n) { return n.number(0.5); }));
}
