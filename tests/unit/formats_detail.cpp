// Less of an asset: which splats stay and what becomes of them, parts left out, and presets in files of every profile.
#include "detail_fixtures.h"
#include "formats_fixtures.h"

#include "appearance/coded_channels.h"
#include "appearance/detail.h"
#include "splats/reorder.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <tuple>

using namespace nacre;
using namespace nacre::test;

namespace {

/// Three clusters of very different density.
SplatAsset clustered(size_t count, float spread, uint32_t seed = 3)
{
    SplatAsset asset = makeAsset(count, 0, 0);
    std::mt19937 rng(seed);
    std::normal_distribution<float> normal;
    for (size_t i = 0; i < count; ++i) {
        const float size = i % 4 == 0 ? 1.0f : i % 4 == 1 ? 0.3f : 0.05f;
        asset.cloud.positions[i] = glm::vec3(i % 4, i % 4 == 1, 0) + size * glm::vec3(normal(rng), normal(rng), normal(rng));
    }
    return withOrder(std::move(asset), 0.25f, spread, seed);
}

void reduce(SplatAsset& asset, const Detail& detail)
{
    const Status s = reduceDetail(asset, detail);
    REQUIRE_MESSAGE(bool(s), (s ? "" : s.error().message));
}

SplatAsset reduced(SplatAsset asset, const Detail& detail)
{
    reduce(asset, detail);
    return asset;
}

using Point = std::tuple<float, float, float>;
std::set<Point> pointsOf(const SplatAsset& asset)
{
    std::set<Point> points;
    for (const glm::vec3& p : asset.cloud.positions) points.insert({p.x, p.y, p.z});
    return points;
}

std::set<std::string> namesOf(const SplatAsset& asset)
{
    std::set<std::string> names;
    for (const Channel& c : asset.channels) names.insert(c.name);
    return names;
}

std::string refusal(const Status& status) { return status ? "" : status.error().message; }

} // namespace

TEST_CASE("the order of importance names each splat once, and each share is part of every larger one")
{
    for (const size_t count : {1, 2, 3, 100, 5000}) {
        const SplatAsset asset = clustered(count, 10);
        std::vector<uint32_t> order = orderOfImportance(asset);
        std::sort(order.begin(), order.end());
        std::vector<uint32_t> all(count);
        std::iota(all.begin(), all.end(), 0u);
        CHECK(order == all);
        std::set<Point> larger = pointsOf(asset);
        for (const float share : {0.9f, 0.5f, 0.2f, 0.01f}) {
            const SplatAsset less = reduced(asset, {share});
            CHECK(less.cloud.count == std::max<size_t>(1, size_t(std::llround(double(share) * double(count)))));
            const std::set<Point> points = pointsOf(less);
            CHECK(std::includes(larger.begin(), larger.end(), points.begin(), points.end()));
            larger = points;
        }
    }
}

TEST_CASE("every place keeps its share of splats that are equally important, however dense it is")
{
    const SplatAsset asset = clustered(20000, 0);
    glm::vec3 low = asset.cloud.positions[0], high = low;
    for (const glm::vec3& p : asset.cloud.positions) low = glm::min(low, p), high = glm::max(high, p);
    const std::vector<uint32_t> order = orderOfImportance(asset);
    for (const float share : {0.5f, 0.25f, 0.05f})
        for (const int cells : {4, 8, 16}) {
            std::map<int, std::pair<size_t, size_t>> ofCell; // kept, all
            for (size_t k = 0; k < order.size(); ++k) {
                const glm::ivec3 c = glm::min(glm::ivec3(float(cells) * (asset.cloud.positions[order[k]] - low) / (high - low)), cells - 1);
                auto& [kept, all] = ofCell[(c.z * cells + c.y) * cells + c.x];
                kept += float(k) < share * float(order.size()), ++all;
            }
            double most = 0; // that a cell is off, in splats: what chance leaves to dense cells is 50
            for (const auto& [cell, n] : ofCell) most = std::max(most, std::abs(double(n.first) - double(share) * double(n.second)));
            CHECK(most < 8);
        }
}

TEST_CASE("splats that show more stay more often, and rare ones are not all lost")
{
    SplatAsset asset = clustered(8000, 0);
    for (Channel& c : asset.channels)
        for (size_t i = 0; i < c.values.size() && c.name == "importance"; ++i) c.values[i] = i / 4 % 2 ? -10.0f : 0.0f; // half of each cluster
    const std::vector<uint32_t> order = orderOfImportance(asset);
    const auto important = std::count_if(order.begin(), order.begin() + 2000, [](uint32_t i) { return i / 4 % 2 == 0; });
    CHECK(important > 1500);
    CHECK(important < 2000);
}

TEST_CASE("the order does not depend on how splats are stored")
{
    const SplatAsset asset = clustered(3000, 10);
    SplatAsset shuffled = asset;
    std::vector<uint32_t> moved(asset.cloud.count);
    std::iota(moved.begin(), moved.end(), 0u);
    std::shuffle(moved.begin(), moved.end(), std::mt19937(5));
    reorderSplats(shuffled, moved);
    const std::vector<uint32_t> a = orderOfImportance(asset), b = orderOfImportance(shuffled);
    bool same = true;
    for (size_t k = 0; k < a.size(); ++k) same &= asset.cloud.positions[a[k]] == shuffled.cloud.positions[b[k]];
    CHECK(same);
}

TEST_CASE("all of everything changes no byte")
{
    for (const bool sss : {false, true}) {
        const SplatAsset asset = withOrder(sss ? makeSss(50, true) : makeAsset(50, 4, 4, true));
        const auto before = encodeAsset(asset);
        REQUIRE(before);
        for (const Detail& all : {Detail{}, Detail{1, 0, 25, 32}, Detail{0.999f}}) CHECK(*encodeAsset(reduced(asset, all)) == *before);
        CHECK(*encodeAsset(reduced(makeAsset(50, 4, 4), {})) == *encodeAsset(makeAsset(50, 4, 4))); // without an order, too
    }
}

TEST_CASE("the smallest shares keep one splat, which has the mean of all and stays within bounds")
{
    for (const float share : {0.001f, 1e-30f, 1e-45f}) {
        SplatAsset asset = withOrder(makeAsset(200, 1, 4), 1, 3);
        asset.cloud.scales[7] = glm::vec3(1e15f);
        const SplatAsset one = reduced(asset, {share});
        CHECK(one.cloud.count == 1);
        CHECK(refusal(validate(one)) == "");
        double sum = 0, weights = 0;
        for (size_t i = 0; i < 200; ++i) {
            const double w = std::exp2(double(asset.find("importance")->values[i]));
            sum += w * double(asset.find("tInd")->values[75 * i + 40]), weights += w;
        }
        CHECK(double(one.find("tInd")->values[40]) == doctest::Approx(sum / weights).epsilon(1e-5));
        CHECK(glm::all(glm::greaterThan(one.cloud.scales[0], glm::vec3(0))));
    }
}

TEST_CASE("splats that are alike look alike when there are fewer; unit normals stay so")
{
    SplatAsset asset = withOrder(makeSss(300, true));
    for (Channel& c : asset.channels)
        for (size_t i = 0; i < c.values.size() && !c.perAsset && c.name != "importance"; ++i) c.values[i] = c.values[i % c.components];
    for (const float share : {0.9f, 0.25f, 0.01f}) {
        const SplatAsset less = reduced(asset, {share});
        for (const Channel& c : less.channels)
            for (size_t i = 0; i < c.values.size() && c.name != "importance"; ++i) REQUIRE(std::abs(c.values[i] - asset.find(c.name.c_str())->values[i % c.components]) < 1e-6f);
    }
    SplatAsset turned = withOrder(makeSss(300, false));
    std::mt19937 rng(2);
    std::normal_distribution<float> normal;
    for (Channel& c : turned.channels)
        for (size_t i = 0; i < 300 && c.name == "normal"; ++i) {
            const glm::vec3 n = glm::normalize(glm::vec3(normal(rng), normal(rng), normal(rng)));
            std::copy_n(&n.x, 3, &c.values[3 * i]);
        }
    reduce(turned, {0.1f});
    for (size_t i = 0; i < turned.cloud.count; ++i) {
        const float* n = &turned.find("normal")->values[3 * i];
        CHECK(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] == doctest::Approx(1).epsilon(1e-5));
    }
}

TEST_CASE("splats that stay grow over those that go, the more the fewer stay")
{
    const SplatAsset asset = withOrder(makeAsset(400, 0, 0), 0.3f);
    const auto area = [](const SplatAsset& a) {
        double sum = 0;
        for (size_t i = 0; i < a.cloud.count; ++i) sum += double(a.cloud.scales[i].y) / 0.25;
        return sum / double(a.cloud.count);
    };
    const double half = area(reduced(asset, {0.5f})), tenth = area(reduced(asset, {0.1f}));
    CHECK(half > 1.0);
    CHECK(half < 1.5);
    CHECK(tenth > 1.3 * half);
    CHECK(tenth < 3.0);
    for (const float o : reduced(asset, {0.5f}).cloud.opacities) CHECK((o >= 0 && o <= 1));

    SplatAsset nearly = withOrder(makeAsset(1000, 0, 0), 0.3f); // one less changes next to nothing of the others
    for (size_t i = 0; i < 1000; ++i) nearly.cloud.positions[i] = glm::vec3(i, i * 7 % 1000, i * 11 % 1000);
    const SplatAsset whole = nearly;
    reduce(nearly, {0.999f});
    REQUIRE(nearly.cloud.count == 999);
    size_t changed = 0, k = 0;
    for (size_t i = 0; i < 999; ++i, ++k) {
        if (nearly.cloud.positions[i] != whole.cloud.positions[k]) ++k;
        const float grown = nearly.cloud.scales[i].y / whole.cloud.scales[k].y, thicker = nearly.cloud.opacities[i] - whole.cloud.opacities[k];
        changed += std::abs(grown - 1) > 1e-3f || std::abs(thicker) > 1e-3f;
    }
    CHECK(changed == 1);
}

TEST_CASE("parts that are named go, and nothing else does")
{
    const std::map<uint32_t, std::set<std::string>> channels = {{kPartVisibility, {"visibility", "shadow"}}, {kPartLobe, {"lobe"}}, {kPartForward, {"forward"}},
                                                                {kPartScatter, {"s"}}, {kPartIndirect, {}}, {kPartNetwork, {"network", "code", "codeWeights"}}};
    for (const bool sss : {false, true}) {
        SplatAsset asset = withOrder(sss ? makeSss(20, true) : makeAsset(20, 4, 4, true));
        if (!sss) asset.channels.push_back({"forward", 4, std::vector<float>(80, 0.5f)});
        for (uint32_t parts = 0; parts <= kAllDetailParts; ++parts) {
            const SplatAsset less = reduced(asset, {1, parts});
            std::set<std::string> expected = namesOf(asset);
            for (const auto& [part, names] : channels)
                for (const std::string& name : names)
                    if (parts & part) expected.erase(name);
            REQUIRE(namesOf(less) == expected);
            REQUIRE(refusal(validate(less)) == "");
            for (const Channel& c : less.channels) {
                const Channel& before = *asset.find(c.name.c_str());
                const bool dark = c.name == "tInd" && (parts & kPartIndirect);
                REQUIRE(c.values == (dark ? std::vector<float>(c.values.size(), 0.0f) : before.values));
                REQUIRE(c.bytes == before.bytes);
            }
        }
    }
    SplatAsset drawn = makeAsset(5, 0, 0);
    drawn.drawnVisibility = 32;
    CHECK(reduced(drawn, {1, kPartVisibility}).drawnVisibility == 0);
    CHECK(reduced(drawn, {1, 0, 0, 16}).drawnVisibility == 16);
    CHECK(reduced(drawn, {1, 0, 0, 32}).drawnVisibility == 32);
}

TEST_CASE("parts and splats may go in one step or in two")
{
    const SplatAsset asset = withOrder(makeAsset(300, 4, 4, true));
    const Detail both{0.3f, kPartLobe | kPartScatter, 4, 16};
    CHECK(identical(reduced(asset, both), reduced(reduced(asset, {0.3f}), {1, kPartLobe | kPartScatter, 4, 16})));
}

TEST_CASE("smaller visibility maps are means of four texels")
{
    SplatAsset asset = makeAsset(7, 0, 0);
    Channel maps{"visibility", 1024};
    std::mt19937 rng(4);
    for (size_t i = 0; i < 7 * 1024; ++i) maps.bytes.push_back(uint8_t(rng() >> 24));
    asset.channels.push_back(maps);
    const SplatAsset less = reduced(asset, {1, 0, 0, 16});
    const Channel& small = *less.find("visibility");
    REQUIRE(small.components == 256);
    REQUIRE(refusal(validate(less)) == "");
    for (size_t g = 0; g < 7; ++g)
        for (size_t j = 0; j < 16; ++j)
            for (size_t i = 0; i < 16; ++i) {
                double sum = 0;
                for (const size_t k : {0, 1, 32, 33}) sum += maps.bytes[1024 * g + 64 * j + 2 * i + k];
                REQUIRE(std::abs(small.bytes[256 * g + 16 * j + i] - sum / 4) <= 0.5);
            }
    CHECK(identical(reduced(less, {1, 0, 0, 16}), less));
}

TEST_CASE("functions beyond the limit are zero, and only those")
{
    const SplatAsset asset = makeAsset(30, 4, 4);
    for (const uint32_t functions : {1, 4, 9, 16, 25}) {
        const SplatAsset less = reduced(asset, {1, 0, functions});
        CHECK(less.find("s")->values == asset.find("s")->values);
        for (const auto& [name, each] : {std::pair("tDir", 1u), std::pair("tInd", 3u)})
            for (size_t k = 0; k < less.find(name)->values.size(); ++k)
                REQUIRE(less.find(name)->values[k] == (k % (25 * each) / each < functions ? asset.find(name)->values[k] : 0.0f));
    }
}

TEST_CASE("of splats of which only the first have rows of a channel, any share is a valid asset")
{
    for (const size_t leading : {1, 3, 150, 297, 299})
        for (const float share : {0.9f, 0.5f, 0.1f, 0.01f, 0.001f}) {
            CAPTURE(leading);
            CAPTURE(share);
            SplatAsset asset = withOrder(makeLeading(300, leading, 4, true));
            for (size_t i = 0; i < 300; ++i) asset.cloud.positions[i] = glm::vec3(i, i * 7 % 300, i * 11 % 300); // no two at one place
            const SplatAsset less = reduced(asset, {share});
            REQUIRE(refusal(validate(less)) == "");
            const std::set<Point> points = pointsOf(less);
            size_t rows = 0;
            for (size_t i = 0; i < leading; ++i) rows += points.contains({asset.cloud.positions[i].x, asset.cloud.positions[i].y, asset.cloud.positions[i].z});
            const Channel* s = less.find("s");
            CHECK((s ? s->rows(less.cloud.count) : 0) == rows);
        }
}

TEST_CASE("whatever is asked of whatever asset, what comes out is valid or the message says why not")
{
    std::mt19937 rng(9);
    const auto pick = [&](auto... values) {
        const std::common_type_t<decltype(values)...> all[] = {values...};
        return all[rng() % std::size(all)];
    };
    for (int i = 0; i < 400; ++i) {
        const size_t count = pick(1, 2, 3, 17, 200);
        SplatAsset asset = rng() % 2 ? makeSss(count, rng() % 2) : count > 2 && rng() % 2 ? makeLeading(count, 1 + rng() % (count - 1), pick(1, 4), rng() % 2) : makeAsset(count, pick(0, 1, 9), 4, rng() % 2);
        asset = withOrder(std::move(asset), pick(0.0f, 0.3f, 1.0f), pick(0.0f, 10.0f, 1e15f), rng());
        const int shape = int(rng() % 4);
        for (glm::vec3& p : asset.cloud.positions) p = shape == 0 ? glm::vec3(1) : shape == 1 ? glm::vec3(p.x, 0, 0) : shape == 2 ? 1e15f * glm::sign(p) : p;
        for (Channel& c : asset.channels) // normals, materials and networks have bounds of their own
            for (float& x : c.values)
                if (rng() % 8 == 0 && (c.name == "tDir" || c.name == "tInd" || c.name == "lobe" || c.name == "importance")) x = pick(0.0f, -1e15f, 1e15f, 1e-40f);
        for (size_t k = 0; k < count; ++k) {
            if (rng() % 8 == 0) asset.cloud.scales[k] = glm::vec3(pick(1e15f, 1e-45f));
            if (rng() % 8 == 0) asset.cloud.opacities[k] = pick(0.0f, 1.0f);
        }
        REQUIRE(refusal(validate(asset)) == "");
        const Detail detail{pick(1.0f, 0.5f, 0.1f, 1e-38f, 0.0f, NAN), uint32_t(rng() % 66), uint32_t(pick(0, 1, 4, 9, 16, 25, 5)), uint32_t(pick(0, 16, 32, 8))};
        const Status s = reduceDetail(asset, detail);
        CHECK(bool(s) == bool(checkDetail(detail)));
        CHECK(refusal(validate(asset)) == "");
    }
}

TEST_CASE("splats all at one place, or around one, are reduced in no time")
{
    SplatAsset asset = makeAsset(60000, 0, 0);
    for (Channel& c : asset.channels) c.values.assign(c.values.size(), 0.5f);
    for (size_t i = 0; i < asset.cloud.count; ++i) asset.cloud.positions[i] = glm::vec3(i % 3, 0, 0);
    asset = withOrder(std::move(asset));
    CHECK(reduced(asset, {0.5f}).cloud.count == 30000);
    for (Channel& c : asset.channels)
        for (size_t i = 0; i < c.values.size() && c.name == "importance"; ++i) {
            const float a = float(i), z = float(i) / 30000 - 1; // the less important half in the centre of a sphere of the others
            asset.cloud.positions[i] = i % 2 ? glm::vec3(0) : glm::vec3(std::sqrt(1 - z * z) * std::cos(a), std::sqrt(1 - z * z) * std::sin(a), z);
            c.values[i] = i % 2 ? -90.0f : 0.0f;
        }
    CHECK(reduced(asset, {0.5f}).cloud.count == 30000);
}

TEST_CASE("fewer splats need an order of importance, whose channels come together and within bounds")
{
    SplatAsset asset = makeAsset(10, 0, 0);
    CHECK(refusal(reduceDetail(asset, {0.5f})).find("nacre pack") != std::string::npos);
    CHECK(identical(asset, makeAsset(10, 0, 0)));
    const SplatAsset whole = withOrder(asset);
    for (const char* name : {"importance", "growth"}) {
        SplatAsset half = whole;
        std::erase_if(half.channels, [&](const Channel& c) { return c.name == name; });
        CHECK(refusal(validate(half)).find(name) != std::string::npos);
        CHECK(!encodeAsset(half));
    }
    for (const float growth : {-0.1f, 1.1f, NAN}) CHECK(refusal(validate(withOrder(asset, growth))).find("growth") != std::string::npos);
}

TEST_CASE("details say what they are, and what is wrong with them")
{
    CHECK(detailText({}) == "everything");
    CHECK(detailText({0.35f, kPartLobe, 9}) == "35 % of the splats, no lobe, 9 transport functions");
    CHECK(detailText({0.025f, kPartVisibility | kPartNetwork, 25, 16}) == "2.5 % of the splats, no visibility, no network, visibility maps of 16 x 16");
    for (const float share : {0.0f, -1.0f, 1.0001f, NAN, INFINITY}) CHECK(refusal(checkDetail({share})).find("share of splats") != std::string::npos);
    CHECK(refusal(checkDetail({1, 64})).find("64") != std::string::npos);
    for (const uint32_t f : {2u, 8u, 26u, ~0u}) CHECK(refusal(checkDetail({1, 0, f})).find(std::to_string(f)) != std::string::npos);
    for (const uint32_t v : {1u, 8u, 31u, ~0u}) CHECK(refusal(checkDetail({1, 0, 0, v})).find(std::to_string(v)) != std::string::npos);
}

TEST_CASE("presets and the order of importance come back from files of every profile")
{
    for (const bool sss : {false, true}) {
        SplatAsset asset = withOrder(sss ? makeSss(9, true) : makeAsset(9, 4, 4, true));
        asset.presets = somePresets();
        const auto lossless = encodeAsset(asset), interop = encodeInterop(asset);
        REQUIRE(lossless);
        REQUIRE_MESSAGE(bool(interop), (interop ? "" : interop.error().message));
        QuantisedAsset q = makeQuantised(9, sss);
        q.frame.presets = asset.presets;
        q.frame.channels.push_back({"importance", 1}), q.frame.channels.push_back({"growth", 1, {}, {}, true});
        const auto block = [&](const char* name, std::vector<int32_t> codes) {
            Block b;
            b.targets = {{name, 0, 1}}, b.numbers = b.columns = 1, b.offset = {0.0f}, b.step = {0.25f}, b.codes = std::move(codes);
            q.blocks.push_back(std::move(b));
        };
        block("importance", {0, -1, -2, -3, -4, -5, -6, -7, -8}), block("growth", {1});
        const auto compact = encodeCompact(q);
        REQUIRE_MESSAGE(bool(compact), (compact ? "" : compact.error().message));
        for (const auto* file : {&*lossless, &*interop, &*compact}) {
            Result<SplatAsset> read = decodeAsset(*file);
            REQUIRE_MESSAGE(bool(read), (read ? "" : read.error().message));
            CHECK(read->presets == asset.presets);
            expandChannels(*read);
            CHECK(read->find("growth")->values == std::vector<float>{0.25f});
            if (file != &*compact) CHECK(read->find("importance")->values == asset.find("importance")->values);
            else CHECK(read->find("importance")->values[8] == -2.0f);
            CHECK(orderOfImportance(*read).size() == 9);
        }
    }
}

TEST_CASE("presets are put into a file of which nothing else changes")
{
    const SplatAsset asset = makeAsset(9, 4, 4, true);
    const auto lossless = encodeAsset(asset), interop = encodeInterop(asset), compact = encodeCompact(makeQuantised(9, false));
    for (const auto* file : {&*lossless, &*interop, &*compact}) {
        const auto with = withPresets(*file, somePresets());
        REQUIRE_MESSAGE(bool(with), (with ? "" : with.error().message));
        CHECK(decodeAsset(*with)->presets == somePresets());
        GlbParts before(*file), after(*with);
        CHECK(before.bin == after.bin);
        after.relight().erase("presets");
        CHECK(before.json == after.json);
        CHECK(GlbParts(*withPresets(*with, {})).json == before.json); // and taken out
        CHECK(decodeAsset(*withPresets(*with, std::vector{preset("one")}))->presets == std::vector{preset("one")});
        CHECK(!withPresets(*with, std::vector{preset("a b")}));
        CHECK(!withPresets(std::span(*file).first(file->size() / 2), somePresets()));
        std::vector<Preset> odd = somePresets();
        odd[1].measuredOn = std::string(1, char(0xff));
        CHECK(!withPresets(*file, odd));
        for (const char* other : {"7", "null", "[]", "{}", "{\"primitives\": 7}", "{\"primitives\": [7, null, {\"extensions\": 7}]}"}) { // somebody else's, which readers skip
            GlbParts more(*file);
            more.json["meshes"].push_back(nlohmann::json::parse(other));
            const auto added = withPresets(more.bytes(), somePresets());
            REQUIRE_MESSAGE(bool(added), (added ? "" : added.error().message));
            CHECK(GlbParts(*added).json["meshes"][1] == more.json["meshes"][1]);
        }
    }
}

TEST_CASE("presets that make no sense are refused before they are written")
{
    const auto refused = [](const std::vector<Preset>& presets) {
        SplatAsset asset = makeAsset(3, 0, 0);
        asset.presets = presets;
        CHECK(!encodeAsset(asset));
        QuantisedAsset q = makeQuantised(3, false);
        q.frame.presets = presets;
        CHECK(!encodeCompact(q));
        return refusal(validate(asset));
    };
    const auto with = [](auto change) {
        Preset p = preset("fast");
        change(p);
        return std::vector<Preset>{p};
    };
    for (const char* name : {"", "a b", "line\nbreak", "caf\xc3\xa9", "\xff", "\x1b[31m", "12345678901234567890123456789012"})
        CHECK(refused(with([&](Preset& p) { p.name = name; })).find("name of a preset") != std::string::npos);
    CHECK(refused({preset("a"), preset("b"), preset("a")}).find("twice") != std::string::npos);
    std::vector<Preset> many;
    for (int i = 10; i < 75; ++i) many.push_back(preset(std::to_string(i)));
    CHECK(refused(many).find("65") != std::string::npos);
    many.pop_back();
    SplatAsset most = makeAsset(3, 0, 0);
    most.presets = many;
    CHECK(decodeAsset(*encodeAsset(most))->presets == many);
    CHECK(refused(with([](Preset& p) { p.detail.splats = 2; })).find("'fast'") != std::string::npos);
    CHECK(refused(with([](Preset& p) { p.detail.leaveOut = 64; })).find("'fast'") != std::string::npos);
    for (const float scale : {0.0f, 1.5f, NAN}) CHECK(refused(with([&](Preset& p) { p.resolutionScale = scale; })).find("resolution") != std::string::npos);
    CHECK(refused(with([](Preset& p) { p.environmentDirections = 1025; })).find("1024") != std::string::npos);
    CHECK(refused(with([](Preset& p) { p.milliseconds = INFINITY; })).find("finite") != std::string::npos);
    CHECK(refused(with([](Preset& p) { p.psnrMasked = NAN; })).find("finite") != std::string::npos);
    SplatAsset odd = makeAsset(3, 0, 0);
    odd.presets = with([](Preset& p) { p.measuredOn = "\xff\xfe"; });
    CHECK(!encodeAsset(odd));
}

TEST_CASE("hostile presets of a file end in one line that names them")
{
    SplatAsset asset = withOrder(makeAsset(3, 0, 0));
    asset.presets = somePresets();
    const auto file = encodeAsset(asset);
    REQUIRE(file);
    const auto message = [&](auto change) {
        GlbParts parts(*file);
        change(parts.relight()["presets"]);
        const Result<SplatAsset> read = decodeAsset(parts.bytes());
        REQUIRE(!read);
        CHECK(read.error().code == ErrorCode::kBadInput);
        CHECK(read.error().message.find("preset") != std::string::npos);
        CHECK(read.error().message.find('\n') == std::string::npos);
        return read.error().message;
    };
    using Json = nlohmann::json;
    for (const Json& value : {Json(1), Json("fast"), Json(nullptr), Json::object()}) message([&](Json& p) { p = value; });
    for (const Json& value : {Json(1), Json("fast"), Json(nullptr), Json::array(), Json::object()}) CHECK(message([&](Json& p) { p[1] = value; }).find("presets[1]") != std::string::npos);
    for (const char* key : {"splats", "leaveOut", "transportFunctions", "visibilitySize", "resolutionScale", "environmentDirections", "milliseconds", "psnrMasked", "measuredOn", "name"})
        for (const Json& value : {Json(nullptr), Json(true), Json::object(), Json::array({1}), Json(std::string(key) == "name" || std::string(key) == "measuredOn" ? Json(1) : Json("1"))})
            CHECK(message([&](Json& p) { p[0][key] = value; }).find(std::string("presets[0].") + key) != std::string::npos);
    for (const double share : {0.0, -1.0, 1.5, 1e300, 1e-300}) message([&](Json& p) { p[0]["splats"] = share; });
    for (const Json& number : {Json(-9), Json(9.5), Json(5), Json(size_t(1) << 40), Json(1e300)}) message([&](Json& p) { p[0]["transportFunctions"] = number; });
    for (const char* name : {"", "a b", "caf\xc3\xa9", "all", "12345678901234567890123456789012"}) message([&](Json& p) { p[0]["name"] = name; });
    message([](Json& p) { p[0]["name"] = std::string(100000, 'x'); });
    message([](Json& p) { while (p.size() < 65) p.push_back({{"name", std::to_string(p.size())}}); });

    GlbParts later(*file); // of a newer version
    later.relight()["presets"][0]["leaveOut"].push_back("fog"), later.relight()["presets"][0]["fog"] = 3;
    CHECK(decodeAsset(later.bytes())->presets == asset.presets);
    const std::string text = GlbParts(*file).json.dump();
    for (size_t length = 0; length < text.size(); length += 7) CHECK(!decodeAsset(GlbParts::assemble(text.substr(0, length), GlbParts(*file).bin)));
}
