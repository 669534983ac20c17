// Files that are cut, lie or reach for other files: an error of one line, never a crash.
#include "mesh_draco_builder.h"
#include "mesh_support.h"

#include <algorithm>

using namespace nacre;

TEST_CASE("a .glb or .gltf cut off at any byte is an error")
{
    GltfBuilder b = quadBuilder({{"normalTexture", {{"index", 0}}}});
    b.add("images", {{"bufferView", b.view(smallPng())}});
    b.add("textures", {{"source", 0}});
    for (const Bytes& good : {b.glb(), b.gltfEmbedded(), dracoBuilder(dracoGrid(2, 8), DracoMethod::kEdgebreaker).glb()}) {
        REQUIRE(decode(good));
        for (size_t n = 0; n < good.size(); n++) {
            const Bytes cut(good.begin(), good.begin() + ptrdiff_t(n));
            const Result<MeshScene> r = decode(cut);
            INFO(n);
            REQUIRE(!r);
            CHECK(r.error().message.find('\n') == std::string::npos);
        }
    }
}

TEST_CASE("a binary chunk cut anywhere, with lengths that agree, is an error that says what is missing")
{
    const GltfBuilder good = quadBuilder();
    for (size_t n = 1; n < good.bin.size(); n++) {
        GltfBuilder cut = good;
        cut.bin.resize(n);
        checkRefused(cut.glb(), ErrorCode::kBadInput, {"bufferViews["});
    }
    checkRefused(good.gltf("quad.bin"), ErrorCode::kBadInput, {"buffers[0]", "the file promises"}, {{"quad.bin", Bytes(50)}});
}

TEST_CASE("what is not glTF 2.0 is said")
{
    const auto text = [](const std::string& s) {
        Bytes b;
        append(b, s.data(), s.size());
        return b;
    };
    checkRefused(text(""), ErrorCode::kBadInput, {"neither .glb nor .gltf"});
    checkRefused(text("ply\nformat ascii 1.0\n"), ErrorCode::kBadInput, {"neither .glb nor .gltf"});
    checkRefused(text("[1, 2]"), ErrorCode::kBadInput, {"not glTF"});
    checkRefused(text("{}"), ErrorCode::kBadInput, {"no 'asset'"});
    checkRefused(text(R"({"asset": {"version": "1.0"}})"), ErrorCode::kUnsupported, {"version '1.0'", "2.0"});
    checkRefused(text(R"({"asset": {"version": "2.0", "minVersion": "2.7"}})"), ErrorCode::kUnsupported, {"minVersion '2.7'"});
    checkRefused(text(R"({"asset": {"version": 2}})"), ErrorCode::kBadInput, {"asset.version", "string"});
    checkRefused(text(R"({"asset": {"version": "2.0"}})"), ErrorCode::kBadInput, {"no triangles"});
    Bytes glb = quadBuilder().glb();
    glb[4] = std::byte(3);
    checkRefused(glb, ErrorCode::kUnsupported, {"GLB version 3"});
    std::string deep = R"({"asset": {"version": "2.0"}, "extras": )";
    for (int i = 0; i < 200000; i++) deep += '[';
    checkRefused(text(deep), ErrorCode::kBadInput, {"JSON"});
    checkRefused(text(std::string(9000000, ',')), ErrorCode::kBadInput, {"9000000 values"});
}

TEST_CASE("file names that leave the folder of the file are refused before anything is read")
{
    for (const char* uri : {"/etc/passwd", "../secret.bin", "a/../../secret.bin", "%2e%2e/secret.bin", "..\\secret.bin", "file:///etc/passwd", "http://x.example/a.bin",
                            "C:\\a.bin", "\\\\server\\a.bin", "a/%00b", ""}) {
        INFO(uri);
        bool asked = false;
        const UriReader reader = [&](const std::string&) -> Result<Bytes> {
            asked = true;
            return Bytes(1000);
        };
        const Result<MeshScene> r = decodeGltf(quadBuilder().gltf(uri), "scene.gltf", reader);
        REQUIRE(!r);
        CHECK(!asked);
        CHECK(mentions(r.error().message, "buffers[0].uri"));
    }
    const GltfBuilder b = quadBuilder();
    CHECK(decode(b.gltf("a/../b.bin"), {{"a/../b.bin", b.bin}})); // stays inside
    CHECK(decode(b.gltf("./b:c.bin"), {{"./b:c.bin", b.bin}}));
    checkRefused(b.gltf("data:text/plain,hello"), ErrorCode::kBadInput, {"not base64"});
    GltfBuilder none = b;
    none.root["buffers"] = {{{"byteLength", 3}}};
    none.bin.clear();
    Bytes text;
    append(text, none.root.dump().data(), none.root.dump().size());
    checkRefused(text, ErrorCode::kBadInput, {"buffers[0] has no uri"});
}

TEST_CASE("single flipped bits give a scene or an error of one line")
{
    GltfBuilder b = quadBuilder({{"normalTexture", {{"index", 0}}}});
    b.add("images", {{"bufferView", b.view(smallPng())}});
    b.add("textures", {{"source", 0}});
    const Bytes good = b.glb();
    for (size_t bit = 0; bit < good.size() * 8; bit++) {
        Bytes damaged = good;
        damaged[bit / 8] ^= std::byte(1 << (bit % 8));
        const Result<MeshScene> r = decode(damaged);
        if (!r) CHECK(r.error().message.find('\n') == std::string::npos);
    }
}

TEST_CASE("a file with thousands of things to warn about has a screenful of warnings")
{
    GltfBuilder b = quadBuilder();
    for (int i = 0; i < 1000; i++) b.add("materials", {{"alphaCutoff", -1.0 - i}});
    const MeshScene scene = load(b.glb());
    CHECK(scene.warnings.size() == 51);
    CHECK(mentions(scene.warnings.back(), "more warnings"));
}
