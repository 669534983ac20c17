// Matrices and settings as hosts really have them: rounded by inversions, drifted, from a minimised window, under a foreign locale.
#include "runtime_fixture.h"

#include <clocale>
#include <cstdlib>
#include <filesystem>
#include <locale>

using namespace nacre;
using namespace nacre::test;

namespace {

const std::vector<Light> kLights = {pointLight({0.8f, 1.1f, 0.4f}, {2.0f, 1.0f, 0.5f})};

/// Inverse by cofactors times the reciprocal of the determinant, all in float, as raylib, gl-matrix and linmath.h have it.
glm::mat4 cofactorInverse(const glm::mat4& m)
{
    glm::mat4 out;
    float det = 0;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) {
            glm::mat3 minor;
            for (int c = 0, k = 0; c < 4; ++c)
                for (int r = 0; r < 4; ++r)
                    if (c != i && r != j) minor[k / 3][k % 3] = m[c][r], ++k;
            const float cofactor = ((i + j) % 2 ? -1.0f : 1.0f) * glm::determinant(minor);
            out[j][i] = cofactor;
            if (j == 0) det += m[i][0] * cofactor;
        }
    const float reciprocal = 1.0f / det;
    for (int c = 0; c < 4; ++c) out[c] *= reciprocal;
    return out;
}

glm::quat randomRotation(std::mt19937& rng)
{
    std::normal_distribution<float> n;
    return glm::normalize(glm::quat(n(rng), n(rng), n(rng), n(rng)));
}
glm::vec3 randomVector(std::mt19937& rng)
{
    std::normal_distribution<float> n;
    return {n(rng), n(rng), n(rng)};
}
glm::mat4 rigid(const glm::quat& q, const glm::vec3& t) { return glm::translate(glm::mat4(1), t) * glm::mat4_cast(q); }

/// How many of `count` descriptions are refused.
template <class Describe>
int refusals(Host& host, int count, Describe describeOne)
{
    int refused = 0;
    for (int i = 0; i < count; ++i) {
        NacreDrawDesc desc = describe(offCentre());
        desc.viewportWidth = desc.viewportHeight = 8;
        describeOne(i, desc);
        refused += nacreViewDraw(host.view, &desc) != NACRE_OK;
    }
    return refused;
}

/// How many of `count` places of the instance are refused, or cannot be drawn.
template <class Place>
int refusedPlaces(Host& host, int count, Place place)
{
    int refused = 0;
    NacreDrawDesc desc = describe(offCentre());
    desc.viewportWidth = desc.viewportHeight = 8;
    for (int i = 0; i < count; ++i) {
        float m[16];
        copy(m, place());
        refused += nacreInstanceSetTransform(host.instance, m) != NACRE_OK || nacreViewDraw(host.view, &desc) != NACRE_OK;
    }
    return refused;
}

/// A locale with a decimal comma, made in a temporary folder if the machine has none. Gone with this object.
class CommaLocale {
public:
    CommaLocale()
    {
        const auto set = [](const char* name) { return std::setlocale(LC_ALL, name) && std::localeconv()->decimal_point[0] == ','; };
        active = set("de_DE.UTF-8") || set("fr_FR.UTF-8");
        if (active) return;
        folder_ = std::filesystem::temp_directory_path() / ("nacre_locale_" + std::to_string(std::random_device{}()));
        std::filesystem::create_directories(folder_);
        const std::string make = "localedef -i de_DE -f UTF-8 " + (folder_ / "de_DE.UTF-8").string() + " >/dev/null 2>&1";
        (void)!std::system(make.c_str()); // its warnings count as failures; whether the locale can be set is what tells
        setenv("LOCPATH", folder_.c_str(), 1);
        active = set("de_DE.UTF-8");
        if (!active) MESSAGE("SKIPPED: no locale with a decimal comma here, and localedef makes none (package locales)");
    }
    ~CommaLocale()
    {
        std::setlocale(LC_ALL, "C");
        unsetenv("LOCPATH");
        std::error_code ignored;
        if (!folder_.empty()) std::filesystem::remove_all(folder_, ignored);
    }
    CommaLocale(const CommaLocale&) = delete;
    bool active = false;

private:
    std::filesystem::path folder_;
};

} // namespace

TEST_CASE("matrices that rounding has touched are drawn")
{
    if (!haveGl()) return;
    Host host(oneSplat(4));
    host.setLights(kLights);
    host.gl->makeCurrent();
    REQUIRE(host.gl->beginFrame(8, 8));
    std::mt19937 rng(7);
    const int kCount = 300;

    for (const float distance : {1.0f, 10.0f, 1000.0f}) {
        CAPTURE(distance);
        CHECK(refusals(host, kCount, [&](int i, NacreDrawDesc& d) { // an orbit
            const float angle = 0.01f * float(i);
            const glm::vec3 eye = distance * glm::vec3(std::cos(angle), 0.4f, std::sin(angle));
            copy(d.viewFromWorld, cofactorInverse(glm::inverse(glm::lookAt(eye, glm::vec3(0), glm::vec3(0, 1, 0)))));
        }) == 0);
        CHECK(refusals(host, kCount, [&](int, NacreDrawDesc& d) {
            copy(d.viewFromWorld, cofactorInverse(rigid(randomRotation(rng), distance * randomVector(rng))));
        }) == 0);
        CHECK(refusals(host, kCount, [&](int, NacreDrawDesc& d) {
            copy(d.viewFromWorld, glm::inverse(glm::inverse(glm::inverse(rigid(randomRotation(rng), distance * randomVector(rng))))));
        }) == 0);
    }
    for (const float scale : {0.001f, 0.01f, 7.0f, 100.0f}) {
        CAPTURE(scale);
        const auto scaled = [&](float translation) {
            return rigid(randomRotation(rng), translation * randomVector(rng)) * glm::scale(glm::mat4(1), glm::vec3(scale));
        };
        CHECK(refusedPlaces(host, kCount, [&] { return glm::inverse(scaled(1)); }) == 0);
        CHECK(refusedPlaces(host, kCount, [&] { return cofactorInverse(scaled(10)); }) == 0);
        CHECK(refusedPlaces(host, kCount, [&] { // a hierarchy
            return scaled(5) * rigid(randomRotation(rng), randomVector(rng)) * scaled(5);
        }) == 0);
    }
    CHECK(refusedPlaces(host, 20, [&] { // integrated and never normalised
        glm::quat q = randomRotation(rng);
        const glm::quat step = glm::angleAxis(0.001f, glm::normalize(randomVector(rng)));
        for (int n = 0; n < 10000; ++n) q = step * q;
        return glm::mat4_cast(q);
    }) == 0);
    CHECK(refusals(host, kCount, [&](int i, NacreDrawDesc& d) {
        copy(d.clipFromView, glm::inverse(glm::inverse(glm::perspective(0.8f + 0.0005f * float(i), 1.7f, 0.1f, 100.0f + float(i)))));
    }) == 0);
    for (const glm::mat4& p : {glm::ortho(-3.0f, 3.0f, -2.0f, 2.0f, 0.1f, 100.0f), glm::ortho(-300.0f, 7.0f, -2.0f, 2.0f, -100.0f, 1e4f), glm::mat4(1)})
        CHECK(refusals(host, 2, [&](int i, NacreDrawDesc& d) { copy(d.clipFromView, i ? cofactorInverse(cofactorInverse(p)) : p); }) == 0);
    CHECK(refusals(host, kCount, [&](int i, NacreDrawDesc& d) {
        copy(d.clipFromView, cofactorInverse(cofactorInverse(glm::perspective(0.8f, 1.7f, 0.01f, 1000.0f + float(i)))));
    }) == 0);
}

TEST_CASE("rounding of a matrix does not show in the picture")
{
    if (!haveGl()) return;
    Host host(randomAsset(50, 4, 3));
    host.setLights(kLights);
    const Camera camera = offCentre();
    const Image exact = host.draw(camera);
    NacreDrawDesc desc = describe(camera);
    glm::dmat4 view = glm::inverse(camera.worldFromCamera);
    view *= 1.0 + 2e-4; // as an inexact determinant does
    view[0][3] = 3e-5, view[2][3] = -3e-5;
    copy(desc.viewFromWorld, view);
    CHECK(largestDifference(host.draw(desc), exact) < 1e-3f); // pixels move by 1e-4 of themselves
}

TEST_CASE("a camera that hangs on something scaled sees the same picture")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : {withSharp(randomAsset(60, 4, 9), kAllSharp, 4), randomSss(60, kAllSss, 4)}) {
        Host host(asset);
        const Camera camera = offCentre();
        const Image plain = host.draw(camera, kLights);
        for (const double scale : {0.25, 2.0}) {
            NacreDrawDesc desc = describe(camera);
            copy(desc.viewFromWorld, glm::scale(glm::dmat4(1), glm::dvec3(scale)) * glm::inverse(camera.worldFromCamera));
            CHECK(largestDifference(host.draw(desc), plain) < 1e-4f); // powers of two: little but the near plane differs
        }
    }
}

TEST_CASE("matrices that are not what they should be are refused")
{
    if (!haveGl()) return;
    Host host(oneSplat(0));
    host.setLights(kLights);
    host.gl->makeCurrent();
    REQUIRE(host.gl->beginFrame(8, 8));
    const auto with = [&](int column, int row, double value) {
        glm::dmat4 m(1.0);
        m[column][row] = value;
        return m;
    };
    const glm::dmat4 wrong[] = {with(0, 1, 0.01), with(2, 0, -0.5),  with(1, 1, 1.01), with(0, 3, 0.001),
                                with(2, 3, -1),   with(3, 3, 2),     with(3, 3, 0),    with(3, 3, -1),
                                clipFromView(offCentre()), glm::dmat4(0.0)};
    for (size_t i = 0; i < std::size(wrong); ++i) {
        CAPTURE(i);
        const glm::dmat4& m = wrong[i];
        if (i < std::size(wrong) - 1) CHECK(refusedPlaces(host, 1, [&] { return m; }) == 1); // all zero: the identity
        CHECK(refusals(host, 1, [&](int, NacreDrawDesc& d) { copy(d.viewFromWorld, m); }) == 1);
    }
    const glm::mat4 tilted(clipFromView(offCentre()) + 0.1 * with(0, 3, 1)); // w grows sideways
    for (const glm::mat4& p : {tilted, glm::mat4(0)}) {
        CAPTURE(p[3][3]);
        CHECK(refusals(host, 1, [&](int, NacreDrawDesc& d) { copy(d.clipFromView, p); }) == 1);
    }
}

TEST_CASE("a viewport without pixels draws nothing and is no error")
{
    if (!haveGl()) return;
    Host host(oneSplat(0));
    host.setLights(kLights);
    host.gl->makeCurrent();
    NacreDrawDesc desc = describe(offCentre());
    host.draw(offCentre());
    for (const auto& [width, height] : {std::pair{0, 0}, {0, 56}, {72, 0}}) {
        desc.viewportWidth = width, desc.viewportHeight = height;
        copy(desc.clipFromView, glm::dmat4(NAN)); // its aspect ratio is 0 / 0
        CHECK(nacreViewDraw(host.view, &desc) == NACRE_OK);
        CHECK(host.stats().splatsDrawn == 0);
    }
    CHECK(host.messages.empty());
    desc.viewportWidth = -1;
    CHECK(nacreViewDraw(host.view, &desc) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(nacreViewDraw(host.view, nullptr) == NACRE_ERROR_INVALID_ARGUMENT);
}

TEST_CASE("a host's decimal comma changes neither pixels nor messages")
{
    if (!haveGl()) return;
    for (const SplatAsset& asset : {withSharp(randomAsset(60, 4, 9), kAllSharp, 4), randomSss(60, kAllSss, 4)}) {
        const auto drawn = [&] {
            Host host(asset);
            host.setLights(kLights);
            const Image image = host.draw(offCentre());
            NacreLight dim = toNacre(kLights[0]);
            dim.intensity[1] = -0.5f;
            CHECK(nacreContextSetLights(host.context, &dim, 1) == NACRE_ERROR_INVALID_ARGUMENT);
            return std::pair(image, host.lastMessage());
        };
        const auto [plain, plainMessage] = drawn();
        const CommaLocale comma;
        if (!comma.active) return;
        const std::locale before = std::locale::global(std::locale("")); // streams as well
        const auto [image, message] = drawn();
        std::locale::global(before);
        CHECK(largestDifference(image, plain) == 0.0f);
        CHECK(message == plainMessage);
    }
}

TEST_CASE("splats and lights as far away as they may be give finite pictures")
{
    if (!haveGl()) return;
    const std::vector<Light> lights = {pointLight({1e15f, -1e15f, 1e15f}, glm::vec3(1e15f)), kLights[0], directionalLight({0, 0, 1}, glm::vec3(1))};
    for (SplatAsset asset : {withSharp(randomAsset(30, 4, 9), kAllSharp, 4), randomSss(30, kAllSss, 4)}) {
        CAPTURE(asset.model);
        asset.cloud.positions[3] = glm::vec3(-1e15f, 1e15f, -1e15f);
        asset.cloud.positions[4] = glm::vec3(0, 0, -1e12f);
        asset.cloud.scales[4] = glm::vec3(1e15f);
        asset.cloud.scales[5] = glm::vec3(1e-30f);
        Host host(asset);
        CHECK(allFinite(host.draw(offCentre(), lights)));
        host.moveTo(glm::scale(glm::dmat4(1), glm::dvec3(1e-6))); // lights are 1e21 away in asset space
        CHECK(allFinite(host.draw(offCentre())));
    }
}

TEST_CASE("large values are drawn where they are stored as float and refused where as half")
{
    if (!haveGl()) return;
    SplatAsset sharp = withSharp(randomAsset(20, 4, 9), kAllSharp, 4);
    for (Channel& c : sharp.channels)
        if (c.name == "lobe") c.values[3] = 1e6f; // sharpness of a mirror
    Host host(sharp);
    CHECK(allFinite(host.draw(offCentre(), kLights)));

    SplatAsset farAway = randomSss(20, kAllSss, 4);
    for (Channel& c : farAway.channels)
        if (c.name == "network") c.values[kSssFrame] = 1e6f, c.values[kSssFrame + 3] = 1e5f; // centre and 1 / half-size
    host.load(farAway);

    for (const char* name : {"tDir", "tInd", "s"}) {
        SplatAsset large = randomAsset(20, 4, 9);
        for (Channel& c : large.channels)
            if (c.name == name) c.values[0] = -65536.0f;
        const auto bytes = encodeAsset(large);
        REQUIRE(bytes);
        NacreAsset refused{};
        CHECK(nacreAssetCreate(host.context, bytes->data(), bytes->size(), &refused) == NACRE_ERROR_BAD_ASSET);
        CHECK_MESSAGE(host.lastMessage() == std::string("channel '") + name + "' has a value of -65536 at splat 0, the largest that can be drawn is 65504", host.lastMessage());
    }
}
