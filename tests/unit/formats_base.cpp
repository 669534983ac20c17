// Files, the border check of assets, and the spherical-harmonic basis.
#include "formats_fixtures.h"

#include "base/byte_stream.h"
#include "base/file.h"
#include "appearance/bigs/bigs.h"
#include "appearance/sss/sss.h"
#include "base/exact_position.h"
#include "base/light.h"
#include "base/fibonacci_sphere.h"
#include "base/spherical_harmonics.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <numbers>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

using namespace nacre;
using namespace nacre::test;
namespace fs = std::filesystem;

namespace {

/// A folder of its own, gone at the end.
struct TemporaryFolder {
    fs::path path = fs::temp_directory_path() / ("nacre-formats-" + std::to_string(::getpid()));
    TemporaryFolder() { fs::create_directories(path); }
    ~TemporaryFolder() { fs::remove_all(path); }
    std::string file(const char* name) const { return (path / name).string(); }
    size_t entries() const { return size_t(std::distance(fs::directory_iterator(path), fs::directory_iterator())); }
};

std::vector<std::byte> someBytes(size_t n)
{
    std::vector<std::byte> bytes(n);
    for (size_t i = 0; i < n; ++i) bytes[i] = std::byte(i * 31);
    return bytes;
}

/// Files may not grow beyond `bytes`, with an error instead of a signal: a full disk without a disk.
struct FileSizeLimit {
    rlimit old{};
    void (*oldHandler)(int);
    explicit FileSizeLimit(rlim_t bytes) : oldHandler(std::signal(SIGXFSZ, SIG_IGN))
    {
        REQUIRE(getrlimit(RLIMIT_FSIZE, &old) == 0);
        const rlimit limit{bytes, old.rlim_max};
        REQUIRE(setrlimit(RLIMIT_FSIZE, &limit) == 0);
    }
    ~FileSizeLimit()
    {
        setrlimit(RLIMIT_FSIZE, &old);
        std::signal(SIGXFSZ, oldHandler);
    }
};

} // namespace

TEST_CASE("written file reads back, and replaces the old one")
{
    const TemporaryFolder folder;
    const std::string path = folder.file("x.bin");
    for (size_t n : {size_t(0), size_t(1), size_t(70000)}) {
        REQUIRE(writeFileAtomically(path, someBytes(n)));
        const auto back = readFile(path);
        REQUIRE(back);
        CHECK(*back == someBytes(n));
        CHECK(folder.entries() == 1);
    }
}

TEST_CASE("full disk leaves the old file and nothing else")
{
    const TemporaryFolder folder;
    const std::string path = folder.file("x.bin");
    REQUIRE(writeFileAtomically(path, someBytes(10)));
    {
        const FileSizeLimit limit(4096);
        const Status status = writeFileAtomically(path, someBytes(1000000));
        REQUIRE_FALSE(status);
        CHECK(status.error().code == ErrorCode::kIo);
        CHECK(status.error().message.find(path) != std::string::npos);
        CHECK(status.error().message.find("File too large") != std::string::npos); // what the system said
        CHECK_FALSE(writeFileAtomically(folder.file("new.bin"), someBytes(1000000)));
    }
    CHECK(folder.entries() == 1);
    CHECK(*readFile(path) == someBytes(10));
}

TEST_CASE("asset that does not fit on the disk is an I/O error without a partial file")
{
    const TemporaryFolder folder;
    const FileSizeLimit limit(2048);
    const Status status = writeAsset(makeAsset(20, 25, 16), folder.file("a.glb"));
    REQUIRE_FALSE(status);
    CHECK(status.error().code == ErrorCode::kIo);
    CHECK(folder.entries() == 0);
}

TEST_CASE("writing into a missing folder or over a folder is an I/O error")
{
    const TemporaryFolder folder;
    for (const std::string& path : {folder.file("no/such/x.bin"), folder.path.string()}) {
        const Status status = writeFileAtomically(path, someBytes(3));
        REQUIRE_FALSE(status);
        CHECK(status.error().code == ErrorCode::kIo);
    }
    CHECK(folder.entries() == 0);
}

TEST_CASE("symbolic links and devices keep being what they are")
{
    const TemporaryFolder folder;
    REQUIRE(writeFileAtomically(folder.file("target"), someBytes(1)));
    fs::create_symlink("target", folder.path / "link");
    REQUIRE(writeFileAtomically(folder.file("link"), someBytes(5)));
    CHECK(fs::is_symlink(folder.path / "link"));
    CHECK(*readFile(folder.file("target")) == someBytes(5));

    REQUIRE(writeFileAtomically("/dev/null", someBytes(5)));
    CHECK(fs::is_character_file("/dev/null"));
    if (fs::exists("/dev/full")) {
        const Status status = writeFileAtomically("/dev/full", someBytes(5));
        REQUIRE_FALSE(status);
        CHECK(status.error().message.find("No space left") != std::string::npos);
    }
}

TEST_CASE("a writer killed at any moment leaves one whole version of the file")
{
    const TemporaryFolder folder;
    const std::string path = folder.file("x.bin");
    constexpr size_t kBytes = 1 << 20; // large enough that most kills hit in the middle of a write
    REQUIRE(writeFileAtomically(path, std::vector<std::byte>(kBytes, std::byte(0))));
    for (int round = 0; round < 20; ++round) {
        const pid_t child = ::fork();
        if (child == 0)
            for (int version = 0;; ++version) (void)writeFileAtomically(path, std::vector<std::byte>(kBytes, std::byte(version)));
        REQUIRE(child > 0);
        ::usleep(useconds_t(500 + 977 * round % 9000));
        ::kill(child, SIGKILL);
        REQUIRE(::waitpid(child, nullptr, 0) == child);
        const auto bytes = readFile(path);
        REQUIRE(bytes);
        REQUIRE(bytes->size() == kBytes);
        CHECK(std::count(bytes->begin(), bytes->end(), bytes->front()) == ptrdiff_t(kBytes));
    }
    removeAbandonedTemporaries(path);
    CHECK(folder.entries() == 1);
}

TEST_CASE("temporaries of a writer that was killed go; those of a running one and files that only look similar stay")
{
    const TemporaryFolder folder;
    const pid_t child = ::fork();
    if (child == 0) { // leaves what a kill in the middle of writing leaves
        std::ofstream(folder.file("x.bin") + ".tmp-" + std::to_string(::getpid())) << "half";
        ::_exit(0);
    }
    REQUIRE(child > 0);
    REQUIRE(::waitpid(child, nullptr, 0) == child);
    REQUIRE(folder.entries() == 1);
    REQUIRE(writeFileAtomically(folder.file("x.bin"), someBytes(7)));
    const std::string gone = std::to_string(child), mine = std::to_string(::getpid());
    for (const std::string& name : {"x.bin.tmp-" + mine, "x.bin.tmp-" + gone + "b", std::string("x.bin.tmp-"), std::string("x.bin.tmp--1"), "y.bin.tmp-" + gone})
        std::ofstream(folder.path / name) << "keep";
    removeAbandonedTemporaries(folder.file("x.bin"));
    CHECK(folder.entries() == 6);
    CHECK_FALSE(fs::exists(folder.path / ("x.bin.tmp-" + gone)));
    CHECK(*readFile(folder.file("x.bin")) == someBytes(7));
    removeAbandonedTemporaries(folder.file("no/such/folder.bin"));
}

TEST_CASE("unreadable and oversized files are bad input")
{
    const TemporaryFolder folder;
    REQUIRE(writeFileAtomically(folder.file("x"), someBytes(100)));
    CHECK(readFile(folder.file("x"), 100));
    for (const auto& result : {readFile(folder.file("x"), 99), readFile(folder.file("none")), readFile(folder.path.string())}) {
        REQUIRE_FALSE(result);
        CHECK(result.error().code == ErrorCode::kBadInput);
        CHECK(result.error().message.find(folder.path.string()) != std::string::npos);
    }
    const auto asset = readAsset(folder.file("x"));
    REQUIRE_FALSE(asset);
    CHECK(asset.error().message.find("x': not a .glb") != std::string::npos);
}

TEST_CASE("asset check accepts the edges of what is allowed")
{
    SplatAsset asset = makeAsset(3, 0, 0);
    asset.cloud.opacities = {0.0f, 1.0f, 0.5f};
    asset.cloud.scales[0] = glm::vec3(std::numeric_limits<float>::min());
    asset.cloud.rotations[0] *= 1.0005f; // rounded by another tool
    asset.lowPassVariance = 0.0f;
    CHECK(validate(asset));
}

TEST_CASE("asset check names what is wrong")
{
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    const auto refuses = [](const char* part, const std::function<void(SplatAsset&)>& edit) {
        SplatAsset asset = makeAsset(3, 4, 4);
        REQUIRE(validate(asset));
        edit(asset);
        const Status status = validate(asset);
        REQUIRE_MESSAGE(!status, part);
        CHECK(status.error().code == ErrorCode::kBadInput);
        CHECK_MESSAGE(status.error().message.find(part) != std::string::npos, status.error().message);
    };
    for (float v : {nan, inf, -inf}) {
        refuses("position is not finite or beyond 1e15 (splat 1)", [&](SplatAsset& a) { a.cloud.positions[1].y = v; });
        refuses("rotation", [&](SplatAsset& a) { a.cloud.rotations[0].w = v; });
        refuses("scale", [&](SplatAsset& a) { a.cloud.scales[2].z = v; });
        refuses("opacity", [&](SplatAsset& a) { a.cloud.opacities[2] = v; });
        refuses("'tInd' has a value", [&](SplatAsset& a) { a.channels[1].values.back() = v; });
        refuses("neutral look has a value", [&](SplatAsset& a) { a.neutral.sh[3].b = v; });
        refuses("filter variance", [&](SplatAsset& a) { a.lowPassVariance = v; });
        refuses("+Y up", [&](SplatAsset& a) { a.yUpFromAsset.x = v; });
    }
    refuses("position is not finite or beyond 1e15 (splat 2)", [](SplatAsset& a) { a.cloud.positions[2].z = -1e20f; });
    refuses("scale", [](SplatAsset& a) { a.cloud.scales[1].y = 1e20f; });
    refuses("'tInd' has a value", [](SplatAsset& a) { a.channels[1].values[0] = -1e20f; });
    refuses("scale", [](SplatAsset& a) { a.cloud.scales[0].x = -1.0f; });
    refuses("scale", [](SplatAsset& a) { a.cloud.scales[0].x = 0.0f; });
    refuses("unit quaternion", [](SplatAsset& a) { a.cloud.rotations[0] = glm::quat(0, 0, 0, 0); });
    refuses("unit quaternion", [](SplatAsset& a) { a.cloud.rotations[0] *= 1.01f; });
    refuses("opacity", [](SplatAsset& a) { a.cloud.opacities[0] = 2.0f; });
    refuses("opacity", [](SplatAsset& a) { a.cloud.opacities[0] = -0.01f; });
    refuses("no splats", [](SplatAsset& a) { a.cloud = {}; });
    refuses("arrays disagree", [](SplatAsset& a) { a.cloud.scales.pop_back(); });
    refuses("unknown appearance model 'painterly'", [](SplatAsset& a) { a.model = "painterly"; });
    refuses("'rho' of model 'bigs' is missing", [](SplatAsset& a) { a.channels.erase(a.channels.begin() + 2); });
    refuses("'rho' appears twice", [](SplatAsset& a) { a.channels.push_back(a.channels[2]); });
    refuses("'extra' does not belong", [](SplatAsset& a) { a.channels[0].name = "extra"; });
    refuses("accepted: 0, 3, 30, 135, 408, 975", [](SplatAsset& a) { a.channels[3].components = 31; });
    refuses("'s' has 0 components", [](SplatAsset& a) { a.channels[3] = {"s", 0, {}}; });
    refuses("'visibility' has 0 floats and 767 bytes", [](SplatAsset& a) {
        a = makeAsset(3, 4, 4, true);
        a.channels[a.channels.size() - 2].bytes.pop_back();
    });
    refuses("'rho' has 9 floats and 1 bytes", [](SplatAsset& a) { a.channels[2].bytes.push_back(0); });
    refuses("'tDir' has 74 floats", [](SplatAsset& a) { a.channels[0].values.pop_back(); });
    refuses("'network' is stored per splat, expected once per asset", [](SplatAsset& a) { a = makeSss(3, true), a.channels.back().perAsset = false; });
    refuses("'normal' is stored once per asset, expected per splat", [](SplatAsset& a) { a = makeSss(3, true), a.channels[2].perAsset = true; });
    refuses("'network' has 6631 floats and 0 bytes, expected 1 row x 6632", [](SplatAsset& a) { a = makeSss(3, true), a.channels.back().values.pop_back(); });
    refuses("'material' of model 'sss' is missing", [](SplatAsset& a) { a = makeSss(3, false), a.channels.erase(a.channels.begin() + 1); });
    refuses("accepted: 2, 3", [](SplatAsset& a) { a = makeSss(3, false), a.channels[1].components = 1; });
    refuses("SH functions", [](SplatAsset& a) { a.neutral.shFunctions = 5; });
    refuses("coefficients", [](SplatAsset& a) { a.neutral.sh.pop_back(); });
}

TEST_CASE("every model is found by its name")
{
    REQUIRE(appearanceModels().size() >= 1);
    for (const AppearanceModel& model : appearanceModels()) CHECK(findAppearanceModel(model.name) == &model);
    CHECK(findAppearanceModel("BIGS") == nullptr);
}

TEST_CASE("spherical harmonics are orthonormal")
{
    // Gauss-Legendre would do with fewer nodes; the product rule below integrates trigonometric polynomials in azimuth exactly
    // and converges like 1/n^2 in z.
    constexpr int kRings = 2000, kSectors = 20;
    double gram[kMaxShFunctions][kMaxShFunctions] = {};
    for (int i = 0; i < kRings; ++i)
        for (int j = 0; j < kSectors; ++j) {
            const double z = -1.0 + 2.0 * (i + 0.5) / kRings, r = std::sqrt(1.0 - z * z);
            const double phi = 2.0 * std::numbers::pi * j / kSectors;
            double y[kMaxShFunctions];
            shBasis(kMaxShFunctions, r * std::cos(phi), r * std::sin(phi), z, y);
            for (int a = 0; a < kMaxShFunctions; ++a)
                for (int b = 0; b <= a; ++b) gram[a][b] += y[a] * y[b] * 4.0 * std::numbers::pi / (kRings * kSectors);
        }
    for (int a = 0; a < kMaxShFunctions; ++a)
        for (int b = 0; b <= a; ++b) {
            CAPTURE(a);
            CAPTURE(b);
            CHECK(std::abs(gram[a][b] - (a == b ? 1.0 : 0.0)) < 1e-5); // midpoint rule in z: error about degree^4 / (24 n^2)
        }
}

TEST_CASE("spherical harmonics have the constants and signs of KHR_gaussian_splatting")
{
    const auto at = [](double x, double y, double z) {
        std::vector<double> values(kMaxShFunctions);
        const double n = std::sqrt(x * x + y * y + z * z);
        shBasis(kMaxShFunctions, x / n, y / n, z / n, values.data());
        return values;
    };
    const double tolerance = 1e-12; // f64 rounding
    const auto close = [&](double a, double b) { return std::abs(a - b) < tolerance; };
    const std::vector<double> x = at(1, 0, 0), y = at(0, 1, 0), z = at(0, 0, 1), xy = at(1, 1, 0), yz = at(0, 1, 1),
                              xz = at(1, 0, 1);
    CHECK(close(x[0], 0.2820947917738781));
    CHECK(close(y[1], -0.4886025119029199));
    CHECK(close(z[2], 0.4886025119029199));
    CHECK(close(x[3], -0.4886025119029199));
    CHECK(close(xy[4], 1.092548430592079 / 2));
    CHECK(close(yz[5], -1.092548430592079 / 2));
    CHECK(close(z[6], 0.3153915652525200 * 2));
    CHECK(close(xz[7], -1.092548430592079 / 2));
    CHECK(close(x[8], 0.5462742152960395));
    CHECK(close(y[9], 0.5900435899266435)); // -c y (3x^2 - y^2)
    CHECK(close(at(1, 1, 1)[10], 2.890611442640554 / std::pow(3.0, 1.5)));
    CHECK(close(y[11], 0.4570457994644657));
    CHECK(close(z[12], 0.3731763325901154 * 2));
    CHECK(close(x[13], 0.4570457994644657));
    CHECK(close(xz[14], 1.445305721320277 / (2 * std::sqrt(2.0))));
    CHECK(close(x[15], -0.5900435899266435));
}

TEST_CASE("fewer spherical harmonics are a prefix")
{
    double all[kMaxShFunctions], some[kMaxShFunctions];
    shBasis(kMaxShFunctions, 0.48, -0.6, 0.64, all);
    for (int count : {1, 4, 9, 16}) {
        std::fill(some, some + kMaxShFunctions, 777.0);
        shBasis(count, 0.48, -0.6, 0.64, some);
        for (int i = 0; i < kMaxShFunctions; ++i) CHECK(some[i] == (i < count ? all[i] : 777.0));
    }
}

TEST_CASE("visibility map: texel centres, seams and slope")
{
    int n = 0;
    SUBCASE("16 x 16") { n = 16; }
    SUBCASE("32 x 32") { n = 32; }
    // A map that holds the height z of its texels' directions, wide enough a ramp that the slope does not clip it.
    const auto direction = [&](int i, int j, double out[3]) {
        const double u = (i + 0.5) / (n / 2) - 1, v = (j + 0.5) / (n / 2) - 1, z = 1 - std::abs(u) - std::abs(v);
        out[0] = z >= 0 ? u : (1 - std::abs(v)) * (u < 0 ? -1 : 1), out[1] = z >= 0 ? v : (1 - std::abs(u)) * (v < 0 ? -1 : 1), out[2] = z;
        const double length = std::sqrt(out[0] * out[0] + out[1] * out[1] + z * z);
        for (int k = 0; k < 3; ++k) out[k] /= length;
    };
    std::vector<uint8_t> texels(size_t(n) * size_t(n));
    const VisibilityMap map{texels.data(), n};
    const auto stored = [](const double* d) { return 0.5 + 0.08 * d[0] - 0.04 * d[1] + 0.05 * d[2]; };
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            double d[3];
            direction(i, j, d);
            texels[size_t(n * j + i)] = uint8_t(std::lround(255 * stored(d)));
        }
    // Everywhere on the sphere, seams and poles included, the bilinear value follows the smooth function.
    for (int k = 0; k < 5000; ++k) {
        const glm::dvec3 d = fibonacciDirection(k, 5000);
        const double expected = 0.5 + kVisibilitySlope * (stored(&d.x) - 0.5);
        CAPTURE(k);
        CHECK(std::abs(mapVisibility(map, &d.x) - expected) < 0.05); // bilinear error of a degree-1 function on texels of up to 15 degrees
    }
    for (const glm::dvec3& axis : {glm::dvec3(1, 0, 0), glm::dvec3(-1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, -1, 0), glm::dvec3(0, 0, -1)})
        CHECK(std::abs(mapVisibility(map, &axis.x) - (0.5 + kVisibilitySlope * (stored(&axis.x) - 0.5))) < 0.05);
    const double up[3] = {0, 0, 1};
    const std::vector<uint8_t> open(texels.size(), 255), closed(texels.size(), 0);
    CHECK(mapVisibility(VisibilityMap{open.data(), n}, up) == 1.0);
    CHECK(mapVisibility(VisibilityMap{closed.data(), n}, up) == 0.0);
}

TEST_CASE("visibility map: any direction stays within the map and its values")
{
    const std::vector<uint8_t> texels(32 * 32, 255);
    const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
    const float extremes[] = {0.0f, -0.0f, 1.0f, -1.0f, 1e-38f, 1e20f, -1e38f, inf, -inf, nan};
    for (const int n : {16, 32})
        for (const float x : extremes)
            for (const float y : extremes)
                for (const float z : extremes) {
                    const float w[3] = {x, y, z};
                    const float v = mapVisibility(VisibilityMap{texels.data(), n}, w);
                    CHECK((v >= 0 && v <= 1));
                }
}

TEST_CASE("lobe: peak at the mirror direction, reciprocal up to the facing term, none from behind, finite for any input")
{
    const double lobe[7] = {0, 0, 1, 200, 1, 1, 1};
    for (int k = 0; k < 500; ++k) {
        const glm::dvec3 wi = fibonacciDirection(k, 500), wo = fibonacciDirection((k * 37) % 500, 500), mirror(-wi.x, -wi.y, wi.z);
        const double value = bigsLobe(lobe, &wo.x, &wi.x), peak = bigsLobe(lobe, &mirror.x, &wi.x);
        CHECK(value >= 0);
        CHECK(value <= 1);
        if (wi.z <= 0) CHECK(value == 0);
        if (wi.z > 0.25) CHECK(peak == doctest::Approx(1));
        if (wi.z > 0.25 && wo.z > 0.25) CHECK(value == doctest::Approx(bigsLobe(lobe, &wi.x, &wo.x)));
        const glm::dvec3 away = -wi;
        CHECK(bigsLobe(lobe, &away.x, &wi.x) == 0);
    }
    const double wild[7] = {30, -4, 8, -1e9, 1, 1, 1}, w[3] = {0.6, 0, 0.8}, v[3] = {0, 0.6, 0.8};
    CHECK(std::isfinite(bigsLobe(wild, w, v)));
}

TEST_CASE("a wide light makes highlights wider and fainter: their integral stays, in both models")
{
    SssSurface<double> surface{{0, 0, 0}, 0.3, 1, {0, 0, 1}};
    const double alpha2 = std::pow(surface.roughness, 4), lobe[7] = {0, 0, 1, 1 / alpha2 - 1, 1, 1, 1};
    double peak = 2;
    for (const float radius : {0.0f, 0.05f, 0.2f, 0.6f}) {
        CAPTURE(radius);
        const double widening = highlightWidening(radius);
        double sss = 0, bigs = 0;
        const int count = 200000;
        for (int i = 0; i < count; ++i) {
            const glm::dvec3 h(fibonacciDirection(i, count)); // light and eye in one direction: that is the half vector
            if (h.z <= 0) continue;
            sss += 4 * 3.14159265358979 / count * sssReflect(surface, &h.x, &h.x, widening).d * h.z;
            const double front = std::min(double(kBigsLobeFacing) * h.z, 1.0);
            bigs += 4 * 3.14159265358979 / count * bigsLobe(lobe, &h.x, &h.x, widening) / front * h.z;
        }
        CHECK(sss == doctest::Approx(1).epsilon(0.002)); // GGX is normalised
        CHECK(bigs == doctest::Approx(3.14159265358979 * alpha2).epsilon(0.002));
        const double up[3] = {0, 0, 1}, now = bigsLobe(lobe, up, up, widening);
        CHECK(now < peak);
        peak = now;
    }
    const double up[3] = {0, 0, 1};
    CHECK(std::isfinite(sssReflect(surface, up, up, 9.0).value[0])); // no wider than rough
    CHECK(bigsLobe(lobe, up, up, 9.0) == doctest::Approx(alpha2));
}

TEST_CASE("a byte that is neither true nor false is an error, not a bool")
{
    for (const int byte : {0, 1, 2, 64, 255}) {
        const std::byte stored[] = {std::byte(byte)};
        ByteReader in(stored);
        const bool value = in.value<bool>();
        CHECK(in.failed == (byte > 1));
        CHECK(value == (byte == 1));
    }
}

TEST_CASE("a position keeps the digits that float32 rounds away, in x, y and z")
{
    std::vector<Light> lights(3);
    const glm::dvec3 exact[] = {{1.000001, 2.000001, 3.000002}, {1e6 + 0.01, -1e6 + 0.02, 3e7 + 0.03}, {0.1, 0.2, 0.3}};
    for (size_t i = 0; i < 3; ++i) setExactPosition(lights[i], exact[i]);
    for (size_t i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) CHECK(std::abs(exactPosition(lights[i])[k] - exact[i][k]) <= 1e-14 * std::abs(exact[i][k]));
}
