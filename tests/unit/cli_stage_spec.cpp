#include "cli/stage_spec.h"

#include <doctest/doctest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <unistd.h>

using namespace nacre;
using namespace nacre::cli;

static bool mentions(const Error& error, const char* part) { return error.message.find(part) != std::string::npos; }

TEST_CASE("scattering texts: one number or three, names with colons, every property")
{
    const auto wax = parseSubsurface("Wax: old:albedo=0.8,0.6,0.5:mfp=0.004:g=-0.3:boundary=dielectric");
    REQUIRE(wax);
    CHECK(wax->material == "Wax: old");
    CHECK(wax->albedo == glm::vec3(0.8f, 0.6f, 0.5f));
    CHECK(wax->singleScatterAlbedo.x < 0);
    CHECK(wax->meanFreePath == glm::vec3(0.004f));
    CHECK(wax->anisotropy == -0.3f);
    CHECK(wax->boundary == SubsurfaceBoundary::kDielectric);
    const auto milk = parseSubsurface("#0:alpha=0.99:mfp=1,2,3");
    REQUIRE(milk);
    CHECK(milk->material == "#0");
    CHECK(milk->singleScatterAlbedo == glm::vec3(0.99f));
    CHECK(milk->albedo.x < 0);
    CHECK(milk->meanFreePath == glm::vec3(1, 2, 3));
    CHECK(milk->anisotropy == 0.0f);
    CHECK(milk->boundary == SubsurfaceBoundary::kDiffuse);
}

TEST_CASE("what is wrong with a scattering text is named")
{
    const std::pair<const char*, const char*> bad[] = {{"Wax", "albedo"}, {"Wax:albedo=0.5", "mfp"}, {"Wax:mfp=1", "albedo"}, {":albedo=1:mfp=1", "name"},
                                                       {"Wax:albedo=1:alpha=1:mfp=1", "one of"}, {"Wax:albedo=1.1:mfp=1", "albedo from 0 to 1"},
                                                       {"Wax:albedo=1:mfp=0", "mfp above 0"}, {"Wax:albedo=1:mfp=1,2", "mfp"}, {"Wax:albedo=1:mfp=inf", "mfp"},
                                                       {"Wax:albedo=1:mfp=1:g=1", "g from"}, {"Wax:albedo=1:mfp=1:boundary=rough", "boundary"},
                                                       {"Wax:albedo=1:mfp=1:tint=3", "tint"}, {"Wax:albedo=:mfp=1", "albedo"}, {"", "name"}};
    for (const auto& [text, word] : bad) {
        INFO(text);
        const auto parsed = parseSubsurface(text);
        REQUIRE_FALSE(parsed);
        CHECK(parsed.error().code == ErrorCode::kBadInput);
        CHECK(mentions(parsed.error(), word));
    }
}

TEST_CASE("the text of an override and of fur parses to the same settings")
{
    for (const char* text : {"Wax:x:albedo=0.8,0.6,0.123456789:mfp=0.004:g=-0.3:boundary=none", "*:alpha=0.1:mfp=1e-5,2,3"}) {
        const auto a = parseSubsurface(text);
        REQUIRE(a);
        const auto b = parseSubsurface(textOf(*a));
        REQUIRE(b);
        CHECK(textOf(*a) == textOf(*b));
        CHECK(a->albedo == b->albedo);
        CHECK(a->singleScatterAlbedo == b->singleScatterAlbedo);
        CHECK(a->meanFreePath == b->meanFreePath);
        CHECK(a->boundary == b->boundary);
    }
    const auto fur = parseFur("20000,0.03,1e-4:material=Hide: back:lean=0.25:tip=0");
    REQUIRE(fur);
    CHECK(fur->density == 20000.0f);
    CHECK(fur->length == 0.03f);
    CHECK(fur->radius == 1e-4f);
    CHECK(fur->material == "Hide: back");
    CHECK(fur->lean == 0.25f);
    CHECK(fur->tipRadius == 0.0f);
    CHECK(fur->clump == FurSettings().clump);
    const auto again = parseFur(textOf(*fur));
    REQUIRE(again);
    CHECK(textOf(*again) == textOf(*fur));
    for (const char* bad : {"", "1", "1,2", "1,2,3,4", "0,1,1", "1,1,nan", "1,1,1:lean=1.1", "1,1,1:lean=", "1,1,1:curl=0.5", "1,1,1:material="})
        CHECK_MESSAGE(!parseFur(bad), bad);
}

TEST_CASE("a scattering file says the same as texts; mistakes are located")
{
    const std::string path = (std::filesystem::temp_directory_path() / ("nacre-sss-" + std::to_string(getpid()) + ".json")).string();
    const auto read = [&](const std::string& text) {
        std::ofstream(path) << text;
        return readSubsurfaceFile(path);
    };
    const auto two = read(R"([{"material": "Wax", "albedo": [0.8, 0.6, 0.5], "mfp": 0.004, "g": 0.5, "boundary": "none"}, {"material": "*", "alpha": 0.9, "mfp": [1, 2, 3]}])");
    REQUIRE(two);
    REQUIRE(two->size() == 2);
    CHECK(textOf((*two)[0]) == textOf(*parseSubsurface("Wax:albedo=0.8,0.6,0.5:mfp=0.004:g=0.5:boundary=none")));
    CHECK(textOf((*two)[1]) == textOf(*parseSubsurface("*:alpha=0.9:mfp=1,2,3")));
    CHECK(read(R"({"material": "Wax", "albedo": 1, "mfp": 1})")->size() == 1);
    const std::pair<const char*, const char*> bad[] = {{"[]", "no materials"}, {"[", "JSON"}, {R"([{"albedo": 1, "mfp": 1}])", "material"},
                                                       {R"([{"material": "a", "albedo": 1}])", "mfp"}, {R"([{"material": "a", "mfp": 1}])", "albedo"},
                                                       {R"([{"material": "a", "albedo": [1, 2], "mfp": 1}])", "[0].albedo"},
                                                       {R"([{"material": "a", "albedo": 2, "mfp": 1}])", "from 0 to 1"},
                                                       {R"([{"material": "a", "albedo": 1, "mfp": 1, "boundary": "x"}])", "boundary"}};
    for (const auto& [text, word] : bad) {
        const auto parsed = read(text);
        INFO(text);
        REQUIRE_FALSE(parsed);
        INFO(parsed.error().message);
        CHECK(mentions(parsed.error(), word));
    }
    std::filesystem::remove(path);
    CHECK_FALSE(readSubsurfaceFile(path));
}

TEST_CASE("an override must name a material of the mesh, and the message lists them")
{
    MeshScene mesh;
    mesh.materials.resize(2);
    mesh.materials[0].name = "Wax";
    SubsurfaceOverride o;
    for (const char* name : {"Wax", "#0", "#1", "*"}) {
        o.material = name;
        CHECK(checkMaterial(o, mesh));
    }
    for (const char* name : {"wax", "#2", "0"}) {
        o.material = name;
        const Status status = checkMaterial(o, mesh);
        REQUIRE_FALSE(status);
        CHECK(mentions(status.error(), "#0 'Wax', #1"));
    }
}

TEST_CASE("sizes, samples, lights per camera and shards")
{
    CHECK(parseStageSize("256")->width == 256);
    CHECK(parseStageSize("256")->height == 256);
    CHECK(parseStageSize("640x480")->height == 480);
    for (const char* bad : {"", "0", "9000", "256x", "x256", "25 6", "-5", "1x2x3", "99999999999"}) CHECK_MESSAGE(!parseStageSize(bad), bad);
    CHECK(*parseTestSamples("256", 64) == 256);
    CHECK(*parseTestSamples("4x", 64) == 256);
    CHECK(*parseTestSamples("0.3x", 64) == 20);
    for (const char* bad : {"", "x", "0", "0x", "-1x", "1.5", "4xx", "nan", "1e9"}) CHECK_MESSAGE(!parseTestSamples(bad, 64), bad);
    CHECK(*parseLightsPerCamera("all") == 0);
    CHECK(*parseLightsPerCamera("7") == 7);
    for (const char* bad : {"", "0", "-1", "2.5", "All", "nan"}) CHECK_MESSAGE(!parseLightsPerCamera(bad), bad);
    CHECK(parseShard("2/8")->index == 2);
    CHECK(parseShard("2/8")->count == 8);
    for (const char* bad : {"", "1", "0/8", "9/8", "1/0", "1/2/3", "a/b", "1/2 "}) CHECK_MESSAGE(!parseShard(bad), bad);
}
