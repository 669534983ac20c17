// The profile compact: columns of integers, blocks, and files of them.
#include "formats_fixtures.h"

#include "appearance/coded_channels.h"
#include "asset/codec/columns.h"
#include "base/file.h"
#include "base/octahedral.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

using namespace nacre;
using namespace nacre::test;

namespace {

std::vector<std::byte> compactBytes(size_t count, bool sss)
{
    auto bytes = encodeCompact(makeQuantised(count, sss));
    REQUIRE_MESSAGE(bool(bytes), (bytes ? "" : bytes.error().message));
    return std::move(*bytes);
}

std::vector<int32_t> randomColumn(size_t rows, int kind, std::mt19937& random)
{
    std::vector<int32_t> column(rows);
    for (size_t i = 0; i < rows; ++i) {
        const uint32_t r = random();
        switch (kind) {
        case 0: column[i] = 0; break;
        case 1: column[i] = -7; break;
        case 2: column[i] = int32_t(r); break;
        case 3: column[i] = int32_t(r % 5) - 2; break;
        case 4: column[i] = int32_t(3 * i + r % 2); break;
        case 5: column[i] = r % 50 == 0 ? std::numeric_limits<int32_t>::min() : 0; break;
        default: column[i] = r % 2 ? std::numeric_limits<int32_t>::max() : std::numeric_limits<int32_t>::min();
        }
    }
    return column;
}

const std::string kGoldenCompact = std::string(NACRE_SOURCE_DIR) + "/tests/golden/asset_v5.glb";

} // namespace

TEST_CASE("columns of integers come back, whatever is in them and beside them")
{
    std::mt19937 random(1);
    for (const size_t rows : {0, 1, 2, 3, 255, 256, 257, 258, 259, 1000, 4099})
        for (int kind = 0; kind < 7; ++kind) {
            CAPTURE(rows);
            CAPTURE(kind);
            const std::vector<int32_t> first = randomColumn(rows, kind, random), second = randomColumn(rows, (kind + 3) % 7, random);
            std::vector<std::byte> bytes;
            codec::encodeColumn(first, {}, bytes), codec::encodeColumn(second, first, bytes);
            std::vector<int32_t> a(rows), b(rows);
            codec::ColumnDecoder decoder(bytes);
            REQUIRE(decoder.next(a, {}));
            REQUIRE(decoder.next(b, a));
            CHECK(a == first);
            CHECK(b == second);
            CHECK(decoder.rest() == 0);
        }
}

TEST_CASE("a column takes about its entropy, and less where it resembles the row above or the column to the left")
{
    constexpr size_t kRows = 20000;
    std::mt19937 random(2);
    std::geometric_distribution<int> geometric(0.5); // 2 bits of entropy, and one of sign for all but zeros
    std::vector<int32_t> plain(kRows), smooth(kRows), beside(kRows);
    for (size_t i = 0; i < kRows; ++i) {
        plain[i] = geometric(random) * (random() % 2 ? 1 : -1);
        smooth[i] = (i ? smooth[i - 1] : 0) + plain[i];
        beside[i] = plain[i] == 0 ? 0 : geometric(random) * 9;
    }
    CHECK(double(codec::encodedBytes(plain, {})) * 8 / kRows < 2.55);
    CHECK(codec::encodedBytes(smooth, {}) < codec::encodedBytes(plain, {}) + 200);
    CHECK(codec::encodedBytes(beside, plain) < codec::encodedBytes(beside, {}) * 9 / 10);
}

TEST_CASE("damaged columns end in false, not in a hang or a crash")
{
    std::mt19937 random(3);
    const std::vector<int32_t> column = randomColumn(300, 4, random);
    std::vector<std::byte> bytes;
    codec::encodeColumn(column, {}, bytes);
    std::vector<int32_t> out(column.size());
    for (size_t length = 0; length < bytes.size(); ++length) CHECK(!codec::ColumnDecoder(std::span(bytes).first(length)).next(out, {}));
    for (size_t i = 0; i < bytes.size(); ++i) { // most flips show in the state that the coder ends in
        std::vector<std::byte> flipped = bytes;
        flipped[i] ^= std::byte(0x55);
        (void)codec::ColumnDecoder(flipped).next(out, {});
    }
}

TEST_CASE("octahedral coordinates lead back to their direction")
{
    for (int i = 0; i < 500; ++i) {
        const glm::vec3 w = glm::normalize(glm::vec3(std::sin(i * 1.7f), std::cos(i * 2.3f), std::sin(i * 0.9f + 1)));
        const glm::vec2 uv = octahedralCoordinates(w);
        CHECK(glm::length(octahedralDirection(uv.x, uv.y) - w) < 1e-6f);
    }
}

TEST_CASE("a compact file holds what its integers stand for, to the last bit")
{
    for (const bool sss : {false, true})
        for (const size_t count : {1, 2, 300}) {
            CAPTURE(sss);
            CAPTURE(count);
            const QuantisedAsset quantised = makeQuantised(count, sss);
            const std::vector<std::byte> bytes = compactBytes(count, sss);
            CHECK(bytes == compactBytes(count, sss));
            Result<SplatAsset> read = decodeAsset(bytes), expected = dequantise(quantised);
            REQUIRE_MESSAGE(bool(read), (read ? "" : read.error().message));
            REQUIRE(bool(expected));
            CHECK(read->profile == "compact");
            CHECK(read->drawnVisibility == quantised.frame.drawnVisibility);
            REQUIRE(read->coded.size() == expected->coded.size());
            for (size_t c = 0; c < read->coded.size(); ++c) CHECK(read->coded[c].values == expected->coded[c].values);
            expandChannels(*read), expandChannels(*expected);
            CHECK(identical(*read, *expected));
        }
}

TEST_CASE("numbers of a block are offset, step and basis, and what its transform makes of them")
{
    Result<SplatAsset> asset = dequantise(makeQuantised(40, false));
    REQUIRE(bool(asset));
    const QuantisedAsset quantised = makeQuantised(40, false);
    const auto block = [&](const char* name) -> const Block& {
        return *std::find_if(quantised.blocks.begin(), quantised.blocks.end(), [&](const Block& b) { return b.targets[0].name == name; });
    };
    expandChannels(*asset);
    const size_t splat = 17, rows = 40;
    CHECK(asset->cloud.positions[splat].y == doctest::Approx(0.25 + block("POSITION").codes[rows + splat] / 256.0));
    CHECK(asset->cloud.scales[splat].z == doctest::Approx(std::exp(0.25 + block("SCALE").codes[2 * rows + splat] / 256.0)));
    CHECK(asset->cloud.rotations[splat].w >= 0);
    CHECK(glm::length(asset->cloud.rotations[splat]) == doctest::Approx(1));
    const Block& transport = block("tDir");
    double expected = 0.25; // number 30, which is component 5 of tInd
    for (size_t k = 0; k < transport.columns; ++k) expected += 0.5 * transport.basis[k * 100 + 30] / 256.0 * transport.codes[k * rows + splat];
    CHECK(asset->find("tInd")->values[75 * splat + 5] == doctest::Approx(expected).epsilon(1e-5));
    const float* n = &asset->find("lobe")->values[7 * splat];
    CHECK(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] == doctest::Approx(1));
}

TEST_CASE("the golden compact file still decodes")
{
    const auto asset = readAsset(kGoldenCompact);
    REQUIRE_MESSAGE(bool(asset), (asset ? "" : asset.error().message));
    Result<SplatAsset> expected = dequantise(makeQuantised(3, true));
    REQUIRE(bool(expected));
    expandChannels(*expected);
    CHECK(identical(*asset, *expected));
}

// Only for a new format version: test_formats --no-skip -tc="write the golden compact file"
TEST_CASE("write the golden compact file" * doctest::skip()) { REQUIRE(writeFileAtomically(kGoldenCompact, compactBytes(3, true))); }

TEST_CASE("a compact file cut anywhere is an error; a flipped byte gives an error or a valid asset")
{
    for (const bool sss : {false, true}) {
        const std::vector<std::byte> bytes = compactBytes(3, sss);
        for (size_t length = 0; length < bytes.size(); ++length) CHECK(!decodeAsset(std::span(bytes).first(length)));
        for (size_t i = 0; i < bytes.size(); ++i)
            for (const int mask : {0x01, 0x80, 0xff}) {
                std::vector<std::byte> flipped = bytes;
                flipped[i] ^= std::byte(mask);
                const auto asset = decodeAsset(flipped);
                if (asset) CHECK(bool(validate(*asset)));
                else CHECK(!asset.error().message.empty());
            }
    }
}

TEST_CASE("a compact file cannot ask for more splats than its bytes allow")
{
    GlbParts edited(compactBytes(3, false));
    edited.relight()["count"] = 9999999999ull;
    const auto asset = decodeAsset(edited.bytes());
    REQUIRE(!asset);
    CHECK(asset.error().message.find("9999999999 splats") != std::string::npos);
}

TEST_CASE("a block cannot ask for more columns than its numbers and bytes allow")
{
    GlbParts edited(compactBytes(300, false));
    for (nlohmann::json& block : edited.relight()["blocks"])
        if (block.contains("basis") && block["numbers"] == 100) block["columns"] = 8192;
    const auto asset = decodeAsset(edited.bytes());
    REQUIRE(!asset);
    CHECK(asset.error().message.find("8192 columns") != std::string::npos);
}

TEST_CASE("blocks that overlap, leave something out or do not fit are refused")
{
    const auto refused = [](auto&& change) {
        QuantisedAsset quantised = makeQuantised(3, false);
        change(quantised);
        return !encodeCompact(quantised);
    };
    CHECK(!refused([](QuantisedAsset&) {}));
    CHECK(refused([](QuantisedAsset& q) { q.blocks.pop_back(); }));
    CHECK(refused([](QuantisedAsset& q) { q.blocks.push_back(q.blocks.back()); }));
    CHECK(refused([](QuantisedAsset& q) { q.blocks[0].targets[0].name = "nosuch"; }));
    CHECK(refused([](QuantisedAsset& q) { q.blocks[0].targets[0].count = 4; }));
    CHECK(refused([](QuantisedAsset& q) { q.blocks[0].step[0] = NAN; }));
    CHECK(refused([](QuantisedAsset& q) { q.blocks[0].codes.pop_back(); }));
    CHECK(refused([](QuantisedAsset& q) { q.blocks[1].transform = BlockTransform::kLinear; }));
    CHECK(refused([](QuantisedAsset& q) { q.blocks[4].codes[0] = 128; })); // beyond a byte
    CHECK(refused([](QuantisedAsset& q) { q.blocks[4].scale[0] = 1e15f; })); // values beyond what a channel may hold
    CHECK(refused([](QuantisedAsset& q) { q.frame.drawnVisibility = 20; }));
}

// formats/SPEC.md, section 8, has this as an annotated dump.
TEST_CASE("the smallest compact file, byte by byte")
{
    QuantisedAsset q;
    q.frame.model = "sss", q.frame.cloud.count = 1;
    const auto add = [&](const char* name, uint32_t components, uint32_t numbers, BlockTransform transform, std::vector<int32_t> codes) {
        Block block;
        block.targets = {{name, 0, components}}, block.transform = transform, block.numbers = block.columns = numbers;
        block.offset.assign(numbers, 0.0f), block.step.assign(numbers, 0.5f), block.codes = std::move(codes);
        q.blocks.push_back(std::move(block));
    };
    for (const auto& [name, components] : {std::pair{"baseColor", 3u}, std::pair{"material", 2u}, std::pair{"normal", 3u}}) {
        Channel c;
        c.name = name, c.components = components;
        q.frame.channels.push_back(std::move(c));
    }
    add("OPACITY", 1, 1, BlockTransform::kLinear, {20});
    add("POSITION", 3, 3, BlockTransform::kLinear, {0, 0, 0});
    add("ROTATION", 4, 3, BlockTransform::kRotation, {0, 0, 0});
    add("SCALE", 3, 3, BlockTransform::kExp, {-2, -2, -2});
    add("baseColor", 3, 3, BlockTransform::kLinear, {1, 1, 1});
    add("material", 2, 2, BlockTransform::kLinear, {1, 0});
    add("normal", 3, 2, BlockTransform::kDirection, {0, 0});
    const auto bytes = encodeCompact(q);
    REQUIRE(bool(bytes));
    const GlbParts parts(*bytes);
    const std::vector<uint8_t> opacity = {
        0, 0, 0, 0,          // offset 0
        0, 0, 0, 0x3f,       // step 0.5
        0,                   // flags: the integer itself, one table
        0, 17, 0x80, 0x20,   // token 0 does not occur, nor do 17 more; token 18 always: 4096 as LEB128
        0, 0, 1, 0,          // the state of the one run: 2^16
        0,                   // no words
        1, 0x08,             // one byte of raw bits: 20 is 40 zigzagged, token 16 + 2 (5 - 4) + 0 and the four bits 1000
    };
    std::vector<uint8_t> start;
    for (const std::byte b : std::span(parts.bin).first(opacity.size())) start.push_back(uint8_t(b));
    CHECK(start == opacity);
    const auto asset = decodeAsset(*bytes);
    REQUIRE(bool(asset));
    CHECK(asset->cloud.opacities[0] == 1); // 10, held in [0, 1]
    CHECK(asset->cloud.scales[0].x == doctest::Approx(std::exp(-1)));
}
