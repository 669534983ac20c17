// The asset container: what is written comes back bit for bit, and no bytes whatsoever make the reader crash or lie.
#include "formats_fixtures.h"

#include "base/file.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <functional>
#include <limits>

using namespace nacre;
using namespace nacre::test;
using nlohmann::json;

namespace {

std::vector<std::byte> encoded(const SplatAsset& asset)
{
    auto bytes = encodeAsset(asset);
    REQUIRE_MESSAGE(bytes, (bytes ? "" : bytes.error().message));
    return *bytes;
}

std::string decodeError(std::span<const std::byte> bytes)
{
    const auto asset = decodeAsset(bytes);
    if (asset) return "";
    CHECK(asset.error().message.find('\n') == std::string::npos); // one line for a person
    return asset.error().message;
}

bool contains(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

const std::string kGolden = std::string(NACRE_SOURCE_DIR) + "/tests/golden/asset_v";
SplatAsset inDataset(SplatAsset asset)
{
    asset.frame = {1234.56789012345678, {500000.123456789, -1e-7, 1.0 / 3}, 0.001 / 7};
    return asset;
}
SplatAsset goldenAsset(int version)
{
    if (version == 4) return inDataset(goldenAsset(3));
    return version >= 3 ? makeLeading(3, 2, 4, /*sharp*/ true) : makeAsset(3, 4, 9, /*sharp*/ version >= 2);
}

} // namespace

TEST_CASE("asset comes back bit for bit, for every size of s and of the neutral look")
{
    for (int s : {0, 1, 4, 9, 16, 25})
        for (int neutral : {0, 1, 4, 9, 16}) {
            CAPTURE(s);
            CAPTURE(neutral);
            const SplatAsset asset = makeAsset(5, s, neutral);
            const auto back = decodeAsset(encoded(asset));
            REQUIRE_MESSAGE(back, (back ? "" : back.error().message));
            CHECK(identical(asset, *back));
        }
}

TEST_CASE("an asset of the model sss comes back bit for bit; a row for all splats must be marked as one")
{
    for (const bool all : {false, true}) {
        const SplatAsset asset = makeSss(5, all);
        const auto back = decodeAsset(encoded(asset));
        REQUIRE_MESSAGE(back, (back ? "" : back.error().message));
        CHECK(identical(asset, *back));
    }
    GlbParts parts(encoded(makeSss(5, true)));
    json& network = parts.relight()["channels"].back();
    REQUIRE(network["perAsset"] == true);
    network["perAsset"] = "yes";
    CHECK(contains(decodeError(parts.bytes()), "perAsset is neither true nor false"));
    network.erase("perAsset");
    CHECK(contains(decodeError(parts.bytes()), "expected 5 splats x 6632 floats"));
}

TEST_CASE("a channel of the first splats only comes back bit for bit, and every other number of rows is refused")
{
    const SplatAsset asset = makeLeading(5, 2, 4);
    const auto back = decodeAsset(encoded(asset));
    REQUIRE_MESSAGE(back, (back ? "" : back.error().message));
    CHECK(identical(asset, *back));
    CHECK(GlbParts(encoded(asset)).relight()["version"] == 3);
    CHECK(GlbParts(encoded(makeAsset(5, 4, 4))).relight()["version"] == 2); // older readers can read what does not need it

    const auto withLeading = [&](const char* name, const json& leading) {
        GlbParts parts(encoded(asset));
        for (json& channel : parts.relight()["channels"])
            if (channel["name"] == name) channel["leading"] = leading;
        return decodeError(parts.bytes());
    };
    CHECK(contains(withLeading("s", 1), "expected 1 splats x 30 floats"));
    CHECK(contains(withLeading("s", 3), "expected 3 splats x 30 floats"));
    for (const json& wrong : {json(0), json(5), json(6), json(4294967295u), json(9223372036854775807u)})
        CHECK(contains(withLeading("s", wrong), "expected 1 to 4"));
    for (const json& wrong : {json(-1), json(1.5), json("2"), json(18446744073709551615u)}) CHECK(withLeading("s", wrong) != "");
    GlbParts parts(encoded(asset)); // a channel that has to cover all, with the bytes of a part
    for (json& channel : parts.relight()["channels"])
        if (channel["name"] == "rho") channel["leading"] = 4, parts.json["bufferViews"][channel["bufferView"].get<size_t>()]["byteLength"] = 48;
    CHECK(contains(decodeError(parts.bytes()), "channel 'rho' has rows for the first 4 of 5 splats, expected for all"));

    SplatAsset all = asset;
    for (Channel& c : all.channels)
        if (c.name == "s") c.leading = 5;
    CHECK_FALSE(encodeAsset(all));
}

TEST_CASE("asset keeps floats that have no short decimal text")
{
    SplatAsset asset = makeAsset(2, 0, 0);
    asset.lowPassVariance = std::nextafter(0.3f, 1.0f);
    asset.yUpFromAsset = glm::normalize(glm::quat(0.3f, 0.1f, -0.7f, 0.2f));
    asset.cloud.positions[1] = {1.17549435e-38f, -0.0f, 3.0e8f};
    const auto back = decodeAsset(encoded(asset));
    REQUIRE(back);
    CHECK(identical(asset, *back));
}

TEST_CASE("encoding is deterministic") { CHECK(encoded(makeAsset(7, 9, 16)) == encoded(makeAsset(7, 9, 16))); }

TEST_CASE("file is what KHR_gaussian_splatting asks for")
{
    const SplatAsset asset = makeAsset(4, 4, 16);
    GlbParts glb(encoded(asset));
    CHECK(glb.json["extensionsUsed"] == json({"KHR_gaussian_splatting", "NACRE_gaussian_splatting_relight"}));
    CHECK_FALSE(glb.json.contains("extensionsRequired")); // viewers that cannot relight still show the neutral look
    CHECK(glb.primitive()["mode"] == 0);
    CHECK(glb.splatting()["kernel"] == "ellipse");
    CHECK(glb.splatting()["colorSpace"] == "lin_rec709_display");
    CHECK(glb.relight()["screenFilter"] == json({{"type", "mip"}, {"variance", 0.1}}));

    const json& attributes = glb.primitive()["attributes"];
    CHECK(attributes.size() == 4 + 16 + 1);
    for (const json& accessor : glb.json["accessors"]) {
        CHECK(accessor["count"] == 4);
        CHECK(accessor["componentType"] == 5126);
    }
    const json& position = glb.json["accessors"][attributes["POSITION"].get<size_t>()];
    for (int axis = 0; axis < 3; ++axis) {
        float lo = std::numeric_limits<float>::max(), hi = -lo;
        for (const glm::vec3& p : asset.cloud.positions) lo = std::min(lo, p[axis]), hi = std::max(hi, p[axis]);
        CHECK(position["min"][size_t(axis)] == lo);
        CHECK(position["max"][size_t(axis)] == hi);
    }
    CHECK(attributes.contains("KHR_gaussian_splatting:SH_DEGREE_3_COEF_6"));
    CHECK_FALSE(attributes.contains("KHR_gaussian_splatting:SH_DEGREE_4_COEF_0"));
}

TEST_CASE("fallback colour is the clamped linear colour of the constant SH term, alpha the opacity")
{
    SplatAsset asset = makeAsset(2, 0, 4);
    asset.neutral.sh[4] = {0.25f, -9.0f, 9.0f}; // splat 1, function 0
    GlbParts glb(encoded(asset));
    const json& accessor = glb.json["accessors"][glb.primitive()["attributes"]["COLOR_0"].get<size_t>()];
    CHECK(accessor["type"] == "VEC4");
    float rgba[4];
    const json& view = glb.json["bufferViews"][accessor["bufferView"].get<size_t>()];
    std::memcpy(rgba, glb.bin.data() + view["byteOffset"].get<size_t>() + 16, 16);
    CHECK(rgba[0] == doctest::Approx(0.5 + 0.282095 * 0.25).epsilon(1e-5));
    CHECK(rgba[1] == 0.0f);
    CHECK(rgba[2] == 1.0f);
    CHECK(rgba[3] == asset.cloud.opacities[1]);
}

TEST_CASE("where an asset lies in its dataset comes back to the last bit, and only readers that know of it read it")
{
    const SplatAsset asset = inDataset(makeAsset(3, 1, 1));
    GlbParts glb(encoded(asset));
    CHECK(glb.relight()["version"] == 4);
    const auto back = decodeAsset(glb.bytes());
    REQUIRE_MESSAGE(back, (back ? "" : back.error().message));
    CHECK(back->frame == asset.frame);
    CHECK(GlbParts(encoded(makeAsset(3, 1, 1))).relight()["version"] == 2); // an asset in the dataset's own units needs no new reader

    struct Damage {
        const char *key, *value;
    };
    for (const Damage& d : {Damage{"scale", "0"}, {"scale", "-1"}, {"scale", "1e300"}, {"scale", "\"1\""}, {"lightGain", "0"}, {"lightGain", "null"},
                            {"translation", "[0, 0]"}, {"translation", "[0, 0, 1e200]"}, {"translation", "3"}}) {
        GlbParts bad = glb;
        bad.relight()["datasetFrame"][d.key] = json::parse(d.value);
        CAPTURE(d.key);
        CAPTURE(d.value);
        CHECK(decodeError(bad.bytes()) != "");
    }
    for (const char* key : {"scale", "lightGain", "translation"}) {
        GlbParts bad = glb;
        bad.relight()["datasetFrame"].erase(key);
        CHECK(contains(decodeError(bad.bytes()), key));
    }
}

TEST_CASE("golden files of every version still decode")
{
    for (int version : {1, 2, 3, 4}) {
        const auto bytes = readFile(kGolden + std::to_string(version) + ".glb");
        REQUIRE_MESSAGE(bytes, (bytes ? "" : bytes.error().message));
        const auto asset = decodeAsset(*bytes);
        REQUIRE_MESSAGE(asset, (asset ? "" : asset.error().message));
        CHECK(identical(*asset, goldenAsset(version)));
        if (version >= 2) CHECK(encoded(*asset) == *bytes); // what needs no newer version is also written as it was
    }
}

// Only for a new format version: test_formats --no-skip -tc="write the golden file"
TEST_CASE("write the golden file" * doctest::skip()) { REQUIRE(writeAsset(goldenAsset(4), kGolden + "4.glb")); }

TEST_CASE("asset cut at every prefix is an error")
{
    const std::vector<std::byte> bytes = encoded(makeAsset(2, 1, 1, true));
    for (size_t n = 0; n < bytes.size(); ++n) {
        const std::vector<std::byte> prefix(bytes.begin(), bytes.begin() + ptrdiff_t(n)); // own allocation: ASan sees overreads
        if (decodeError(prefix).empty()) FAIL("accepted the first " << n << " of " << bytes.size() << " bytes");
    }
}

TEST_CASE("asset cut at every prefix, with GLB lengths that agree, is an error")
{
    const GlbParts glb(encoded(makeAsset(2, 1, 1)));
    const std::string text = glb.json.dump();
    for (size_t n = 0; n < glb.bin.size(); n += 4) {
        const std::vector<std::byte> bin(glb.bin.begin(), glb.bin.begin() + ptrdiff_t(n));
        if (decodeError(GlbParts::assemble(text, bin)).empty()) FAIL("accepted " << n << " bytes of binary chunk");
    }
    for (size_t n = 0; n < text.size(); ++n)
        if (decodeError(GlbParts::assemble(text.substr(0, n), glb.bin)).empty()) FAIL("accepted " << n << " bytes of JSON");
}

TEST_CASE("flipping any byte gives an error or a valid asset")
{
    const std::vector<std::byte> original = encoded(makeAsset(2, 1, 1, true));
    for (size_t i = 0; i < original.size(); ++i)
        for (const int mask : {0x01, 0x80, 0xff}) {
            std::vector<std::byte> bytes = original;
            bytes[i] ^= std::byte(mask);
            const auto asset = decodeAsset(bytes);
            if (asset && !validate(*asset)) FAIL("byte " << i << " ^ " << mask << ": accepted an invalid asset");
        }
}

TEST_CASE("counts, lengths and offsets that lie are refused")
{
    const std::vector<std::byte> original = encoded(makeAsset(3, 4, 4));
    const auto refuses = [&](const char* what, const std::function<void(GlbParts&)>& edit) {
        GlbParts glb(original);
        edit(glb);
        INFO(what);
        CHECK(decodeError(glb.bytes()) != "");
    };
    const json numbers = {-1,
                          0,
                          1,
                          2,
                          4,
                          1e300,
                          "3",
                          nullptr,
                          json::array(),
                          true,
                          2147483648u,
                          4294967295u,
                          1152921504606846976u,
                          9223372036854775807u,
                          18446744073709551615u};
    for (const json& n : numbers) {
        CAPTURE(n.dump());
        refuses("count", [&](GlbParts& g) { g.relight()["count"] = n; });
        refuses("every count", [&](GlbParts& g) {
            g.relight()["count"] = n;
            for (json& accessor : g.json["accessors"]) accessor["count"] = n;
        });
        for (size_t i = 0; i < GlbParts(original).json["accessors"].size() - 1; ++i) // the last is COLOR_0, which is not read
            refuses("accessor count", [&](GlbParts& g) { g.json["accessors"][i]["count"] = n; });
        for (size_t i = 0; i < 5; ++i) refuses("byteLength", [&](GlbParts& g) { g.json["bufferViews"][i]["byteLength"] = n; });
        for (const char* field : {"components", "componentType"})
            refuses(field, [&](GlbParts& g) { g.relight()["channels"][1][field] = n; });
        if (n != json(0)) refuses("buffer", [&](GlbParts& g) { g.json["bufferViews"][0]["buffer"] = n; });
        if (n != json(1) && n != json(2) && n != json(3) && n != json(4)) refuses("version", [&](GlbParts& g) { g.relight()["version"] = n; });
        if (n != json(0)) refuses("mode", [&](GlbParts& g) { g.primitive()["mode"] = n; });
        if (n != json(0) && n != json(1)) // a prefix of the coefficients is a smaller look, not a lie
            if (n != json(4)) refuses("neutralFunctions", [&](GlbParts& g) { g.relight()["neutralFunctions"] = n; });
    }
    for (const json& n : {json(-4), json(4294967292u), json(18446744073709551612u), json("0")}) {
        CAPTURE(n.dump());
        refuses("view offset", [&](GlbParts& g) { g.json["bufferViews"][1]["byteOffset"] = n; });
        refuses("accessor offset", [&](GlbParts& g) { g.json["accessors"][1]["byteOffset"] = n; });
        refuses("stride", [&](GlbParts& g) { g.json["bufferViews"][0]["byteStride"] = n; });
        refuses("channel view", [&](GlbParts& g) { g.relight()["channels"][0]["bufferView"] = n; });
        refuses("attribute", [&](GlbParts& g) { g.primitive()["attributes"]["POSITION"] = n; });
    }
    refuses("overlapping rows", [](GlbParts& g) { g.json["bufferViews"][0]["byteStride"] = 4; });
    refuses("unaligned rows", [](GlbParts& g) { g.json["bufferViews"][0]["byteStride"] = 13; });
    refuses("buffer longer than the chunk", [](GlbParts& g) { g.json["buffers"][0]["byteLength"] = g.bin.size() + 4; });
    refuses("wrong accessor type", [](GlbParts& g) { g.json["accessors"][0]["type"] = "VEC4"; });
    refuses("duplicate channel", [](GlbParts& g) { g.relight()["channels"][1] = g.relight()["channels"][0]; });
    refuses("a thousand channels", [](GlbParts& g) {
        for (int i = 0; i < 1000; ++i) g.relight()["channels"].push_back(g.relight()["channels"][0]);
    });
}

TEST_CASE("channels that share bytes are refused before they are copied")
{
    const std::vector<std::byte> original = encoded(makeAsset(3, 4, 0));
    const auto withCopies = [&](const std::function<std::string(int)>& name) {
        GlbParts glb(original);
        for (int i = 0; i < 40; ++i) {
            json copy = glb.relight()["channels"][0];
            copy["name"] = name(i);
            glb.relight()["channels"].push_back(copy);
        }
        return decodeError(glb.bytes());
    };
    CHECK(contains(withCopies([](int i) { return "extra" + std::to_string(i); }), "must not share bytes"));
    CHECK(contains(withCopies([](int) { return "tDir"; }), "occurs twice"));
}

TEST_CASE("every property the reader needs is missed when it is gone, and no wrong type crashes it")
{
    const std::vector<std::byte> original = encoded(makeAsset(2, 1, 1, true));
    // Walks the tree and edits one node at a time.
    std::vector<json::json_pointer> paths;
    const std::function<void(const json&, const json::json_pointer&)> walk = [&](const json& node, const json::json_pointer& at) {
        paths.push_back(at);
        if (node.is_object())
            for (const auto& [key, child] : node.items()) walk(child, at / key);
        else if (node.is_array())
            for (size_t i = 0; i < node.size(); ++i) walk(node[i], at / i);
    };
    const GlbParts glb(original);
    walk(glb.json, json::json_pointer());
    for (const auto& path : paths)
        for (const json& wrong : {json(nullptr), json(true), json(-1), json(0.5), json("x"), json::array(), json::object()}) {
            GlbParts edited = glb;
            edited.json[path] = wrong;
            const auto asset = decodeAsset(edited.bytes());
            if (asset) CHECK_MESSAGE(validate(*asset), path.to_string());
        }
    for (const char* key : {"version", "model", "profile", "count", "positionHash", "screenFilter", "neutralFunctions",
                            "lightUnits", "channels", "bakedWith"}) {
        GlbParts edited = glb;
        edited.relight().erase(key);
        CHECK_MESSAGE(contains(decodeError(edited.bytes()), key), key);
    }
}

TEST_CASE("hostile JSON is refused before it is parsed")
{
    const std::vector<std::byte> none;
    CHECK(contains(decodeError(GlbParts::assemble(std::string(1000000, '['), none)), "nested"));
    std::string nested;
    for (int i = 0; i < 100000; ++i) nested += "{\"a\":";
    CHECK(contains(decodeError(GlbParts::assemble(nested, none)), "nested"));
    CHECK(contains(decodeError(GlbParts::assemble("{\"a\":\"" + std::string(5000000, 'x') + "\"}", none)), "at most"));
    for (const char* text :
         {"", "null", "[]", "{", "{}", "\"", "\"\\", "{\"meshes\":[{\"primitives\":[7]}]}", "\xff\xfe", "{} {}"}) {
        CAPTURE(text);
        CHECK(decodeError(GlbParts::assemble(text, none)) != "");
    }
}

TEST_CASE("nothing outside the file is read")
{
    const GlbParts glb(encoded(makeAsset(2, 0, 1)));
    for (const char* uri : {"/etc/passwd", "data:application/octet-stream;base64,AAAA", "http://localhost/x", ""}) {
        GlbParts edited = glb;
        edited.json["buffers"][0]["uri"] = uri;
        CHECK(contains(decodeError(edited.bytes()), "URI"));
    }
}

TEST_CASE("files that are no Nacre assets say what they are")
{
    const GlbParts glb(encoded(makeAsset(2, 0, 1)));
    const auto messageAfter = [&](const std::function<void(GlbParts&)>& edit) {
        GlbParts edited = glb;
        edit(edited);
        return decodeError(edited.bytes());
    };
    CHECK(contains(messageAfter([](GlbParts& g) { g.splatting().erase("extensions"); }), "without Nacre relighting data"));
    CHECK(contains(messageAfter([](GlbParts& g) { g.primitive().erase("extensions"); }), "without Gaussian splats"));
    CHECK(contains(messageAfter([](GlbParts& g) { g.relight()["version"] = 6; }), "update Nacre"));
    CHECK(contains(messageAfter([](GlbParts& g) { g.relight()["model"] = "nerf"; }), "unknown appearance model 'nerf'"));
    CHECK(contains(messageAfter([](GlbParts& g) { g.json["extensionsRequired"] = {"EXT_meshopt_compression"}; }),
                   "EXT_meshopt_compression"));
    CHECK(contains(messageAfter([](GlbParts& g) { g.relight()["model"] = "two\nlines"; }), "printable"));
    CHECK(contains(messageAfter([](GlbParts& g) { g.relight()["channels"][0]["name"] = "a\x1b[2J"; }), "printable"));
    const std::string png = "\x89PNG\r\n\x1a\n and then some more bytes";
    CHECK(contains(decodeError(std::as_bytes(std::span(png))), "not a .glb"));
}

TEST_CASE("a tool that moved or reordered splats is noticed")
{
    GlbParts moved(encoded(makeAsset(3, 1, 1)));
    std::vector<std::byte> first(moved.bin.begin(), moved.bin.begin() + 12); // POSITION is the first view, tight
    std::swap_ranges(first.begin(), first.end(), moved.bin.begin() + 12);
    std::copy(first.begin(), first.end(), moved.bin.begin());
    CHECK(contains(decodeError(moved.bytes()), "relighting data belong to other positions"));
}

TEST_CASE("a tool that repacked the same data, with other scene nodes, is no harm")
{
    const SplatAsset asset = makeAsset(3, 1, 0);
    GlbParts glb(encoded(asset));
    // POSITION moves to the end of the buffer, strided, and COLOR_0 goes.
    json& view = glb.json["bufferViews"][0];
    view["byteOffset"] = glb.bin.size();
    view["byteStride"] = 20;
    view["byteLength"] = 2 * 20 + 12 + 4;
    glb.json["accessors"][0]["byteOffset"] = 4;
    glb.bin.resize(glb.bin.size() + 56);
    for (size_t i = 0; i < 3; ++i) std::memcpy(glb.bin.data() + glb.bin.size() - 56 + 4 + 20 * i, &asset.cloud.positions[i], 12);
    glb.json["buffers"][0]["byteLength"] = glb.bin.size();
    glb.primitive()["attributes"].erase("COLOR_0");
    glb.json["nodes"].insert(glb.json["nodes"].begin(), json{{"name", "camera"}});
    const auto back = decodeAsset(glb.bytes());
    REQUIRE_MESSAGE(back, (back ? "" : back.error().message));
    CHECK(identical(asset, *back));
}

TEST_CASE("invalid assets are not written")
{
    SplatAsset asset = makeAsset(2, 1, 1);
    asset.cloud.opacities[1] = 2.0f;
    const auto bytes = encodeAsset(asset);
    REQUIRE_FALSE(bytes);
    CHECK(bytes.error().code == ErrorCode::kBadInput);

    asset = makeAsset(2, 1, 1);
    asset.bakedWith = "\xff\xfe not UTF-8";
    CHECK_FALSE(encodeAsset(asset));
}

TEST_CASE("summary counts the bytes of every part, and they add up to the binary chunk")
{
    const SplatAsset asset = makeAsset(10, 9, 16);
    const std::vector<std::byte> bytes = encoded(asset);
    const AssetSummary summary = summarizeAsset(asset);
    CHECK(summary.profile == "lossless");
    size_t total = 0;
    std::vector<std::string> names;
    for (const auto& c : summary.channels) total += c.bytes, names.push_back(c.name);
    CHECK(names == std::vector<std::string>{"geometry", "neutralLook", "tDir", "tInd", "rho", "s"});
    CHECK(total == GlbParts(bytes).bin.size());
    CHECK(summary.channels[2].bytes == 10 * 25 * 4);
}

TEST_CASE("a network whose sums would overflow is refused, by its weights, codes or normals")
{
    const SplatAsset sound = makeSss(5, true);
    REQUIRE(validate(sound));
    const auto factors = [&](const char* name, float factor) {
        SplatAsset asset = sound;
        for (Channel& c : asset.channels)
            if (c.name == name)
                for (float& v : c.values) v *= factor;
        return asset;
    };
    CHECK(validate(factors("network", 1e3f)));
    CHECK(validate(factors("code", 1e6f)));
    for (const SplatAsset& asset : {factors("network", 1e14f), factors("normal", 1e14f), factors("code", 1e14f)}) {
        SplatAsset worse = asset;
        for (Channel& c : worse.channels)
            if (c.name == "network")
                for (float& v : c.values) v *= 1e6f;
        const Status s = validate(worse);
        REQUIRE_FALSE(s);
        CHECK(s.error().message.find("network") != std::string::npos);
    }
}
