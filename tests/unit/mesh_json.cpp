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

TEST_CASE("text that is not JSON is reported with line, column, byte and cause")
{
    const struct {
        std::string text;
        std::initializer_list<const char*> words;
    } cases[] = {
        {"{\n \"a\": NaN}", {"line 2, column 7 (byte 9)", "'NaN'"}},
        {"[1, 2, nan]", {"line 1, column 8 (byte 8)", "'nan'"}},
        {"[-Infinity]", {"byte 2", "'-Infinity'"}},
        {"[+inf]", {"byte 2", "'+inf'"}},
        {"{\"a\": [1, 2,]}", {"column 13 (byte 13)", "comma"}},
        {"{\"a\": 1,\n}", {"line 2, column 1", "comma"}},
        {"{ // words\n}", {"byte 3", "comments"}},
        {"# words\n{}", {"byte 1", "comments"}},
        {"{\"a\": 1 /* words */}", {"comments"}},
        {"{'a': 1}", {"byte 2", "double quotes"}},
        {"{\"a\": True}", {"'True'", "true"}},
        {"{\"a\": None}", {"'None'", "null"}},
        {"{\"a\": 1 \"b\": 2}", {"byte 9"}},
        {"{\"a\": 01}", {"'01'"}},
        {"{\"a\": .5}", {"'.5'"}},
        {"{\"a\": +5}", {"'+5'"}},
        {std::string("\xff\xfe{\0}\0", 6), {"UTF-8"}},
        {std::string("{\0}\0", 4), {"UTF-8"}},
        {"{\"a\": 1", {"byte 8", "ends too early"}},
        {"", {"ends too early"}},
        {"{\"a\": 1e999}", {"out of range", "1e999"}},
        {"{\"a\": {\"b\": 1, \"c\": 2, \"b\": 3}}", {"'b'", "twice"}},
    };
    for (const auto& c : cases) {
        const Result<JsonDocument> document = JsonDocument::parse(std::as_bytes(std::span(c.text)), "x.json");
        CAPTURE(c.text);
        REQUIRE(!document);
        CAPTURE(document.error().message);
        CHECK(document.error().message.starts_with("x.json: "));
        CHECK(document.error().message.find('\n') == std::string::npos);
        for (const char* word : c.words) {
            CAPTURE(word);
            CHECK(document.error().message.find(word) != std::string::npos);
        }
    }
    parse("\xef\xbb\xbf{\"a\": 1}");                           // a byte order mark of UTF-8 is harmless
    parse(R"([{"a": {"a": 1}, "b": 2}, {"a": 1, "b": 3}])"); // equal keys of different objects
}
