// 3DGS .ply and plain KHR_gaussian_splatting files: what is written reads back, in every layout; what is wrong is refused in one line.
#include "plain_splats_fixtures.h"

#include "base/spherical_harmonics.h"
#include "interchange/ply.h"
#include "interchange/rotate_splats.h"
#include "interchange/splat_glb.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

using namespace nacre;
using namespace nacre::test;

namespace {

void checkSame(const PlainSplats& a, const PlainSplats& b, float tolerance)
{
    REQUIRE(a.cloud.count == b.cloud.count);
    REQUIRE(a.look.shFunctions == b.look.shFunctions);
    for (size_t i = 0; i < a.cloud.count; ++i) {
        CHECK(glm::length(a.cloud.positions[i] - b.cloud.positions[i]) <= tolerance);
        CHECK(glm::length(a.cloud.scales[i] / b.cloud.scales[i] - 1.0f) <= 1e-5f); // through a logarithm in float32
        CHECK(std::abs(a.cloud.opacities[i] - b.cloud.opacities[i]) <= 1e-6f);
        CHECK(std::abs(glm::dot(a.cloud.rotations[i], b.cloud.rotations[i])) > 1 - 1e-6f);
    }
    for (size_t k = 0; k < a.look.sh.size(); ++k) CHECK(glm::length(a.look.sh[k] - b.look.sh[k]) <= tolerance);
}

PlainSplats decoded(const std::vector<std::byte>& bytes)
{
    const auto file = decodePly(bytes);
    REQUIRE_MESSAGE(file, (file ? "" : file.error().message));
    CHECK(file->warnings.empty());
    return file->splats;
}

void checkRefused(const std::vector<std::byte>& bytes, const std::string& part)
{
    const auto file = decodePly(bytes);
    REQUIRE(!file);
    CHECK_MESSAGE(file.error().message.find(part) != std::string::npos, file.error().message);
    CHECK(file.error().message.find('\n') == std::string::npos);
}

} // namespace

TEST_CASE("a .ply reads back as it was written, at every degree")
{
    for (int functions : {1, 4, 9, 16}) {
        const PlainSplats splats = makePlainSplats(5, functions);
        checkSame(splats, decoded(encodePly(splats)), 0);
    }
}

TEST_CASE("a .ply means the same in either byte order and as text, with its properties in any order and of any type, and others between")
{
    const PlainSplats splats = makePlainSplats(4, 9);
    for (const char* format : {"binary_little_endian", "binary_big_endian", "ascii"})
        for (const char* type : {"float", "double", "float64"})
            for (unsigned shuffle : {0u, 1u, 7u}) {
                CAPTURE(format);
                CAPTURE(type);
                CAPTURE(shuffle);
                checkSame(splats, decoded(writePly(splats, {format, type, shuffle})), 1e-6f);
            }
}

TEST_CASE("elements before the splats are skipped, and what follows them is not read")
{
    const PlainSplats splats = makePlainSplats(3, 4);
    for (const char* format : {"binary_little_endian", "ascii"}) {
        PlyLayout layout{format, "float", 0};
        layout.before = layout.after = true;
        checkSame(splats, decoded(writePly(splats, layout)), 1e-6f);
    }
}

TEST_CASE("every beginning of a .ply is refused")
{
    for (const char* format : {"binary_little_endian", "ascii"}) {
        const auto whole = writePly(makePlainSplats(2, 4), {format, "float", 3});
        // The end of a text is where its last number ends; a shorter one is another number.
        const size_t complete = whole.size() - (std::string(format) == "ascii" ? 12 : 0);
        for (size_t size = 0; size < complete; ++size) {
            const auto file = decodePly(std::span(whole).first(size));
            CHECK_MESSAGE(!file, size);
            if (!file) CHECK(file.error().message.find('\n') == std::string::npos);
        }
    }
}

TEST_CASE("a .ply that is longer than its header says is refused")
{
    auto bytes = encodePly(makePlainSplats(2, 1));
    bytes.push_back(std::byte(0));
    checkRefused(bytes, "1 bytes follow the last splat");
}

TEST_CASE("a number of splats that the file cannot hold is refused before memory is taken for it")
{
    const auto bytes = replaced(encodePly(makePlainSplats(2, 1)), "vertex 2\n", "vertex 18446744073709551615\n");
    checkRefused(bytes, "truncated");
    checkRefused(replaced(encodePly(makePlainSplats(2, 1)), "vertex 2\n", "vertex 18446744073709551616\n"), "no number of elements");
    checkRefused(replaced(encodePly(makePlainSplats(2, 1)), "vertex 2\n", "vertex 0\n"), "no splats");
}

TEST_CASE("what is no splat is refused, by its number")
{
    struct {
        const char *property, *value, *message;
    } const kCases[] = {{"x", "nan", "splat 1: x is not a number"},     {"x", "inf", "splat 1: x is inf"},
                        {"y", "1e30", "splat 1: y is 1e+30, too large"}, {"y", "1e999", "splat 1: y is inf"},
                        {"rot_0", "inf", "splat 1: rot_0 is inf"},       {"opacity", "nan", "splat 1: opacity is not a number"},
                        {"scale_1", "100", "splat 1: scale_1 is 100"},   {"scale_1", "inf", "splat 1: scale_1 is inf"},
                        {"f_rest_8", "-nan", "splat 1: f_rest_8 is not a number"}, {"f_dc_0", "0x", "splat 1: a number is missing or none"}};
    for (const auto& c : kCases) {
        PlyLayout layout{"ascii", "float", 0};
        layout.property = c.property, layout.value = c.value;
        checkRefused(writePly(makePlainSplats(2, 4), layout), c.message);
    }
}

TEST_CASE("what viewers draw all the same is mended, and said")
{
    struct {
        const char *property, *value, *warning;
        float opacity;
    } const kCases[] = {{"opacity", "inf", "infinite opacity", 1}, {"opacity", "-inf", "infinite opacity", 0}, {"scale_0", "-inf", "scales are 0", -1}};
    for (const auto& c : kCases) {
        PlyLayout layout{"ascii", "float", 0};
        layout.property = c.property, layout.value = c.value;
        const auto file = decodePly(writePly(makePlainSplats(2, 1), layout));
        REQUIRE(file);
        REQUIRE(file->warnings.size() == 1);
        CHECK(file->warnings[0].find(c.warning) != std::string::npos);
        if (c.opacity >= 0) CHECK(file->splats.cloud.opacities[1] == c.opacity);
        CHECK(file->splats.cloud.scales[1].x > 0);
    }
    PlainSplats lost = makePlainSplats(2, 1);
    lost.cloud.rotations[1] = glm::quat(0, 0, 0, 0);
    const auto file = decodePly(encodePly(lost));
    REQUIRE(file);
    CHECK(file->warnings.size() == 1);
    CHECK(file->splats.cloud.rotations[1] == glm::quat(1, 0, 0, 0));
}

TEST_CASE("headers that are none, and files of another kind, are refused in one line")
{
    const auto whole = encodePly(makePlainSplats(2, 4));
    checkRefused({}, "not a .ply");
    checkRefused(replaced(whole, "ply\n", "plx\n"), "not a .ply");
    checkRefused(replaced(whole, "binary_little_endian", "binary_middle_endian"), "line 2 of the header: unknown format");
    checkRefused(replaced(whole, " 1.0", " 2.0"), "version '2.0'");
    checkRefused(replaced(whole, "property float x", "property flaot x"), "unknown type 'flaot'");
    checkRefused(replaced(whole, "property float nx", "property float x"), "'x' occurs twice");
    checkRefused(replaced(whole, "property float y\n", ""), "no property 'y'");
    checkRefused(replaced(whole, "property float nx", "property list uchar float nx"), "a list");
    checkRefused(replaced(whole, "f_rest_3", "rest_3"), "8 properties f_rest_*");
    checkRefused(replaced(whole, "f_rest_3", "f_rest_9"), "9 properties f_rest_*");
    checkRefused(replaced(whole, "element vertex", "element vortex"), "no element 'vertex'");
    checkRefused(replaced(whole, "scale_2", "other_2"), "flat splats");
    checkRefused(replaced(whole, "end_header", "end_haeder"), "not a line of a PLY header: 'end_haeder'");
    checkRefused(replaced(whole, "comment Nacre\n", "comment " + std::string(70000, 'x') + "\n"), "no 'end_header' within 65536 bytes");
}

TEST_CASE("rotated splats show in rotated directions what they showed before")
{
    const PlainSplats before = makePlainSplats(6, 16);
    PlainSplats after = before;
    const glm::dquat rotation = glm::normalize(glm::dquat(0.3, -0.5, 0.7, 0.2));
    rotateSplats(rotation, after);
    const auto colorOf = [](const PlainSplats& s, size_t i, const glm::dvec3& d) {
        double y[16];
        shBasis(16, d.x, d.y, d.z, y);
        glm::dvec3 sum(0.0);
        for (size_t f = 0; f < 16; ++f) sum += y[f] * glm::dvec3(s.look.sh[16 * i + f]);
        return sum;
    };
    for (size_t i = 0; i < before.cloud.count; ++i) {
        for (const glm::dvec3& v : {glm::dvec3(1, 0, 0), glm::dvec3(0.2, -0.9, 0.4), glm::dvec3(-0.5, 0.5, -0.7)}) {
            const glm::dvec3 d = glm::normalize(v);
            CHECK(glm::length(colorOf(before, i, d) - colorOf(after, i, rotation * d)) < 1e-5); // float32 coefficients of order one
        }
        CHECK(glm::length(glm::dvec3(after.cloud.positions[i]) - rotation * glm::dvec3(before.cloud.positions[i])) < 1e-6);
        const glm::dmat3 turned = glm::mat3_cast(rotation) * glm::mat3_cast(glm::dquat(before.cloud.rotations[i]));
        const glm::dmat3 found = glm::mat3_cast(glm::dquat(after.cloud.rotations[i]));
        for (int k = 0; k < 3; ++k) CHECK(glm::length(turned[k] - found[k]) < 1e-5);
    }
}

TEST_CASE("a plain .glb reads back as it was written, turned as its node says")
{
    for (int functions : {1, 4, 9, 16}) {
        PlainSplats splats = makePlainSplats(5, functions);
        splats.srgb = functions != 4;
        splats.yUpFromSplats = glm::quat(0.70710678f, -0.70710678f, 0, 0);
        const auto bytes = encodeSplatGlb(splats);
        REQUIRE(bytes);
        const auto back = decodeSplatGlb(*bytes, "test");
        REQUIRE_MESSAGE(back, (back ? "" : back.error().message));
        CHECK(back->srgb == splats.srgb);
        rotateSplats(splats.yUpFromSplats, splats);
        checkSame(splats, *back, 1e-5f);
    }
}

TEST_CASE("a plain .glb says that nobody needs to know more than the extension")
{
    const auto bytes = encodeSplatGlb(makePlainSplats(2, 16));
    REQUIRE(bytes);
    const std::string text(reinterpret_cast<const char*>(bytes->data()), bytes->size());
    CHECK(text.find("\"extensionsUsed\":[\"KHR_gaussian_splatting\"]") != std::string::npos);
    CHECK(text.find("extensionsRequired") == std::string::npos);
    CHECK(text.find("NACRE") == std::string::npos);
    CHECK(text.find("srgb_rec709_display") != std::string::npos);
}

TEST_CASE("every beginning of a plain .glb, and every broken byte of its JSON, is an error or valid splats")
{
    const auto whole = encodeSplatGlb(makePlainSplats(2, 4));
    REQUIRE(whole);
    for (size_t size = 0; size < whole->size(); ++size) CHECK(!decodeSplatGlb(std::span(*whole).first(size), "test"));
    auto broken = *whole;
    for (size_t i = 0; i < whole->size(); ++i)
        for (unsigned flip : {0x01u, 0x80u}) {
            broken[i] ^= std::byte(flip);
            const auto splats = decodeSplatGlb(broken, "test");
            if (!splats) CHECK(!splats.error().message.empty());
            else for (const glm::vec3& s : splats->cloud.scales) CHECK((s.x > 0 && s.y > 0 && s.z > 0));
            broken[i] = (*whole)[i];
        }
}
